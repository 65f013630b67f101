!> Events of the mechanism: stops that touch and part, impacts, joints that stick and slip, controllers that are limited or sample.
module mechanism_events
  use kinds, only: wp, ip
  use archive, only: value_archive
  use contact_mass, only: mass_at, time_of_contact
  use controls, only: pass_control_events, start_controls
  use dynamics, only: evaluate, evaluate_motion, marker_kinematics, motion_state
  use evaluation_results, only: conditions_of, evaluation
  use evaluation_settings, only: at_side
  use force_element, only: by_position, inactive, most_roots
  use friction_law, only: row_at_limit, row_parted, row_slips, row_stuck, sliding
  use friction_shares, only: find_undetermined
  use marker, only: marker_states
  use measure, only: measure_course
  use impacts, only: impact_result, pass_impacts
  use mechanism_rates, only: moving_mechanism
  use ode_system, only: root_course
  use projection, only: project
  use resting_rows, only: close_low, comes_to_rest, find_states, hold_resting, resting_set
  use root_watch, only: resting
  use slipping, only: painleve_ratio
  use stops, only: slowest_touch, stop_contact, stop_let_go, stop_model, stop_open, stop_rebound, stop_touching
  use switch_tally, only: joint_tally, element_tally
  use switching, only: event_list, is_rigid_stop, pass_events, start_states, switch_event, watch_roots
  implicit none (type, external)
  private

  real(wp), parameter :: difference_time = sqrt(resting)   !! of difference quotients, of an output step: as rounding asks [-]
  real(wp), parameter :: least_change = 1.0e3_wp       !! of a root; a smaller one is rounding; of what counts as zero [-]
  integer, parameter :: checked_per_step = 4  !! joints whose Painleve's ratio is found in an accepted step

  !> The system with its events.
  type, abstract, extends(moving_mechanism), public :: switching_mechanism
    type(event_list) :: events                !! of elements that switch
    integer :: sunk = 0                       !! a stop that is pressed in as deep as its profile's radius of curvature; 0: none
    integer :: conflict = 0                   !! a rigid stop that is pressed by a part which cannot move back; 0: none
    type(element_tally), allocatable :: tally(:)   !! of each of them
    type(joint_tally), allocatable :: friction(:)  !! of each joint with friction
    logical :: follows_stiffness = .true.     !! steps have to be short beside the stiffest contact: the method is explicit
    real(wp) :: shortest_limit = huge(1.0_wp) !! shortest of all steps that contacts allowed [s]
    real(wp), allocatable :: painleve(:)      !! (rows that switch) Painleve's ratio when it was last found [-]
    integer :: last_checked = 0               !! row whose ratio was found last
    class(evaluation), allocatable, private :: nearby  !! a little later, for difference quotients
    class(evaluation), allocatable, private :: within  !! motion of the markers within a step
    real(wp) :: output_step = huge(1.0_wp)    !! between two rows of the history [s]
  contains
    procedure :: start_switching
    procedure :: position_of
    procedure :: hold_rows
    procedure :: find_roots
    procedure :: find_courses
    procedure :: follow_roots
    procedure :: resolve_events
    procedure :: note_step
    procedure :: longest_fixed
    procedure :: exchange_switches
    procedure :: choose_rows => keep_rows
  end type switching_mechanism

contains

  !> Elements that switch take their states from the start; from now on only events change them. Controllers are switched on.
  subroutine start_switching(self, t, y, given)
    class(switching_mechanism), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(inout), contiguous :: y(:)   !! (ny) [m, rad], [m/s, rad/s], [J]
    logical, intent(in) :: given            !! states of controllers are those of y; else as when they are switched on
    logical :: ok
    integer :: k
    self%ev%t = t
    self%ev%options = self%options
    associate (nq => self%m%s%nq, nz => self%m%s%nz)
      call start_states(self%m, self%ev, y(1:nq), y(nq + 1:2*nq))
      call start_controls(self%m, self%ev, t, y(1:nq), y(nq + 1:2*nq), y(2*nq + 1:2*nq + nz), given)
    end associate
    self%roots = most_roots*(self%m%s%elements + size(self%m%s%controllers))
    allocate (self%tally(size(self%m%s%switching)))
    allocate (self%friction(self%m%s%elements - size(self%tally)))
    associate (touched => self%ev%switches%state(:self%m%s%stops) /= stop_open)
      call rate_contacts(self, t, y, abs(self%ev%switches%state(:self%m%s%stops)) == stop_touching)
      if (self%m%s%stops > 0) call begin_contacts(self, t, y, [(k, k=1, self%m%s%stops)], touched)
    end associate
    do k = 1, size(self%friction)
      self%friction(k)%position = self%position_of(k)
    end do
    if (self%m%s%elements > 0) call apply_events(self, t, y, spread(.false., 1, self%roots), self%ev%switches%state, ok)
  end subroutine start_switching

  !> Position of joint k of those with friction in the last evaluation [m] or [rad].
  pure real(wp) function position_of(self, k)
    class(switching_mechanism), intent(in) :: self
    integer, intent(in) :: k
    position_of = self%m%s%constraints(self%m%s%permanent + k)%item%position(self%ev%p)
  end function position_of

  !> How far joint k of those with friction has slid since it was last asked. Between two steps it slides one way, or not at all.
  subroutine note_way(self, k)
    class(switching_mechanism), intent(inout) :: self
    integer, intent(in) :: k
    real(wp) :: x                           ! [m] or [rad]
    x = self%position_of(k)
    associate (tally => self%friction(k))
      tally%slid = tally%slid + abs(self%m%s%constraints(self%m%s%permanent + k)%item%way(tally%position, x))
      tally%position = x
    end associate
  end subroutine note_way

  !> For linear analyses about a state at t = 0: rigid stops that are touched and pressed are closed, joints with friction stick or
  !> slip, or move freely.
  subroutine hold_rows(self, y, free)
    class(switching_mechanism), intent(inout) :: self
    real(wp), intent(in), contiguous :: y(:)   !! (ny) [m, rad], [m/s, rad/s], [J]
    logical, intent(in) :: free             !! joints move freely
    type(event_list) :: unheard
    type(impact_result) :: x
    type(motion_state) :: at
    type(resting_set) :: set
    logical :: none(most_roots*self%m%s%elements), no_row(size(self%m%s%constraints) - self%m%s%permanent), ok, more
    integer :: k
    if (self%m%s%stop_rows + size(self%m%s%friction) == 0) return
    none = .false.
    self%ev%switches%state(size(self%m%s%switching) + 1:) = by_position
    do k = 1, self%m%s%stops
      if (is_rigid_stop(self%m, k)) self%ev%switches%state(k) = inactive
    end do
    at = self%motion_at(0.0_wp, y)
    call pass_impacts(self%m, self%ev, at, none, unheard, x)
    no_row = spread(.false., 1, size(x%side))
    set = resting_set(x%side, no_row, 0*x%side, free)
    call hold_resting(self%m, self%ev, at, none, set, more)
    call find_states(self%m, self%ev, at, 0.0_wp, set, ok, k)
    if (size(self%m%s%friction) > 0 .and. .not. free) call check_friction(self, at, ok)
  end subroutine hold_rows

  !> Roots of the elements that switch, then of controllers.
  subroutine find_roots(self, t, y, left_limit, g, rate, zero)
    class(switching_mechanism), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(in), contiguous :: y(:)   !! (ny) [m, rad], [m/s, rad/s], [J]
    logical, intent(in) :: left_limit       !! y is the end of a step
    real(wp), intent(out) :: g(:), rate(:), zero(:)   !! (roots) [any], [any/s], [any]
    associate (m => self%m, ev => self%ev, s => self%m%s, z => y(2*self%m%s%nq + 1:2*self%m%s%nq + self%m%s%nz))
      if (size(s%friction) > 0 .or. holds_stops(self)) then
        call self%evaluate_state(t, y, left_limit)
        call watch_roots(m, ev, size(s%switching) + 1, s%elements, t, left_limit, z, g, rate, zero)
        call measure_rates(self, t, y, g, rate, zero)
        self%events_may_follow = comes_to_rest(m, ev)
      end if
      if (size(s%switching) + size(s%controllers) == 0) return
      call marker_kinematics(m, ev, y(1:s%nq), y(s%nq + 1:2*s%nq))
      call watch_roots(m, ev, 1, size(s%switching), t, left_limit, z, g, rate, zero)
      call watch_roots(m, ev, s%elements + 1, s%elements + size(s%controllers), t, left_limit, z, g, rate, zero)
    end associate
  end subroutine find_roots

  !> Courses of force elements and controllers, by the last motion of the markers.
  subroutine find_courses(self, course)
    class(switching_mechanism), intent(in) :: self
    type(root_course), intent(out) :: course(:)   !! (roots)
    call courses_at(self, self%ev%p, course)
  end subroutine find_courses

  !> The same by any motion of the markers. What a controller demands is not bounded by its motion.
  subroutine courses_at(self, p, course)
    class(switching_mechanism), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(root_course), intent(out) :: course(:)   !! (roots)
    type(measure_course) :: c
    integer :: k, n
    associate (s => self%m%s)
      do k = 1, size(s%switching)
        c = s%forces(s%switching(k))%item%measure%course(p)
        course(most_roots*(k - 1) + 1:most_roots*k) = root_course(c%w, c%turning, c%bend)
      end do
      do k = 1, size(s%controllers)
        c = s%controllers(k)%quantity%course(p)
        n = most_roots*(s%elements + k)
        course(n - most_roots + 1:n)%turning = c%turning
      end do
    end associate
  end subroutine courses_at

  !> Roots that follow from motion alone: those of force elements but for the forces of rigid stops, and of controllers.
  subroutine follow_roots(self, t, y, g, rate, course)
    class(switching_mechanism), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(in), contiguous :: y(:)   !! (ny) [m, rad], [m/s, rad/s]
    real(wp), intent(out) :: g(:), rate(:)  !! (roots) [any], [any/s]
    type(root_course), intent(out) :: course(:)   !! (roots)
    real(wp) :: zero(size(g))               ! not used [any]
    integer :: k
    if (.not. allocated(self%within)) call begin_within(self)
    g = huge(1.0_wp)
    rate = huge(1.0_wp)
    associate (m => self%m, s => self%m%s, x => self%within, nq => self%m%s%nq, z => y(2*self%m%s%nq + 1:))
      x%t = t
      x%options = at_side(self%options, .true.)
      x%switches%state = self%ev%switches%state
      x%switches%event_value = self%ev%switches%event_value
      x%control%state = self%ev%control%state
      call marker_kinematics(m, x, y(1:nq), y(nq + 1:2*nq))
      call watch_roots(m, x, 1, size(s%switching), t, .true., z(:s%nz), g, rate, zero)
      call watch_roots(m, x, s%elements + 1, s%elements + size(s%controllers), t, .true., z(:s%nz), g, rate, zero)
      do k = 1, size(s%switching)
        if (is_rigid_stop(m, k) .and. x%switches%state(k) /= inactive) g(most_roots*(k - 1) + 1:most_roots*k) = huge(1.0_wp)
      end do
      call courses_at(self, x%p, course)
    end associate
  end subroutine follow_roots

  !> What the motion of markers and the roots of elements need of an evaluation.
  subroutine begin_within(self)
    class(switching_mechanism), intent(inout) :: self
    allocate (evaluation :: self%within)
    associate (x => self%within, ev => self%ev)
      x%p = ev%p
      x%frame%angle = ev%frame%angle
      x%frame%cos = ev%frame%cos
      x%frame%sin = ev%frame%sin
      x%switches = ev%switches
      x%control = ev%control
      x%factor = ev%factor
      x%lambda = ev%lambda
    end associate
  end subroutine begin_within

  !> Rates of the distances to the limits of joints that stick, by a second evaluation a little later. With them a share that
  !> reaches its limit and leaves it within a step is found. A change that may be rounding gives no rate.
  subroutine measure_rates(self, t, y, g, rate, zero)
    class(switching_mechanism), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(in), contiguous :: y(:)   !! (ny) [m, rad], [m/s, rad/s], [J]
    real(wp), intent(in) :: g(:), zero(:)   !! (roots) of the last evaluation [any]
    real(wp), intent(inout) :: rate(:)      !! (roots) [any/s]
    real(wp), dimension(size(g)) :: later, unused, rounding   ! [any], [any/s], [any]
    real(wp) :: h                           ! [s]
    integer :: k
    if (size(self%m%s%friction) == 0) return
    if (.not. allocated(self%nearby)) allocate (self%nearby, source=self%ev)
    associate (s => self%m%s, ev => self%ev, x => self%nearby)
      if (.not. any(ev%switches%state(size(s%switching) + 1:) == row_stuck)) return
      if (ev%schur%singular .or. ev%broken .or. .not. self%output_step < huge(1.0_wp)) return
      x%switches%state = ev%switches%state
      x%switches%event_value = ev%switches%event_value
      x%slip%start = ev%lambda
      x%control = ev%control
      x%broken = .false.
      h = sign(difference_time*self%output_step, merge(-1.0_wp, 1.0_wp, ev%options%left_limit))
      associate (q => y(1:s%nq), v => y(s%nq + 1:2*s%nq), z => y(2*s%nq + 1:2*s%nq + s%nz), nzd => s%nzd, &
                 zd => y(2*s%nq + s%nz + 1:2*s%nq + s%nz + s%nzd))
        call evaluate(self%m, x, ev%options, t + h, q + h*v, v + h*ev%a, z + h*[zd, ev%zdd(nzd + 1:)], zd + h*ev%zdd(:nzd))
        if (x%schur%singular .or. x%broken) return
        call watch_roots(self%m, x, size(s%switching) + 1, s%elements, t, .true., z, later, unused, rounding)
      end associate
      do k = 1, size(s%friction)
        if (ev%switches%state(s%friction(k)%number) /= row_stuck) cycle
        associate (i => most_roots*(s%friction(k)%number - 1) + 1)
          rate(i) = 0.0_wp
          if (abs(later(i) - g(i)) > least_change*zero(i)) rate(i) = (later(i) - g(i))/h
        end associate
      end do
    end associate
  end subroutine measure_rates

  !> Whether a rigid stop is closed.
  pure logical function holds_stops(self) result(yes)
    class(switching_mechanism), intent(in) :: self
    integer :: k
    yes = .false.
    do k = size(self%m%s%constraints) - self%m%s%stop_rows + 1, size(self%m%s%constraints)
      associate (c => self%m%s%constraints(k)%item)
        yes = yes .or. c%holds(self%ev%switches%state(c%switch_number))
      end associate
    end do
  end function holds_stops

  !> Events change states, rigid stops change velocities. Rows that begin to hold lose their rate. Samples change outputs of
  !> controllers.
  subroutine resolve_events(self, t, y, fallen, ok)
    class(switching_mechanism), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(inout), contiguous :: y(:)   !! (ny) [m, rad], [m/s, rad/s], [J]
    logical, intent(in) :: fallen(:)        !! (roots)
    logical, intent(out) :: ok
    integer :: n, before(self%m%s%elements)
    real(wp) :: event_value(self%m%s%elements)   ! before [any]
    ok = .true.
    call self%forget()
    self%unchanged = .false.
    before = self%ev%switches%state
    event_value = self%ev%switches%event_value
    n = most_roots*self%m%s%elements
    associate (nq => self%m%s%nq, nz => self%m%s%nz)
      call pass_control_events(self%m, self%ev, t, y(1:nq), y(nq + 1:2*nq), y(2*nq + 1:2*nq + nz), fallen(n + 1:))
    end associate
    if (n == 0) return
    n = self%events%count
    call apply_events(self, t, y, fallen, before, ok)
    self%unchanged = self%events%count == n .and. all(self%ev%switches%state == before) .and. &
                     .not. any(abs(self%ev%switches%event_value - event_value) > 0.0_wp) .and. &
                     .not. any(fallen(most_roots*self%m%s%elements + 1:))
  end subroutine resolve_events

  !> Elements that switch: impacts, then events of forces, then the rows that are at rest after them. At the start nothing has
  !> fallen.
  subroutine apply_events(self, t, y, fallen, before, ok)
    class(switching_mechanism), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(inout), contiguous :: y(:)   !! (ny) [m, rad], [m/s, rad/s], [J]
    logical, intent(in) :: fallen(:)        !! (roots)
    integer, intent(in) :: before(:)        !! (elements that switch) states
    logical, intent(out) :: ok
    type(impact_result) :: x
    type(motion_state) :: at
    integer :: k, first
    ok = .true.
    first = self%events%count + 1
    at = self%motion_at(t, y)
    associate (n => self%m%s%nq, sums => 2*self%m%s%nq + self%m%s%nz + self%m%s%nzd)
      call pass_impacts(self%m, self%ev, at, fallen, self%events, x)
      y(n + 1:2*n) = at%v
      self%conflict = x%conflict
      y(sums + 2) = y(sums + 2) + x%work
      k = size(y) - size(x%integrated) + 1
      y(k:) = y(k:) + x%integrated
      if (size(self%tally) > 0) call pass_events(self%m, self%ev, t, y(1:n), y(n + 1:2*n), &
                                                 fallen(:most_roots*size(self%tally)), self%events)
      associate (x => self%events%items(first:self%events%count))
        call rate_contacts(self, t, y, [(any(x%element == k .and. abs(x%from) == stop_let_go .and. abs(x%to) == stop_touching), &
                                         k=1, self%m%s%stops)])
      end associate
      ok = self%conflict == 0
      call self%choose_rows()
      if (self%events%count >= first) call begin_contacts(self, t, y, self%events%items(first:self%events%count)%element, &
                                                          self%events%items(first:self%events%count)%from == 0)
      if (ok .and. size(x%side) > 0) call find_resting(self, t, y, fallen, before, x, ok)
      y(sums + 1) = y(sums + 1) + sum(x%lost)
      y(sums + 3:sums + 2 + size(x%lost)) = y(sums + 3:sums + 2 + size(x%lost)) + x%lost
    end associate
    do k = first, self%events%count
      associate (event => self%events%items(k), n => size(self%tally))
        if (event%element <= n) call self%tally(event%element)%note_event(t, event%from, event%to)
        if (event%element > n) call self%friction(event%element - n)%note_event(event%from, event%to)
      end associate
    end do
    do k = 1, size(self%friction)
      call note_way(self, k)
    end do
    call limit_steps_at_rest(self)
  end subroutine apply_events

  !> Rows at rest after any event hold or are off. Those that hold lose their rates; rows that lose theirs with them rest, too. A
  !> rebound too low to be followed ends at once.
  subroutine find_resting(self, t, y, fallen, before, x, ok)
    class(switching_mechanism), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(inout), contiguous :: y(:)   !! (ny) [m, rad], [m/s, rad/s], [J]
    logical, intent(in) :: fallen(:)        !! (roots)
    integer, intent(in) :: before(:)        !! (elements that switch) states
    type(impact_result), intent(inout) :: x
    logical, intent(out) :: ok
    type(resting_set) :: set
    real(wp), dimension(size(x%side)) :: u, flight, last   ! speeds of rebounds [m/s]; their times, of the last ones [s]
    logical :: more, closed(size(x%side))
    integer :: k
    ok = .false.
    closed = .false.
    set = resting_set(x%side, closed, 0*x%side)
    last = 0.0_wp
    do
      do
        call hold_resting(self%m, self%ev, self%motion_at(t, y), fallen, set, more)
        if (.not. (more .or. any(closed))) exit
        call take_rates(self, t, y, x)
        closed = .false.
      end do
      if (self%conflict == 0) call find_states(self%m, self%ev, self%motion_at(t, y), difference_time*self%output_step, set, ok, &
                                               self%conflict)
      call close_low(self%m, self%ev, set, resting*self%m%s%size, u, flight, closed)
      if (.not. (ok .and. any(closed))) exit
      where (closed) last = flight
      do k = 1, size(u)                     ! energies of rebounds that end at once
        if (.not. (closed(k) .and. u(k) > 0.0_wp)) cycle
        associate (lost => x%lost(self%m%s%constraints(self%m%s%permanent + k)%item%switch_number))
          lost = lost + 0.5_wp*u(k)**2/x%yield(k)
        end associate
      end do
    end do
    call note_states(self, t, before, x, last, flight)
    if (self%conflict > 0 .or. size(self%friction) == 0) return
    call find_undetermined(self%m, self%ev, self%friction%undetermined)
    call check_friction(self, self%motion_at(t, y), ok)
  end subroutine find_resting

  !> Puts positions and rates onto the rows that hold.
  subroutine take_rates(self, t, y, x)
    class(switching_mechanism), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(inout), contiguous :: y(:)   !! (ny) [m, rad], [m/s, rad/s], [J]
    type(impact_result), intent(in) :: x
    logical :: ok
    if (.not. (self%has_manifold .or. any(x%side /= 0))) return
    associate (n => self%m%s%nq, i => 2*self%m%s%nq + self%m%s%nz, e => 2*self%m%s%nq + self%m%s%nz + self%m%s%nzd)
      call project(self%m, self%ev, self%options, t, y(1:n), y(n + 1:2*n), y(2*n + 1:i), y(i + 1:e), ok)
    end associate
    if (.not. ok .and. any(x%side /= 0)) self%conflict = maxloc(x%impulse, 1)
  end subroutine take_rates

  !> Notes new states of the rows that switch. An impact without a rebound and the state after it are one event. Rebounds that are
  !> not followed end at a later date.
  subroutine note_states(self, t, before, x, last, flight)
    class(switching_mechanism), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    integer, intent(in) :: before(:)        !! (elements that switch) states
    type(impact_result), intent(in) :: x
    real(wp), intent(in) :: last(:), flight(:)   !! (rows that switch) of the last rebound, of one that is followed [s]
    real(wp) :: date                        ! [s]
    integer :: k, i, j
    do i = 1, size(x%side)
      k = 1 + mod(i - 1 + size(self%friction), size(x%side))   ! stops, then friction
      associate (n => self%m%s%constraints(self%m%s%permanent + k)%item%switch_number, list => self%events)
        if (x%side(k) /= 0) call self%tally(n)%note_impact(x%impulse(n), flight(k))
        if (self%ev%switches%state(n) == before(n)) cycle
        date = t
        if (x%restitution(k) < 1.0_wp) date = t + last(k)/(1 - x%restitution(k))
        j = 0
        if (.not. date > t) j = list%rebound_of(n, t)
        if (j > 0) then
          list%items(j)%to = self%ev%switches%state(n)
        else
          call list%add(switch_event(date, n, before(n), self%ev%switches%state(n)))
        end if
      end associate
    end do
  end subroutine note_states

  !> Whether there are states of the joints with friction, and one motion with them. Where no states are found, joints that would
  !> press themselves if all slipped may be the cause.
  subroutine check_friction(self, at, found)
    class(switching_mechanism), intent(inout) :: self
    type(motion_state), intent(in) :: at
    logical, intent(in) :: found
    integer :: k
    if (.not. allocated(self%painleve)) allocate (self%painleve(size(self%m%s%friction)), source=0.0_wp)
    if (.not. found) then
      associate (state => self%ev%switches%state(size(self%m%s%switching) + 1:))
        where (abs(state) /= row_parted) state = sign(row_slips, state)
      end associate
      call evaluate_motion(self%m, self%ev, at)
    end if
    do k = 1, size(self%painleve)
      self%painleve(k) = painleve_ratio(self%m, self%ev, k, found)
    end do
    self%fault = .not. found .or. any(self%painleve >= 1.0_wp)
  end subroutine check_friction

  !> While joints stick or rigid stops are closed, steps are not longer than the output interval: their load may change.
  subroutine limit_steps_at_rest(self)
    class(switching_mechanism), intent(inout) :: self
    logical :: holds
    holds = holds_stops(self)
    associate (state => self%ev%switches%state(size(self%tally) + 1:))
      holds = holds .or. any(state == row_stuck .or. abs(state) == row_at_limit)
    end associate
    self%resting_step = merge(self%output_step, huge(1.0_wp), holds)
  end subroutine limit_steps_at_rest

  !> The duration of contacts that have just begun limits the next steps.
  subroutine begin_contacts(self, t, y, elements, begins)
    class(switching_mechanism), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(in), contiguous :: y(:)   !! (ny) [m, rad], [m/s, rad/s], [J]
    integer, intent(in) :: elements(:)      !! their numbers among those that switch
    logical, intent(in) :: begins(:)        !! a contact begins there
    real(wp), allocatable :: dy(:)
    real(wp) :: mass                        ! [kg] or [kg m2]
    integer :: i
    if (any(begins)) then
      allocate (dy(size(y)))
      call self%rates(self%options, t, y, dy)
    end if
    do i = 1, size(elements)
      if (.not. begins(i)) cycle
      if (is_rigid_stop(self%m, elements(i))) cycle
      associate (k => self%m%s%switching(elements(i)))
        mass = mass_at(self%m, self%ev, k)
        call self%tally(elements(i))%note_contact(mass, time_of_contact(self%m, self%ev, k, mass))
      end associate
    end do
    call limit_steps(self)
  end subroutine begin_contacts

  !> Contacts that no touching began: those at the start, and those that had let go there and press again. A restitution is one of
  !> the speed at touching, here that from which the mass that they meet would have come so deep; the least one would make them as
  !> stiff as no contact is.
  subroutine rate_contacts(self, t, y, touched)
    class(switching_mechanism), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(in), contiguous :: y(:)   !! (ny) [m, rad], [m/s, rad/s], [J]
    logical, intent(in) :: touched(:)       !! (stops)
    real(wp) :: dy(size(y)), mass           ! [the same per second]; [kg] or [kg m2]
    type(stop_contact) :: c
    integer :: i
    if (.not. any(touched)) return
    call self%rates(self%options, t, y, dy)
    do i = 1, size(touched)
      if (.not. touched(i) .or. is_rigid_stop(self%m, i)) cycle
      associate (k => self%m%s%switching(i))
        mass = mass_at(self%m, self%ev, k)
        if (mass >= huge(1.0_wp)) cycle
        select type (stop => self%m%s%forces(k)%item)
        class is (stop_model)
          if (.not. stop%rebound > 0.0_wp) cycle
          call stop%contact(self%ev%p, conditions_of(self%m, self%ev, k), c)
          associate (speed => self%ev%switches%event_value(i))
            if (t > 0.0_wp .and. speed > stop%scaled(slowest_touch)) cycle      ! that of a touching
            speed = max(speed, stop%speed_to(mass, c%depth, c%rate))
          end associate
        end select
      end associate
    end do
  end subroutine rate_contacts

  !> The longest step that all contacts allow.
  subroutine limit_steps(self)
    class(switching_mechanism), intent(inout) :: self
    integer :: k
    self%longest_step = minval([huge(1.0_wp), self%tally%longest])
    do k = 1, size(self%tally)              ! those of rigid stops are flights
      if (is_rigid_stop(self%m, k)) cycle
      self%shortest_limit = min(self%shortest_limit, self%tally(k)%longest)
    end do
  end subroutine limit_steps

  !> Accepted steps.
  subroutine note_step(self, h, g0, rate0, g1, rate1)
    class(switching_mechanism), intent(inout) :: self
    real(wp), intent(in) :: h               !! [s]
    real(wp), intent(in) :: g0(:), rate0(:), g1(:), rate1(:)   !! (roots) [any], [any/s]
    integer :: i, k
    self%sunk = 0
    do i = 1, self%m%s%stops
      k = most_roots*(i - 1) + 1            ! the penetration
      associate (element => self%m%s%switching(i), state => self%ev%switches%state(i))
        if (is_rigid_stop(self%m, i)) call self%tally(i)%note_rigid(state, [g0(k), g1(k)])
        if (state == 0 .or. is_rigid_stop(self%m, i)) cycle
        select type (stop => self%m%s%forces(element)%item)
        class is (stop_model)
          call self%tally(i)%note_step(stop, conditions_of(self%m, self%ev, element), self%follows_stiffness, h, &
                                       [g0(k), g1(k)], [rate0(k), rate1(k)])
          if (stop%measure%sunk(self%ev%p)) self%sunk = i
        end select
      end associate
    end do
    do i = 1, size(self%friction)
      associate (law => self%m%s%friction(i))
        associate (state => self%ev%switches%state(law%number))
          call note_way(self, i)
          if (sliding(state) /= 0 .or. state == row_parted) cycle
          call self%friction(i)%note_rest(h, law%share(state, self%ev%lambda, self%ev%rows%pressed(law%row)))
        end associate
      end associate
    end do
    self%fault = self%fault .or. self%sunk > 0
    call limit_steps(self)
    if (.not. allocated(self%painleve)) return
    self%ev%slip%start = merge(self%ev%lambda, 0.0_wp, abs(self%ev%lambda) < huge(1.0_wp))
    do i = 1, min(checked_per_step, size(self%painleve))
      self%last_checked = 1 + mod(self%last_checked, size(self%painleve))
      self%painleve(self%last_checked) = painleve_ratio(self%m, self%ev, self%last_checked, .false.)
      self%fault = self%fault .or. self%painleve(self%last_checked) >= 1.0_wp
    end do
  end subroutine note_step

  !> The longest fixed step that contacts allow, graded towards their ends.
  real(wp) function longest_fixed(self, h, order) result(longest)   ! [s]
    class(switching_mechanism), intent(in) :: self
    real(wp), intent(in) :: h               !! [s]
    integer, intent(in) :: order            !! of the method
    integer :: i
    longest = self%longest_step
    if (self%roots == 0) return
    do i = 1, size(self%tally)
      if (self%ev%switches%state(i) == inactive) cycle
      if (is_rigid_stop(self%m, i)) cycle   ! its contact takes no time
      select type (stop => self%m%s%forces(self%m%s%switching(i))%item)
      class is (stop_model)
        longest = min(longest, self%tally(i)%graded(min(h, longest), order, stop%smoothness()))
      end select
    end do
  end function longest_fixed

  !> Saves or restores states and events that are not yet written.
  subroutine exchange_switches(self, a)
    class(switching_mechanism), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    integer(ip), allocatable :: words(:)
    integer :: k
    if (self%roots == 0) return
    do k = 1, size(self%ev%control)
      call a%exchange(self%ev%control(k)%state)
    end do
    words = self%ev%switches%state
    call a%exchange(words)
    self%ev%switches%state = int(words)
    call a%exchange(self%ev%switches%event_value)
    if (allocated(self%ev%slip%start)) call a%exchange(self%ev%slip%start)
    call a%exchange(self%ev%switches%indeterminate, self%longest_step, self%shortest_limit)
    call self%events%exchange(a)
    words = transfer(self%tally, [0_ip])
    call a%exchange(words)
    self%tally = transfer(words, self%tally)
    call self%choose_rows()
    words = transfer(self%friction, [0_ip])
    call a%exchange(words)
    self%friction = transfer(words, self%friction)
    call limit_steps_at_rest(self)
    if (.not. allocated(self%painleve)) return
    call a%exchange(self%last_checked)
    call a%exchange(self%painleve)
  end subroutine exchange_switches

  !> Implicit methods choose rows anew where states have changed; others do nothing.
  subroutine keep_rows(self)
    class(switching_mechanism), intent(inout) :: self
  end subroutine keep_rows
end module mechanism_events
