!> What the summary says of a transient: steps, evaluations, stable steps, what `accuracy_words` and the validity watch say.
module transient_summary
  use kinds, only: wp
  use accuracy_words, only: accuracy_lines
  use errors, only: status_failed
  use scene_run, only: run_state, warn
  use step_counts, only: actual_step
  use summary, only: add_line, add_warnings
  use text, only: es_text, fixed_text, to_text
  use transient, only: transient_march
  implicit none (type, external)
  private
  public :: transient_lines

contains

  !> The transient's part of the summary; warnings go to standard error too.
  subroutine transient_lines(run, march, status, text)
    type(run_state), intent(in) :: run
    type(transient_march), intent(in) :: march
    integer, intent(in) :: status              !! of the run (`errors`)
    character(:), allocatable, intent(inout) :: text
    if (.not. allocated(march%method)) return
    associate (r => run%d%transient, method => march%method, m => run%sys%m)
      call add_line(text, '')
      call add_line(text, 'transient')
      call add_line(text, '  method: '//trim(r%method)//', stabilization: '//trim(r%stabilization))
      if (r%adaptive) then
        call add_line(text, '  tolerance: '//es_text(r%tolerance, 3)//', accepted steps from '// &
                      es_text(min(method%shortest, method%longest), 3)//' to '//es_text(method%longest, 3)//' s')
      else
        call add_line(text, '  step: '//es_text(actual_step(r%output_step, r%step), 9)//' s')
      end if
      call add_line(text, '  reached: t = '//es_text(method%t, 9)//' s')
      call add_line(text, '  steps: '//to_text(method%steps)//', rejected: '//to_text(method%rejected))
      call add_line(text, '  evaluations: '//to_text(m%evaluations)//', banded solves: '//to_text(m%solves))
      if (len(method%account()) > 0) call add_line(text, '  '//method%account())
      if (run%monitor%smallest < huge(1.0_wp)) then
        call add_line(text, '  smallest current bound of the step: '//es_text(run%monitor%smallest, 4)//' s at t = '// &
                      es_text(run%monitor%at, 4)//' s ('//to_text(run%monitor%estimates)//' estimates)')
        if (.not. r%adaptive) call compare_step(run, text)
      end if
      if (len(march%warning) > 0) call warn(run, march%warning, text)
      if (r%motion_step > 0.0_wp) call motion_interval(run, text)
    end associate
    call accuracy_lines(run, march, status == status_failed, text)
    call validity_lines(run, text)
  end subroutine transient_lines

  !> Says where a fixed step lay above the smallest current bound that was met.
  subroutine compare_step(run, text)
    type(run_state), intent(in) :: run
    character(:), allocatable, intent(inout) :: text
    real(wp) :: share                          ! of the bound [-]
    associate (r => run%d%transient)
      share = actual_step(r%output_step, r%step)/run%monitor%smallest
    end associate
    if (share <= 1.0_wp) return
    call warn(run, 'the step was '//fixed_text(share, 3)//' times the smallest current bound: what limits it grew, '// &
              'if slowly', text)
  end subroutine compare_step

  !> Says how often the motion was written where that is not what the deck asks for: it goes with the rows of the history.
  subroutine motion_interval(run, text)
    type(run_state), intent(in) :: run
    character(:), allocatable, intent(inout) :: text
    real(wp) :: ratio
    associate (r => run%d%transient)
      ratio = r%motion_step/r%output_step
      if (ratio >= 1.0_wp .and. abs(ratio - anint(ratio)) <= 1.0e-9_wp*ratio) return
      call warn(run, 'motion_step ='//es_text(r%motion_step, 3)//' s is no multiple of output_step ='// &
                es_text(r%output_step, 3)//' s: motion.txt has a row every'// &
                es_text(max(1.0_wp, anint(ratio))*r%output_step, 3)//' s', text)
    end associate
  end subroutine motion_interval

  !> Warnings of the validity watch.
  subroutine validity_lines(run, text)
    type(run_state), intent(in) :: run
    character(:), allocatable, intent(inout) :: text
    character(:), allocatable :: warnings
    warnings = run%watch%warnings(run%sys%m, '')
    if (len(warnings) == 0) then
      call add_line(text, '  validity: deflections, spins and excited frequencies stay within what the model can tell')
    else
      call add_warnings(text, run%d%path, warnings)
    end if
  end subroutine validity_lines
end module transient_summary
