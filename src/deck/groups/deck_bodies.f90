!> Reader of &body.
module deck_bodies
  use kinds, only: wp
  use text, only: lower, quoted, to_text
  use deck_input, only: deck_source
  use deck_get, only: counted
  use deck_geometry, only: check_frame, check_reference
  use deck_records, only: body_record, section_record
  use deck_take, only: take
  implicit none (type, external)
  private
  public :: read_body

  character(*), parameter :: elastic = 'beam frame'   !! kinds with nodes and elements
  character(*), parameter :: uncored = ' has no effect on sections without cores, expected sections with layers and cores'

contains

  !> &body. `known`: its kind and its number of nodes could be read.
  subroutine read_body(deck, sections, b, known)
    class(deck_source), intent(inout) :: deck
    type(section_record), intent(in) :: sections(:)
    type(body_record), intent(inout) :: b
    logical, intent(out) :: known
    call take(deck, b)
    if (lower(b%name) == 'ground') call deck%complain('name', 'name='//quoted(trim(b%name))//' is the name of the fixed body, '// &
      'expected another one')
    b%position_given = deck%is_set('position')
    b%velocity_stated = deck%is_set('velocity')
    b%angular_velocity_stated = deck%is_set('angular_velocity')
    call check_frame_elements()
    if (deck%is_choice('beam') .and. deck%is_set('elements')) b%nodes = b%elements + 1
    if (.not. deck%is_given('element_section')) call deck%need('section')
    call spread_over('material', b%material)
    call spread_over('section', b%section)
    call spread_over('element_section', b%element_section)
    if (.not. deck%is_set('element_section')) b%element_section = b%section
    call spread_over('element_material', b%element_material)
    if (.not. deck%is_set('element_material')) b%element_material = b%material
    call check_layers()
    call check_switches()
    known = deck%is_choice('rigid') .or. (deck%is_choice(elastic) .and. b%nodes > 0)
    if (known .and. deck%is_choice(elastic)) call check_reference(deck, b)
  contains
    !> Nodes and elements of a frame.
    subroutine check_frame_elements()
      integer :: n
      n = size(b%pairs)
      b%element_nodes = reshape(b%pairs(1:n/2*2), [2, n/2])
      if (.not. deck%is_choice('frame')) return
      if (deck%is_set('element_nodes')) then
        b%elements = n/2
        if (mod(n, 2) == 1) call deck%complain('element_nodes', 'element_nodes has '//counted(n)// &
          ', expected pairs: the two nodes of each element')
      end if
      call check_frame(deck, b, mod(n, 2) == 0)
    end subroutine check_frame_elements

    !> Materials or sections of the elements: one for all; one for each element of a frame, or where the key says so.
    subroutine spread_over(name, numbers)
      character(*), intent(in) :: name                   !! `material`, `section`, `element_material` or `element_section`
      integer, allocatable, intent(inout) :: numbers(:)  !! indices as given; of each element, 0: not known
      character(:), allocatable :: expected
      integer :: n
      logical :: each, good
      n = size(numbers)
      each = index(name, 'element_') == 1
      good = .true.
      if (deck%is_set(name) .and. b%elements > 0 .and. deck%is_choice(elastic)) then
        expected = 'one for each of the '//to_text(b%elements)//' elements'
        if (.not. each) expected = '1 or '//expected
        if (deck%is_choice('beam') .and. .not. each) expected = '1 for a beam'
        good = (n == 1 .and. .not. each) .or. (n == b%elements .and. (each .or. deck%is_choice('frame')))
        if (.not. good) call deck%complain(name, name//' has '//counted(n)//', expected '//expected)
      end if
      if (n == 1 .and. good) numbers = spread(numbers(1), 1, b%elements)
      if (size(numbers) /= b%elements) numbers = spread(0, 1, b%elements)
    end subroutine spread_over

    !> Sections of layers have their materials; elements of others need one. Layers go on from element to element.
    subroutine check_layers()
      logical :: layered(size(b%element_section))
      integer :: e, first
      if (.not. deck%is_choice(elastic)) return
      if ((deck%is_given('section') .or. deck%is_given('element_section')) .and. any(b%element_section == 0)) return   ! not known
      layered = .false.
      do e = 1, size(layered)
        if (b%element_section(e) == 0) cycle
        if (.not. allocated(sections(b%element_section(e))%layers)) return   ! the section could not be read
        layered(e) = size(sections(b%element_section(e))%layers) > 0
      end do
      if (.not. any(layered)) then
        if (.not. deck%is_given('element_material')) call deck%need('material')
        call deck%refuse('slip_held', uncored)
        return
      end if
      if (.not. all(layered)) call deck%complain('element_section', 'sections with layers beside sections without, expected '// &
        'layers in all sections of the body')
      call deck%refuse('material element_material', ' has no effect where sections have layers, expected it not to be given')
      if (.not. deck%is_clean()) return
      if (any([(size(sections(b%element_section(e))%thickness) == 0, e=1, size(layered))])) return
      if (.not. any([(size(sections(b%element_section(e))%cores) > 0, e=1, size(layered))])) call deck%refuse('slip_held', uncored)
      first = b%element_section(1)
      do e = 1, size(layered)
        associate (s => sections(b%element_section(e)), one => sections(first))
          b%element_material(e) = s%layers(s%base)
          if (s%layers(s%base) == one%layers(one%base) .and. abs(s%thickness(s%base) - one%thickness(one%base)) <= 0.0_wp .and. &
              abs(s%width - one%width) <= 0.0_wp) cycle
        end associate
        call deck%complain('element_section', 'the base layer of element '//to_text(e)//' differs from that of element 1, so '// &
          'that the node line would step, expected base layers of one material, thickness and width')
        return
      end do
      if (any(b%slip_held == 0 .or. b%slip_held < -1 .or. b%slip_held > b%nodes)) call deck%complain('slip_held', 'slip_held '// &
        'names no node, expected 1 to '//to_text(b%nodes)//', or -1 (the last)')
      where (b%slip_held == -1) b%slip_held = b%nodes
    end subroutine check_layers

    !> What of a beam or frame is modelled.
    subroutine check_switches()
      if (b%viscoelastic) call deck%refuse('modulus_at', ' is the frequency of the modulus that an elastic body keeps in place '// &
        'of its GHM terms, expected it with viscoelastic=.false.')
      if (b%static_shapes .and. .not. reduced() .and. deck%is_known('modes')) call deck%complain('static_shapes', &
        'static_shapes=.true. with nodal coordinates (modes=0), which contain every shape, expected modes > 0')
      if (deck%is_choice('frame') .and. .not. b%axial) call deck%complain('axial', 'axial=.false. does not apply to '// &
        'kind=''frame'': where elements meet at an angle the axial motion of one is the bending of the other, expected '// &
        'axial=.true. or kind=''beam''')
      if (deck%is_set('reference') .and. b%reference == 'free' .and. deck%is_known('modes') .and. .not. reduced()) call &
        deck%complain('reference', 'reference=''free'' with nodal coordinates (modes=0): nothing would fix the body''s frame, '// &
        'expected modes > 0')
      if (.not. b%stiffening) return
      if (.not. b%axial) call deck%complain('stiffening', 'stiffening=.true. with axial=.false.: the quadratic strain '// &
        'shortens the chord, which needs axial deformation or it locks the beam, expected axial=.true.')
      if (reduced()) call deck%complain('stiffening', 'stiffening=.true. with modes='// &
        deck%written(deck%token(deck%assignment_of('modes'), 1))//': a truncated basis cannot follow the shortening of the '// &
        'chord and the quadratic strain locks the beam, expected modes=0')
    end subroutine check_switches

    !> Whether modes are the coordinates.
    pure logical function reduced() result(yes)
      yes = b%modes > 0 .or. b%auto_modes
    end function reduced
  end subroutine read_body
end module deck_bodies
