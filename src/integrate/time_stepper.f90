!> What a transient sees of a method: it marches from one output time to the next, a few steps a call, and can be
!> saved between two calls and restored, so that a restarted run repeats the uninterrupted one bit for bit.
module time_stepper
  use kinds, only: wp, ip
  use archive, only: value_archive
  use ode_system, only: ode
  use step_control, only: error_norm
  use summary_text, only: summary_record
  implicit none (type, external)
  private
  public :: step_end, exchange_common, loss_of_accuracy

  !> How a call of `advance` ended: at the output time, before it, or with the solution lost.
  integer, parameter, public :: reached = 1, paused = 2, lost = 3
  !> Why the solution was lost.
  integer, parameter, public :: trouble_none = 0, trouble_size = 1, trouble_manifold = 2, trouble_accuracy = 3, &
                                trouble_iteration = 4, trouble_shape = 5, trouble_rounding = 6

  !> What a deck asks of the steps.
  type, public :: step_settings
    logical :: adaptive = .false.             !! steps are chosen by their errors
    real(wp) :: step = 0.0_wp                 !! fixed: as written in the deck [s]
    real(wp) :: tolerance = 0.0_wp            !! adaptive [-]
    real(wp) :: first_step = 0.0_wp           !! adaptive [s], 0: chosen by the method
    real(wp) :: max_step = huge(1.0_wp)       !! adaptive [s]
    real(wp), allocatable :: stops(:)         !! times that end a step, ascending; the last is the end of the run [s]
    logical, allocatable :: jumps(:)          !! whether accelerations jump there
  end type step_settings

  !> A method with its state.
  type, abstract, public :: stepper
    type(step_settings) :: settings
    type(error_norm) :: norm                  !! scales of errors, bounds of what means anything
    real(wp) :: t = 0.0_wp                    !! end of the last accepted step [s]
    integer(ip) :: steps = 0                  !! accepted
    integer(ip) :: rejected = 0               !! tried and given up
    real(wp) :: shortest = huge(1.0_wp)       !! accepted step [s]
    real(wp) :: longest = 0.0_wp              !! [s]
    real(wp) :: removed = 0.0_wp              !! energy that the method itself has taken out so far [J]
    integer :: trouble = trouble_none         !! after `lost`
    real(wp) :: tried = 0.0_wp                !! time that could not be reached [s]
    real(wp), allocatable :: y(:)             !! (n) state at t [unit of each unknown]
    real(wp), allocatable :: trial(:)         !! (n) after `lost`: the state that was given up [unit of each unknown]
  contains
    procedure(begin_march), deferred :: begin
    procedure(advance_march), deferred :: advance
    procedure(exchange_march), deferred :: exchange
    procedure :: count_step
    procedure :: keep_lost_state
    procedure :: account => account_nothing
  end type stepper

  abstract interface
    !> Starts at a state on the manifold; the system's last evaluation is then the one at this state.
    subroutine begin_march(self, system, t, y)
      import :: stepper, ode, wp
      class(stepper), intent(inout) :: self
      class(ode), intent(inout) :: system
      real(wp), intent(in) :: t               !! [s]
      real(wp), intent(in) :: y(:)            !! (n) state [unit]
    end subroutine begin_march
    !> Marches towards the output time `to`, at most `most` steps, tried ones counted. Outcome `reached`: y is the state at
    !> `to`, on the manifold, and the system's last evaluation is the one at it. A call that paused is repeated with the same
    !> times; nothing may depend on where the pauses are, or on what the system last evaluated before the call.
    subroutine advance_march(self, system, from, to, most, y, outcome)
      import :: stepper, ode, wp
      class(stepper), intent(inout) :: self
      class(ode), intent(inout) :: system
      real(wp), intent(in) :: from, to        !! last and next output time [s]
      integer, intent(in) :: most
      real(wp), intent(inout) :: y(:)         !! (n) state [unit]
      integer, intent(out) :: outcome         !! reached, paused or lost
    end subroutine advance_march
    !> Saves or restores the march: exchange_common, then what the method has besides.
    subroutine exchange_march(self, a)
      import :: stepper, value_archive
      class(stepper), intent(inout) :: self
      type(value_archive), intent(inout) :: a
    end subroutine exchange_march
  end interface

contains

  !> Saves or restores what every method has.
  subroutine exchange_common(self, a)
    class(stepper), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    call a%exchange(self%t)
    call a%exchange(self%steps)
    call a%exchange(self%rejected)
    call a%exchange(self%shortest)
    call a%exchange(self%longest)
    call a%exchange(self%removed)
    call a%exchange(self%y)
  end subroutine exchange_common

  !> Notes an accepted step that ended at t.
  subroutine count_step(self, t, h)
    class(stepper), intent(inout) :: self
    real(wp), intent(in) :: t, h              !! [s]
    self%t = t
    self%steps = self%steps + 1
    self%shortest = min(self%shortest, h)
    self%longest = max(self%longest, h)
  end subroutine count_step

  !> Keeps a state that was given up, the time that could not be reached, and why, for the report of the failure.
  subroutine keep_lost_state(self, t, y, trouble)
    class(stepper), intent(inout) :: self
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in) :: y(:)              !! (n) state [unit]
    integer, intent(in) :: trouble
    self%trial = y
    self%tried = t
    self%trouble = trouble
  end subroutine keep_lost_state

  !> End of a step from t: at a stop that lies within it or hardly beyond, else after the step that is wanted.
  pure subroutine step_end(t, wanted, stops, next, h, ends, at_stop)
    real(wp), intent(in) :: t, wanted         !! [s]
    real(wp), intent(in) :: stops(:)          !! ascending; the last is the end of the run [s]
    integer, intent(out) :: next              !! first stop after t
    real(wp), intent(out) :: h, ends          !! step and its end [s]
    logical, intent(out) :: at_stop           !! whether the step ends at that stop
    next = 1
    do while (stops(next) <= t .and. next < size(stops))
      next = next + 1
    end do
    at_stop = t + 1.01_wp*wanted >= stops(next)
    h = wanted
    if (at_stop) h = stops(next) - t
    ends = merge(stops(next), t + h, at_stop)
  end subroutine step_end

  !> Why a step that is too small still errs: rounding where the error is below half the digits and that of a step eight times as
  !> large is not larger by a third power, as no method's own error would be.
  pure integer function loss_of_accuracy(tolerance, error, larger) result(trouble)
    real(wp), intent(in) :: tolerance         !! [-]
    real(wp), intent(in) :: error, larger     !! of the step and of the larger one, over the tolerance [-]
    trouble = trouble_accuracy
    if (error*tolerance < sqrt(epsilon(1.0_wp)) .and. larger < 8**3*error) trouble = trouble_rounding
  end function loss_of_accuracy

  !> A line for the summary about the method's own work; most methods have none.
  subroutine account_nothing(self, text)
    class(stepper), intent(in) :: self
    type(summary_record), intent(inout) :: text
  end subroutine account_nothing
end module time_stepper
