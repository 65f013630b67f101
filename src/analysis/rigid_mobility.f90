!> The mobility of a mechanism: its degrees of freedom with all bodies rigid. A deck whose joints hold too much, or too
!> little, shows here at once, where elastic coordinates hide it among many.
module rigid_mobility
  use kinds, only: wp
  use assembly, only: assemble
  use assembly_reports, only: assembly_report
  use build_scene, only: build
  use deck_records, only: deck
  use errors, only: failure, fault_list
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  use mechanism_setup, only: set_up_mechanism
  use scene_model, only: scene
  use summary_text, only: summary_record
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
    call text%figure('  rigid mobility: ', 'rigid_mobility', free)
    call text%figure(trim(merge(' degree ', ' degrees', free == 1))//' of freedom with all bodies rigid, ', &
                     'driven_freedoms', free - driven)
    call text%line(' of them driven')
  end subroutine mobility_lines

  !> Degrees of freedom with all bodies rigid at the start; -1: the deck does not assemble so.
  integer function freedoms(d, drives) result(n)
    type(deck), intent(in) :: d
    logical, intent(in) :: drives              !! whether drives act
    type(deck) :: other
    type(mechanism_model) :: m
    type(evaluation) :: ev
    type(scene) :: s
    type(fault_list) :: faults
    type(assembly_report) :: report
    type(failure) :: fail
    real(wp), allocatable :: q(:), v(:)
    other = d
    other%bodies%flexible = .false.
    if (.not. drives) deallocate (other%drives)
    if (.not. drives) allocate (other%drives(0))
    n = -1
    call build(other, s, faults)
    if (faults%count > 0) return
    call set_up_mechanism(m, ev, s)
    allocate (q(s%nq), v(s%nq))
    call assemble(m, ev, q, v, report, fail)
    if (.not. fail%happened()) n = report%freedoms
  end function freedoms
end module rigid_mobility
