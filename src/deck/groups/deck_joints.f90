!> Readers of &lump, &joint, &drive, &spring, &force and &stop: what sits on bodies, between them or acts on them.
module deck_joints
  use kinds, only: wp
  use text, only: to_text
  use deck_input, only: deck_source
  use deck_marker, only: check_marker, forbid_ground, forbid_rigid_pair
  use deck_profiles, only: check_follower
  use deck_records, only: deck_record => deck, lump_record, joint_record, drive_record, spring_record, force_record, &
    stop_record
  use deck_take, only: take
  implicit none (type, external)
  private
  public :: read_lump, read_joint, read_drive, read_spring, read_force, read_stop

  real(wp), parameter :: least_restitution = 0.05_wp   !! of a stop with stiffness: the damping grows without limit below [-]
  character(*), parameter :: pin = 'pin_radius > 0 (m), the arm of the friction of '

contains

  !> &lump
  subroutine read_lump(deck, d, l)
    class(deck_source), intent(inout) :: deck
    type(deck_record), intent(in) :: d            !! its bodies are read
    type(lump_record), intent(inout) :: l
    call take(deck, l)
    call check_marker(deck, d, '', l%marker)
    call forbid_ground(deck, 'body', l%marker%body, 'does not move, a mass on it has no effect')
  end subroutine read_lump

  !> &joint
  subroutine read_joint(deck, d, j)
    class(deck_source), intent(inout) :: deck
    type(deck_record), intent(in) :: d            !! its bodies are read
    type(joint_record), intent(inout) :: j
    call take(deck, j)
    call check_marker(deck, d, '_a', j%a, frames='gear')
    call check_marker(deck, d, '_b', j%b, frames='gear')
    call check_marker(deck, d, '_c', j%c, frames='gear')
    if (deck%is_set('ratio') .and. .not. abs(j%ratio) > 0.0_wp) call deck%complain('ratio', 'ratio=0 holds section a and '// &
      'moves nothing, expected turns of a for one of b, not 0')
    if (max(j%friction, j%friction_static) > 0.0_wp) call deck%need('pin_radius', pin//'a revolute joint')
    call check_follower(deck, d, j%profile, j%radius)
    call forbid_rigid_pair(deck, d, j%a, j%b, 'a', 'b')
    if (.not. deck%is_choice('gear')) return
    call forbid_rigid_pair(deck, d, j%a, j%c, 'a', 'c')
    call forbid_rigid_pair(deck, d, j%b, j%c, 'b', 'c')
  end subroutine read_joint

  !> &drive
  subroutine read_drive(deck, d, r)
    class(deck_source), intent(inout) :: deck
    type(deck_record), intent(in) :: d            !! its bodies and histories are read
    type(drive_record), intent(inout) :: r
    call take(deck, r)
    call check_marker(deck, d, '_a', r%a, frames='rotation')
    call check_marker(deck, d, '_b', r%b, frames='rotation')
    call forbid_rigid_pair(deck, d, r%a, r%b, 'a', 'b')
  end subroutine read_drive

  !> &spring
  subroutine read_spring(deck, d, s)
    class(deck_source), intent(inout) :: deck
    type(deck_record), intent(in) :: d            !! its bodies are read
    type(spring_record), intent(inout) :: s
    call take(deck, s)
    call check_marker(deck, d, '_a', s%a, frames='torsional')
    call check_marker(deck, d, '_b', s%b, frames='torsional')
    call forbid_rigid_pair(deck, d, s%a, s%b, 'a', 'b')
  end subroutine read_spring

  !> &force
  subroutine read_force(deck, d, f)
    class(deck_source), intent(inout) :: deck
    type(deck_record), intent(in) :: d            !! its bodies and histories are read
    type(force_record), intent(inout) :: f
    call take(deck, f)
    call check_marker(deck, d, '', f%marker, frames='torque')
    call forbid_ground(deck, 'body', f%marker%body, 'does not move, no load acts on it')
  end subroutine read_force

  !> &stop
  subroutine read_stop(deck, d, s)
    class(deck_source), intent(inout) :: deck
    type(deck_record), intent(in) :: d            !! its bodies are read
    type(stop_record), intent(inout) :: s
    call take(deck, s)
    call check_marker(deck, d, '_a', s%a, frames='rotation')
    call check_marker(deck, d, '_b', s%b, frames='rotation')
    s%rigid = deck%is_given('restitution') .and. .not. (deck%is_given('stiffness') .or. deck%is_given('damping'))
    if (deck%is_set('restitution') .and. .not. s%rigid .and. s%restitution < least_restitution) call deck%complain('restitution', &
      'restitution='//to_text(s%restitution)//' is out of range, expected restitution from '//to_text(least_restitution)// &
      ' to 1, or no stiffness: a rigid stop')
    if (s%rigid) call forbid_flexible(deck, d, s)
    if (s%rigid .and. max(s%friction, s%friction_static) > 0.0_wp) call deck%complain('friction', &
      'friction beside a rigid stop is not there, as impacts with friction have no one law; expected stiffness > 0 beside it')
    if (max(s%friction, s%friction_static) > 0.0_wp) call deck%need('pin_radius', pin//'a pin in its hole')
    call check_follower(deck, d, s%profile, s%radius)
    if (s%profile > 0) s%lower = 0.0_wp
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
