!> Readers of &parameter, &scene, &material and &section.
module deck_properties
  use kinds, only: wp, pi
  use expression, only: is_name, is_reserved
  use text, only: to_text, joined, listed, quoted
  use deck_input, only: deck_source, required
  use deck_get, only: get, get_list, get_pair
  use deck_parameters, only: parameter_value
  use deck_words, only: get_name, get_choice
  use deck_records, only: law_record, parameter_record, scene_record, material_record, section_record
  implicit none (type, external)
  private
  public :: read_parameter, read_scene, read_material, read_section, read_law

contains

  !> &parameter: its name has to be one that expressions can state.
  subroutine read_parameter(deck, r, p)
    class(deck_source), intent(inout) :: deck
    type(parameter_record), intent(inout) :: r
    type(parameter_value), intent(in) :: p       !! its value
    character(:), allocatable :: name
    call get_name(deck, r)
    call get(deck, 'value', r%value, required)
    r%value = p%value
    r%set = p%source /= p%group
    r%used = p%used
    if (r%name == '') return
    name = deck%peek('name')
    if (is_reserved(name)) then
      call deck%complain('name', 'name='//quoted(name)//' means something else in expressions, expected another name')
    else if (.not. is_name(name)) then
      call deck%complain('name', 'name='//quoted(name)//' cannot stand in expressions, expected a letter, then letters, '// &
        'digits and _')
    end if
  end subroutine read_parameter

  !> &scene
  subroutine read_scene(deck, scene)
    class(deck_source), intent(inout) :: deck
    type(scene_record), intent(inout) :: scene
    scene%at = deck%at()
    call get(deck, 'title', scene%title)
    call get_pair(deck, 'gravity', scene%gravity)
  end subroutine read_scene

  !> &material
  subroutine read_material(deck, m)
    class(deck_source), intent(inout) :: deck
    type(material_record), intent(inout) :: m
    real(wp) :: scale      !! temperature shift: multiplies every omega and 1/tau [-]
    call get_name(deck, m)
    call get(deck, 'density', m%density, required, above=0.0_wp)
    call get(deck, 'young', m%young, required, above=0.0_wp)
    call read_law(deck, m%law)
    scale = 1.0_wp
    call get(deck, 'ghm_frequency_scale', scale, above=0.0_wp)
    if (deck%is_given('ghm_frequency_scale') .and. .not. (deck%is_given('ghm_omega') .or. &
      deck%is_given('prony_tau'))) call deck%complain('ghm_frequency_scale', 'ghm_frequency_scale has no effect on an elastic '// &
      'material, expected ghm_alpha, ghm_zeta and ghm_omega, or prony_alpha and prony_tau')
    m%law%ghm_omega = scale*m%law%ghm_omega
    m%law%prony_tau = m%law%prony_tau/scale
    call get_pair(deck, 'band', m%band)
    if (deck%is_set('band') .and. .not. (m%band(1) > 0.0_wp .and. m%band(1) < m%band(2))) call deck%complain('band', &
      'band has to be two positive frequencies in Hz, expected the lower one first')
    m%band = scale*m%band
    call get(deck, 'rayleigh_mass', m%rayleigh_mass, least=0.0_wp)
    call get(deck, 'rayleigh_stiffness', m%rayleigh_stiffness, least=0.0_wp)
  end subroutine read_material

  !> Viscoelastic terms of a material or a spring.
  subroutine read_law(deck, law)
    class(deck_source), intent(inout) :: deck
    type(law_record), intent(inout) :: law
    call get_list(deck, 'ghm_alpha', law%ghm_alpha, above=0.0_wp)
    call get_list(deck, 'ghm_zeta', law%ghm_zeta, above=0.0_wp)
    call get_list(deck, 'ghm_omega', law%ghm_omega, above=0.0_wp)
    call check_terms(deck, [character(9) :: 'ghm_alpha', 'ghm_zeta', 'ghm_omega'], &
                     [size(law%ghm_alpha), size(law%ghm_zeta), size(law%ghm_omega)])
    call get_list(deck, 'prony_alpha', law%prony_alpha, above=0.0_wp)
    call get_list(deck, 'prony_tau', law%prony_tau, above=0.0_wp)
    call check_terms(deck, [character(11) :: 'prony_alpha', 'prony_tau'], [size(law%prony_alpha), size(law%prony_tau)])
  end subroutine read_law

  !> Checks the lists of one kind of terms: all are given or none, with equal lengths.
  subroutine check_terms(deck, names, lengths)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: names(:)   !! the variables
    integer, intent(in) :: lengths(:)      !! numbers of their values
    logical :: given(size(names)), good(size(names))
    character(12) :: numbers(size(names))
    integer :: k
    given = [(deck%is_given(trim(names(k))), k=1, size(names))]
    good = [(deck%is_set(trim(names(k))), k=1, size(names))]
    do k = 1, size(names)
      numbers(k) = to_text(lengths(k))
      if (any(given) .and. .not. given(k)) call deck%note_missing(trim(names(k)), joined(names, ', ')//' of equal length')
    end do
    if (all(good) .and. any(lengths /= lengths(1))) call deck%complain(trim(names(1)), listed(names, 'and')//' have '// &
      listed(numbers, 'and')//' values, expected equal numbers')
  end subroutine check_terms

  !> &section: area and second moment, or a shape with its sizes.
  subroutine read_section(deck, s)
    class(deck_source), intent(inout) :: deck
    type(section_record), intent(inout) :: s
    character(9) :: shape
    real(wp) :: width, height        !! rectangle [m]
    real(wp) :: outer, inner         !! diameters of circle and tube [m]
    logical :: no_shape
    call get_name(deck, s)
    shape = ''
    width = 0.0_wp
    height = 0.0_wp
    outer = 0.0_wp
    inner = 0.0_wp
    call get_choice(deck, 'shape', shape, [character(9) :: 'rectangle', 'circle', 'tube'])
    no_shape = deck%choice_known .and. shape == ''
    call get(deck, 'width', width, required, above=0.0_wp, kinds='rectangle')
    call get(deck, 'height', height, required, above=0.0_wp, kinds='rectangle')
    call get(deck, 'diameter', outer, required, above=0.0_wp, kinds='circle')
    call get(deck, 'outer', outer, required, above=0.0_wp, kinds='tube')
    call get(deck, 'inner', inner, required, above=0.0_wp, kinds='tube')
    call get(deck, 'area', s%area, no_shape, above=0.0_wp)
    call get(deck, 'inertia', s%inertia, no_shape, above=0.0_wp)
    call deck%forbid_both('shape', 'area', ': the sizes of a shape give its area')
    call deck%forbid_both('shape', 'inertia', ': the sizes of a shape give its inertia')
    call deck%check_order('inner', inner, 'outer', outer)
    if (shape == 'rectangle') then
      s%area = width*height
      s%inertia = width*height**3/12.0_wp
      s%fibre = height/2.0_wp
    else if (shape /= '') then
      s%area = pi/4.0_wp*(outer**2 - inner**2)
      s%inertia = pi/64.0_wp*(outer**4 - inner**4)
      s%fibre = outer/2.0_wp
    end if
  end subroutine read_section
end module deck_properties
