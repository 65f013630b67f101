!> The mobility of a mechanism: its degrees of freedom with all bodies rigid. A deck whose joints hold too much, or too
!> little, shows here at once, where elastic coordinates hide it among many.
module rigid_mobility
  use kinds, only: wp
  use assembly_reports, only: assembly_report
  use build_scene, only: build
  use deck_records, only: deck
  use errors, only: failure, fault_list
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  use scene_model, only: scene
  use summary_text, only: summary_record
  use trial_scene, only: assemble_scene, rigid_copy
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
    type(scene) :: s
    type(fault_list) :: faults
    type(failure) :: fail
    other = rigid_copy(d)
    if (.not. drives) deallocate (other%drives)
    if (.not. drives) allocate (other%drives(0))
    call build(other, s, faults)
    if (faults%count == 0) call assemble_scene(s, m, ev, q, report, fail)
    n = merge(report%freedoms, -1, faults%count == 0 .and. .not. fail%happened())
  end function freedoms
end module rigid_mobility
