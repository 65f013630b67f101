!> Builds the matrices of a body's elastic coordinates: sums over elements and lumps, or modes. Set-up work.
module body_operators
  use kinds, only: wp
  use beam_element, only: element_mass, element_gyroscopic, element_stiffness
  use body, only: body_model
  use elastic_operators, only: elastic_operator
  use segment_model, only: viscoelastic_segment
  implicit none (type, external)
  private
  public :: nodal_operators, modal_operators

contains

  !> Nodes: sums over the elements and lumps.
  subroutine nodal_operators(body, op)
    type(body_model), intent(in) :: body
    type(elastic_operator), intent(out) :: op
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
    op%rotary = any(abs(op%j) > 0.0_wp)
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

  !> Modes: m_ff is the unit matrix, lumps' rotary inertia included.
  subroutine modal_operators(segments, omega2, z, j, c, op)
    type(viscoelastic_segment), intent(in) :: segments(:)   !! of each material
    real(wp), intent(in) :: omega2(:)                       !! (n) squared frequencies [rad2/s2]
    real(wp), intent(in) :: z(:, :)                         !! (n, n) Psi^T Z Psi [-]
    real(wp), intent(in) :: j(:, :)                         !! (n, n) rotary inertia of lumps, which theta' does not see [-]
    real(wp), intent(in) :: c(:, :)                         !! (n, n) Rayleigh damping [1/s]
    type(elastic_operator), intent(out) :: op
    integer :: i, k, r, n
    n = size(omega2)
    call op%odd%make(n, [((i, i=1, n), k=1, n)], [((k, i=1, n), k=1, n)])
    if (size(segments) == 0 .and. .not. any(abs(j) + abs(c) > 0.0_wp)) then
      call op%even%make(n, [integer ::], [integer ::])
    else
      op%even = op%odd
    end if
    op%j = [(j(op%even%row(k), op%even%col(k)), k=1, size(op%even%row))]
    op%c = [(c(op%even%row(k), op%even%col(k)), k=1, size(op%even%row))]
    op%m = -op%j
    op%k = 0*op%j
    op%z = reshape(transpose(z), [n**2])
    do i = 1, n
      op%m(op%even%entry(i, i)) = op%m(op%even%entry(i, i)) + 1
      op%k(op%even%entry(i, i)) = omega2(i)
    end do
    op%entry = [((i, i=1, n**2), r=1, size(segments))]
    op%segment = [((r, i=1, n**2), r=1, size(segments))]
    op%part = [(reshape(segments(r)%stiffness, [n**2]), r=1, size(segments))]
    op%rotary = any(abs(op%j) > 0.0_wp)
  end subroutine modal_operators
end module body_operators
