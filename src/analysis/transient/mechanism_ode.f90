!> The mechanism as integrators see it: first-order equations for explicit methods, second-order ones for implicit methods. State:
!> q, v, z, z' (of second order), dissipated energy, work, energies lost in stops (layout in `scene_model`).
module mechanism_ode
  use kinds, only: wp
  use archive, only: value_archive
  use border_row_lists, only: row_lists, list_rows, order_rows
  use border_rows, only: hold_weak_rows, light_shift, least_shift, strong_shift, stage_shift
  use controls, only: control_inputs, control_slopes, exchange_controls, pass_control_events, solve_controls, start_controls, &
                      watch_controls
  use dynamics, only: evaluate, motion_state, set_frames, marker_kinematics, constraint_values
  use evaluation_settings, only: evaluation_options, at_side
  use evaluation_results, only: conditions_of, evaluation, powers_of
  use condensed_system, only: change_rows
  use force_element, only: idle, by_position, most_roots
  use friction_states, only: comes_to_rest, settle_friction
  use friction_row, only: friction_model, row_stuck
  use friction_tally, only: joint_tally, exchange_friction
  use mechanism, only: mechanism_model
  use newton_condensation, only: condense
  use contact_mass, only: mass_at, time_of_contact
  use impacts, only: impact_result, pass_impacts
  use complex_newton_condensation, only: condense_complex => condense
  use newton_correction, only: take_residual, correction, row_correction
  use complex_newton_correction, only: take_complex => take_residual, correct_complex => correction
  use newton_equations, only: prepare, give_terms, let_terms_follow, residual, take_body_residuals => take_residual, renew
  use newton_results, only: term_deformations, relaxation_rates, find_powers, mass_product, resolved_part, scene_reach
  use newton_start, only: smooth_accelerations, row_gaps
  use newton_system, only: newton_matrix, set_up_newton
  use ode_system, only: largest_value, is_bounded
  use position_measures, only: position_measure
  use projection, only: project
  use second_order_system, only: second_order_ode
  use singular, only: evaluate_branch
  use switched_rows, only: slip_gaps
  use slipping, only: pressing
  use switch_tally, only: element_tally, exchange_tallies
  use switching, only: event_list, switch_event, start_states, watch_roots, watch_rows, pass_events, exchange_states, &
                       is_rigid_stop
  use stage_equations, only: stage_residual, factor_stages, stage_tangents
  use complex_condensed_system, only: complex_matrix => condensed_matrix, set_up_complex => set_up_condensed, &
                                      change_complex => change_rows
  implicit none (type, external)
  private

  real(wp), parameter :: weak_row = 1.0e-3_wp      !! relative pivot of the multipliers' matrix from which rows nearly depend [-]

  !> The system.
  type, extends(second_order_ode), public :: mechanism_system
    type(mechanism_model) :: m                !! constant once assembled
    type(evaluation) :: ev                    !! its last evaluation
    type(evaluation_options) :: options       !! what acts in the present analysis
    type(event_list) :: events                !! of elements that switch
    integer :: conflict = 0                   !! a rigid stop against which something presses that cannot give way; 0: none
    type(element_tally), allocatable :: tally(:)   !! of each of them
    type(joint_tally), allocatable :: friction(:)  !! of each joint with friction
    real(wp) :: shortest_limit = huge(1.0_wp) !! shortest of all steps that contacts allowed [s]
    real(wp), allocatable :: pressing(:)      !! (rows that switch) the last time it was looked at: Painleve's ratio [-]
    integer :: turn = 0                       !! the row that was looked at last
    real(wp) :: output_step = huge(1.0_wp)    !! between two rows of the history [s]
    type(newton_matrix), allocatable :: t     !! implicit methods: the dynamic stiffness
    type(complex_matrix), allocatable :: stages   !! methods of several stages: the same for a complex constant
    logical, allocatable, private :: bordered(:)   !! whether each element that switches has rows in the border of implicit steps
    real(wp), allocatable, private :: closed(:), closed_rates(:)   !! (nq) work: a state on the constraints [m, rad] and per second
  contains
    procedure :: start_implicit
    procedure :: prepare => mechanism_prepare
    procedure :: give_internal
    procedure :: residual => mechanism_residual
    procedure :: renew => mechanism_renew
    procedure :: correction => mechanism_correction
    procedure :: stage_residual => mechanism_stage
    procedure :: take_parts
    procedure :: renew_stages
    procedure :: complex_correction
    procedure :: deformations
    procedure :: solve_linear
    procedure :: powers
    procedure :: mass_product => mechanism_mass
    procedure :: accelerations
    procedure :: report
    procedure :: smooth
    procedure :: gaps
    procedure :: along_rows => mechanism_along
    procedure :: resolve
    procedure :: rates                        !! of the state with other options
    procedure :: derivative
    procedure :: project => mechanism_project
    procedure :: start_switching
    procedure :: place_of
    procedure :: hold_friction
    procedure :: hold_stops
    procedure :: free_friction
    procedure :: find_roots
    procedure :: resolve_events
    procedure :: note_step
    procedure :: longest_fixed
    procedure :: exchange_switches
  end type mechanism_system

contains

  !> Rates of the whole state (theory.md, sections 3 to 6).
  subroutine derivative(self, t, y, left_limit, dy)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(in), contiguous :: y(:)   !! (ny) [m, rad], [m/s, rad/s], [J]
    logical, intent(in) :: left_limit
    real(wp), intent(out), contiguous :: dy(:)   !! (ny) [the same per second]
    call self%rates(at_side(self%options, left_limit), t, y, dy)
  end subroutine derivative

  !> The same with other options.
  subroutine rates(self, options, t, y, dy)
    class(mechanism_system), intent(inout) :: self
    type(evaluation_options), intent(in) :: options
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(in), contiguous :: y(:)   !! (ny) [m, rad], [m/s, rad/s], [J]
    real(wp), intent(out), contiguous :: dy(:)   !! (ny) [the same per second]
    self%ev%broken = .false.
    associate (m => self%m, ev => self%ev, nq => self%m%s%nq, nz => self%m%s%nz, nzd => self%m%s%nzd)
      call evaluate_branch(m, ev, options, t, y(1:nq), y(nq + 1:2*nq), y(2*nq + 1:2*nq + nz), y(2*nq + nz + 1:2*nq + nz + nzd))
      dy(1:nq) = y(nq + 1:2*nq)
      dy(nq + 1:2*nq) = ev%a
      if (ev%broken) dy(nq + 1:2*nq) = 10*largest_value       ! no acceleration: whoever uses it sees that it is lost
      dy(2*nq + 1:2*nq + nzd) = y(2*nq + nz + 1:2*nq + nz + nzd)
      dy(2*nq + nzd + 1:2*nq + nz) = ev%zdd(nzd + 1:)
      dy(2*nq + nz + 1:2*nq + nz + nzd) = ev%zdd(1:nzd)
      call powers_of(m, ev, dy(2*nq + nz + nzd + 1:))
    end associate
  end subroutine rates

  !> Projects an accepted state, from the side of the last evaluation; refuses states that are not finite.
  subroutine mechanism_project(self, t, y, ok)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(inout), contiguous :: y(:)   !! (ny) [m, rad], [m/s, rad/s], [J]
    logical, intent(out) :: ok
    ok = is_bounded(y) .and. .not. self%ev%broken
    if (.not. ok .or. .not. self%has_manifold) return
    associate (ev => self%ev, nq => self%m%s%nq, nz => self%m%s%nz, nzd => self%m%s%nzd)
      call project(self%m, ev, ev%options, t, y(1:nq), y(nq + 1:2*nq), y(2*nq + 1:2*nq + nz), &
                   y(2*nq + nz + 1:2*nq + nz + nzd), ok)
      if (ok) ok = is_bounded(y(1:2*nq))
    end associate
  end subroutine mechanism_project

  !> Elements that switch take their states from a position that no event has led to; from now on they keep them. Controllers are
  !> switched on.
  subroutine start_switching(self, t, y)
    class(mechanism_system), intent(inout) :: self
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
    call self%hold_friction(t, y)
    do k = 1, size(self%friction)
      self%friction(k)%place = self%place_of(k)
    end do
  end subroutine start_switching

  !> Where joint k of those with friction stands in its last evaluation [m] or [rad].
  pure real(wp) function place_of(self, k)
    class(mechanism_system), intent(in) :: self
    integer, intent(in) :: k
    associate (row => self%m%s%constraints(self%m%s%switching_rows(k))%item)
      place_of = row%measure(self%ev%p)/merge(row%size, 1.0_wp, row%angular)
    end associate
  end function place_of

  !> Rigid stops that are touched and pressed at a state at rest are closed, others open.
  subroutine hold_stops(self, t, y)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(in), contiguous :: y(:)   !! (ny) [m, rad], [m/s, rad/s], [J]
    type(motion_state) :: at
    type(event_list) :: unheard
    type(impact_result) :: x
    integer :: k
    if (self%m%s%stop_rows == 0) return
    do k = 1, self%m%s%stops
      if (is_rigid_stop(self%m, k)) self%ev%switches%state(k) = idle
    end do
    at = motion_at(self, t, y)
    call pass_impacts(self%m, self%ev, at, spread(.false., 1, most_roots*self%m%s%elements), unheard, x)
  end subroutine hold_stops

  !> Joints with friction stick or slip as at a state that no event has led to.
  subroutine hold_friction(self, t, y)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(in), contiguous :: y(:)   !! (ny) [m, rad], [m/s, rad/s], [J]
    logical :: ok
    if (size(self%m%s%switching_rows) == 0) return
    call self%free_friction()
    call settle_friction(self%m, self%ev, motion_at(self, t, y), spread(.false., 1, most_roots*size(self%m%s%switching_rows)), ok)
    self%pressing = spread(0.0_wp, 1, size(self%m%s%switching_rows))
    call judge_friction(self, ok)
  end subroutine hold_friction

  !> Friction acts no longer.
  subroutine free_friction(self)
    class(mechanism_system), intent(inout) :: self
    self%ev%switches%state(size(self%m%s%switching) + 1:) = by_position
  end subroutine free_friction

  !> Roots of the elements that switch, then of controllers.
  subroutine find_roots(self, t, y, left_limit, g, rate, zero)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(in), contiguous :: y(:)   !! (ny) [m, rad], [m/s, rad/s], [J]
    logical, intent(in) :: left_limit       !! y is the end of a step
    real(wp), intent(out) :: g(:), rate(:), zero(:)   !! (roots) [any], [any/s], [any]
    integer :: k
    k = self%roots - 2*size(self%m%s%controllers)
    associate (nq => self%m%s%nq, nz => self%m%s%nz, nzd => self%m%s%nzd, n => most_roots*size(self%m%s%switching))
      if (size(self%m%s%switching_rows) > 0 .or. holds_stops(self)) then
        call evaluate_branch(self%m, self%ev, at_side(self%options, left_limit), t, y(1:nq), y(nq + 1:2*nq), &
                             y(2*nq + 1:2*nq + nz), y(2*nq + nz + 1:2*nq + nz + nzd))
        call watch_rows(self%m, self%ev, g(n + 1:k), rate(n + 1:k), zero(n + 1:k))
        self%unsettled = comes_to_rest(self%m, self%ev)
      end if
      if (n + size(self%m%s%controllers) > 0) call marker_kinematics(self%m, self%ev, y(1:nq), y(nq + 1:2*nq))
      call watch_roots(self%m, self%ev, g(:n), rate(:n), zero(:n))
      call watch_controls(self%m, self%ev, t, left_limit, y(2*nq + 1:2*nq + nz), g(k + 1:), rate(k + 1:), zero(k + 1:))
    end associate
  end subroutine find_roots

  !> Whether a rigid stop is closed.
  pure logical function holds_stops(self) result(yes)
    class(mechanism_system), intent(in) :: self
    integer :: k
    yes = .false.
    do k = size(self%m%s%constraints) - self%m%s%stop_rows + 1, size(self%m%s%constraints)
      associate (c => self%m%s%constraints(k)%item)
        yes = yes .or. c%holds(self%ev%switches%state(c%switch_number))
      end associate
    end do
  end function holds_stops

  !> The parts of a state.
  pure type(motion_state) function motion_at(self, t, y) result(at)
    class(mechanism_system), intent(in) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(in) :: y(:)            !! (ny) [m, rad], [m/s, rad/s], [J]
    associate (nq => self%m%s%nq, nz => self%m%s%nz, nzd => self%m%s%nzd)
      at = motion_state(self%options, t, y(1:nq), y(nq + 1:2*nq), y(2*nq + 1:2*nq + nz), y(2*nq + nz + 1:2*nq + nz + nzd))
    end associate
  end function motion_at

  !> Events change states, rigid stops velocities; joints that begin to stick have no rate left; samples change what controllers put
  !> out.
  subroutine resolve_events(self, t, y, fallen, ok)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(inout), contiguous :: y(:)   !! (ny) [m, rad], [m/s, rad/s], [J]
    logical, intent(in) :: fallen(:)        !! (roots)
    logical, intent(out) :: ok
    integer :: n
    ok = .true.
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
    call choose_rows(self)
    call begin_contacts(self, t, y, self%events%items(n + 1:self%events%count)%element, &
                        self%events%items(n + 1:self%events%count)%from == 0)
    if (ok .and. size(self%m%s%switching_rows) > 0) call resolve_friction(self, t, y, fallen, ok)
  end subroutine resolve_events

  !> Counts the events of force elements since one of the list.
  subroutine count_events(self, t, first)
    class(mechanism_system), intent(inout) :: self
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
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(inout), contiguous :: y(:)   !! (ny) [m, rad], [m/s, rad/s], [J]
    logical, intent(in) :: fallen(:)        !! (roots)
    type(motion_state) :: at
    type(impact_result) :: x
    logical :: ok
    integer :: k
    if (self%m%s%stop_rows == 0) return
    at = motion_at(self, t, y)
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
      do k = 1, size(x%lost)
        y(e + 2 + k) = y(e + 2 + k) + x%lost(k)
        if (is_rigid_stop(self%m, k)) call self%tally(k)%note_impact(x%impulse(k), x%flight(k))
      end do
    end associate
  end subroutine meet_rigid_stops

  !> Joints with friction after any event.
  subroutine resolve_friction(self, t, y, fallen, ok)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(inout), contiguous :: y(:)   !! (ny) [m, rad], [m/s, rad/s], [J]
    logical, intent(in) :: fallen(:)        !! (roots)
    logical, intent(out) :: ok
    integer :: before(self%m%s%elements), k
    before = self%ev%switches%state
    k = most_roots*self%m%s%elements
    call settle_friction(self%m, self%ev, motion_at(self, t, y), fallen(most_roots*size(self%tally) + 1:k), ok)
    do k = size(self%tally) + 1, self%m%s%elements
      associate (state => self%ev%switches%state(k))
        if (state == before(k)) cycle
        call self%events%add(switch_event(t, k, before(k), state))
        call self%friction(k - size(self%tally))%note_event(t, before(k), state)
      end associate
    end do
    do k = 1, size(self%friction)
      call self%friction(k)%note_place(self%place_of(k))
    end do
    call judge_friction(self, ok)
    if (self%has_manifold .and. .not. self%fault) call self%project(t, y, ok)
  end subroutine resolve_friction

  !> Whether there are states of the joints with friction, and one motion with them; steps are limited while one sticks.
  subroutine judge_friction(self, settled)
    class(mechanism_system), intent(inout) :: self
    logical, intent(in) :: settled
    integer :: k
    do k = 1, size(self%pressing)
      self%pressing(k) = pressing(self%m, self%ev, k, .true.)
    end do
    self%fault = .not. settled .or. any(self%pressing >= 1.0_wp)
    call limit_resting(self)
  end subroutine judge_friction

  !> A load on joints that stick is looked at in steps of the output at least.
  subroutine limit_resting(self)
    class(mechanism_system), intent(inout) :: self
    self%resting_step = merge(self%output_step, huge(1.0_wp), any(self%ev%switches%state(size(self%tally) + 1:) == row_stuck))
  end subroutine limit_resting

  !> How long contacts take that have just begun decides on the steps that follow.
  subroutine begin_contacts(self, t, y, elements, begins)
    class(mechanism_system), intent(inout) :: self
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
    class(mechanism_system), intent(inout) :: self
    integer :: k
    self%longest_step = minval([huge(1.0_wp), self%tally%longest])
    do k = 1, size(self%tally)              ! those of rigid stops are flights
      if (is_rigid_stop(self%m, k)) cycle
      self%shortest_limit = min(self%shortest_limit, self%tally(k)%longest)
    end do
  end subroutine limit_steps

  !> Accepted steps.
  subroutine note_step(self, h, g0, rate0, g1, rate1)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in) :: h               !! [s]
    real(wp), intent(in) :: g0(:), rate0(:), g1(:), rate1(:)   !! (roots) [any], [any/s]
    integer :: i, k
    do i = 1, self%m%s%stops
      k = most_roots*(i - 1) + 1            ! the penetration
      associate (element => self%m%s%switching(i), state => self%ev%switches%state(i))
        if (is_rigid_stop(self%m, i)) call self%tally(i)%note_rigid(state, [g0(k), g1(k)])
        if (state == 0 .or. is_rigid_stop(self%m, i)) cycle
        call self%tally(i)%note_step(self%m, element, conditions_of(self%m, self%ev, element), .not. allocated(self%t), h, &
                                     [g0(k), g1(k)], [rate0(k), rate1(k)])
      end associate
    end do
    do i = 1, size(self%friction)
      select type (row => self%m%s%constraints(self%m%s%switching_rows(i))%item)
      class is (friction_model)
        associate (state => self%ev%switches%state(row%switch_number))
          if (row%slides(state) == 0) call self%friction(i)%note_rest(h, row%share(state, self%ev%lambda))
        end associate
      end select
    end do
    call limit_steps(self)
    if (.not. allocated(self%pressing)) return
    self%turn = 1 + mod(self%turn, size(self%pressing))
    self%pressing(self%turn) = pressing(self%m, self%ev, self%turn, .false.)
    self%fault = self%pressing(self%turn) >= 1.0_wp
  end subroutine note_step

  !> The longest fixed step that contacts allow, graded towards their ends.
  real(wp) function longest_fixed(self, h, order) result(longest)   ! [s]
    class(mechanism_system), intent(in) :: self
    real(wp), intent(in) :: h               !! [s]
    integer, intent(in) :: order            !! of the method
    integer :: i
    longest = self%longest_step
    if (self%roots == 0) return
    do i = 1, size(self%tally)
      if (self%ev%switches%state(i) == idle) cycle
      associate (stop => self%m%s%forces(self%m%s%switching(i))%item)
        if (is_rigid_stop(self%m, i)) cycle ! nothing to follow
        longest = min(longest, self%tally(i)%graded(min(h, longest), order, stop%smoothness()))
      end associate
    end do
  end function longest_fixed

  !> Saves or restores states and events that have not been told.
  subroutine exchange_switches(self, a)
    class(mechanism_system), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    if (self%roots == 0) return
    call exchange_controls(self%ev, a)
    call exchange_states(self%ev, a)
    call a%exchange(self%longest_step)
    call a%exchange(self%shortest_limit)
    call self%events%exchange(a)
    call exchange_tallies(self%tally, a)
    call choose_rows(self)
    call exchange_friction(self%friction, a)
    if (.not. allocated(self%pressing)) return
    call a%exchange(self%pressing)
    call a%exchange(self%turn)
    call limit_resting(self)
  end subroutine exchange_switches

  !> Elements that are idle have no rows in the border of implicit steps: open stops would widen its band.
  subroutine choose_rows(self)
    class(mechanism_system), intent(inout) :: self
    type(row_lists) :: lists
    if (.not. allocated(self%t)) return
    associate (states => self%ev%switches%state)
      if (all(self%bordered .eqv. states(:size(self%bordered)) /= idle)) return
      self%bordered = states(:size(self%bordered)) /= idle
      call list_rows(lists, self%m, states)
    end associate
    call order_rows(lists)
    call change_rows(self%t%t, self%m, lists)
    if (allocated(self%stages)) call change_complex(self%stages, self%m, lists)
  end subroutine choose_rows

  !> Makes ready for an implicit method.
  subroutine start_implicit(self, stages)
    class(mechanism_system), intent(inout) :: self
    logical, intent(in) :: stages             !! the method has several
    integer :: k
    self%nq = self%m%s%nq
    self%nz = self%m%s%nz
    self%nzd = self%m%s%nzd
    self%linear = sum(self%m%s%controllers%states)
    self%rows = self%m%s%rows
    self%quadratures = 2 + self%m%s%elements
    self%blocks = count(self%m%s%bodies%flexible)
    if (allocated(self%t)) deallocate (self%t)
    if (allocated(self%stages)) deallocate (self%stages)
    allocate (self%t)
    self%closed = spread(0.0_wp, 1, self%nq)
    self%closed_rates = self%closed
    call set_up_newton(self%t, self%m)
    if (stages) then
      allocate (self%stages)
      call set_up_complex(self%stages, self%m, self%t%t%rows%row_lists)
      call let_terms_follow(self%t)
    end if
    self%bordered = spread(.true., 1, size(self%m%s%switching))
    call choose_rows(self)
    self%viscosity = spread(0.0_wp, 1, self%nz)
    self%inertia = self%viscosity
    do k = 1, size(self%t%terms)
      associate (t => self%t%terms(k))
        self%viscosity(t%first:t%last) = t%viscosity
        self%inertia(t%first:t%last) = t%inertia
      end associate
    end do
    self%measure = measure_of(self%m)
  end subroutine start_implicit

  !> Groups in which positions are measured, four a body: origin, angle, elastic translations, elastic rotations.
  pure type(position_measure) function measure_of(m) result(x)
    type(mechanism_model), intent(in) :: m
    integer :: b, i
    associate (s => m%s)
      allocate (x%group(s%nq), x%scale(4*size(s%bodies)), x%grows(4*size(s%bodies)))
      allocate (x%weight(s%nq), source=1.0_wp)
      allocate (x%unit(s%nq), source=0.0_wp)
      do b = 1, size(s%bodies)
        associate (body => s%bodies(b))
          i = s%qo(b)
          x%group(i + 1:i + 2) = 4*b - 3
          x%group(i + 3) = 4*b - 2
          x%group(i + 4:i + 3 + body%nf) = 4*b - 1
          if (body%flexible) then
            where (body%basis%rotation) x%group(i + 4:i + 3 + body%nf) = 4*b
            x%weight(i + 4:i + 3 + body%nf) = body%basis%reach
          end if
          x%scale(4*b - 3:4*b) = [s%size, 1.0_wp, 1.0e-6_wp*s%size, 1.0e-6_wp]
          x%grows(4*b - 3:4*b) = [.false., .false., .true., .true.]   ! frames' groups keep the scene's size, one radian
        end associate
      end do
      x%whole = x%weight/merge(1.0_wp, s%size, mod(x%group, 2) == 0)
    end associate
  end function measure_of

  !> Takes the constants of a step and factors the elastic blocks.
  subroutine mechanism_prepare(self, c1, c2, near, ok)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in) :: c1                !! [1/s2]
    real(wp), intent(in) :: c2                !! [1/s]
    real(wp), intent(in) :: near              !! of c1 [-]
    logical, intent(out) :: ok
    logical :: bad
    call prepare(self%t, self%m, c1, c2, near, bad)
    ok = .not. bad
  end subroutine mechanism_prepare

  !> Takes the dissipative coordinates of residuals to come, at zero deformation.
  subroutine give_internal(self, z)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in), contiguous :: z(:)  !! (nz) [m, rad]
    call give_terms(self%t, self%m, z)
  end subroutine give_internal

  !> Residuals at a trial state.
  subroutine mechanism_residual(self, t, q, v, a, lambda, left_limit, gap)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in), contiguous :: q(:), v(:), a(:)   !! (nq) [m, rad], rates, accelerations
    real(wp), intent(in), contiguous :: lambda(:)          !! (rows) [N]
    logical, intent(in) :: left_limit
    real(wp), intent(out), contiguous :: gap(:)            !! (rows) [m]
    call residual(self%t, self%m, self%ev, at_side(self%options, left_limit), t, q, v, a, lambda)
    call take_body_residuals(self%t, self%m)
    gap = self%ev%rows%phi
    call slip_gaps(self%m, self%ev, lambda, gap)
  end subroutine mechanism_residual

  !> The matrix at the state of the last residual. Rows that depend on others in a singular position are held: all of them by a
  !> stronger shift within a step (exact or not), the weak ones at its start.
  subroutine mechanism_renew(self, q, v, a, lambda, exact, hold, ok)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in), contiguous :: q(:), v(:), a(:)   !! (nq) [m, rad], rates, accelerations
    real(wp), intent(in), contiguous :: lambda(:)          !! (rows) [N]
    logical, intent(in) :: exact, hold
    logical, intent(out) :: ok
    logical :: bad
    associate (in_step => self%ev%options%left_limit)
      self%shift = merge(light_shift, least_shift, self%m%redundant)
      if (hold .and. in_step) self%shift = strong_shift
      call give_gains(self)
      call renew(self%t, self%m, self%ev, q, v, a, lambda, exact, self%shift, bad)
      if (hold .and. .not. in_step) call hold_weak_rows(self%t%t%rows)
    end associate
    self%weakest = self%t%t%rows%weakest
    self%reach = scene_reach(self%m, self%ev, q)
    ok = .not. bad
  end subroutine mechanism_renew

  !> What controllers make of motions that grow as the matrices say.
  subroutine give_gains(self)
    class(mechanism_system), intent(inout) :: self
    integer :: k
    if (size(self%m%s%controllers) == 0) return
    do k = 1, size(self%m%s%forces)
      associate (c => self%m%s%forces(k)%item%controller)
        if (c == 0) cycle
        associate (control => self%m%s%controllers(c), side => self%ev%control(c)%limited)
          self%t%t%element_factor(k) = real(control%response(side, cmplx(self%t%t%c2, 0.0_wp, wp)), wp)
          if (allocated(self%stages)) self%stages%element_factor(k) = control%response(side, self%stages%c2)
        end associate
      end associate
    end do
  end subroutine give_gains

  !> Corrections by the matrix that stands, of several stages the real one.
  subroutine mechanism_correction(self, gap, dq, dlambda)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in), contiguous :: gap(:)        !! (rows) [m]
    real(wp), intent(out), contiguous :: dq(:)        !! (nq) [m, rad]
    real(wp), intent(out), contiguous :: dlambda(:)   !! (rows) [N]
    call correction(self%t%t, self%m, self%ev, gap, dq)
    dlambda = self%t%t%rows%y(1:self%rows)
  end subroutine mechanism_correction

  !> Powers at the end of a step or stage.
  subroutine powers(self, t, q, v, lambda, z, zd, power)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in), contiguous :: q(:), v(:)        !! (nq) [m, rad] and per second
    real(wp), intent(in), contiguous :: lambda(:)         !! (rows) [N]
    real(wp), intent(in), contiguous :: z(:), zd(:)       !! (nz) [m, rad] and per second
    real(wp), intent(out) :: power(:)         !! as `powers_of` [W]
    associate (m => self%m, ev => self%ev)
      ev%options = at_side(self%options, .true.)
      call marker_kinematics(m, ev, q, v)
      if (size(m%s%constraints) > m%s%joints) call constraint_values(m, ev, ev%options, t)   ! rates of drives and rows that switch
      call find_powers(self%t, m, ev, t, v, lambda, z, zd, power)
    end associate
  end subroutine powers

  !> Products with the mass.
  function mechanism_mass(self, q, x) result(product)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in), contiguous :: q(:)      !! (nq) [m, rad]
    real(wp), intent(in), contiguous :: x(:, :)   !! (nq + nz, 4) [any]
    real(wp) :: product                           !! [J] for rates
    product = mass_product(self%t, self%m, self%ev, q, x)
  end function mechanism_mass

  !> Accelerations, multipliers and powers of the equations.
  subroutine accelerations(self, t, q, v, z, zd, end_of_step, a, lambda, powers)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in), contiguous :: q(:), v(:), z(:)          !! (nq), (nz) [m, rad] and per second
    real(wp), intent(inout), contiguous :: zd(:)                  !! (nz) [m/s, rad/s]; set where of first order
    logical, intent(in) :: end_of_step
    real(wp), intent(out), contiguous :: a(:)        !! (nq + nz) [m/s2, rad/s2]
    real(wp), intent(out), contiguous :: lambda(:)   !! (rows) [N]
    real(wp), intent(out) :: powers(:)        !! as `powers_of` [W]
    type(evaluation_options) :: options
    logical :: ok
    options = at_side(self%options, end_of_step)
    self%closed_rates = v
    call evaluate(self%m, self%ev, options, t, q, self%closed_rates, z, zd)
    if (end_of_step .and. nearly_dependent(self%ev)) then   ! accelerations amplify what is left of the offset: project it away
      self%closed = q
      call project(self%m, self%ev, options, t, self%closed, self%closed_rates, z, zd, ok)
      call evaluate_branch(self%m, self%ev, options, t, self%closed, self%closed_rates, z, zd)
    end if
    a(1:self%nq) = self%ev%a
    a(self%nq + 1:) = self%ev%zdd
    call relaxation_rates(self%t, self%m, self%ev, q, self%closed_rates, zd, a(self%nq + 1:))
    call control_slopes(self%m, self%ev, t, zd, a(self%nq + 1:))
    lambda = self%ev%lambda
    call powers_of(self%m, self%ev, powers)
  end subroutine accelerations

  !> A state put onto the constraints, with its evaluation.
  subroutine report(self, t, y, ok)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(inout), contiguous :: y(:)      !! (ny) [m, rad], [m/s, rad/s], [J]
    logical, intent(out) :: ok
    self%ev%broken = .false.
    ok = .true.
    associate (m => self%m, ev => self%ev, n => self%m%s%nq, i => 2*self%m%s%nq + self%m%s%nz, nzd => self%m%s%nzd)
      call evaluate(m, ev, self%options, t, y(1:n), y(n + 1:2*n), y(2*n + 1:i), y(i + 1:i + nzd))
      if (m%s%rows > 0) then
        call project(m, ev, self%options, t, y(1:n), y(n + 1:2*n), y(2*n + 1:i), y(i + 1:i + nzd), ok)
        call evaluate_branch(m, ev, self%options, t, y(1:n), y(n + 1:2*n), y(2*n + 1:i), y(i + 1:i + nzd))
      end if
      ok = ok .and. .not. ev%broken
    end associate
  end subroutine report

  !> Accelerations that a step resolves.
  subroutine smooth(self, t, q, v, lambda, a, ok)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in), contiguous :: q(:), v(:), lambda(:)   !! (nq), (rows) [m, rad], rates, [N]
    real(wp), intent(inout), contiguous :: a(:)                 !! (nq) [m/s2, rad/s2]
    logical, intent(out) :: ok
    logical :: bad
    call smooth_accelerations(self%t, self%m, self%ev, self%options, t, q, v, lambda, a, bad)
    ok = .not. bad
  end subroutine smooth

  !> The constraints and their derivatives.
  subroutine gaps(self, t, q, v, a, u, gap)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in), contiguous :: q(:), v(:), a(:), u(:)   !! (nq) [m, rad], rates, accelerations, [any]
    real(wp), intent(out), contiguous :: gap(:, 0:)        !! (rows, 0:2 or 0:3) [m], [m/s], [m/s2], [any]
    call row_gaps(self%m, self%ev, t, q, v, a, u, gap)
  end subroutine gaps

  !> Closes gaps in the directions that the constraints hold.
  subroutine mechanism_along(self, q, gap, dq, dlambda)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in), contiguous :: q(:)          !! (nq) [m, rad]
    real(wp), intent(in), contiguous :: gap(:, :)        !! (rows, columns) [m] and its derivatives
    real(wp), intent(out), contiguous :: dq(:, :)        !! (nq, columns) [m, rad] and theirs
    real(wp), intent(out), contiguous :: dlambda(:, :)   !! (rows, columns) [N] and theirs
    if (.not. allocated(self%stages)) call hold_weak_rows(self%t%t%rows)
    call set_frames(self%m, self%ev, q)
    call row_correction(self%t%t, self%m, self%ev, gap, dq, dlambda)
  end subroutine mechanism_along

  !> What the step resolves of two vectors.
  subroutine resolve(self, x, y)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(inout), contiguous :: x(:), y(:)   !! (nq) [any]
    call resolved_part(self%t, self%m, x, y)
  end subroutine resolve

  !> Whether rows were nearly dependent at the last evaluation.
  pure logical function nearly_dependent(ev) result(yes)
    type(evaluation), intent(in) :: ev
    integer :: k
    yes = ev%schur%singular
    do k = 1, ev%schur%n                            ! the factor holds 1/pivot
      yes = yes .or. ev%schur%f(0, k)*ev%schur%s(0, k)*weak_row > 1.0_wp
    end do
  end function nearly_dependent

  !> Residuals of a stage.
  subroutine mechanism_stage(self, t, q, v, a, z, lambda, left, r, gap)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in), contiguous :: q(:), v(:), a(:)   !! (nq) [m, rad], rates, accelerations
    real(wp), intent(in), contiguous :: z(:)               !! (nz) [m, rad]
    real(wp), intent(in), contiguous :: lambda(:)          !! (rows) [N]
    logical, intent(in) :: left
    real(wp), intent(out), contiguous :: r(:)              !! (nq) [N, N m]
    real(wp), intent(out), contiguous :: gap(:)            !! (rows) [m/s]
    call give_terms(self%t, self%m, z)
    call residual(self%t, self%m, self%ev, at_side(self%options, left), t, q, v, a, lambda)
    call stage_residual(self%t, self%m, self%ev, r, gap)
    call slip_gaps(self%m, self%ev, lambda, gap)
  end subroutine mechanism_stage

  !> Both matrices at the state of the last residual.
  subroutine renew_stages(self, c2, q, v, a, lambda, whole, hold, ok)
    class(mechanism_system), intent(inout) :: self
    complex(wp), intent(in) :: c2(2)          !! [1/s]
    real(wp), intent(in), contiguous :: q(:), v(:), a(:)   !! (nq) [m, rad], rates, accelerations
    real(wp), intent(in), contiguous :: lambda(:)    !! (rows) [N]
    logical, intent(in) :: whole, hold
    logical, intent(out) :: ok
    real(wp) :: shift                         ! of constraint rows [-]
    logical :: bad
    shift = merge(light_shift, least_shift, self%m%redundant)
    if (hold) shift = stage_shift
    self%t%t%rows%unit = real(c2(1), wp)
    self%stages%rows%unit = c2(2)
    call factor_stages(self%stages, self%t, self%m, c2, bad)
    ok = .not. bad
    if (bad) return
    call stage_tangents(self%stages, self%t, self%m, self%ev, q, v, a)
    call give_gains(self)
    call condense(self%t%t, self%m, self%ev, self%t%eq, v, a, lambda, whole, shift, bad)
    if (.not. bad) call condense_complex(self%stages, self%m, self%ev, self%t%eq, v, a, lambda, whole, shift, bad)
    ok = .not. bad
  end subroutine renew_stages

  !> Takes what corrections are asked for.
  subroutine take_parts(self, r, r_complex)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in), contiguous :: r(:)            !! (nq) [N, N m]
    complex(wp), intent(in), contiguous :: r_complex(:) !! (nq) [N, N m]
    call take_residual(self%t%t, self%m, self%ev, r)
    call take_complex(self%stages, self%m, self%ev, r_complex)
  end subroutine take_parts

  !> Corrections by the complex matrix.
  subroutine complex_correction(self, gap, dq, dlambda)
    class(mechanism_system), intent(inout) :: self
    complex(wp), intent(in), contiguous :: gap(:)       !! (rows) [m]
    complex(wp), intent(out), contiguous :: dq(:)       !! (nq) [m, rad]
    complex(wp), intent(out), contiguous :: dlambda(:)  !! (rows) [N]
    call correct_complex(self%stages, self%m, self%ev, gap, dq)
    dlambda = self%stages%rows%y(1:self%rows)
  end subroutine complex_correction

  !> Deformations that internal variables follow.
  subroutine deformations(self, t, q, v, delta)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in), contiguous :: q(:), v(:)   !! (nq) [m, rad] and per second
    real(wp), intent(out), contiguous :: delta(:)    !! (nz) [m, rad]
    call term_deformations(self%t, self%m, self%ev, q, v, delta)
    call control_inputs(self%m, self%ev, self%options, t, q, v, delta)
  end subroutine deformations

  !> States of controllers.
  subroutine solve_linear(self, c, x)
    class(mechanism_system), intent(in) :: self
    complex(wp), intent(in) :: c              !! [1/s]
    complex(wp), intent(inout) :: x(:)        !! (linear) [any], then [any s]
    call solve_controls(self%m, self%ev, c, x)
  end subroutine solve_linear
end module mechanism_ode
