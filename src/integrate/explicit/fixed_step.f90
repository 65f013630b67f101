!> Explicit Runge-Kutta methods with a fixed step, one stepping loop for all tableaux.
module fixed_step
  use kinds, only: wp
  use archive, only: value_archive
  use event_location, only: begin_roots
  use fixed_march, only: at_stop, fixed_attempt
  use ode_system, only: ode, is_bounded
  use step_control, only: same_length
  use tableaux, only: tableau
  use time_stepper, only: stepper, exchange_common, trouble_size, trouble_manifold
  implicit none (type, external)
  private

  integer, parameter :: block_size = 512         !! unknowns combined at a time

  !> A tableau with its step.
  type, extends(stepper), public :: fixed_stepper
    type(tableau) :: method
    real(wp), allocatable :: k(:, :)          !! (n, stages) stage derivatives; k(:, 1) is that at y [unit/s]
    real(wp), allocatable :: stage(:)         !! (n) stage state [unit]
  contains
    procedure :: prepare
    procedure :: step_from
    procedure :: weighted
    procedure :: begin
    procedure :: attempt
    procedure :: try_step
    procedure :: accept_step
    procedure :: keep_path
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
    call self%prepare(size(y))
    self%t = t
    self%y = y
    self%trial = y
    call begin_roots(self, system)
    call system%derivative(t, y, .false., self%k(:, 1))
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
    call self%step_from(system, self%t, h, self%trial, ok)
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
    call system%derivative(self%tried, self%y, .not. at_stop(self), self%k(:, 1))
    call self%count_step(self%tried, h)
  end subroutine accept_step

  !> The cubic from the start, with its slope, to the projected end.
  subroutine keep_path(self, h)
    class(fixed_stepper), intent(inout) :: self
    real(wp), intent(in) :: h                 !! [s]
    self%path(:, 0) = self%y
    self%path(:, 1) = h*self%k(:, 1)
    self%path(:, 2) = h*matmul(self%k, self%method%curve)
    self%path(:, 3) = self%trial - self%y - self%path(:, 1) - self%path(:, 2)
    self%degree = 3
  end subroutine keep_path

  !> Goes on after an event.
  subroutine restart(self, system, ok)
    class(fixed_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    logical, intent(out) :: ok
    call system%resolve_events(self%t, self%y, self%roots%fallen, ok)
    call system%derivative(self%t, self%y, .false., self%k(:, 1))
  end subroutine restart

  !> The state, or the end of a step over what is left to the output time; a rest that is rounding needs the derivative alone.
  subroutine output_state(self, system, to, y, ok)
    class(fixed_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: to                !! [s]
    real(wp), intent(inout) :: y(:)           !! (n) [unit]
    logical, intent(out) :: ok
    real(wp) :: rest                          ! [s]
    y = self%y
    ok = .true.
    rest = to - self%t
    if (.not. (abs(rest) > 0.0_wp .or. at_stop(self))) return   ! the last evaluation is that of the row
    if (abs(rest) > same_length*self%settings%step) then
      self%tried = to
      call self%try_step(system, rest, ok)
      if (.not. ok) self%trouble = self%cause
      if (.not. ok) return
      y = self%trial
    else if (abs(rest) > 0.0_wp) then
      call system%derivative(to, y, .true., self%trial)
      y = y + rest*self%trial
    end if
    call system%derivative(to, y, .true., self%trial)
  end subroutine output_state

  !> Saves or restores the march.
  subroutine exchange(self, a)
    class(fixed_stepper), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    call exchange_common(self, a)
    call a%exchange(self%k(:, 1))
  end subroutine exchange

  !> Allocates the work space for n unknowns.
  pure subroutine prepare(self, n)
    class(fixed_stepper), intent(inout) :: self
    integer, intent(in) :: n
    if (allocated(self%k)) deallocate (self%k, self%stage)
    allocate (self%k(n, self%method%stages), self%stage(n), source=0.0_wp)
  end subroutine prepare

  !> One step from t to t + h, without projection, which looks whether its end is finite. On entry k(:, 1) = f(t, y). Where the
  !> state of a stage is not finite or too large, ok is false and y is that state.
  subroutine step_from(self, system, t, h, y, ok)
    class(fixed_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: t, h              !! [s]
    real(wp), intent(inout) :: y(:)           !! (n) [unit]
    logical, intent(out) :: ok
    integer :: i
    associate (s => self%method%stages)
      do i = 2, s
        call combine(size(y), i - 1, s, self%method%a(:, i), h, y, self%k, self%stage)
        ok = is_bounded(self%stage)
        if (.not. ok) exit
        call system%derivative(t + self%method%c(i)*h, self%stage, self%method%c(i) >= 1.0_wp, self%k(:, i))
      end do
      if (ok) call combine(size(y), s, s, self%method%b, h, y, self%k, self%stage)
    end associate
    y = self%stage
  end subroutine step_from

  !> x = h times the weighted sum of the stages and of the derivative at the end of the step.
  subroutine weighted(self, weights, h, last, x)
    class(fixed_stepper), intent(inout) :: self
    real(wp), intent(in) :: weights(:)        !! (stages + 1) [-]
    real(wp), intent(in) :: h                 !! [s]
    real(wp), intent(in) :: last(:)           !! (n) [unit/s]
    real(wp), intent(inout) :: x(:)           !! (n) [unit]
    associate (s => self%method%stages)
      self%stage = (h*weights(s + 1))*last
      call combine(size(x), s, s, weights(1:s), h, self%stage, self%k, x)
    end associate
  end subroutine weighted

  !> x = y + h sum of a_j k_j over the stages, in blocks that stay in the processor's first cache.
  pure subroutine combine(n, used, stages, a, h, y, k, x)
    integer, intent(in) :: n, used, stages
    real(wp), intent(in) :: a(stages), h, y(n), k(n, stages)   !! weights [-], step [s], state [unit], derivatives [unit/s]
    real(wp), intent(inout) :: x(n)                            !! [unit]
    integer :: from
    do from = 1, n, block_size
      call combine_block(min(block_size, n - from + 1), n, used, a, h, y(from), k(from, 1), x(from))
    end do
  end subroutine combine

  !> The same of m unknowns, over the stages whose weight is not zero, two stages a pass.
  pure subroutine combine_block(m, n, used, a, h, y, k, x)
    integer, intent(in) :: m, n, used
    real(wp), intent(in) :: a(used), h, y(m), k(n, *)   !! the same [-], [s], [unit], [unit/s]
    real(wp), intent(inout) :: x(m)                     !! [unit]
    integer :: j, i, unpaired
    logical :: first
    first = .true.
    unpaired = 0
    do j = 1, used
      if (abs(a(j)) <= 0.0_wp) cycle
      if (first) then
        do i = 1, m
          x(i) = y(i) + (h*a(j))*k(i, j)
        end do
        first = .false.
      else if (unpaired == 0) then
        unpaired = j
      else
        do i = 1, m
          x(i) = (x(i) + (h*a(unpaired))*k(i, unpaired)) + (h*a(j))*k(i, j)
        end do
        unpaired = 0
      end if
    end do
    if (unpaired == 0) return
    do i = 1, m
      x(i) = x(i) + (h*a(unpaired))*k(i, unpaired)
    end do
  end subroutine combine_block
end module fixed_step
