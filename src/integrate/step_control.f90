!> Step size control of adaptive methods: the error norm, which measures every unknown by its own group, and the
!> proportional-integral controller of Hairer, Norsett and Wanner (Solving Ordinary Differential Equations I, II.4 and IV.2).
module step_control
  use kinds, only: wp
  implicit none (type, external)
  private

  real(wp), parameter :: safety = 0.9_wp      !! on the step that the error model predicts [-]
  real(wp), parameter :: most_shrink = 0.2_wp, most_growth = 10.0_wp   !! bounds on the change of a step [-]
  real(wp), parameter :: integral = 0.04_wp   !! weight of the last error: beta of the reference [-]
  real(wp), parameter :: least_remembered = 1.0e-4_wp   !! a smaller error of the last step counts as this [-]
  real(wp), parameter, public :: least_scale = 1.0e-6_wp   !! floor of a scale, of the scene's size [-], or of angles [rad]
  real(wp), parameter, public :: value_rounding = 16*epsilon(1.0_wp)   !! of a value in its last digits [-]
  real(wp), parameter, public :: same_length = 1.0e-9_wp    !! of a step: steps and times that differ by less are the same [-]

  !> Groups of unknowns that share a scale: the largest value that the group has had, or its floor if that is larger.
  type, public :: error_norm
    integer, allocatable :: group(:)          !! (n) group of each unknown, 0: not measured
    real(wp), allocatable :: floor(:)         !! (groups) least scale of the values [unit of the group]
    logical, allocatable :: rate(:)           !! (groups) rates: their floor is that of the values over the step
    real(wp), allocatable :: bound(:)         !! (groups) values above it have no physical meaning [unit of the group]
    real(wp), allocatable :: largest(:)       !! (groups) largest value so far [unit of the group]
    logical, allocatable :: steady(:)         !! (groups) positions of frames: Newton's method measures them by the scene's size
    real(wp), allocatable :: scale(:)         !! (groups) work [unit of the group]
    logical, allocatable :: slope(:)          !! (groups) rates whose derivatives are measured too: accelerations
    real(wp), allocatable :: steepest(:)      !! (groups) largest such derivative so far [unit/s]
    real(wp), allocatable :: noise(:)   !! (groups) rounding of derivatives of rates, which nothing can undercut [unit/s]
    real(wp) :: fastest = 0.0_wp              !! largest natural frequency of the system, 0: nothing vibrates [rad/s]
  contains
    procedure :: watch
    procedure :: watch_slopes
    procedure :: measure
    procedure :: measure_slopes
    procedure :: out_of_bounds
  end type error_norm

  !> The controller; `order` is the order of the local error that is estimated (5 for 5(4) pairs).
  type, public :: step_controller
    integer :: order = 5
    real(wp) :: last_error = least_remembered   !! error of the last accepted step [-]
    logical :: after_rejection = .false.
  contains
    procedure :: accepted
    procedure :: refused
    procedure :: restart
  end type step_controller

contains

  !> Updates the largest values of all groups; y may be the first part of the state alone.
  pure subroutine watch(self, y)
    class(error_norm), intent(inout) :: self
    real(wp), intent(in) :: y(:)              !! (n) state [unit of each unknown]
    integer :: k
    do k = 1, size(y)
      if (self%group(k) > 0) self%largest(self%group(k)) = max(self%largest(self%group(k)), abs(y(k)))
    end do
  end subroutine watch

  !> Updates the largest derivatives, or the rounding error of derivatives, measured as their change when the state changes in
  !> its last digits. In an equilibrium, where large forces cancel, derivatives are nothing but this rounding.
  pure subroutine watch_slopes(self, dy, rounding)
    class(error_norm), intent(inout) :: self
    real(wp), intent(in) :: dy(:)             !! (n) derivatives, or their change [unit/s]
    logical, intent(in) :: rounding           !! their change is given
    integer :: k
    do k = 1, size(dy)
      associate (g => self%group(k))
        if (g == 0 .or. .not. abs(dy(k)) < huge(1.0_wp)) cycle
        if (self%rate(g) .and. rounding) self%noise(g) = max(self%noise(g), abs(dy(k)))
        if (self%slope(g) .and. .not. rounding) self%steepest(g) = max(self%steepest(g), abs(dy(k)))
      end associate
    end do
  end subroutine watch_slopes

  !> Largest error of a derivative relative to the largest derivative of its group so far, in tolerances. The scale of a group is at
  !> least a millionth of the largest of the system, and what would move the group by its floor in the run: a motion that begins
  !> from nothing has no scale of its own. Rounding is allowed besides: the largest noise of any group, since joints pass it on, and
  !> that of the values, eps v, times h and the square of the fastest frequency.
  real(wp) function measure_slopes(self, e, dy, h, length, tolerance) result(worst)   ! [-]
    class(error_norm), intent(inout) :: self
    real(wp), intent(in) :: e(:), dy(:)       !! (n) errors of derivatives, derivatives at the end of the step [unit/s]
    real(wp), intent(in) :: h, length         !! step, the whole run [s]
    real(wp), intent(in) :: tolerance         !! [-]
    integer :: k
    self%scale = self%steepest
    do k = 1, size(dy)
      if (self%group(k) > 0) self%scale(self%group(k)) = max(self%scale(self%group(k)), abs(dy(k)))
    end do
    self%scale = max(self%scale, max(least_scale*maxval(self%scale/self%floor, self%slope), 1/length**2)*self%floor)
    self%scale = tolerance*self%scale + maxval(self%noise/self%floor, self%slope)*self%floor &
                 + value_rounding*h*self%fastest**2*self%largest + tiny(1.0_wp)
    worst = 0.0_wp
    do k = 1, size(e)
      if (self%group(k) == 0) cycle
      if (self%slope(self%group(k))) worst = max(worst, abs(e(k))/self%scale(self%group(k)))
    end do
  end function measure_slopes

  !> Largest |e| of any unknown over its group's scale, in tolerances: 1 is just allowed. y is the state at the end of the step.
  !> Known rounding of values and of rates is allowed besides: the largest of any group, since joints pass it on. Rates of internal
  !> variables follow small differences of large values: the rounding of their derivatives times h is allowed in their own group.
  real(wp) function measure(self, e, y, h, tolerance, rounding) result(worst)   ! [-]
    class(error_norm), intent(inout) :: self
    real(wp), intent(in) :: tolerance         !! [-]
    real(wp), intent(in) :: e(:), y(:)        !! (n) error and state [unit of each unknown]
    real(wp), intent(in) :: h                 !! step [s]
    real(wp), intent(in), optional :: rounding(:)   !! (n) what of the error is rounding [unit of each unknown]
    real(wp) :: value_digits, rate_digits     ! rounding of values, of rates, over their floors [-]
    integer :: k
    value_digits = 0.0_wp
    rate_digits = 0.0_wp
    do k = 1, merge(size(e), 0, present(rounding))
      if (self%group(k) == 0) cycle
      if (self%rate(self%group(k))) rate_digits = max(rate_digits, abs(rounding(k))/self%floor(self%group(k)))
      if (.not. self%rate(self%group(k))) value_digits = max(value_digits, abs(rounding(k))/self%floor(self%group(k)))
    end do
    do k = 1, size(self%scale)
      self%scale(k) = max(self%largest(k), merge(self%floor(k)/h, self%floor(k), self%rate(k)))
    end do
    do k = 1, size(y)
      if (self%group(k) > 0) self%scale(self%group(k)) = max(self%scale(self%group(k)), abs(y(k)))
    end do
    self%scale = self%scale + merge(rate_digits, value_digits, self%rate)*self%floor/tolerance
    where (self%rate .and. .not. self%slope) self%scale = self%scale + h*self%noise*epsilon(1.0_wp)/(value_rounding*tolerance)
    worst = 0.0_wp
    do k = 1, size(e)
      if (self%group(k) > 0) worst = max(worst, abs(e(k))/self%scale(self%group(k)))
    end do
    worst = worst/tolerance
  end function measure

  !> Whether the values of a group have passed their bound.
  pure logical function out_of_bounds(self)
    class(error_norm), intent(in) :: self
    out_of_bounds = count(self%largest > self%bound) > 0
  end function out_of_bounds

  !> Next step after an accepted one of size h with error err (1: just the tolerance).
  real(wp) function accepted(self, h, err) result(next)   ! [s]
    class(step_controller), intent(inout) :: self
    real(wp), intent(in) :: h                 !! [s]
    real(wp), intent(in) :: err               !! [-]
    real(wp) :: factor
    factor = err**(1.0_wp/self%order - 0.75_wp*integral)/self%last_error**integral
    factor = min(1.0_wp/most_shrink, max(1.0_wp/most_growth, factor/safety))
    next = h/factor
    if (self%after_rejection) next = min(next, h)
    self%last_error = max(err, least_remembered)
    self%after_rejection = .false.
  end function accepted

  !> Step to try after one of size h with an error above 1; err <= 0: the step was lost before its error was known.
  real(wp) function refused(self, h, err) result(next)   ! [s]
    class(step_controller), intent(inout) :: self
    real(wp), intent(in) :: h                 !! [s]
    real(wp), intent(in) :: err               !! [-]
    self%after_rejection = .true.
    next = most_shrink*h
    if (err > 0.0_wp) next = h/min(1.0_wp/most_shrink, err**(1.0_wp/self%order - 0.75_wp*integral)/safety)
  end function refused

  !> Forgets earlier errors: at the start, and where the equations jump.
  subroutine restart(self)
    class(step_controller), intent(inout) :: self
    self%last_error = least_remembered
    self%after_rejection = .false.
  end subroutine restart
end module step_control
