!> The static analysis: equilibrium by load steps, into static.txt; later analyses start from it. Bodies that nothing holds
!> are refused before anything is written.
module static_analysis
  use kinds, only: wp
  use result_columns, only: motion_columns, motion_row, result_column
  use controls, only: switch_on_controls
  use equilibrium, only: find_contacts, find_equilibrium, equilibrium_report
  use equilibrium_growth, only: find_growth
  use errors, only: failure, status_failed, status_bad_input
  use evaluation_settings, only: evaluation_options
  use force_element, only: stage_static
  use free_bodies, only: free_bodies_under, loose_bodies
  use impacts, only: close_entered
  use linear_state, only: evaluate_state, refuse_uneven
  use scene_run, only: run_state, no_output, stop_if_signalled
  use sensors, only: read_sensors
  use summary_text, only: summary_record
  use switching, only: sunken_stop, too_soft
  use text, only: either, in_quotes, joined, to_text
  use text_file, only: result_file
  use validity, only: validity_watch
  implicit none (type, external)
  private
  public :: run_static, refuse_free_bodies

contains

  !> Refuses a scene in which joints, drives, springs, stops, elasticity and loads leave a motion without any stiffness; names the
  !> bodies.
  subroutine refuse_free_bodies(run, fail)
    type(run_state), intent(inout) :: run
    type(failure), intent(inout) :: fail
    character(:), allocatable :: names
    type(evaluation_options) :: options
    options = run%sys%options
    options%stage = stage_static
    options%controlled = .false.
    names = in_quotes(pack(run%sys%m%s%bodies%name, free_bodies_under(run, options, both_ways=.true.)))
    if (len(names) == 0) return
    names = names//'; expected joints, drives, springs, elastic bodies, or weight and loads that change with the position, '// &
            'that hold every body by more than rounding'
    if (allocated(run%sys%ev%rows%off)) names = names//' (friction of joints does not act in static analyses)'
    call fail%raise(status_bad_input, 'static: left free to move:'//names)
  end subroutine refuse_free_bodies

  !> Runs the deck's static analysis.
  subroutine run_static(run, text, fail)
    type(run_state), intent(inout) :: run
    type(summary_record), intent(inout) :: text !! the summary
    type(failure), intent(inout) :: fail
    type(result_file) :: file
    type(equilibrium_report) :: report
    type(evaluation_options) :: part                 ! of the loads
    type(validity_watch) :: watch
    logical :: loose(size(run%sys%m%s%bodies))       ! stops or loads alone hold it
    real(wp) :: rate                                 ! of unstable motions [1/s]
    integer :: k, steps, nq, sunk, body
    nq = run%sys%m%s%nq
    loose = loose_bodies(run)
    run%sys%options%stage = stage_static
    run%sys%options%controlled = .false.
    call watch%begin(run%sys%m)
    do k = 1, size(run%sys%m%s%bodies)               ! elastic coordinates are at rest
      associate (i => nq + run%sys%m%s%qo(k) + 3)
        run%y(i + 1:i + run%sys%m%s%bodies(k)%nf) = 0.0_wp
      end associate
    end do
    if (len(run%folder) > 0) call file%open(run%folder//'/static.txt')      ! pilots have no files
    if (len(run%folder) > 0) call write_header(run, file)
    steps = 0
    do k = 1, run%d%static%load_steps
      call stop_if_signalled('static analysis', fail)
      if (fail%happened()) exit
      part = run%sys%options                         ! free lengths and angles go from the assembled ones to the deck's
      part%load_factor = real(k, wp)/run%d%static%load_steps
      part%prestress = part%load_factor
      part%gravity = part%load_factor*part%gravity
      call balance_with_rows(run, part, any(loose), report)
      steps = steps + report%steps
      sunk = sunken_stop(run%sys%m, run%sys%ev)
      if (sunk > 0) call fail%raise(status_failed, 'static: '//too_soft(run%sys%m, sunk))
      if (.not. report%converged) then
        call stop_if_signalled('static analysis', fail)
        call refuse_uneven(run, 'static analysis', status_failed, fail)
      end if
      if (.not. fail%happened() .and. any(loose)) call require_held(run, part, loose, fail)
      if (.not. report%converged) call fail%raise(status_failed, 'the static analysis found no equilibrium at load step '// &
        to_text(k)//' of '//to_text(run%d%static%load_steps)//': the loads may exceed what the structure can carry (buckling), '// &
        'or need more load steps'//either(', or drive on without end what only they hold:'//in_quotes(pack( &
        run%sys%m%s%bodies%name, loose)), '', any(loose)))
      if (fail%happened()) exit                      ! the first of these counts
      call write_row(run, part, file, report)
      call watch%note(run%sys%m, run%sys%ev, run%y(1:nq), run%y(nq + 1:2*nq))
    end do
    call file%close()
    if (file%failed) call no_output(run, fail)
    call text%section('static', 'static')
    call text%line('  load steps done: {load_steps #}, Newton steps: {newton_steps #}', [real(wp) :: k - 1, steps])
    if (allocated(run%sys%ev%rows%off)) call text%line('  friction of joints does not act: this equilibrium is one of a set, '// &
      'about which friction holds the mechanism')
    call text%line('  residual over the largest force: {residual} (rounding: {rounding})', [report%residual, report%noise])
    call text%close()
    call text%warn(watch%warnings(run%sys%m, run%sys%ev, 'in the static analysis '), outside=.true.)
    if (fail%happened()) return
    call find_growth(run, rate, body)
    run%sys%options%controlled = .true.
    associate (s => run%sys%m%s, y => run%y)
      call switch_on_controls(run%sys%m, run%sys%ev, y(1:s%nq), y(s%nq + 1:2*s%nq), y(2*s%nq + 1:2*s%nq + s%nz))
    end associate
    if (rate > 0.0_wp) call text%warn('the static equilibrium is unstable: without damping small motions about it, most of all '// &
      'of body "'//trim(run%sys%m%s%bodies(body)%name)//'", grow at '//to_text(rate)//' 1/s (&modal shows them)')
  end subroutine run_static

  !> Equilibrium under a part of the loads. Rows of rigid stops are closed and opened until no stop is entered and none pulls.
  subroutine balance_with_rows(run, part, loose, report)
    type(run_state), intent(inout) :: run
    type(evaluation_options), intent(in) :: part     !! of the loads
    logical, intent(in) :: loose                     !! only stops or loads hold some body
    type(equilibrium_report), intent(out) :: report
    logical :: changed
    integer :: pass, steps
    steps = 0
    do pass = 1, 4*run%sys%m%s%stop_rows + 1
      call balance_load(run, part, loose, report)
      report%steps = report%steps + steps
      steps = report%steps
      if (.not. report%converged .or. run%sys%m%s%stop_rows == 0) return
      call close_entered(run%sys%m, run%sys%ev, changed)
      if (.not. changed) return
    end do
    report%converged = .false.
  end subroutine balance_with_rows

  !> The same, the rows of rigid stops as they are. Newton's method alone finds no contact, and no way down from a position in
  !> which a load pushes away from its equilibrium; so bodies first move until something holds them
  !> - where only stops or loads hold some body;
  !> - where Newton's method has found nothing.
  subroutine balance_load(run, part, loose, report)
    type(run_state), intent(inout) :: run
    type(evaluation_options), intent(in) :: part     !! of the loads
    logical, intent(in) :: loose                     !! only stops or loads hold some body
    type(equilibrium_report), intent(out) :: report
    real(wp), allocatable :: start(:)
    integer :: steps, attempt
    start = run%y
    steps = 0
    do attempt = merge(2, 1, loose), 2
      run%y = start
      if (attempt == 2) call find_contacts(run, part, run%d%static%tolerance, report)
      steps = steps + report%steps
      call find_equilibrium(run, part, run%d%static%tolerance, report)
      report%steps = report%steps + steps
      steps = report%steps
      if (report%converged) exit
    end do
  end subroutine balance_load

  !> Refuses a state in which bodies that only stops or loads can hold are held by none, with the names of the stops that are open.
  subroutine require_held(run, part, loose, fail)
    type(run_state), intent(inout) :: run
    type(evaluation_options), intent(in) :: part     !! of the loads
    logical, intent(in) :: loose(:)                  !! (bodies) only stops or loads can hold it
    type(failure), intent(inout) :: fail
    character(:), allocatable :: free, open
    logical :: moving(size(loose))                   ! (bodies) without what can hold it
    integer :: k
    moving = free_bodies_under(run, part, both_ways=.false.)
    free = in_quotes(pack(run%sys%m%s%bodies%name, loose .and. moving))
    if (len(free) == 0) return
    associate (s => run%sys%m%s, action => run%sys%ev%action)
      open = in_quotes(pack([(s%forces(s%switching(k))%item%name, k=1, s%stops)], &
                            [(.not. action(s%switching(k))%force > 0.0_wp, k=1, s%stops)]))
    end associate
    if (run%sys%m%s%stops == 0) then
      call fail%raise(status_failed, 'static: nothing holds'//free//' where it came to; expected loads that hold it there')
    else
      call fail%raise(status_failed, 'static: no stop holds'//free//': what acts there pushes it away from every stop, or '// &
        'along it; open:'//open//'; expected loads towards a stop, or something else that holds it')
    end if
  end subroutine require_held

  !> First lines of the file.
  subroutine write_header(run, file)
    type(run_state), intent(in) :: run
    type(result_file), intent(inout) :: file
    type(result_column), allocatable :: columns(:)
    call file%head('static equilibrium, one row a load step', run%d%name, run%sys%m%s%title)
    call file%line('# load: fraction of loads and weight; residual: largest over the largest force; then the sensors, then '// &
                   'body frames and nodes')
    columns = motion_columns(run%sys%m)
    columns = [run%list%column, columns%of('state.')]
    call file%line('# columns: load[-] residual[-] newton_steps[-] '//joined(columns%label(), ' '))
  end subroutine write_header

  !> One row.
  subroutine write_row(run, options, file, report)
    type(run_state), intent(inout) :: run
    type(evaluation_options), intent(in) :: options  !! the loads that act
    type(result_file), intent(inout) :: file
    type(equilibrium_report), intent(in) :: report
    real(wp), allocatable :: values(:)
    allocate (values(run%list%columns))
    call evaluate_state(run%sys, options, run%y)
    if (len(run%folder) == 0) return
    call read_sensors(run%list, run%sys%m, run%sys%ev, run%y, values)
    call file%row([options%load_factor, report%residual, real(report%steps, wp), values, &
                   motion_row(run%sys%m, run%y(1:run%sys%m%s%nq))])
  end subroutine write_row
end module static_analysis
