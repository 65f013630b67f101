!> The march of an implicit method: fixed steps, of which one that fails is divided and tried again; starting again where loads or
!> drives jump and after events; when a run is lost. A method says how a step is solved and taken.
module implicit_march
  use kinds, only: wp, ip
  use archive, only: value_archive
  use event_location, only: begin_roots
  use fixed_march, only: at_stop, fixed_attempt
  use ode_system, only: ode, is_bounded
  use second_order_system, only: second_order_ode
  use step_control, only: same_length
  use summary_text, only: summary_record
  use text, only: either, to_text
  use time_stepper, only: stepper, exchange_common, trouble_size, trouble_manifold, trouble_iteration, trouble_shape
  implicit none (type, external)
  private
  public :: exchange_march, fixed_step, give_up, start_again

  integer, parameter :: most_halvings = 30         !! of a fixed step that fails
  integer, parameter :: hopeless_halvings = 16     !! a fixed step divided so often is hopeless: a run of them would never end
  integer, parameter, public :: most_hopeless = 20000      !! hopeless steps in a row after which the run is given up

  !> A march with its state.
  type, abstract, extends(stepper), public :: implicit_stepper
    logical :: started = .false.              !! the method's own variables are set
    integer(ip) :: failures = 0               !! steps that Newton's method could not solve
    integer :: hopeless = 0                   !! steps in a row from which the run would never end
  contains
    procedure :: begin
    procedure :: attempt => fixed_step
    procedure :: try_step
    procedure :: accept_step
    procedure :: restart
    procedure :: output_state
    procedure :: refuse => divide_step
    procedure :: pack_trial
    procedure :: end_step
    procedure :: report_failures
    procedure :: interpolate => no_interpolation
    procedure(take_system), deferred :: set_up
    procedure(solve_step), deferred :: solve_step
    procedure(take_step), deferred :: take_step
    procedure(pack_state), deferred :: pack_state
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
    !> The solved step becomes the state; calls `end_step`.
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
  subroutine fixed_step(self, system, from, to)
    class(implicit_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: from, to          !! [s]
    self%hopeless = merge(self%hopeless + 1, 0, self%grid%level >= hopeless_halvings)
    call fixed_attempt(self, system, from, to)
  end subroutine fixed_step

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
    call start_again(self, system, ok)
    if (ok) call system%resolve_events(self%t, self%y, self%roots%fallen, ok)
  end subroutine restart

  !> The method starts anew from the projected state.
  subroutine start_again(self, system, ok)
    class(implicit_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    logical, intent(out) :: ok
    call self%pack_state(.false., self%y)
    call system%evaluate_on_manifold(self%t, self%y, .false., self%trial, ok)
    self%started = .false.
  end subroutine start_again

  !> The end of the step that was solved.
  subroutine pack_trial(self)
    class(implicit_stepper), intent(inout) :: self
    call self%pack_state(.true., self%trial)
  end subroutine pack_trial

  !> The end of an accepted step. The run is lost where the state has left its physical bounds. Where accelerations jump, the method
  !> starts anew from the projected state.
  subroutine end_step(self, system, h, q)
    class(implicit_stepper), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: h                 !! [s]
    real(wp), intent(in), contiguous :: q(:)  !! (nq) positions [m, rad]
    logical :: ok
    call self%count_step(self%tried, h)
    call self%norm%watch(q)
    if (self%norm%out_of_bounds()) then
      call give_up(self, trouble_shape)
      return
    end if
    if (at_stop(self)) then
      if (self%settings%jumps(self%next_stop)) call start_again(self, system, ok)
    end if
  end subroutine end_step

  !> Ends the run: the solution is lost in the step that was tried.
  subroutine give_up(self, trouble)
    class(implicit_stepper), intent(inout) :: self
    integer, intent(in) :: trouble
    call self%pack_state(.true., self%trial)
    self%trouble = trouble
  end subroutine give_up

  !> The state at an output time, on the manifold and with its evaluation.
  subroutine output_state(self, system, to, y, ok)
    class(implicit_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: to                !! [s]
    real(wp), intent(inout) :: y(:)           !! (n) [unit of each unknown]
    logical, intent(out) :: ok
    real(wp) :: rest                          ! of a fixed step that joins the next one [s]
    integer :: first                          ! unknown that the derivative alone moves over it
    ok = .true.
    rest = 0.0_wp
    if (.not. self%settings%adaptive) rest = to - self%t
    self%tried = to
    first = 1
    call self%pack_state(.false., y)
    if (abs(rest) > same_length*self%settings%step) then
      call self%try_step(system, rest, ok)
      if (ok) call self%pack_state(.true., y)
      select type (system)
      class is (second_order_ode)
        first = size(y) - system%quadratures + 1
      end select
    end if
    if (self%t > to .and. self%settings%adaptive) call self%interpolate(to, y)
    ok = ok .and. is_bounded(y)
    if (ok) call system%evaluate_on_manifold(to, y, .true., self%trial, ok)
    if (.not. ok) then
      call self%keep_lost_state(to, y, merge(trouble_manifold, trouble_size, is_bounded(y)))
      return
    end if
    if (.not. abs(rest) > 0.0_wp) return
    y(first:) = y(first:) + rest*self%trial(first:)
    if (first == 1) call system%derivative(to, y, .true., self%trial)
  end subroutine output_state

  !> The state y at a time within the last step, from that at its end; fixed steps end at the times of rows.
  subroutine no_interpolation(self, time, y)
    class(implicit_stepper), intent(in) :: self
    real(wp), intent(in) :: time              !! [s]
    real(wp), intent(inout) :: y(:)           !! (n) [unit of each unknown]
  end subroutine no_interpolation

  !> Steps that had to be divided, and the end of the line about the method's work.
  subroutine report_failures(self, text)
    class(implicit_stepper), intent(in) :: self
    type(summary_record), intent(inout) :: text
    call text%line('; failures of Newton''s method: {newton_failures #}'//either(', where the step was '//either('tried smaller', &
      'halved', self%settings%adaptive), '', self%failures > 0), [real(wp) :: self%failures])
  end subroutine report_failures

  !> Saves or restores what every implicit method has.
  subroutine exchange_march(self, a)
    class(implicit_stepper), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    call exchange_common(self, a)
    call a%exchange(self%started, self%failures, self%hopeless)
    call a%exchange(self%norm%largest)
  end subroutine exchange_march
end module implicit_march
