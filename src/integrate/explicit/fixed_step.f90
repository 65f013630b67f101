!> Explicit Runge-Kutta methods with a fixed step.
module fixed_step
  use kinds, only: wp
  use archive, only: value_archive
  use event_location, only: begin_roots
  use fixed_march, only: at_stop, fixed_attempt
  use ode_system, only: ode, is_bounded
  use runge_kutta, only: explicit_stepper
  use tableaux, only: tableau
  use time_stepper, only: stepper, exchange_common, trouble_size, trouble_manifold
  implicit none (type, external)
  private

  !> A tableau with its step.
  type, extends(stepper), public :: fixed_stepper
    type(tableau) :: method
    type(explicit_stepper) :: stages          !! its k(:, 1) is the derivative at y
  contains
    procedure :: begin
    procedure :: attempt
    procedure :: try_step
    procedure :: accept_step
    procedure :: restart
    procedure :: output_state
    procedure :: exchange
  end type fixed_stepper

contains

  !> Starts at a state.
  subroutine begin(self, system, t, y)
    class(fixed_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in) :: y(:)              !! (n) [unit]
    call self%stages%prepare(self%method, size(y))
    self%t = t
    self%y = y
    self%trial = y
    call begin_roots(self, system)
    call system%derivative(t, y, .false., self%stages%k(:, 1))
  end subroutine begin

  !> The next step or piece of one.
  subroutine attempt(self, system, from, to)
    class(fixed_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: from, to          !! [s]
    call fixed_attempt(self, system, from, to)
  end subroutine attempt

  !> The stages of a step and its projected end.
  subroutine try_step(self, system, h, ok)
    class(fixed_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: h                 !! [s]
    logical, intent(out) :: ok
    self%trial = self%y
    call self%stages%step(system, self%t, h, self%trial, ok)
    self%cause = trouble_size
    if (.not. ok) return
    call system%project(self%tried, self%trial, ok)
    if (.not. ok) self%cause = merge(trouble_manifold, trouble_size, is_bounded(self%trial))
  end subroutine try_step

  !> The trial becomes the state. Its derivative may have been found with the roots. At a stop, where loads may jump, the derivative
  !> after the jump is taken.
  subroutine accept_step(self, system, h)
    class(fixed_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: h                 !! [s]
    real(wp), allocatable :: old(:)           !! (n)
    call move_alloc(self%y, old)              ! exchanged, not copied
    call move_alloc(self%trial, self%y)
    call move_alloc(old, self%trial)
    call system%derivative(self%tried, self%y, .not. at_stop(self, h), self%stages%k(:, 1))
    call self%count_step(self%tried, h)
  end subroutine accept_step

  !> Goes on after an event.
  subroutine restart(self, system, ok)
    class(fixed_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    logical, intent(out) :: ok
    call system%resolve_events(self%t, self%y, self%roots%fallen, ok)
    call system%derivative(self%t, self%y, .false., self%stages%k(:, 1))
  end subroutine restart

  !> The state, or the end of a step over what is left to the output time.
  subroutine output_state(self, system, to, y, ok)
    class(fixed_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: to                !! [s]
    real(wp), intent(inout) :: y(:)           !! (n) [unit]
    logical, intent(out) :: ok
    y = self%y
    ok = .true.
    if (.not. self%output_due .and. at_stop(self, self%settings%step)) call system%derivative(to, y, .true., self%trial)
    if (.not. self%output_due) return
    self%tried = to
    call self%try_step(system, to - self%t, ok)
    if (.not. ok) self%trouble = self%cause
    if (.not. ok) return
    y = self%trial
    call system%derivative(to, y, .true., self%trial)
  end subroutine output_state

  !> Saves or restores the march.
  subroutine exchange(self, a)
    class(fixed_stepper), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    call exchange_common(self, a)
    call a%exchange(self%stages%k(:, 1))
  end subroutine exchange
end module fixed_step
