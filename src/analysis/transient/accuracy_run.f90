!> A transient by passes until the deck's accuracy is kept (theory.md, section 12): each pass is a run like any other, compared
!> row by row with the one before. Files of a finished pass get their names when the next one has begun, or at the end. Its part
!> of the summary is kept as text, since what that describes is gone when the next pass has begun.
module accuracy_run
  use kinds, only: wp, ip
  use accuracy_search, only: has_fixed_steps, pass_record, pass_search, setting_words, under_way, finished, given_up, lost_pass, &
    witness
  use accuracy_words, only: asked_errors
  use errors, only: failure, status_failed
  use mechanism_ode, only: mechanism_system
  use posix, only: standard_error, write_bytes
  use readable_text, only: json_text
  use run_summary, only: announce
  use scene_run, only: run_state, no_output, warn
  use step_counts, only: step_count
  use step_monitor, only: stability_monitor, method_number
  use stored_pass, only: compared_names
  use summary_text, only: json_number, summary_record
  use text, only: short_text, to_text
  use transient, only: run_transient, transient_march
  use transient_summary, only: transient_lines
  implicit none (type, external)
  private
  public :: run_to_accuracy

contains

  !> Runs passes until the search is over; the summary gets what the last finished one has found, and what was tried.
  subroutine run_to_accuracy(run, march, text, fail)
    type(run_state), intent(inout) :: run
    type(transient_march), intent(inout) :: march
    type(summary_record), intent(inout) :: text
    type(failure), intent(inout) :: fail
    class(mechanism_system), allocatable :: start_system
    type(transient_march) :: next
    real(wp), allocatable :: start_state(:)   ! [m, rad], [m/s, rad/s], [J]
    type(summary_record) :: so_far
    logical :: ok
    allocate (start_system, source=run%sys)
    start_state = run%y
    associate (r => run%d%transient)
      call march%search%begin(run%d, run%stable_steps, size(compared_names(run)), &
                              step_count(0.0_wp, r%t_end, r%output_step), run%began)
    end associate
    if (run%restart) call march%search%exchange(run%saved)
    do
      call march%search%set(run%d%transient)
      run%stable_step = huge(1.0_wp)
      if (method_number(run%d%transient%method) > 0) run%stable_step = run%stable_steps(method_number(run%d%transient%method))
      call run_transient(run, march, fail)
      if (fail%happened() .and. fail%status /= status_failed) exit
      call end_pass(run, march, fail)
      if (march%search%over) exit
      fail = failure()
      so_far = run%opening
      call search_lines(run, march, so_far)
      call announce(run, fail, so_far)
      if (fail%happened()) return
      next%search = march%search
      next%restarts = march%restarts
      call next%files%follow(march%files, march%search%delivered == march%search%count - 1)
      march = next
      deallocate (run%sys)
      allocate (run%sys, source=start_system)
      run%y = start_state
      run%monitor = stability_monitor()
      run%restart = .false.
    end do
    if (march%search%over .and. any(march%search%delivered == [0, march%search%count])) then
      call march%files%publish(run%folder, march%files%suffix, ok)
      if (.not. ok) call no_output(run, fail)
    end if
    if (march%search%delivered > 0) then
      if (march%search%over .and. fail%status == status_failed) fail = failure()
      call text%append(march%search%found)
      ok = write_bytes(standard_error, march%search%found%held_back%all())
    else
      call transient_lines(run, march, fail%status, text)
    end if
    call search_lines(run, march, text)
    if (march%search%over .and. march%search%delivered > 0 .and. .not. march%search%kept) then
      call warn_not_kept(run, march%search, text)
    end if
  end subroutine run_to_accuracy

  !> What a pass has cost and shown; its files get their names, and its part of the summary is kept, where it went to the end.
  subroutine end_pass(run, march, fail)
    type(run_state), intent(inout) :: run
    type(transient_march), intent(inout) :: march
    type(failure), intent(inout) :: fail
    type(pass_record) :: pass
    real(wp), allocatable :: x(:)             ! differences over what is asked [-]
    associate (search => march%search, c => march%check)
      pass = search%passes(search%count)
      pass%outcome = finished
      if (march%stopped) pass%outcome = given_up
      if (fail%happened()) pass%outcome = lost_pass
      pass%cost = march%cost(run)
      pass%reached = march%last
      pass%other = search%stored
      if (c%active .and. pass%reached > 0.0_wp) then
        x = c%error/asked_errors(run, c)
        pass%column = maxloc(x, 1)
        pass%apart = x(pass%column)
        pass%differ_at = c%differ_at
        c%error_ratio = search%ratio(pass)
        if (pass%role == witness) search%witnessed = x
      end if
      if (pass%outcome == finished .and. pass%role /= witness) then
        search%found = summary_record(silent=.true.)
        call transient_lines(run, march, fail%status, search%found)
      end if
      call search%judge(pass)
    end associate
  end subroutine end_pass

  !> What was tried, what was chosen and why, and what it cost.
  subroutine search_lines(run, march, text)
    type(run_state), intent(in) :: run
    type(transient_march), intent(in) :: march
    type(summary_record), intent(inout) :: text
    character(80), allocatable :: names(:)
    integer :: k
    names = compared_names(run)
    associate (search => march%search)
      call text%line('')
      call text%open('accuracy', '{')
      call text%figure('accuracy of ', 'asked', run%d%transient%accuracy, &
                       rest=' of the range of each column, kept by passes that check each other; cost in explicit evaluations')
      call text%open('passes', '[')
      do k = 1, search%count
        call pass_line(search, k, names, text)
      end do
      call text%close()
      if (any(search%witnessed >= 0.0_wp)) then
        call text%open('damped', '{')
        call text%line('  left out or damped as too small, by the witness: '// &
                       trim(merge('column, part of what is asked               ', &
                                  'no column shows a hundredth of what is asked', any(search%witnessed > 0.01_wp))))
        do k = 1, size(names)
          if (search%witnessed(k) > 0.01_wp) call text%figure('    '//trim(names(k))//' ', trim(names(k)), &
                                                              search%witnessed(k), 1, rest='')
        end do
        call text%close()
      end if
      if (len_trim(search%choice) > 0) call text%line('  choice: '//trim(search%choice))
      call text%figure('  cost of all passes: ', 'cost', nint(sum(search%passes(1:search%count)%cost), ip), rest='')
      if (search%over) call text%member('kept', trim(merge('true ', 'false', search%kept)))
      if (search%delivered > 0) call text%figure('  the results are those of pass ', 'results_of_pass', search%delivered, rest='')
      if (search%kept) call text%line('  accuracy: kept, by the estimated errors of all columns')
      call text%close()
    end associate
  end subroutine search_lines

  !> A pass: its method and setting, what it has cost, how it ended, its error.
  subroutine pass_line(search, k, names, text)
    type(pass_search), intent(in) :: search
    integer, intent(in) :: k                  !! number of the pass
    character(*), intent(in) :: names(:)      !! of the columns
    type(summary_record), intent(inout) :: text
    character(*), parameter :: roles(3) = [character(7) :: 'pilot', 'results', 'witness']
    character(*), parameter :: endings(2:3) = [character(10) :: 'given up', 'lost']
    associate (pass => search%passes(k))
      call text%open('', '{')
      call text%figure('  pass '//to_text(k)//', ', 'role', trim(roles(pass%role)))
      call text%figure(': ', 'method', trim(pass%method))
      call text%words%add(setting_words(pass))
      call text%member(trim(merge('step     ', 'tolerance', has_fixed_steps(pass%method))), json_number(pass%setting))
      if (pass%outcome == under_way) then
        call text%figure(', expected to cost about ', 'expected_cost', &
                         nint(min(search%predicted_cost(pass%method, pass%setting), pass%budget), ip))
      else
        call text%figure(', cost ', 'cost', nint(pass%cost, ip))
        call text%member('reached', json_number(pass%reached))
      end if
      if (pass%outcome > finished) call text%words%add(', '//trim(endings(pass%outcome))//' at t = '// &
                                                       short_text(pass%reached, 3)//' s')
      if (pass%apart >= 0.0_wp) then
        call text%figure('; '//trim(names(pass%column))//' errs by ', 'worst_error_of_asked', search%error_of(pass), 1)
        call text%words%add(' of what is asked, by pass '//to_text(pass%other))
        call text%member('worst_column', json_text(trim(names(pass%column))))
      else if (pass%role == witness .and. pass%outcome > finished) then
        call text%words%add(', before its first row: it tells nothing')
      end if
      if (pass%differ_at >= 0.0_wp) call text%words%add('; events differ from t = '//short_text(pass%differ_at, 3)//' s on')
      call text%line('')
      call text%close()
    end associate
  end subroutine pass_line

  !> Why columns may err by more than was asked, and which one errs most.
  subroutine warn_not_kept(run, search, text)
    type(run_state), intent(in) :: run
    type(pass_search), intent(in) :: search
    type(summary_record), intent(inout) :: text
    character(80), allocatable :: names(:)
    character(:), allocatable :: words
    names = compared_names(run)
    words = 'the accuracy is not kept: '//trim(search%reason)
    associate (pass => search%passes(search%delivered))
      if (pass%differ_at >= 0.0_wp) words = words//'; events of the last two passes differ from t = '// &
        short_text(pass%differ_at, 6)//' s on'
      if (pass%other == 0) then
        words = words//'; errors of the results, pass '//to_text(search%delivered)//', are unknown: no other pass was finished'
      else
        words = words//'; the worst column of the results, '//trim(names(pass%column))//', errs by an estimated '// &
          short_text(search%error_of(pass), 1)//' of what is asked'
      end if
    end associate
    call warn(run, words, text)
  end subroutine warn_not_kept
end module accuracy_run
