!> The system for the multipliers, S lambda = r with S = Phi_q M^-1 Phi_q^T: its block graph is the joint graph, so it is
!> kept banded in a good ordering (theory.md, sections 6 and 7). A weak pivot has one of two causes. Very uneven masses (a heavy
!> body held by a light link) leave S regular: its own factor serves, and whoever uses the multipliers corrects them by the
!> residual. Dependent rows (redundant joints, a singular position) make S singular: the factor of S + eps 1 and a few
!> corrections give the minimum-norm multipliers. The matrix G of the joints' geometry alone, the same rows on bodies of unit
!> mass, tells the two apart.
module multipliers
  use kinds, only: wp
  use band_ldl, only: eliminate, substitute, subtract_product
  use ordering, only: reverse_cuthill_mckee
  implicit none (type, external)
  private
  public :: multiplier_system

  real(wp), parameter :: weak_pivot = 1.0e-6_wp   !! relative pivot from which rows count as independent [-]
  real(wp), parameter :: least_pivot = 2.0e-15_wp !! relative pivot that still stands above rounding [-]
  real(wp), parameter :: regular_pivot = 1.0e-12_wp   !! relative pivot down to which S may be taken as regular [-]
  integer, parameter :: most_passes = 100           !! corrections of the regularised solve

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
    integer :: held = 0                        !! how many of them are those of rows that hold, which come first
    integer, allocatable :: row(:)             !! one of both rows, that which holds where one does
    integer, allocatable :: place(:)           !! its place
    integer, allocatable :: off(:)             !! the other one
    integer, allocatable :: diagonal(:)        !! (rows) the entry of S of each row with itself, 0: it has none
  end type row_couplings

  !> Banded S of the rows that hold, its factor and the ordering; behind the band the entries between rows that are off and others.
  type :: multiplier_system
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
    real(wp), allocatable :: f(:, :)           !! (0:kd, n+kd) L below the diagonal [-], 1/D on it [kg]; zero beyond n
    real(wp) :: shift = 1.0e-6_wp              !! eps of S + eps 1 over the mean diagonal: 1e-9 where rows are redundant [-]
                                               !! everywhere; larger in passing, where the weak direction must not move
    real(wp) :: weakest = weak_pivot           !! relative pivot below which S is looked at more closely [-]
    logical :: singular = .false.              !! rows depend on others: the factor is that of a shifted S
    logical :: uneven_masses = .false.         !! very uneven masses: multipliers are exact only after corrections
    logical :: ill_conditioned = .false.       !! masses so uneven that double precision no longer holds S
    logical :: was_ill_conditioned = .false.   !! at some evaluation of the run
    real(wp), allocatable :: x(:)              !! (n+kd) work, zero beyond n [m/s2, N]
    real(wp), allocatable :: r(:), best(:)     !! (rows) work [m/s2, N]
    logical, allocatable :: dependent(:)       !! (rows) reordered rows that depend on earlier ones by geometry
    logical, allocatable :: off(:)             !! (rows) those that hold nothing, in their own order; allocated where rows switch
  contains
    procedure :: set_up
    procedure :: clear
    procedure :: factor
    procedure :: factor_uneven
    procedure :: beyond_digits
    procedure :: factor_strong
    procedure :: factor_weak
    procedure :: note_ill_conditioned
    procedure :: solve
    procedure :: solve_beside
    procedure :: put
    procedure :: get
    procedure :: mean_shift
    procedure :: add_shift
    procedure :: minimum_norm_equivalent
    procedure :: remove_range
    procedure :: weak_rows
    procedure :: weakest_row
    procedure :: hold
    procedure :: soften
    procedure :: uncouple
    procedure :: diagonal
    procedure :: column
    procedure :: motion_off
  end type multiplier_system

contains

  !> Orders the rows from the pairs of sides that meet in a body, and allocates; all rows hold.
  subroutine set_up(self, n, rows, cols, same)
    class(multiplier_system), intent(inout) :: self
    integer, intent(in) :: n                  !! constraint rows
    integer, intent(in) :: rows(:), cols(:)   !! pairs of sides of one body
    logical, intent(in) :: same(:)            !! a side with itself
    integer, allocatable :: order(:), starts(:)
    integer :: k
    call reverse_cuthill_mckee(n, rows, cols, order, starts)
    allocate (self%scale(n), source=1.0_wp)
    allocate (self%r(n), self%best(n), source=0.0_wp)
    allocate (self%dependent(n), source=.false.)
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
    class(multiplier_system), intent(inout) :: self
    logical, intent(in) :: off(:)             !! (rows)
    self%off = off
    if (.not. all((self%position == 0) .eqv. off)) call arrange(self, off)
  end subroutine hold

  !> Where the entries of S stand: the band of the rows that hold, then the entries that rows that are off have with these, then
  !> those that they have with one another.
  subroutine arrange(self, off)
    class(multiplier_system), intent(inout) :: self
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
      c%held = count(mixed)
      c%row = [pack(merge(a, b, off(b)), mixed), pack(a, .not. (holds .or. mixed))]
      c%off = [pack(merge(b, a, off(b)), mixed), pack(b, .not. (holds .or. mixed))]
      c%place = self%position(c%row)
      a = self%position(a)
      b = self%position(b)
      place(pack(used, holds)) = pack(1 + abs(a - b) + (self%kd + 1)*(min(a, b) - 1), holds)
      place(pack(used, mixed)) = behind + [(k, k=1, c%held)]
      place(pack(used, .not. (holds .or. mixed))) = behind + [(k, k=c%held + 1, size(c%row))]
      self%entry = sign(place(abs(p%entry)), p%entry)
      c%diagonal = place(1 + (p%kd + 1)*(p%position - 1))
      if (allocated(self%s)) deallocate (self%s, self%f, self%x)
      allocate (self%s(0:self%kd, self%n + (size(c%row) + self%kd)/(self%kd + 1)), self%f(0:self%kd, self%n + self%kd), &
                self%x(self%n + self%kd), source=0.0_wp)
    end associate
  end subroutine arrange

  !> Forgets S before it is summed anew.
  subroutine clear(self)
    class(multiplier_system), intent(inout) :: self
    call fill_zero(size(self%s), self%s)
  end subroutine clear

  !> x = 0, as one run of memory.
  pure subroutine fill_zero(n, x)
    integer, intent(in) :: n
    real(wp), intent(out) :: x(n)             !! [any]
    x = 0.0_wp
  end subroutine fill_zero

  !> Rows that hold give way by part of what a unit multiplier accelerates them.
  subroutine soften(self, creep, rows)
    class(multiplier_system), intent(inout) :: self
    real(wp), intent(in) :: creep             !! that part [-]
    integer, intent(in) :: rows(:)
    associate (at => pack(self%position(rows), self%position(rows) > 0))
      self%s(0, at) = self%s(0, at)*(1 + creep)
    end associate
  end subroutine soften

  !> G without what rows that are off have in common with others.
  subroutine uncouple(self)
    class(multiplier_system), intent(inout) :: self
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
    class(multiplier_system), intent(in) :: self
    integer, intent(in) :: row
    diagonal = 0.0_wp
    associate (e => self%coupled%diagonal(row) - 1)
      if (e >= 0) diagonal = self%s(mod(e, self%kd + 1), 1 + e/(self%kd + 1))/self%scale(row)**2
    end associate
  end function diagonal

  !> y = S e_k of the rows that hold, k a row that is off.
  subroutine column(self, k, y)
    class(multiplier_system), intent(inout) :: self
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
    class(multiplier_system), intent(inout) :: self
    real(wp), intent(in) :: lambda(:)         !! (rows) [N]
    real(wp), intent(inout) :: r(:)           !! (rows) [m/s2]
    integer :: k
    self%r = lambda/self%scale
    self%best = 0.0_wp
    if (size(self%coupled%row) > 0) call add_couplings(self%coupled%held, size(self%coupled%row), self%coupled%row, &
      self%coupled%off, self%s(0, self%n + 1), self%r, self%best)
    do k = 1, size(r)
      r(k) = merge(r(k) - self%best(k)/self%scale(k), 0.0_wp, self%off(k))
    end do
  end subroutine motion_off

  !> y + S x of rows that are off: the first entries with rows that hold, the others with one another.
  pure subroutine add_couplings(held, n, row, off, s, x, y)
    integer, intent(in) :: held, n
    integer, intent(in) :: row(n), off(n)
    real(wp), intent(in) :: s(n)              !! [1/kg]
    real(wp), intent(in) :: x(:)              !! (rows) [N]
    real(wp), intent(inout) :: y(:)           !! (rows) [m/s2]
    integer :: k
    do k = 1, held
      y(off(k)) = y(off(k)) + s(k)*x(row(k))
    end do
    do k = held + 1, n
      y(off(k)) = y(off(k)) + s(k)*x(row(k))
      if (row(k) /= off(k)) y(row(k)) = y(row(k)) + s(k)*x(off(k))
    end do
  end subroutine add_couplings

  !> x <- x - S r of rows that hold, r multipliers of rows that are off.
  subroutine subtract_couplings(self)
    class(multiplier_system), intent(inout) :: self
    associate (c => self%coupled)
      if (c%held > 0) call subtract_entries(c%held, c%place, c%off, self%s(0, self%n + 1), self%r, self%x)
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

  !> Factors S; falls back to S + eps 1 where a pivot is weak.
  subroutine factor(self)
    class(multiplier_system), intent(inout) :: self
    logical :: good
    call self%factor_strong(good)
    if (.not. good) call factor_shifted(self)
  end subroutine factor

  !> Factors an S with weak pivots, knowing G: as it is, if no pivot is 0 by rounding, where no row depends on
  !> others by geometry; S + eps 1 otherwise.
  subroutine factor_uneven(self)
    class(multiplier_system), intent(inout) :: self
    logical :: good
    call mark_dependent(self, weak_pivot)
    good = .not. any(self%dependent)
    if (good) then
      call take_matrix((self%kd + 1)*self%n, size(self%f), self%s, self%f)
      call eliminate(self%n, self%kd, self%f, self%s, regular_pivot, good)
    end if
    if (.not. good) call factor_shifted(self)
  end subroutine factor_uneven

  !> Whether the last factor has pivots that may be 0 by rounding.
  pure logical function beyond_digits(self) result(yes)
    class(multiplier_system), intent(in) :: self
    yes = self%ill_conditioned .or. any(self%f(0, 1:self%n)*self%s(0, 1:self%n)*regular_pivot > 1.0_wp)   ! the factor holds 1/pivot
  end function beyond_digits

  !> Factors S; good is false where a pivot is weak.
  subroutine factor_strong(self, good)
    class(multiplier_system), intent(inout) :: self
    logical, intent(out) :: good
    self%singular = .false.
    self%uneven_masses = .false.
    self%ill_conditioned = .false.
    good = .true.
    if (self%n == 0) return
    call take_matrix((self%kd + 1)*self%n, size(self%f), self%s, self%f)
    call eliminate(self%n, self%kd, self%f, self%s, self%weakest, good)
  end subroutine factor_strong

  !> Factors an S with weak pivots, knowing G: as it is where no row depends on others; with a shift of all rows where S is
  !> singular while the masses are not very uneven; with the dependent rows alone shifted, by their own diagonal, where it is both.
  subroutine factor_weak(self, accept_weak_pivots)
    class(multiplier_system), intent(inout) :: self
    logical, intent(in) :: accept_weak_pivots   !! factor S as it is, however weak its pivots, if none is 0 by rounding
    logical :: good
    if (accept_weak_pivots) then
      call take_matrix((self%kd + 1)*self%n, size(self%f), self%s, self%f)
      call eliminate(self%n, self%kd, self%f, self%s, regular_pivot, self%uneven_masses)
      if (self%uneven_masses) return
    end if
    call mark_dependent(self, weak_pivot)
    self%singular = any(self%dependent)
    call take_dependent(self)
    call eliminate(self%n, self%kd, self%f, self%s, merge(weak_pivot, least_pivot, self%singular), good)
    self%uneven_masses = self%singular .neqv. good
    if (.not. (self%singular .or. good)) call self%note_ill_conditioned()
    if (.not. self%uneven_masses) then
      call factor_shifted(self)
    else if (self%singular) then
      call take_dependent(self)
      call eliminate(self%n, self%kd, self%f, self%s, -1.0e100_wp, good)
    end if
  end subroutine factor_weak

  !> Notes that rounding has taken the heavy bodies' part from S.
  subroutine note_ill_conditioned(self)
    class(multiplier_system), intent(inout) :: self
    self%ill_conditioned = .true.
    self%was_ill_conditioned = .true.
  end subroutine note_ill_conditioned

  !> f = S with the diagonal entries of dependent rows doubled.
  subroutine take_dependent(self)
    class(multiplier_system), intent(inout) :: self
    integer :: k
    call take_matrix((self%kd + 1)*self%n, size(self%f), self%s, self%f)
    do k = 1, self%n
      if (self%dependent(self%all%position(self%row(k)))) self%f(0, k) = 2*self%f(0, k)
    end do
  end subroutine take_dependent

  !> The factor of S + eps 1.
  subroutine factor_shifted(self)
    class(multiplier_system), intent(inout) :: self
    real(wp) :: eps                           ! [1/kg]
    logical :: good
    self%singular = .true.
    call take_matrix((self%kd + 1)*self%n, size(self%f), self%s, self%f)
    eps = self%mean_shift()
    if (.not. eps > tiny(1.0_wp)) eps = 1.0_wp   ! S is 0, no multiplier moves anything: any of ordinary size
    self%f(0, 1:self%n) = self%f(0, 1:self%n) + eps
    call eliminate(self%n, self%kd, self%f, self%s, -1.0e100_wp, good)
  end subroutine factor_shifted

  !> f = S, with zeros beyond its last column.
  pure subroutine take_matrix(ns, nf, s, f)
    integer, intent(in) :: ns, nf             !! entries of s and f
    real(wp), intent(in) :: s(ns)             !! [1/kg]
    real(wp), intent(out) :: f(nf)            !! [1/kg]
    f(1:ns) = s
    f(ns + 1:) = 0.0_wp
  end subroutine take_matrix

  !> Solves S lambda = r in place (minimum norm where S is singular).
  subroutine solve(self, lambda)
    class(multiplier_system), intent(inout) :: self
    real(wp), intent(inout) :: lambda(:)      !! (n) right-hand side [m/s2], then multipliers [N], in the rows' own order
    integer :: k
    if (self%n == 0) return
    do k = 1, self%n
      self%x(k) = lambda(self%row(k))*self%scale(self%row(k))
    end do
    call substitute_placed(self, lambda)
  end subroutine solve

  !> Multipliers x of the rows that hold, beside given ones of rows that are off: S x = b - S f.
  subroutine solve_beside(self, b, f, x)
    class(multiplier_system), intent(inout) :: self
    real(wp), intent(in) :: b(:)              !! (rows) [m/s2]
    real(wp), intent(in) :: f(:)              !! (rows) zero where rows hold [N]
    real(wp), intent(inout) :: x(:)           !! (rows) [N]
    call self%put(b, f)
    call substitute_placed(self, x)
  end subroutine solve_beside

  !> Puts b - S f in the order of the factor.
  subroutine put(self, b, f)
    class(multiplier_system), intent(inout) :: self
    real(wp), intent(in) :: b(:)              !! (rows) [m/s2]
    real(wp), intent(in) :: f(:)              !! (rows) of those that are off [N]
    integer :: k
    do k = 1, self%n
      self%x(k) = b(self%row(k))*self%scale(self%row(k))
    end do
    self%r = f/self%scale
    call subtract_couplings(self)
  end subroutine put

  !> What has been solved for, in the rows' own order.
  subroutine get(self, x)
    class(multiplier_system), intent(inout) :: self
    real(wp), intent(inout) :: x(:)           !! (rows) [N]
    integer :: k
    do k = 1, self%n
      x(self%row(k)) = self%x(k)*self%scale(self%row(k))
    end do
  end subroutine get

  !> What is added to the diagonal of a singular S.
  pure real(wp) function mean_shift(self)          ! [1/kg]
    class(multiplier_system), intent(in) :: self
    mean_shift = self%shift*sum(self%s(0, 1:self%n))/self%n
  end function mean_shift

  !> Adds what that shift makes of multipliers to the right-hand side.
  pure subroutine add_shift(self, lambda)
    class(multiplier_system), intent(inout) :: self
    real(wp), intent(in) :: lambda(:)         !! (rows) [N]
    self%x(1:self%n) = self%x(1:self%n) + self%mean_shift()*lambda(self%row)/self%scale(self%row)
  end subroutine add_shift

  !> x by the last factor, from the right-hand side in the order of the factor.
  subroutine substitute_placed(self, x)
    class(multiplier_system), intent(inout) :: self
    real(wp), intent(inout) :: x(:)           !! (rows) [N]
    if (self%singular) then
      call correct(self)
    else
      call substitute(self%n, self%kd, self%f, self%x)
    end if
    if (self%n < size(x)) x = 0.0_wp
    call self%get(x)
  end subroutine substitute_placed

  !> The minimum-norm multipliers that exert the same forces as the given ones, by the last factor: redundant rows share.
  subroutine minimum_norm_equivalent(self, lambda)
    class(multiplier_system), intent(inout) :: self
    real(wp), intent(inout) :: lambda(:)      !! (n) in the constraints' own order [N]
    integer :: k
    do k = 1, self%n
      self%r(k) = lambda(self%row(k))/self%scale(self%row(k))
    end do
    self%x = 0.0_wp
    call subtract_product(self%n, self%kd, self%s, self%r, self%x)
    do k = 1, self%n
      lambda(self%row(k)) = -self%x(k)/self%scale(self%row(k))
    end do
    call self%solve(lambda)
  end subroutine minimum_norm_equivalent

  !> Leaves of the given multipliers what exerts no force: their part in the null space of S.
  subroutine remove_range(self, lambda)
    class(multiplier_system), intent(inout) :: self
    real(wp), intent(inout) :: lambda(:)      !! (n) in the constraints' own order [N]
    real(wp) :: shared(size(lambda))
    shared = lambda
    call self%minimum_norm_equivalent(shared)
    lambda = lambda - shared
  end subroutine remove_range

  !> x <- x + (S + eps)^-1 (r - S x) from 0 until the residual stops falling.
  subroutine correct(self)
    class(multiplier_system), intent(inout) :: self
    real(wp) :: size_now, size_before
    integer :: pass
    associate (b => self%r(1:self%n), x => self%best(1:self%n), w => self%x(1:self%n))
      b(:) = w
      x = 0.0_wp
      size_before = huge(1.0_wp)
      do pass = 1, most_passes
        size_now = maxval(abs(w))
        if (size_now >= 0.9_wp*size_before) exit
        size_before = size_now
        call substitute(self%n, self%kd, self%f, self%x)
        x(:) = x + w
        w(:) = b
        call subtract_product(self%n, self%kd, self%s, x, w)
      end do
      w(:) = x
    end associate
  end subroutine correct

  !> Rows that depend on earlier ones, by elimination of G, which is spent: a pivot below tol of its diagonal; and
  !> those that are off.
  subroutine weak_rows(self, tol, dependent)
    class(multiplier_system), intent(inout) :: self
    real(wp), intent(in) :: tol               !! [-]
    logical, intent(out) :: dependent(:)      !! (n) in the constraints' own order
    call mark_dependent(self, tol)
    dependent = self%dependent(self%all%position)
    if (allocated(self%off)) dependent = dependent .or. self%off
  end subroutine weak_rows

  !> The row that rounding weakens most: its pivot in S is the smallest beside its diagonal entry. 0: no row.
  pure integer function weakest_row(self) result(row)
    class(multiplier_system), intent(in) :: self
    real(wp), allocatable :: s(:, :)
    real(wp) :: diagonal(self%n)
    logical :: dependent(self%n)
    row = 0
    if (self%n == 0) return
    allocate (s(0:self%kd, self%n), source=self%s(:, 1:self%n))
    call find_dependent(self%n, self%kd, s, 0.0_wp, diagonal, dependent)
    row = self%row(minloc(s(0, :)/max(diagonal, tiny(1.0_wp)), 1))
  end function weakest_row

  !> Marks the rows that depend on earlier ones by geometry. Overwrites G.
  subroutine mark_dependent(self, tol)
    class(multiplier_system), intent(inout) :: self
    real(wp), intent(in) :: tol               !! [-]
    call find_dependent(size(self%dependent), self%all%kd, self%g, tol, self%r, self%dependent)
  end subroutine mark_dependent

  !> Eliminates a band matrix in place and leaves its pivots on its diagonal. A row depends on earlier ones where its pivot is not
  !> above tol times its diagonal entry; such a row is skipped.
  pure subroutine find_dependent(n, kd, g, tol, diagonal, dependent)
    integer, intent(in) :: n, kd
    real(wp), intent(inout) :: g(0:kd, n)     !! lower band, g(i, j) = G(j+i, j) [any]
    real(wp), intent(in) :: tol               !! [-]
    real(wp), intent(out) :: diagonal(n)      !! of the given matrix [any]
    logical, intent(out) :: dependent(n)
    real(wp) :: l
    integer :: i, j, k
    diagonal = g(0, :)
    do j = 1, n
      dependent(j) = .not. g(0, j) > tol*diagonal(j)
      if (dependent(j)) cycle                      ! the row adds nothing: skip it
      do i = 1, min(kd, n - j)
        l = g(i, j)/g(0, j)
        do k = i, min(kd, n - j)
          g(k - i, j + i) = g(k - i, j + i) - l*g(k, j)
        end do
      end do
    end do
  end subroutine find_dependent
end module multipliers
