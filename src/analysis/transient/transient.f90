!> The transient analysis: lets a method march from output to output, writes rows and checkpoints, and stops at the last
!> good time when the solution is lost or a signal comes.
module transient
  use kinds, only: wp, ip
  use accuracy_ladder, only: pass_ladder
  use archive, only: value_archive
  use checkpoint, only: write_checkpoint
  use column_ranges, only: column_range
  use choose_stepper, only: make_stepper
  use energy_balance, only: balance_watch, distrusted
  use error_groups, only: group_unknowns, out_of_shape
  use errors, only: failure, status_ok, status_failed, status_bad_input, status_signal
  use force_scale, only: largest_force
  use linear_state, only: refuse_uneven
  use march_failure, only: explain_loss, explain_balance, explain_shape, explain_drift
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  use pair_forces, only: pair_watch
  use posix, only: caught_signal
  use progress, only: progress_line
  use result_columns, only: motion_row
  use results, only: pass_suffix, result_set
  use run_summary, only: announce
  use scene_run, only: run_state, no_output
  use sensors, only: read_sensors
  use stored_pass, only: pass_rows
  use step_control, only: error_norm
  use step_counts, only: actual_step, step_count
  use text, only: short_text, to_text
  use time_stepper, only: stepper, paused, diverged, trouble_shape
  use turn_log, only: exchange_turns
  implicit none (type, external)
  private
  public :: run_transient

  integer, parameter :: steps_per_call = 64    !! steps between checks for signals and due checkpoints

  !> A transient that is running, with figures for the summary.
  type, public :: transient_march
    class(stepper), allocatable :: method
    type(result_set) :: files
    type(balance_watch) :: balance
    type(column_range) :: seen                 !! values of all columns
    type(pair_watch) :: pairs                  !! contact forces of joints on profiles
    type(error_norm) :: norm                   !! largest values so far, to name what grows
    integer(ip) :: outputs = 0                 !! output intervals of the run
    integer(ip) :: done = 0                    !! of them done
    real(wp) :: last = 0.0_wp                  !! time of the last row [s]
    real(wp) :: saved = 0.0_wp                 !! time of the last checkpoint [s]
    integer :: restarts = 0
    type(pass_ladder) :: ladder                !! where the deck asks for an accuracy, or for errors
    type(pass_rows) :: rows                    !! of a run that is compared with another one
    logical :: pilot = .false.                 !! a question about the model: no files, no checkpoint
    real(wp) :: budget = huge(1.0_wp)          !! cost at which the run is given up, in explicit evaluations [-]
    logical :: stopped = .false.               !! it was
  contains
    procedure :: cost
    procedure :: exchange
  end type transient_march

contains

  !> Runs the deck's transient from the present state, or from the checkpoint that run%saved holds.
  subroutine run_transient(run, march, fail)
    type(run_state), intent(inout) :: run
    type(transient_march), intent(inout) :: march
    type(failure), intent(inout) :: fail
    type(progress_line) :: line
    call prepare(run, march, fail)
    if (fail%happened()) return
    if (run%restart) then
      call continue_run(run, march, fail)
    else
      call start_run(run, march, fail)
    end if
    if (march%ladder%active .and. any(fail%status == [status_ok, status_failed])) call name_last_pass(run, march, fail)
    if (.not. fail%happened()) then
      call line%begin(run%quiet, march%ladder%words())
      do while (march%done < march%outputs)
        call one_output(run, march, fail)
        if (fail%happened() .or. march%stopped) exit
        call line%report(march%last, run%d%transient%t_end)
      end do
      call line%finish()
    end if
    call march%files%close()
    if (march%files%failed()) call no_output(run, fail)
  end subroutine run_transient

  !> Method, groups and estimates, as they are before the first step.
  subroutine prepare(run, march, fail)
    type(run_state), intent(inout) :: run
    type(transient_march), intent(inout) :: march
    type(failure), intent(inout) :: fail
    integer :: k
    associate (r => run%d%transient, s => run%sys%m%s)
      run%sys%has_manifold = r%stabilization == 'projection' .and. s%rows > 0
      if (r%stabilization == 'baumgarte') run%sys%options%baumgarte = [r%baumgarte_alpha, r%baumgarte_beta]
      if (.not. r%adaptive) run%monitor%step = actual_step(r%output_step, r%step)
      call run%monitor%begin(run%sys%m, run%sys%ev, run%y(1:s%nq), r%method)
      call make_stepper(r, s, run%monitor%fastest, march%method)
      call group_unknowns(s, march%norm)
      march%outputs = step_count(0.0_wp, r%t_end, r%output_step)
      call march%balance%begin(run%sys%m, r%t_end)
      call run%watch%begin(run%sys%m)
      call march%seen%begin(run%list%columns)
      call march%pairs%begin(pack([(k, k=1, size(run%d%joints))], run%d%joints%profile > 0))
      call refuse_uneven(run, 'transient', status_failed, fail)
      if (fail%happened()) return
      run%sys%output_step = r%output_step
      call run%sys%start_switching(0.0_wp, run%y, given=run%d%periodic%present)
      call march%method%begin(run%sys, 0.0_wp, run%y)
      if (march%ladder%count > merge(1, 0, march%ladder%estimates)) march%files%suffix = pass_suffix(march%ladder%count)
    end associate
  end subroutine prepare

  !> Opens the result files and writes the row of t = 0.
  subroutine start_run(run, march, fail)
    type(run_state), intent(inout) :: run
    type(transient_march), intent(inout) :: march
    type(failure), intent(inout) :: fail
    call march%files%open(run%folder, run%d%name, run%sys%m, run%list, run%d%transient%motion_step > 0.0_wp)
    if (march%files%failed()) call no_output(run, fail)
    if (.not. fail%happened()) call write_state(run, march, 0.0_wp, 0_ip, fail)
    if (fail%happened() .or. .not. march%ladder%active) return
    if (run%d%transient%checkpoint_interval > 0.0_wp .or. march%restarts > 0) call save(run, march, fail)
  end subroutine start_run

  !> Renames the files of the pass before to their final names, if it is the best so far. A checkpoint of that pass refers to the
  !> old names: so there must be a checkpoint of this pass first.
  subroutine name_last_pass(run, march, fail)
    type(run_state), intent(in) :: run
    type(transient_march), intent(in) :: march
    type(failure), intent(inout) :: fail
    logical :: ok
    associate (last => march%ladder%count - 1)
      if (last == 0 .or. march%ladder%delivered() /= last) return
      call march%files%publish(run%folder, pass_suffix(last), ok)
      if (.not. ok) call no_output(run, fail)
    end associate
  end subroutine name_last_pass

  !> Continues an interrupted run: its state, and its files cut to the rows of the checkpoint.
  subroutine continue_run(run, march, fail)
    type(run_state), intent(inout) :: run
    type(transient_march), intent(inout) :: march
    type(failure), intent(inout) :: fail
    character(:), allocatable :: delivered     ! how the names of files of the pass before end, where they are to be kept
    call march%exchange(run, run%saved)
    if (.not. run%saved%complete()) then
      call fail%raise(status_bad_input, 'the checkpoint in "'//run%folder//'" does not fit this deck; run without --restart')
      return
    end if
    march%restarts = march%restarts + 1
    delivered = ''
    associate (last => march%ladder%count - 1)
      if (last > 0 .and. march%ladder%delivered() == last) delivered = pass_suffix(last)
    end associate
    call march%files%resume(run%folder, delivered, run%sys%m, run%list, run%d%transient%motion_step > 0.0_wp)
    if (march%files%incomplete) then
      call fail%raise(status_bad_input, 'the results in "'//run%folder//'" are missing, cut off or changed since its '// &
                      'checkpoint; run without --restart to start at t = 0')
    else if (march%files%failed()) then
      call no_output(run, fail)
    end if
    if (.not. fail%happened()) call announce(run, fail)
  end subroutine continue_run

  !> Marches to the next output time and writes its row.
  subroutine one_output(run, march, fail)
    type(run_state), intent(inout) :: run
    type(transient_march), intent(inout) :: march
    type(failure), intent(inout) :: fail
    real(wp) :: from, to
    integer :: outcome
    associate (r => run%d%transient)
      from = real(march%done, wp)*r%output_step
      to = min(real(march%done + 1, wp)*r%output_step, r%t_end)
      if (march%done + 1 == march%outputs) to = r%t_end
      outcome = paused
      do while (outcome == paused)
        call one_portion(run, march, from, to, outcome)
        if (march%pilot .or. march%ladder%active) then
          march%stopped = run%late() .and. (march%pilot .or. march%ladder%delivered() > 0)
          if (march%cost(run) > march%budget) march%stopped = .true.
          if (march%ladder%active) call march%ladder%look(march%cost(run), march%method%t, march%stopped)
        end if
        if (march%stopped .and. outcome == paused) return
        if (outcome == paused) call interrupt(run, march, fail)
        if (fail%happened()) return
      end do
      if (outcome == diverged) then
        if (march%method%trouble == trouble_shape) call march%norm%watch(march%method%trial)
        call explain_loss(run, march%norm, march%method, march%last, fail)
        return
      end if
      call write_state(run, march, to, march%done + 1, fail)
      if (fail%happened()) return
      march%done = march%done + 1
      if (march%done == march%outputs) march%stopped = .false.
      if (march%done == march%outputs) return
      if (.not. march%stopped) call interrupt(run, march, fail)
    end associate
  end subroutine one_output

  !> A few steps, up to the next estimate of the current stability bound at most.
  subroutine one_portion(run, march, from, to, outcome)
    type(run_state), intent(inout) :: run
    type(transient_march), intent(inout) :: march
    real(wp), intent(in) :: from, to           !! [s]
    integer, intent(out) :: outcome
    integer :: most                            ! accepted steps
    associate (monitor => run%monitor, method => march%method)
      most = steps_per_call
      if (monitor%active) most = int(min(int(most, ip), monitor%next - method%steps))
      call method%advance(run%sys, from, to, most, run%y, outcome)
      if (outcome == diverged .or. .not. monitor%active) return
      if (method%steps == monitor%next) call monitor%estimate(run%sys%m, run%sys%ev, run%sys%ev%t, method%steps)
    end associate
  end subroutine one_portion

  !> Writes the rows of a state whose evaluation has just been made, unless its energies say that it is lost.
  subroutine write_state(run, march, t, k, fail)
    type(run_state), intent(inout) :: run
    type(transient_march), intent(inout) :: march
    real(wp), intent(in) :: t                  !! [s]
    integer(ip), intent(in) :: k               !! number of the output
    type(failure), intent(inout) :: fail
    integer(ip) :: every
    associate (y => run%y, nq => run%sys%m%s%nq, files => march%files, r => run%d%transient)
      call read_sensors(run%list, run%sys%m, run%sys%ev, y, files%values)
      call march%balance%read(run%sys%m, run%sys%ev, y, k == 0)
      ! what the largest force of the start could give the whole mass until the next row: from rest there is no other scale that
      ! separates a first row with a large error from a lost one
      if (k == 0) march%balance%reachable = 0.5_wp*(largest_force(run%sys%m, run%sys%ev)*r%output_step)**2/ &
                                            sum(run%sys%m%s%bodies%mass)
      call check_row(run, march, t, fail)
      if (fail%happened()) return
      call march%balance%count(march%method%steps)
      call march%seen%note(files%values)
      call march%pairs%note(run%sys%m, run%sys%ev, t)
      if (allocated(march%rows%values)) then
        if (size(files%values) > 0) then
          call march%rows%note(k, files%values, run%sys%events)
        else
          call march%rows%note(k, motion_row(run%sys%m, y(1:nq)), run%sys%events)
        end if
      end if
      call run%watch%note(run%sys%m, run%sys%ev, y(1:nq), y(nq + 1:2*nq))
      call files%write_row(t, march%balance%row(:march%balance%columns))
      call files%write_events(run%sys%m, run%sys%events)
      march%last = t
      if (r%motion_step > 0.0_wp) then
        every = max(1_ip, nint(r%motion_step/r%output_step, ip))
        if (mod(k, every) == 0) call files%write_motion(t, run%sys%m, y(1:nq))
      end if
      if (files%failed()) call no_output(run, fail)
    end associate
  end subroutine write_state

  !> What the run has cost so far, in explicit evaluations.
  pure real(wp) function cost(self, run)
    class(transient_march), intent(in) :: self
    type(run_state), intent(in) :: run
    cost = run%sys%ev%evaluations + self%method%implicit_work()   ! [-]
  end function cost

  !> Checks the row just read: energies, shapes and joints show whether the solution is lost.
  subroutine check_row(run, march, t, fail)
    type(run_state), intent(inout) :: run
    type(transient_march), intent(inout) :: march
    real(wp), intent(in) :: t                  !! [s]
    type(failure), intent(inout) :: fail
    integer :: b
    associate (balance => march%balance, s => run%sys%m%s)
      if (balance%diverged()) then
        call explain_balance(run, march%norm, t, march%last, balance%row(5), balance%largest_balanced, fail)
      else if (balance%row(6) > distrusted*s%size) then
        call explain_drift(run, t, march%last, fail)
      else
        call march%norm%watch(run%y)
        b = out_of_shape(march%norm, size(s%bodies))
        if (b > 0) call explain_shape(run, b, t, march%last, fail)
      end if
    end associate
  end subroutine check_row

  !> Between two portions: a checkpoint where one is due or a signal has come, which ends the run.
  subroutine interrupt(run, march, fail)
    type(run_state), intent(inout) :: run
    type(transient_march), intent(inout) :: march
    type(failure), intent(inout) :: fail
    integer :: signal
    logical :: due
    signal = caught_signal()
    due = run%d%transient%checkpoint_interval > 0.0_wp
    if (due) due = march%method%t >= march%saved + run%d%transient%checkpoint_interval
    if (.not. (due .or. signal > 0)) return
    if (march%pilot) then
      call fail%raise(status_signal + signal, 'a signal stopped a pilot')
      return
    end if
    call save(run, march, fail)
    if (signal == 0) return
    call fail%raise(status_signal + signal, 'stopped by signal '//to_text(signal)// &
                    ' at t = '//short_text(march%method%t, 6)//' s; biela --restart continues from there')
  end subroutine interrupt

  !> Puts the results on the disk, then a checkpoint that refers to them.
  subroutine save(run, march, fail)
    type(run_state), intent(inout) :: run
    type(transient_march), intent(inout) :: march
    type(failure), intent(inout) :: fail
    type(value_archive) :: a
    logical :: ok
    call march%files%sync()
    ok = .not. march%files%failed()
    if (ok) then
      march%saved = march%method%t
      call a%begin_saving()
      if (run%model_found) call run%exchange_model(a)
      if (run%d%periodic%present) call exchange_turns(run%turns, a)
      call march%ladder%exchange(a)
      call march%rows%exchange(a)
      call march%exchange(run, a)
      call write_checkpoint(run%folder, run%d%text, run%d%settings, a, ok)
    end if
    if (.not. ok) call no_output(run, fail)
  end subroutine save

  !> Saves or restores everything that the rest of the run depends on.
  subroutine exchange(self, run, a)
    class(transient_march), intent(inout) :: self
    type(run_state), intent(inout) :: run
    type(value_archive), intent(inout) :: a
    call a%exchange(self%restarts, self%done, self%last, self%saved)
    call a%exchange(run%y)
    call self%method%exchange(a)
    call run%sys%exchange_switches(a)
    call a%exchange(self%norm%largest)
    call self%files%exchange(a)
    call self%balance%exchange(a)
    call self%seen%exchange(a)
    call self%pairs%exchange(a)
    call a%exchange(run%watch%figures)
    call a%exchange(run%watch%axial%worst)
    call a%exchange(run%watch%axial%latest)
    associate (x => run%monitor)
      call a%exchange(x%estimates, x%next, x%latest, x%smallest, x%at, x%cause)
    end associate
    call a%exchange(run%sys%ev%evaluations, run%sys%ev%solves, run%sys%ev%factorisations, run%sys%ev%schur%was_ill_conditioned)
  end subroutine exchange
end module transient
