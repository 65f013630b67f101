!> Events of the mechanism: stops that touch and part, impacts, joints that stick and slip, controllers that are limited or sample.
module mechanism_events
  use kinds, only: wp
  use archive, only: value_archive
  use contact_mass, only: mass_at, time_of_contact
  use controls, only: exchange_controls, pass_control_events, start_controls, watch_controls
  use dynamics, only: evaluate, marker_kinematics, motion_state
  use evaluation_results, only: conditions_of, evaluation
  use force_element, only: by_position, idle, most_roots
  use friction_law, only: row_carried, row_stuck
  use friction_shares, only: find_undetermined
  use friction_states, only: comes_to_rest, hold_resting, settle_friction
  use friction_tally, only: exchange_friction, joint_tally
  use impacts, only: impact_result, pass_impacts
  use mechanism_rates, only: moving_mechanism
  use projection, only: project
  use slipping, only: keep_multipliers, pressing
  use stops, only: stop_model
  use switch_tally, only: element_tally, exchange_tallies
  use switching, only: event_list, exchange_states, is_rigid_stop, pass_events, start_states, switch_event, watch_roots, watch_rows
  implicit none (type, external)
  private

  real(wp), parameter :: difference_time = 1.0e-6_wp   !! between evaluations of a difference quotient, of an output step [-]
  real(wp), parameter :: least_change = 1.0e3_wp   !! a smaller change is rounding; of the values that count as zero [-]
  integer, parameter :: checked_per_step = 4  !! joints whose Painleve's ratio is found in an accepted step

  !> The system with its events.
  type, abstract, extends(moving_mechanism), public :: switching_mechanism
    type(event_list) :: events                !! of elements that switch
    integer :: conflict = 0                   !! a rigid stop that is pressed by a part which cannot move back; 0: none
    type(element_tally), allocatable :: tally(:)   !! of each of them
    type(joint_tally), allocatable :: friction(:)  !! of each joint with friction
    logical :: follows_stiffness = .true.     !! steps have to be short beside the stiffest contact: the method is explicit
    real(wp) :: shortest_limit = huge(1.0_wp) !! shortest of all steps that contacts allowed [s]
    real(wp), allocatable :: pressing(:)      !! (rows that switch) Painleve's ratio when it was last found [-]
    integer :: last_checked = 0               !! row whose ratio was found last
    type(evaluation), allocatable, private :: nearby   !! a little later, for difference quotients
    real(wp) :: output_step = huge(1.0_wp)    !! between two rows of the history [s]
  contains
    procedure :: start_switching
    procedure :: position_of
    procedure :: hold_friction
    procedure :: hold_stops
    procedure :: free_friction
    procedure :: find_roots
    procedure :: resolve_events
    procedure :: note_step
    procedure :: longest_fixed
    procedure :: exchange_switches
    procedure :: choose_rows => keep_rows
  end type switching_mechanism

contains

  !> Elements that switch take their states from the start; from now on only events change them. Controllers are switched on.
  subroutine start_switching(self, t, y)
    class(switching_mechanism), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(inout), contiguous :: y(:)   !! (ny) [m, rad], [m/s, rad/s], [J]
    integer :: k
    self%ev%t = t
    self%ev%options = self%options
    associate (nq => self%m%s%nq, nz => self%m%s%nz)
      call start_states(self%m, self%ev, y(1:nq), y(nq + 1:2*nq))
      call start_controls(self%m, self%ev, y(1:nq), y(nq + 1:2*nq), y(2*nq + 1:2*nq + nz))
    end associate
    self%roots = most_roots*self%m%s%elements + 2*size(self%m%s%controllers)
    allocate (self%tally(size(self%m%s%switching)))
    allocate (self%friction(self%m%s%elements - size(self%tally)))
    if (self%m%s%stops > 0) call begin_contacts(self, t, y, [(k, k=1, self%m%s%stops)], &
                                                self%ev%switches%state(:self%m%s%stops) /= 0)
    call meet_rigid_stops(self, t, y, spread(.false., 1, self%roots))
    call count_events(self, t, 1)
    call self%hold_friction(y)
    call limit_steps_at_rest(self)
    do k = 1, size(self%friction)
      self%friction(k)%position = self%position_of(k)
    end do
    call find_undetermined(self%m, self%ev, self%friction%undetermined)
  end subroutine start_switching

  !> Position of joint k of those with friction in the last evaluation [m] or [rad].
  pure real(wp) function position_of(self, k)
    class(switching_mechanism), intent(in) :: self
    integer, intent(in) :: k
    associate (row => self%m%s%constraints(self%m%s%permanent + k)%item)
      position_of = row%measure(self%ev%p)/merge(row%size, 1.0_wp, row%angular)
    end associate
  end function position_of

  !> Rigid stops that are touched and pressed at a state at rest at t = 0 are closed, others open.
  subroutine hold_stops(self, y)
    class(switching_mechanism), intent(inout) :: self
    real(wp), intent(in), contiguous :: y(:)   !! (ny) [m, rad], [m/s, rad/s], [J]
    type(motion_state) :: at
    type(event_list) :: unheard
    type(impact_result) :: x
    integer :: k
    if (self%m%s%stop_rows == 0) return
    do k = 1, self%m%s%stops
      if (is_rigid_stop(self%m, k)) self%ev%switches%state(k) = idle
    end do
    at = self%motion_at(0.0_wp, y)
    call pass_impacts(self%m, self%ev, at, spread(.false., 1, most_roots*self%m%s%elements), unheard, x)
  end subroutine hold_stops

  !> Joints with friction stick or slip as they do at t = 0.
  subroutine hold_friction(self, y)
    class(switching_mechanism), intent(inout) :: self
    real(wp), intent(in), contiguous :: y(:)   !! (ny) [m, rad], [m/s, rad/s], [J]
    logical :: none(most_roots*size(self%m%s%friction)), ok
    logical, dimension(size(self%m%s%friction)) :: rests, breaks   ! (rows that switch)
    if (size(self%m%s%friction) == 0) return
    none = .false.
    call self%free_friction()
    call hold_resting(self%m, self%ev, self%motion_at(0.0_wp, y), none, rests, breaks)
    call settle_friction(self%m, self%ev, self%motion_at(0.0_wp, y), none, rests, breaks, ok)
    self%pressing = spread(0.0_wp, 1, size(self%m%s%friction))
    call check_friction(self, ok)
  end subroutine hold_friction

  !> Friction acts no longer.
  subroutine free_friction(self)
    class(switching_mechanism), intent(inout) :: self
    self%ev%switches%state(size(self%m%s%switching) + 1:) = by_position
  end subroutine free_friction

  !> Roots of the elements that switch, then of controllers.
  subroutine find_roots(self, t, y, left_limit, g, rate, zero)
    class(switching_mechanism), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(in), contiguous :: y(:)   !! (ny) [m, rad], [m/s, rad/s], [J]
    logical, intent(in) :: left_limit       !! y is the end of a step
    real(wp), intent(out) :: g(:), rate(:), zero(:)   !! (roots) [any], [any/s], [any]
    integer :: k
    k = self%roots - 2*size(self%m%s%controllers)
    associate (nq => self%m%s%nq, nz => self%m%s%nz, n => most_roots*size(self%m%s%switching))
      if (size(self%m%s%friction) > 0 .or. holds_stops(self)) then
        call self%look_at(t, y, left_limit)
        call watch_rows(self%m, self%ev, g(n + 1:k), rate(n + 1:k), zero(n + 1:k))
        call measure_rates(self, t, y, g(n + 1:k), rate(n + 1:k), zero(n + 1:k))
        self%events_may_follow = comes_to_rest(self%m, self%ev)
      end if
      if (n + size(self%m%s%controllers) > 0) call marker_kinematics(self%m, self%ev, y(1:nq), y(nq + 1:2*nq))
      call watch_roots(self%m, self%ev, g(:n), rate(:n), zero(:n))
      call watch_controls(self%m, self%ev, t, left_limit, y(2*nq + 1:2*nq + nz), g(k + 1:), rate(k + 1:), zero(k + 1:))
    end associate
  end subroutine find_roots

  !> Rates of the distances to the limits of joints that stick, by a second evaluation a little later. With them a share that
  !> reaches its limit and leaves it within a step is found. A change that may be rounding gives no rate.
  subroutine measure_rates(self, t, y, g, rate, zero)
    class(switching_mechanism), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(in), contiguous :: y(:)   !! (ny) [m, rad], [m/s, rad/s], [J]
    real(wp), intent(in) :: g(:), zero(:)   !! (roots of the rows) of the last evaluation [any]
    real(wp), intent(inout) :: rate(:)      !! (roots of the rows) [any/s]
    real(wp), dimension(size(g)) :: later, unused, rounding   ! [any], [any/s], [any]
    real(wp) :: h                           ! [s]
    integer :: k
    if (size(self%m%s%friction) == 0) return
    if (.not. allocated(self%nearby)) allocate (self%nearby, source=self%ev)
    associate (s => self%m%s, ev => self%ev, x => self%nearby)
      if (.not. any(ev%switches%state(size(s%switching) + 1:) == row_stuck)) return
      if (ev%schur%singular .or. ev%broken .or. .not. self%output_step < huge(1.0_wp)) return
      x%switches%state = ev%switches%state
      x%switches%memory = ev%switches%memory
      x%slip%start = ev%lambda
      x%control = ev%control
      x%broken = .false.
      h = sign(difference_time*self%output_step, merge(-1.0_wp, 1.0_wp, ev%options%left_limit))
      associate (q => y(1:s%nq), v => y(s%nq + 1:2*s%nq), z => y(2*s%nq + 1:2*s%nq + s%nz), nzd => s%nzd, &
                 zd => y(2*s%nq + s%nz + 1:2*s%nq + s%nz + s%nzd))
        call evaluate(self%m, x, ev%options, t + h, q + h*v, v + h*ev%a, z + h*[zd, ev%zdd(nzd + 1:)], zd + h*ev%zdd(:nzd))
      end associate
      if (x%schur%singular .or. x%broken) return
      call watch_rows(self%m, x, later, unused, rounding)
      do k = 1, size(s%friction)
        if (ev%switches%state(s%friction(k)%number) /= row_stuck) cycle
        associate (i => most_roots*(k - 1) + 1)
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

  !> Events change states, rigid stops change velocities. Joints that begin to stick lose their rate. Samples change outputs of
  !> controllers.
  subroutine resolve_events(self, t, y, fallen, ok)
    class(switching_mechanism), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(inout), contiguous :: y(:)   !! (ny) [m, rad], [m/s, rad/s], [J]
    logical, intent(in) :: fallen(:)        !! (roots)
    logical, intent(out) :: ok
    integer :: n, before(self%m%s%elements)
    real(wp) :: memory(self%m%s%elements)   ! before [any]
    ok = .true.
    call self%forget()
    self%unchanged = .false.
    before = self%ev%switches%state
    memory = self%ev%switches%memory
    n = self%roots - 2*size(self%m%s%controllers)
    associate (nq => self%m%s%nq, nz => self%m%s%nz)
      call pass_control_events(self%m, self%ev, t, y(1:nq), y(nq + 1:2*nq), y(2*nq + 1:2*nq + nz), fallen(n + 1:))
      if (n == 0) return
      n = self%events%count
      call meet_rigid_stops(self, t, y, fallen)
      if (size(self%tally) > 0) call pass_events(self%m, self%ev, t, y(1:nq), y(nq + 1:2*nq), &
                                                 fallen(:most_roots*size(self%tally)), self%events, ok)
    end associate
    ok = ok .and. self%conflict == 0
    call count_events(self, t, n + 1)
    call self%choose_rows()
    call begin_contacts(self, t, y, self%events%items(n + 1:self%events%count)%element, &
                        self%events%items(n + 1:self%events%count)%from == 0)
    if (ok .and. size(self%m%s%friction) > 0) call resolve_friction(self, t, y, fallen, before, ok)
    call limit_steps_at_rest(self)
    self%unchanged = self%events%count == n .and. all(self%ev%switches%state == before) .and. &
                     .not. any(abs(self%ev%switches%memory - memory) > 0.0_wp) .and. &
                     .not. any(fallen(most_roots*self%m%s%elements + 1:))
  end subroutine resolve_events

  !> Counts the events of force elements since one of the list.
  subroutine count_events(self, t, first)
    class(switching_mechanism), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    integer, intent(in) :: first            !! its number
    integer :: k
    do k = first, self%events%count
      associate (event => self%events%items(k))
        call self%tally(event%element)%note_event(t, event%from, event%to)
      end associate
    end do
  end subroutine count_events

  !> Passes the rigid stops that are touched.
  subroutine meet_rigid_stops(self, t, y, fallen)
    class(switching_mechanism), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(inout), contiguous :: y(:)   !! (ny) [m, rad], [m/s, rad/s], [J]
    logical, intent(in) :: fallen(:)        !! (roots)
    type(motion_state) :: at
    type(impact_result) :: x
    logical :: ok
    integer :: k
    if (self%m%s%stop_rows == 0) return
    at = self%motion_at(t, y)
    associate (n => self%m%s%nq, i => 2*self%m%s%nq + self%m%s%nz, e => 2*self%m%s%nq + self%m%s%nz + self%m%s%nzd)
      call pass_impacts(self%m, self%ev, at, fallen, self%events, x)
      y(n + 1:2*n) = at%v
      self%conflict = x%conflict
      if (.not. x%any) return
      ok = .true.
      if (x%conflict == 0) call project(self%m, self%ev, self%options, t, y(1:n), y(n + 1:2*n), y(2*n + 1:i), y(i + 1:e), ok)
      if (.not. ok) self%conflict = maxloc(x%impulse, 1)
      y(e + 1) = y(e + 1) + sum(x%lost)
      y(e + 2) = y(e + 2) + x%work
      k = size(y) - size(x%integrated) + 1
      y(k:) = y(k:) + x%integrated
      do k = 1, size(x%lost)
        y(e + 2 + k) = y(e + 2 + k) + x%lost(k)
        if (is_rigid_stop(self%m, k)) call self%tally(k)%note_impact(x%impulse(k), x%flight(k))
      end do
    end associate
  end subroutine meet_rigid_stops

  !> Joints with friction after any event.
  subroutine resolve_friction(self, t, y, fallen, before, ok)
    class(switching_mechanism), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(inout), contiguous :: y(:)   !! (ny) [m, rad], [m/s, rad/s], [J]
    logical, intent(in) :: fallen(:)        !! (roots)
    integer, intent(in) :: before(:)        !! (elements that switch) states
    logical, intent(out) :: ok
    logical, dimension(size(self%friction)) :: rests, breaks   ! (rows that switch)
    integer :: k
    k = most_roots*self%m%s%elements
    associate (roots => fallen(most_roots*size(self%tally) + 1:k))
      call hold_resting(self%m, self%ev, self%motion_at(t, y), roots, rests, breaks)
      if (self%has_manifold) call self%project(t, y, ok)
      call settle_friction(self%m, self%ev, self%motion_at(t, y), roots, rests, breaks, ok)
    end associate
    do k = size(self%tally) + 1, self%m%s%elements
      associate (state => self%ev%switches%state(k))
        if (state == before(k)) cycle
        call self%events%add(switch_event(t, k, before(k), state))
        call self%friction(k - size(self%tally))%note_event(t, before(k), state)
      end associate
    end do
    do k = 1, size(self%friction)
      call self%friction(k)%note_position(self%position_of(k))
    end do
    call find_undetermined(self%m, self%ev, self%friction%undetermined)
    call check_friction(self, ok)
    if (self%has_manifold .and. .not. self%fault) call self%project(t, y, ok)
  end subroutine resolve_friction

  !> Whether there are states of the joints with friction, and one motion with them.
  subroutine check_friction(self, settled)
    class(switching_mechanism), intent(inout) :: self
    logical, intent(in) :: settled
    integer :: k
    do k = 1, size(self%pressing)
      self%pressing(k) = pressing(self%m, self%ev, k, .true.)
    end do
    self%fault = .not. settled .or. any(self%pressing >= 1.0_wp)
  end subroutine check_friction

  !> While joints stick or rigid stops are closed, steps are not longer than the output interval: their load may change.
  subroutine limit_steps_at_rest(self)
    class(switching_mechanism), intent(inout) :: self
    logical :: holds
    holds = holds_stops(self)
    associate (state => self%ev%switches%state(size(self%tally) + 1:))
      holds = holds .or. any(state == row_stuck .or. abs(state) == row_carried)
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
    do i = 1, self%m%s%stops
      k = most_roots*(i - 1) + 1            ! the penetration
      associate (element => self%m%s%switching(i), state => self%ev%switches%state(i))
        if (is_rigid_stop(self%m, i)) call self%tally(i)%note_rigid(state, [g0(k), g1(k)])
        if (state == 0 .or. is_rigid_stop(self%m, i)) cycle
        select type (stop => self%m%s%forces(element)%item)
        class is (stop_model)
          call self%tally(i)%note_step(stop, conditions_of(self%m, self%ev, element), self%follows_stiffness, h, &
                                       [g0(k), g1(k)], [rate0(k), rate1(k)])
        end select
      end associate
    end do
    do i = 1, size(self%friction)
      associate (law => self%m%s%friction(i))
        associate (state => self%ev%switches%state(law%number))
          if (law%slides(state) == 0) call self%friction(i)%note_rest(h, law%share(state, self%ev%lambda))
        end associate
      end associate
    end do
    call limit_steps(self)
    if (.not. allocated(self%pressing)) return
    call keep_multipliers(self%ev)
    do i = 1, min(checked_per_step, size(self%pressing))
      self%last_checked = 1 + mod(self%last_checked, size(self%pressing))
      self%pressing(self%last_checked) = pressing(self%m, self%ev, self%last_checked, .false.)
      self%fault = self%fault .or. self%pressing(self%last_checked) >= 1.0_wp
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
      if (self%ev%switches%state(i) == idle) cycle
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
    if (self%roots == 0) return
    call exchange_controls(self%ev, a)
    call exchange_states(self%ev, a)
    call a%exchange(self%longest_step)
    call a%exchange(self%shortest_limit)
    call self%events%exchange(a)
    call exchange_tallies(self%tally, a)
    call self%choose_rows()
    call exchange_friction(self%friction, a)
    call limit_steps_at_rest(self)
    if (.not. allocated(self%pressing)) return
    call a%exchange(self%pressing)
    call a%exchange(self%last_checked)
  end subroutine exchange_switches

  !> Implicit methods choose rows anew where states have changed; others do nothing.
  subroutine keep_rows(self)
    class(switching_mechanism), intent(inout) :: self
  end subroutine keep_rows
end module mechanism_events
