!> Readers of &parameter, &material and &section.
module deck_properties
  use kinds, only: wp, pi
  use expression, only: is_name, is_reserved
  use text, only: to_text, joined, listed, quoted
  use deck_input, only: deck_source
  use deck_parameters, only: parameter_value
  use deck_records, only: law_record, parameter_record, material_record, section_record
  use deck_take, only: take
  implicit none (type, external)
  private
  public :: read_parameter, read_material, read_section, check_law

contains

  !> &parameter: its name has to be one that expressions can state.
  subroutine read_parameter(deck, r, p)
    class(deck_source), intent(inout) :: deck
    type(parameter_record), intent(inout) :: r
    type(parameter_value), intent(in) :: p       !! its value
    character(:), allocatable :: name
    call take(deck, r)
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

  !> &material
  subroutine read_material(deck, m)
    class(deck_source), intent(inout) :: deck
    type(material_record), intent(inout) :: m
    call take(deck, m)
    call check_law(deck, m%law)
    if (deck%is_given('ghm_frequency_scale') .and. .not. (deck%is_given('ghm_omega') .or. &
      deck%is_given('prony_tau'))) call deck%complain('ghm_frequency_scale', 'ghm_frequency_scale has no effect on an elastic '// &
      'material, expected ghm_alpha, ghm_zeta and ghm_omega, or prony_alpha and prony_tau')
    m%law%ghm_omega = m%ghm_frequency_scale*m%law%ghm_omega
    m%law%prony_tau = m%law%prony_tau/m%ghm_frequency_scale
    if (deck%is_set('band') .and. .not. (m%band(1) > 0.0_wp .and. m%band(1) < m%band(2))) call deck%complain('band', &
      'band has to be two positive frequencies in Hz, expected the lower one first')
    m%band = m%ghm_frequency_scale*m%band
  end subroutine read_material

  !> Viscoelastic terms of a material or a spring.
  subroutine check_law(deck, law)
    class(deck_source), intent(inout) :: deck
    type(law_record), intent(in) :: law
    call check_terms(deck, [character(9) :: 'ghm_alpha', 'ghm_zeta', 'ghm_omega'], &
                     [size(law%ghm_alpha), size(law%ghm_zeta), size(law%ghm_omega)])
    call check_terms(deck, [character(11) :: 'prony_alpha', 'prony_tau'], [size(law%prony_alpha), size(law%prony_tau)])
  end subroutine check_law

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
      if (any(given)) call deck%need(trim(names(k)), joined(names, ', ')//' of equal length')
    end do
    if (all(good) .and. any(lengths /= lengths(1))) call deck%complain(trim(names(1)), listed(names, 'and')//' have '// &
      listed(numbers, 'and')//' values, expected equal numbers')
  end subroutine check_terms

  !> &section: area and second moment, or a shape with its sizes.
  subroutine read_section(deck, s)
    class(deck_source), intent(inout) :: deck
    type(section_record), intent(inout) :: s
    call take(deck, s)
    if (deck%choice_known .and. s%shape == '') then
      call deck%need('area')
      call deck%need('inertia')
    end if
    call deck%forbid_both('shape', 'area', ': the sizes of a shape give its area')
    call deck%forbid_both('shape', 'inertia', ': the sizes of a shape give its inertia')
    call deck%check_order('inner', s%inner, 'outer', s%outer)
    if (s%shape == 'rectangle') then
      s%area = s%width*s%height
      s%inertia = s%width*s%height**3/12.0_wp
      s%fibre = s%height/2.0_wp
    else if (s%shape /= '') then
      s%area = pi/4.0_wp*(s%outer**2 - s%inner**2)
      s%inertia = pi/64.0_wp*(s%outer**4 - s%inner**4)
      s%fibre = s%outer/2.0_wp
    end if
  end subroutine read_section
end module deck_properties
