!> The periodic analysis (theory.md, section 15): the cycle that a driven machine settles into, its multipliers, its file and its
!> part of the summary. The state of the run is then the cycle's at t = 0, where the transient starts.
module periodic_analysis
  use kinds, only: wp
  use cycle_search, only: cycle_state
  use deck_tables, only: read_columns
  use errors, only: failure, status_bad_input, status_failed
  use periodic_words, only: cycle_lines, no_cycle
  use readable_text, only: lf, one_line
  use scene_run, only: run_state, no_output
  use self_heating, only: heat_balance
  use summary_text, only: summary_record
  use text, only: joined, to_text
  use text_file, only: result_file
  use turn_log, only: exchange_turns
  use whole_file, only: read_file
  implicit none (type, external)
  private
  public :: run_periodic

  character(*), parameter :: orbit = '/orbit.txt'   !! the state at t = 0, from which the search of another cycle may start

contains

  !> Finds the cycle and its multipliers.
  subroutine run_periodic(run, text, fail)
    type(run_state), intent(inout) :: run
    type(summary_record), intent(inout) :: text
    type(failure), intent(inout) :: fail
    type(cycle_state) :: cycle
    type(heat_balance) :: heat
    real(wp) :: now, before                   ! largest error, of this and of the last number of steps [-]
    real(wp) :: longer                        ! [-]
    character(:), allocatable :: problem
    call run%turns%begin_saving()
    if (run%restart) then
      call exchange_turns(run%turns, run%saved)
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
      cycle%turn%period = p%period
      if (len(run%orbit) > 0) call read_orbit(run, run%orbit, cycle%turn%period, fail)
      if (fail%happened()) return
      cycle%turn%start = run%y
      cycle%error = [real(wp) ::]
      call cycle%find_cycle(run)
      if (cycle%found) call cycle%shorten(run)
      call heat%begin(run)
      if (cycle%found .and. size(heat%part) > 0) call heat%settle(run, cycle)
      if (cycle%found .and. run%d%transient%check_error .and. .not. accuracy > 0.0_wp) call finer()
      now = huge(1.0_wp)
      do while (cycle%found)
        call cycle%find_multipliers(run, p%multipliers)
        if (.not. cycle%found) exit
        if (p%multipliers > 0 .or. accuracy > 0.0_wp .or. run%d%transient%check_error) call cycle%find_errors(run)
        before = now
        now = maxval([cycle%start_error, cycle%error])
        if (now < accuracy .or. now > 0.5_wp*before .or. .not. accuracy > 0.0_wp) exit   ! what does not fall is rounding
        call finer()
      end do
    end associate
    if (cycle%found .and. .not. cycle%fail%happened()) call cycle%turn_again(run)
    call cycle%line%finish()
    fail = cycle%fail
    if (fail%happened()) return
    problem = no_cycle(run, cycle)
    if (len(problem) > 0) call fail%raise(status_failed, problem)
    if (fail%happened()) return
    if (run%d%periodic%free_period .and. run%d%periodic%one_period) then   ! as many steps and rows as the deck asks of the guess
      associate (r => run%d%transient)
        longer = cycle%turn%period/run%d%periodic%period
        r%t_end = cycle%turn%period
        r%output_step = longer*r%output_step
        r%motion_step = longer*r%motion_step
        r%step = longer*r%step
      end associate
    end if
    run%y = cycle%turn%start
    call write_orbit(run, cycle%turn%period, fail)
    call cycle_lines(run, cycle, heat, text, fail)
  contains
    !> The cycle of twice as many steps.
    subroutine finer()
      cycle%map%steps = 2*cycle%map%steps
      call cycle%go_on(run)
    end subroutine finer
  end subroutine run_periodic

  !> The line by which a file is known to belong to a scene.
  function heading(run) result(line)
    type(run_state), intent(in) :: run
    character(:), allocatable :: line
    line = '# unknowns: '//to_text(run%sys%m%s%ny)//' of bodies '//one_line(joined(run%sys%m%s%bodies%name, ' '))
  end function heading

  !> Writes the present state.
  subroutine write_orbit(run, period, fail)
    type(run_state), intent(in) :: run
    real(wp), intent(in) :: period            !! [s]
    type(failure), intent(inout) :: fail
    type(result_file) :: file
    integer :: k
    call file%open(run%folder//orbit)
    call file%head('state of a cycle at t = 0, after its period', run%d%name, run%sys%m%s%title)
    call file%line(heading(run))
    call file%line('# columns: number[-] value[-]')
    call file%row([0.0_wp, period])
    do k = 1, size(run%y)
      call file%row([real(k, wp), run%y(k)])
    end do
    call file%close()
    if (file%failed) call no_output(run, fail)
  end subroutine write_orbit

  !> Reads a state of the same unknowns.
  subroutine read_orbit(run, folder, period, fail)
    type(run_state), intent(inout) :: run     !! run%y receives it
    character(*), intent(in) :: folder
    real(wp), intent(inout) :: period         !! of the cycle; left as it is where the deck gives it [s]
    type(failure), intent(inout) :: fail
    character(:), allocatable :: content, problem
    real(wp), allocatable :: number(:), value(:)   ! [-], [any]
    call read_file(folder//orbit, content, problem)
    if (len(problem) == 0) then
      call read_columns(content, [1, 2], number, value, problem)
      if (index(content, heading(run)//lf) > 0 .and. size(value) == size(run%y) + 1) then
        if (run%d%periodic%free_period) period = value(1)
        run%y = value(2:)
        return
      end if
    end if
    call fail%raise(status_bad_input, '--orbit: "'//folder//orbit//'" is not the cycle of a deck with the same bodies and '// &
                    'unknowns; expected the results of such a deck with &periodic')
  end subroutine read_orbit
end module periodic_analysis
