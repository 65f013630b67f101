!> Builds a body: rigid-body integrals, elastic coordinates under the reference conditions, shape integrals, the
!> factor of the mass matrix, internal variables. All set-up work; nothing here runs in a step.
module body_setup
  use kinds, only: half_digits, pi, wp
  use body, only: body_model, lump
  use element_law, only: inertia_of
  use layered_element, only: element_inertia
  use segment_model, only: viscoelastic_segment
  use elastic_operators, only: factor_entries
  use marker, only: turn
  use nodal_basis, only: nodal_model
  implicit none (type, external)
  private
  public :: add_rigid_element, number_coordinates, elastic_integrals, make_nodal
  public :: elements_of, finish_elastic, body_length, find_segments

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
    associate (kind => b%layers%kinds(b%layers%kind(e)))
      d = [-b%elements(e)%s, b%elements(e)%c]
      b%i1 = b%i1 + kind%first*d
      b%i11 = b%i11 + 2*kind%first*dot_product(xi, d) + kind%second
    end associate
  end subroutine add_rigid_element

  !> Numbers the nodal coordinates that remain, node by node (u, v, rotation, shear angles of cores), behind each node those that
  !> are elements' own.
  pure subroutine number_coordinates(b, removed)
    type(body_model), intent(inout) :: b
    logical, intent(in) :: removed(:, :)   !! (3 and cores, nn) coordinates stopped by the reference conditions, or not there
    logical :: kept(size(removed, 1), b%nn)
    integer :: own(b%nn)                   ! coordinates of elements that begin at a node; then the last one given a number
    integer :: k, j, e
    kept = .not. removed
    if (.not. b%axial) kept(1, :) = .false.
    own = 0
    do e = 1, b%ne
      own(b%en(1, e)) = own(b%en(1, e)) + (b%layers%kinds(b%layers%kind(e))%coordinates - 6)/3
    end do
    allocate (b%dof(size(kept, 1), b%nn), source=0)
    b%nf = 0
    do k = 1, b%nn
      b%dof(:, k) = unpack([(b%nf + j, j=1, count(kept(:, k)))], kept(:, k), 0)
      j = b%nf + count(kept(:, k))
      b%nf = j + own(k)
      own(k) = j
    end do
    allocate (b%edof(3*(size(kept, 1) - 1), b%ne), source=0)
    do e = 1, b%ne
      b%edof(:6, e) = reshape(b%dof(:3, b%en(:, e)), [6])
      associate (kind => b%layers%kinds(b%layers%kind(e)))
        do j = 1, (kind%coordinates - 6)/3
          k = 3 + b%layers%slot(j, kind%section)
          own(b%en(1, e)) = own(b%en(1, e)) + 1
          b%edof(4 + 3*j:6 + 3*j, e) = [b%dof(k, b%en(1, e)), b%dof(k, b%en(2, e)), own(b%en(1, e))]
        end do
      end associate
    end do
  end subroutine number_coordinates

  !> S-bar, I1f and c0 of the nodal coordinates (theory.md, section 2), lumps included.
  pure subroutine elastic_integrals(b)
    type(body_model), intent(inout) :: b
    type(element_inertia) :: x
    real(wp) :: xi(2)
    real(wp), allocatable :: sb(:, :), f1(:), cc(:)
    integer :: e, k, j
    allocate (sb(2, 0:b%nf), f1(0:b%nf), cc(0:b%nf), source=0.0_wp)
    do e = 1, b%ne
      x = inertia_of(b, e)
      xi = b%x(:, b%en(1, e))
      do k = 1, size(b%edof, 1)
        j = b%edof(k, e)
        sb(:, j) = sb(:, j) + x%s(:, k)
        f1(j) = f1(j) + dot_product(xi, x%s(:, k)) + x%along(k)
        cc(j) = cc(j) + dot_product(turn(xi), x%s(:, k)) + x%turning(k)
      end do
    end do
    do k = 1, size(b%lumps)
      call add_elastic_lump(b%lumps(k), b%dof(:3, b%lumps(k)%node), sb, f1, cc)
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
    real(wp), allocatable :: stiffness(:) ! of each row [N/m], [N m]
    integer :: k, e
    nodal = elements_of(b)
    call factor_entries(b%op%symmetric, b%op%m + b%op%j, nodal%mff, bad)
    nodal%factors = 1
    nodal%rotation = [(.true., k=1, b%nf)]
    nodal%rotation(pack(b%dof(1:2, :), b%dof(1:2, :) > 0)) = .false.
    nodal%top_frequency = pi**2*minval(sqrt(b%elements%ei_l/b%elements%mass)/b%elements%length)      ! half a wave an element
    allocate (stiffness(nodal%columns))
    do e = 1, b%ne
      associate (kind => b%layers%kinds(b%layers%kind(e)))
        stiffness(b%layers%row(:size(kind%stiffness), e)) = kind%stiffness
      end associate
    end do
    do k = 1, size(b%segments)
      b%segments(k)%diagonal = stiffness(b%segments(k)%first:b%segments(k)%last)
    end do
    allocate (b%basis, source=nodal)
  end subroutine make_nodal

  !> What nodal coordinates are but for m_ff.
  type(nodal_model) function elements_of(b) result(nodal)
    type(body_model), intent(in) :: b
    integer :: e
    nodal%rows = 1
    nodal%columns = maxval(b%layers%row)
    allocate (nodal%angle(nodal%columns))
    do e = 1, b%ne
      associate (angle => b%layers%kinds(b%layers%kind(e))%angle)
        nodal%angle(b%layers%row(:size(angle), e)) = angle
      end associate
    end do
    allocate (nodal%at(0:6, b%ne))
    nodal%at(0, :) = b%layers%row(1, :)
    nodal%at(1:, :) = b%edof(:6, :)
    nodal%straight = all(abs(b%elements%s) <= 0.0_wp .and. b%elements%c >= 0.0_wp)
  end function elements_of

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
        segment%width = b%basis%rows*(segment%last - segment%first + 1)
        b%nz = b%nz + segment%width*size(segment%law%alpha)
      end associate
    end do
  end subroutine finish_elastic

  !> Places the rows of all elements among the deformations: elastic ones, then layer by layer along the body what terms follow.
  !> Neighbouring elements whose layer is of the same material share a segment.
  pure subroutine find_segments(b)
    type(body_model), intent(inout) :: b
    type(viscoelastic_segment), allocatable :: segments(:)
    integer :: e, i, l, n, columns, layers, rows, last, material, segment
    layers = 0
    rows = 0
    do i = 1, size(b%layers%kinds)
      layers = max(layers, maxval(b%layers%kinds(i)%layer))
      rows = max(rows, size(b%layers%kinds(i)%layer))
    end do
    allocate (b%layers%row(rows, b%ne), b%layers%row_part(rows, b%ne), source=0)
    allocate (b%layers%part(layers + 1, b%ne), source=-1)
    allocate (segments(layers*b%ne))
    n = 0
    columns = 0
    do l = 0, layers
      last = -1                            ! element before that has the layer with terms
      do e = 1, b%ne
        associate (kind => b%layers%kinds(b%layers%kind(e)), part => b%layers%part(:, e))
          material = 0
          do i = 1, size(kind%layer)
            if (merge(0, kind%layer(i), kind%material(i) == 0) /= l) cycle
            columns = columns + 1
            b%layers%row(i, e) = columns
            if (l > 0 .and. material == 0) then
              material = kind%material(i)
              if (last == e - 1 .and. n > 0) then
                if (segments(n)%material /= material) last = -1
              end if
              if (last /= e - 1) then
                n = n + 1
                segments(n)%first = columns
                segments(n)%material = material
                segments(n)%layer = merge(l, 0, layers > 1)
              end if
              last = e
            end if
            segment = merge(n, 0, l > 0)
            if (l > 0) segments(n)%last = columns
            if (.not. any(part == segment)) part(count(part >= 0) + 1) = segment
            b%layers%row_part(i, e) = findloc(part, segment, 1)
          end do
        end associate
      end do
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
    ends = pack([(i, i=1, size(r))], r + maxval(r) >= (1 - half_digits)*sqrt(far))
    do i = 2, size(ends)
      do j = 1, i - 1
        far = max(far, (x(1, ends(i)) - x(1, ends(j)))**2 + (x(2, ends(i)) - x(2, ends(j)))**2)
      end do
    end do
    length = sqrt(far)
  end function body_length
end module body_setup
