!> Explicit Runge-Kutta methods: one stepping loop for all tableaux.
module runge_kutta
  use kinds, only: wp
  use ode_system, only: ode, is_bounded
  use tableaux, only: tableau
  implicit none (type, external)
  private
  public :: explicit_stepper

  integer, parameter :: block_size = 512         !! unknowns combined at a time

  !> A method with its work space.
  type :: explicit_stepper
    type(tableau) :: method
    real(wp), allocatable :: k(:, :)          !! (n, stages) stage derivatives; k(:, 1) is set by the caller [unit/s]
    real(wp), allocatable :: y(:)             !! (n) stage state [unit]
  contains
    procedure :: prepare
    procedure :: step
    procedure :: weighted
  end type explicit_stepper

contains

  !> Allocates the work space for n unknowns.
  pure subroutine prepare(self, method, n)
    class(explicit_stepper), intent(inout) :: self
    type(tableau), intent(in) :: method
    integer, intent(in) :: n
    self%method = method
    if (allocated(self%k)) deallocate (self%k, self%y)
    allocate (self%k(n, method%stages), self%y(n), source=0.0_wp)
  end subroutine prepare

  !> One step from t to t + h, without projection, which looks whether its end is finite. On entry k(:, 1) = f(t, y). Where the
  !> state of a stage is not finite or too large, ok is false and y is that state.
  subroutine step(self, system, t, h, y, ok)
    class(explicit_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: t, h              !! [s]
    real(wp), intent(inout) :: y(:)           !! (n) [unit]
    logical, intent(out) :: ok
    integer :: i
    do i = 2, self%method%stages
      call combine(size(y), i - 1, self%method%stages, self%method%a(:, i), h, y, self%k, self%y)
      ok = is_bounded(self%y)
      if (.not. ok) exit
      call system%derivative(t + self%method%c(i)*h, self%y, self%method%c(i) >= 1.0_wp, self%k(:, i))
    end do
    if (ok) call combine(size(y), self%method%stages, self%method%stages, self%method%b, h, y, self%k, self%y)
    y = self%y
  end subroutine step

  !> x = h times the weighted sum of the stages and of the derivative at the end of the step.
  subroutine weighted(self, weights, h, last, x)
    class(explicit_stepper), intent(inout) :: self
    real(wp), intent(in) :: weights(:)        !! (stages + 1) [-]
    real(wp), intent(in) :: h                 !! [s]
    real(wp), intent(in) :: last(:)           !! (n) [unit/s]
    real(wp), intent(inout) :: x(:)           !! (n) [unit]
    associate (s => self%method%stages)
      self%y = (h*weights(s + 1))*last
      call combine(size(x), s, s, weights(1:s), h, self%y, self%k, x)
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
end module runge_kutta
