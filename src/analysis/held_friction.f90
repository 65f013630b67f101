!> Friction of joints in small motions about a state: joints that stick there are fixed, those that slide are under a
!> constant force. `friction='free'` leaves it out.
module held_friction
  use friction_law, only: row_stuck
  use kinds, only: wp
  use scene_run, only: run_state
  use summary_text, only: summary_record
  implicit none (type, external)
  private
  public :: set_friction, tell_friction

contains

  !> Lets joints with friction stick or slip as they do at the present state, or move freely.
  subroutine set_friction(run, word)
    type(run_state), intent(inout) :: run
    character(*), intent(in) :: word               !! of the deck: 'held', 'free'
    call run%sys%hold_rows(run%y, word /= 'held')
  end subroutine set_friction

  !> Says which joints are held, which slide, and which rigid stops are closed.
  subroutine tell_friction(run, text)
    type(run_state), intent(in) :: run
    type(summary_record), intent(inout) :: text
    character(:), allocatable :: held, sliding, free
    integer :: k
    held = ''
    do k = size(run%sys%m%s%constraints) - run%sys%m%s%stop_rows + 1, size(run%sys%m%s%constraints)
      associate (row => run%sys%m%s%constraints(k)%item)
        if (row%holds(run%sys%ev%switches%state(row%switch_number))) held = held//' "'//trim(row%name)//'"'
      end associate
    end do
    if (len(held) > 0) call text%line('  rigid stops that are closed:{closed_stops='//held//'}')
    held = ''
    sliding = ''
    free = ''
    do k = 1, size(run%sys%m%s%friction)
      associate (law => run%sys%m%s%friction(k), row => run%sys%m%s%constraints(run%sys%m%s%permanent + k)%item)
        associate (state => run%sys%ev%switches%state(law%number), name => ' "'//trim(row%name)//'"')
          if (state == row_stuck) then
            held = held//name
          else if (law%slides(state) /= 0) then
            sliding = sliding//name
          else
            free = free//name
          end if
        end associate
      end associate
    end do
    if (len(held) > 0) call text%line('  joints held by their friction:{held_by_friction='//held//'}')
    if (len(sliding) > 0) call text%line('  joints that slide, with the friction of this state as a constant force:'// &
                                         '{constant_friction='//sliding//'}')
    if (len(free) > 0) call text%line('  joints that move without their friction:{without_friction='//free//'}')
  end subroutine tell_friction
end module held_friction
