!> A method as a transient uses it: it marches from one output time to the next, a few steps a call, and can be
!> saved between two calls and restored, so that a restarted run repeats the uninterrupted one bit for bit.
!>
!> A method says how a step of any length is tried from the present state and how a tried one is accepted. A step that is refused
!> leaves nothing behind: another length can be tried from the same state.
module time_stepper
  use kinds, only: wp, ip
  use archive, only: value_archive
  use ode_system, only: ode, root_course
  use step_control, only: error_norm
  use step_counts, only: rounding_of, same_instant
  use summary_text, only: summary_record
  implicit none (type, external)
  private
  public :: step_end, pass_stops, exchange_common

  !> How a call of `advance` ended: at the output time, before it, or with the solution lost.
  integer, parameter, public :: reached = 1, paused = 2, diverged = 3
  !> Why the solution was lost.
  integer, parameter, public :: trouble_none = 0, trouble_size = 1, trouble_manifold = 2, trouble_accuracy = 3, &
                                trouble_iteration = 4, trouble_shape = 5, trouble_events = 6, trouble_system = 7

  !> Steps as the deck specifies them.
  type, public :: step_settings
    logical :: adaptive = .false.             !! steps are chosen by their errors
    integer :: order = 1                      !! of the method
    real(wp) :: step = 0.0_wp                 !! fixed: as written in the deck [s]
    integer :: parts = 1                      !! fixed: of each step, or piece of one, of a first pass that this one refines
    real(wp) :: tolerance = 0.0_wp            !! adaptive [-]
    real(wp) :: first_step = 0.0_wp           !! adaptive [s], 0: chosen by the method
    real(wp) :: max_step = huge(1.0_wp)       !! adaptive [s]
    real(wp), allocatable :: stops(:)         !! times that end a step, ascending; the last is the end of the run [s]
    logical, allocatable :: jumps(:)          !! whether accelerations jump there
  end type step_settings

  !> Fixed steps: how far the present output interval is done.
  type, public :: step_grid
    integer(ip) :: done = 0                   !! whole steps
    integer :: level = 0                      !! the step is divided into 2**level parts
    integer :: part = 0                       !! parts of it done
    integer :: left = 0                       !! pieces to take up to the time `ends`
    real(wp) :: ends = -1.0_wp                !! [s]
  end type step_grid

  !> Roots at the end of a step of some length, as `find_roots` says.
  type, public :: root_values
    real(wp) :: h = 0.0_wp                    !! [s]
    real(wp), allocatable :: g(:), rate(:)    !! (roots); rates by the length, as far as they are known [any], [any/s]
    type(root_course), allocatable :: course(:)   !! (roots)
  end type root_values

  !> Roots at the present state, and an event there (`event_location`).
  type, public :: root_watch
    type(root_values) :: now                  !! at the present state
    type(root_values) :: end                  !! at the end of the step that was tried
    real(wp), allocatable :: zero(:)          !! (roots) values so small are zero [any]
    logical, allocatable :: fallen(:)         !! (roots) those that have fallen to zero at t
    logical :: pending = .false.              !! some have, and the system has not resolved that event yet
    logical, allocatable :: rounding(:)       !! (roots) those whose fall has changed nothing: not watched until a step is taken
    logical :: locating = .false.             !! lengths are tried: each is taken to the last digit
    integer :: recent = 0                     !! events since the time `since`
    real(wp) :: since = 0.0_wp                !! [s]
  end type root_watch

  !> A method with its state.
  type, abstract, public :: stepper
    type(step_settings) :: settings
    type(error_norm) :: norm                  !! scales of errors, bounds of states with a physical meaning
    real(wp) :: t = 0.0_wp                    !! end of the last accepted step [s]
    integer(ip) :: steps = 0                  !! accepted
    integer(ip) :: rejected = 0               !! tried and given up
    real(wp) :: shortest = huge(1.0_wp)       !! accepted step [s]
    real(wp) :: longest = 0.0_wp              !! [s]
    real(wp) :: removed = 0.0_wp              !! energy that the method itself has taken out so far [J]
    type(step_grid) :: grid
    type(root_watch) :: roots
    integer :: next_stop = 1                  !! first of the stops after t; found again after a restart
    logical :: output_due = .false.           !! fixed: the output interval is done, but for what joins the next step
    integer :: cause = trouble_none           !! why the last trial could not be made
    integer :: trouble = trouble_none         !! after `diverged`
    real(wp) :: tried = 0.0_wp                !! end of the step that is tried [s]
    real(wp), allocatable :: y(:)             !! (n) state at t [unit of each unknown]
    real(wp), allocatable :: trial(:)         !! (n) the end of the step tried, also after `diverged` [unit of each unknown]
    real(wp), allocatable :: path(:, :)       !! (n, 0:5) of the step tried by its share's powers, for roots [unit of each unknown]
    integer :: degree = 5                     !! of that
    real(wp), allocatable :: inner(:)         !! (n) a state of it [unit of each unknown]
  contains
    procedure(begin_march), deferred :: begin
    procedure(make_attempt), deferred :: attempt
    procedure(try_length), deferred :: try_step
    procedure(take_trial), deferred :: accept_step
    procedure(find_path), deferred :: keep_path
    procedure(pass_event), deferred :: restart
    procedure(read_output), deferred :: output_state
    procedure(exchange_march), deferred :: exchange
    procedure :: advance
    procedure :: refuse => lose_step
    procedure :: pack_trial => keep_trial
    procedure :: count_step
    procedure :: keep_lost_state
    procedure :: report_work => no_work_to_report
    procedure :: implicit_work => no_implicit_work
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
    !> Tries a step and accepts it or not, or passes an event that the last one ended at. Sets `trouble` where the solution is lost.
    subroutine make_attempt(self, system, from, to)
      import :: stepper, ode, wp
      class(stepper), intent(inout) :: self
      class(ode), intent(inout) :: system
      real(wp), intent(in) :: from, to        !! last and next output time [s]
    end subroutine make_attempt
    !> Tries a step of size h from t to `tried`; ok is false where it cannot be made, for the reason `cause`.
    subroutine try_length(self, system, h, ok)
      import :: stepper, ode, wp
      class(stepper), intent(inout) :: self
      class(ode), intent(inout) :: system
      real(wp), intent(in) :: h               !! [s]
      logical, intent(out) :: ok
    end subroutine try_length
    !> The step that was tried last becomes the state.
    subroutine take_trial(self, system, h)
      import :: stepper, ode, wp
      class(stepper), intent(inout) :: self
      class(ode), intent(inout) :: system
      real(wp), intent(in) :: h               !! its size [s]
    end subroutine take_trial
    !> The method's own continuous solution within the step that was tried, without quadratures: sets `path` up to its `degree`.
    subroutine find_path(self, h)
      import :: stepper, wp
      class(stepper), intent(inout) :: self
      real(wp), intent(in) :: h               !! length of the step [s]
    end subroutine find_path
    !> Lets the system resolve the event of the roots that have fallen at t, and starts anew from the state y after it; ok is false
    !> where it cannot.
    subroutine pass_event(self, system, ok)
      import :: stepper, ode
      class(stepper), intent(inout) :: self
      class(ode), intent(inout) :: system
      logical, intent(out) :: ok
    end subroutine pass_event
    !> The state at an output time that the march has reached, with its evaluation from the left; not ok: lost, as `trouble` says.
    subroutine read_output(self, system, to, y, ok)
      import :: stepper, ode, wp
      class(stepper), intent(inout) :: self
      class(ode), intent(inout) :: system
      real(wp), intent(in) :: to              !! [s]
      real(wp), intent(inout) :: y(:)         !! (n) state [unit]
      logical, intent(out) :: ok
    end subroutine read_output
    !> Saves or restores the march: exchange_common, then what the method has besides.
    subroutine exchange_march(self, a)
      import :: stepper, value_archive
      class(stepper), intent(inout) :: self
      type(value_archive), intent(inout) :: a
    end subroutine exchange_march
  end interface

contains

  !> Marches towards the output time `to`, at most `most` attempts. Outcome `reached`: y is the state at `to`, on the manifold, and
  !> the system's last evaluation is of that state. At a jump or an event, to rounding, both are those before it. A call that paused
  !> is repeated with the same times. Results must not depend on where the pauses are, nor on what the system evaluated before the
  !> call.
  subroutine advance(self, system, from, to, most, y, outcome)
    class(stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: from, to          !! last and next output time [s]
    integer, intent(in) :: most
    real(wp), intent(inout) :: y(:)           !! (n) state [unit]
    integer, intent(out) :: outcome           !! reached, paused or diverged
    integer :: attempt
    logical :: ok
    attempt = 0
    outcome = paused
    do while (merge(self%t < to - rounding_of(to), .not. self%output_due, self%settings%adaptive))
      if (attempt == most) return
      attempt = attempt + 1
      if (.not. system%fault) call self%attempt(system, from, to)
      if (system%fault) self%trouble = trouble_system
      if (self%trouble /= trouble_none) outcome = diverged
      if (outcome == diverged) return
    end do
    call self%output_state(system, to, y, ok)
    self%output_due = .false.
    outcome = merge(reached, diverged, ok)
  end subroutine advance

  !> Where a method does not divide steps, a fixed step that fails loses the solution.
  subroutine lose_step(self)
    class(stepper), intent(inout) :: self
    self%trouble = self%cause
  end subroutine lose_step

  !> The end of the step that was tried, in the system's layout: most methods have it in `trial`.
  subroutine keep_trial(self)
    class(stepper), intent(inout) :: self
  end subroutine keep_trial

  !> Saves or restores what every method has.
  subroutine exchange_common(self, a)
    class(stepper), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    real(wp), allocatable :: course(:)        ! [any/s], [rad/s], [any]
    integer :: k
    call a%exchange(self%t, self%steps, self%rejected, self%shortest, self%longest, self%removed, self%grid%done, self%grid%level)
    call a%exchange(self%grid%part, self%grid%left, self%grid%ends)
    call a%exchange(self%y)
    associate (r => self%roots)
      call a%exchange(r%now%g, r%now%rate)
      course = [(r%now%course(k)%w, r%now%course(k)%turning, r%now%course(k)%bend, k=1, size(r%fallen))]
      call a%exchange(course)
      r%now%course = [(root_course(course(4*k - 3:4*k - 2), course(4*k - 1), course(4*k)), k=1, size(r%fallen))]
      do k = 1, size(r%fallen)
        call a%exchange(r%fallen(k), r%rounding(k))
      end do
      call a%exchange(r%pending, r%recent, r%since)
    end associate
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

  !> End of a step from t: at a stop that lies within it or just beyond it, else after the wanted length.
  pure subroutine step_end(t, wanted, stops, next, h, ends, at_stop)
    real(wp), intent(in) :: t, wanted         !! [s]
    real(wp), intent(in) :: stops(:)          !! ascending; the last is the end of the run [s]
    integer, intent(inout) :: next            !! first stop after t; on entry one that is not after that
    real(wp), intent(out) :: h, ends          !! step and its end [s]
    logical, intent(out) :: at_stop           !! whether the step ends at that stop
    call pass_stops(t, stops, next)
    at_stop = t + 1.01_wp*wanted >= stops(next)
    h = wanted
    if (at_stop) h = stops(next) - t
    ends = merge(stops(next), t + h, at_stop)
  end subroutine step_end

  !> The first stop after t; the last one is the end of the run.
  pure subroutine pass_stops(t, stops, next)
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in) :: stops(:)          !! ascending [s]
    integer, intent(inout) :: next            !! on entry one that is not after that
    do while (next < size(stops) .and. (stops(next) < t .or. same_instant(stops(next), t)))
      next = next + 1
    end do
  end subroutine pass_stops

  !> Work of solving for steps, in explicit evaluations.
  pure real(wp) function no_implicit_work(self) result(work)
    class(stepper), intent(in) :: self
    work = 0.0_wp                             ! [-]
  end function no_implicit_work

  !> A line for the summary about the method's own work; most methods have none.
  subroutine no_work_to_report(self, text)
    class(stepper), intent(in) :: self
    type(summary_record), intent(inout) :: text
  end subroutine no_work_to_report
end module time_stepper
