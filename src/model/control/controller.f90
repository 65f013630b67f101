!> Controllers: PID of a sensed quantity against a history (theory.md, section 14). A controller is linear in each of its states,
!> free or at a limit: with w its own states x, the sensed y and y', the reference r and r', and 1,
!>
!>   x' = rates w      demand = kp e + i + kd e'      output = demand, or the limit
!>
!> so that all methods, the linearisation and the transfer function read the same coefficients. What is sampled changes at samples.
module controller
  use kinds, only: half_digits, wp
  use history, only: breakpoint, history_model
  use marker, only: marker_states
  use measure, only: measure_model, measured
  use root_watch, only: watched_roots
  use small_matrices, only: solve_small
  use step_counts, only: rounding_of
  implicit none (type, external)
  private

  integer, parameter, public :: free = 0, at_upper = 1, at_lower = -1   !! states of one that is not sampled
  integer, parameter, public :: unset = -huge(1)  !! no state is kept: it follows from the motion
  integer, parameter :: order = 3                 !! of the Pade approximation of a delay
  !> T omega up to which its phase errs by less than 5 degrees: x - 2 atan(x (1/2 - x^2/120)/(1 - x^2/10)) = 5 degrees [-]
  real(wp), parameter, public :: delay_limit = 4.0473915374627_wp
  integer, parameter, public :: control_parts = 5 !! of w beside the states: y, y', r, r', 1

  !> A controller.
  type, public :: controller_model
    character(32) :: name = ''
    class(measure_model), allocatable :: quantity  !! what it senses
    class(history_model), allocatable :: reference  !! what that is to be
    real(wp) :: kp = 0.0_wp                   !! [unit of the output over that of the quantity]
    real(wp) :: ki = 0.0_wp                   !! [the same per second]
    real(wp) :: kd = 0.0_wp                   !! [the same times a second]
    real(wp) :: filter = 0.0_wp               !! time constant of the derivative's filter; 0: none [s]
    real(wp) :: lower = -huge(1.0_wp)         !! of the output; huge ones are not given [any]
    real(wp) :: upper = huge(1.0_wp)          !! [any]
    real(wp) :: windup_time = 0.0_wp          !! in which the integral follows a limited output [s]
    real(wp) :: sample = 0.0_wp               !! 0: continuous [s]
    real(wp) :: delay = 0.0_wp                !! of what it senses [s]
    integer :: states = 0                     !! first those of the delay
    integer :: first = 0                      !! they stand behind so many of the scene's internal variables
    integer :: smooth = 0, integral = 0, sampled = 0   !! numbers of states: filter, integral, sampled output; 0: none
    real(wp), allocatable :: rates(:, :, :)   !! (states, states + 5, -1:1) of free ones and at a limit [any/s]
    real(wp), allocatable :: output(:, :)     !! (states + 5, -1:1) [any]
    real(wp), allocatable :: demand(:)          !! (states + 5) output without limits [any]
    real(wp), allocatable :: error(:)         !! (states + 5) [unit of the quantity]
    real(wp), allocatable :: change(:)        !! (states + 5) kd e', of a sampled one at a sample [any]
  contains
    procedure :: set_up
    procedure :: inputs
    procedure :: start
    procedure :: law_at
    procedure :: is_beyond
    procedure :: law_in
    procedure :: solve
    procedure :: limited
    procedure :: roots
    procedure :: take_sample
    procedure :: slopes
    procedure :: response
    procedure :: delayed
    procedure :: breakpoints
    procedure :: size_of
    procedure :: winds_back
  end type controller_model

contains

  !> Numbers the states and writes the coefficients.
  subroutine set_up(self)
    class(controller_model), intent(inout) :: self
    real(wp), allocatable :: delayed(:), delayed_rate(:), error_rate(:)   ! coefficients of w
    integer :: n, k, law
    n = merge(order, 0, self%delay > 0.0_wp)
    call number_state(self%filter > 0.0_wp .and. abs(self%kd) > 0.0_wp, self%smooth)
    call number_state(abs(self%ki) > 0.0_wp, self%integral)
    call number_state(self%sample > 0.0_wp, self%sampled)
    self%states = n
    allocate (self%rates(n, n + control_parts, -1:1), source=0.0_wp)
    allocate (self%output(n + control_parts, -1:1), source=0.0_wp)
    delayed = unit(n + 1)
    delayed_rate = unit(n + 2)
    if (self%delay > 0.0_wp) then             ! e^(-T s) = -1 + (240 + 24 (T s)^2)/(120 + 60 T s + 12 (T s)^2 + (T s)^3)
      do k = 1, 2
        self%rates(k, :, 0) = unit(k + 1)/self%delay
      end do
      self%rates(order, :, 0) = (unit(n + 1) - 120*unit(1) - 60*unit(2) - 12*unit(3))/self%delay
      delayed = 240*unit(1) + 24*unit(3) - unit(n + 1)
      delayed_rate = 240*self%rates(1, :, 0) + 24*self%rates(3, :, 0) - unit(n + 2)
    end if
    self%error = unit(n + 3) - delayed
    error_rate = unit(n + 4) - delayed_rate
    self%change = self%kd*error_rate
    if (self%smooth > 0) then                 ! kd s/(filter s + 1)
      self%change = self%kd/(self%filter + self%sample)*(self%error - unit(self%smooth))
      self%rates(self%smooth, :, 0) = (self%error - unit(self%smooth))/self%filter
    end if
    self%demand = self%kp*self%error + self%change
    if (self%integral > 0) then
      self%demand = self%demand + unit(self%integral)
      self%rates(self%integral, :, 0) = self%ki*self%error
    end if
    self%output(:, 0) = self%demand
    if (self%sample > 0.0_wp) then
      self%rates(n - count([self%smooth, self%integral, self%sampled] > 0) + 1:, :, :) = 0.0_wp
      self%output(:, 0) = unit(self%sampled)
    end if
    do law = -1, 1, 2
      self%rates(:, :, law) = self%rates(:, :, 0)
      self%output(:, law) = merge(self%upper, self%lower, law > 0)*unit(n + control_parts)
      if (maxval(abs(self%output(:, law))) >= huge(1.0_wp)) cycle      ! no limit at this end
      if (self%integral > 0 .and. self%windup_time > 0.0_wp) self%rates(self%integral, :, law) = &
        self%rates(self%integral, :, law) + (self%output(:, law) - self%demand)/self%windup_time
    end do
  contains
    !> Gives a state the next number.
    subroutine number_state(has_it, number)
      logical, intent(in) :: has_it
      integer, intent(out) :: number
      n = n + merge(1, 0, has_it)
      number = merge(n, 0, has_it)
    end subroutine number_state

    !> One part of w.
    pure function unit(k) result(x)
      integer, intent(in) :: k
      real(wp) :: x(n + control_parts)
      x = 0.0_wp
      x(k) = 1.0_wp
    end function unit
  end subroutine set_up

  !> w, from its states and those of the markers. The rate of a sensed rate is not known, and nothing asks for it.
  pure function inputs(self, p, t, left_limit, x) result(w)
    class(controller_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: t                 !! [s]
    logical, intent(in) :: left_limit         !! a jump of the reference at t does not act yet
    real(wp), intent(in) :: x(:)              !! (states) [any]
    real(wp) :: w(self%states + control_parts)        ! [any]
    type(measured) :: now
    real(wp) :: h(-1:2)
    call self%quantity%measure(p, now)
    call self%reference%evaluate(t, left_limit, h)
    w = [x, merge(now%rate, now%x - self%quantity%datum, self%quantity%rate), merge(0.0_wp, now%rate, self%quantity%rate), h(0), &
         h(1), 1.0_wp]
  end function inputs

  !> States when it is switched on: the delay has seen the quantity stand still, the filter the error, the integral is 0.
  pure subroutine start(self, p, t, x)
    class(controller_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(out) :: x(:)             !! (states) [any]
    real(wp) :: w(self%states + control_parts)
    x = 0.0_wp
    w = self%inputs(p, t, .false., x)
    if (self%delay > 0.0_wp) x(1) = w(self%states + 1)/120
    w = self%inputs(p, t, .false., x)
    if (self%smooth > 0) x(self%smooth) = dot_product(self%error, w)
  end subroutine start

  !> Which of its laws holds: that of its state, or where no event has led to one that of its demand.
  pure integer function law_at(self, state, w) result(law)
    class(controller_model), intent(in) :: self
    integer, intent(in) :: state
    real(wp), intent(in) :: w(:)              !! (states + 5) [any]
    law = self%law_in(state)
    if (state /= unset .or. self%sample > 0.0_wp) return
    associate (demand => dot_product(self%demand, w))
      if (demand > self%upper) law = at_upper
      if (demand < self%lower) law = at_lower
    end associate
  end function law_at

  !> Which of its laws holds in a state; free, where no state is kept.
  pure integer function law_in(self, state) result(law)
    class(controller_model), intent(in) :: self
    integer, intent(in) :: state
    law = merge(free, state, self%sample > 0.0_wp .or. state == unset)
  end function law_in

  !> Whether its demand is beyond a limit by more than rounding.
  pure logical function is_beyond(self, w) result(yes)
    class(controller_model), intent(in) :: self
    real(wp), intent(in) :: w(:)              !! (states + 5) [any]
    real(wp) :: demand, slack
    demand = dot_product(self%demand, w)
    slack = half_digits*maxval(abs(self%demand*w))
    yes = demand > self%upper + slack .or. demand < self%lower - slack
  end function is_beyond

  !> Whether its output is at a limit: 1 the upper, -1 the lower one. A held output is a state, and known to the rounding of steps.
  pure integer function limited(self, law, output)
    class(controller_model), intent(in) :: self
    integer, intent(in) :: law
    real(wp), intent(in) :: output            !! [any]
    limited = law
    if (.not. self%sample > 0.0_wp) return
    limited = 0
    if (self%lower > -huge(1.0_wp) .and. output <= self%lower + half_digits*abs(self%lower)) limited = at_lower
    if (self%upper < huge(1.0_wp) .and. output >= self%upper - half_digits*abs(self%upper)) limited = at_upper
  end function limited

  !> Its roots: the distance to both limits, the return from one, or the time to the next sample.
  pure subroutine roots(self, t, state, w, left_limit, watched)
    class(controller_model), intent(in) :: self
    real(wp), intent(in) :: t                 !! [s]
    integer, intent(in) :: state              !! of a sampled one the number of the next sample
    real(wp), intent(in) :: w(:)              !! (states + 5) [any]
    logical, intent(in) :: left_limit         !! a jump of the reference at t does not act yet
    type(watched_roots), intent(out) :: watched
    real(wp) :: slope, limit, h(-1:2)
    integer :: n, k, side
    if (self%sample > 0.0_wp) then
      watched%g(1) = state*self%sample - t
      watched%rate(1) = -1.0_wp
      watched%zero(1) = rounding_of(state*self%sample)
      return
    end if
    n = self%states
    slope = huge(1.0_wp)
    if (.not. (self%quantity%rate .or. abs(self%demand(n + 2)) > 0.0_wp)) then
      call self%reference%evaluate(t, left_limit, h)
      slope = dot_product(self%demand, [matmul(self%rates(:, :, state), w), w(n + 2), 0.0_wp, h(1), h(2), 0.0_wp])
    end if
    do k = 1, 2
      limit = merge(self%upper, self%lower, k == 1)
      side = merge(at_upper, at_lower, k == 1)
      if (state == -side .or. abs(limit) >= huge(1.0_wp)) cycle
      if (state == free) side = -side         ! the demand is on this side of the limit
      watched%g(k) = side*(dot_product(self%demand, w) - limit)
      watched%rate(k) = merge(side*slope, slope, slope < huge(1.0_wp))
      watched%zero(k) = 64*epsilon(1.0_wp)*max(abs(limit), maxval(abs(self%demand*w)))
    end do
  end subroutine roots

  !> The sample number k: the output that is held until the next one, the filter and the integral in between.
  pure subroutine take_sample(self, p, k, x)
    class(controller_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    integer, intent(in) :: k
    real(wp), intent(inout) :: x(:)           !! (states) [any]
    real(wp) :: w(self%states + control_parts), demand, error
    w = self%inputs(p, k*self%sample, .false., x)
    demand = dot_product(self%demand, w)
    error = dot_product(self%error, w)
    associate (h => self%sample, limited => min(max(demand, self%lower), self%upper))
      if (self%smooth > 0) x(self%smooth) = (self%filter*x(self%smooth) + h*error)/(self%filter + h)
      if (self%integral > 0) then
        x(self%integral) = x(self%integral) + h*self%ki*error
        if (self%windup_time > 0.0_wp) x(self%integral) = x(self%integral) + h*(limited - demand)/self%windup_time
      end if
      x(self%sampled) = limited
    end associate
  end subroutine take_sample

  !> Derivatives of the output by what it senses and by the rate of that, its states fixed.
  pure function slopes(self, limited) result(d)
    class(controller_model), intent(in) :: self
    integer, intent(in) :: limited            !! 1, -1: at a limit
    real(wp) :: d(2)                          !! [any]
    d = self%output(self%states + 1:self%states + 2, merge(free, limited, self%sample > 0.0_wp))
  end function slopes

  !> Output over sensed quantity at s: output_y + s output_y' + output_x (s - A)^-1 (b_y + s b_y').
  pure complex(wp) function response(self, state, s) result(h)
    class(controller_model), intent(in) :: self
    integer, intent(in) :: state
    complex(wp), intent(in) :: s              !! [1/s]
    complex(wp) :: x(self%states)             ! [any]
    integer :: law
    law = self%law_in(state)
    associate (n => self%states)
      x = self%rates(:, n + 1, law) + s*self%rates(:, n + 2, law)
      call self%solve(law, s, x)
      h = self%output(n + 1, law) + s*self%output(n + 2, law) + sum(self%output(1:n, law)*x)
    end associate
  end function response

  !> Solves (c - A) y = x of its states, 6 at most.
  pure subroutine solve(self, law, c, x)
    class(controller_model), intent(in) :: self
    integer, intent(in) :: law
    complex(wp), intent(in) :: c              !! [1/s]
    complex(wp), intent(inout) :: x(:)        !! (states) [any], then [any s]
    complex(wp) :: a(self%states, self%states)
    integer :: k
    a = -self%rates(:, 1:self%states, law)
    do k = 1, self%states
      a(k, k) = a(k, k) + c
    end do
    call solve_small(a, x)
  end subroutine solve

  !> Transfer function of a delay, by its approximation [-].
  pure complex(wp) function delayed(self, s)
    class(controller_model), intent(in) :: self
    complex(wp), intent(in) :: s              !! [1/s]
    complex(wp) :: x
    x = self%delay*s
    delayed = (120 - x*(60 - x*(12 - x)))/(120 + x*(60 + x*(12 + x)))
  end function delayed

  !> How large a state is where the quantity changes by as much as it may in the scene.
  pure real(wp) function size_of(self, k, change) result(size)   ! [any]
    class(controller_model), intent(in) :: self
    integer, intent(in) :: k                  !! state
    real(wp), intent(in) :: change            !! [m] or [rad]
    size = change
    if (any(k == [self%integral, self%sampled])) size = change*(abs(self%kp) + abs(self%ki) + abs(self%kd))   ! in a second
  end function size_of

  !> Whether its integral follows the output while that is at a limit, along the steps of a method.
  pure logical function winds_back(self) result(yes)
    class(controller_model), intent(in) :: self
    yes = self%integral > 0 .and. self%windup_time > 0.0_wp .and. .not. self%sample > 0.0_wp .and. &
          (self%upper < huge(1.0_wp) .or. self%lower > -huge(1.0_wp))
  end function winds_back

  !> Times at which its output is not smooth: a derivative without a filter follows the reference's slope.
  pure function breakpoints(self, until) result(list)
    class(controller_model), intent(in) :: self
    real(wp), intent(in) :: until             !! end of the run [s]
    type(breakpoint), allocatable :: list(:)
    list = self%reference%breakpoints(until)
    if (abs(self%kd) > 0.0_wp .and. self%smooth == 0) list%order = max(0, list%order - 1)
  end function breakpoints
end module controller
