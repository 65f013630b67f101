!> The static analysis: equilibrium by load steps, into static.txt; later analyses start from it. Bodies that nothing holds
!> are refused before anything is written.
module static_analysis
  use kinds, only: wp
  use column_names, only: motion_names, motion_row
  use dynamic_stiffness, only: stiffness_system
  use equilibrium, only: find_contacts, find_equilibrium, equilibrium_report
  use equilibrium_growth, only: find_growth
  use errors, only: failure, status_failed, status_bad_input
  use evaluation_settings, only: evaluation_options
  use linear_state, only: linear_system_with, evaluate_state, refuse_uneven
  use linear_matrices, only: linear_mechanism
  use force_element, only: bilateral, by_position, element_action, stage_static
  use impacts, only: close_entered
  use natural_modes, only: lowest_natural_modes, rounding_level
  use scene_run, only: run_state, no_output, stop_if_signalled
  use sensors, only: read_sensors
  use summary, only: add_warnings
  use summary_text, only: summary_record
  use text, only: joined, to_text
  use text_file, only: result_file
  use validity, only: validity_watch
  implicit none (type, external)
  private
  public :: run_static, refuse_free_bodies

  real(wp), parameter :: takes_part = 1.0e-3_wp      !! motion of a body in a free motion worth naming, over the largest [-]

contains

  !> Refuses a scene in which joints, drives, springs, stops and elasticity leave a motion without any stiffness; names the bodies.
  subroutine refuse_free_bodies(run, fail)
    type(run_state), intent(inout) :: run
    type(failure), intent(inout) :: fail
    character(:), allocatable :: names
    names = names_of(run, free_bodies(run, bilateral))
    if (len(names) == 0) return
    names = names//'; expected joints, drives, springs or elastic bodies that hold every body by more than rounding'
    if (allocated(run%sys%ev%rows%off)) names = names//' (friction of joints does not act in static analyses)'
    call fail%raise(status_bad_input, 'static: left free to move:'//names)
  end subroutine refuse_free_bodies

  !> The names of chosen bodies, a blank before each.
  function names_of(run, chosen) result(names)
    type(run_state), intent(in) :: run
    logical, intent(in) :: chosen(:)
    character(:), allocatable :: names
    integer :: b
    names = ''
    do b = 1, size(chosen)
      if (chosen(b)) names = names//' "'//trim(run%sys%m%s%bodies(b)%name)//'"'
    end do
  end function names_of

  !> The bodies that can move without any stiffness, with stops that act both ways, or as they are.
  function free_bodies(run, stops) result(free)
    type(run_state), intent(inout) :: run
    integer, intent(in) :: stops             !! `bilateral` or `by_position`
    logical, allocatable :: free(:)
    type(evaluation_options) :: unloaded
    type(element_action), allocatable :: action(:)
    type(stiffness_system) :: ds
    type(linear_mechanism) :: lin
    real(wp), allocatable :: omega2(:), x(:, :), y(:), a(:), lambda(:)
    integer :: j
    logical :: ok
    associate (m => run%sys%m, ev => run%sys%ev)
      unloaded = run%sys%options
      unloaded%gravity = 0.0_wp
      unloaded%load_factor = 0.0_wp
      y = run%y
      y(m%s%nq + 1:2*m%s%nq) = 0.0_wp
      call evaluate_state(run%sys, unloaded, y)
      allocate (a(m%s%nq), lambda(m%s%rows), source=0.0_wp)   ! stiffness of materials and springs alone
      action = ev%action
      do j = 1, size(action)
        if (.not. m%s%forces(j)%item%in_all_directions()) action(j) = element_action()
      end do
      ev%switches%state = stops
      call linear_system_with(m, ev, y, a, lambda, action, ds, lin)
      ev%switches%state = by_position
    end associate
    call even_masses(run, ds)
    call lowest_natural_modes(ds, 4, .false., omega2, x, ok)
    allocate (free(size(run%sys%m%s%bodies)), source=.false.)
    do j = 1, merge(size(omega2), 0, ok)
      if (abs(omega2(j)) <= rounding_level(ds, x(:, j))) call mark(run, x(:, j), free)
    end do
  end function free_bodies

  !> Gives every body the same mass, distributed as before. Whether a motion is free does not depend on masses, but with very
  !> uneven masses rounding would hide it.
  subroutine even_masses(run, ds)
    type(run_state), intent(in) :: run
    type(stiffness_system), intent(inout) :: ds
    integer :: b, e, first, last
    do b = 1, size(run%sys%m%s%bodies)
      first = run%sys%m%s%qo(b) + 1
      last = first + 2 + run%sys%m%s%bodies(b)%nf
      do e = ds%first(first), ds%first(last + 1) - 1
        ds%m(e) = ds%m(e)/run%sys%m%s%bodies(b)%mass
      end do
    end do
  end subroutine even_masses

  !> Marks the bodies whose frames take part in a motion.
  subroutine mark(run, x, free)
    type(run_state), intent(in) :: run
    real(wp), intent(in) :: x(:)                     !! (nq) [m, rad]
    logical, intent(inout) :: free(:)
    real(wp) :: motion(size(free))
    integer :: b, i
    do b = 1, size(free)
      i = run%sys%m%s%qo(b)
      motion(b) = max(norm2(x(i + 1:i + 2)), run%sys%m%s%size*abs(x(i + 3)))
    end do
    free = free .or. motion > takes_part*maxval(motion)
  end subroutine mark

  !> Runs the deck's static analysis.
  subroutine run_static(run, text, fail)
    type(run_state), intent(inout) :: run
    type(summary_record), intent(inout) :: text !! the summary
    type(failure), intent(inout) :: fail
    type(result_file) :: file
    type(equilibrium_report) :: report
    type(evaluation_options) :: part                 ! of the loads
    type(validity_watch) :: watch
    logical :: loose(size(run%sys%m%s%bodies))       ! supported by stops alone
    integer :: k, steps, nq
    nq = run%sys%m%s%nq
    loose = .false.
    if (run%sys%m%s%stops > 0) loose = free_bodies(run, by_position)
    run%sys%options%stage = stage_static
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
      part = fraction_of(run%sys%options, real(k, wp)/run%d%static%load_steps)
      call balance_with_rows(run, part, any(loose), report)
      steps = steps + report%steps
      if (.not. report%converged) then
        call stop_if_signalled('static analysis', fail)
        call refuse_uneven(run, 'static analysis', status_failed, fail)
      end if
      if (.not. fail%happened()) call require_held(run, loose, fail)
      if (.not. report%converged) call fail%raise(status_failed, 'the static analysis found no equilibrium at load step '// &
        to_text(k)//' of '//to_text(run%d%static%load_steps)//': the loads may exceed what the structure can carry '// &
        '(buckling), or need more load steps')
      if (fail%happened()) exit                      ! the first of these counts
      call write_row(run, part, file, report)
      call watch%look(run%sys%m, run%sys%ev, run%y(1:nq), run%y(nq + 1:2*nq))
    end do
    call file%close()
    if (file%failed) call no_output(run, fail)
    call text%line('')
    call text%line('static')
    call text%open('static', '{')
    call text%figure('  load steps done: ', 'load_steps', k - 1)
    call text%figure(', Newton steps: ', 'newton_steps', steps, rest='')
    if (allocated(run%sys%ev%rows%off)) call text%line('  friction of joints does not act: this equilibrium is one of a set, '// &
      'about which friction holds the mechanism')
    call text%figure('  residual over the largest force: ', 'residual', report%residual)
    call text%figure(' (rounding: ', 'rounding', report%noise, rest=')')
    call text%close()
    call add_warnings(text, run%d%path, watch%warnings(run%sys%m, run%sys%ev, 'in the static analysis ', run%vibrates()))
    if (.not. fail%happened()) call tell_growth(run, text)
  end subroutine run_static

  !> Equilibrium under a part of the loads. Rows of rigid stops are closed and opened until no stop is entered and none pulls.
  subroutine balance_with_rows(run, part, loose, report)
    type(run_state), intent(inout) :: run
    type(evaluation_options), intent(in) :: part     !! of the loads
    logical, intent(in) :: loose                     !! only stops hold some body
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

  !> The same, the rows of rigid stops as they are. Newton's method alone finds no contact; so bodies first move until a stop
  !> holds them
  !> - where only stops hold some body;
  !> - where Newton's method has found nothing.
  subroutine balance_load(run, part, loose, report)
    type(run_state), intent(inout) :: run
    type(evaluation_options), intent(in) :: part     !! of the loads
    logical, intent(in) :: loose                     !! only stops hold some body
    type(equilibrium_report), intent(out) :: report
    real(wp), allocatable :: start(:)
    integer :: steps, attempt
    start = run%y
    steps = 0
    do attempt = merge(2, 1, loose), merge(2, 1, run%sys%m%s%stops > 0 .or. run%sys%m%s%laws)
      run%y = start
      if (attempt == 2) call find_contacts(run, part, run%d%static%tolerance, report)
      steps = steps + report%steps
      call find_equilibrium(run, part, run%d%static%tolerance, report)
      report%steps = report%steps + steps
      steps = report%steps
      if (report%converged) exit
    end do
  end subroutine balance_load

  !> Refuses a state in which bodies that only stops can hold are held by none, with the names of the stops that are open.
  subroutine require_held(run, loose, fail)
    type(run_state), intent(inout) :: run
    logical, intent(in) :: loose(:)                  !! (bodies) only stops can hold it
    type(failure), intent(inout) :: fail
    character(:), allocatable :: free, open
    logical, allocatable :: moves(:)
    integer :: k
    if (.not. any(loose)) return
    moves = free_bodies(run, by_position)
    free = names_of(run, loose .and. moves)
    if (len(free) == 0) return
    open = ''
    do k = 1, run%sys%m%s%stops
      associate (f => run%sys%m%s%forces(run%sys%m%s%switching(k))%item)
        if (.not. run%sys%ev%action(run%sys%m%s%switching(k))%force > 0.0_wp) open = open//' "'//trim(f%name)//'"'
      end associate
    end do
    call fail%raise(status_failed, 'static: no stop holds'//free//': what acts there pushes it away from every stop, or '// &
      'along it; open:'//open//'; expected loads towards a stop, or something else that holds it')
  end subroutine require_held

  !> Warns of an unstable equilibrium.
  subroutine tell_growth(run, text)
    type(run_state), intent(inout) :: run
    type(summary_record), intent(inout) :: text !! the summary
    real(wp) :: rate                                 ! [1/s]
    integer :: body
    call find_growth(run, rate, body)
    if (rate > 0.0_wp) call add_warnings(text, run%d%path, 'warning: the static equilibrium is unstable: without damping small '// &
      'motions about it, most of all of body "'//trim(run%sys%m%s%bodies(body)%name)//'", grow at '//to_text(rate)// &
      ' 1/s'//new_line('a'))
  end subroutine tell_growth

  !> A part of weight, loads and prestress: free lengths and angles go from the assembled ones to the deck's.
  pure type(evaluation_options) function fraction_of(full, factor) result(part)
    type(evaluation_options), intent(in) :: full
    real(wp), intent(in) :: factor                   !! [-]
    part = full
    part%load_factor = factor
    part%prestress = factor
    part%gravity = factor*full%gravity
  end function fraction_of

  !> First lines of the file.
  subroutine write_header(run, file)
    type(run_state), intent(in) :: run
    type(result_file), intent(inout) :: file
    call file%head('static equilibrium, one row a load step', run%d%name, run%sys%m%s%title)
    call file%line('# load: fraction of loads and weight; residual: largest over the largest force; then the sensors, then '// &
                   'body frames and nodes')
    call file%line('# columns: '//joined([character(80) :: 'load[-]', 'residual[-]', 'newton_steps[-]', &
                                          run%list%names(:run%list%columns), 'state.'//motion_names(run%sys%m)], ' '))
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
