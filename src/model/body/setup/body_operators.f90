!> Builds the matrices of a body's elastic coordinates: sums over elements and lumps, or modes. Set-up work.
module body_operators
  use kinds, only: wp
  use body, only: body_model
  use elastic_operators, only: elastic_operator
  use beam_element, only: deformation_matrix
  use element_law, only: inertia_of, parts_of, stiffness_part, weighted_stiffness
  use layered_element, only: element_inertia
  use segment_model, only: viscoelastic_segment
  implicit none (type, external)
  private
  public :: nodal_operators, modal_operators

contains

  !> Nodes: sums over the elements and lumps. All entries that are not zero are listed, then added up on the patterns they make.
  subroutine nodal_operators(body, op)
    type(body_model), intent(in) :: body
    type(elastic_operator), intent(out) :: op
    integer, allocatable :: symmetric(:, :), skew(:, :)      ! (2, entries) row and column
    integer, allocatable :: segment(:), p(:)           ! of entries: segment or 0, number in the pattern
    real(wp), allocatable :: a(:, :), az(:)            ! (4, entries) of m, k, c, j; of Z [kg, kg m, ...]
    real(wp), dimension(size(body%edof, 1), size(body%edof, 1)) :: k, c
    type(element_inertia) :: x
    integer :: e, r, n, nz, i, j, at(2), part, most, parts
    most = size(body%edof, 1)**2
    parts = size(body%layers%part, 1)
    allocate (symmetric(2, most*parts*body%ne), segment(most*parts*body%ne), a(4, most*parts*body%ne))
    allocate (skew(2, most*body%ne + 2*size(body%lumps)), az(most*body%ne + 2*size(body%lumps)))
    n = 0
    nz = 0
    do e = 1, body%ne
      x = inertia_of(body, e)
      c = 0.0_wp
      call weighted_stiffness(body, e, body%layers%kinds(body%layers%kind(e))%ray_k, deformation_matrix(body%elements(e)), c)
      c = x%c + c
      do part = 1, parts_of(body, e)
        k = 0.0_wp
        call stiffness_part(body, e, part, k)
        r = body%layers%part(part, e)
        do j = 1, size(body%edof, 1)
          do i = 1, size(body%edof, 1)
            at = body%edof([i, j], e)
            if (any(at == 0)) cycle
            if (part == 1 .and. abs(x%z(i, j)) > 0.0_wp) call note(at, x%z(i, j))
            if (.not. (abs(x%m(i, j)) + abs(x%j(i, j)) > 0.0_wp .or. abs(k(i, j)) > 0.0_wp)) cycle
            n = n + 1
            symmetric(:, n) = at
            segment(n) = r
            a(:, n) = [x%m(i, j), k(i, j), c(i, j), x%j(i, j)]
            if (part > 1) a([1, 3, 4], n) = 0.0_wp
          end do
        end do
      end do
    end do
    do r = 1, size(body%lumps)
      at = body%dof(1:2, body%lumps(r)%node)
      if (any(at == 0)) cycle
      call note(at, body%lumps(r)%mass)
      call note(at([2, 1]), -body%lumps(r)%mass)
    end do
    call op%symmetric%make(body%nf, symmetric(1, 1:n), symmetric(2, 1:n))
    call op%skew%make(body%nf, skew(1, 1:nz), skew(2, 1:nz))
    allocate (p(n))
    allocate (op%m(size(op%symmetric%row)), op%z(size(op%skew%row)), source=0.0_wp)
    op%j = op%m
    op%c = op%m
    op%k = op%m
    do e = 1, n
      p(e) = op%symmetric%entry(symmetric(2, e), symmetric(1, e))
      op%m(p(e)) = op%m(p(e)) + a(1, e)
      op%k(p(e)) = op%k(p(e)) + a(2, e)
      op%c(p(e)) = op%c(p(e)) + a(3, e)
      op%j(p(e)) = op%j(p(e)) + a(4, e)
    end do
    do e = 1, nz
      i = op%skew%entry(skew(2, e), skew(1, e))
      op%z(i) = op%z(i) + az(e)
    end do
    op%entry = pack(p, segment(1:n) > 0)
    op%segment = pack(segment(1:n), segment(1:n) > 0)
    op%part = pack(a(2, 1:n), segment(1:n) > 0)
    call add_lumps(body, op)
    op%rotary = any(abs(op%j) > 0.0_wp)
  contains
    !> Appends an entry of Z.
    subroutine note(at, x)
      integer, intent(in) :: at(2)
      real(wp), intent(in) :: x                        !! [kg, kg m]
      nz = nz + 1
      skew(:, nz) = at
      az(nz) = x
    end subroutine note
  end subroutine nodal_operators

  !> Masses and inertias of lumps on the diagonal.
  pure subroutine add_lumps(body, op)
    type(body_model), intent(in) :: body
    type(elastic_operator), intent(inout) :: op
    integer :: l, i, p
    do l = 1, size(body%lumps)
      associate (d => body%dof(:, body%lumps(l)%node))
        do i = 1, 3
          if (d(i) == 0) cycle
          p = op%symmetric%entry(d(i), d(i))
          if (i < 3) op%m(p) = op%m(p) + body%lumps(l)%mass
          if (i == 3) op%j(p) = op%j(p) + body%lumps(l)%inertia
        end do
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
    call op%skew%make(n, [((i, i=1, n), k=1, n)], [((k, i=1, n), k=1, n)])
    if (size(segments) == 0 .and. .not. any(abs(j) + abs(c) > 0.0_wp)) then
      call op%symmetric%make(n, [integer ::], [integer ::])
    else
      op%symmetric = op%skew
    end if
    op%j = [(j(op%symmetric%row(k), op%symmetric%col(k)), k=1, size(op%symmetric%row))]
    op%c = [(c(op%symmetric%row(k), op%symmetric%col(k)), k=1, size(op%symmetric%row))]
    op%m = -op%j
    op%k = 0*op%j
    op%z = reshape(transpose(z), [n**2])
    do i = 1, n
      op%m(op%symmetric%entry(i, i)) = op%m(op%symmetric%entry(i, i)) + 1
      op%k(op%symmetric%entry(i, i)) = omega2(i)
    end do
    op%entry = [((i, i=1, n**2), r=1, size(segments))]
    op%segment = [((r, i=1, n**2), r=1, size(segments))]
    op%part = [(reshape(segments(r)%stiffness, [n**2]), r=1, size(segments))]
    op%rotary = any(abs(op%j) > 0.0_wp)
  end subroutine modal_operators
end module body_operators
