!> Deck records of bodies, materials, sections and lumps into bodies of the model.
module build_bodies
  use kinds, only: wp
  use build_law, only: law_of
  use build_layers, only: add_layers
  use errors, only: fault_list
  use deck_geometry, only: removed_coordinates
  use deck_records, only: deck, body_record
  use body, only: body_model
  use body_operators, only: nodal_operators
  use body_setup, only: add_rigid_element, number_coordinates, elastic_integrals, make_nodal, finish_elastic, &
                        body_length, find_segments
  use acting_markers, only: acting_marker, coordinates_under_load
  use modal_reduction, only: reduce_to_modes
  use number_range, only: check_values, lost
  use text, only: to_text
  implicit none (type, external)
  private
  public :: build_body

contains

  !> One body of the deck. Faults: reference conditions that leave a motion free, too many modes, a mass matrix that is
  !> not positive definite.
  subroutine build_body(d, k, lumps, acting, b, faults)
    type(deck), intent(in) :: d
    integer, intent(in) :: k                  !! number of the body
    integer, intent(in) :: lumps(:)           !! numbers of the lumps on it
    type(acting_marker), intent(in) :: acting(:, :)
    type(body_model), intent(out) :: b
    type(fault_list), intent(inout) :: faults
    integer :: e, faults_before
    associate (r => d%bodies(k))
      b%name = r%name
      if (r%kind == 'rigid') then
        b%mass = r%mass
        b%i1 = r%mass*r%com
        b%i11 = r%inertia + r%mass*dot_product(r%com, r%com)
        allocate (b%segments(0), b%elements(0), b%x(2, 0), b%en(2, 0))
      else
        call lay_out_nodes(r, b)
        call set_elements(d, r, b)
        call add_layers(d, r, b, faults)
        do e = 1, b%ne
          call add_rigid_element(b, e)
        end do
      end if
      call add_lumps()
      b%length = body_length(b%x)
      faults_before = faults%count
      call check_values(d, r, b, faults)
      if (faults%count > faults_before) return
      if (r%kind /= 'rigid' .and. r%flexible) then
        call make_flexible()
      else
        if (.not. allocated(b%segments)) allocate (b%segments(0))
        if (b%mass*b%i11 - dot_product(b%i1, b%i1) <= lost*b%mass*b%i11) then
          call r%at%blame(faults, 'the mass matrix is not positive definite: the body has no rotary inertia about '// &
                      'its mass centre; expected inertia > 0 or a lump away from the mass centre')
        end if
      end if
    end associate
  contains
    !> Lumps of the body.
    subroutine add_lumps()
      integer :: k
      allocate (b%lumps(size(lumps)))
      do k = 1, size(lumps)
        associate (r => d%lumps(lumps(k)), l => b%lumps(k))
          l%node = r%marker%node
          l%x = r%marker%point
          if (l%node > 0) l%x = b%x(:, l%node)
          l%mass = r%mass
          l%inertia = r%inertia
          b%mass = b%mass + l%mass
          b%i1 = b%i1 + l%mass*l%x
          b%i11 = b%i11 + l%mass*dot_product(l%x, l%x) + l%inertia
        end associate
      end do
    end subroutine add_lumps

    !> Elastic coordinates, their integrals and what damps them.
    subroutine make_flexible()
      logical, allocatable :: removed(:, :)
      integer :: e
      logical :: bad
      associate (r => d%bodies(k))
        b%flexible = .true.
        b%axial = r%axial
        b%stiffening = r%stiffening
        removed = removed_coordinates(r)
        b%extra_references = max(count(removed) - 3, 0)
        call number_coordinates(b, with_cores(b, removed, r%slip_held))
        if (b%nf == 0) then
          call r%at%blame(faults, 'no elastic coordinate remains; expected more elements, or flexible=.false.')
          return
        end if
        call elastic_integrals(b)
        call find_segments(b)
        do e = 1, size(b%segments)
          b%segments(e)%law = law_of(d%materials(b%segments(e)%material)%law)
        end do
        call nodal_operators(b, b%op)
        if (r%modes > 0) then
          call reduce()
        else
          call make_nodal(b, bad)
          if (bad) then
            call r%at%blame(faults, 'the mass matrix is not positive definite; expected positive density, area and '// &
                        'element lengths of comparable size')
            return
          end if
        end if
        if (faults%count > 0) return
        call finish_elastic(b)
      end associate
    end subroutine make_flexible

    !> Reduces the body to its lowest modes; if the deck asks for them, also to static shapes of forces and moments on it.
    subroutine reduce()
      integer :: available
      logical :: bad
      associate (r => d%bodies(k))
        available = b%nf
        if (r%reference == 'free') available = b%nf - merge(3, 2, b%axial)
        if (r%modes > available) then
          call r%at%blame(faults, 'modes is larger than the number of elastic modes of the mesh; expected at most '// &
                      to_text(available))
          return
        end if
        call reduce_to_modes(b, r%modes, r%static_shapes, coordinates_under_load(acting, k, b), bad)
        if (bad) call r%at%blame(faults, 'the modes could not be computed: double precision does not carry the stiffness of '// &
                             'this mesh; expected fewer elements or less uneven ones')
      end associate
    end subroutine reduce
  end subroutine build_body

  !> Coordinates that are not there, those of cores included: no element beside the node has the core.
  pure function with_cores(b, removed, held) result(all_removed)
    type(body_model), intent(in) :: b
    logical, intent(in) :: removed(:, :)      !! (3, nn) u, v, rotation
    integer, intent(in) :: held(:)            !! nodes at which layers do not slip
    logical, allocatable :: all_removed(:, :) !! (3 and cores, nn)
    integer :: e, j, slots
    slots = maxval([0, b%layers%slot])
    allocate (all_removed(3 + slots, b%nn), source=.true.)
    all_removed(:3, :) = removed
    do e = 1, b%ne
      associate (kind => b%layers%kinds(b%layers%kind(e)))
        do j = 1, (kind%coordinates - 6)/3
          all_removed(3 + b%layers%slot(j, kind%section), b%en(:, e)) = .false.
        end do
      end associate
    end do
    all_removed(4:, held) = .true.
  end function with_cores

  !> Nodes and connectivity.
  subroutine lay_out_nodes(r, b)
    type(body_record), intent(in) :: r
    type(body_model), intent(inout) :: b
    integer :: k
    b%nn = r%nodes
    b%ne = r%elements
    allocate (b%x(2, b%nn), b%en(2, b%ne))
    if (r%kind == 'beam') then
      do k = 1, b%nn
        b%x(:, k) = [r%length*(k - 1)/b%ne, 0.0_wp]
      end do
      do k = 1, b%ne
        b%en(:, k) = [k, k + 1]
      end do
    else
      b%x(1, :) = r%node_x
      b%x(2, :) = r%node_y
      b%en = r%element_nodes
    end if
  end subroutine lay_out_nodes

  !> Geometry of the elements.
  subroutine set_elements(d, r, b)
    type(deck), intent(in) :: d
    type(body_record), intent(in) :: r
    type(body_model), intent(inout) :: b
    real(wp) :: dx(2)
    integer :: e
    allocate (b%elements(b%ne))
    do e = 1, b%ne
      associate (s => d%sections(r%element_section(e)), g => b%elements(e))
        dx = b%x(:, b%en(2, e)) - b%x(:, b%en(1, e))
        g%length = hypot(dx(1), dx(2))
        g%c = dx(1)/g%length
        g%s = dx(2)/g%length
        g%fibre = s%fibre
      end associate
    end do
  end subroutine set_elements
end module build_bodies
