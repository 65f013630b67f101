!> Which rows hold at a position: joints with friction that stick, rigid stops that are closed. Rows at rest solve one
!> complementarity problem (theory.md, section 13): each has no acceleration and a multiplier within bounds, a joint's static limit
!> both ways or no pull of a stop, or it is at a bound and moves away from there. It is solved by principal pivots. What counts is
!> the motion that follows at once: forces are those of a little later, so that those which are zero at an event have their signs.
module resting_rows
  use kinds, only: wp
  use dynamics, only: evaluate_motion, motion_state
  use evaluation_results, only: evaluation, motion_of_row
  use friction_law, only: row_stuck, row_slips, row_at_limit, row_parted, row_unloaded
  use friction_shares, only: dependent_rows
  use mechanism, only: mechanism_model
  use root_watch, only: by_position, most_roots, resting
  use stops, only: stop_touching
  implicit none (type, external)
  private
  public :: hold_resting, find_states, close_low, comes_to_rest

  integer, parameter :: most_levels = 8      !! each softens a tenth as much as the one before, from 10 to 1e-6
  integer, parameter :: keeps = huge(1)      !! a row meets the law
  integer, parameter :: block_passes = 3     !! in which all rows change that break the law, without fewer of them [-]

  !> The rows that switch, at an event.
  type, public :: resting_set
    integer, allocatable :: side(:)              !! of a rigid stop that is touched: 1 upper limit, -1 lower one; else 0
    logical, allocatable :: rests(:)             !! it has no rate
    integer, allocatable :: before(:)            !! as `relation`: how it is tried first
    logical :: free = .false.                    !! friction does not act
  end type resting_set

contains

  !> Rows that are at rest hold, joints from where they are, stops at their limits; their rates are to be taken off before their
  !> states are found. Called again after that it adds those that have lost their rates with others.
  subroutine hold_resting(m, ev, at, fallen, x, more)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(motion_state), intent(in) :: at
    logical, intent(in) :: fallen(:)             !! (roots of the elements) those that have fallen to zero
    type(resting_set), intent(inout) :: x
    logical, intent(out) :: more                 !! rows have been added
    integer :: k, phase
    more = .false.
    call evaluate_states(m, ev, at)
    do phase = 1, 2                              ! what joints do depends on the stops that are closed
      do k = 1, size(x%rests)
        associate (item => m%s%constraints(m%s%permanent + k)%item)
          if (x%rests(k) .or. (item%one_sided .neqv. phase == 1) .or. merge(x%side(k) == 0, x%free, item%one_sided)) cycle
        end associate
        call see_whether_it_rests(m, ev, fallen, k, x)
        more = more .or. x%rests(k)
      end do
      if (more) exit
    end do
    ev%switches%indeterminate = .false.
    if (more) call evaluate_states(m, ev, at)
  end subroutine hold_resting

  !> Whether row k of those that switch rests, and holds then. Friction of a stop that does not touch has nothing to hold by.
  subroutine see_whether_it_rests(m, ev, fallen, k, x)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    logical, intent(in) :: fallen(:)             !! (roots of the elements)
    integer, intent(in) :: k
    type(resting_set), intent(inout) :: x
    logical :: down
    if (parted(m, ev, k)) then
      call set_relation(m, ev, x, k, row_parted)
      return
    end if
    associate (now => motion_of_row(m, ev, k), one_sided => m%s%constraints(m%s%permanent + k)%item%one_sided, &
               state => x%before(k))
      state = relation(m, ev, x, k)
      down = .not. one_sided .and. abs(state) == row_slips .and. fallen(most_roots*(number(m, k) - 1) + 1)
      x%rests(k) = down .or. merge(-x%side(k)*now%rate, abs(now%rate), one_sided) <= now%still
      if (.not. x%rests(k)) call set_relation(m, ev, x, k, nint(sign(1.0_wp, now%rate))*row_slips)
      if (.not. x%rests(k) .or. state == row_stuck) return
      call hold(m, ev, x, k)
      if (all(abs(state) /= merge([row_unloaded, row_unloaded], [row_slips, row_at_limit], one_sided))) state = row_stuck
    end associate
  end subroutine see_whether_it_rests

  !> The states of the rows at rest. ok is false where no states meet the laws; `pressed` is then a stop that a drive presses, 0 if
  !> there is none. The last evaluation is that of the states found.
  subroutine find_states(m, ev, at, delay, x, ok, pressed)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(motion_state), intent(in) :: at
    real(wp), intent(in) :: delay                !! after which forces are judged [s]
    type(resting_set), intent(inout) :: x
    logical, intent(out) :: ok
    integer, intent(out) :: pressed              !! its number among the elements that switch
    type(motion_state) :: later
    integer :: k
    call evaluate_states(m, ev, at)
    later = at
    associate (nzd => m%s%nzd)
      later%t = at%t + delay
      later%q = at%q + delay*at%v
      later%v = at%v + delay*ev%a
      later%z = at%z + delay*[at%zd, ev%zdd(nzd + 1:)]
      later%zd = at%zd + delay*ev%zdd(:nzd)
    end associate
    if (.not. ev%broken) call evaluate_states(m, ev, later)
    ok = .not. ev%broken
    pressed = 0
    if (ok .and. any(x%rests)) call solve(m, ev, later, x, ok, pressed)
    do k = 1, size(m%s%friction)
      associate (law => m%s%friction(k), s => ev%switches)
        if (abs(s%state(law%number)) == row_slips) s%event_value(law%number) = law%normal_signs(ev%lambda)
        if (s%state(law%number) == -row_unloaded) s%state(law%number) = row_unloaded
      end associate
    end do
    do k = 1, size(x%side)
      associate (item => m%s%constraints(m%s%permanent + k)%item)
        if (item%one_sided .and. .not. item%holds(ev%switches%state(number(m, k)))) ev%switches%event_value(number(m, k)) = 0.0_wp
      end associate
    end do
    call evaluate_states(m, ev, at)
    if (ok .and. ev%broken) then                 ! of loads that are zero now but for rounding, friction at its limit bears nothing
      do k = 1, size(x%rests)
        if (x%rests(k) .and. abs(relation(m, ev, x, k)) == row_at_limit) call set_relation(m, ev, x, k, row_unloaded)
      end do
      call evaluate_states(m, ev, at)
    end if
    ok = ok .and. .not. ev%broken
  end subroutine find_states

  !> Whether row k is the friction of a stop that does not press.
  pure logical function parted(m, ev, k) result(yes)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: k
    yes = .false.
    if (k > size(m%s%friction)) return
    associate (law => m%s%friction(k))
      if (law%element == 0) return
      associate (state => ev%switches%state(m%s%forces(law%element)%item%switch_number))
        yes = abs(state) /= stop_touching .and. .not. (state == by_position .and. ev%rows%pressed(law%row) > 0.0_wp)
      end associate
    end associate
  end function parted

  !> Whether a row that slips has neither a rate nor an acceleration, as behind a drive that has come to rest.
  logical function comes_to_rest(m, ev) result(yes)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer :: k
    yes = .false.
    do k = 1, size(m%s%friction)
      associate (x => motion_of_row(m, ev, k))
        yes = yes .or. (abs(x%state) == row_slips .and. abs(x%rate) <= x%still .and. abs(x%acceleration) <= resting*ev%rows%largest)
      end associate
    end do
  end function comes_to_rest

  !> An evaluation with the present states.
  subroutine evaluate_states(m, ev, at)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(motion_state), intent(in) :: at
    ev%broken = .false.
    call evaluate_motion(m, ev, at)
  end subroutine evaluate_states

  !> Solves the problem of the rows at rest, after an evaluation in which all of them hold. Where they share loads, first with rows
  !> that give way a little: its matrix is then definite, so that there is one solution.
  subroutine solve(m, ev, at, x, ok, pressed)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(motion_state), intent(in) :: at
    type(resting_set), intent(inout) :: x
    logical, intent(out) :: ok
    integer, intent(out) :: pressed
    integer :: level, found(size(ev%switches%state))   ! states that meet the law, though other shares may hold the rows at rest
    logical :: met
    pressed = 0
    if (ev%schur%singular) call sort_dependent(m, ev, at, x, pressed)
    ok = pressed == 0
    if (.not. ok) return
    call start_as_before(m, ev, at, x)
    call sort_rows(m, ev, at, x, met)
    if (met .and. .not. (ev%switches%indeterminate .and. slides(m, ev, x))) return
    found = ev%switches%state
    do level = 1, most_levels
      ev%softening = 100*0.1_wp**level
      call evaluate_states(m, ev, at)
      call pivot(m, ev, at, x, ok)
    end do
    ev%softening = 0.0_wp
    call evaluate_states(m, ev, at)
    call sort_rows(m, ev, at, x, ok)
    if (ok .or. .not. met) return
    ev%switches%state = found
    call evaluate_states(m, ev, at)
    ok = .true.
  end subroutine solve

  !> Pivots, and what breaks away after them.
  subroutine sort_rows(m, ev, at, x, ok)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(motion_state), intent(in) :: at
    type(resting_set), intent(in) :: x
    logical, intent(out) :: ok
    logical :: found(size(x%rests))
    integer :: k
    do k = 1, 2*size(found) + 2
      call pivot(m, ev, at, x, ok)
      if (.not. ok) return
      call break_away(m, ev, x, found)
      if (.not. any(found)) return
      call evaluate_states(m, ev, at)
    end do
    ok = .false.
  end subroutine sort_rows

  !> Whether a row at rest begins to move.
  logical function slides(m, ev, x) result(yes)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    type(resting_set), intent(in) :: x
    integer :: k
    yes = .false.
    do k = 1, size(x%rests)
      yes = yes .or. (x%rests(k) .and. abs(relation(m, ev, x, k)) == row_slips)
    end do
  end function slides

  !> Principal pivots: all rows change that break the law, or, where that does not lead to fewer of them, the last one (after
  !> Judice & Pires, Computers & Operations Research 21, 1994, 587).
  subroutine pivot(m, ev, at, x, ok)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(motion_state), intent(in) :: at
    type(resting_set), intent(in) :: x
    logical, intent(out) :: ok
    integer :: next(size(x%rests)), least, n, pass, since, k
    least = huge(least)
    since = 0
    do pass = 1, 8*size(next)                    ! where one row changes at a time, each may have to more than once
      call find_next(m, ev, x, next)
      n = count(next /= keeps)
      ok = n == 0 .and. .not. ev%broken
      if (n == 0) return
      since = since + 1
      if (n < least .and. pass > 1) since = 0
      least = min(n, least)
      do k = size(next), 1, -1
        if (next(k) == keeps) cycle
        call set_relation(m, ev, x, k, next(k))
        if (since >= block_passes) exit
      end do
      call evaluate_states(m, ev, at)
    end do
  end subroutine pivot

  !> What was at its limit still is, and what has just begun to slip goes on where it is accelerated that way.
  subroutine start_as_before(m, ev, at, x)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(motion_state), intent(in) :: at
    type(resting_set), intent(in) :: x
    real(wp) :: least                            ! [m/s2]
    integer :: k
    do k = 1, size(x%rests)
      if (relation(m, ev, x, k) == row_stuck .and. x%rests(k)) call set_relation(m, ev, x, k, x%before(k))
    end do
    call evaluate_states(m, ev, at)
    do k = 1, size(x%rests)
      if (.not. x%rests(k) .or. abs(x%before(k)) /= row_slips .or. abs(relation(m, ev, x, k)) /= row_slips) cycle
      associate (now => motion_of_row(m, ev, k), f => ev%lambda(row(m, k)))
        least = now%noise + resting*now%compliance*abs(f)
        if (.not. ev%switches%indeterminate) least = -least ! it goes on
        if (x%before(k)*now%acceleration <= least) call set_relation(m, ev, x, k, row_stuck)
      end associate
    end do
    call evaluate_states(m, ev, at)
  end subroutine start_as_before

  !> How each row at rest is to hold next: `keeps` where it meets the law. What is within rounding, or of a row at its limit within
  !> `resting` of it, counts for nothing, so that neither sticking nor slipping would be wrong there. A stop that nothing presses
  !> but for rounding is open.
  subroutine find_next(m, ev, x, next)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    type(resting_set), intent(in) :: x
    integer, intent(out) :: next(:)              !! (rows that switch) as `relation`
    real(wp) :: slack, limit, least              ! [N], [N], [m/s2]
    integer :: k, state
    next = keeps
    do k = 1, size(next)
      if (.not. x%rests(k)) cycle
      associate (now => motion_of_row(m, ev, k), f => ev%lambda(row(m, k)), side => x%side(k))
        state = relation(m, ev, x, k)
        slack = now%noise/now%compliance
        if (ev%broken) then                      ! no forces meet the law: other rows are to be at their limits
          if (any(abs(state) == [row_slips, row_at_limit])) next(k) = row_stuck
        else if (side /= 0) then
          slack = slack + resting*ev%rows%strongest
          least = 2*now%compliance*slack
          if (state == row_stuck .and. side*f <= slack) next(k) = row_unloaded
          if (state /= row_stuck .and. side*now%acceleration > least) next(k) = row_stuck
        else if (state == row_stuck) then
          limit = maxval(m%s%constraints(m%s%permanent + k)%item%bounds(side, ev%lambda, now%pressed))
          if (abs(f) > limit*(1 + resting) + slack) next(k) = nint(sign(1.0_wp, f))*row_at_limit
        else if (abs(state) /= row_unloaded) then
          least = ev%softening*now%compliance*abs(f) - now%noise - resting*now%compliance*abs(f)
          if (sign(1, state)*now%acceleration < least) next(k) = merge(-row_unloaded, row_stuck, x%before(k) == row_unloaded)
        end if
      end associate
    end do
  end subroutine find_next

  !> Rows at a bound that move away from there: joints slip, stops open.
  subroutine break_away(m, ev, x, found)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(resting_set), intent(in) :: x
    logical, intent(out) :: found(:)             !! (rows that switch)
    integer :: k, state, direction
    found = .false.
    do k = 1, size(found)
      state = relation(m, ev, x, k)
      if (.not. x%rests(k) .or. any(state == [row_stuck, row_slips, -row_slips, -row_unloaded])) cycle
      associate (a => ev%rows%acceleration(row(m, k)))
        direction = merge(sign(1, state), -x%side(k), x%side(k) == 0)
        if (state == row_unloaded .and. x%side(k) == 0) direction = nint(sign(1.0_wp, a))
        found(k) = direction*a > resting*ev%rows%largest
      end associate
      if (found(k)) call set_relation(m, ev, x, k, direction*row_slips)
    end do
  end subroutine break_away

  !> Where rows at rest depend on others: those that depend on rows that always hold need no force, or move
  !> as these accelerate them; those that depend on other rows at rest share the load with them.
  subroutine sort_dependent(m, ev, at, x, pressed)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(motion_state), intent(in) :: at
    type(resting_set), intent(inout) :: x
    integer, intent(out) :: pressed              !! number of a stop into which they drive a body, 0: none
    logical :: dependent(size(x%rests))
    integer :: k
    pressed = 0
    dependent = .false.
    ev%schur%off(m%s%permanent_rows + 1:) = .true.
    do k = 1, size(dependent)
      if (x%rests(k)) dependent(k) = depends(m, ev, k)
      if (.not. dependent(k)) cycle
      x%before(k) = row_unloaded
      call set_relation(m, ev, x, k, row_unloaded)
    end do
    call evaluate_states(m, ev, at)
    ev%switches%indeterminate = ev%schur%singular
    do k = 1, size(dependent)
      associate (now => motion_of_row(m, ev, k))
        if (dependent(k) .and. x%side(k)*now%acceleration > resting*ev%rows%largest) pressed = number(m, k)
      end associate
    end do
  end subroutine sort_dependent

  !> Whether row k of those that switch depends on the rows that hold.
  logical function depends(m, ev, k) result(yes)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    integer, intent(in) :: k
    integer :: before
    before = dependent_rows(m, ev)
    ev%schur%off(row(m, k)) = .false.
    yes = dependent_rows(m, ev) > before
    ev%schur%off(row(m, k)) = .true.
  end function depends

  !> Times until stops that bodies leave are met again. Where the rebound stays below a height, the stop rests, too.
  subroutine close_low(m, ev, x, height, u, flight, closed)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev        !! of the states found
    type(resting_set), intent(inout) :: x
    real(wp), intent(in) :: height               !! [m]
    real(wp), intent(out) :: u(:)                !! (rows that switch) speeds at which touched stops open [m/s]
    real(wp), intent(out) :: flight(:)           !! (rows that switch) huge: none [s]
    logical, intent(out) :: closed(:)            !! (rows that switch) such stops
    real(wp) :: fall                             ! [m/s2]
    integer :: k
    u = 0.0_wp
    flight = huge(1.0_wp)
    closed = .false.
    do k = 1, size(closed)
      if (x%side(k) == 0 .or. x%rests(k)) cycle
      associate (now => motion_of_row(m, ev, k))
        u(k) = -x%side(k)*now%rate
        fall = x%side(k)*now%acceleration
        if (.not. (u(k) > 0.0_wp .and. fall > now%noise + resting*ev%rows%largest)) cycle
        flight(k) = 2*u(k)/fall
        closed(k) = u(k)**2 < 2*fall*height
      end associate
      if (closed(k)) call hold(m, ev, x, k)
    end do
    x%rests = x%rests .or. closed
  end subroutine close_low

  !> Row k of those that switch holds from now on.
  subroutine hold(m, ev, x, k)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(resting_set), intent(in) :: x
    integer, intent(in) :: k
    ev%switches%event_value(number(m, k)) = m%s%constraints(m%s%permanent + k)%item%place(ev%p, x%side(k))
    call set_relation(m, ev, x, k, row_stuck)
  end subroutine hold

  !> How row k of those that switch holds: `row_stuck`, or off as `friction_law` says.
  pure integer function relation(m, ev, x, k)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    type(resting_set), intent(in) :: x
    integer, intent(in) :: k
    relation = m%s%constraints(m%s%permanent + k)%item%relation(ev%switches%state(number(m, k)), x%side(k))
  end function relation

  !> Its state by that.
  pure subroutine set_relation(m, ev, x, k, relation)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(resting_set), intent(in) :: x
    integer, intent(in) :: k, relation
    ev%switches%state(number(m, k)) = m%s%constraints(m%s%permanent + k)%item%state_of(relation, x%side(k))
  end subroutine set_relation

  !> Its number among the elements that switch.
  pure integer function number(m, k)
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: k
    number = m%s%constraints(m%s%permanent + k)%item%switch_number
  end function number

  !> Its number among all rows.
  pure integer function row(m, k)
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: k
    row = m%s%constraints(m%s%permanent + k)%item%first
  end function row
end module resting_rows
