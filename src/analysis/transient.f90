!> The transient analysis with a fixed-step explicit method: marches, projects, writes rows, and stops at the last good
!> time when the solution is lost.
module transient
  use kinds, only: wp, ip
  use errors, only: failure, status_failed, status_no_output, status_signal
  use mechanism_ode, only: mechanism_system, stabilise_none, stabilise_projection, stabilise_baumgarte
  use posix, only: catch_signals, caught_signal
  use progress, only: progress_line
  use projection, only: worst_constraint
  use results, only: result_set
  use runge_kutta, only: explicit_stepper, classical_rk4
  use scene_run, only: run_state
  use step_monitor, only: stability_monitor
  implicit none (type, external)
  private
  public :: run_transient, transient_report, step_layout

  !> What a transient did, for the summary.
  type :: transient_report
    logical :: done = .false.
    integer(ip) :: steps = 0              !! accepted
    integer(ip) :: rejected = 0
    integer(ip) :: evaluations = 0        !! right-hand sides
    integer(ip) :: solves = 0             !! banded solves
    real(wp) :: step = 0.0_wp             !! the fixed step used [s]
    real(wp) :: t = 0.0_wp                !! last good time [s]
    real(wp) :: residual = 0.0_wp         !! largest energy residual [J]
    real(wp) :: energy = 0.0_wp           !! largest energy [J]
    real(wp) :: position = 0.0_wp         !! largest violation [m]
    real(wp) :: velocity = 0.0_wp         !! [m/s]
    real(wp) :: seconds = 0.0_wp          !! wall time of the march [s]
  end type transient_report

contains

  !> Number of steps in an output interval: the fixed step is output_step/ceiling(output_step/step) (deck.md).
  pure function step_layout(interval, step) result(n)
    real(wp), intent(in) :: interval      !! [s]
    real(wp), intent(in) :: step          !! as written in the deck [s]
    integer(ip) :: n
    n = max(1_ip, ceiling(interval/step*(1.0_wp - 1.0e-12_wp), ip))
  end function step_layout

  !> Runs the deck's transient from the present state.
  subroutine run_transient(run, report, fail)
    type(run_state), intent(inout) :: run
    type(transient_report), intent(inout) :: report
    type(failure), intent(inout) :: fail
    type(result_set) :: files
    type(explicit_stepper) :: stepper
    type(progress_line) :: line
    integer(ip) :: k, outputs
    real(wp) :: t0, t1
    logical :: ok
    associate (r => run%d%transient)
      call choose_stabilisation(run)
      call stepper%prepare(classical_rk4(), run%sys%n)
      call files%open(run%folder, run%d%name, run%sys%m, run%list, r%motion_step > 0.0_wp)
      if (files%failed()) call fail%raise(status_no_output, 'results cannot be written into "'//run%folder//'"')
      if (fail%happened()) return
      outputs = max(1_ip, ceiling(r%t_end/r%output_step*(1.0_wp - 1.0e-12_wp), ip))
      report%step = r%output_step/real(step_layout(r%output_step, r%step), wp)
      call run%watch%begin(run%sys%m)
      call run%monitor%begin(run%d, run%sys%m, run%y(1:run%sys%m%s%nq), r%method)
      call catch_signals()
      call line%begin(run%quiet)
      call run%sys%derivative(0.0_wp, run%y, .false., stepper%k(:, 1))
      call write_state(run, files, 0.0_wp, 0_ip)
      do k = 1, outputs
        t0 = real(k - 1, wp)*r%output_step
        t1 = min(real(k, wp)*r%output_step, r%t_end)
        if (abs(t1 - r%t_end) <= 1.0e-9_wp*r%output_step) t1 = merge(r%t_end, t1, k == outputs)
        call march(run%sys, run%monitor, stepper, t0, t1, step_layout(t1 - t0, r%step), run%y, report, ok)
        if (.not. ok) then
          call explain(run%sys, report%t, fail)
          exit
        end if
        call write_state(run, files, t1, k)
        call line%report(t1, r%t_end)
        if (files%failed()) call fail%raise(status_no_output, 'results cannot be written into "'//run%folder//'"')
        if (caught_signal() > 0) call fail%raise(status_signal + caught_signal(), 'stopped by a signal')
        if (fail%happened()) exit
      end do
      call line%finish()
      call files%close()
      if (files%failed()) call fail%raise(status_no_output, 'results cannot be written into "'//run%folder//'"')
    end associate
    call fill_report(run, files, report, .not. fail%happened())
  end subroutine run_transient

  !> How the deck wants constraints kept.
  subroutine choose_stabilisation(run)
    type(run_state), intent(inout) :: run
    select case (run%d%transient%stabilization)
    case ('projection')
      run%sys%stabilisation = stabilise_projection
    case ('baumgarte')
      run%sys%stabilisation = stabilise_baumgarte
      run%sys%m%baumgarte = [run%d%transient%baumgarte_alpha, run%d%transient%baumgarte_beta]
    case default
      run%sys%stabilisation = stabilise_none
    end select
  end subroutine choose_stabilisation

  !> Marches n equal steps from t0 to t1; the stepper's first stage holds the derivative at the present state.
  subroutine march(sys, monitor, stepper, t0, t1, n, y, report, ok)
    type(mechanism_system), intent(inout) :: sys
    type(stability_monitor), intent(inout) :: monitor
    type(explicit_stepper), intent(inout) :: stepper
    real(wp), intent(in) :: t0, t1        !! [s]
    integer(ip), intent(in) :: n
    real(wp), intent(inout) :: y(:)
    type(transient_report), intent(inout) :: report
    logical, intent(out) :: ok
    real(wp) :: h, t
    integer(ip) :: i
    h = (t1 - t0)/real(n, wp)
    do i = 1, n
      call stepper%step(sys, t0 + real(i - 1, wp)*h, h, y)
      t = merge(t1, t0 + real(i, wp)*h, i == n)
      call sys%accept(t, y, ok)
      if (.not. ok) return
      call sys%derivative(t, y, .false., stepper%k(:, 1))
      report%steps = report%steps + 1
      report%t = t
      if (monitor%active) then
        if (mod(report%steps, int(monitor%every, ip)) == 0) call monitor%look(sys%m, t)
      end if
    end do
  end subroutine march

  !> Writes the rows of a state whose evaluation has just been made.
  subroutine write_state(run, files, t, k)
    type(run_state), intent(inout) :: run
    type(result_set), intent(inout) :: files
    real(wp), intent(in) :: t             !! [s]
    integer(ip), intent(in) :: k          !! number of the output
    integer :: nq, nz
    integer(ip) :: every
    nq = run%sys%m%s%nq
    nz = run%sys%m%s%nz
    associate (y => run%y)
      call run%watch%look(run%sys%m, y(1:nq), y(nq + 1:2*nq))
      call files%write_row(t, run%sys%m, run%list, y(1:nq), y(nq + 1:2*nq), y(2*nq + 1:2*nq + nz), &
                           y(2*nq + nz + 1:2*nq + 2*nz), y(2*nq + 2*nz + 1), y(2*nq + 2*nz + 2))
      if (run%d%transient%motion_step <= 0.0_wp) return
      every = max(1_ip, nint(run%d%transient%motion_step/run%d%transient%output_step, ip))
      if (mod(k, every) == 0) call files%write_motion(t, run%sys%m, y(1:nq))
    end associate
  end subroutine write_state

  !> Why the march stopped.
  subroutine explain(sys, t, fail)
    type(mechanism_system), intent(in) :: sys
    real(wp), intent(in) :: t             !! last good time [s]
    type(failure), intent(inout) :: fail
    character(24) :: text
    write (text, '(es13.6)') t
    if (sys%m%s%rows > 0 .and. .not. sys%m%broken .and. all(abs(sys%m%p%r) <= 1.0e150_wp)) then
      call fail%raise(status_failed, 'the joints cannot be kept closed after t = '//trim(adjustl(text))//' s: "'// &
                      worst_constraint(sys%m)//'" opens most. A drive may demand the impossible there, or the step '// &
                      'is too large; try a smaller step')
    else
      call fail%raise(status_failed, 'the solution diverged after t = '//trim(adjustl(text))//' s; the step is '// &
                      'probably unstable: try a smaller one')
    end if
  end subroutine explain

  !> Figures of the run for the summary.
  subroutine fill_report(run, files, report, done)
    type(run_state), intent(in) :: run
    type(result_set), intent(in) :: files
    type(transient_report), intent(inout) :: report
    logical, intent(in) :: done
    report%done = done
    report%evaluations = run%sys%m%evaluations
    report%solves = run%sys%m%solves
    report%residual = files%largest_residual
    report%energy = files%largest_energy
    report%position = files%worst_position
    report%velocity = files%worst_velocity
  end subroutine fill_report
end module transient
