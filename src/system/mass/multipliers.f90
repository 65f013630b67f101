!> The system for the multipliers, S lambda = r: the factor of S and its solutions. A weak pivot has one of two causes:
!> - very uneven masses (a heavy body on a light link) leave S regular: its own factor serves, and whoever uses the multipliers
!>   corrects them by the residual;
!> - dependent rows (redundant joints, a singular position) make S singular: the factor of S + eps 1 and a few corrections give the
!>   minimum-norm multipliers.
!> The matrix G of the joints' geometry alone, the same rows on bodies of unit mass, shows which of the two it is.
module multipliers
  use kinds, only: wp
  use band_ldl, only: eliminate, substitute, subtract_product
  use row_matrix_storage, only: row_matrix
  implicit none (type, external)
  private
  public :: multiplier_system

  real(wp), parameter :: redundant = 1.0e-8_wp    !! relative pivot of G below which a row depends on others [-]
  real(wp), parameter :: weak_pivot = 1.0e-6_wp   !! relative pivot from which rows count as independent [-]
  real(wp), parameter :: least_pivot = 2.0e-15_wp !! relative pivot that is still above rounding [-]
  real(wp), parameter :: strong_pivot = 1.0e-2_wp !! relative pivot of G from which the order of rows does not matter [-]
  real(wp), parameter :: regular_pivot = 1.0e-12_wp   !! relative pivot down to which S may be taken as regular [-]
  integer, parameter :: most_passes = 100           !! corrections of the regularised solve

  !> S, its factor and what weak pivots mean.
  type, extends(row_matrix) :: multiplier_system
    real(wp) :: shift = 1.0e-6_wp              !! eps of S + eps 1 over the mean diagonal: 1e-9 where rows are redundant [-]
                                               !! everywhere; larger while a weak direction must not move (`frame_closing`)
    real(wp) :: weakest = weak_pivot           !! relative pivot below which the geometry decides what it means [-]
    logical :: singular = .false.              !! rows depend on others: the factor is that of a shifted S
    logical :: uneven_masses = .false.         !! very uneven masses: multipliers are exact only after corrections
    logical :: ill_conditioned = .false.       !! masses so uneven that S in double precision has lost the heavy bodies
    logical :: was_ill_conditioned = .false.   !! at some evaluation of the run
    logical, allocatable :: dependent(:)       !! (rows) reordered rows that depend on others by geometry
  contains
    procedure :: set_up => set_up_factor
    procedure :: factor
    procedure :: factor_uneven
    procedure :: beyond_digits
    procedure :: factor_strong
    procedure :: factor_weak
    procedure :: note_ill_conditioned
    procedure :: put
    procedure :: get
    procedure :: solve
    procedure :: solve_beside
    procedure :: mean_shift
    procedure :: add_shift
    procedure :: minimum_norm_equivalent
    procedure :: remove_range
    procedure :: weak_rows
    procedure :: weakest_row
  end type multiplier_system

contains

  !> Orders the rows from the pairs of sides that meet in a body, and allocates.
  subroutine set_up_factor(self, n, rows, cols, same)
    class(multiplier_system), intent(inout) :: self
    integer, intent(in) :: n                  !! constraint rows
    integer, intent(in) :: rows(:), cols(:)   !! pairs of sides of one body
    logical, intent(in) :: same(:)            !! a side with itself
    call self%row_matrix%set_up(n, rows, cols, same)
    allocate (self%dependent(n), source=.false.)
  end subroutine set_up_factor

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

  !> Notes that rounding has removed the heavy bodies' part of S.
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
    eps = eps_of_factor(self)
    self%f(0, 1:self%n) = self%f(0, 1:self%n) + eps
    call eliminate(self%n, self%kd, self%f, self%s, -1.0e100_wp, good)
  end subroutine factor_shifted

  !> What is added to the diagonal of a singular S.
  pure real(wp) function eps_of_factor(self) result(eps)   ! [1/kg]
    class(multiplier_system), intent(in) :: self
    eps = self%mean_shift()
    if (.not. eps > tiny(1.0_wp)) eps = 1.0_wp   ! S is 0: no multiplier moves anything, any shift will do
  end function eps_of_factor

  !> f = S, with zeros beyond its last column.
  pure subroutine take_matrix(ns, nf, s, f)
    integer, intent(in) :: ns, nf             !! entries of s and f
    real(wp), intent(in) :: s(ns)             !! [1/kg]
    real(wp), intent(out) :: f(nf)            !! [1/kg]
    f(1:ns) = s
    f(ns + 1:) = 0.0_wp
  end subroutine take_matrix

  !> Puts the right-hand side b, or b - S f, in the order of the factor.
  subroutine put(self, b, f)
    class(multiplier_system), intent(inout) :: self
    real(wp), intent(in), contiguous :: b(:)  !! (rows) [m/s2]
    real(wp), intent(in), optional :: f(:)    !! (rows) of those that are off [N]
    integer :: k
    do k = 1, self%n
      self%x(k) = b(self%row(k))*self%scale(self%row(k))
    end do
    if (.not. present(f)) return
    self%r = f/self%scale
    call self%subtract_couplings()
  end subroutine put

  !> The solution, in the rows' own order.
  subroutine get(self, x)
    class(multiplier_system), intent(in) :: self
    real(wp), intent(inout), contiguous :: x(:)   !! (rows) [N]
    integer :: k
    do k = 1, self%n
      x(self%row(k)) = self%x(k)*self%scale(self%row(k))
    end do
  end subroutine get

  !> Solves S lambda = r in place (minimum norm where S is singular).
  subroutine solve(self, lambda)
    class(multiplier_system), intent(inout) :: self
    real(wp), intent(inout), contiguous :: lambda(:)   !! (n) right-hand side [m/s2], then multipliers [N], in the rows' own order
    if (self%n == 0) return
    call put(self, lambda)
    call substitute_placed(self, lambda)
  end subroutine solve

  !> Multipliers x of the rows that hold, beside given ones of rows that are off: S x = b - S f.
  subroutine solve_beside(self, b, f, x)
    class(multiplier_system), intent(inout) :: self
    real(wp), intent(in), contiguous :: b(:)  !! (rows) [m/s2]
    real(wp), intent(in) :: f(:)              !! (rows) zero where rows hold [N]
    real(wp), intent(inout), contiguous :: x(:)   !! (rows) [N]
    call put(self, b, f)
    call substitute_placed(self, x)
  end subroutine solve_beside

  !> The shift of the diagonal of a singular S.
  pure real(wp) function mean_shift(self)          ! [1/kg]
    class(multiplier_system), intent(in) :: self
    mean_shift = self%shift*sum(self%s(0, 1:self%n))/self%n
  end function mean_shift

  !> Adds that shift times given multipliers to the right-hand side.
  pure subroutine add_shift(self, lambda)
    class(multiplier_system), intent(inout) :: self
    real(wp), intent(in) :: lambda(:)         !! (rows) [N]
    self%x(1:self%n) = self%x(1:self%n) + self%mean_shift()*lambda(self%row)/self%scale(self%row)
  end subroutine add_shift

  !> x by the last factor, from the right-hand side in the order of the factor.
  subroutine substitute_placed(self, x)
    class(multiplier_system), intent(inout) :: self
    real(wp), intent(inout), contiguous :: x(:)   !! (rows) [N]
    if (self%singular) then
      call correct(self)
    else
      call substitute(self%n, self%kd, self%f, self%x)
    end if
    if (self%n < size(x)) x = 0.0_wp
    call get(self, x)
  end subroutine substitute_placed

  !> The minimum-norm multipliers that exert the same forces as the given ones, by the last factor: redundant rows share.
  !> Rounding of S lambda over eps is in them, too, and exerts no force: what eps/(S + eps) leaves of them holds it and is split.
  subroutine minimum_norm_equivalent(self, lambda)
    class(multiplier_system), intent(inout) :: self
    real(wp), intent(inout) :: lambda(:)      !! (n) in the constraints' own order [N]
    real(wp) :: rest(size(lambda)), moving(size(lambda))   ! of those multipliers, and what of it exerts forces [N]
    integer :: pass
    call solve_for_forces(self, lambda)
    if (.not. self%singular .or. self%uneven_masses) return   ! no factor of S + eps
    call put(self, lambda/self%scale**2)
    do pass = 1, 2
      call substitute(self%n, self%kd, self%f, self%x)
      self%x = eps_of_factor(self)*self%x
    end do
    rest = 0.0_wp
    call get(self, rest)
    moving = rest
    call solve_for_forces(self, moving)
    lambda = lambda - (rest - moving)
  end subroutine minimum_norm_equivalent

  !> lambda <- the solution for S lambda.
  subroutine solve_for_forces(self, lambda)
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
  end subroutine solve_for_forces

  !> Reduces the given multipliers to the part that exerts no force: that in the null space of S.
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

  !> Rows that depend on others, by elimination of G, which is overwritten; and those that are off.
  subroutine weak_rows(self, dependent, tol)
    class(multiplier_system), intent(inout) :: self
    logical, intent(out) :: dependent(:)      !! (n) in the constraints' own order
    real(wp), intent(in), optional :: tol     !! pivot over its diagonal, in place of `redundant` [-]
    real(wp) :: least                         ! [-]
    least = redundant
    if (present(tol)) least = tol
    call mark_dependent(self, least)
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
    call find_dependent(self%n, self%kd, s, 0.0_wp, 0.0_wp, diagonal, dependent)
    row = self%row(minloc(s(0, :)/max(diagonal, tiny(1.0_wp)), 1))
  end function weakest_row

  !> Marks the rows that depend on others by geometry. Overwrites G.
  subroutine mark_dependent(self, tol)
    class(multiplier_system), intent(inout) :: self
    real(wp), intent(in) :: tol               !! [-]
    call find_dependent(size(self%dependent), self%all%kd, self%g, tol, strong_pivot, self%r, self%dependent)
  end subroutine mark_dependent

  !> Eliminates a band matrix in place and leaves its pivots on its diagonal. A row depends on others where its pivot is not above
  !> tol times its diagonal entry; such a row is skipped. Rows with weak pivots come last, since rounding grows behind each of them.
  pure subroutine find_dependent(n, kd, g, tol, strong, diagonal, dependent)
    integer, intent(in) :: n, kd
    real(wp), intent(inout) :: g(0:kd, n)     !! lower band, g(i, j) = G(j+i, j) [any]
    real(wp), intent(in) :: tol               !! [-]
    real(wp), intent(in) :: strong            !! pivot over its diagonal entry below which a row comes last [-]
    real(wp), intent(out) :: diagonal(n)      !! of the given matrix [any]
    logical, intent(out) :: dependent(n)
    logical :: later(n)
    real(wp) :: l
    integer :: i, j, k
    diagonal = g(0, :)
    do j = 1, n
      dependent(j) = .not. g(0, j) > tol*diagonal(j)
      later(j) = g(0, j) < strong*diagonal(j) .and. .not. dependent(j)
      if (dependent(j) .or. later(j)) cycle        ! the row adds nothing: skip it
      do i = 1, min(kd, n - j)
        l = g(i, j)/g(0, j)
        do k = i, min(kd, n - j)
          g(k - i, j + i) = g(k - i, j + i) - l*g(k, j)
        end do
      end do
    end do
    if (any(later)) call eliminate_later(n, kd, tol, diagonal, pack([(j, j=1, n)], later), g, dependent)
  end subroutine find_dependent

  !> Eliminates the rows that were left for later, the strongest pivot first: their matrix beside the others, c, is full.
  pure subroutine eliminate_later(n, kd, tol, diagonal, rows, g, dependent)
    integer, intent(in) :: n, kd
    real(wp), intent(in) :: tol               !! [-]
    real(wp), intent(in) :: diagonal(n)       !! of the given matrix [any]
    integer, intent(in) :: rows(:)            !! left for later, ascending
    real(wp), intent(inout) :: g(0:kd, n)     !! as the elimination has left it [any]
    logical, intent(inout) :: dependent(n)
    real(wp) :: e(n, size(rows)), c(size(rows), size(rows))   ! columns of the rows within the others, what is left [any]
    integer :: j, k, last, next
    logical :: left(size(rows))
    e = 0.0_wp
    c = 0.0_wp
    next = 1
    do j = 1, n
      last = min(kd, n - j)
      if (next <= size(rows)) then
        if (rows(next) == j) then
          c(:, next) = e(j, :)
          c(next, :) = e(j, :)
          c(next, next) = g(0, j)
          e(j + 1:j + last, next) = g(1:last, j)
          next = next + 1
          cycle
        end if
      end if
      if (dependent(j)) cycle
      do k = 1, next - 1
        c(:, k) = c(:, k) - e(j, k)/g(0, j)*e(j, :)
        e(j + 1:j + last, k) = e(j + 1:j + last, k) - e(j, k)/g(0, j)*g(1:last, j)
      end do
    end do
    left = .true.
    do while (any(left))
      next = maxloc([(c(k, k)/diagonal(rows(k)), k=1, size(rows))], 1, left)
      g(0, rows(next)) = c(next, next)
      dependent(rows(next)) = .not. c(next, next) > tol*diagonal(rows(next))
      left(next) = .false.
      if (.not. dependent(rows(next))) c = c - spread(c(:, next)/c(next, next), 2, size(rows))*spread(c(next, :), 1, size(rows))
    end do
  end subroutine eliminate_later
end module multipliers
