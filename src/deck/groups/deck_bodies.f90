!> Reader of &body.
module deck_bodies
  use kinds, only: wp
  use text, only: to_text, lower
  use deck_input, only: deck_source, required
  use deck_get, only: get, get_list, get_pair, counted
  use deck_words, only: get_name, get_choice, get_word, get_letters, get_references
  use deck_kinds, only: in_material, in_section
  use deck_geometry, only: check_frame, check_reference
  use deck_records, only: body_record
  implicit none (type, external)
  private
  public :: read_body

  character(*), parameter :: elastic = 'beam frame'   !! kinds with nodes and elements
  real(wp), parameter :: most_elements = 1.0e6_wp     !! far beyond what double precision resolves in one beam [-]

  character(*), parameter :: massless = 'a massless crank is a &joint of type ''distance'' with a &force of type '// &
    '''torque_about'', a massless slider a &joint of type ''slider'''

contains

  !> &body. `known`: its kind and its number of nodes could be read.
  subroutine read_body(deck, b, known)
    class(deck_source), intent(inout) :: deck
    type(body_record), intent(inout) :: b
    logical, intent(out) :: known
    call get_name(deck, b)
    if (lower(b%name) == 'ground') call deck%complain('name', 'name='''//trim(b%name)//''' is the name of the fixed body, '// &
      'expected another one')
    b%kind = 'rigid'
    call get_choice(deck, 'kind', b%kind, [character(5) :: 'rigid', 'beam', 'frame'])
    call get_pair(deck, 'position', b%position)
    call get(deck, 'angle', b%angle)
    call get_pair(deck, 'velocity', b%velocity)
    call get(deck, 'angular_velocity', b%angular_velocity)
    b%velocity_stated = deck%is_set('velocity')
    b%angular_velocity_stated = deck%is_set('angular_velocity')
    call get(deck, 'mass', b%mass, required, above=0.0_wp, kinds='rigid', hint=massless)
    call get(deck, 'inertia', b%inertia, required, least=0.0_wp, kinds='rigid')
    call get_pair(deck, 'com', b%com, kinds='rigid')
    call read_elements()
    call read_switches()
    call read_reference()
    known = deck%is_choice('rigid') .or. (deck%is_choice(elastic) .and. b%nodes > 0)
    if (known .and. deck%is_choice(elastic)) call check_reference(deck, b)
  contains
    !> Geometry, materials and sections of a beam or frame.
    subroutine read_elements()
      call get(deck, 'length', b%length, required, above=0.0_wp, kinds='beam')
      call get(deck, 'elements', b%elements, required, 1.0_wp, most_elements, 'beam', b%auto_elements)
      if (b%auto_elements) b%elements = 1     ! until all places on it are known
      call get_list(deck, 'node_x', b%node_x, required, kinds='frame')
      call get_list(deck, 'node_y', b%node_y, required, kinds='frame')
      call read_frame()
      if (deck%is_choice('beam') .and. deck%is_set('elements')) b%nodes = b%elements + 1
      call read_properties('material', in_material, b%element_material, .not. deck%is_given('element_material'))
      call read_properties('section', in_section, b%element_section, .true.)
      call read_properties('element_material', in_material, b%element_material, .false.)
    end subroutine read_elements

    !> Nodes and elements of a frame.
    subroutine read_frame()
      integer, allocatable :: pairs(:)
      call get_list(deck, 'element_nodes', pairs, required, kinds='frame')
      b%element_nodes = reshape(pairs(1:size(pairs)/2*2), [2, size(pairs)/2])
      if (.not. deck%is_choice('frame')) return
      if (deck%is_set('element_nodes')) then
        b%elements = size(pairs)/2
        if (mod(size(pairs), 2) == 1) call deck%complain('element_nodes', 'element_nodes has '// &
          counted(size(pairs))//', expected pairs: the two nodes of each element')
      end if
      call check_frame(deck, b, mod(size(pairs), 2) == 0)
    end subroutine read_frame

    !> Materials or sections of the elements: one for all; one for each element of a frame, or where the variable says so.
    subroutine read_properties(name, kind, numbers, need)
      character(*), intent(in) :: name                   !! `material`, `section` or `element_material`
      integer, intent(in) :: kind                        !! what it names
      integer, allocatable, intent(inout) :: numbers(:)  !! (elements) indices
      logical, intent(in) :: need                        !! whether it is required
      integer, allocatable :: found(:)
      character(:), allocatable :: expected
      logical :: each
      each = name == 'element_material'
      call get_references(deck, name, kind, found, need, elastic)
      if (.not. allocated(numbers)) numbers = spread(0, 1, b%elements)
      if (.not. deck%is_set(name) .or. b%elements == 0) return
      expected = 'one for each of the '//to_text(b%elements)//' elements'
      if (.not. each) expected = '1 or '//expected
      if (deck%is_choice('beam') .and. .not. each) expected = '1 for a beam'
      if (each .and. b%auto_elements) then
        call deck%complain(name, name//' with elements=''auto'', whose elements have no numbers, expected material')
      else if (size(found) == 1 .and. .not. each) then
        numbers = spread(found(1), 1, b%elements)
      else if (size(found) == b%elements .and. (each .or. deck%is_choice('frame'))) then
        numbers = found
      else if (deck%is_choice(elastic)) then
        call deck%complain(name, name//' has '//counted(size(found))//', expected '//expected)
      end if
    end subroutine read_properties

    !> What of a beam or frame is modelled.
    subroutine read_switches()
      call get(deck, 'flexible', b%flexible, kinds=elastic)
      call get(deck, 'viscoelastic', b%viscoelastic, kinds=elastic)
      call get(deck, 'modulus_at', b%modulus_at, least=0.0_wp, kinds=elastic)
      if (deck%is_set('modulus_at') .and. b%viscoelastic) call deck%complain('modulus_at', 'modulus_at is the frequency of '// &
        'the modulus that an elastic body keeps in place of its GHM terms, expected it with viscoelastic=.false.')
      call get(deck, 'axial', b%axial, kinds=elastic)
      call get(deck, 'stiffening', b%stiffening, kinds=elastic)
      call get(deck, 'modes', b%modes, least=0.0_wp, kinds=elastic, auto=b%auto_modes)
      call get(deck, 'static_shapes', b%static_shapes, kinds=elastic)
      if (b%static_shapes .and. .not. reduced() .and. deck%is_known('modes')) call deck%complain('static_shapes', &
        'static_shapes=.true. with nodal coordinates (modes=0), which contain every shape, expected modes > 0')
      if (deck%is_choice('frame') .and. .not. b%axial) call deck%complain('axial', 'axial=.false. does not apply to '// &
        'kind=''frame'': where elements meet at an angle the axial motion of one is the bending of the other, expected '// &
        'axial=.true. or kind=''beam''')
      if (.not. b%stiffening) return
      if (.not. b%axial) call deck%complain('stiffening', 'stiffening=.true. with axial=.false.: the quadratic strain '// &
        'shortens the chord, which needs axial deformation or it locks the beam, expected axial=.true.')
      if (reduced()) call deck%complain('stiffening', 'stiffening=.true. with modes='// &
        deck%written(deck%token(deck%assignment_of('modes'), 1))//': a truncated basis cannot follow the shortening of the '// &
        'chord and the quadratic strain locks the beam, expected modes=0')
    end subroutine read_switches

    !> Whether modes are the coordinates.
    pure logical function reduced() result(yes)
      yes = b%modes > 0 .or. b%auto_modes
    end function reduced

    !> The coordinates that fix the body's frame to its nodes.
    subroutine read_reference()
      call get_word(deck, 'reference', b%reference, [character(7) :: 'pinned', 'clamped', 'free'], kinds=elastic)
      call get_list(deck, 'reference_node', b%reference_node, kinds=elastic)
      call get_letters(deck, 'reference_dof', b%reference_dof, ['u', 'v', 'r'], kinds=elastic)
      if (.not. (deck%is_set('reference') .and. deck%is_known('modes')) .or. reduced()) return
      if (b%reference == 'free') call deck%complain('reference', 'reference=''free'' with nodal coordinates (modes=0): '// &
        'nothing would fix the body''s frame, expected modes > 0')
    end subroutine read_reference
  end subroutine read_body
end module deck_bodies
