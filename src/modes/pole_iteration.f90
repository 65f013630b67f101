!> One pole of the linearised mechanism with its right and left vectors, T(lambda) x = 0, y^T T(lambda) = 0, by two-sided
!> Rayleigh iteration (Schreiber 2008): x <- T^-1 T' x, y <- T^-T T'^T y, lambda the root of y^T T(lambda) x. It converges
!> cubically, and the root is of second order in the errors of x and y: what rounding leaves in the factor of a nearly
!> singular T does not reach lambda.
module pole_iteration
  use kinds, only: wp, half_digits
  use dynamic_stiffness, only: stiffness_system
  implicit none (type, external)
  private
  public :: pole_state, start_pole, refine_pole, follow_damping, double_root

  integer, parameter :: most_passes = 30           ! a double root is approached by halves
  real(wp), parameter :: pole_change = half_digits   !! change that ends the iteration: the next one is its cube [-]
  real(wp), parameter, public :: same_shape = 0.99_wp   !! share of a shape, by modal masses, that makes it another one [-]
  real(wp), parameter :: smallest_step = epsilon(1.0_wp)**0.25_wp   !! of the growing damping [-]

  !> A pole.
  type :: pole_state
    complex(wp) :: lambda = (0.0_wp, 0.0_wp)           !! [1/s]
    complex(wp), allocatable :: x(:)                   !! (n) right vector, its largest entry 1 [-]
    complex(wp), allocatable :: y(:)                   !! (n) left vector, likewise [-]
    complex(wp) :: m = (0.0_wp, 0.0_wp)                !! y^T M x [kg]
    complex(wp) :: gyro = (0.0_wp, 0.0_wp)             !! likewise of gyroscopic terms [kg/s]
    complex(wp) :: c = (0.0_wp, 0.0_wp)                !! of damping [kg/s]
    complex(wp) :: k = (0.0_wp, 0.0_wp)                !! of the stiffness at E_R [kg/s2]
    complex(wp), allocatable :: part(:)                !! (groups) of what viscoelastic terms multiply [kg/s2]
  end type pole_state

contains

  !> A first estimate: without gyroscopic terms the left vector is the right one, with them its conjugate is near.
  function start_pole(ds, lambda, x) result(pole)
    type(stiffness_system), intent(in) :: ds
    complex(wp), intent(in) :: lambda                  !! [1/s]
    complex(wp), intent(in) :: x(:)                    !! (n) shape [-]
    type(pole_state) :: pole
    pole%lambda = lambda
    pole%x = x/maxval(abs(x))
    pole%y = pole%x
    if (.not. ds%symmetric) pole%y = conjg(pole%x)
    call find_forms(ds, pole)
  end function start_pole

  !> The bilinear forms of the present vectors, stiffness summed in twice the working precision.
  pure subroutine find_forms(ds, pole)
    type(stiffness_system), intent(in) :: ds
    type(pole_state), intent(inout) :: pole
    complex(wp), dimension(ds%n + ds%rows) :: x, y
    integer :: r
    x = ds%padded(pole%x)
    y = ds%padded(pole%y)
    pole%m = sum(y*ds%times(cmplx(ds%m, 0.0_wp, wp), x))
    pole%gyro = sum(y*ds%times(cmplx(ds%gyro, 0.0_wp, wp), x))
    pole%c = sum(y*ds%times(cmplx(ds%c - ds%gyro, 0.0_wp, wp), x))
    pole%k = sum(y*ds%stiffness_product(x, 0))
    pole%part = [(sum(y*ds%stiffness_product(x, r)), r=1, size(ds%groups))]
  end subroutine find_forms

  !> y^T T(s) x and its derivative by s. Without damping the laws are not evaluated: s may be a pole of theirs.
  pure subroutine functional(ds, pole, s, damping, f, slope)
    type(stiffness_system), intent(in) :: ds
    type(pole_state), intent(in) :: pole
    complex(wp), intent(in) :: s                       !! [1/s]
    real(wp), intent(in) :: damping                    !! [-]
    complex(wp), intent(out) :: f, slope               !! [kg/s2], [kg/s]
    complex(wp) :: damped                              ! part of f that grows with the damping [kg/s2]
    integer :: r
    damped = pole%c*s
    slope = pole%c
    do r = 1, merge(size(ds%groups), 0, damping > 0.0_wp)
      damped = damped + pole%part(r)*ds%groups(r)%law%ratio(s)
      slope = slope + pole%part(r)*ds%groups(r)%law%slope(s)
    end do
    f = pole%m*s**2 + pole%gyro*s + pole%k + damping*damped
    slope = 2*pole%m*s + pole%gyro + damping*slope
  end subroutine functional

  !> Iterates until the next change would be rounding, or the changes are rounding alone.
  subroutine refine_pole(ds, damping, pole, ok)
    type(stiffness_system), intent(inout) :: ds
    real(wp), intent(in) :: damping                    !! 1: the damped system, 0: the undamped one [-]
    type(pole_state), intent(inout) :: pole
    logical, intent(out) :: ok
    complex(wp) :: before, u(ds%n + ds%rows)
    real(wp) :: change, last
    integer :: pass
    last = huge(1.0_wp)
    do pass = 1, most_passes
      before = pole%lambda
      call ds%set(pole%lambda, damping)
      call ds%factor()
      u = ds%times(ds%slope, ds%padded(pole%x))
      call ds%solve(u)
      pole%x = u(1:ds%n)/maxval(abs(u(1:ds%n)))
      if (ds%symmetric) then
        pole%y = pole%x
      else                                           ! not corrected: the root is of second order in the errors of both vectors
        u = ds%times(ds%slope(ds%mirror), ds%padded(pole%y))
        call ds%solver%solve(u, .true.)
        pole%y = u(1:ds%n)/maxval(abs(u(1:ds%n)))
      end if
      call find_forms(ds, pole)
      call functional_root(ds, damping, pole, ok)
      if (.not. ok) return
      change = abs(pole%lambda - before)
      if (change <= pole_change*abs(pole%lambda)) return
      if (change <= 1.0e-7_wp*abs(pole%lambda) .and. change > 0.3_wp*last) return   ! rounding alone changes it
      last = change
    end do
    ok = .false.
  end subroutine refine_pole

  !> The root of y^T T(lambda) x near lambda, by Newton's method.
  subroutine functional_root(ds, damping, pole, ok)
    type(stiffness_system), intent(in) :: ds
    real(wp), intent(in) :: damping                    !! [-]
    type(pole_state), intent(inout) :: pole
    logical, intent(out) :: ok
    complex(wp) :: f, slope, step, lambda
    integer :: pass
    lambda = pole%lambda
    do pass = 1, 8
      call functional(ds, pole, lambda, damping, f, slope)
      step = 0.0_wp
      if (abs(f) > 0.0_wp) step = -f/slope
      if (abs(step) > 0.3_wp*abs(lambda)) step = step*(0.3_wp*abs(lambda)/abs(step))
      ok = abs(step) <= abs(lambda)
      if (.not. ok) return
      lambda = lambda + step
      if (abs(step) <= epsilon(1.0_wp)*abs(lambda)) exit
    end do
    pole%lambda = lambda
  end subroutine functional_root

  !> Whether a pole is a double root with one vector: y^T T' x vanishes. Rounding spreads the two in any estimate.
  pure logical function double_root(ds, damping, pole) result(yes)
    type(stiffness_system), intent(in) :: ds
    real(wp), intent(in) :: damping                    !! [-]
    type(pole_state), intent(in) :: pole
    complex(wp) :: f, slope
    call functional(ds, pole, pole%lambda, damping, f, slope)
    yes = abs(slope) <= 1.0e-3_wp*abs(2*pole%lambda*pole%m)
  end function double_root

  !> Follows a vibrating pole while the damping changes, in steps so small that its shape hardly changes.
  subroutine follow_damping(ds, longest, pole, vibrates)
    type(stiffness_system), intent(inout) :: ds
    real(wp), intent(in) :: longest                    !! step of the damping, which grows from 0 to 1 [-]
    type(pole_state), intent(inout) :: pole            !! in: undamped; out: the vibration that it turns into
    logical, intent(out) :: vibrates                   !! false: it meets the real axis, over-damped, or could not be followed
    type(pole_state) :: next
    complex(wp) :: predicted
    real(wp) :: damping, step, next_damping
    logical :: accepted
    damping = 0.0_wp
    step = longest
    vibrates = .true.
    if (.not. ds%symmetric) call refine_pole(ds, damping, pole, vibrates)
    do while (vibrates .and. damping < 1.0_wp)
      next_damping = min(damping + step, 1.0_wp)
      next = pole
      call functional_root(ds, next_damping, next, accepted)
      predicted = next%lambda                           ! of the former shape: a large change would be another pole
      if (accepted) call refine_pole(ds, next_damping, next, accepted)
      if (accepted) accepted = next%lambda%im > 1.0e-9_wp*abs(next%lambda) .and. alike(ds, pole%x, next%x) .and. &
                               abs(next%lambda - predicted) <= 0.01_wp*abs(next%lambda)
      if (accepted) then
        pole = next
        damping = next_damping
        step = min(2*step, longest)
      else
        step = step/2
        vibrates = step > smallest_step
      end if
    end do
  end subroutine follow_damping

  !> Whether two shapes are the same, or one the conjugate of the other: by modal masses, as the modal assurance criterion.
  pure logical function alike(ds, a, b) result(yes)
    type(stiffness_system), intent(in) :: ds
    complex(wp), intent(in) :: a(:), b(:)              !! (n) [m, rad]
    complex(wp) :: ma(size(a))                         ! [kg m, kg m2]
    ma = ds%momentum(a)
    yes = max(abs(dot_product(b, ma)), abs(sum(b*ma)))**2 > &
          same_shape*abs(dot_product(a, ma))*abs(dot_product(b, ds%momentum(b)))
  end function alike
end module pole_iteration
