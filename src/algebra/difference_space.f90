!> A space of directions V with their images W = M V by differences of a map whose derivative is M (theory.md, section 15). What it
!> knows of M gives the step of the search and the multipliers. Nothing of the size of M is formed.
module difference_space
  use kinds, only: wp
  use lapack, only: dgeev, dgesdd, dgesv
  use sorting, only: ascending
  implicit none (type, external)
  private

  !> The space.
  type, public :: direction_space
    integer :: count = 0
    real(wp), allocatable :: basis(:, :)      !! (n, count or more) orthonormal [-]
    real(wp), allocatable :: v(:, :)          !! (n, count or more) directions that were moved along [-]
    real(wp), allocatable :: w(:, :)          !! (n, count or more) their images [-]
  contains
    procedure :: clear
    procedure :: add
    procedure :: learn
    procedure :: rest_of
    procedure :: fit
    procedure :: ritz
    procedure :: rescale
    procedure :: along
    procedure :: spread => spread_of
  end type direction_space

  !> Ritz pairs of M, the largest first.
  type, public :: ritz_pairs
    complex(wp), allocatable :: value(:)      !! [-]
    complex(wp), allocatable :: vector(:, :)  !! (n, pairs) of length 1 [-]
    real(wp), allocatable :: residual(:)      !! |M x - value x| [-]
    real(wp), allocatable :: condition(:)     !! change of a value by one of M, at most [-]
    complex(wp), allocatable :: left(:, :)    !! (space, pairs) left vectors [-]
    complex(wp), allocatable :: right(:, :)   !! (space, pairs) right vectors; left and right have the product 1 [-]
  end type ritz_pairs

contains

  !> No directions.
  subroutine clear(self, n)
    class(direction_space), intent(inout) :: self
    integer, intent(in) :: n                  !! unknowns
    integer, parameter :: first = 16          ! directions that fit without more memory
    self%count = 0
    if (.not. allocated(self%v)) allocate (self%basis(n, first), self%v(n, first), self%w(n, first))
  end subroutine clear

  !> Appends a direction of length 1, or what the joints left of it, unless it is hardly a new one.
  subroutine add(self, v, w)
    class(direction_space), intent(inout) :: self
    real(wp), intent(in) :: v(:), w(:)        !! (n) [-]
    real(wp), parameter :: new = 0.1_wp       ! of a new direction is orthogonal to the others, at least [-]
    real(wp) :: rest(size(v))                 ! [-]
    rest = self%rest_of(v)
    if (norm2(rest) < new) return
    if (self%count == size(self%v, 2)) then
      self%basis = reshape(self%basis, [size(v), 2*self%count], pad=[0.0_wp])
      self%v = reshape(self%v, [size(v), 2*self%count], pad=[0.0_wp])
      self%w = reshape(self%w, [size(v), 2*self%count], pad=[0.0_wp])
    end if
    self%count = self%count + 1
    self%basis(:, self%count) = rest/norm2(rest)
    self%v(:, self%count) = v
    self%w(:, self%count) = w
  end subroutine add

  !> Puts the last difference before all others, of which those are given up that are no longer new beside it.
  subroutine learn(self, v, w)
    class(direction_space), intent(inout) :: self
    real(wp), intent(in) :: v(:), w(:)        !! (n) of any length [-]
    type(direction_space) :: before
    real(wp) :: length                        ! [-]
    integer :: k
    length = max(norm2(v), tiny(1.0_wp))
    before%v = self%v(:, :self%count)
    before%w = self%w(:, :self%count)
    self%count = 0
    call self%add(v/length, w/length)
    do k = 1, size(before%v, 2)
      call self%add(before%v(:, k), before%w(:, k))
    end do
  end subroutine learn

  !> All components by other units.
  subroutine rescale(self, factor)
    class(direction_space), intent(inout) :: self
    real(wp), intent(in) :: factor(:)         !! (n) [any]
    type(direction_space) :: before
    real(wp) :: length                        ! [any]
    integer :: k
    before%v = self%v(:, :self%count)
    before%w = self%w(:, :self%count)
    self%count = 0
    do k = 1, size(before%v, 2)
      length = norm2(factor*before%v(:, k))
      if (length > 0.0_wp) call self%add(factor*before%v(:, k)/length, factor*before%w(:, k)/length)
    end do
  end subroutine rescale

  !> The part of a vector that is orthogonal to the directions, to rounding.
  function rest_of(self, x) result(rest)
    class(direction_space), intent(in) :: self
    real(wp), intent(in) :: x(:)              !! (n) [-]
    real(wp) :: rest(size(x))                 ! [-]
    integer :: pass
    rest = x
    associate (b => self%basis(:, :self%count))
      do pass = 1, 2
        rest = rest - matmul(b, matmul(rest, b))
      end do
    end associate
  end function rest_of

  !> Coefficients c for which (V - W) c is nearest to r, of least size, and what is left of r. With an unknown period there is
  !> another column for it, minus the slope; the directions are then across the slope, which is the phase condition.
  subroutine fit(self, r, slope, c, rest)
    class(direction_space), intent(in) :: self
    real(wp), intent(in) :: r(:)              !! (n) [-]
    real(wp), intent(in) :: slope(:)          !! (n), or none: of the state at the end by the period, over the period [-]
    real(wp), allocatable, intent(out) :: c(:)   !! (space), and the change of the period over it [-]
    real(wp), intent(out) :: rest(:)          !! (n) [-]
    real(wp), parameter :: cut = 1.0e-7_wp    ! of the largest singular value, and of a direction of length 1: rounding below it [-]
    real(wp), allocatable :: a(:, :), s(:), u(:, :), vt(:, :)
    integer :: columns
    columns = self%count + min(1, size(slope))
    allocate (c(columns), source=0.0_wp)
    rest = r
    if (columns == 0) return
    allocate (a(size(r), columns))
    a(:, :self%count) = self%v(:, :self%count) - self%w(:, :self%count)
    if (size(slope) > 0) a(:, columns) = -slope
    call decompose(a, s, u, vt)
    associate (m => count(s > cut*max(1.0_wp, s(1))))
      c = matmul(matmul(r, u(:, :m))/s(:m), vt(:m, :))
    end associate
    rest = r - matmul(a, c)
  end subroutine fit

  !> Singular values and vectors of a tall or wide matrix.
  subroutine decompose(a, s, u, vt)
    real(wp), intent(in) :: a(:, :)           !! [-]
    real(wp), allocatable, intent(out) :: s(:), u(:, :), vt(:, :)   !! [-]
    real(wp), allocatable :: work(:), copy(:, :)
    real(wp) :: wanted(1)
    integer :: m, n, k, info
    integer, allocatable :: integers(:)
    m = size(a, 1)
    n = size(a, 2)
    k = min(m, n)
    copy = a
    allocate (s(k), u(m, k), vt(k, n), integers(8*k))
    call dgesdd('S', m, n, copy, m, s, u, m, vt, k, wanted, -1, integers, info)
    allocate (work(nint(wanted(1))))
    call dgesdd('S', m, n, copy, m, s, u, m, vt, k, work, size(work), integers, info)
  end subroutine decompose

  !> Ritz pairs, with residuals.
  subroutine ritz(self, pairs)
    class(direction_space), intent(in) :: self
    type(ritz_pairs), intent(out) :: pairs
    real(wp), allocatable :: h(:, :), left(:, :), right(:, :), re(:), im(:), work(:)
    integer, allocatable :: order(:)
    complex(wp), allocatable :: x(:)
    real(wp) :: size_of                       ! [-]
    integer :: k, n, info
    n = self%count
    h = coefficients(self, self%w(:, :n))               ! the map within the space: M V is nearest to V H
    allocate (left(n, n), right(n, n), re(n), im(n), work(8*n + 8))
    call dgeev('V', 'V', n, h, n, re, im, left, n, right, n, work, size(work), info)
    order = ascending(-hypot(re, im))         ! equal ones, the two of a pair, stay as they are
    pairs%value = cmplx(re(order), im(order), wp)
    allocate (pairs%left(n, n), pairs%right(n, n), pairs%residual(n), pairs%condition(n))
    allocate (pairs%vector(size(self%v, 1), n))
    do k = 1, n
      pairs%left(:, k) = complex_vector(left, im, order(k))
      pairs%right(:, k) = complex_vector(right, im, order(k))
      associate (product => dot_product(pairs%left(:, k), pairs%right(:, k)))
        pairs%condition(k) = 1/max(abs(product), tiny(1.0_wp))
        pairs%left(:, k) = pairs%left(:, k)/conjg(product)
      end associate
      x = matmul(self%v(:, :n), pairs%right(:, k))
      size_of = sqrt(sum(abs(x)**2))
      pairs%residual(k) = sqrt(sum(abs(matmul(self%w(:, :n), pairs%right(:, k)) - pairs%value(k)*x)**2))/size_of
      pairs%vector(:, k) = x/size_of
    end do
  end subroutine ritz

  !> Coefficients of what is nearest to vectors in the space.
  function coefficients(self, x) result(c)
    class(direction_space), intent(in) :: self
    real(wp), intent(in) :: x(:, :)           !! (n, vectors) [-]
    real(wp), allocatable :: c(:, :)
    c = by_products(self, matmul(transpose(self%v(:, :self%count)), x))
  end function coefficients

  !> The same where the products with the directions are known.
  function by_products(self, products) result(c)
    class(direction_space), intent(in) :: self
    real(wp), intent(in) :: products(:, :)    !! (space, vectors) [-]
    real(wp), allocatable :: c(:, :), g(:, :)
    integer :: pivots(self%count), info
    c = products
    associate (v => self%v(:, :self%count))
      g = matmul(transpose(v), v)
    end associate
    call dgesv(self%count, size(c, 2), g, self%count, pivots, c, self%count, info)
  end function by_products

  !> What a vector has of a Ritz vector: the product with its left vector.
  complex(wp) function along(self, pairs, k, x)
    class(direction_space), intent(in) :: self
    type(ritz_pairs), intent(in) :: pairs
    integer, intent(in) :: k                  !! number of the pair
    complex(wp), intent(in) :: x(:)           !! (n) [-]
    real(wp), allocatable :: c(:, :)
    c = coefficients(self, reshape([x%re, x%im], [size(x), 2]))
    along = dot_product(pairs%left(:, k), cmplx(c(:, 1), c(:, 2), wp))
  end function along

  !> By how much a Ritz value changes, about, when each component of each image does so at random.
  real(wp) function spread_of(self, pairs, k, by) result(change)   ! [-]
    class(direction_space), intent(in) :: self
    type(ritz_pairs), intent(in) :: pairs
    integer, intent(in) :: k                  !! number of the pair
    real(wp), intent(in) :: by(:)             !! (n) changes of the components [-]
    real(wp), allocatable :: c(:, :)
    complex(wp) :: weights(size(by))          ! of the components in the product with the left vector [-]
    c = by_products(self, reshape([pairs%left(:, k)%re, pairs%left(:, k)%im], [self%count, 2]))
    weights = matmul(self%v(:, :self%count), cmplx(c(:, 1), c(:, 2), wp))
    change = sqrt(sum(abs(weights*by)**2)*sum(abs(pairs%right(:, k))**2))
  end function spread_of

  !> A vector of dgeev: of a pair, real and imaginary part stand in two columns.
  pure function complex_vector(x, im, k) result(z)
    real(wp), intent(in) :: x(:, :)           !! [-]
    real(wp), intent(in) :: im(:)             !! imaginary parts of the values; those of a pair have opposite signs [-]
    integer, intent(in) :: k
    complex(wp) :: z(size(x, 1))
    z = x(:, k)
    if (im(k) > 0.0_wp) z = cmplx(x(:, k), x(:, k + 1), wp)
    if (im(k) < 0.0_wp) z = cmplx(x(:, k - 1), -x(:, k), wp)
  end function complex_vector
end module difference_space
