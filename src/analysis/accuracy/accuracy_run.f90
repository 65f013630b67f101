!> A transient by passes until two agree as well as the deck asks (theory.md, section 12), or by two, of which the second one tells
!> the errors of the first: each is a run like any other, compared row by row with the one before. Files of a finished pass get
!> their names when the next one has begun, or at the end. Its part of the summary is kept as text, since what that describes is
!> gone when the next pass has begun.
module accuracy_run
  use kinds, only: wp, ip
  use accuracy_ladder, only: finished, given_up, has_fixed_steps, lost_pass, pass_record, setting_words, under_way
  use accuracy_words, only: asked_errors, error_lines
  use errors, only: failure, status_failed
  use mechanism_ode, only: mechanism_system
  use posix, only: standard_error, write_bytes
  use run_summary, only: announce
  use scene_run, only: run_state, no_output
  use step_counts, only: step_count
  use step_monitor, only: stability_monitor, method_number
  use result_columns, only: labels_of, result_column
  use stored_pass, only: compared_columns
  use summary_text, only: json_number, summary_record
  use text, only: either, joined, short_text, to_text
  use transient, only: run_transient, transient_march
  use transient_summary, only: transient_lines
  implicit none (type, external)
  private
  public :: run_to_accuracy

contains

  !> Runs passes until the ladder ends; the summary gets what the last finished one has found, and what was tried.
  subroutine run_to_accuracy(run, march, text, fail)
    type(run_state), intent(inout) :: run
    type(transient_march), intent(inout) :: march
    type(summary_record), intent(inout) :: text
    type(failure), intent(inout) :: fail
    class(mechanism_system), allocatable :: start_system
    type(transient_march) :: next
    real(wp), allocatable :: start_state(:)   ! [m, rad], [m/s, rad/s], [J]
    type(summary_record) :: so_far
    integer :: columns
    logical :: ok
    allocate (start_system, source=run%sys)
    start_state = run%y
    columns = size(compared_columns(run))
    call march%ladder%begin(run%d, run%stable_steps, columns)
    call march%rows%begin(columns, step_count(0.0_wp, run%d%transient%t_end, run%d%transient%output_step))
    if (run%restart) call march%ladder%exchange(run%saved)
    if (run%restart) call march%rows%exchange(run%saved)
    do
      call march%ladder%set(run%d%transient)
      march%budget = march%ladder%passes(march%ladder%count)%budget
      run%stable_step = huge(1.0_wp)
      if (method_number(run%d%transient%method) > 0) run%stable_step = run%stable_steps(method_number(run%d%transient%method))
      call run_transient(run, march, fail)
      if (fail%happened() .and. fail%status /= status_failed) exit
      call end_pass(run, march, fail)
      if (march%ladder%over) exit
      fail = failure()
      so_far = run%opening
      if (.not. march%ladder%estimates) call ladder_lines(run, march, so_far)
      call announce(run, fail, so_far)
      if (fail%happened()) return
      next%ladder = march%ladder
      next%restarts = march%restarts
      call next%files%follow(march%files, march%ladder%delivered == march%ladder%count - 1)
      next%rows = march%rows
      march = next
      deallocate (run%sys)
      allocate (run%sys, source=start_system)
      run%y = start_state
      run%monitor = stability_monitor()
      run%restart = .false.
    end do
    associate (ladder => march%ladder)
      if (ladder%over .and. any(ladder%delivered == [0, ladder%count])) then
        call march%files%publish(run%folder, march%files%suffix, ok)
        if (.not. ok) call no_output(run, fail)
      end if
      if (ladder%delivered > 0) then
        if (ladder%estimates) call error_lines(run, march, fail, ladder%found)
        if (ladder%estimates) call ladder%found%close()
        if (ladder%over .and. fail%status == status_failed) fail = failure()
        call text%append(ladder%found)
        ok = write_bytes(standard_error, ladder%found%pending%all())
      else
        call transient_lines(run, march, fail%status, text)
      end if
      if (ladder%estimates) return
      call ladder_lines(run, march, text)
      if (ladder%over .and. ladder%delivered > 0 .and. .not. ladder%kept) call warn_not_kept(run, march, text)
    end associate
  end subroutine run_to_accuracy

  !> What a pass has cost and shown; its part of the summary is kept where it went to the end.
  subroutine end_pass(run, march, fail)
    type(run_state), intent(inout) :: run
    type(transient_march), intent(inout) :: march
    type(failure), intent(inout) :: fail
    type(pass_record) :: pass
    type(result_column), allocatable :: columns(:)
    real(wp), allocatable :: apart(:)         ! (columns, then events) differences over what is asked [-]
    associate (ladder => march%ladder, c => march%rows)
      pass = ladder%passes(ladder%count)
      pass%outcome = finished
      if (march%stopped) pass%outcome = given_up
      if (fail%happened()) pass%outcome = lost_pass
      pass%cost = march%cost(run)
      pass%reached = march%last
      pass%mean_step = march%last/max(march%method%steps, 1_ip)
      apart = [real(wp) ::]
      pass%residual = march%balance%largest_residual
      pass%share = march%balance%share()
      if (c%filled .and. pass%outcome == finished .and. .not. ladder%estimates) then
        pass%other = ladder%stored
        apart = [c%error/asked_errors(run, march%compared_range(), ladder%absolute), 0.0_wp]
        pass%column = maxloc(apart, 1)
        pass%apart = apart(pass%column)
        pass%differ_at = c%differ_at
        if (c%differ_at >= 0.0_wp) apart(size(apart)) = max(pass%apart, 2.0_wp)   ! they may agree as long as columns converge
      end if
      if (pass%outcome == finished .and. (ladder%count == 1 .or. .not. ladder%estimates)) then
        ladder%found = summary_record(silent=.true.)
        ladder%found%path = run%d%path
        call transient_lines(run, march, fail%status, ladder%found)
        call march%rows%turn()
      else if (.not. ladder%estimates) then
        call march%rows%forget()
      end if
      call ladder%end_pass(pass, apart, run%late() .and. (pass%outcome == finished .or. ladder%delivered > 0))
      ladder%because = ''
      if (pass%differ_at >= 0.0_wp) then
        ladder%because = ', for the sequence of events'
      else if (pass%apart > 1.0_wp) then
        columns = compared_columns(run)
        ladder%because = ', for '//columns(pass%column)%label()
      end if
    end associate
  end subroutine end_pass

  !> What was tried, which columns have an absolute accuracy, what was chosen and why, and what it cost.
  subroutine ladder_lines(run, march, text)
    type(run_state), intent(in) :: run
    type(transient_march), intent(in) :: march
    type(summary_record), intent(inout) :: text
    character(80), allocatable :: names(:)
    integer :: k
    names = labels_of(compared_columns(run))
    associate (ladder => march%ladder)
      call text%line('')
      call text%open('accuracy', '{')
      call text%line('accuracy of {asked} of the range of each column, kept where two passes agree so well; cost in explicit '// &
                     'evaluations', [run%d%transient%accuracy])
      call text%open('passes', '[')
      do k = 1, ladder%count
        call pass_line(ladder%passes(k), k, names, text)
      end do
      call text%close()
      if (any(ladder%absolute > 0.0_wp)) then
        call text%line('  absolute accuracy of columns with a floor, or a range below a thousandth of the largest of their kind:')
        call text%table('absolute', pack(names, ladder%absolute > 0.0_wp), pack(ladder%absolute, ladder%absolute > 0.0_wp), 2)
      end if
      if (len_trim(ladder%choice) > 0) call text%line('  choice: {choice='//trim(ladder%choice)//'}')
      call text%line('  cost of all passes: {cost #}', [sum(ladder%passes(1:ladder%count)%cost)])
      if (ladder%over) call text%member('kept', either('true', 'false', ladder%kept))
      if (ladder%over .and. ladder%delivered > 0) then
        call text%open('not_kept', '[')
        do k = 1, size(names)
          if (ladder%apart(k) > 1.0_wp) call text%line('  accuracy not kept: {='//trim(names(k))//'}')
        end do
        call text%close()
      end if
      if (ladder%delivered > 0) call text%line('  the results are those of pass {results_of_pass '// &
                    '#}', [real(wp) :: ladder%delivered])
      if (ladder%kept) call text%line('  accuracy: kept, the last two passes agree in all columns and events')
      call text%close()
    end associate
  end subroutine ladder_lines

  !> A pass: its method and setting, what it has cost, how it ended, what sets the cost of the next one.
  subroutine pass_line(pass, k, names, text)
    type(pass_record), intent(in) :: pass
    integer, intent(in) :: k                  !! number of the pass
    character(*), intent(in) :: names(:)      !! of the columns
    type(summary_record), intent(inout) :: text
    character(*), parameter :: endings(2:3) = [character(8) :: 'given up', 'failed']
    call text%open('', '{')
    call text%say('  pass '//to_text(k)//': {method='//trim(pass%method)//'}, '//either('step {step} s', 'tolerance {tolerance}', &
                                                                       has_fixed_steps(pass%method)), [pass%setting])
    if (pass%outcome == under_way) then
      call text%say(', under way')
    else
      call text%say(', cost {cost #}', [pass%cost])
      if (pass%outcome > finished) call text%say(', '//trim(endings(pass%outcome))//' at t = {reached 3} s', [pass%reached])
      if (pass%outcome == finished) call text%member('reached', json_number(pass%reached))
    end if
    if (pass%other > 0) call text%say('; {worst_column='//trim(names(pass%column))//'} differs by {worst_error_of_asked 1} of '// &
                                      'what is asked from pass {compared_with #}', [real(wp) :: pass%apart, pass%other])
    if (pass%differ_at >= 0.0_wp) call text%say('; events differ from t = {events_differ_from 3} s', [pass%differ_at])
    call text%line('')
    call text%close()
  end subroutine pass_line

  !> Why columns may err by more than was asked, and which: the others keep it.
  subroutine warn_not_kept(run, march, text)
    type(run_state), intent(in) :: run
    type(transient_march), intent(in) :: march
    type(summary_record), intent(inout) :: text
    character(80), allocatable :: names(:)
    character(:), allocatable :: words
    integer, parameter :: most = 5            ! columns named
    integer :: n
    names = labels_of(compared_columns(run))
    associate (ladder => march%ladder, pass => march%ladder%passes(march%ladder%delivered), all => size(names))
      words = 'the accuracy is not kept: '//trim(ladder%reason)
      if (pass%differ_at >= 0.0_wp) words = words//'; events of the last two passes differ from t = '// &
        short_text(pass%differ_at, 6)//' s on'
      names = pack(names, ladder%apart(:all) > 1.0_wp)
      n = size(names)
      if (pass%other == 0) then
        words = words//'; errors of the results, pass '//to_text(ladder%delivered)//', are unknown: no other pass was finished'
      else if (n > 0) then
        words = words//'; '//joined(names(:min(n, most)), ', ')//either(' and others', '', n > most)// &
          either(' errs', ' err', n == 1)// &
                ' by an estimated '//either('', 'largest ', n == 1)//short_text(maxval(ladder%apart(:all)), 1)//' of what is asked'
        if (n < all .and. pass%differ_at < 0.0_wp) words = words//'; the other columns keep it'
      end if
    end associate
    call text%warn(words)
  end subroutine warn_not_kept
end module accuracy_run
