!> Newton's method for one pole of the linearised mechanism, on h(lambda)^-1 = (c^T [T]^-1 b)^-1, which vanishes at poles; a
!> pole that has been found before is divided out (Maehly).
module pole_newton
  use kinds, only: wp
  use complex_modulus, only: modulus_ratio, modulus_slope
  use dynamic_stiffness, only: stiffness_system
  use mode_list, only: mode_set, padded, known_slope
  implicit none (type, external)
  private
  public :: newton_pole, grow_damping

  integer, parameter :: most_newton = 40
  integer, parameter :: stages = 40                    !! of the growing damping

contains

  !> Follows an undamped mode while the damping grows from 0 to 1: the vibration that it turns into.
  subroutine grow_damping(ds, lambda, x, modes, ok)
    type(stiffness_system), intent(inout) :: ds
    complex(wp), intent(inout) :: lambda, x(:)         !! in: the undamped mode; out: its vibration
    type(mode_set), intent(in) :: modes
    logical, intent(out) :: ok                         !! whether it still vibrates and is not known
    integer :: i
    do i = 1, stages
      call newton(ds, lambda, x, modes, (real(i, wp)/stages)**2, .false., ok)
      if (.not. ok) return
    end do
    ok = abs(lambda%im) > 1.0e-12_wp*abs(lambda)
    if (ok) ok = .not. modes%known(ds, lambda, x, 1.0_wp)
  end subroutine grow_damping

  !> Newton's method for one pole. On entry lambda and x start it; a pole that is known with the same shape is divided out.
  subroutine newton_pole(ds, lambda, x, modes, damping, ok)
    type(stiffness_system), intent(inout) :: ds
    complex(wp), intent(inout) :: lambda
    complex(wp), intent(inout) :: x(:)
    type(mode_set), intent(in) :: modes
    real(wp), intent(in) :: damping                    !! 1: the damped system, 0: the undamped one
    logical, intent(out) :: ok
    complex(wp) :: start, x0(size(x))
    integer :: attempt
    start = lambda
    x0 = x
    do attempt = 0, 2
      lambda = start
      if (attempt == 2) lambda = start*cmplx(1.0_wp, 0.05_wp, wp)
      x = x0
      call newton(ds, lambda, x, modes, damping, attempt > 0, ok)
      if (ok) ok = .not. modes%known(ds, lambda, x, damping)
      if (ok) return
    end do
  end subroutine newton_pole

  !> The iteration.
  subroutine newton(ds, lambda, x, modes, damping, deflate, ok)
    type(stiffness_system), intent(inout) :: ds
    complex(wp), intent(inout) :: lambda, x(:)
    type(mode_set), intent(in) :: modes
    real(wp), intent(in) :: damping
    logical, intent(in) :: deflate
    logical, intent(out) :: ok
    complex(wp), allocatable :: b(:), u(:), w(:)
    complex(wp) :: h, dh, slope, step
    real(wp) :: before
    integer :: pass
    ok = .false.
    before = huge(1.0_wp)
    b = ds%times(cmplx(ds%m, 0.0_wp, wp), padded(ds, x))
    b = b/norm2(abs(b))
    do pass = 1, most_newton
      call ds%set(lambda, damping)
      call ds%factor()
      u = b
      call ds%solve(u)
      if (.not. all(abs(u) < huge(1.0_wp))) return
      h = sum(conjg(b)*u)
      w = -ds%times(ds%slope, u)
      call ds%solve(w)
      dh = sum(conjg(b)*w)
      slope = -dh/h
      if (deflate) slope = slope - known_slope(modes, lambda, damping)
      if (.not. abs(slope) > 0.0_wp) return
      step = -1.0_wp/slope
      if (abs(step) > 0.3_wp*abs(lambda)) step = step*(0.3_wp*abs(lambda)/abs(step))
      lambda = lambda + step
      if (abs(step) <= 1.0e-13_wp*abs(lambda) .or. (abs(step) <= 1.0e-7_wp*abs(lambda) .and. abs(step) > 0.3_wp*before)) then
        ok = .true.
        exit
      end if
      before = abs(step)
    end do
    x = u(1:size(x))/norm2(abs(u(1:size(x))))
    if (.not. ok) return
    if (ds%symmetric) then
      call rayleigh(ds, padded(ds, x), damping, lambda)
    else if (ds%conservative .and. damping <= 0.0_wp) then
      call rayleigh_gyroscopic(ds, padded(ds, x), lambda)
    end if
  end subroutine newton

  !> The root of x^T T(lambda) x near lambda: of second order in the error of x where T is symmetric, and free of the
  !> rounding that the factorisation of a nearly singular T leaves in Newton's root.
  subroutine rayleigh(ds, x, damping, lambda)
    type(stiffness_system), intent(in) :: ds
    complex(wp), intent(in) :: x(:)                    !! (n+rows), multipliers zero
    real(wp), intent(in) :: damping
    complex(wp), intent(inout) :: lambda
    complex(wp) :: m, c, k, part(size(ds%groups)), f, df, step
    integer :: pass, r
    m = sum(x*ds%times(cmplx(ds%m, 0.0_wp, wp), x))
    c = damping*sum(x*ds%times(cmplx(ds%c - ds%gyro, 0.0_wp, wp), x))
    k = sum(x*ds%stiffness_product(x, 0))
    do r = 1, size(part)
      part(r) = damping*sum(x*ds%stiffness_product(x, r))
    end do
    do pass = 1, 4
      f = m*lambda**2 + c*lambda + k
      df = 2*m*lambda + c
      do r = 1, size(part)
        associate (p => ds%groups(r))
          f = f + part(r)*modulus_ratio(p%alpha, p%zeta, p%omega, lambda)
          df = df + part(r)*modulus_slope(p%alpha, p%zeta, p%omega, lambda)
        end associate
      end do
      step = -f/df
      if (.not. abs(step) <= 1.0e-4_wp*abs(lambda)) return   ! no polish: the shape is not that of this root
      lambda = lambda + step
      if (abs(step) <= epsilon(1.0_wp)*abs(lambda)) return
    end do
  end subroutine rayleigh

  !> The root i omega of x^H T(i omega) x near lambda, an undamped pole: T is Hermitian there, so that the root is again of
  !> second order in the error of x.
  subroutine rayleigh_gyroscopic(ds, x, lambda)
    type(stiffness_system), intent(in) :: ds
    complex(wp), intent(in) :: x(:)                    !! (n+rows), multipliers zero
    complex(wp), intent(inout) :: lambda
    real(wp) :: m, g, k, omega, step
    integer :: pass
    if (abs(lambda%re) > 1.0e-6_wp*abs(lambda)) return
    m = real(dot_product(x, ds%times(cmplx(ds%m, 0.0_wp, wp), x)), wp)
    g = aimag(dot_product(x, ds%times(cmplx(ds%gyro, 0.0_wp, wp), x)))
    k = real(dot_product(x, ds%stiffness_product(x, 0)), wp)
    omega = lambda%im
    do pass = 1, 4                                     ! -omega^2 m - omega g + k = 0
      step = (k - omega*(g + omega*m))/(g + 2*omega*m)
      if (.not. abs(step) <= 1.0e-4_wp*abs(omega)) return
      omega = omega + step
    end do
    lambda = cmplx(0.0_wp, omega, wp)
  end subroutine rayleigh_gyroscopic
end module pole_newton
