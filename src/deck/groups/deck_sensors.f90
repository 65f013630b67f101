!> Reader of &sensor.
module deck_sensors
  use kinds, only: wp
  use text, only: either, lower, quoted, to_text
  use deck_input, only: deck_source
  use deck_marker, only: check_marker, forbid_ground, body_text
  use deck_records, only: deck_record => deck, body_record, sensor_record
  use deck_take, only: take
  implicit none (type, external)
  private
  public :: read_sensor

  character(*), parameter :: angles = 'angle angular_velocity angular_acceleration'
  character(*), parameter :: elastic = 'deflection coordinate internal stress layer slip'
  character(12), parameter :: columns(4) = [character(12) :: 't', 'load', 'residual', 'newton_steps']   ! of no sensor

contains

  !> &sensor
  subroutine read_sensor(deck, d, s)
    class(deck_source), intent(inout) :: deck
    type(deck_record), intent(in) :: d            !! its bodies are read
    type(sensor_record), intent(inout) :: s
    call take(deck, s%sensor_values)
    call check_marker(deck, d, '', s%marker, frames=angles)
    call forbid_ground(deck, 'body', s%marker%body, 'does not move')
    call check_marker(deck, d, '_b', s%other, frames=angles)
    if (deck%is_choice(angles//' distance power work') .and. any(lower(s%name) == columns)) call deck%complain('name', &
      'name='''//trim(s%name)//''' is that of another column of the results, expected another one')
    call check_contact()
    call check_friction()
    call check_elastic()
  contains
    !> A contact is that of a pair; its pressure needs two numbers, and a follower that is round or flat.
    subroutine check_contact()
      character(:), allocatable :: other
      logical :: edge
      if (.not. deck%is_choice('contact')) return
      other = ''
      edge = .false.
      if (s%joint > 0 .and. deck%is_set('joint')) then
        if (d%joints(s%joint)%type /= 'profile') other = 'joint'
        edge = .not. (d%joints(s%joint)%radius > 0.0_wp .or. d%joints(s%joint)%face < huge(1.0_wp))
      else if (s%stop > 0 .and. deck%is_set('stop')) then
        if (d%stops(s%stop)%type /= 'profile') other = 'stop'
        edge = .not. (d%stops(s%stop)%radius > 0.0_wp .or. d%stops(s%stop)%face < huge(1.0_wp))
      end if
      if (len(other) > 0) call deck%complain(other, 'its '//other//' is not of type=''profile'', expected one that is')
      if (edge .and. len(other) == 0) call deck%refuse('modulus', ' of an edge (radius=0), which has no pressure by Hertz, '// &
        'expected a follower with radius or face')
    end subroutine check_contact

    !> Friction is that of a joint or stop that has some.
    subroutine check_friction()
      if (.not. deck%is_choice('friction')) return
      if (deck%is_set('joint') .and. s%joint > 0) then
        associate (j => d%joints(s%joint))
          if (max(j%friction, j%friction_static, j%preload, j%preload_static) > 0.0_wp) return
          call deck%complain('joint', 'joint "'//trim(j%name)//'" has no friction, expected a joint with friction or preload '// &
                             'above 0')
        end associate
      else if (deck%is_set('stop') .and. s%stop > 0) then
        associate (x => d%stops(s%stop))
          if (max(x%friction, x%friction_static) > 0.0_wp) return
          call deck%complain('stop', 'stop "'//trim(x%name)//'" has no friction, expected a stop with friction above 0')
        end associate
      end if
    end subroutine check_friction

    !> Elastic quantities are those of beams and frames; the element must exist.
    subroutine check_elastic()
      character(:), allocatable :: what
      if (.not. ((deck%is_choice(elastic) .or. deck%is_set('layer')) .and. deck%is_set('body')) .or. s%marker%body == 0) return
      if (.not. deck%body_known(s%marker%body)) return
      what = 'quantity='//quoted(trim(s%quantity))//either(' of a layer', '', deck%is_choice('energy'))
      associate (b => d%bodies(s%marker%body))
        if (b%kind == 'rigid') then
          if (.not. deck%is_set('node')) call deck%complain('body', what//' does not apply to '// &
            body_text(d, s%marker%body)//', expected a beam or frame')
        else if (.not. b%flexible .and. .not. (deck%is_choice('deflection') .or. &
                                               deck%is_choice('internal stress') .and. b%kind == 'beam')) then
          call deck%complain('body', what//' does not apply to '//body_text(d, s%marker%body)//' with flexible=.false., '// &
            'which is rigid, expected flexible=.true.')
        else if (s%quantity == 'stress' .and. size(b%element_section) > 0 .and. &
                 .not. any(d%sections(pack(b%element_section, b%element_section > 0))%fibre > 0.0_wp)) then
          call deck%complain('body', 'no section of '//body_text(d, s%marker%body)//' has a shape, which a stress needs, '// &
            'expected a &section with a shape')
        else if (deck%is_choice('layer energy') .and. .not. sections_read(d, b)) then
          return
        else if (deck%is_set('element') .and. s%element > b%elements) then
          call deck%complain('element', 'element='//to_text(s%element)//' is out of range for '// &
            body_text(d, s%marker%body)//', expected 1 to '//to_text(b%elements))
        else if (deck%is_choice('energy')) then
          call check_layer(b, 1, b%elements, body_text(d, s%marker%body))
        else if (deck%is_set('layer') .and. deck%is_set('element')) then
          call check_layer(b, s%element, s%element, 'element '//to_text(s%element))
        end if
        if (deck%is_choice('slip') .and. .not. deck%is_given('node')) call deck%need('node')
      end associate
    end subroutine check_elastic

    !> A layer of one of some elements; where energies of modes are asked for, no other layer shares its viscoelastic material.
    subroutine check_layer(b, first, last, of)
      type(body_record), intent(in) :: b
      integer, intent(in) :: first, last
      character(*), intent(in) :: of              !! the elements, in words
      integer :: e, l, layers, material(last - first + 1)
      layers = 0
      material = 0
      do e = first, last
        associate (list => d%sections(b%element_section(e))%layers)
          layers = max(layers, size(list))
          if (size(list) >= s%layer) material(e - first + 1) = list(max(s%layer, 1))
        end associate
      end do
      if (layers == 0) call deck%complain('body', body_text(d, s%marker%body)//' has no layers, expected a body whose sections '// &
        'have layers')
      if (layers > 0 .and. s%layer > layers) call deck%complain('layer', 'layer='//to_text(s%layer)//' is out of range for '// &
        of//', expected 1 to '//to_text(layers))
      if (layers == 1 .and. deck%is_choice('energy')) call deck%complain('layer', body_text(d, s%marker%body)// &
        ' has one layer, whose energy is that of the body, expected no layer')
      if (.not. (deck%is_choice('energy') .and. b%viscoelastic .and. (b%modes > 0 .or. b%auto_modes))) return
      do e = first, last
        associate (list => d%sections(b%element_section(e))%layers)
          do l = 1, size(list)
            if (l == s%layer .or. list(l) == 0 .or. .not. any(material == list(l))) cycle
            associate (m => d%materials(list(l)))
              if (size(m%law%ghm_alpha) + size(m%law%prony_alpha) == 0) cycle
              call deck%complain('layer', 'layers '//to_text(s%layer)//' and '//to_text(l)//' of '//of//' are of material '// &
                quoted(trim(m%name))//', whose energy in modes is one, expected no modes, or a material for each layer')
              return
            end associate
          end do
        end associate
      end do
    end subroutine check_layer
  end subroutine read_sensor

  !> Whether the sections of all elements are there and could be read.
  pure logical function sections_read(d, b)
    type(deck_record), intent(in) :: d
    type(body_record), intent(in) :: b
    integer :: e
    sections_read = all(b%element_section > 0)
    if (sections_read) sections_read = all([(allocated(d%sections(b%element_section(e))%layers), e=1, b%elements)])
  end function sections_read
end module deck_sensors
