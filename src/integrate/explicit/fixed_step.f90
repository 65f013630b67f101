!> Explicit Runge-Kutta methods with a fixed step: equal steps in each output interval, times never accumulated.
module fixed_step
  use kinds, only: wp, ip
  use archive, only: value_archive
  use ode_system, only: ode, is_bounded
  use runge_kutta, only: explicit_stepper
  use step_counts, only: step_count
  use tableaux, only: tableau
  use time_stepper, only: stepper, exchange_common, reached, paused, lost, trouble_size, trouble_manifold
  implicit none (type, external)
  private

  !> A tableau with its step.
  type, extends(stepper), public :: fixed_stepper
    type(tableau) :: method
    integer(ip) :: done = 0                   !! steps done in the present interval
    type(explicit_stepper) :: stages          !! its k(:, 1) is the derivative at y
  contains
    procedure :: begin
    procedure :: advance
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
    call system%derivative(t, y, .false., self%stages%k(:, 1))
  end subroutine begin

  !> Marches towards an output time (see `time_stepper`).
  subroutine advance(self, system, from, to, most, y, outcome)
    class(fixed_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: from, to          !! [s]
    integer, intent(in) :: most
    real(wp), intent(inout) :: y(:)           !! (n) [unit]
    integer, intent(out) :: outcome
    integer(ip) :: n
    integer :: attempt
    real(wp) :: h
    n = step_count(from, to, self%settings%step)
    h = (to - from)/real(n, wp)
    outcome = paused
    do attempt = 1, most
      self%tried = merge(to, from + real(self%done + 1, wp)*h, self%done + 1 == n)
      call one_step(self, system, from + real(self%done, wp)*h, h, outcome)
      if (outcome == lost) return
      self%done = self%done + 1
      call self%count_step(self%tried, h)
      if (self%done < n) cycle
      self%done = 0
      y = self%y
      outcome = reached
      return
    end do
  end subroutine advance

  !> One step to self%tried with projection, and the derivative there.
  subroutine one_step(self, system, t, h, outcome)
    class(fixed_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: t, h              !! [s]
    integer, intent(inout) :: outcome         !! set where the solution is lost
    real(wp), allocatable :: old(:)           !! (n)
    logical :: ok
    self%trial = self%y
    call self%stages%step(system, t, h, self%trial, ok)
    self%trouble = trouble_size
    if (ok) then
      call system%project(self%tried, self%trial, ok)
      if (.not. ok) self%trouble = merge(trouble_manifold, trouble_size, is_bounded(self%trial))
    end if
    if (.not. ok) then
      outcome = lost
      return
    end if
    call move_alloc(self%y, old)              ! exchanged, not copied
    call move_alloc(self%trial, self%y)
    call move_alloc(old, self%trial)
    call system%derivative(self%tried, self%y, .false., self%stages%k(:, 1))
  end subroutine one_step

  !> Saves or restores the march.
  subroutine exchange(self, a)
    class(fixed_stepper), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    call exchange_common(self, a)
    call a%exchange(self%done)
    call a%exchange(self%stages%k(:, 1))
  end subroutine exchange
end module fixed_step
