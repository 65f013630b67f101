!> Builds a body: rigid-body integrals, elastic coordinates under the reference conditions, shape integrals, the
!> factor of the mass matrix, dissipative coordinates. All set-up work; nothing here runs in a step.
module body_setup
  use kinds, only: wp
  use banded, only: factor_symmetric, band_solve_two
  use beam_element, only: beam_geometry, shape_integral, shape_moment
  use body, only: body_model, lump, viscoelastic_segment
  use body_matrices, only: mass_triplets
  use body_operators, only: elastic_operators_of
  use chain_kernel, only: element_factors
  use nodal_basis, only: nodal_model
  implicit none (type, external)
  private
  public :: add_rigid_element, add_rigid_lump, number_coordinates, elastic_integrals, factor_mass
  public :: finish_elastic, allocate_work, body_length, sort_segments

contains

  !> Adds an element's mass to the rigid-body integrals.
  pure subroutine add_rigid_element(b, e)
    type(body_model), intent(inout) :: b
    integer, intent(in) :: e              !! element
    real(wp) :: w, xi(2), d(2)
    w = b%elements(e)%mass
    xi = b%x(:, b%en(1, e))
    d = b%x(:, b%en(2, e)) - xi
    b%mass = b%mass + w
    b%i1 = b%i1 + w*(xi + d/2)
    b%i11 = b%i11 + w*(dot_product(xi, xi) + dot_product(xi, d) + dot_product(d, d)/3)
  end subroutine add_rigid_element

  !> Adds a lump to the rigid-body integrals.
  pure subroutine add_rigid_lump(b, l)
    type(body_model), intent(inout) :: b
    type(lump), intent(in) :: l
    b%mass = b%mass + l%mass
    b%i1 = b%i1 + l%mass*l%x
    b%i11 = b%i11 + l%mass*dot_product(l%x, l%x) + l%inertia
  end subroutine add_rigid_lump

  !> Numbers the nodal coordinates that remain, node by node (u, v, rotation).
  pure subroutine number_coordinates(b, removed)
    type(body_model), intent(inout) :: b
    logical, intent(in) :: removed(:, :)   !! (3, nn) coordinates stopped by the reference conditions
    integer :: k, c, e
    allocate (b%dof(3, b%nn), b%edof(6, b%ne))
    b%nf = 0
    do k = 1, b%nn
      do c = 1, 3
        b%dof(c, k) = 0
        if (removed(c, k)) cycle
        if (c == 1 .and. .not. b%axial) cycle
        b%nf = b%nf + 1
        b%dof(c, k) = b%nf
      end do
    end do
    do e = 1, b%ne
      b%edof(1:3, e) = b%dof(:, b%en(1, e))
      b%edof(4:6, e) = b%dof(:, b%en(2, e))
    end do
  end subroutine number_coordinates

  !> S-bar, I1f and c0 of the nodal coordinates (theory.md, section 2), lumps included.
  pure subroutine elastic_integrals(b)
    type(body_model), intent(inout) :: b
    real(wp) :: s(2, 6), sx(2, 6), xi(2), d(2)
    real(wp), allocatable :: sb(:, :), f1(:), cc(:)
    integer :: e, k, j
    allocate (sb(2, 0:b%nf), f1(0:b%nf), cc(0:b%nf), source=0.0_wp)
    do e = 1, b%ne
      s = shape_integral(b%elements(e))
      sx = shape_moment(b%elements(e))
      xi = b%x(:, b%en(1, e))
      d = b%x(:, b%en(2, e)) - xi
      do k = 1, 6
        j = b%edof(k, e)
        sb(:, j) = sb(:, j) + s(:, k)
        f1(j) = f1(j) + dot_product(xi, s(:, k)) + dot_product(d, sx(:, k))
        cc(j) = cc(j) + dot_product(turned(xi), s(:, k)) + dot_product(turned(d), sx(:, k))
      end do
    end do
    do k = 1, size(b%lumps)
      call add_elastic_lump(b%lumps(k), b%dof(:, b%lumps(k)%node), sb, f1, cc)
    end do
    allocate (b%sbar(b%nf, 2), b%i1f(b%nf), b%c0(b%nf))
    b%sbar = transpose(sb(:, 1:))
    b%i1f = f1(1:)
    b%c0 = cc(1:)
  end subroutine elastic_integrals

  !> H x: a vector turned by +90 degrees.
  pure function turned(x) result(y)
    real(wp), intent(in) :: x(2)
    real(wp) :: y(2)
    y = [-x(2), x(1)]
  end function turned

  !> A lump's part of S-bar, I1f and c0.
  pure subroutine add_elastic_lump(l, dof, sb, f1, cc)
    type(lump), intent(in) :: l
    integer, intent(in) :: dof(3)            !! coordinates of its node
    real(wp), intent(inout) :: sb(:, 0:), f1(0:), cc(0:)
    real(wp) :: hx(2)
    integer :: c
    hx = turned(l%x)
    do c = 1, 2
      sb(c, dof(c)) = sb(c, dof(c)) + l%mass
      f1(dof(c)) = f1(dof(c)) + l%mass*l%x(c)
      cc(dof(c)) = cc(dof(c)) + l%mass*hx(c)
    end do
    cc(dof(3)) = cc(dof(3)) + l%inertia
  end subroutine add_elastic_lump

  !> Factors m_ff of the nodal coordinates.
  subroutine factor_mass(b, bad)
    type(body_model), intent(inout) :: b
    integer, intent(out) :: bad           !! 0, or the coordinate at which m_ff is not positive definite
    integer, allocatable :: rows(:), cols(:)
    real(wp), allocatable :: values(:)
    call mass_triplets(b, rows, cols, values)
    call factor_symmetric(b%nf, rows, cols, values, b%mff, bad)
  end subroutine factor_mass

  !> m_ff^-1 S-bar^T and S-bar m_ff^-1 S-bar^T (nodal: by the factor; modal: m_ff is the unit matrix).
  subroutine finish_elastic(b)
    type(body_model), intent(inout) :: b
    integer :: i, j
    b%pmat = b%sbar
    if (.not. b%modal) call band_solve_two(b%mff, b%pmat(:, 1), b%pmat(:, 2))
    do j = 1, 2
      do i = 1, 2
        b%sps(i, j) = dot_product(b%sbar(:, i), b%pmat(:, j))
      end do
    end do
  end subroutine finish_elastic

  !> Counts the internal variables and allocates the work space of one evaluation.
  subroutine allocate_work(b)
    type(body_model), intent(inout) :: b
    integer :: k
    b%nz = 0
    if (.not. allocated(b%basis)) allocate (nodal_model :: b%basis)
    do k = 1, size(b%segments)
      associate (segment => b%segments(k))
        segment%width = merge(b%nf, b%nd*(segment%last - segment%first + 1), b%modal)
        segment%ei_l = b%elements(segment%first:segment%last)%ei_l
        segment%ea_l = pack(b%elements(segment%first:segment%last)%ea_l, b%axial)
      end associate
      b%nz = b%nz + b%segments(k)%width*size(b%segments(k)%law%alpha)
    end do
    b%chain = b%straight .and. .not. (b%stiffening .or. b%modal)
    allocate (b%factors(10, b%ne))
    do k = 1, b%ne
      associate (g => b%elements(k))
        b%factors(:, k) = element_factors(g%length, g%mass, g%ea_l, g%ei_l)
      end associate
      if (k > 1) b%chain = b%chain .and. b%en(1, k) == b%en(2, k - 1)
    end do
    call elastic_operators_of(b, b%op)
    allocate (b%qx(0:b%nf), b%vx(0:b%nf), b%elastic_force(0:b%nf), b%angle_coupling(0:b%nf), source=0.0_wp)
    if (b%modal) then
      allocate (b%d(b%nf, size(b%segments)), b%ds(b%nf, size(b%segments)), source=0.0_wp)
    else
      allocate (b%d(b%nd, b%ne), b%ds(b%nd, b%ne), source=0.0_wp)
    end if
  end subroutine allocate_work

  !> Splits the elements into segments of one viscoelastic material.
  pure subroutine sort_segments(b, has_ghm)
    type(body_model), intent(inout) :: b
    logical, intent(in) :: has_ghm(:)      !! (ne) whether the element is viscoelastic
    type(viscoelastic_segment), allocatable :: segments(:)
    integer :: e, n
    allocate (segments(b%ne))
    n = 0
    do e = 1, b%ne
      if (.not. has_ghm(e)) cycle
      if (n > 0) then
        if (segments(n)%last == e - 1 .and. segments(n)%material == b%material(e)) then
          segments(n)%last = e
          cycle
        end if
      end if
      n = n + 1
      segments(n)%first = e
      segments(n)%last = e
      segments(n)%material = b%material(e)
    end do
    b%segments = segments(1:n)
  end subroutine sort_segments

  !> Largest distance between two points [m].
  pure function body_length(x) result(length)
    real(wp), intent(in) :: x(:, :)      !! (2, n) [m]
    real(wp) :: length, far, middle(2)
    real(wp) :: r(size(x, 2))            ! distances from the middle, where no two points are farther apart than their sum [m]
    integer, allocatable :: ends(:)
    integer :: i, j
    middle = 0.5_wp*(maxval(x, dim=2) + minval(x, dim=2))
    do i = 1, size(x, 2)
      r(i) = norm2(x(:, i) - middle)
    end do
    j = maxloc(r, dim=1)
    far = maxval([0.0_wp, ((x(1, i) - x(1, j))**2 + (x(2, i) - x(2, j))**2, i=1, size(r))])
    ends = pack([(i, i=1, size(r))], r + maxval(r) >= 0.999_wp*sqrt(far))
    do i = 2, size(ends)
      do j = 1, i - 1
        far = max(far, (x(1, ends(i)) - x(1, ends(j)))**2 + (x(2, ends(i)) - x(2, ends(j)))**2)
      end do
    end do
    length = sqrt(far)
  end function body_length
end module body_setup
