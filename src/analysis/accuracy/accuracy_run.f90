!> A transient by passes until two agree as well as the deck asks (theory.md, section 12), or by two, of which the second one tells
!> the errors of the first: each is a run like any other, compared with the one before. Files of a finished pass get their names
!> when the next one has begun, or at the end. Its part of the summary is kept as text, since what that describes is gone when the
!> next pass has begun.
module accuracy_run
  use kinds, only: wp, ip
  use accuracy_ladder, only: finished, given_up, half, lost_pass, pass_record
  use accuracy_words, only: error_lines, ladder_lines
  use choose_stepper, only: method_order
  use column_ranges, only: rounded_share
  use errors, only: failure, status_failed
  use mechanism_ode, only: mechanism_system
  use posix, only: standard_error, write_bytes
  use run_summary, only: announce
  use scene_run, only: run_state, no_output
  use step_monitor, only: stability_monitor, method_number
  use result_columns, only: labels_of
  use stored_pass, only: compared_columns, pass_difference
  use summary_text, only: summary_record
  use transient, only: run_transient, transient_march
  use transient_summary, only: transient_lines
  implicit none (type, external)
  private
  public :: run_to_accuracy

contains

  !> Runs passes until the ladder ends; the summary gets what the delivered one has found, and what was tried.
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
    call march%ladder%begin(run%d, run%stable_steps, size(compared_columns(run)))
    call march%rows%begin(run)
    if (run%restart) call march%ladder%exchange(run%saved)
    if (run%restart) call march%rows%exchange(run%saved)
    do
      call march%ladder%set(run%d%transient)
      run%stable_step = huge(1.0_wp)
      if (method_number(run%d%transient%method) > 0) run%stable_step = run%stable_steps(method_number(run%d%transient%method))
      call run_transient(run, march, fail)
      if (fail%happened() .and. fail%status /= status_failed) exit
      call end_pass(run, march, fail)
      if (march%ladder%over) exit
      fail = failure()
      so_far = run%opening
      call ladder_lines(run, march%ladder, so_far)
      call announce(run, fail, so_far)
      if (fail%happened()) return
      next%ladder = march%ladder
      next%restarts = march%restarts
      call next%files%follow(march%files, march%ladder%delivered() == march%ladder%count - 1)
      next%rows = march%rows
      march = next
      deallocate (run%sys)
      allocate (run%sys, source=start_system)
      run%y = start_state
      run%monitor = stability_monitor()
      run%restart = .false.
    end do
    associate (ladder => march%ladder, delivered => march%ladder%delivered())
      if (ladder%over .and. any(delivered == [0, ladder%count])) then
        call march%files%publish(run%folder, march%files%suffix, ok)
        if (.not. ok) call no_output(run, fail)
      end if
      if (delivered == 0) then
        call transient_lines(run, march, fail%status, text)
        call text%close()
      else
        if (ladder%passes(merge(ladder%count, delivered, ladder%estimates))%column == '') then
          call ladder%found%line('  accuracy: unknown, no other pass has come to its end')
        end if
        if (ladder%over .and. fail%status == status_failed) then
          if (ladder%estimates) call ladder%found%warn('errors of columns are unknown, the second run failed: '//fail%message)
          fail = failure()
        end if
        call ladder%found%close()
        call text%append(ladder%found)
        ok = write_bytes(standard_error, ladder%found%pending%all())
      end if
      call ladder_lines(run, ladder, text)
    end associate
  end subroutine run_to_accuracy

  !> What a pass has cost and shown; its part of the summary is kept where it may be delivered.
  subroutine end_pass(run, march, fail)
    type(run_state), intent(inout) :: run
    type(transient_march), intent(inout) :: march
    type(failure), intent(in) :: fail
    type(pass_record) :: pass
    type(pass_difference) :: x
    character(80), allocatable :: names(:)
    real(wp) :: ratio                         ! error of the first one of two runs over their difference [-]
    real(wp), allocatable :: apart(:)         ! (columns, then events) differences over what is asked [-]
    names = labels_of(compared_columns(run))
    apart = spread(huge(1.0_wp), 1, size(names) + 1)
    associate (ladder => march%ladder)
      pass = ladder%passes(ladder%count)
      pass%outcome = merge(given_up, finished, march%stopped)
      if (fail%happened()) pass%outcome = lost_pass
      pass%cost = march%cost(run)
      pass%reached = march%last
      pass%mean_step = march%last/max(march%method%steps, 1_ip)
      pass%residual = march%balance%largest_residual
      if (pass%outcome == finished .and. .not. (ladder%estimates .and. ladder%count == 2)) then
        ladder%found = summary_record(silent=.true.)
        ladder%found%path = run%d%path
        call transient_lines(run, march, fail%status, ladder%found)
      end if
      if (pass%outcome == finished .and. march%rows%filled) then
        x = march%rows%difference(run, rounded_share(march%norm, run%stable_steps(1), run%d%transient%t_end))
        if (ladder%estimates) then            ! Richardson; a tenth of the tolerance leaves a fifth of an error or less
          ratio = 1/(1 - half**merge(method_order(pass%method), 2, pass%fixed))
          x%error = ratio*x%error
          x%event_error = ratio*x%event_error
        end if
        pass%column = names(maxloc(x%error/x%asked, 1))
        pass%apart = maxval(x%error/x%asked)
        pass%differ_at = x%differ_at
        apart = [min(x%error, x%range)/x%asked, 0.0_wp]    ! beyond its range a column is as wrong as can be
        if (x%differ_at >= 0.0_wp) apart(size(apart)) = max(maxval(apart), 2.0_wp)   ! may agree as long as columns converge
        call error_lines(run, march, x, ladder%found)
      end if
      call march%rows%turn(pass%outcome /= finished)
      call ladder%end_pass(pass, apart, run%late() .and. (pass%outcome == finished .or. ladder%delivered() > 0))
    end associate
  end subroutine end_pass
end module accuracy_run
