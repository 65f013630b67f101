!> Force elements of the model from their records: the factories of springs, loads and stops.
module build_loads
  use build_history, only: make_history
  use build_law, only: law_of
  use build_profiles, only: by_angle, make_pair, watch_pair
  use constraint, only: constraint_box
  use build_factors, only: factor_list, follows_time, require_continuous
  use deck_records, only: column_record, deck, force_record, spring_record, stop_record, transient_record
  use errors, only: fault_list
  use force_element, only: append, force_model, stage_all, stage_static, stage_transient
  use loads, only: load_model
  use scene_model, only: scene
  use stop_row, only: stop_row_model
  use measure, only: measure_model
  use measures, only: difference, distance, line
  use motion_watch, only: history_watch
  use springs, only: spring_model
  use stops, only: stop_model, rebound_factor
  use text, only: either, quoted
  implicit none (type, external)
  private
  public :: make_forces, place_stop_rows

contains

  !> Springs, loads, stops, each of its kind, then what watches motions for loads; they have no markers yet.
  subroutine make_forces(d, s, watched, faults)
    type(deck), intent(in) :: d
    type(scene), intent(inout) :: s
    type(column_record), allocatable, intent(out) :: watched(:)   !! columns that the watches of factors watch
    type(fault_list), intent(inout) :: faults
    type(factor_list) :: list
    class(force_model), allocatable :: item
    integer, allocatable :: order(:)       ! stops first
    integer :: k, loads
    s%springs = size(d%springs)
    loads = s%springs + size(d%forces)
    s%acting = loads + size(d%stops)
    allocate (s%forces(s%acting), s%factors(size(d%forces)), list%histories(0), list%columns(0))
    do k = 1, s%acting
      if (k <= s%springs) then
        call make_spring(d, d%springs(k), item, faults)
      else if (k <= loads) then
        call make_load(d, s, d%forces(k - s%springs), item, list, faults)
      else
        call make_stop(d, d%stops(k - loads), item, faults)
      end if
      call move_alloc(item, s%forces(k)%item)
    end do
    s%stops = size(d%stops)
    s%factors = s%factors(:list%count)
    watched = list%columns
    call watch_profiles(d, s)
    order = [(k, k=loads + 1, s%acting), (k, k=1, loads), (k, k=s%acting + 1, size(s%forces))]
    s%switching = pack(order, [(s%forces(order(k))%item%switches, k=1, size(order))])
    do k = 1, size(s%switching)
      s%forces(s%switching(k))%item%switch_number = k
    end do
    do k = 1, size(s%friction)
      s%constraints(s%permanent + k)%item%switch_number = size(s%switching) + k
    end do
    s%elements = size(s%switching) + size(s%friction)
    call add_stop_rows(d, s)
  end subroutine make_forces

  !> Behind all others what watches the corners of laws, of joints and stops on profiles.
  subroutine watch_profiles(d, s)
    type(deck), intent(in) :: d
    type(scene), intent(inout) :: s
    integer :: k
    allocate (s%corners(0))
    do k = 1, s%joints
      if (d%joints(k)%profile > 0) call watch(s%constraints(k)%item%measures(1)%item, k)
    end do
    do k = 1, s%stops
      associate (i => s%acting - s%stops + k)
        if (d%stops(k)%profile > 0) call watch(s%forces(i)%item%measure, s%permanent + i)
      end associate
    end do
  contains
    !> Adds one where there are corners.
    subroutine watch(gap, number)
      class(measure_model), intent(inout) :: gap
      integer, intent(in) :: number          !! of its joint or stop, among constraints and force elements
      type(history_watch), allocatable :: watcher
      class(force_model), allocatable :: item
      allocate (watcher)
      call watch_pair(gap, size(s%corners) + 1, watcher%history)
      if (.not. allocated(watcher%history)) return
      watcher%switches = .true.
      watcher%whole_turns = .true.
      watcher%name = 'corners'
      call move_alloc(watcher, item)
      call append(s%forces, item)
      s%corners = [s%corners, number]
    end subroutine watch
  end subroutine watch_profiles

  !> A row for each rigid stop, behind all others.
  subroutine add_stop_rows(d, s)
    type(deck), intent(in) :: d
    type(scene), intent(inout) :: s
    type(constraint_box), allocatable :: all(:)
    type(stop_row_model), allocatable :: row
    integer :: i, k, n
    s%stop_rows = count(d%stops%rigid)
    n = size(s%constraints)
    allocate (all(n + s%stop_rows))
    do k = 1, n
      call move_alloc(s%constraints(k)%item, all(k)%item)
    end do
    do k = 1, size(d%stops)
      if (.not. d%stops(k)%rigid) cycle
      allocate (row)
      i = s%acting - size(d%stops) + k
      associate (f => s%forces(i)%item)
        row%name = f%name
        row%switch_number = f%switch_number
        call row%hold(f%measure)
      end associate
      row%parent = s%permanent + i
      row%one_sided = .true.
      row%lower = d%stops(k)%lower
      row%upper = d%stops(k)%upper
      row%restitution = d%stops(k)%restitution
      n = n + 1
      call move_alloc(row, all(n)%item)
    end do
    call move_alloc(all, s%constraints)
  end subroutine add_stop_rows

  !> Gives stops and their rows each other's place, when both are numbered; what watches pairs sees what these measure.
  subroutine place_stop_rows(s)
    type(scene), intent(inout) :: s
    integer :: k
    do k = size(s%constraints) - s%stop_rows + 1, size(s%constraints)
      associate (c => s%constraints(k)%item, f => s%forces(s%switching(s%constraints(k)%item%switch_number))%item)
        f%row = c%first
        call c%attach(f%ia, f%ib, 0)
      end associate
    end do
    do k = 1, size(s%corners)
      associate (f => s%forces(size(s%forces) - size(s%corners) + k)%item, number => s%corners(k))
        if (number <= s%joints) then
          allocate (f%measure, source=s%constraints(number)%item%measures(1)%item)
        else
          allocate (f%measure, source=s%forces(number - s%permanent)%item%measure)
        end if
        call by_angle(f%measure)
        f%ia = f%measure%ia
        f%ib = f%measure%ib
        f%size = s%size
      end associate
    end do
  end subroutine place_stop_rows

  !> The factory of springs: the deck's word into the kind.
  subroutine make_spring(d, r, item, faults)
    type(deck), intent(in) :: d
    type(spring_record), intent(in) :: r
    class(force_model), allocatable, intent(out) :: item
    type(fault_list), intent(inout) :: faults
    type(spring_model), allocatable :: sp
    allocate (sp)
    if (r%type == 'torsional') then
      sp%measure = difference(3)
    else
      sp%measure = distance()
    end if
    sp%name = r%name
    sp%group = 'spring'
    sp%angular = sp%measure%angular
    sp%along_line = sp%measure%radial
    sp%acts = sp%measure%acts
    sp%stiffness = r%law%stiffer*r%stiffness
    sp%damping = r%law%stiffer*r%law%slower*r%damping
    sp%measure%pending = r%free >= huge(r%free)
    if (.not. sp%measure%pending) sp%measure%datum = r%free
    sp%law = law_of(r%law)
    if (r%characteristic > 0) then
      call make_history(d, r%characteristic, sp%history)
      call sp%watch_corners(order_of_events(d%transient))
      sp%stiffness = sp%history%steepest()
      call require_continuous(r%at, 'characteristic', sp%history, faults)
      if (sp%measure%pending .and. .not. sp%history%vanishes()) call r%at%blame(faults, 'characteristic='// &
        quoted(trim(sp%history%name))//' is nowhere zero, so that the spring has no unloaded state, expected one that passes '// &
        'through zero, or '//either('free_angle', 'free_length', sp%angular)//', from which its argument counts')
    end if
    call move_alloc(sp, item)
  end subroutine make_spring

  !> The factory of loads.
  subroutine make_load(d, s, r, item, list, faults)
    type(deck), intent(in) :: d
    type(scene), intent(inout) :: s
    type(force_record), intent(in) :: r
    class(force_model), allocatable, intent(out) :: item
    type(factor_list), intent(inout) :: list       !! of factors that follow motions
    type(fault_list), intent(inout) :: faults
    type(load_model), allocatable :: l
    allocate (l)
    if (r%type == 'force') l%f = [r%fx, r%fy]
    if (r%type /= 'force') l%moment = r%moment
    l%in_frame = r%axes == 'body'
    l%in_section = r%axes == 'section'
    l%central = r%type == 'torque_about'
    if (l%central) l%centre = r%centre
    l%acts(1:2) = r%type /= 'torque'
    l%acts(3) = r%type == 'torque'
    l%name = r%name
    if (follows_time(d, r)) then
      call make_history(d, r%history, l%history)
    else if (r%history > 0) then
      call list%find(d, s, r, order_of_events(d%transient), l%motion_factor, faults)
    end if
    l%controller = r%controller
    l%stage = stage_all
    if (r%stage == 'static') l%stage = stage_static
    if (r%stage == 'transient') l%stage = stage_transient
    call move_alloc(l, item)
  end subroutine make_load

  !> The highest derivative of a function of motion whose jumps are events. With fixed steps those are events, too, that lower
  !> the order of the method: a jump of derivative k causes an error of order k + 1.
  pure integer function order_of_events(r) result(order)
    type(transient_record), intent(in) :: r
    order = 1
    if (r%adaptive) return
    if (r%method == 'rk4') order = 2
    if (any(r%method == [character(6) :: 'dopri5', 'radau'])) order = 3
  end function order_of_events

  !> The factory of stops.
  subroutine make_stop(d, r, item, faults)
    type(deck), intent(in) :: d
    type(stop_record), intent(in) :: r
    class(force_model), allocatable, intent(out) :: item
    type(fault_list), intent(inout) :: faults
    type(stop_model), allocatable :: t
    allocate (t)
    select case (r%type)
    case ('rotation')
      t%measure = difference(3)
    case ('position')
      t%measure = line(r%direction, r%b%body == 0)
    case ('profile')
      call make_pair(d, r%at, r%profile, r%radius, r%face, t%measure, faults)
    case default
      t%measure = distance(r%upper)
    end select
    t%name = r%name
    t%group = 'stop'
    t%angular = t%measure%angular
    t%acts = t%measure%acts
    t%switches = .true.
    t%lower = r%lower
    t%upper = r%upper
    t%hardness = r%stiffness
    t%exponent = r%exponent
    t%chi = r%damping
    t%rigid = r%rigid
    if (r%rigid) then
      t%restitution = r%restitution
    else
      t%rebound = rebound_factor(r%restitution)
    end if
    call move_alloc(t, item)
  end subroutine make_stop
end module build_loads
