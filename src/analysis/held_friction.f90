!> Friction of joints in small motions about a state: joints that stick there are fixed, those that slide are under a
!> constant force. `friction='free'` leaves it out.
module held_friction
  use friction_law, only: row_stuck, sliding
  use kinds, only: wp
  use scene_run, only: run_state
  use summary_text, only: summary_record
  use text, only: in_quotes
  implicit none (type, external)
  private
  public :: tell_friction

contains

  !> Says which joints are held, which slide, and which rigid stops are closed.
  subroutine tell_friction(run, text)
    type(run_state), intent(in) :: run
    type(summary_record), intent(inout) :: text
    character(32), allocatable :: names(:)
    logical, allocatable :: held(:), slides(:)
    integer :: k
    associate (s => run%sys%m%s, laws => run%sys%m%s%friction, states => run%sys%ev%switches%state)
      associate (rows => s%constraints(size(s%constraints) - s%stop_rows + 1:))
        names = [(rows(k)%item%name, k=1, size(rows))]
        held = [(rows(k)%item%holds(states(rows(k)%item%switch_number)), k=1, size(rows))]
      end associate
      call tell('  rigid stops that are closed:', 'closed_stops', held)
      names = [(s%constraints(s%permanent + k)%item%name, k=1, size(laws))]
      held = states(laws%number) == row_stuck
      slides = sliding(states(laws%number)) /= 0
    end associate
    call tell('  joints held by their friction:', 'held_by_friction', held)
    call tell('  joints that slide, with the friction of this state as a constant force:', 'constant_friction', slides)
    call tell('  joints that move without their friction:', 'without_friction', .not. (held .or. slides))
  contains
    !> A line where there are any.
    subroutine tell(sentence, name, chosen)
      character(*), intent(in) :: sentence, name
      logical, intent(in) :: chosen(:)             !! (names)
      if (any(chosen)) call text%line(sentence//'{'//name//'='//in_quotes(pack(names, chosen))//'}')
    end subroutine tell
  end subroutine tell_friction
end module held_friction
