!> Poles of the linearised mechanism, damping and GHM included: T(lambda) x + J^T mu = 0, J x = 0, a non-linear
!> eigenproblem that is exact in the modulus E(lambda). Newton's method (`pole_newton`) starts from the roots of each mode's
!> scalar system; a vibration that it misses is followed while the damping grows, and where searches still ended at poles found
!> before, the rest starts from the poles of the system reduced on the undamped modes (`reduced_poles`).
module complex_modes
  use kinds, only: wp
  use dynamic_stiffness, only: stiffness_system
  use gyroscopic_modes, only: add_gyroscopic
  use mode_list, only: mode_set, padded, residual_of, known_slope, undamped_mode, vibration_mode, further_mode, real_pole
  use natural_modes, only: natural_subspace, rounding_level
  use pole_newton, only: newton_pole, grow_damping
  use process, only: caught_signal
  use reduced_poles, only: reduced_system_poles
  use scalar_modes, only: scalar_roots
  implicit none (type, external)
  private
  public :: find_modes

  real(wp), parameter :: no_pole = 1.0e-7_wp           !! residual beyond which Newton's method has not ended at a pole [-]
  integer, parameter :: whole_below = 120              !! unknowns up to which a gyroscopic system is reduced on all its modes

contains

  !> The lowest undamped modes and, with damping, their poles.
  subroutine find_modes(ds, asked, modes, ok)
    type(stiffness_system), intent(inout) :: ds
    integer, intent(in) :: asked                       !! how many modes
    type(mode_set), intent(out) :: modes
    logical, intent(out) :: ok
    real(wp), allocatable :: omega2(:), x(:, :)
    integer :: j, basis, wanted
    modes = mode_set(kind=[integer ::], mode=[integer ::], lambda=[complex(wp) ::], residual=[real(wp) ::])
    allocate (modes%x(ds%n, 0))
    ok = .true.
    wanted = min(asked, ds%n - ds%rows)
    if (wanted == 0) return
    basis = wanted
    if (.not. ds%symmetric) basis = merge(ds%n - ds%rows, 2*wanted + 20, ds%n <= whole_below)
    call natural_subspace(ds, basis, omega2, x, ok)
    if (.not. ok) return
    if (ds%symmetric) then
      do j = 1, min(wanted, size(omega2))
        call add_symmetric(ds, omega2(j), x(:, j), j, modes)
      end do
    else
      call add_gyroscopic(ds, x, wanted, modes, ok)
    end if
    if (ok .and. ds%damped) call damped_poles(ds, modes)
    if (ok .and. modes%lost > 0 .and. caught_signal() == 0) call missing_poles(ds, x, modes)
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

  !> The poles of every undamped mode found so far.
  subroutine damped_poles(ds, modes)
    type(stiffness_system), intent(inout) :: ds
    type(mode_set), intent(inout) :: modes
    complex(wp), allocatable :: roots(:), x(:), x0(:)
    complex(wp) :: lambda
    real(wp) :: mass, damping, part(size(ds%groups))
    integer :: j, i, vibration, undamped, pass
    logical :: ok
    undamped = modes%count
    do pass = 1, 2                                     ! vibrations first, so that further poles cannot take their place
      do j = 1, undamped
        x0 = modes%x(:, j)
        if (caught_signal() > 0) return
        if (abs(modes%lambda(j)%im) <= 0.0_wp) cycle   ! rigid or diverging: no vibration to damp
        call project(ds, x0, mass, damping, part)
        call scalar_roots(mass, damping, mass*modes%lambda(j)%im**2, part, ds%groups, roots, vibration)
        do i = 1, size(roots)
          if ((i == vibration) .neqv. (pass == 1)) cycle
          lambda = roots(i)
          x = x0
          call newton_pole(ds, lambda, x, modes, 1.0_wp, ok)
          if (.not. ok .and. i == vibration) then
            lambda = cmplx(0.0_wp, modes%lambda(j)%im, wp)
            x = x0
            call grow_damping(ds, lambda, x, modes, ok)
          end if
          if (ok) call add_pole(ds, merge(vibration_mode, further_mode, i == vibration), modes%mode(j), lambda, x, modes, ok)
          if (.not. ok) modes%lost = modes%lost + 1
        end do
      end do
    end do
  end subroutine damped_poles

  !> Poles that the searches from single modes did not reach: each belongs to the undamped mode that it resembles most.
  subroutine missing_poles(ds, basis, modes)
    type(stiffness_system), intent(inout) :: ds
    real(wp), intent(in) :: basis(:, :)                !! (n, p) natural subspace
    type(mode_set), intent(inout) :: modes
    complex(wp), allocatable :: lambdas(:), shapes(:, :), x(:)
    complex(wp) :: lambda
    logical, allocatable :: near(:)
    integer :: i, j, kind, undamped
    logical :: ok
    undamped = count(modes%kind == undamped_mode)
    call reduced_system_poles(ds, basis, lambdas, shapes)
    allocate (near(modes%count), source=modes%kind /= undamped_mode)
    do i = 1, size(lambdas)
      lambda = lambdas(i)
      j = 0
      if (any(near)) j = minloc(abs(modes%lambda(1:size(near)) - lambda), 1, near)
      if (j > 0) then
        if (abs(modes%lambda(j) - lambda) <= 1.0e-6_wp*abs(lambda)) then
          near(j) = .false.                            ! this one is listed, once
          cycle
        end if
      end if
      x = shapes(:, i)
      call newton_pole(ds, lambda, x, modes, 1.0_wp, ok)
      if (.not. ok) cycle
      j = most_alike(ds, x, modes, undamped)
      kind = further_mode
      if (.not. any(modes%kind == vibration_mode .and. modes%mode == modes%mode(j))) kind = vibration_mode
      call add_pole(ds, kind, modes%mode(j), lambda, x, modes, ok)
      if (ok) modes%lost = modes%lost - 1
    end do
  end subroutine missing_poles

  !> Adds a pole with Im >= 0, unless what it leaves of the equations says that it is none.
  subroutine add_pole(ds, kind, mode, lambda, x, modes, ok)
    type(stiffness_system), intent(inout) :: ds
    integer, intent(in) :: kind, mode                  !! kind if it oscillates, number of its undamped mode
    complex(wp), intent(in) :: lambda, x(:)
    type(mode_set), intent(inout) :: modes
    logical, intent(out) :: ok                         !! whether it was added
    complex(wp) :: pole, shape(size(x))
    real(wp) :: residual
    logical :: still
    still = abs(lambda%im) <= 1.0e-12_wp*abs(lambda)
    pole = cmplx(lambda%re, merge(0.0_wp, abs(lambda%im), still), wp)
    shape = x
    if (lambda%im < 0.0_wp .and. .not. still) shape = conjg(x)
    residual = residual_of(ds, pole, shape, 1.0_wp)
    ok = residual <= no_pole
    if (ok) call modes%add(merge(real_pole, kind, still), mode, pole, residual, shape)
  end subroutine add_pole

  !> Which of the first modes resembles a shape most, in the sense of the mass matrix.
  integer function most_alike(ds, x, modes, undamped) result(best)
    type(stiffness_system), intent(in) :: ds
    complex(wp), intent(in) :: x(:)
    type(mode_set), intent(in) :: modes
    integer, intent(in) :: undamped                    !! how many of the modes are undamped ones
    complex(wp) :: mx(ds%n + ds%rows), my(ds%n + ds%rows)
    real(wp) :: alike, most
    integer :: j
    best = 1
    most = -1.0_wp
    mx = ds%times(cmplx(ds%m, 0.0_wp, wp), padded(ds, x))
    do j = 1, undamped
      my = ds%times(cmplx(ds%m, 0.0_wp, wp), padded(ds, modes%x(:, j)))
      alike = abs(dot_product(modes%x(:, j), mx(1:ds%n)))**2/abs(dot_product(modes%x(:, j), my(1:ds%n)))
      if (alike <= most) cycle
      most = alike
      best = j
    end do
  end function most_alike

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
end module complex_modes
