!> Readers of &lump, &joint, &drive, &spring, &force and &stop: what sits on bodies, between them or acts on them.
module deck_joints
  use kinds, only: wp
  use text, only: to_text
  use deck_input, only: deck_source, required
  use deck_get, only: get, get_pair
  use deck_words, only: get_name, get_choice, get_column, get_reference, get_word
  use deck_kinds, only: in_controller, in_history
  use deck_marker, only: read_marker, forbid_ground, forbid_rigid_pair
  use deck_properties, only: read_law
  use deck_records, only: deck_record => deck, lump_record, joint_record, drive_record, spring_record, force_record, &
    stop_record
  implicit none (type, external)
  private
  public :: read_lump, read_joint, read_drive, read_spring, read_force, read_stop

  character(*), parameter :: pins = 'revolute weld slider prismatic distance'   !! joints between points

contains

  !> &lump
  subroutine read_lump(deck, d, l)
    class(deck_source), intent(inout) :: deck
    type(deck_record), intent(in) :: d            !! its bodies are read
    type(lump_record), intent(inout) :: l
    l%at = deck%at()
    call read_marker(deck, d, '', l%marker, required)
    call forbid_ground(deck, 'body', l%marker%body, 'does not move, a mass on it has no effect')
    call get(deck, 'mass', l%mass, least=0.0_wp)
    call get(deck, 'inertia', l%inertia, least=0.0_wp)
  end subroutine read_lump

  !> &joint
  subroutine read_joint(deck, d, j)
    class(deck_source), intent(inout) :: deck
    type(deck_record), intent(in) :: d            !! its bodies are read
    type(joint_record), intent(inout) :: j
    call get_name(deck, j)
    call get_choice(deck, 'type', j%type, [character(9) :: 'revolute', 'weld', 'slider', 'prismatic', 'distance', 'gear'], &
      required)
    call read_marker(deck, d, '_a', j%a, required, point_kinds=pins, frame_kinds='gear')
    call read_marker(deck, d, '_b', j%b, .not. required, point_kinds=pins, frame_kinds='gear')
    call read_marker(deck, d, '_c', j%c, .not. required, body_kinds='gear', node_kinds='gear', point_kinds='', frame_kinds='gear')
    call get(deck, 'direction', j%direction, kinds='slider prismatic')
    call get(deck, 'length', j%length, above=0.0_wp, kinds='distance')
    j%has_length = deck%is_set('length')
    call get(deck, 'ratio', j%ratio, required, kinds='gear')
    if (deck%is_set('ratio') .and. .not. abs(j%ratio) > 0.0_wp) call deck%complain('ratio', 'ratio=0 holds section a and '// &
      'moves nothing, expected turns of a for one of b, not 0')
    call read_friction(deck, j)
    call forbid_rigid_pair(deck, d, j%a, j%b, 'a', 'b')
    if (.not. deck%is_choice('gear')) return
    call forbid_rigid_pair(deck, d, j%a, j%c, 'a', 'c')
    call forbid_rigid_pair(deck, d, j%b, j%c, 'b', 'c')
  end subroutine read_joint

  !> Dry friction of &joint.
  subroutine read_friction(deck, j)
    class(deck_source), intent(inout) :: deck
    type(joint_record), intent(inout) :: j
    character(*), parameter :: sliding = 'revolute slider prismatic'
    call get(deck, 'friction', j%friction, least=0.0_wp, most=10.0_wp, kinds=sliding)
    call get(deck, 'friction_static', j%friction_static, least=0.0_wp, most=10.0_wp, kinds=sliding)
    call get(deck, 'preload', j%preload, least=0.0_wp, kinds=sliding)
    call get(deck, 'pin_radius', j%pin_radius, above=0.0_wp, kinds='revolute')
    call get(deck, 'pad_distance', j%pad_distance, least=0.0_wp, kinds='prismatic')
    if (deck%is_set('friction_static') .and. j%friction_static < j%friction) call deck%complain('friction_static', &
      'friction_static='//to_text(j%friction_static)//' is below friction='//to_text(j%friction)//', expected not less: '// &
      'surfaces that stick hold at least as much as surfaces that slip')
    if (.not. deck%is_choice('revolute') .or. deck%is_given('pin_radius')) return
    if (max(j%friction, j%friction_static) > 0.0_wp) call deck%note_missing('pin_radius', 'pin_radius > 0 (m), the arm of the '// &
      'friction of a revolute joint')
  end subroutine read_friction

  !> &drive
  subroutine read_drive(deck, d, r)
    class(deck_source), intent(inout) :: deck
    type(deck_record), intent(in) :: d            !! its bodies and histories are read
    type(drive_record), intent(inout) :: r
    call get_name(deck, r)
    r%type = 'rotation'
    call get_choice(deck, 'type', r%type, [character(8) :: 'rotation', 'position'])
    call read_marker(deck, d, '_a', r%a, required, point_kinds='position', frame_kinds='rotation')
    call read_marker(deck, d, '_b', r%b, .not. required, point_kinds='position', frame_kinds='rotation')
    call get(deck, 'direction', r%direction, kinds='position')
    call get_reference(deck, 'history', in_history, r%history, required)
    call get(deck, 'rate', r%rate)
    call get(deck, 'relative', r%relative)
    call forbid_rigid_pair(deck, d, r%a, r%b, 'a', 'b')
  end subroutine read_drive

  !> &spring
  subroutine read_spring(deck, d, s)
    class(deck_source), intent(inout) :: deck
    type(deck_record), intent(in) :: d            !! its bodies are read
    type(spring_record), intent(inout) :: s
    call get_name(deck, s)
    s%type = 'linear'
    call get_choice(deck, 'type', s%type, [character(9) :: 'linear', 'torsional'])
    call read_marker(deck, d, '_a', s%a, required, point_kinds='linear', frame_kinds='torsional')
    call read_marker(deck, d, '_b', s%b, .not. required, point_kinds='linear', frame_kinds='torsional')
    call get_reference(deck, 'characteristic', in_history, s%characteristic)
    call get(deck, 'stiffness', s%stiffness, .not. deck%is_given('characteristic'), least=0.0_wp)
    call deck%forbid_both('stiffness', 'characteristic', ': a characteristic is the force over the deformation')
    call get(deck, 'damping', s%damping, least=0.0_wp)
    call get(deck, 'free_length', s%free, least=0.0_wp, kinds='linear')
    call get(deck, 'free_angle', s%free, kinds='torsional')
    s%has_free = deck%is_set('free_length') .or. deck%is_set('free_angle')
    call read_law(deck, s%law)
    if (deck%is_given('characteristic') .and. size(s%law%ghm_alpha) + size(s%law%prony_alpha) > 0) call deck%complain( &
      'characteristic', 'GHM and Maxwell terms follow a constant stiffness and do not go with a characteristic, expected them '// &
      'in a second spring between the same markers')
    call forbid_rigid_pair(deck, d, s%a, s%b, 'a', 'b')
  end subroutine read_spring

  !> &force
  subroutine read_force(deck, d, f)
    class(deck_source), intent(inout) :: deck
    type(deck_record), intent(in) :: d            !! its bodies and histories are read
    type(force_record), intent(inout) :: f
    call get_name(deck, f)
    f%type = 'force'
    call get_choice(deck, 'type', f%type, [character(12) :: 'force', 'torque', 'torque_about'])
    call read_marker(deck, d, '', f%marker, required, point_kinds='force torque_about', frame_kinds='torque')
    call forbid_ground(deck, 'body', f%marker%body, 'does not move, no load acts on it')
    call get(deck, 'fx', f%fx, kinds='force')
    call get(deck, 'fy', f%fy, kinds='force')
    call get_word(deck, 'axes', f%axes, [character(7) :: 'global', 'body', 'section'], kinds='force')
    call get(deck, 'moment', f%moment, required, kinds='torque torque_about')
    call get_pair(deck, 'centre', f%centre, required, kinds='torque_about')
    call get_reference(deck, 'history', in_history, f%history, deck%is_given('argument') .and. .not. deck%is_given('controller'))
    call get_column(deck, 'argument', f%argument%sensor, f%argument%suffix)
    call get_reference(deck, 'controller', in_controller, f%controller)
    call deck%forbid_both('argument', 'controller', ': the &controller has an argument of its own')
    call deck%forbid_both('history', 'controller', '')
    call get_word(deck, 'stage', f%stage, [character(9) :: 'all', 'static', 'transient'])
  end subroutine read_force

  !> &stop
  subroutine read_stop(deck, d, s)
    class(deck_source), intent(inout) :: deck
    type(deck_record), intent(in) :: d            !! its bodies are read
    type(stop_record), intent(inout) :: s
    call get_name(deck, s)
    call get_choice(deck, 'type', s%type, [character(9) :: 'rotation', 'position', 'clearance'], required)
    call read_marker(deck, d, '_a', s%a, required, point_kinds='position clearance', frame_kinds='rotation')
    call read_marker(deck, d, '_b', s%b, .not. required, point_kinds='position clearance', frame_kinds='rotation')
    call get(deck, 'direction', s%direction, kinds='position')
    call get(deck, 'lower', s%lower, kinds='rotation position')
    call get(deck, 'upper', s%upper, kinds='rotation position')
    call get(deck, 'gap', s%upper, required, above=0.0_wp, kinds='clearance')
    call get(deck, 'stiffness', s%stiffness, above=0.0_wp, hint='without stiffness and with restitution a stop is rigid')
    s%rigid = deck%is_given('restitution') .and. .not. (deck%is_given('stiffness') .or. deck%is_given('damping'))
    if (.not. (deck%is_given('stiffness') .or. s%rigid)) call deck%note_missing('stiffness', 'stiffness > 0 (N/m^n or '// &
      'Nm/rad^n), or restitution alone: a rigid stop')
    call get(deck, 'exponent', s%exponent, least=1.0_wp, most=3.0_wp)
    call get(deck, 'damping', s%damping, least=0.0_wp)
    call get(deck, 'restitution', s%restitution, least=merge(0.0_wp, 0.05_wp, s%rigid), most=1.0_wp)
    call deck%forbid_both('damping', 'restitution', ': a restitution sets the damping')
    if (s%rigid) then
      call forbid_flexible(deck, d, s)
      if (deck%is_given('exponent')) call deck%complain('exponent', 'exponent belongs to a stop with stiffness, expected '// &
        'stiffness > 0, or restitution alone: a rigid stop')
    end if
    if (deck%is_choice('rotation position') .and. .not. (deck%is_given('lower') .or. deck%is_given('upper'))) call &
      deck%note_missing('upper', 'lower, upper or both')
    call deck%check_order('lower', s%lower, 'upper', s%upper)
    call forbid_rigid_pair(deck, d, s%a, s%b, 'a', 'b')
  end subroutine read_stop

  !> A rigid stop meets rigid bodies alone: how a flexible one rebounds depends on its mesh.
  subroutine forbid_flexible(deck, d, s)
    class(deck_source), intent(inout) :: deck
    type(deck_record), intent(in) :: d            !! its bodies are read
    type(stop_record), intent(in) :: s
    integer :: k, bodies(2)
    bodies = [s%a%body, s%b%body]
    do k = 1, merge(2, 1, bodies(1) /= bodies(2))
      if (bodies(k) == 0) cycle
      if (.not. deck%body_known(bodies(k))) cycle
      if (d%bodies(bodies(k))%kind /= 'rigid' .and. d%bodies(bodies(k))%flexible) call deck%complain('restitution', 'body '''// &
        trim(d%bodies(bodies(k))%name)//''' is flexible, and how it rebounds from a rigid stop depends on its mesh; expected '// &
        'stiffness beside restitution')
    end do
  end subroutine forbid_flexible
end module deck_joints
