!> Readers of &parameter, &material and &section.
module deck_properties
  use kinds, only: wp, pi
  use expression, only: is_name, is_reserved
  use text, only: to_text, quoted
  use deck_get, only: counted
  use deck_input, only: deck_source
  use deck_parameters, only: parameter_value
  use deck_records, only: parameter_record, material_record, section_record
  use deck_take, only: take
  implicit none (type, external)
  private
  public :: read_parameter, read_material, read_section

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
    if (deck%is_set('shear_modulus')) m%young = 2*(1 + m%poisson)*m%shear_modulus
    m%law%ghm_omega = m%ghm_frequency_scale*m%law%ghm_omega
    m%law%prony_tau = m%law%prony_tau/m%ghm_frequency_scale
    if (deck%is_set('band') .and. .not. (m%band(1) > 0.0_wp .and. m%band(1) < m%band(2))) call deck%complain('band', &
      'band has to be two positive frequencies in Hz, expected the lower one first')
    m%band = m%ghm_frequency_scale*m%band
  end subroutine read_material

  !> &section: area and second moment, or a shape with its sizes.
  subroutine read_section(deck, s)
    class(deck_source), intent(inout) :: deck
    type(section_record), intent(inout) :: s
    call take(deck, s)
    if (deck%is_set('layers')) call check_layers(deck, s)
    if (deck%is_choice('rectangle')) call deck%need('width', 'width > 0'//deck%for_choice())
    if (deck%is_choice('circle tube')) call deck%refuse('width', ' does not apply to shape='//quoted(trim(s%shape))// &
      ', it applies to shape=''rectangle'' and to layers')
    if (s%shear .and. deck%choice_known .and. s%shape == '' .and. .not. deck%is_given('layers')) call deck%need('shear_factor')
    if (deck%is_set('shear_factor') .and. s%shear_factor > 1.0_wp) call deck%refuse('shear_factor', ' of more than the whole '// &
      'area, expected at most 1')
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
  end subroutine read_section

  !> Layers of a section: thicknesses, base and cores.
  subroutine check_layers(deck, s)
    class(deck_source), intent(inout) :: deck
    type(section_record), intent(inout) :: s
    integer :: n
    n = size(s%layers)
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
