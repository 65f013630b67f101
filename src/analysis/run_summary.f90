!> The files summary.txt and summary.json of a run: while the run is under way they say so, at the end how the run ended.
!> They are replaced as a whole, so that whatever ends a run, even the system, leaves a summary that is true.
module run_summary
  use kinds, only: wp
  use deck_json, only: groups_json
  use errors, only: failure
  use own_files, only: clear_folder
  use posix, only: host_name, remove_scratch, replace_file
  use scene_run, only: run_state, no_output
  use summary, only: version
  use summary_text, only: json_number, summary_record
  use readable_text, only: json_text, readable
  use text, only: fixed_text, to_text
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
    if (.not. fail%happened()) call clear_folder(run%folder)
  end subroutine begin_results

  !> Writes the summary of a run that is under way.
  subroutine announce(run, fail, so_far)
    type(run_state), intent(in) :: run
    type(failure), intent(inout) :: fail
    type(summary_record), intent(in), optional :: so_far   !! in place of the opening
    type(summary_record) :: text
    logical :: ok
    text = run%opening
    if (present(so_far)) text = so_far
    call text%line('')
    call text%line('outcome: running; where biela is no longer at work in this folder, the run was killed: its last rows '// &
                  'may be missing, and biela --restart goes on from its checkpoint, if there is one')
    call text%member('outcome', json_text('running'))
    call write_summary(run, text, ok)
    if (.not. ok) call no_output(run, fail)
  end subroutine announce

  !> Writes the summary of a run that has ended: text, outcome, times, the deck.
  subroutine finish_summary(run, fail, seconds, restarts, text, ok)
    type(run_state), intent(in) :: run
    type(failure), intent(in) :: fail
    real(wp), intent(in) :: seconds(2)           !! by the clock, of the processor [s]
    integer, intent(in) :: restarts              !! times that the run was continued
    type(summary_record), intent(inout) :: text
    logical, intent(out) :: ok                   !! whether it could be written
    character(:), allocatable :: outcome
    character(8) :: date
    character(10) :: clock
    if (restarts > 0) call text%line('timing: restarts '//to_text(restarts))
    call text%line('')
    outcome = 'done'
    if (fail%happened()) outcome = fail%message
    call text%word('outcome: ', 'outcome', outcome)
    call text%line('')
    call text%line('status: {status #}', [real(wp) :: fail%status])
    call text%line('timing: analyses took '//fixed_text(seconds(1), 6)//' s, '//fixed_text(seconds(2), 6)//' s of the processor')
    call date_and_time(date, clock)
    call text%member('timing', '{"seconds": '//json_number(seconds(1))//', "processor_seconds": '//json_number(seconds(2))// &
      ', "restarts": '//to_text(restarts)//', "ended": '//json_text(date(1:4)//'-'//date(5:6)//'-'//date(7:8)//'T'// &
      clock(1:2)//':'//clock(3:4)//':'//clock(5:6))//', "host": '//json_text(host_name())//', "compiler": '// &
      json_text(compiler_version())//'}')
    call write_summary(run, text, ok)
  end subroutine finish_summary

  !> Adds the version and the deck's text, and writes both files.
  subroutine write_summary(run, text, ok)
    type(run_state), intent(in) :: run
    type(summary_record), intent(inout) :: text
    logical, intent(out) :: ok
    call text%line('version: biela '//version//', '//compiler_version())
    call text%line('')
    call text%line('deck text')
    call text%word('', 'deck_text', run%d%text)
    call text%line('')
    call text%member('groups', groups_json(run%d%flat))
    call write_whole(run%folder//'/summary.json', text%json(), ok)
    if (ok) call write_whole(run%folder//'/summary.txt', readable(text%words%all()), ok)
  end subroutine write_summary

  !> Writes a complete file under another name and renames it, so that no reader sees a part of it.
  subroutine write_whole(path, text, ok)
    character(*), intent(in) :: path, text
    logical, intent(out) :: ok
    type(result_file) :: file
    call file%open(path//'.new')
    call file%line(text)
    call file%close()
    ok = .not. file%failed
    if (ok) ok = replace_file(path//'.new', path)
    if (.not. ok) call remove_scratch(path//'.new')
  end subroutine write_whole
end module run_summary
