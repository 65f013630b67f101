!> Lines of the summary about a transient: steps, evaluations, stable steps, those energies, the validity watch.
module transient_summary
  use kinds, only: wp
  use balance_words, only: balance_lines, closing_lines
  use column_ranges, only: rounded_share
  use errors, only: status_failed
  use material_band, only: motion_outside_band
  use scene_run, only: run_state
  use step_counts, only: actual_step
  use loss_words, only: friction_lines, loss_lines
  use stop_words, only: stop_lines
  use summary_text, only: summary_record
  use text, only: either, es_text, fixed_text, short_text
  use transient, only: transient_march
  implicit none (type, external)
  private
  public :: transient_lines

contains

  !> The transient's part of the summary, left open to estimated errors; warnings go to standard error too.
  subroutine transient_lines(run, march, status, text)
    type(run_state), intent(in) :: run
    type(transient_march), intent(in) :: march
    integer, intent(in) :: status              !! of the run (`errors`)
    type(summary_record), intent(inout) :: text
    if (.not. allocated(march%method)) return
    associate (r => run%d%transient, method => march%method, m => run%sys%m, ev => run%sys%ev)
      call text%section('transient', 'transient')
      call text%line('  method: {method='//trim(r%method)//'}, stabilization: {stabilization='//trim(r%stabilization)//'}')
      if (r%adaptive) then
        call text%line('  tolerance: {tolerance 3}, accepted steps from {shortest_step 3} to {longest_step 3} s', &
                       [r%tolerance, min(method%shortest, method%longest), method%longest])
      else
        call text%line('  step: {step 9} s', [actual_step(r%output_step, r%step)])
      end if
      call text%line('  reached: t = {reached 9} s', [method%t])
      call text%line('  steps: {steps #}, rejected: {rejected #}', [real(wp) :: method%steps, method%rejected])
      call text%line('  evaluations: {evaluations #}, banded solves: {banded_solves #}', [real(wp) :: ev%evaluations, ev%solves])
      call method%report_work(text)
      if (run%monitor%smallest < huge(1.0_wp)) then
        call text%line('  smallest current bound of the step: {smallest_bound 4} s at t = {smallest_bound_at 4} s (estimates: '// &
                       '{bound_estimates #})', [real(wp) :: run%monitor%smallest, run%monitor%at, run%monitor%estimates])
        if (.not. r%adaptive) call compare_step(run, text)
      end if
    end associate
    call still_lines(run, march, text)
    call stop_lines(run, march, text)
    call march%pairs%lines(run%sys%m, text)
    call friction_lines(run, text)
    call loss_lines(run, run%y, .false., text)
    call closing_lines(run, march, text)
    if (status == status_failed) then
      call text%line('  accuracy: unknown, the run failed; its last rows may be wrong')
    else
      call balance_lines(run, march, text)
      if (.not. march%ladder%active) call text%line('  accuracy: the energy balance does not bound errors of columns: a '// &
        'vibration that is late keeps its energy; check_error=.true. in &transient estimates the error of every column')
    end if
    call validity_lines(run, status, text)
  end subroutine transient_lines

  !> Names the columns that stand still but for rounding, with their values.
  subroutine still_lines(run, march, text)
    type(run_state), intent(in) :: run
    type(transient_march), intent(in) :: march
    type(summary_record), intent(inout) :: text
    real(wp), dimension(run%list%columns) :: range, value   ! [of the column]
    real(wp) :: share                          ! of a motion over the scene's size that counts [-]
    if (march%done == 0) return
    associate (columns => run%list%column)
      share = rounded_share(march%norm, run%stable_steps(1), run%d%transient%t_end)
      range = march%seen%moved(run%sys%m%s, columns, run%d%transient%t_end, share)
      value = march%seen%still(run%sys%m%s, columns, run%d%transient%t_end, share)
      if (all(range > 0.0_wp)) return
      call text%line('  constant columns (only rounding changes them), and their values:')
      call text%table('still_columns', pack(columns%label(), .not. range > 0.0_wp), pack(value, .not. range > 0.0_wp), 9)
    end associate
  end subroutine still_lines

  !> Says where a fixed step lay above the smallest current bound that was met. That may lie below the safe bound, which covers all
  !> directions of springs, but only the shapes of the start.
  subroutine compare_step(run, text)
    type(run_state), intent(in) :: run
    type(summary_record), intent(inout) :: text
    real(wp) :: share                          ! of the bound [-]
    associate (r => run%d%transient, monitor => run%monitor)
      share = actual_step(r%output_step, r%step)/monitor%smallest
      if (share <= 1.0_wp) return
      call text%warn('the step was '//fixed_text(share, 3)//' times the smallest current bound, at t = '// &
        short_text(monitor%at, 4)//' s, limited by '//trim(monitor%cause)//': what limits it grew slowly'// &
        either('; deflections changed the inertia of flexible bodies, which the safe bound of '//short_text(run%stable_step, 4)// &
               ' s does not count', '', monitor%smallest < 0.99_wp*run%stable_step .and. any(run%sys%m%s%bodies%flexible)))
    end associate
  end subroutine compare_step

  !> Warnings of the validity watch. A run that failed says nothing in its favour.
  subroutine validity_lines(run, status, text)
    type(run_state), intent(in) :: run
    integer, intent(in) :: status              !! of the run
    type(summary_record), intent(inout) :: text
    character(:), allocatable :: warnings, coarse
    real(wp) :: share(size(run%sys%m%s%bodies))   ! [-]
    integer :: b
    do b = 1, size(share)
      share(b) = run%watch%left_out(run%sys%m, b)
    end do
    b = maxloc(share, 1)
    if (share(b) > 0.0_wp .and. status /= status_failed) call text%line('  validity: the linear deflections of body "'// &
      '{left_out_of='//trim(run%sys%m%s%bodies(b)%name)//'}" leave out about {left_out_percent} % of the '// &
      'largest one (shortening, turns, loads along the axis)', [100*share(b)])
    warnings = run%watch%warnings(run%sys%m, run%sys%ev, '')//motion_outside_band(run)
    coarse = run%watch%too_coarse(run%sys%m, run%sys%ev)
    call text%warn(warnings, outside=.true.)
    call text%warn(coarse)
    if (len(warnings//coarse) > 0 .or. status == status_failed) return
    call text%line('  validity: spins and excited frequencies stay within what the model can tell')
  end subroutine validity_lines
end module transient_summary
