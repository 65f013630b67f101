!> Sections of layers, and sections that shear, from records into a body whose nodes and elements are laid out.
module build_layers
  use kinds, only: half_digits, pi, wp
  use body, only: body_model
  use build_law, only: law_of
  use errors, only: fault_list
  use deck_records, only: deck, body_record, material_record, section_record
  use layered_element, only: make_layered_element
  use layered_section, only: layered_section_model, section_layer, set_up_section, shear_coefficient
  use viscoelastic_law, only: viscoelastic_terms
  implicit none (type, external)
  private
  public :: add_layers

  real(wp), parameter :: same_length = 1.0e-12_wp  !! nodes are rounded: lengths that differ by less are one [-]

contains

  !> Mass and stiffness of a body's elements, by the layers of their sections.
  subroutine add_layers(d, r, b, faults)
    type(deck), intent(in) :: d
    type(body_record), intent(in) :: r
    type(body_model), intent(inout) :: b
    type(fault_list), intent(inout) :: faults
    integer :: of(b%ne), e
    call find_sections(d, r, b, of)
    call check_place(r, b, faults)
    call find_slots(b)
    call find_kinds(r%axial, of, b)
    do e = 1, b%ne
      associate (g => b%elements(e), section => b%layers%sections(of(e)), kind => b%layers%kinds(b%layers%kind(e)))
        g%mass = kind%mass
        g%ea_l = section%stretching/g%length
        g%ei_l = section%bending/g%length
        g%softening = kind%softening
        if (size(section%layers) == 1) g%turn_l = kind%stiffness(size(kind%stiffness))
        g%area = sum(section%layers%area)
        g%second = sum(section%layers%second)
      end associate
    end do
  end subroutine add_layers

  !> The sections of a body, each with the material of those that are of one, and the section of each element.
  subroutine find_sections(d, r, b, of)
    type(deck), intent(in) :: d
    type(body_record), intent(in) :: r
    type(body_model), intent(inout) :: b
    integer, intent(out) :: of(:)            !! (ne) number of the section
    integer, allocatable :: pair(:, :)       ! (2, sections of the body) section and material
    integer :: e, k
    allocate (pair(2, 0))
    do e = 1, b%ne
      do k = 1, size(pair, 2)
        if (all(pair(:, k) == [r%element_section(e), r%element_material(e)])) exit
      end do
      if (k > size(pair, 2)) pair = reshape([pair, r%element_section(e), r%element_material(e)], [2, k])
      of(e) = k
    end do
    allocate (b%layers%sections(size(pair, 2)))
    b%rayleigh = .false.
    do k = 1, size(pair, 2)
      associate (s => d%sections(pair(1, k)), section => b%layers%sections(k))
        call make_section(s, d%materials, pair(2, k), r, section)
        b%layers%shown = b%layers%shown .or. s%shear .or. size(s%layers) > 0
        b%rayleigh = b%rayleigh .or. any(section%layers%ray_m > 0.0_wp .or. section%layers%ray_k > 0.0_wp)
      end associate
    end do
  end subroutine find_sections

  !> The kinds of element, each with one section and one length, and the kind of each element.
  subroutine find_kinds(axial, of, b)
    logical, intent(in) :: axial
    integer, intent(in) :: of(:)             !! (ne) section
    type(body_model), intent(inout) :: b
    integer :: first(b%ne), e, k, n          ! first element of each kind
    allocate (b%layers%kind(b%ne))
    n = 0
    do e = 1, b%ne
      do k = n, 1, -1
        if (of(first(k)) /= of(e)) cycle
        if (abs(b%elements(e)%length - b%elements(first(k))%length) <= same_length*b%elements(e)%length) exit
      end do
      if (k < 1) then
        n = n + 1
        first(n) = e
        k = n
      end if
      b%layers%kind(e) = k
    end do
    allocate (b%layers%kinds(n))
    do k = 1, n
      b%layers%kinds(k) = make_layered_element(b%layers%sections(of(first(k))), of(first(k)), b%elements(first(k))%length, axial)
    end do
  end subroutine find_kinds

  !> Reports sections whose node line is not where the model needs it.
  subroutine check_place(r, b, faults)
    type(body_record), intent(in) :: r
    type(body_model), intent(in) :: b
    type(fault_list), intent(inout) :: faults
    integer :: k
    logical :: bent                          ! elements meet at an angle
    bent = any(hypot(b%elements%c - b%elements(1)%c, b%elements%s - b%elements(1)%s) > half_digits)
    do k = 1, size(b%layers%sections)
      associate (s => b%layers%sections(k))
        associate (low => s%layers(1)%height - 0.5_wp*s%layers(1)%thickness, &
                   high => s%layers(size(s%layers))%height + 0.5_wp*s%layers(size(s%layers))%thickness)
          if (bent .and. abs(low + high) > half_digits*(high - low)) then
            call r%at%blame(faults, 'elements that meet at an angle have sections whose base is not in the middle, so that '// &
                        'layers would not meet there; expected the base layer in the middle, or elements in one direction')
            return
          end if
          if (r%axial .or. .not. r%flexible) cycle
          if (.not. s%stretched()) cycle
          call r%at%blame(faults, 'axial=.false. with cores, or with an axis beside the node line: bending then stretches the '// &
                      'layers; expected axial=.true.')
          return
        end associate
      end associate
    end do
  end subroutine check_place

  !> Gives the cores that lie as many layers above the base one number in the whole body.
  subroutine find_slots(b)
    type(body_model), intent(inout) :: b
    integer, allocatable :: above(:)         ! layers between the base and each core of the body
    integer :: k, l
    allocate (above(0))
    allocate (b%layers%slot(maxval(b%layers%sections%cores), size(b%layers%sections)), source=0)
    do k = 1, size(b%layers%sections)
      associate (s => b%layers%sections(k))
        do l = 1, size(s%layers)
          if (s%layers(l)%core == 0) cycle
          if (.not. any(above == l - s%base)) above = [above, l - s%base]
          b%layers%slot(s%layers(l)%core, k) = findloc(above, l - s%base, 1)
        end do
      end associate
    end do
  end subroutine find_slots

  !> A section of layers, or of one material, which shears or not.
  subroutine make_section(r, materials, material, body, s)
    type(section_record), intent(in) :: r
    type(material_record), intent(in) :: materials(:)
    integer, intent(in) :: material          !! number of that of a section without layers
    type(body_record), intent(in) :: body
    type(layered_section_model), intent(out) :: s
    real(wp) :: factor                       ! [-]
    integer :: l, number
    logical :: layered
    layered = size(r%layers) > 0
    s%shears = r%shear
    if (layered) s%base = r%base
    s%core_stretch = r%core_stretch
    allocate (s%layers(max(1, size(r%layers))))
    number = material
    do l = 1, size(s%layers)
      if (layered) number = r%layers(l) + body%own_materials
      associate (m => materials(number), layer => s%layers(l))
        layer = layer_of(m, number, body)
        layer%thickness = 2*r%fibre
        layer%area = r%area
        layer%second = r%inertia
        if (layered) then
          layer%core = max(0, findloc(r%cores, l, 1))
          layer%thickness = r%thickness(l)
          layer%area = r%width*layer%thickness
          layer%second = r%width*layer%thickness**3/12
        end if
        if (layered .or. r%shear) layer%turning = layer%second
        factor = 1.0_wp
        if (r%shear) factor = r%shear_factor
        if (.not. factor > 0.0_wp) factor = shear_coefficient(trim(r%shape), m%poisson, r%inner/max(r%outer, tiny(1.0_wp)))
        layer%shear = factor*layer%young/(2*(1 + m%poisson))
      end associate
    end do
    call set_up_section(s)
  end subroutine make_section

  !> What a material gives to a layer: E_R, or the storage modulus that a body without terms keeps of it.
  type(section_layer) function layer_of(m, material, body) result(layer)
    type(material_record), intent(in) :: m
    integer, intent(in) :: material          !! its number
    type(body_record), intent(in) :: body
    type(viscoelastic_terms) :: law
    law = law_of(m%law)
    layer%material = material
    layer%follows = body%viscoelastic .and. law%order() > 0
    layer%density = m%density
    layer%young = m%law%stiffer*m%young
    if (.not. body%viscoelastic) layer%young = layer%young*(1 + real(law%ratio(cmplx(0.0_wp, 2*pi*body%modulus_at, wp)), wp))
    layer%ray_m = m%rayleigh_mass
    layer%ray_k = m%law%slower*m%rayleigh_stiffness
  end function layer_of
end module build_layers
