!> The matrices of a flexible body's elastic coordinates, nodal or modal, each entry once on a sparse pattern: what residuals,
!> tangents and their factors multiply with. Modes fill their pattern; nothing else tells them from nodes here.
module elastic_operators
  use kinds, only: wp
  use beam_element, only: element_mass, element_gyroscopic, element_stiffness
  use body, only: body_model
  use sparse_pattern, only: symmetric_pattern
  implicit none (type, external)
  private
  public :: elastic_operators_of, inertia_products, add_product

  !> The operators. An entry of row i stands among first(i) to first(i+1) - 1, its column in `row` (the patterns are symmetric).
  type, public :: elastic_operator
    type(symmetric_pattern) :: even          !! of the symmetric matrices
    type(symmetric_pattern) :: odd           !! of Z
    real(wp), allocatable :: m(:)            !! translational part of m_ff [kg, kg m, kg m2]
    real(wp), allocatable :: j(:)            !! rotary inertia of lumps, the rest of m_ff [kg m2]
    real(wp), allocatable :: c(:)            !! Rayleigh damping [N s/m, N s, N m s]
    real(wp), allocatable :: k(:)            !! stiffness at E_R, without stiffening [N/m, N, N m]
    real(wp), allocatable :: z(:)            !! Z on its own pattern [kg, kg m, kg m2]
    logical :: rotary = .false.              !! j is not zero
    ! stiffness that GHM terms multiply, as a list: an element's entries, or those of a material's modal stiffness
    integer, allocatable :: entry(:)         !! marker in the even pattern
    integer, allocatable :: segment(:)       !! GHM segment of the body
    real(wp), allocatable :: part(:)         !! [N/m, N, N m]
  end type elastic_operator

contains

  !> Builds the operators of a body.
  subroutine elastic_operators_of(body, op)
    type(body_model), intent(in) :: body
    type(elastic_operator), intent(out) :: op
    if (body%modal) then
      call modal_operators(body, op)
    else
      call nodal_operators(body, op)
    end if
    op%rotary = any(abs(op%j) > 0.0_wp)
  end subroutine elastic_operators_of

  !> Modes: m_ff is the unit matrix, lumps' rotary inertia included.
  subroutine modal_operators(body, op)
    type(body_model), intent(in) :: body
    type(elastic_operator), intent(inout) :: op
    integer :: i, j, r, n
    n = body%nf
    call op%even%make(n, [((i, i=1, n), j=1, n)], [((j, i=1, n), j=1, n)])
    op%odd = op%even
    op%j = reshape(body%jmodal, [n**2])
    op%m = -op%j
    op%k = [(0.0_wp, i=1, n**2)]
    op%c = reshape(body%cmodal, [n**2])
    op%z = reshape(transpose(body%zmodal), [n**2])
    do i = 1, n
      op%m(op%even%entry(i, i)) = op%m(op%even%entry(i, i)) + 1
      op%k(op%even%entry(i, i)) = body%omega2(i)
    end do
    op%entry = [((i, i=1, n**2), r=1, size(body%segments))]
    op%segment = [((r, i=1, n**2), r=1, size(body%segments))]
    op%part = [(reshape(body%segments(r)%stiffness, [n**2]), r=1, size(body%segments))]
  end subroutine modal_operators

  !> Nodes: sums over the elements and lumps.
  subroutine nodal_operators(body, op)
    type(body_model), intent(in) :: body
    type(elastic_operator), intent(inout) :: op
    real(wp) :: m(6, 6), k(6, 6), z(6, 6)
    integer :: e, r, n, i, j, p, segment
    call nodal_patterns(body, op)
    n = size(op%even%row)
    allocate (op%m(n), op%j(n), op%c(n), op%k(n), op%z(size(op%odd%row)), source=0.0_wp)
    allocate (op%entry(36*body%ne), op%segment(36*body%ne), op%part(36*body%ne))
    n = 0
    do e = 1, body%ne
      m = element_mass(body%elements(e))
      k = element_stiffness(body%elements(e))
      z = element_gyroscopic(body%elements(e))
      segment = 0
      do r = 1, size(body%segments)
        if (e >= body%segments(r)%first .and. e <= body%segments(r)%last) segment = r
      end do
      do j = 1, 6
        do i = 1, 6
          if (body%edof(i, e) == 0 .or. body%edof(j, e) == 0) cycle
          if (abs(z(i, j)) > 0.0_wp) then
            p = op%odd%entry(body%edof(j, e), body%edof(i, e))
            op%z(p) = op%z(p) + z(i, j)
          end if
          if (.not. (abs(m(i, j)) > 0.0_wp .or. abs(k(i, j)) > 0.0_wp)) cycle
          p = op%even%entry(body%edof(j, e), body%edof(i, e))
          op%m(p) = op%m(p) + m(i, j)
          op%k(p) = op%k(p) + k(i, j)
          op%c(p) = op%c(p) + body%elements(e)%ray_m*m(i, j) + body%elements(e)%ray_k*k(i, j)
          if (segment == 0) cycle
          n = n + 1
          op%entry(n) = p
          op%segment(n) = segment
          op%part(n) = k(i, j)
        end do
      end do
    end do
    op%entry = op%entry(1:n)
    op%segment = op%segment(1:n)
    op%part = op%part(1:n)
    call add_lumps(body, op)
  end subroutine nodal_operators

  !> The markers of all entries that are not zero.
  subroutine nodal_patterns(body, op)
    type(body_model), intent(in) :: body
    type(elastic_operator), intent(inout) :: op
    integer, allocatable :: r(:), c(:), zr(:), zc(:)
    real(wp) :: a(6, 6), z(6, 6)
    integer :: e, i, j, n, nz, l
    allocate (r(36*body%ne), c(36*body%ne), zr(36*body%ne + size(body%lumps)), zc(36*body%ne + size(body%lumps)))
    n = 0
    nz = 0
    do e = 1, body%ne
      a = abs(element_mass(body%elements(e))) + abs(element_stiffness(body%elements(e)))
      z = element_gyroscopic(body%elements(e))
      do j = 1, 6
        do i = 1, 6
          if (body%edof(i, e) == 0 .or. body%edof(j, e) == 0) cycle
          if (a(i, j) > 0.0_wp) call note(body%edof(i, e), body%edof(j, e), n, r, c)
          if (abs(z(i, j)) > 0.0_wp) call note(body%edof(i, e), body%edof(j, e), nz, zr, zc)
        end do
      end do
    end do
    do l = 1, size(body%lumps)
      associate (d => body%dof(:, body%lumps(l)%node))
        if (d(1) > 0 .and. d(2) > 0) call note(d(1), d(2), nz, zr, zc)
      end associate
    end do
    call op%even%make(body%nf, r(1:n), c(1:n))
    call op%odd%make(body%nf, zr(1:nz), zc(1:nz))
  contains
    !> Appends a marker.
    pure subroutine note(row, col, n, r, c)
      integer, intent(in) :: row, col
      integer, intent(inout) :: n, r(:), c(:)
      n = n + 1
      r(n) = row
      c(n) = col
    end subroutine note
  end subroutine nodal_patterns

  !> What lumps add.
  pure subroutine add_lumps(body, op)
    type(body_model), intent(in) :: body
    type(elastic_operator), intent(inout) :: op
    integer :: l, i, j, p
    do l = 1, size(body%lumps)
      associate (d => body%dof(:, body%lumps(l)%node), mu => body%lumps(l)%mass)
        do i = 1, 3
          if (d(i) == 0) cycle
          p = op%even%entry(d(i), d(i))
          if (i < 3) op%m(p) = op%m(p) + mu
          if (i == 3) op%j(p) = op%j(p) + body%lumps(l)%inertia
        end do
        if (d(1) == 0 .or. d(2) == 0) cycle
        i = op%odd%entry(d(2), d(1))
        j = op%odd%entry(d(1), d(2))
        op%z(i) = op%z(i) + mu
        op%z(j) = op%z(j) - mu
      end associate
    end do
  end subroutine add_lumps

  !> m x of two vectors and Z y of two others, m the translational part of m_ff: the pairs stand side by side in memory.
  pure subroutine inertia_products(op, n, x, y, mx, zy)
    type(elastic_operator), intent(in) :: op
    integer, intent(in) :: n
    real(wp), intent(in) :: x(2, n), y(2, n)       !! coordinates, rates, accelerations [m, rad, ...]
    real(wp), intent(out) :: mx(2, n), zy(2, n)    !! [kg] times these
    call two_products(n, size(op%m), op%even%first, op%even%row, op%m, x, mx)
    call two_products(n, size(op%z), op%odd%first, op%odd%row, op%z, y, zy)
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
end module elastic_operators
