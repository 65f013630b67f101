!> The march of an implicit method: fixed steps, of which one that fails is divided and tried again, or steps by the estimated error
!> with continuous output; starting again where loads or drives jump and after events; when a run is lost. A method says how a
!> step is solved, taken and measured, and which step follows from an error.
module implicit_march
  use kinds, only: wp, ip
  use archive, only: value_archive
  use event_location, only: begin_roots, find_event, look_again, next_fall, pass_event
  use fixed_march, only: fixed_attempt
  use ode_system, only: ode, is_bounded
  use second_order_system, only: second_order_ode
  use summary_text, only: summary_record
  use text, only: to_text
  use time_stepper, only: stepper, step_end, exchange_common, trouble_size, trouble_manifold, trouble_iteration, trouble_shape, &
                          loss_of_accuracy
  implicit none (type, external)
  private
  public :: exchange_march

  integer, parameter :: most_halvings = 30         !! of a fixed step that fails
  integer, parameter :: hopeless_halvings = 16     !! a fixed step divided so often is hopeless: a run of them would never end
  real(wp), parameter :: hopeless_steps = 1.0e11_wp   !! so is a controlled one, so many of which are left to the end of the run
  integer, parameter :: most_hopeless = 20000      !! hopeless steps in a row after which the run is given up
  real(wp), parameter :: failure_error = 8.0_wp   !! taken as the error of a step whose Newton iteration failed [-]
  real(wp), parameter :: safety = 0.85_wp          !! on the step that the error model predicts [-]
  real(wp), parameter :: prompt_growth = 2.0_wp   !! a step that may grow by more grows at once [-]
  real(wp), parameter :: most_growth = 5.0_wp      !! of a step [-]
  real(wp), parameter :: least_growth = 1.2_wp    !! a step that may grow by less stays: new matrices would cost more [-]

  !> Errors since the step last changed.
  type, public :: step_memory
    real(wp) :: worst = 0.0_wp                !! over the tolerance [-]
    integer :: steps = 0
  end type step_memory

  !> A march with its state.
  type, abstract, extends(stepper), public :: implicit_stepper
    logical :: started = .false.              !! the method's own variables stand
    integer(ip) :: failures = 0               !! steps that Newton's method could not solve
    integer :: hopeless = 0                   !! steps in a row from which the run would never end
    real(wp) :: h = 0.0_wp                    !! adaptive: next step [s], 0: to be chosen
    integer :: order = 0                      !! adaptive: the estimated error is of this order in the step
    integer :: patience = 0                   !! adaptive: steps whose errors are seen before a step grows
    type(step_memory) :: memory               !! adaptive
    logical :: passes = .false.               !! adaptive: the step that is tried reaches an output time
    real(wp), allocatable :: dense(:, :)      !! (n, 4) what the method interpolates in the last such step [unit of each unknown]
    real(wp) :: dense_times(2) = 0.0_wp       !! where that step began, its size [s]
  contains
    procedure :: begin
    procedure :: attempt
    procedure :: try_step
    procedure :: accept_step
    procedure :: restart
    procedure :: row
    procedure :: refuse => divide_step
    procedure :: pack_trial
    procedure :: end_step
    procedure :: account_failures
    procedure(take_system), deferred :: set_up
    procedure(take_system), deferred :: limit_first_step   !! makes self%h as small as accelerations of a start or jump ask for
    procedure(solve_step), deferred :: solve_step
    procedure(estimate_step), deferred :: measure_step
    procedure(take_step), deferred :: take_step
    procedure(pack_state), deferred :: pack_state
    procedure(interpolate_step), deferred :: interpolate
  end type implicit_stepper

  abstract interface
    !> Takes a system: its work space; its state at the first step.
    subroutine take_system(self, system)
      import :: implicit_stepper, second_order_ode
      class(implicit_stepper), intent(inout) :: self
      class(second_order_ode), intent(inout) :: system
    end subroutine take_system
    !> Solves a step of size h from self%t to self%tried; ok is false where Newton's method fails.
    subroutine solve_step(self, system, h, ok)
      import :: implicit_stepper, second_order_ode, wp
      class(implicit_stepper), intent(inout) :: self
      class(second_order_ode), intent(inout) :: system
      real(wp), intent(in) :: h               !! [s]
      logical, intent(out) :: ok
    end subroutine solve_step
    !> The estimated error of the step that was tried, over what is allowed.
    subroutine estimate_step(self, system, h, error)
      import :: implicit_stepper, second_order_ode, wp
      class(implicit_stepper), intent(inout) :: self
      class(second_order_ode), intent(inout) :: system
      real(wp), intent(in) :: h               !! [s]
      real(wp), intent(out) :: error          !! 1: just allowed [-]
    end subroutine estimate_step
    !> What was solved becomes the state; calls `end_step`.
    subroutine take_step(self, system, h)
      import :: implicit_stepper, second_order_ode, wp
      class(implicit_stepper), intent(inout) :: self
      class(second_order_ode), intent(inout) :: system
      real(wp), intent(in) :: h               !! [s]
    end subroutine take_step
    !> The state at self%t, or the end of the step that was tried, in the system's layout.
    subroutine pack_state(self, tried, y)
      import :: implicit_stepper, wp
      class(implicit_stepper), intent(in) :: self
      logical, intent(in) :: tried
      real(wp), intent(inout) :: y(:)         !! (n) [unit of each unknown]
    end subroutine pack_state
    !> The state at a time within the last step.
    subroutine interpolate_step(self, time, y)
      import :: implicit_stepper, wp
      class(implicit_stepper), intent(in) :: self
      real(wp), intent(in) :: time            !! [s]
      real(wp), intent(inout) :: y(:)         !! (n) state at the step's end, then there [unit of each unknown]
    end subroutine interpolate_step
  end interface

contains

  !> Takes the state; the method's own variables follow with the first step, whose size they need.
  subroutine begin(self, system, t, y)
    class(implicit_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in) :: y(:)              !! (n) [unit of each unknown]
    self%t = t
    self%y = y
    self%trial = y
    allocate (self%dense(size(y), 4), source=0.0_wp)
    call self%norm%watch(y)
    self%cause = trouble_iteration
    call begin_roots(self, system)
    select type (system)
    class is (second_order_ode)
      call self%set_up(system)
      call system%derivative(t, y, .false., self%trial)
    end select
    self%trial = y
  end subroutine begin

  !> Tries the next step and accepts it, or passes an event.
  subroutine attempt(self, system, from, to)
    class(implicit_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: from, to          !! [s]
    if (self%settings%adaptive) then
      select type (system)
      class is (second_order_ode)
        call controlled_step(self, system, from, to)
      end select
    else
      self%hopeless = merge(self%hopeless + 1, 0, self%grid%level >= hopeless_halvings)
      call fixed_attempt(self, system, from, to)
    end if
  end subroutine attempt

  !> Solves a step.
  subroutine try_step(self, system, h, ok)
    class(implicit_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: h                 !! [s]
    logical, intent(out) :: ok
    ok = .false.
    select type (system)
    class is (second_order_ode)
      call self%solve_step(system, h, ok)
    end select
  end subroutine try_step

  !> The step that was solved becomes the state.
  subroutine accept_step(self, system, h)
    class(implicit_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: h                 !! [s]
    select type (system)
    class is (second_order_ode)
      call self%take_step(system, h)
    end select
  end subroutine accept_step

  !> A fixed step that fails is halved until it works; the parts grow again as far as they fit.
  subroutine divide_step(self)
    class(implicit_stepper), intent(inout) :: self
    self%rejected = self%rejected + 1
    self%failures = self%failures + 1
    self%grid%level = self%grid%level + 1
    self%grid%part = 2*self%grid%part
    if (self%grid%level > most_halvings .or. self%hopeless >= most_hopeless) call give_up(self, self%cause)
  end subroutine divide_step

  !> Goes on after an event, from the projected state.
  subroutine restart(self, system, ok)
    class(implicit_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    logical, intent(out) :: ok
    ok = .false.
    select type (system)
    class is (second_order_ode)
      call start_again(self, system, ok)
    end select
    if (ok) call system%resolve_events(self%t, self%y, self%roots%fallen, ok)
    self%h = 0.0_wp
  end subroutine restart

  !> The method starts anew from the projected state.
  subroutine start_again(self, system, ok)
    class(implicit_stepper), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    logical, intent(out) :: ok
    call self%pack_state(.false., self%y)
    call system%report(self%t, self%y, ok)
    self%started = .false.
  end subroutine start_again

  !> The end of the step that was solved.
  subroutine pack_trial(self)
    class(implicit_stepper), intent(inout) :: self
    call self%pack_state(.true., self%trial)
  end subroutine pack_trial

  !> Tries one step of the size that the last error asks for; one that is cut short by a stop does not shorten the next.
  subroutine controlled_step(self, system, from, to)
    class(implicit_stepper), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: from, to          !! [s]
    real(wp) :: h, error, next, end
    integer :: trouble
    logical :: at_stop, at_event, ok
    if (self%roots%pending) then
      call pass_event(self, system)
      return
    end if
    associate (s => self%settings)
      end = s%stops(size(s%stops))
      if (.not. self%h > 0.0_wp) then
        self%h = min(to - from, s%max_step, end - self%t, system%longest_step)
        if (s%first_step > 0.0_wp .and. self%steps == 0) then
          self%h = min(s%first_step, self%h)
        else
          call self%limit_first_step(system)
        end if
      end if
      call step_end(self%t, min(self%h, s%max_step, system%resting_step), s%stops, self%next_stop, h, self%tried, at_stop)
    end associate
    self%passes = self%tried >= to
    self%hopeless = merge(self%hopeless + 1, 0, end - self%t > hopeless_steps*h .and. .not. at_stop)
    call self%try_step(system, h, ok)
    error = huge(1.0_wp)
    if (ok) call self%measure_step(system, h, error)
    at_event = .false.
    if (error <= 1.0_wp .and. system%roots > 0) then
      call find_event(self, system, h, at_event, ok)
      if (.not. ok) error = huge(1.0_wp)
    end if
    if (error > 1.0_wp) then
      self%rejected = self%rejected + 1
      if (.not. ok) self%failures = self%failures + 1
      self%h = next_step(self, h, error)
      if (ok .and. system%roots > 0) self%h = min(self%h, next_fall(self, system, h))
      if (self%h > max(16*spacing(self%t), 1.0e-15_wp*end) .and. self%hopeless < most_hopeless) return
      trouble = trouble_iteration
      if (ok) call try_larger(self, system, h, error, trouble)
      call give_up(self, trouble)
      return
    end if
    if (h > 0.0_wp) call self%accept_step(system, h)
    if (at_event) return
    if (at_stop) call look_again(self, system)
    next = next_step(self, h, error)
    self%h = merge(max(self%h, next), next, at_stop)
    if (.not. self%started) self%h = 0.0_wp
  end subroutine controlled_step

  !> Why the last step, of size h, errs too much, from the error of a larger one.
  subroutine try_larger(self, system, h, error, trouble)
    class(implicit_stepper), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: h                 !! [s]
    real(wp), intent(in) :: error             !! [-]
    integer, intent(out) :: trouble
    real(wp) :: larger                        ! [-]
    logical :: ok
    call self%try_step(system, 8*h, ok)
    larger = huge(1.0_wp)
    if (ok) call self%measure_step(system, 8*h, larger)
    trouble = loss_of_accuracy(self%settings%tolerance, error, larger)
  end subroutine try_larger

  !> Step that estimated errors ask for after one of size h. A new step means new matrices, and errors of a vibration come and go
  !> with its phase: a step grows where the worst error of several steps allows it, or at once where it may grow by much.
  function next_step(self, h, error) result(next)
    class(implicit_stepper), intent(inout) :: self
    real(wp), intent(in) :: h                 !! [s]
    real(wp), intent(in) :: error             !! its estimated error over what is allowed, huge: Newton's method failed [-]
    real(wp) :: next                          !! [s]
    real(wp) :: factor                        ! [-]
    associate (m => self%memory)
      m%worst = max(m%worst, merge(error, failure_error, error < huge(1.0_wp)))
      m%steps = m%steps + 1
      factor = safety*max(m%worst, 1.0e-6_wp)**(-1.0_wp/self%order)
      next = h
      if (error > 1.0_wp) then
        next = h*max(0.2_wp, min(0.8_wp, factor))
      else if (factor > prompt_growth .or. (m%steps >= self%patience .and. factor > least_growth)) then
        next = h*min(factor, most_growth)
      else if (m%steps < self%patience) then
        return
      end if
      m = step_memory()
    end associate
  end function next_step

  !> The end of an accepted step: the run is lost where the state is no longer one of a mechanism; where accelerations jump the
  !> method starts anew from the projected state.
  subroutine end_step(self, system, h, q)
    class(implicit_stepper), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: h                 !! [s]
    real(wp), intent(in), contiguous :: q(:)  !! (nq) positions [m, rad]
    integer :: k
    logical :: ok
    call self%count_step(self%tried, h)
    call self%norm%watch(q)
    if (self%norm%out_of_bounds()) then
      call give_up(self, trouble_shape)
      return
    end if
    do k = max(1, self%next_stop - 1), min(self%next_stop + 1, size(self%settings%stops))
      if (.not. self%settings%jumps(k) .or. abs(self%settings%stops(k) - self%t) > 1.0e-9_wp*h) cycle
      call start_again(self, system, ok)
    end do
  end subroutine end_step

  !> The solution is lost at the step that was tried.
  subroutine give_up(self, trouble)
    class(implicit_stepper), intent(inout) :: self
    integer, intent(in) :: trouble
    call self%pack_state(.true., self%trial)
    self%trouble = trouble
  end subroutine give_up

  !> The state at an output time, on the manifold and with its evaluation.
  subroutine row(self, system, to, y, ok)
    class(implicit_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: to                !! [s]
    real(wp), intent(inout) :: y(:)           !! (n) [unit of each unknown]
    logical, intent(out) :: ok
    ok = .true.
    self%tried = to
    if (self%row_due) call self%try_step(system, to - self%t, ok)   ! what is left to the output time
    call self%pack_state(self%row_due .and. ok, y)
    if (self%t > to) call self%interpolate(to, y)
    ok = ok .and. is_bounded(y)
    select type (system)
    class is (second_order_ode)
      if (ok) call system%report(to, y, ok)
    end select
    ok = ok .and. is_bounded(y)
    if (.not. ok) call self%keep_lost_state(to, y, merge(trouble_manifold, trouble_size, is_bounded(y)))
  end subroutine row

  !> Steps that had to be divided, and the end of the line about the method's work.
  subroutine account_failures(self, text)
    class(implicit_stepper), intent(in) :: self
    type(summary_record), intent(inout) :: text
    call text%member('newton_failures', to_text(self%failures))
    if (self%failures > 0) call text%words%add('; failures of Newton''s method: '//to_text(self%failures)// &
      ', where the step was '//trim(merge('tried smaller', 'halved       ', self%settings%adaptive)))
    call text%line('')
  end subroutine account_failures

  !> Saves or restores what every implicit method has.
  subroutine exchange_march(self, a)
    class(implicit_stepper), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    call exchange_common(self, a)
    call a%exchange(self%started)
    call a%exchange(self%failures)
    call a%exchange(self%hopeless)
    call a%exchange(self%h)
    call a%exchange(self%memory%worst)
    call a%exchange(self%memory%steps)
    call a%exchange(self%norm%largest)
    call a%exchange(self%dense)
    call a%exchange(self%dense_times)
  end subroutine exchange_march
end module implicit_march
