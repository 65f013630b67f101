!> The matrix of the multipliers, S = Phi_q M^-1 Phi_q^T, as it is stored. Its block graph is the joint graph, so that it is
!> banded in a good ordering (theory.md, sections 6 and 7). Rows that are off leave the band; their entries stand behind it.
module row_matrix_storage
  use kinds, only: wp
  use ordering, only: reverse_cuthill_mckee
  implicit none (type, external)
  private

  !> Where the entries of S stand, all rows in a good ordering.
  type :: row_pattern
    integer :: kd = 0                          !! half band width
    integer, allocatable :: position(:)        !! (rows) place of each row in the ordering
    integer, allocatable :: row(:)             !! (rows) the row at each place
    integer, allocatable :: entry(:)           !! entry of each pair of sides f <= e of one body, body by body, in a band of all
                                               !! rows; negative where both are sides of one row, whose entry gets the pair twice
  end type row_pattern

  !> Entries of S between rows that are off and others.
  type :: row_couplings
    integer :: holding = 0                     !! how many of them are those of rows that hold, which come first
    integer, allocatable :: row(:)             !! one of both rows, that which holds where one does
    integer, allocatable :: place(:)           !! its place
    integer, allocatable :: off(:)             !! the other one
    integer, allocatable :: diagonal(:)        !! (rows) the entry of S of each row with itself, 0: it has none
  end type row_couplings

  !> Banded S of the rows that hold and their ordering; behind the band the entries between rows that are off and others.
  type, public :: row_matrix
    type(row_pattern) :: all                   !! with the rows that are off
    integer :: n = 0                           !! rows that hold
    integer :: kd = 0                          !! half band width
    integer, allocatable :: position(:)        !! (rows) place of each row among those that hold, 0: it is off
    integer, allocatable :: row(:)             !! (n) the row at each place
    integer, allocatable :: entry(:)           !! as that of all rows, in s
    type(row_couplings) :: coupled
    real(wp), allocatable :: scale(:)          !! (rows) weight of each row, fixed at set-up [-]
    real(wp), allocatable :: s(:, :)           !! (0:kd, n) lower band of S, s(i, j) = S(j+i, j), then the couplings [1/kg]
    real(wp), allocatable :: g(:, :)           !! band of all rows, of the geometry alone, summed only where it is needed [-]
    real(wp), allocatable :: f(:, :)           !! (0:kd, n+kd) room for a factor (`multipliers`) [-], [kg]
    real(wp), allocatable :: x(:)              !! (n+kd) right-hand side, then solution; zero beyond n [m/s2], [N]
    real(wp), allocatable :: r(:), best(:)     !! (rows) work [m/s2, N]
    logical, allocatable :: off(:)             !! (rows) those that hold nothing, in their own order; allocated where rows switch
  contains
    procedure :: set_up
    procedure :: clear
    procedure :: hold
    procedure :: soften
    procedure :: uncouple
    procedure :: diagonal
    procedure :: column
    procedure :: motion_off
    procedure :: subtract_couplings
  end type row_matrix

contains

  !> Orders the rows from the pairs of sides that meet in a body, and allocates; all rows hold.
  subroutine set_up(self, n, rows, cols, same)
    class(row_matrix), intent(inout) :: self
    integer, intent(in) :: n                  !! constraint rows
    integer, intent(in) :: rows(:), cols(:)   !! pairs of sides of one body
    logical, intent(in) :: same(:)            !! a side with itself
    integer, allocatable :: order(:), starts(:)
    integer :: k
    call reverse_cuthill_mckee(n, rows, cols, order, starts)
    allocate (self%scale(n), source=1.0_wp)
    allocate (self%r(n), self%best(n), source=0.0_wp)
    associate (p => self%all)
      allocate (p%position(n), p%entry(size(rows)))
      p%position(order) = [(k, k=1, n)]
      p%row = order(1:n)
      p%kd = half_width(p%position, rows, cols)
      p%entry = 1 + abs(p%position(rows) - p%position(cols)) + (p%kd + 1)*(min(p%position(rows), p%position(cols)) - 1)
      where (rows == cols .and. .not. same) p%entry = -p%entry
      allocate (self%g(0:p%kd, n), source=0.0_wp)
    end associate
    call arrange(self, spread(.false., 1, n))
  end subroutine set_up

  !> Half band width of rows in an ordering, of pairs that meet.
  pure integer function half_width(position, rows, cols) result(kd)
    integer, intent(in) :: position(:), rows(:), cols(:)
    integer :: k
    kd = 0
    do k = 1, size(rows)
      kd = max(kd, abs(position(rows(k)) - position(cols(k))))
    end do
    if (kd > 0 .and. kd < 3) kd = 3                         ! takes the short way of half band width 3
  end function half_width

  !> Takes rows that hold nothing off S, which is then to be summed: their multipliers are zero.
  subroutine hold(self, off)
    class(row_matrix), intent(inout) :: self
    logical, intent(in) :: off(:)             !! (rows)
    self%off = off
    if (.not. all((self%position == 0) .eqv. off)) call arrange(self, off)
  end subroutine hold

  !> Where the entries of S stand: the band of the rows that hold, then the entries that rows that are off have with these, then
  !> those that they have with one another.
  subroutine arrange(self, off)
    class(row_matrix), intent(inout) :: self
    logical, intent(in) :: off(:)             !! (rows)
    integer, allocatable :: used(:), a(:), b(:)   ! entries of the band of all rows, both rows of each
    integer, allocatable :: place(:)          ! of each entry of that band
    logical, allocatable :: holds(:), mixed(:)
    integer :: k, behind
    associate (p => self%all, c => self%coupled)
      self%row = pack(p%row, .not. off(p%row))
      self%n = size(self%row)
      self%position = spread(0, 1, size(off))
      self%position(self%row) = [(k, k=1, self%n)]
      allocate (place((p%kd + 1)*size(off)), source=0)
      place(abs(p%entry)) = 1
      used = pack([(k, k=1, size(place))], place > 0)
      b = p%row(1 + (used - 1)/(p%kd + 1))
      a = p%row(p%position(b) + mod(used - 1, p%kd + 1))
      holds = .not. (off(a) .or. off(b))
      mixed = off(a) .neqv. off(b)
      self%kd = half_width(self%position, pack(a, holds), pack(b, holds))
      behind = (self%kd + 1)*self%n
      c%holding = count(mixed)
      c%row = [pack(merge(a, b, off(b)), mixed), pack(a, .not. (holds .or. mixed))]
      c%off = [pack(merge(b, a, off(b)), mixed), pack(b, .not. (holds .or. mixed))]
      c%place = self%position(c%row)
      a = self%position(a)
      b = self%position(b)
      place(pack(used, holds)) = pack(1 + abs(a - b) + (self%kd + 1)*(min(a, b) - 1), holds)
      place(pack(used, mixed)) = behind + [(k, k=1, c%holding)]
      place(pack(used, .not. (holds .or. mixed))) = behind + [(k, k=c%holding + 1, size(c%row))]
      self%entry = sign(place(abs(p%entry)), p%entry)
      c%diagonal = place(1 + (p%kd + 1)*(p%position - 1))
      if (allocated(self%s)) deallocate (self%s, self%f, self%x)
      allocate (self%s(0:self%kd, self%n + (size(c%row) + self%kd)/(self%kd + 1)), self%f(0:self%kd, self%n + self%kd), &
                self%x(self%n + self%kd), source=0.0_wp)
    end associate
  end subroutine arrange

  !> Forgets S before it is summed anew.
  subroutine clear(self)
    class(row_matrix), intent(inout) :: self
    call fill_zero(size(self%s), self%s)
  end subroutine clear

  !> x = 0, as one run of memory.
  pure subroutine fill_zero(n, x)
    integer, intent(in) :: n
    real(wp), intent(out) :: x(n)             !! [any]
    x = 0.0_wp
  end subroutine fill_zero

  !> Rows that hold give way by part of what a unit multiplier accelerates them.
  subroutine soften(self, softening, first)
    class(row_matrix), intent(inout) :: self
    real(wp), intent(in) :: softening         !! that part [-]
    integer, intent(in) :: first              !! of these rows
    associate (at => pack(self%position(first:), self%position(first:) > 0))
      self%s(0, at) = self%s(0, at)*(1 + softening)
    end associate
  end subroutine soften

  !> G without what rows that are off have in common with others.
  subroutine uncouple(self)
    class(row_matrix), intent(inout) :: self
    integer :: i, j, k
    do i = 1, size(self%off)
      if (.not. self%off(i)) cycle
      k = self%all%position(i)
      self%g(1:, k) = 0.0_wp
      do j = max(1, k - self%all%kd), k - 1
        self%g(k - j, j) = 0.0_wp
      end do
    end do
  end subroutine uncouple

  !> The acceleration of a row by its own unit multiplier alone, also of one that is off.
  pure real(wp) function diagonal(self, row)     ! [1/kg]
    class(row_matrix), intent(in) :: self
    integer, intent(in) :: row
    diagonal = 0.0_wp
    associate (e => self%coupled%diagonal(row) - 1)
      if (e >= 0) diagonal = self%s(mod(e, self%kd + 1), 1 + e/(self%kd + 1))/self%scale(row)**2
    end associate
  end function diagonal

  !> y = S e_k of the rows that hold, k a row that is off.
  subroutine column(self, k, y)
    class(row_matrix), intent(inout) :: self
    integer, intent(in) :: k
    real(wp), intent(out) :: y(:)             !! (rows) [1/kg]
    self%r = 0.0_wp
    self%r(k) = -1/self%scale(k)
    self%x(1:self%n) = 0.0_wp
    call subtract_couplings(self)
    y = 0.0_wp
    y(self%row) = self%x(1:self%n)/self%scale(self%row)
  end subroutine column

  !> r <- r - S lambda of the rows that are off; 0 of others.
  subroutine motion_off(self, lambda, r)
    class(row_matrix), intent(inout) :: self
    real(wp), intent(in) :: lambda(:)         !! (rows) [N]
    real(wp), intent(inout) :: r(:)           !! (rows) [m/s2]
    integer :: k
    self%r = lambda/self%scale
    self%best = 0.0_wp
    if (size(self%coupled%row) > 0) call add_couplings(self%coupled%holding, size(self%coupled%row), self%coupled%row, &
      self%coupled%off, self%s(0, self%n + 1), self%r, self%best)
    do k = 1, size(r)
      r(k) = merge(r(k) - self%best(k)/self%scale(k), 0.0_wp, self%off(k))
    end do
  end subroutine motion_off

  !> y + S x of rows that are off: the first entries with rows that hold, the others with one another.
  pure subroutine add_couplings(holding, n, row, off, s, x, y)
    integer, intent(in) :: holding, n
    integer, intent(in) :: row(n), off(n)
    real(wp), intent(in) :: s(n)              !! [1/kg]
    real(wp), intent(in) :: x(:)              !! (rows) [N]
    real(wp), intent(inout) :: y(:)           !! (rows) [m/s2]
    integer :: k
    do k = 1, holding
      y(off(k)) = y(off(k)) + s(k)*x(row(k))
    end do
    do k = holding + 1, n
      y(off(k)) = y(off(k)) + s(k)*x(row(k))
      if (row(k) /= off(k)) y(row(k)) = y(row(k)) + s(k)*x(off(k))
    end do
  end subroutine add_couplings

  !> x <- x - S r of rows that hold, r multipliers of rows that are off.
  subroutine subtract_couplings(self)
    class(row_matrix), intent(inout) :: self
    associate (c => self%coupled)
      if (c%holding > 0) call subtract_entries(c%holding, c%place, c%off, self%s(0, self%n + 1), self%r, self%x)
    end associate
  end subroutine subtract_couplings

  !> The same of a list of entries.
  pure subroutine subtract_entries(n, place, off, s, r, x)
    integer, intent(in) :: n
    integer, intent(in) :: place(n), off(n)
    real(wp), intent(in) :: s(n)              !! [1/kg]
    real(wp), intent(in), contiguous :: r(:)  !! (rows) [N]
    real(wp), intent(inout), contiguous :: x(:)   !! places [m/s2]
    integer :: k
    do k = 1, n
      x(place(k)) = x(place(k)) - s(k)*r(off(k))
    end do
  end subroutine subtract_entries
end module row_matrix_storage
