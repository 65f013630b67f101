!> Readers of &parameter, &material and &section.
module deck_properties
  use kinds, only: wp, pi
  use expression, only: is_name, is_reserved
  use text, only: to_text, joined, listed, quoted
  use deck_get, only: counted
  use deck_input, only: deck_source
  use deck_parameters, only: parameter_value
  use deck_records, only: law_record, parameter_record, material_record, section_record
  use deck_take, only: take
  use deck_temperature, only: check_shift
  implicit none (type, external)
  private
  public :: read_parameter, read_material, read_section, check_law

  integer, parameter :: most_cores = 4        !! of a section, as `layered_section` has room for

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
    if (.not. deck%is_given('shear_modulus')) call deck%need('young')
    call deck%forbid_both('young', 'shear_modulus', ': one gives the other with poisson')
    if (deck%is_set('shear_modulus')) m%young = 2*(1 + m%poisson)*m%shear_modulus
    call check_law(deck, m%law)
    call check_shift(deck)
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
    if (deck%is_given('layers')) then
      call check_layers(deck, s)
    else if (deck%choice_known .and. s%shape == '') then
      call deck%need('area')
      call deck%need('inertia')
    end if
    call check_width()
    call deck%forbid_both('shape', 'area', ': the sizes of a shape give its area')
    call deck%forbid_both('shape', 'inertia', ': the sizes of a shape give its inertia')
    call deck%check_order('inner', s%inner, 'outer', s%outer)
    if (s%shear .and. deck%choice_known .and. s%shape == '' .and. .not. deck%is_given('layers')) call deck%need('shear_factor')
    if (deck%is_set('shear_factor') .and. .not. s%shear) call deck%complain('shear_factor', 'shear_factor has no effect on a '// &
      'section that does not shear, expected shear=.true.')
    if (s%shape == 'rectangle') then
      s%area = s%width*s%height
      s%inertia = s%width*s%height**3/12.0_wp
      s%fibre = s%height/2.0_wp
    else if (s%shape /= '') then
      s%area = pi/4.0_wp*(s%outer**2 - s%inner**2)
      s%inertia = pi/64.0_wp*(s%outer**4 - s%inner**4)
      s%fibre = s%outer/2.0_wp
    end if
    if (deck%is_given('layers') .and. .not. deck%is_set('layers')) deallocate (s%layers)      ! not known
    if (deck%is_clean()) return
    s%thickness = [real(wp) ::]                      ! of a section with a fault no more is asked than whether it has layers
    s%cores = [integer ::]
  contains
    !> A width is that of a rectangle or of layers.
    subroutine check_width()
      if (deck%is_choice('rectangle')) then
        call deck%need('width', 'width > 0 for shape=''rectangle''')
      else if (deck%is_given('layers')) then
        call deck%need('width', 'width > 0 with layers')
      else if (deck%is_given('width') .and. deck%choice_known) then
        if (s%shape == '') call deck%complain('width', 'width applies to shape=''rectangle'' and to layers only, expected '// &
          'shape or layers to be given')
        if (s%shape /= '') call deck%complain('width', 'width does not apply to shape='//quoted(trim(s%shape))// &
          ', it applies to shape=''rectangle'' and to layers')
      end if
    end subroutine check_width
  end subroutine read_section

  !> Layers of a section: thicknesses, base and cores.
  subroutine check_layers(deck, s)
    class(deck_source), intent(inout) :: deck
    type(section_record), intent(inout) :: s
    character(*), parameter :: of_shape(3) = ['shape  ', 'area   ', 'inertia']
    integer :: n, k
    do k = 1, size(of_shape)
      call deck%forbid_both('layers', trim(of_shape(k)), ': layers have their own areas')
    end do
    call deck%need('thickness', 'a thickness of each layer')
    if (.not. deck%is_set('layers')) return
    n = size(s%layers)
    if (deck%is_set('thickness') .and. size(s%thickness) /= n) call deck%complain('thickness', 'thickness has '// &
      counted(size(s%thickness))//', expected one for each of the '//to_text(n)//' layers')
    if (s%base > n) call deck%complain('base', 'base='//to_text(s%base)//' is no layer, expected 1 to '//to_text(n))
    if (n == 3 .and. .not. deck%is_given('cores') .and. .not. s%shear) s%cores = [2]
    if (n > 3 .and. .not. s%shear) call deck%need('cores', 'the numbers of the layers that shear, between the layers that '// &
      'bend; 0: none')
    if (size(s%cores) == 1 .and. all(s%cores == 0)) s%cores = [integer ::]
    if (size(s%cores) == 0) return
    if (s%shear) call deck%complain('shear', 'shear=.true. with cores: layers that shear by themselves and a section that '// &
      'shears as a whole exclude each other, expected one of both')
    if (any(s%cores < 2 .or. s%cores >= n)) then
      call deck%complain('cores', 'cores lie between two other layers, expected 2 to '//to_text(n - 1))
    else if (any(s%cores(2:) - s%cores(:size(s%cores) - 1) < 2)) then
      call deck%complain('cores', 'cores have to ascend, with a layer between two of them that does not shear, '// &
        'expected such numbers')
    else if (size(s%cores) > most_cores) then
      call deck%complain('cores', 'cores has '//counted(size(s%cores))//', expected at most '//to_text(most_cores))
    end if
  end subroutine check_layers
end module deck_properties
