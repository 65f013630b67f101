!> What the summary says of a transient: steps, evaluations, drift, and energy as a witness of how far to trust it.
module transient_summary
  use kinds, only: wp
  use scene_run, only: run_state
  use summary, only: add_line
  use time_stepper, only: step_count
  use transient, only: transient_march
  use, intrinsic :: iso_fortran_env, only: error_unit
  implicit none (type, external)
  private
  public :: transient_lines

contains

  !> The transient's part of the summary; warnings go to standard error too.
  subroutine transient_lines(run, march, text)
    type(run_state), intent(in) :: run
    type(transient_march), intent(in) :: march
    character(:), allocatable, intent(inout) :: text
    character(200) :: line
    if (.not. allocated(march%method)) return
    associate (r => run%d%transient, method => march%method, m => run%sys%m)
      call add_line(text, '')
      call add_line(text, 'transient')
      call add_line(text, '  method: '//trim(r%method)//', stabilization: '//trim(r%stabilization))
      if (r%adaptive) then
        write (line, '(a, es10.3, a, es10.3, a, es10.3, a)') '  tolerance: ', r%tolerance, ', accepted steps from ', &
          min(method%shortest, method%longest), ' to ', method%longest, ' s'
      else
        write (line, '(a, es16.9, a)') '  step: ', r%output_step/real(step_count(r%output_step, r%step), wp), ' s'
      end if
      call add_line(text, trim(line))
      write (line, '(a, es16.9, a)') '  reached: t = ', method%t, ' s'
      call add_line(text, trim(line))
      write (line, '(a, i0, a, i0)') '  steps: ', method%steps, ', rejected: ', method%rejected
      call add_line(text, trim(line))
      write (line, '(a, i0, a, i0)') '  evaluations: ', m%evaluations, ', banded solves: ', m%solves
      call add_line(text, trim(line))
      if (len(method%account()) > 0) call add_line(text, '  '//method%account())
      if (run%monitor%smallest < huge(1.0_wp)) then
        write (line, '(a, es11.4, a, es11.4, a, i0, a)') '  smallest current bound of the step: ', run%monitor%smallest, &
          ' s at t = ', run%monitor%at, ' s (', run%monitor%estimates, ' estimates)'
        call add_line(text, trim(line))
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
    character(12) :: number
    real(wp) :: share                          ! of the bound [-]
    associate (r => run%d%transient)
      share = r%output_step/real(step_count(r%output_step, r%step), wp)/run%monitor%smallest
    end associate
    if (share <= 1.0_wp) return
    write (number, '(f12.3)') min(share, 1.0e6_wp)
    call warn(run, 'the step was '//trim(adjustl(number))//' times the smallest current bound: what limits it grew, '// &
              'if slowly', text)
  end subroutine compare_step

  !> A warning, in the summary and on standard error.
  subroutine warn(run, words, text)
    type(run_state), intent(in) :: run
    character(*), intent(in) :: words
    character(:), allocatable, intent(inout) :: text
    call add_line(text, '  warning: '//words)
    write (error_unit, '(a)') run%d%path//': warning: '//words
  end subroutine warn

  !> Says how often the motion was written where that is not what the deck asks for: it goes with the rows of the history.
  subroutine motion_interval(run, text)
    type(run_state), intent(in) :: run
    character(:), allocatable, intent(inout) :: text
    character(160) :: line
    real(wp) :: ratio
    associate (r => run%d%transient)
      ratio = r%motion_step/r%output_step
      if (ratio >= 1.0_wp .and. abs(ratio - anint(ratio)) <= 1.0e-9_wp*ratio) return
      write (line, '(a, es10.3, a, es10.3, a, es10.3, a)') 'motion_step =', r%motion_step, ' s is no multiple of output_step =', &
        r%output_step, ' s: motion.txt has a row every', max(1.0_wp, anint(ratio))*r%output_step, ' s'
    end associate
    call warn(run, trim(line), text)
  end subroutine motion_interval

  !> Drift, energy residual and what they say.
  subroutine witness(run, march, text)
    type(run_state), intent(in) :: run
    type(transient_march), intent(in) :: march
    character(:), allocatable, intent(inout) :: text
    character(200) :: line
    real(wp) :: share, rest
    rest = sum(run%sys%m%s%bodies%mass)*(1.0e-6_wp*run%sys%m%s%size/run%d%transient%t_end)**2   ! a millionth of S in the run
    associate (f => march%files)
      write (line, '(a, es10.3, a, es10.3, a, es10.3, a)') '  largest violations: position ', f%worst_position, ' m (', &
        f%worst_position/run%sys%m%s%size, ' of the size), velocity ', f%worst_velocity, ' m/s'
      call add_line(text, trim(line))
      share = 0.0_wp
      if (f%largest_energy > 0.0_wp) share = f%largest_residual/f%largest_energy
      write (line, '(a, es10.3, a, es10.3, a, es10.3, a, es10.3, a)') '  energy residual: largest ', f%largest_residual, &
        ' J, at the end ', f%residual, ' J; ', share, ' of the largest energy, ', f%largest_energy, ' J'
      call add_line(text, trim(line))
      if (run%d%transient%method == 'generalized_alpha') then
        write (line, '(a, es10.3, a, es10.3, a)') '  energy removed by the method itself: ', march%method%removed, &
          ' J, numerical damping that the residual shows; without it the residual at the end: ', &
          f%residual + march%method%removed, ' J'
        call add_line(text, trim(line))
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
    character(16) :: number
    write (number, '(es9.1)') share
    number = adjustl(number)
    if (.not. moves .and. share <= 1.0e-8_wp) then
      text = 'no energy moves in this scene, so energy says nothing'
    else if (share <= 1.0e-8_wp) then
      text = 'energy and joints are kept to '//trim(number)//': the integration is as good as exact'
    else if (share <= 1.0e-4_wp) then
      text = 'energy and joints are kept to '//trim(number)//': the integration can be trusted at that level'
    else if (share <= 1.0e-2_wp) then
      text = 'energy and joints are kept to '//trim(number)//' only: good for pictures; accelerations and reactions need a '// &
             'smaller step or tolerance'
    else
      text = 'energy or joints are off by '//trim(number)//': the results cannot be trusted; use a smaller step or tolerance'
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
    integer :: from, to
    warnings = run%watch%warnings(run%sys%m)
    if (len(warnings) == 0) then
      call add_line(text, '  validity: deflections, spins and excited frequencies stay within what the model can tell')
    else
      text = text//warnings
      from = 1
      do while (from <= len(warnings))
        to = from + index(warnings(from:), new_line('a')) - 2
        write (error_unit, '(a)') run%d%path//': '//warnings(from:to)
        from = to + 2
      end do
    end if
  end subroutine validity_lines
end module transient_summary
