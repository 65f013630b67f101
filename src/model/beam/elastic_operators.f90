!> The matrices of a flexible body's elastic coordinates, nodal or modal, each entry once on a sparse pattern, and the products
!> that forces, residuals, tangents and energies take with them.
module elastic_operators
  use kinds, only: wp
  use banded, only: band_factor, factor_symmetric
  use sparse_pattern, only: symmetric_pattern
  implicit none (type, external)
  private
  public :: inertia_forces, damping_forces, inertia_products, mass_product, bilinear, add_product, factor_entries

  !> The operators. An entry of row i stands among first(i) to first(i+1) - 1, its column in `row` (the patterns are symmetric).
  type, public :: elastic_operator
    type(symmetric_pattern) :: symmetric     !! of the symmetric matrices
    type(symmetric_pattern) :: skew          !! of Z
    real(wp), allocatable :: m(:)            !! translational part of m_ff [kg, kg m, kg m2]
    real(wp), allocatable :: j(:)            !! rotary inertia of lumps, the rest of m_ff [kg m2]
    real(wp), allocatable :: c(:)            !! Rayleigh damping [N s/m, N s, N m s]
    real(wp), allocatable :: k(:)            !! stiffness at E_R, without stiffening [N/m, N, N m]
    real(wp), allocatable :: z(:)            !! Z on its own pattern [kg, kg m, kg m2]
    logical :: rotary = .false.              !! j is not zero
    ! stiffness that viscoelastic terms multiply, as a list of entries: of elements, or of a material's modal stiffness
    integer, allocatable :: entry(:)         !! place of each entry in the symmetric pattern
    integer, allocatable :: segment(:)       !! viscoelastic segment of the body
    real(wp), allocatable :: part(:)         !! [N/m, N, N m]
  end type elastic_operator

contains

  !> Adds theta'^2 m q + 2 theta' Z q' to the forces and -Z q to m_theta_f, and sums q^T m q and q^T m q' (theory.md, section 3).
  pure subroutine inertia_forces(op, n, thetad, q, v, force, coupling, qmq, qmv)
    type(elastic_operator), intent(in) :: op
    integer, intent(in) :: n
    real(wp), intent(in) :: thetad                 !! frame rate [rad/s]
    real(wp), intent(in) :: q(n), v(n)             !! coordinates [m, rad] and rates [m/s, rad/s]
    real(wp), intent(inout) :: force(n)            !! [N, N m]
    real(wp), intent(inout) :: coupling(n)         !! [kg m, kg m2]
    real(wp), intent(out) :: qmq, qmv              !! [kg m2], [kg m2/s]
    real(wp) :: s, z(2)
    integer :: i, k
    qmq = 0.0_wp
    qmv = 0.0_wp
    do i = 1, n
      s = 0.0_wp
      do k = op%symmetric%first(i), op%symmetric%first(i + 1) - 1
        s = s + op%m(k)*q(op%symmetric%row(k))
      end do
      z = 0.0_wp
      do k = op%skew%first(i), op%skew%first(i + 1) - 1
        z(1) = z(1) + op%z(k)*q(op%skew%row(k))
        z(2) = z(2) + op%z(k)*v(op%skew%row(k))
      end do
      qmq = qmq + q(i)*s
      qmv = qmv + v(i)*s
      force(i) = force(i) + (thetad**2*s + 2*thetad*z(2))
      coupling(i) = coupling(i) - z(1)
    end do
  end subroutine inertia_forces

  !> Adds -C v to the forces, and to the power v^T C v.
  pure subroutine damping_forces(op, n, v, force, power)
    type(elastic_operator), intent(in) :: op
    integer, intent(in) :: n
    real(wp), intent(in) :: v(n)                   !! [m/s, rad/s]
    real(wp), intent(inout) :: force(n)            !! [N, N m]
    real(wp), intent(inout) :: power               !! [W]
    real(wp) :: s
    integer :: i, k
    do i = 1, n
      s = 0.0_wp
      do k = op%symmetric%first(i), op%symmetric%first(i + 1) - 1
        s = s + op%c(k)*v(op%symmetric%row(k))
      end do
      force(i) = force(i) - s
      power = power + v(i)*s
    end do
  end subroutine damping_forces

  !> m x of two vectors and Z y of two others, m the translational part of m_ff: the pairs stand side by side in memory.
  pure subroutine inertia_products(op, n, x, y, mx, zy)
    type(elastic_operator), intent(in) :: op
    integer, intent(in) :: n
    real(wp), intent(in) :: x(2, n), y(2, n)       !! coordinates, rates, accelerations [m, rad, ...]
    real(wp), intent(out) :: mx(2, n), zy(2, n)    !! [kg] times these
    call two_products(n, size(op%m), op%symmetric%first, op%symmetric%row, op%m, x, mx)
    call two_products(n, size(op%z), op%skew%first, op%skew%row, op%z, y, zy)
  end subroutine inertia_products

  !> A x of two vectors.
  pure subroutine two_products(n, entries, first, col, a, x, y)
    integer, intent(in) :: n, entries
    integer, intent(in) :: first(n + 1), col(entries)
    real(wp), intent(in) :: a(entries), x(2, n)    !! [any]
    real(wp), intent(out) :: y(2, n)               !! [any]
    real(wp) :: s(2)
    integer :: i, k
    do i = 1, n
      s = 0.0_wp
      do k = first(i), first(i + 1) - 1
        s = s + a(k)*x(:, col(k))
      end do
      y(:, i) = s
    end do
  end subroutine two_products

  !> y = m_ff x.
  pure subroutine mass_product(op, x, y)
    type(elastic_operator), intent(in) :: op
    real(wp), intent(in) :: x(:)                   !! (n) [m, rad, ...]
    real(wp), intent(out) :: y(:)                  !! (n) [kg] times these
    y = 0.0_wp
    call add_product(op%symmetric, op%m, x, y)
    if (op%rotary) call add_product(op%symmetric, op%j, x, y)
  end subroutine mass_product

  !> x^T A y, A given by its entries on a pattern; allocates nothing.
  pure real(wp) function bilinear(pattern, a, x, y) result(total)   ! [any]
    type(symmetric_pattern), intent(in) :: pattern
    real(wp), intent(in), contiguous :: a(:)       !! (entries) [any]
    real(wp), intent(in), contiguous :: x(:), y(:) !! (n) [any]
    real(wp) :: s
    integer :: i, k
    total = 0.0_wp
    do i = 1, size(x)
      s = 0.0_wp
      do k = pattern%first(i), pattern%first(i + 1) - 1
        s = s + a(k)*y(pattern%row(k))
      end do
      total = total + x(i)*s
    end do
  end function bilinear

  !> y <- y + A x, A given by its entries on a pattern.
  pure subroutine add_product(pattern, a, x, y)
    type(symmetric_pattern), intent(in) :: pattern
    real(wp), intent(in) :: a(:)                   !! (entries) [any]
    real(wp), intent(in) :: x(:)                   !! (n) [any]
    real(wp), intent(inout) :: y(:)                !! (n) [any]
    real(wp) :: s
    integer :: i, k
    do i = 1, size(x)
      s = 0.0_wp
      do k = pattern%first(i), pattern%first(i + 1) - 1
        s = s + a(k)*x(pattern%row(k))
      end do
      y(i) = y(i) + s
    end do
  end subroutine add_product

  !> Factors a symmetric positive definite matrix given by its entries on a pattern.
  subroutine factor_entries(pattern, a, factor, bad)
    type(symmetric_pattern), intent(in) :: pattern
    real(wp), intent(in) :: a(:)                   !! (entries) [any]
    type(band_factor), intent(out) :: factor
    logical, intent(out) :: bad                    !! the matrix is not positive definite
    logical :: lower(size(a))
    lower = pattern%row >= pattern%col
    call factor_symmetric(size(pattern%first) - 1, pack(pattern%row, lower), pack(pattern%col, lower), pack(a, lower), factor, bad)
  end subroutine factor_entries
end module elastic_operators
