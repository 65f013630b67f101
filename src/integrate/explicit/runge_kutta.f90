!> Explicit Runge-Kutta methods: tableaux as data, one stepping loop.
module runge_kutta
  use kinds, only: wp
  use ode_system, only: ode, is_bounded
  implicit none (type, external)
  private
  public :: tableau, classical_rk4, dormand_prince, explicit_stepper

  integer, parameter :: block_size = 512         !! unknowns combined at a time

  !> A Butcher tableau of an explicit method.
  type :: tableau
    integer :: stages = 0
    integer :: order = 0
    real(wp), allocatable :: a(:, :)          !! (stages, stages): column i holds the weights of stage i, a(j, i) for j < i [-]
    real(wp), allocatable :: b(:)             !! (stages) weights [-]
    real(wp), allocatable :: c(:)             !! (stages) nodes [-]
  end type tableau

  !> A method with its work space.
  type :: explicit_stepper
    type(tableau) :: method
    real(wp), allocatable :: k(:, :)          !! (n, stages) stage derivatives; k(:, 1) is set by the caller [unit/s]
    real(wp), allocatable :: y(:)             !! (n) stage state [unit]
  contains
    procedure :: prepare
    procedure :: step
  end type explicit_stepper

contains

  !> The classical fourth-order method (Kutta 1901).
  pure function classical_rk4() result(m)
    type(tableau) :: m
    m%stages = 4
    m%order = 4
    allocate (m%a(4, 4), source=0.0_wp)
    m%a(1, 2) = 0.5_wp
    m%a(2, 3) = 0.5_wp
    m%a(3, 4) = 1.0_wp
    m%b = [1.0_wp, 2.0_wp, 2.0_wp, 1.0_wp]/6.0_wp
    m%c = [0.0_wp, 0.5_wp, 0.5_wp, 1.0_wp]
  end function classical_rk4

  !> The fifth-order method of Dormand and Prince (1980), its six stages; the seventh, the derivative at the end of the
  !> step, is the first of the next one (Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I, II.5).
  pure function dormand_prince() result(m)
    type(tableau) :: m
    m%stages = 6
    m%order = 5
    allocate (m%a(6, 6), source=0.0_wp)
    m%a(1, 2) = 1.0_wp/5.0_wp
    m%a(1:2, 3) = [3.0_wp/40.0_wp, 9.0_wp/40.0_wp]
    m%a(1:3, 4) = [44.0_wp/45.0_wp, -56.0_wp/15.0_wp, 32.0_wp/9.0_wp]
    m%a(1:4, 5) = [19372.0_wp/6561.0_wp, -25360.0_wp/2187.0_wp, 64448.0_wp/6561.0_wp, -212.0_wp/729.0_wp]
    m%a(1:5, 6) = [9017.0_wp/3168.0_wp, -355.0_wp/33.0_wp, 46732.0_wp/5247.0_wp, 49.0_wp/176.0_wp, -5103.0_wp/18656.0_wp]
    m%b = [35.0_wp/384.0_wp, 0.0_wp, 500.0_wp/1113.0_wp, 125.0_wp/192.0_wp, -2187.0_wp/6784.0_wp, 11.0_wp/84.0_wp]
    m%c = [0.0_wp, 0.2_wp, 0.3_wp, 0.8_wp, 8.0_wp/9.0_wp, 1.0_wp]
  end function dormand_prince

  !> Allocates the work space for n unknowns.
  pure subroutine prepare(self, method, n)
    class(explicit_stepper), intent(inout) :: self
    type(tableau), intent(in) :: method
    integer, intent(in) :: n
    self%method = method
    if (allocated(self%k)) deallocate (self%k, self%y)
    allocate (self%k(n, method%stages), self%y(n), source=0.0_wp)
  end subroutine prepare

  !> One step from t to t + h, without projection. On entry k(:, 1) = f(t, y). Where the state of a stage is not finite or too
  !> large, ok is false and y is that state.
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
    if (ok) then
      call combine(size(y), self%method%stages, self%method%stages, self%method%b, h, y, self%k, self%y)
      ok = is_bounded(self%y)
    end if
    y = self%y
  end subroutine step

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
    integer :: j, i, waiting
    logical :: first
    first = .true.
    waiting = 0
    do j = 1, used
      if (abs(a(j)) <= 0.0_wp) cycle
      if (first) then
        do i = 1, m
          x(i) = y(i) + (h*a(j))*k(i, j)
        end do
        first = .false.
      else if (waiting == 0) then
        waiting = j
      else
        do i = 1, m
          x(i) = (x(i) + (h*a(waiting))*k(i, waiting)) + (h*a(j))*k(i, j)
        end do
        waiting = 0
      end if
    end do
    if (waiting == 0) return
    do i = 1, m
      x(i) = x(i) + (h*a(waiting))*k(i, waiting)
    end do
  end subroutine combine_block
end module runge_kutta
