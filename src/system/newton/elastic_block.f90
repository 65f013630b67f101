!> The elastic coordinates' block of a body's dynamic stiffness, factored: T0 = c1 m_ff + c2 C + K with the GHM terms condensed,
!> symmetric and constant while the step is, and where that contracts poorly the full block with what the frame's motion and
!> stiffening add, c1 m_ff + c2 (C - 2 theta' Z) + K - theta'2 m - theta'' Z + geometric (theory.md, section 7). Refilling and
!> factoring allocate nothing.
module elastic_block
  use band_lu, only: factor_lu, solve_lu
  use kinds, only: wp, number
  use banded, only: band_factor, band_solve, band_solve_two, factor_again, order_band
  use body, only: body_model
  use body_terms, only: body_equations
  use elastic_operators, only: elastic_operator
  use element_law, only: add_geometric, parts_of, stiffness_part
  use layered_element, only: most_coordinates
  use ordering, only: reverse_cuthill_mckee
  implicit none (type, external)
  private

  !> The block's factors.
  type, public :: block_factor
    integer :: n = 0
    type(band_factor) :: base                !! of T0
    real(number), allocatable :: factor(:)   !! (segments) 1 + sum of alpha (1 - g) over a segment's terms [-]
    integer, allocatable :: row(:), col(:)   !! of T0's lower triangle
    integer, allocatable :: entry(:)         !! where these entries stand on the symmetric pattern of the operators
    real(number), allocatable :: value(:)    !! (symmetric pattern) T0 [kg/s2, ...]
    real(number), allocatable :: lower(:)    !! its lower triangle [N/m, N, N m]
    integer :: kb = 0                        !! half band width of the full block
    integer, allocatable :: position(:)      !! (n) its ordering
    real(number), allocatable :: lu(:, :)    !! its LU in LAPACK's band storage [N/m, N, N m]
    integer, allocatable :: pivots(:)        !! (n)
    integer :: upper = 0                     !! diagonals of its factor above the main one
    real(number), allocatable :: x(:, :)     !! (n, 1) work of its solves [any]
    real(number), allocatable :: work(:, :)  !! (2, n) of those with T0 [any]
  contains
    procedure :: set_up
    procedure :: factor_base
    procedure :: factor_full
    procedure :: solve
    procedure :: solve_two
  end type block_factor

contains

  !> Entries and orderings.
  subroutine set_up(self, op, segments)
    class(block_factor), intent(inout) :: self
    type(elastic_operator), intent(in) :: op
    integer, intent(in) :: segments          !! of viscoelastic material
    integer, allocatable :: order(:), starts(:)
    integer :: e, i, n
    associate (symmetric => op%symmetric, skew => op%skew)
      self%n = size(symmetric%first) - 1
      self%entry = pack([(e, e=1, size(symmetric%row))], symmetric%row >= symmetric%col)
      self%row = symmetric%row(self%entry)
      self%col = symmetric%col(self%entry)
      call order_band(self%n, self%row, self%col, self%base)
      call reverse_cuthill_mckee(self%n, [symmetric%row, skew%row], [symmetric%col, skew%col], order, starts)
      allocate (self%position(self%n), self%pivots(self%n))
      self%position(order) = [(i, i=1, self%n)]
      self%kb = max(maxval(abs(self%position(symmetric%row) - self%position(symmetric%col))), &
                    maxval(abs(self%position(skew%row) - self%position(skew%col))))
      n = size(symmetric%row)
    end associate
    allocate (self%value(n), self%lower(size(self%entry)), self%lu(3*self%kb + 1, self%n), self%x(self%n, 1), &
              self%work(2, self%n))
    allocate (self%factor(segments))
    self%x = 0.0_wp
  end subroutine set_up

  !> Fills and factors T0; the segments' factors belong to the step.
  subroutine factor_base(self, body, c1, c2, bad)
    class(block_factor), intent(inout) :: self
    type(body_model), intent(in) :: body
    real(number), intent(in) :: c1           !! [1/s2]
    real(number), intent(in) :: c2           !! [1/s]
    logical, intent(out) :: bad
    integer :: i
    associate (op => body%op)
      self%value = c1*(op%m + op%j) + c2*op%c + op%k
      do i = 1, size(op%entry)
        self%value(op%entry(i)) = self%value(op%entry(i)) + (self%factor(op%segment(i)) - 1)*op%part(i)
      end do
    end associate
    do i = 1, size(self%entry)
      self%lower(i) = self%value(self%entry(i))
    end do
    call factor_again(self%base, self%row, self%col, self%lower, bad)
  end subroutine factor_base

  !> Fills and factors the full block at the state of eq's last residual.
  subroutine factor_full(self, eq, body, c2, w, wd, bad)
    class(block_factor), intent(inout) :: self
    type(body_equations), intent(in) :: eq
    type(body_model), intent(in) :: body
    real(number), intent(in) :: c2           !! [1/s]
    real(wp), intent(in) :: w                !! frame rate [rad/s]
    real(wp), intent(in) :: wd               !! frame acceleration [rad/s2]
    logical, intent(out) :: bad
    real(number) :: turn
    integer :: e
    turn = 2*c2*w + wd
    self%lu = 0.0_wp
    associate (op => body%op)
      do e = 1, size(self%value)             ! a pattern's column is the row's number in the operators
        call add(self, op%symmetric%col(e), op%symmetric%row(e), self%value(e) - w**2*op%m(e))
      end do
      do e = 1, size(op%z)
        call add(self, op%skew%col(e), op%skew%row(e), -turn*op%z(e))
      end do
    end associate
    if (body%stiffening) then
      do e = 1, body%ne
        call add_stiffening(self, eq, body, e)
      end do
    end if
    call factor_lu(self%n, self%kb, self%lu, self%pivots, self%upper, bad)
  end subroutine factor_full

  !> Adds an entry of the full block.
  pure subroutine add(self, row, col, x)
    class(block_factor), intent(inout) :: self
    integer, intent(in) :: row, col
    real(number), intent(in) :: x            !! [kg/s2, ...]
    integer :: i, j
    i = self%position(row)
    j = self%position(col)
    self%lu(2*self%kb + 1 + i - j, j) = self%lu(2*self%kb + 1 + i - j, j) + x
  end subroutine add

  !> Adds what stiffening changes of an element's stiffness, at the coordinates of eq's last residual.
  subroutine add_stiffening(self, eq, body, e)
    class(block_factor), intent(inout) :: self
    type(body_equations), intent(in) :: eq
    type(body_model), intent(in) :: body
    integer, intent(in) :: e
    real(wp), dimension(max(most_coordinates, size(body%edof, 1)), max(most_coordinates, size(body%edof, 1))) :: k, at_rest, g
    real(number) :: factor
    integer :: i, j, r, n, part
    n = size(body%edof, 1)
    k(:n, :n) = 0.0_wp
    at_rest(:n, :n) = 0.0_wp
    g(:n, :n) = 0.0_wp
    call add_geometric(body, e, eq%w%ds, g)
    do part = 1, parts_of(body, e)
      call stiffness_part(body, e, part, k, eq%w%q(body%edof(:6, e)))
      call stiffness_part(body, e, part, at_rest)
      r = body%layers%part(part, e)
      factor = 1.0_wp
      if (r > 0) factor = self%factor(r)
      do j = 1, n
        do i = 1, n
          associate (row => body%edof(i, e), col => body%edof(j, e))
            if (row > 0 .and. col > 0) call add(self, row, col, factor*(k(i, j) - at_rest(i, j)) + g(i, j))
          end associate
        end do
      end do
      g(:n, :n) = 0.0_wp
    end do
  end subroutine add_stiffening

  !> Solves in place with T0 or the full block.
  subroutine solve(self, full_block, x)
    class(block_factor), intent(inout) :: self
    logical, intent(in) :: full_block
    real(number), intent(inout) :: x(:)      !! (n) forces [N, N m], then displacements [m, rad]
    integer :: i
    if (.not. full_block) then
      call band_solve(self%base, self%n, x, self%work)
      return
    end if
    do i = 1, self%n
      self%x(self%position(i), 1) = x(i)
    end do
    call solve_lu(self%n, self%kb, self%lu, self%pivots, self%upper, 1, self%x)
    do i = 1, self%n
      x(i) = self%x(self%position(i), 1)
    end do
  end subroutine solve

  !> The same for two right-hand sides.
  subroutine solve_two(self, full_block, x, y)
    class(block_factor), intent(inout) :: self
    logical, intent(in) :: full_block
    real(number), intent(inout) :: x(:), y(:)   !! (n) [N, N m], then [m, rad]
    if (full_block) then
      call self%solve(full_block, x)
      call self%solve(full_block, y)
    else
      call band_solve_two(self%base, self%n, x, y, self%work)
    end if
  end subroutine solve_two
end module elastic_block
