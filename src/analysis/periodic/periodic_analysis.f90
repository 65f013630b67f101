!> The periodic analysis (theory.md, section 15): the cycle that a driven machine settles into, its multipliers, its file and its
!> part of the summary. The state of the run is then the cycle's at t = 0, where the transient starts.
module periodic_analysis
  use kinds, only: wp
  use cycle_search, only: cycle_state
  use errors, only: failure, status_bad_input, status_failed
  use orbit_file, only: read_orbit, write_orbit
  use periodic_words, only: cycle_lines, no_cycle
  use scene_run, only: run_state
  use self_heating, only: heat_balance
  use summary_text, only: summary_record
  implicit none (type, external)
  private
  public :: run_periodic

contains

  !> Finds the cycle and its multipliers.
  subroutine run_periodic(run, text, fail)
    type(run_state), intent(inout) :: run
    type(summary_record), intent(inout) :: text
    type(failure), intent(inout) :: fail
    type(cycle_state) :: cycle
    type(heat_balance) :: heat
    real(wp), allocatable :: start(:)         ! (ny) [m, rad], [m/s, rad/s], [J]
    real(wp) :: period, now, before           ! [s]; largest error, of this and of the last number of steps [-]
    character(:), allocatable :: problem
    if (run%restart) then
      call run%turns%exchange(run%saved)
      if (run%saved%damaged) call fail%raise(status_bad_input, 'the checkpoint in "'//run%folder// &
                                             '" does not fit this deck; run without --restart')
      if (run%saved%complete()) run%restart = .false.         ! no transient had begun
      if (fail%happened()) return
    end if
    associate (p => run%d%periodic, accuracy => run%d%transient%accuracy)
      cycle%tolerance = p%tolerance
      if (accuracy > 0.0_wp .and. .not. p%own_tolerance) cycle%tolerance = 1.0e-3_wp*accuracy
      cycle%free_period = p%free_period
      cycle%most_turns = p%most_turns
      call cycle%line%begin(run%quiet, '')
      call cycle%map%begin(run)
      period = p%period
      if (len(run%orbit) > 0) call read_orbit(run, run%orbit, period, fail)
      if (fail%happened()) return
      start = run%y
      cycle%error = [real(wp) ::]
      call cycle%find_cycle(run, start, period)
      call heat%begin(run)
      if (cycle%found .and. size(heat%part) > 0) call heat%settle(run, cycle)
      if (cycle%found) call cycle%find_multipliers(run, p%multipliers)
      now = huge(1.0_wp)
      do while (cycle%found .and. (accuracy > 0.0_wp .or. run%d%transient%check_error))
        call cycle%halve_steps(run)
        if (cycle%found) call cycle%find_multipliers(run, p%multipliers)
        before = now
        now = maxval([cycle%start_error, cycle%error])
        if (now < accuracy .or. now > 0.5_wp*before .or. .not. accuracy > 0.0_wp) exit   ! what does not fall is rounding
      end do
    end associate
    if (cycle%found) call cycle%turn_again(run)
    call cycle%line%finish()
    fail = cycle%fail
    if (fail%happened()) return
    problem = no_cycle(run, cycle)
    if (len(problem) > 0) call fail%raise(status_failed, problem)
    if (fail%happened()) return
    call set_transient(run, cycle%period)
    run%y = cycle%turn%start
    call write_orbit(run, cycle%period, fail)
    call cycle_lines(run, cycle, heat, text, fail)
  end subroutine run_periodic

  !> The transient follows the cycle: a period that was sought has as many steps and rows as the deck asks of the guess.
  subroutine set_transient(run, period)
    type(run_state), intent(inout) :: run
    real(wp), intent(in) :: period            !! [s]
    real(wp) :: longer                        ! [-]
    if (.not. (run%d%periodic%free_period .and. run%d%periodic%one_period)) return
    associate (r => run%d%transient)
      longer = period/run%d%periodic%period
      r%t_end = period
      r%output_step = longer*r%output_step
      r%motion_step = longer*r%motion_step
      r%step = longer*r%step
    end associate
  end subroutine set_transient

end module periodic_analysis
