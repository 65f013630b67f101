!> The mobility of a mechanism: its degrees of freedom with all bodies rigid. A deck whose joints hold too much, or too
!> little, shows here at once, where elastic coordinates hide it among many.
module rigid_mobility
  use kinds, only: wp
  use assembly_reports, only: assembly_report
  use deck_records, only: deck
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  use summary_text, only: summary_record
  use trial_scene, only: assemble_deck, rigid_copy
  use text, only: either
  implicit none (type, external)
  private
  public :: mobility_lines

contains

  !> Adds the mobility that the joints leave and what of it the drives prescribe.
  subroutine mobility_lines(d, text)
    type(deck), intent(in) :: d
    type(summary_record), intent(inout) :: text
    integer :: free, driven
    free = freedoms(d, .false.)
    driven = freedoms(d, .true.)
    if (min(free, driven) < 0) then
      call text%line('  rigid mobility: unknown, the joints do not close with all bodies rigid')
      call text%member('rigid_mobility', 'null')
      return
    end if
    call text%line('  rigid mobility: {rigid_mobility #}'//either(' degree', ' degrees', free == 1)//' of freedom with all '// &
                   'bodies rigid, {driven_freedoms #} of them driven', [real(wp) :: free, free - driven])
  end subroutine mobility_lines

  !> Degrees of freedom with all bodies rigid at the start; -1: the deck does not assemble so.
  integer function freedoms(d, drives) result(n)
    type(deck), intent(in) :: d
    logical, intent(in) :: drives              !! whether drives act
    type(deck) :: other
    type(mechanism_model) :: m
    type(evaluation) :: ev
    type(assembly_report) :: report
    real(wp), allocatable :: q(:)
    logical :: ok
    other = rigid_copy(d)
    if (.not. drives) deallocate (other%drives)
    if (.not. drives) allocate (other%drives(0))
    call assemble_deck(other, m, ev, q, report, ok)
    n = merge(report%freedoms, -1, ok)
  end function freedoms
end module rigid_mobility
