!> Builds a body: rigid-body integrals, elastic coordinates under the reference conditions, shape integrals, the
!> factor of the mass matrix, internal variables. All set-up work; nothing here runs in a step.
module body_setup
  use kinds, only: wp, pi
  use beam_element, only: shape_integral, shape_moment
  use body, only: body_model, lump
  use segment_model, only: viscoelastic_segment
  use elastic_operators, only: factor_entries
  use marker, only: turn
  use nodal_basis, only: nodal_model
  implicit none (type, external)
  private
  public :: add_rigid_element, add_rigid_lump, number_coordinates, elastic_integrals, make_nodal
  public :: element_basis, finish_elastic, body_length, find_segments

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
    logical :: kept(3, b%nn)
    integer :: k
    kept = .not. removed
    if (.not. b%axial) kept(1, :) = .false.
    b%nf = count(kept)
    b%dof = unpack([(k, k=1, b%nf)], kept, 0)
    b%edof = reshape(b%dof(:, reshape(b%en, [2*b%ne])), [6, b%ne])
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
        cc(j) = cc(j) + dot_product(turn(xi), s(:, k)) + dot_product(turn(d), sx(:, k))
      end do
    end do
    do k = 1, size(b%lumps)
      call add_elastic_lump(b%lumps(k), b%dof(:, b%lumps(k)%node), sb, f1, cc)
    end do
    b%shape%sbar = transpose(sb(:, 1:))
    b%shape%i1f = f1(1:)
    b%shape%c0 = cc(1:)
  end subroutine elastic_integrals

  !> A lump's part of S-bar, I1f and c0.
  pure subroutine add_elastic_lump(l, dof, sb, f1, cc)
    type(lump), intent(in) :: l
    integer, intent(in) :: dof(3)            !! coordinates of its node
    real(wp), intent(inout) :: sb(:, 0:)     !! [kg]
    real(wp), intent(inout) :: f1(0:), cc(0:)   !! [kg m], rotations [kg m2]
    real(wp) :: hx(2)
    integer :: c
    hx = turn(l%x)
    do c = 1, 2
      sb(c, dof(c)) = sb(c, dof(c)) + l%mass
      f1(dof(c)) = f1(dof(c)) + l%mass*l%x(c)
      cc(dof(c)) = cc(dof(c)) + l%mass*hx(c)
    end do
    cc(dof(3)) = cc(dof(3)) + l%inertia
  end subroutine add_elastic_lump

  !> Makes a body nodal: the factor of m_ff, the elements' constants, the viscoelastic segments' stiffness.
  subroutine make_nodal(b, bad)
    type(body_model), intent(inout) :: b
    logical, intent(out) :: bad           !! m_ff is not positive definite
    type(nodal_model) :: nodal
    integer :: k
    nodal = element_basis(b)
    call factor_entries(b%op%symmetric, b%op%m + b%op%j, nodal%mff, bad)
    nodal%factors = 1
    nodal%columns = b%ne
    nodal%angle = [(k > 3, k=6 - b%nd, 5)]
    nodal%rotation = [(.false., k=1, b%nf)]
    nodal%rotation(pack(b%dof(3, :), b%dof(3, :) > 0)) = .true.
    nodal%reach = [(1.0_wp, k=1, b%nf)]
    nodal%carried = pi**2*minval(sqrt(b%elements%ei_l/b%elements%mass)/b%elements%length)      ! half a wave an element
    do k = 1, size(b%segments)
      associate (segment => b%segments(k))
        segment%ei_l = b%elements(segment%first:segment%last)%ei_l
        segment%ea_l = pack(b%elements(segment%first:segment%last)%ea_l, b%axial)
      end associate
    end do
    allocate (b%basis, source=nodal)
  end subroutine make_nodal

  !> What nodal coordinates are but for m_ff.
  pure type(nodal_model) function element_basis(b) result(nodal)
    type(body_model), intent(in) :: b
    nodal%straight = all(abs(b%elements%s) <= 0.0_wp .and. b%elements%c >= 0.0_wp)
  end function element_basis

  !> Solutions m_ff^-1 of the shape integrals, and the number of internal variables.
  subroutine finish_elastic(b)
    type(body_model), intent(inout) :: b
    real(wp) :: work(2, b%nf)                 ! [any]
    integer :: k
    associate (shape => b%shape)
      shape%pmat = shape%sbar
      call b%basis%solve_mass(b%nf, work, shape%pmat(:, 1), shape%pmat(:, 2))
      shape%sps = matmul(transpose(shape%sbar), shape%pmat)
    end associate
    b%nz = 0
    do k = 1, size(b%segments)
      associate (segment => b%segments(k))
        segment%width = size(b%basis%angle)*(segment%last - segment%first + 1)
        b%nz = b%nz + segment%width*size(segment%law%alpha)
      end associate
    end do
  end subroutine finish_elastic

  !> Splits the elements into segments of one viscoelastic material.
  pure subroutine find_segments(b, viscoelastic)
    type(body_model), intent(inout) :: b
    logical, intent(in) :: viscoelastic(:) !! (ne) whether the element has terms
    type(viscoelastic_segment), allocatable :: segments(:)
    integer :: e, n
    allocate (segments(b%ne))
    n = 0
    do e = 1, b%ne
      if (.not. viscoelastic(e)) cycle
      if (n > 0) then
        if (segments(n)%last == e - 1 .and. segments(n)%material == b%elements(e)%material) then
          segments(n)%last = e
          cycle
        end if
      end if
      n = n + 1
      segments(n)%first = e
      segments(n)%last = e
      segments(n)%material = b%elements(e)%material
    end do
    b%segments = segments(1:n)
  end subroutine find_segments

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
