!> The elastic coordinates' block of a body's dynamic stiffness, factored: T0 = c1 m_ff + c2 C + K with the GHM terms condensed,
!> symmetric and constant while the step is, and where that contracts poorly the whole block with what the frame's motion and
!> stiffening add, c1 m_ff + c2 (C - 2 theta' Z) + K - theta'2 m - theta'' Z + geometric (theory.md, section 7). Refilling and
!> factoring allocate nothing.
module elastic_block
  use kinds, only: wp
  use banded, only: band_factor, band_solve, band_solve_two, factor_again, factor_symmetric
  use beam_element, only: element_stiffness, stiffening_tangent
  use body, only: body_model
  use body_terms, only: body_equations
  use elastic_operators, only: elastic_operator
  use lapack, only: dgbtrf, dgbtrs
  use ordering, only: reverse_cuthill_mckee
  implicit none (type, external)
  private
  public :: stiffening_change

  !> The block's factors.
  type, public :: block_factor
    integer :: n = 0
    type(band_factor) :: base                !! of T0
    integer, allocatable :: row(:), col(:)   !! of T0's lower triangle
    integer, allocatable :: entry(:)         !! these entries' markers on the even pattern of the operators
    real(wp), allocatable :: value(:)        !! (even pattern) T0 [kg/s2, ...]
    real(wp), allocatable :: lower(:)        !! its lower triangle [N/m, N, N m]
    integer, allocatable :: reordered(:)     !! (n) reordered row of each coordinate
    real(wp), allocatable :: band(:)         !! work of the factorisation [N/m, N, N m]
    integer :: kb = 0                        !! half band width of the whole block
    integer, allocatable :: position(:)      !! (n) its ordering
    real(wp), allocatable :: lu(:, :)        !! its LU in LAPACK's band storage [N/m, N, N m]
    integer, allocatable :: pivots(:)        !! (n)
    real(wp), allocatable :: x(:, :)         !! (n, 1) work of its solves [any]
    real(wp), allocatable :: work(:, :)      !! (2, n) of those with T0 [any]
  contains
    procedure :: set_up
    procedure :: factor_base
    procedure :: factor_whole
    procedure :: solve
    procedure :: solve_two
  end type block_factor

contains

  !> Entries and orderings.
  subroutine set_up(self, op)
    class(block_factor), intent(inout) :: self
    type(elastic_operator), intent(in) :: op
    integer, allocatable :: order(:), starts(:)
    integer :: e, i, n
    associate (even => op%even, odd => op%odd)
      self%n = size(even%first) - 1
      self%entry = pack([(e, e=1, size(even%row))], even%row >= even%col)
      self%row = even%row(self%entry)
      self%col = even%col(self%entry)
      call reverse_cuthill_mckee(self%n, [even%row, odd%row], [even%col, odd%col], order, starts)
      allocate (self%position(self%n), self%pivots(self%n), self%reordered(self%n))
      self%position(order) = [(i, i=1, self%n)]
      self%kb = max(maxval(abs(self%position(even%row) - self%position(even%col))), &
                    maxval(abs(self%position(odd%row) - self%position(odd%col))))
      n = size(even%row)
    end associate
    allocate (self%value(n), self%lower(size(self%entry)), self%lu(3*self%kb + 1, self%n), self%x(self%n, 1), &
              self%work(2, self%n), source=0.0_wp)
    allocate (self%band(0))
  end subroutine set_up

  !> Fills and factors T0; the segments' factors of eq belong to the step.
  subroutine factor_base(self, op, eq, c1, c2, bad)
    class(block_factor), intent(inout) :: self
    type(elastic_operator), intent(in) :: op
    type(body_equations), intent(in) :: eq
    real(wp), intent(in) :: c1               !! [1/s2]
    real(wp), intent(in) :: c2               !! [1/s]
    logical, intent(out) :: bad
    integer :: i, n, info
    self%value = c1*(op%m + op%j) + c2*op%c + op%k
    do i = 1, size(op%entry)
      self%value(op%entry(i)) = self%value(op%entry(i)) + (eq%factor(op%segment(i)) - 1)*op%part(i)
    end do
    do i = 1, size(self%entry)
      self%lower(i) = self%value(self%entry(i))
    end do
    if (self%base%n > 0) then
      call factor_again(self%base, self%reordered, self%row, self%col, self%lower, self%band, info)
    else
      call factor_symmetric(self%n, self%row, self%col, self%lower, self%base, info)
      self%reordered(self%base%order) = [(i, i=1, self%n)]
      n = 0
      do i = 1, size(self%base%blocks)
        associate (b => self%base%blocks(i))
          n = max(n, (b%kd + 1)*(b%last - b%first + 1))
        end associate
      end do
      self%band = [(0.0_wp, i=1, n)]
    end if
    bad = info /= 0
  end subroutine factor_base

  !> Fills and factors the whole block at the state of eq's last residual.
  subroutine factor_whole(self, eq, body, c2, w, wd, bad)
    class(block_factor), intent(inout) :: self
    type(body_equations), intent(in) :: eq
    type(body_model), intent(in) :: body
    real(wp), intent(in) :: c2               !! [1/s]
    real(wp), intent(in) :: w                !! frame rate [rad/s]
    real(wp), intent(in) :: wd               !! frame acceleration [rad/s2]
    logical, intent(out) :: bad
    real(wp) :: turn
    integer :: e, info
    turn = 2*c2*w + wd
    self%lu = 0.0_wp
    associate (op => body%op)
      do e = 1, size(self%value)             ! a pattern's column is the row's number in the operators
        call marker(self, op%even%col(e), op%even%row(e), self%value(e) - w**2*op%m(e))
      end do
      do e = 1, size(op%z)
        call marker(self, op%odd%col(e), op%odd%row(e), -turn*op%z(e))
      end do
    end associate
    if (body%stiffening) then
      do e = 1, body%ne
        call add_stiffening(self, eq, body, e)
      end do
    end if
    call dgbtrf(self%n, self%n, self%kb, self%kb, self%lu, 3*self%kb + 1, self%pivots, info)
    bad = info /= 0
  end subroutine factor_whole

  !> Adds an entry of the whole block.
  pure subroutine marker(self, row, col, x)
    class(block_factor), intent(inout) :: self
    integer, intent(in) :: row, col
    real(wp), intent(in) :: x                !! [kg/s2, ...]
    integer :: i, j
    i = self%position(row)
    j = self%position(col)
    self%lu(2*self%kb + 1 + i - j, j) = self%lu(2*self%kb + 1 + i - j, j) + x
  end subroutine marker

  !> Adds what stiffening changes of an element's stiffness, at the coordinates of eq's last residual.
  subroutine add_stiffening(self, eq, body, e)
    class(block_factor), intent(inout) :: self
    type(body_equations), intent(in) :: eq
    type(body_model), intent(in) :: body
    integer, intent(in) :: e
    real(wp) :: k(6, 6)
    integer :: i, j
    call stiffening_change(eq, body, e, k)
    do j = 1, 6
      do i = 1, 6
        if (body%edof(i, e) > 0 .and. body%edof(j, e) > 0) call marker(self, body%edof(i, e), body%edof(j, e), k(i, j))
      end do
    end do
  end subroutine add_stiffening

  !> What stiffening changes of the stiffness of element e, at the coordinates of eq's last residual.
  subroutine stiffening_change(eq, body, e, k)
    type(body_equations), intent(in) :: eq
    type(body_model), intent(in) :: body
    integer, intent(in) :: e
    real(wp), intent(out) :: k(6, 6)         !! [N/m, N, N m]
    real(wp) :: g(6, 6), factor
    integer :: r
    factor = 1.0_wp
    do r = 1, size(body%segments)
      if (e >= body%segments(r)%first .and. e <= body%segments(r)%last) factor = eq%factor(r)
    end do
    call stiffening_tangent(body%elements(e), eq%w%q(body%edof(:, e)), body%elements(e)%ea_l*eq%w%ds(1, e), k, g)
    k = factor*(k - element_stiffness(body%elements(e))) + g
  end subroutine stiffening_change

  !> Solves in place with T0 or the whole block.
  subroutine solve(self, whole, x)
    class(block_factor), intent(inout) :: self
    logical, intent(in) :: whole
    real(wp), intent(inout) :: x(:)          !! (n) forces [N, N m], then displacements [m, rad]
    integer :: i, info
    if (.not. whole) then
      call band_solve(self%base, self%n, x, self%work)
      return
    end if
    do i = 1, self%n
      self%x(self%position(i), 1) = x(i)
    end do
    call dgbtrs('N', self%n, self%kb, self%kb, 1, self%lu, 3*self%kb + 1, self%pivots, self%x, self%n, info)
    do i = 1, self%n
      x(i) = self%x(self%position(i), 1)
    end do
  end subroutine solve

  !> The same for two right-hand sides.
  subroutine solve_two(self, whole, x, y)
    class(block_factor), intent(inout) :: self
    logical, intent(in) :: whole
    real(wp), intent(inout) :: x(:), y(:)    !! (n) [N, N m], then [m, rad]
    if (whole) then
      call self%solve(whole, x)
      call self%solve(whole, y)
    else
      call band_solve_two(self%base, self%n, x, y, self%work)
    end if
  end subroutine solve_two
end module elastic_block
