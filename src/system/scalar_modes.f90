!> One mode with GHM damping as a system of one degree of freedom: m s^2 + c s + k + sum_r k_r g_r(s) = 0. Its roots are the
!> exact poles of a homogeneous body's mode and start the search of the others. The root that the vibration turns into is
!> followed from the undamped frequency while the damping grows.
module scalar_modes
  use kinds, only: wp
  use complex_modulus, only: ghm_group, modulus_ratio, modulus_slope
  use lapack, only: dgeev
  implicit none (type, external)
  private
  public :: scalar_roots

  integer, parameter :: fractions = 60               !! steps of the growing damping

contains

  !> All roots with Im >= 0; `vibration` is the number of the root that continues the undamped frequency, 0: none (it is
  !> over-damped).
  subroutine scalar_roots(mass, damping, stiffness, part, groups, roots, vibration)
    real(wp), intent(in) :: mass                     !! [kg], scaled
    real(wp), intent(in) :: damping                  !! [kg/s]
    real(wp), intent(in) :: stiffness                !! [N/m], positive
    real(wp), intent(in) :: part(:)                  !! (groups) k_r [N/m]
    type(ghm_group), intent(in) :: groups(:)
    complex(wp), allocatable, intent(out) :: roots(:)
    integer, intent(out) :: vibration
    real(wp), allocatable :: a(:, :), wr(:), wi(:), work(:), left(:, :), right(:, :)
    complex(wp) :: s
    integer :: n, info
    call companion(mass, damping, stiffness, part, groups, a)
    n = size(a, 1)
    allocate (wr(n), wi(n), work(34*n), left(1, 1), right(1, 1))
    call dgeev('N', 'N', n, a, n, wr, wi, left, 1, right, 1, work, size(work), info)
    roots = pack(cmplx(wr, wi, wp), wi >= 0.0_wp)
    vibration = 0
    if (info /= 0 .or. size(roots) == 0) return
    call follow(mass, damping, stiffness, part, groups, s)
    vibration = minloc(abs(roots - s), 1)
    if (abs(roots(vibration) - s) > 1.0e-3_wp*abs(s) .or. roots(vibration)%im <= 0.0_wp) vibration = 0
  end subroutine scalar_roots

  !> First-order form: x' = v, z_k' = w_k, and so on; groups that do not take part are left out.
  subroutine companion(mass, damping, stiffness, part, groups, a)
    real(wp), intent(in) :: mass, damping, stiffness, part(:)
    type(ghm_group), intent(in) :: groups(:)
    real(wp), allocatable, intent(out) :: a(:, :)
    integer :: r, k, n, i
    n = 2
    do r = 1, size(groups)
      if (takes_part(part, stiffness, r)) n = n + 2*size(groups(r)%alpha)
    end do
    allocate (a(n, n), source=0.0_wp)
    a(1, 2) = 1.0_wp
    a(2, 1) = -stiffness/mass
    a(2, 2) = -damping/mass
    i = 1
    do r = 1, size(groups)
      if (.not. takes_part(part, stiffness, r)) cycle
      do k = 1, size(groups(r)%alpha)
        i = i + 2
        a(2, 1) = a(2, 1) - part(r)*groups(r)%alpha(k)/mass
        a(2, i) = part(r)*groups(r)%alpha(k)/mass
        a(i, i + 1) = 1.0_wp
        a(i + 1, 1) = groups(r)%omega(k)**2
        a(i + 1, i) = -groups(r)%omega(k)**2
        a(i + 1, i + 1) = -2*groups(r)%zeta(k)*groups(r)%omega(k)
      end do
    end do
  end subroutine companion

  !> Whether a group's stiffness matters in the mode.
  pure logical function takes_part(part, stiffness, r) result(yes)
    real(wp), intent(in) :: part(:), stiffness
    integer, intent(in) :: r
    yes = abs(part(r)) > 1.0e-9_wp*stiffness
  end function takes_part

  !> The undamped root i omega, followed by Newton steps while the damping grows from 0 to 1.
  subroutine follow(mass, damping, stiffness, part, groups, s)
    real(wp), intent(in) :: mass, damping, stiffness, part(:)
    type(ghm_group), intent(in) :: groups(:)
    complex(wp), intent(out) :: s
    complex(wp) :: f, df
    real(wp) :: tau
    integer :: i, pass, r
    s = cmplx(0.0_wp, sqrt(stiffness/mass), wp)
    do i = 1, fractions
      tau = (real(i, wp)/fractions)**2
      do pass = 1, 8
        f = mass*s**2 + tau*damping*s + stiffness
        df = 2*mass*s + tau*damping
        do r = 1, size(groups)
          associate (p => groups(r))
            f = f + tau*part(r)*modulus_ratio(p%alpha, p%zeta, p%omega, s)
            df = df + tau*part(r)*modulus_slope(p%alpha, p%zeta, p%omega, s)
          end associate
        end do
        if (abs(df) <= 0.0_wp) exit
        s = s - f/df
        if (abs(f/df) <= 1.0e-12_wp*abs(s)) exit
      end do
    end do
  end subroutine follow
end module scalar_modes
