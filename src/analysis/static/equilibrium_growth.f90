!> Whether an equilibrium is one that a real mechanism stays in: the growth rate of small motions about it.
module equilibrium_growth
  use kinds, only: wp
  use complex_modes, only: find_modes
  use dynamic_stiffness, only: stiffness_system
  use linear_state, only: linear_system
  use mode_list, only: mode_set
  use natural_modes, only: lowest_natural_modes, rounding_level
  use scene_run, only: run_state
  use text, only: to_text
  implicit none (type, external)
  private
  public :: find_growth

  integer, parameter :: modes_looked_at = 4          !! where bodies turn or loads follow: lowest modes
  real(wp), parameter :: grows = 1.0e-6_wp           !! real part of an eigenvalue that is positive, over its modulus [-]

contains

  !> The largest growth rate of the undamped linearisation, 0: none, and how the body moves that moves most in it. Without
  !> gyroscopic terms and follower loads the lowest squared frequency says it, else the eigenvalues of the lowest modes do.
  subroutine find_growth(run, rate, motion)
    type(run_state), intent(inout) :: run
    real(wp), intent(out) :: rate                    !! [1/s]
    character(:), allocatable, intent(out) :: motion
    type(stiffness_system) :: ds
    type(mode_set) :: modes
    real(wp), allocatable :: omega2(:), x(:, :)
    integer :: k
    logical :: ok
    rate = 0.0_wp
    motion = ''
    call linear_system(run, ds)
    if (ds%n == ds%rows) return
    if (ds%symmetric) then
      call lowest_natural_modes(ds, 1, .false., omega2, x, ok)
      if (.not. ok) return
      if (.not. omega2(1) < -rounding_level(ds, x(:, 1))) return
      rate = sqrt(-omega2(1))
      motion = words_of(run, ds, cmplx(x(:, 1), 0.0_wp, wp))
      return
    end if
    call find_modes(ds, min(modes_looked_at, ds%n - ds%rows), modes, ok)
    if (.not. ok) return
    do k = 1, modes%count
      associate (s => modes%lambda(k))
        if (s%re <= max(rate, grows*abs(s))) cycle
        if (s%re**2 <= rounding_level(ds, abs(modes%x(:, k)))) cycle
        rate = s%re
        motion = words_of(run, ds, modes%x(:, k))
      end associate
    end do
  end subroutine find_growth

  !> The body with the largest part of a motion's kinetic energy, and whether its frame turns about a point, moves along a line, or
  !> its elastic coordinates bend it.
  function words_of(run, ds, x) result(words)
    type(run_state), intent(in) :: run
    type(stiffness_system), intent(in) :: ds
    complex(wp), intent(in) :: x(:)                  !! (n) the motion, body axes [m, rad]
    character(:), allocatable :: words
    complex(wp) :: y(ds%n + ds%rows)
    real(wp) :: part(size(run%sys%m%s%bodies))       ! [J], to a factor
    real(wp) :: line(3)                              ! [m, m, rad]
    integer :: b, i, n, most
    y = ds%times(cmplx(ds%m, 0.0_wp, wp), ds%padded(x))
    do b = 1, size(part)
      i = run%sys%m%s%qo(b)
      n = 3 + run%sys%m%s%bodies(b)%nf
      part(b) = real(dot_product(x(i + 1:i + n), y(i + 1:i + n)), wp)
    end do
    b = maxloc(part, dim=1)
    i = run%sys%m%s%qo(b)
    words = 'body "'//trim(run%sys%m%s%bodies(b)%name)//'", which '
    most = i + maxloc(abs(x(i + 1:i + 3)), dim=1)
    line = real(x(i + 1:i + 3)*conjg(x(most)), wp)
    if (real(dot_product(x(i + 1:i + 3), y(i + 1:i + 3)), wp) < 0.5_wp*part(b)) then
      words = words//'bends'
    else if (abs(line(3))*run%sys%m%s%size > norm2(line(1:2))) then
      words = words//'turns'
    else
      line(1:2) = nint(1000*run%sys%ev%frame%to_global(b, line(1:2))/norm2(line(1:2)))/1000.0_wp
      words = words//'moves along ('//to_text(line(1))//', '//to_text(line(2))//')'
    end if
  end function words_of
end module equilibrium_growth
