!> Whether an equilibrium is one that a real mechanism stays in: the growth rate of small motions about it.
module equilibrium_growth
  use kinds, only: wp
  use complex_modes, only: find_modes
  use dynamic_stiffness, only: stiffness_system
  use linear_state, only: linear_system
  use mode_list, only: mode_set
  use natural_modes, only: lowest_natural_modes, rounding_level
  use scene_run, only: run_state
  implicit none (type, external)
  private
  public :: find_growth

  integer, parameter :: modes_looked_at = 4          !! where bodies turn or loads follow: lowest modes
  real(wp), parameter :: grows = 1.0e-6_wp           !! real part of an eigenvalue that is positive, over its modulus [-]

contains

  !> The largest growth rate of the undamped linearisation, 0: none, and the body that moves most in it. Without
  !> gyroscopic terms and follower loads the lowest squared frequency says it, else the eigenvalues of the lowest modes do.
  subroutine find_growth(run, rate, body)
    type(run_state), intent(inout) :: run
    real(wp), intent(out) :: rate                    !! [1/s]
    integer, intent(out) :: body
    type(stiffness_system) :: ds
    type(mode_set) :: modes
    real(wp), allocatable :: omega2(:), x(:, :)
    integer :: k
    logical :: ok
    rate = 0.0_wp
    body = 0
    call linear_system(run, ds)
    if (ds%n == ds%rows) return
    if (ds%symmetric) then
      call lowest_natural_modes(ds, 1, .false., omega2, x, ok)
      if (.not. ok) return
      if (.not. omega2(1) < -rounding_level(ds, x(:, 1))) return
      rate = sqrt(-omega2(1))
      body = most_moved(run, ds, cmplx(x(:, 1), 0.0_wp, wp))
      return
    end if
    call find_modes(ds, min(modes_looked_at, ds%n - ds%rows), modes, ok)
    if (.not. ok) return
    do k = 1, modes%count
      associate (s => modes%lambda(k))
        if (s%re <= max(rate, grows*abs(s))) cycle
        if (s%re**2 <= rounding_level(ds, abs(modes%x(:, k)))) cycle
        rate = s%re
        body = most_moved(run, ds, modes%x(:, k))
      end associate
    end do
  end subroutine find_growth

  !> The body with the largest part of a motion's kinetic energy.
  integer function most_moved(run, ds, x) result(body)
    type(run_state), intent(in) :: run
    type(stiffness_system), intent(in) :: ds
    complex(wp), intent(in) :: x(:)                  !! (n) the motion, body axes [m, rad]
    complex(wp) :: y(ds%n + ds%rows)
    real(wp) :: part(size(run%sys%m%s%bodies))       ! [J], to a factor
    integer :: b, i, n
    y = ds%times(cmplx(ds%m, 0.0_wp, wp), ds%padded(x))
    do b = 1, size(part)
      i = run%sys%m%s%qo(b)
      n = 3 + run%sys%m%s%bodies(b)%nf
      part(b) = real(dot_product(x(i + 1:i + n), y(i + 1:i + n)), wp)
    end do
    body = maxloc(part, dim=1)
  end function most_moved
end module equilibrium_growth
