!> Reader of &force.
module deck_loads
  use deck_input, only: deck_source, required
  use deck_get, only: get, get_pair
  use deck_words, only: get_name, get_choice, get_word, get_reference
  use deck_kinds, only: in_history
  use deck_marker, only: read_marker, forbid_ground
  use deck_records, only: deck_record => deck, force_record
  implicit none (type, external)
  private
  public :: read_force

contains

  !> &force
  subroutine read_force(deck, d, f)
    class(deck_source), intent(inout) :: deck
    type(deck_record), intent(in) :: d            !! its bodies and histories are read
    type(force_record), intent(inout) :: f
    f%at = deck%at()
    call get_name(deck, f%name)
    f%type = 'force'
    call get_choice(deck, 'type', f%type, [character(12) :: 'force', 'torque', 'torque_about'])
    call read_marker(deck, d, '', f%marker, required, point_kinds='force torque_about', frame_kinds='torque')
    call forbid_ground(deck, 'body', f%marker%body, 'does not move, no load acts on it')
    call get(deck, 'fx', f%fx, kinds='force')
    call get(deck, 'fy', f%fy, kinds='force')
    call get_word(deck, 'axes', f%axes, [character(7) :: 'global', 'body', 'section'], kinds='force')
    call get(deck, 'moment', f%moment, required, kinds='torque torque_about')
    call get_pair(deck, 'centre', f%centre, required, kinds='torque_about')
    call get_reference(deck, 'history', in_history, f%history)
    call get_word(deck, 'stage', f%stage, [character(9) :: 'all', 'static', 'transient'])
  end subroutine read_force
end module deck_loads
