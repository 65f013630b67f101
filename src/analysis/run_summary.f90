!> The file summary.txt of a run: while the run is under way it says so, at the end how the run ended. It is replaced as a
!> whole, so that whatever ends a run, even the system, leaves a summary that is true.
module run_summary
  use kinds, only: wp
  use checkpoint, only: remove_checkpoint
  use errors, only: failure, status_no_output
  use posix, only: remove_file, replace_file
  use scene_run, only: run_state
  use summary, only: version, add_line
  use text, only: fixed_text
  use text_file, only: result_file
  use, intrinsic :: iso_fortran_env, only: compiler_version
  implicit none (type, external)
  private
  public :: begin_results, announce, finish_summary

contains

  !> Makes the folder this run's own: first the summary says that the run is under way, then what earlier runs of biela left
  !> is removed, so that the files beside a summary are never those of another run. Other files are not touched.
  subroutine begin_results(run, fail)
    type(run_state), intent(in) :: run
    type(failure), intent(inout) :: fail
    call announce(run, fail)
    if (fail%happened()) return
    call remove_checkpoint(run%folder)
    call remove_file(run%folder//'/static.txt')
    call remove_file(run%folder//'/modes.txt')
    call remove_file(run%folder//'/frequency_response.txt')
    call remove_file(run%folder//'/history.txt')
    call remove_file(run%folder//'/energy.txt')
    call remove_file(run%folder//'/motion.txt')
  end subroutine begin_results

  !> Writes the summary of a run that is under way.
  subroutine announce(run, fail)
    type(run_state), intent(in) :: run
    type(failure), intent(inout) :: fail
    character(:), allocatable :: text
    logical :: ok
    text = run%opening
    call add_line(text, '')
    call add_line(text, 'outcome: running; where biela is no longer at work in this folder, the run was killed: its last rows '// &
                  'may be missing, and biela --restart goes on from its checkpoint, if there is one')
    call add_deck(run, text)
    call write_whole(run%folder//'/summary.txt', text, ok)
    if (.not. ok) call fail%raise(status_no_output, 'results cannot be written into "'//run%folder// &
                                  '": the disk may be full or the folder protected')
  end subroutine announce

  !> Writes the summary of a run that has ended: text, outcome, times, the deck.
  subroutine finish_summary(run, fail, seconds, processor, text, ok)
    type(run_state), intent(in) :: run
    type(failure), intent(in) :: fail
    real(wp), intent(in) :: seconds, processor   !! by the clock, of the processor [s]
    character(:), allocatable, intent(inout) :: text
    logical, intent(out) :: ok                   !! whether it could be written
    call add_line(text, '')
    if (fail%happened()) then
      call add_line(text, 'outcome: '//fail%message)
    else
      call add_line(text, 'outcome: done')
    end if
    call add_line(text, 'timing: analyses took '//fixed_text(seconds, 6)//' s, '//fixed_text(processor, 6)// &
                  ' s of the processor')
    call add_deck(run, text)
    call write_whole(run%folder//'/summary.txt', text, ok)
  end subroutine finish_summary

  !> Adds the version and the deck's text.
  subroutine add_deck(run, text)
    type(run_state), intent(in) :: run
    character(:), allocatable, intent(inout) :: text
    call add_line(text, 'version: biela '//version//', '//compiler_version())
    call add_line(text, '')
    call add_line(text, 'deck text')
    call add_line(text, run%d%text)
  end subroutine add_deck

  !> Writes a whole file beside its place and renames it, so that it is never half there.
  subroutine write_whole(path, text, ok)
    character(*), intent(in) :: path, text
    logical, intent(out) :: ok
    type(result_file) :: file
    call file%open(path//'.new')
    call file%line(text)
    call file%close()
    ok = .not. file%failed
    if (ok) ok = replace_file(path//'.new', path)
    if (.not. ok) call remove_file(path//'.new')
  end subroutine write_whole
end module run_summary
