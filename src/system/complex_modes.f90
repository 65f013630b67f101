!> Poles of the linearised mechanism, damping and GHM included: T(lambda) x + J^T mu = 0, J x = 0, a non-linear
!> eigenproblem that is exact in the modulus E(lambda). Every pole is found by Newton's method on
!> h(lambda)^-1 = (c^T [T]^-1 b)^-1, which vanishes at poles, started from the roots of the mode's scalar system; a pole that
!> has been found before is divided out (Maehly).
module complex_modes
  use kinds, only: wp
  use complex_modulus, only: modulus_ratio, modulus_slope
  use dynamic_stiffness, only: stiffness_system
  use lapack, only: dgeev
  use mode_list, only: mode_set, padded, residual_of, known_slope, undamped_mode, vibration_mode, further_mode, real_pole
  use natural_modes, only: natural_subspace, rounding_level
  use scalar_modes, only: scalar_roots
  implicit none (type, external)
  private
  public :: find_modes

  integer, parameter :: most_newton = 40
  integer, parameter :: whole_below = 120              !! unknowns up to which a gyroscopic system is reduced on all its modes

contains

  !> The lowest undamped modes and, with damping, their poles.
  subroutine find_modes(ds, wanted, modes, ok)
    type(stiffness_system), intent(inout) :: ds
    integer, intent(in) :: wanted
    type(mode_set), intent(out) :: modes
    logical, intent(out) :: ok
    real(wp), allocatable :: omega2(:), x(:, :)
    integer :: j, basis
    modes = mode_set(kind=[integer ::], mode=[integer ::], lambda=[complex(wp) ::], residual=[real(wp) ::])
    allocate (modes%x(ds%n, 0))
    basis = wanted
    if (.not. ds%symmetric) basis = merge(ds%n - ds%rows, 2*wanted + 20, ds%n <= whole_below)
    call natural_subspace(ds, basis, omega2, x, ok)
    if (.not. ok) return
    if (ds%symmetric) then
      do j = 1, min(wanted, size(omega2))
        call add_symmetric(ds, omega2(j), x(:, j), j, modes)
      end do
    else
      call gyroscopic_modes(ds, omega2, x, wanted, modes, ok)
    end if
    if (ok .and. ds%damped) call damped_poles(ds, modes)
  end subroutine find_modes

  !> A mode of the symmetric system; a frequency within rounding of zero is a rigid motion.
  subroutine add_symmetric(ds, omega2, x, j, modes)
    type(stiffness_system), intent(inout) :: ds
    real(wp), intent(in) :: omega2, x(:)
    integer, intent(in) :: j
    type(mode_set), intent(inout) :: modes
    complex(wp) :: lambda, v(size(x))
    v = cmplx(x, 0.0_wp, wp)
    lambda = sqrt(cmplx(-omega2, 0.0_wp, wp))
    if (abs(omega2) <= rounding_level(ds, x)) lambda = 0.0_wp
    call modes%add(undamped_mode, j, lambda, residual_of(ds, lambda, v, 0.0_wp), v)
  end subroutine add_symmetric

  !> Undamped modes with gyroscopic terms or an unsymmetric K: the quadratic eigenproblem on the subspace, each pole then
  !> brought to the full system's.
  subroutine gyroscopic_modes(ds, omega2, x, wanted, modes, ok)
    type(stiffness_system), intent(inout) :: ds
    real(wp), intent(in) :: omega2(:), x(:, :)
    integer, intent(in) :: wanted
    type(mode_set), intent(inout) :: modes
    logical, intent(out) :: ok
    real(wp), allocatable :: a(:, :), wr(:), wi(:), vr(:, :), work(:), left(:, :)
    complex(wp), allocatable :: v(:)
    complex(wp) :: lambda
    integer, allocatable :: order(:)
    integer :: p, j, i, info, found
    logical :: good
    p = size(omega2)
    allocate (a(2*p, 2*p), wr(2*p), wi(2*p), vr(2*p, 2*p), work(16*p), left(1, 1), source=0.0_wp)
    do j = 1, p
      a(j, p + j) = 1.0_wp
      v = ds%times(cmplx(ds%k, 0.0_wp, wp), padded(ds, cmplx(x(:, j), 0.0_wp, wp)))
      a(p + 1:, j) = -matmul(real(v(1:ds%n), wp), x)
      v = ds%times(cmplx(ds%gyro, 0.0_wp, wp), padded(ds, cmplx(x(:, j), 0.0_wp, wp)))
      a(p + 1:, p + j) = -matmul(real(v(1:ds%n), wp), x)
    end do
    call dgeev('N', 'V', 2*p, a, 2*p, wr, wi, left, 1, vr, 2*p, work, size(work), info)
    ok = info == 0
    if (.not. ok) return
    call by_modulus(wr, wi, order)
    found = 0
    do i = 1, size(order)
      j = order(i)
      if (found == wanted) exit
      if (wi(j) < 0.0_wp) cycle
      lambda = cmplx(wr(j), wi(j), wp)
      if (wi(j) > 0.0_wp) then
        v = matmul(x, cmplx(vr(1:p, j), vr(1:p, j + 1), wp))
      else
        v = matmul(x, cmplx(vr(1:p, j), 0.0_wp, wp))
      end if
      if (abs(lambda)**2 <= 1.0e-10_wp*maxval(abs(omega2))/p**4) then   ! a rigid motion: found once for its double zero
        if (mod(count(abs(modes%lambda) <= 0.0_wp) + count_small(wr, wi, order(1:i), abs(lambda)), 2) == 0) cycle
        found = found + 1
        call modes%add(undamped_mode, found, (0.0_wp, 0.0_wp), 0.0_wp, v)
        cycle
      end if
      if (abs(wi(j)) <= 1.0e-9_wp*abs(lambda) .and. wr(j) < 0.0_wp) cycle   ! the stable twin of a diverging motion
      call newton_pole(ds, lambda, v, modes, 0.0_wp, good)
      if (.not. good .or. lambda%im < 0.0_wp) cycle
      if (abs(lambda%re) <= 1.0e-10_wp*abs(lambda)) lambda%re = 0.0_wp
      found = found + 1
      call modes%add(undamped_mode, found, lambda, residual_of(ds, lambda, v, 0.0_wp), v)
    end do
  end subroutine gyroscopic_modes

  !> How many of the listed eigenvalues are at most that large.
  pure integer function count_small(wr, wi, list, size_of) result(n)
    real(wp), intent(in) :: wr(:), wi(:), size_of
    integer, intent(in) :: list(:)
    n = count(hypot(wr(list), wi(list)) <= size_of)
  end function count_small

  !> Order of ascending modulus.
  pure subroutine by_modulus(wr, wi, order)
    real(wp), intent(in) :: wr(:), wi(:)
    integer, allocatable, intent(out) :: order(:)
    integer :: i, j, k
    allocate (order(size(wr)))
    do i = 1, size(wr)
      order(i) = i
      do j = i, 2, -1
        if (hypot(wr(order(j)), wi(order(j))) >= hypot(wr(order(j - 1)), wi(order(j - 1)))) exit
        k = order(j)
        order(j) = order(j - 1)
        order(j - 1) = k
      end do
    end do
  end subroutine by_modulus

  !> The poles of every undamped mode found so far.
  subroutine damped_poles(ds, modes)
    type(stiffness_system), intent(inout) :: ds
    type(mode_set), intent(inout) :: modes
    complex(wp), allocatable :: roots(:), x(:), x0(:)
    complex(wp) :: lambda
    real(wp) :: mass, damping, part(size(ds%groups))
    integer :: j, i, vibration, undamped, kind, pass
    logical :: ok
    undamped = modes%count
    do pass = 1, 2                                     ! vibrations first, so that further poles cannot take their place
      do j = 1, undamped
        x0 = modes%x(:, j)
        if (abs(modes%lambda(j)%im) <= 0.0_wp) cycle   ! rigid or diverging: no vibration to damp
        call project(ds, x0, mass, damping, part)
        call scalar_roots(mass, damping, mass*modes%lambda(j)%im**2, part, ds%groups, roots, vibration)
        do i = 1, size(roots)
          if ((i == vibration) .neqv. (pass == 1)) cycle
          lambda = roots(i)
          x = x0
          call newton_pole(ds, lambda, x, modes, 1.0_wp, ok)
          if (.not. ok) then
            modes%lost = modes%lost + 1
            cycle
          end if
          kind = merge(vibration_mode, further_mode, i == vibration)
          if (abs(lambda%im) <= 1.0e-12_wp*abs(lambda)) kind = real_pole
          if (kind == real_pole) lambda%im = 0.0_wp
          if (lambda%im < 0.0_wp) then
            lambda = conjg(lambda)
            x = conjg(x)
          end if
          call modes%add(kind, modes%mode(j), lambda, residual_of(ds, lambda, x, 1.0_wp), x)
        end do
      end do
    end do
  end subroutine damped_poles

  !> Mass, damping and GHM stiffnesses of a shape.
  subroutine project(ds, x, mass, damping, part)
    type(stiffness_system), intent(in) :: ds
    complex(wp), intent(in) :: x(:)
    real(wp), intent(out) :: mass, damping, part(:)
    complex(wp) :: y(ds%n + ds%rows), v(size(y))
    integer :: r, k
    v = padded(ds, x)
    y = ds%times(cmplx(ds%m, 0.0_wp, wp), v)
    mass = real(dot_product(v, y), wp)
    y = ds%times(cmplx(ds%c - ds%gyro, 0.0_wp, wp), v)
    damping = real(dot_product(v, y), wp)
    do r = 1, size(part)
      part(r) = 0.0_wp
      associate (p => ds%groups(r))
        do k = 1, size(p%entry)
          part(r) = part(r) + p%value(k)*real(conjg(v(ds%row(p%entry(k))))*v(ds%col(p%entry(k))), wp)
        end do
      end associate
    end do
  end subroutine project

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
    if (ok .and. ds%symmetric) call rayleigh(ds, padded(ds, x), damping, lambda)
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
end module complex_modes
