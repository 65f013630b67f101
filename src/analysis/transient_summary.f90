!> What the summary says of a transient: steps, evaluations, drift, and energy as a witness of how far to trust it.
module transient_summary
  use kinds, only: wp
  use posix, only: tell
  use scene_run, only: run_state
  use step_counts, only: actual_step
  use summary, only: add_line, add_warnings
  use text, only: es_text, fixed_text, to_text
  use transient, only: transient_march
  implicit none (type, external)
  private
  public :: transient_lines

contains

  !> The transient's part of the summary; warnings go to standard error too.
  subroutine transient_lines(run, march, text)
    type(run_state), intent(in) :: run
    type(transient_march), intent(in) :: march
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
    call witness(run, march, text)
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

  !> A warning, in the summary and on standard error.
  subroutine warn(run, words, text)
    type(run_state), intent(in) :: run
    character(*), intent(in) :: words
    character(:), allocatable, intent(inout) :: text
    call add_line(text, '  warning: '//words)
    call tell(run%d%path//': warning: '//words)
  end subroutine warn

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

  !> Drift, energy residual and what they say.
  subroutine witness(run, march, text)
    type(run_state), intent(in) :: run
    type(transient_march), intent(in) :: march
    character(:), allocatable, intent(inout) :: text
    real(wp) :: share, rest
    rest = sum(run%sys%m%s%bodies%mass)*(1.0e-6_wp*run%sys%m%s%size/run%d%transient%t_end)**2   ! a millionth of S in the run
    associate (f => march%files)
      call add_line(text, '  largest violations: position '//es_text(f%worst_position, 3)//' m ('// &
                    es_text(f%worst_position/run%sys%m%s%size, 3)//' of the size), velocity '// &
                    es_text(f%worst_velocity, 3)//' m/s')
      share = 0.0_wp
      if (f%largest_energy > 0.0_wp) share = f%largest_residual/f%largest_energy
      call add_line(text, '  energy residual: largest '//es_text(f%largest_residual, 3)//' J, at the end '// &
                    es_text(f%residual, 3)//' J; '//es_text(share, 3)//' of the largest energy, '// &
                    es_text(f%largest_energy, 3)//' J')
      if (run%d%transient%method == 'generalized_alpha') then
        call add_line(text, '  energy removed by the method itself: '//es_text(march%method%removed, 3)// &
                      ' J, numerical damping that the residual shows; without it the residual at the end: '// &
                      es_text(f%residual + march%method%removed, 3)//' J')
      end if
      if (.not. f%largest_energy > rest) share = 0.0_wp
      call add_line(text, '  trust: '//verdict(max(share, f%worst_position/run%sys%m%s%size), f%largest_energy > rest) &
                    //damped(march%method%removed, f%residual, f%largest_residual, share))
    end associate
  end subroutine witness

  !> The verdict on the larger of the relative energy residual and the relative drift. It bounds what the integration can
  !> have done to the energies, not the error of every single column: fast motion of little energy may be less accurate.
  function verdict(share, moves) result(text)
    real(wp), intent(in) :: share              !! [-]
    logical, intent(in) :: moves               !! whether there is any energy to speak of
    character(:), allocatable :: text
    character(:), allocatable :: number
    number = trim(adjustl(es_text(share, 1)))
    if (.not. moves .and. share <= 1.0e-8_wp) then
      text = 'no energy moves in this scene, so energy says nothing'
    else if (share <= 1.0e-8_wp) then
      text = 'energy and joints are kept to '//number//': the integration is as good as exact'
    else if (share <= 1.0e-4_wp) then
      text = 'energy and joints are kept to '//number//': the integration can be trusted at that level'
    else if (share <= 1.0e-2_wp) then
      text = 'energy and joints are kept to '//number//' only: good for pictures; accelerations and reactions need a '// &
             'smaller step or tolerance'
    else
      text = 'energy or joints are off by '//number//': the results cannot be trusted; use a smaller step or tolerance'
    end if
  end function verdict

  !> What the verdict adds where numerical damping explains most of the residual.
  function damped(removed, residual, largest, share) result(text)
    real(wp), intent(in) :: removed            !! by the method itself [J]
    real(wp), intent(in) :: residual, largest  !! of the energy, at the end and largest [J]
    real(wp), intent(in) :: share              !! largest, of the largest energy [-]
    character(:), allocatable :: text
    text = ''
    if (share <= 1.0e-8_wp .or. abs(residual) < 0.5_wp*largest) return
    if (abs(residual + removed) > 0.2_wp*abs(residual)) return
    text = '; most of that is numerical damping of vibrations that the steps do not resolve: slower motion may be better'
  end function damped

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
