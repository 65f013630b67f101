!> Which rows hold at a position: joints with friction that stick, rigid stops that are closed. Rows at rest are sorted by passes
!> (theory.md, section 13). All of them hold first. The multiplier of each has bounds: a joint's static limit both ways, no pull of
!> a stop. One beyond its bounds is taken off: its joint slips, or is carried at its limit where others hold it all the same, and
!> its stop opens. Where rows share the load, corners of what the shares may be are tried last. Where a joint at rest is accelerated
!> by rows that always hold (a dead centre, a drive), it slips with them.
module resting_rows
  use kinds, only: wp
  use dynamics, only: evaluate_motion, motion_state
  use evaluation_results, only: evaluation, motion_of_row
  use friction_law, only: row_stuck, row_slips, row_carried, row_idle
  use friction_shares, only: dependent_rows
  use mechanism, only: mechanism_model
  use root_watch, only: most_roots, resting
  implicit none (type, external)
  private
  public :: hold_resting, settle_rows, close_low, comes_to_rest

  real(wp), parameter :: reached = 1.0e-6_wp     !! a share so near to its limit is there after an event that says so [-]
  integer, parameter :: most_levels = 16         !! tenths of the creep before, from 10 to rounding
  integer, parameter :: most_passes = 10         !! of a level
  integer, parameter :: most_shared = 6          !! rows of which all choices are tried

  !> The rows that switch, at an event.
  type, public :: resting_set
    integer, allocatable :: side(:)              !! of a rigid stop that is touched: 1 upper limit, -1 lower one; else 0
    logical, allocatable :: rests(:)             !! it has no rate
    logical, allocatable :: breaks(:)            !! it held, and has come to a bound
    logical, allocatable :: fresh(:)             !! an event of this time has let it slip: it may have no acceleration yet
    logical :: free = .false.                    !! friction does not act
  end type resting_set

  !> What a row at rest misses of its law.
  type :: verdict
    real(wp) :: over = 0.0_wp                    !! it holds, beyond a bound: by how much; else 0 [-]
    integer :: way = 0                           !! it is off: in which it moves against the law, else 0
  end type verdict

contains

  !> Rows that are at rest hold, joints from where they are, stops at their limits; their rates are to be taken off before they are
  !> settled. Called again after that it adds those that have lost their rates with others.
  subroutine hold_resting(m, ev, at, fallen, x, more)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(motion_state), intent(in) :: at
    logical, intent(in) :: fallen(:)             !! (roots of the elements) those that have fallen to zero
    type(resting_set), intent(inout) :: x
    logical, intent(out) :: more                 !! rows have been added
    integer :: k, phase
    more = .false.
    call look(m, ev, at)
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
    ev%switches%shared = .false.
    if (more) call look(m, ev, at)
  end subroutine hold_resting

  !> Whether row k of those that switch rests, and holds then, but for one that has just begun to slip and goes on.
  subroutine see_whether_it_rests(m, ev, fallen, k, x)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    logical, intent(in) :: fallen(:)             !! (roots of the elements)
    integer, intent(in) :: k
    type(resting_set), intent(inout) :: x
    real(wp) :: least                            ! [m/s2]
    logical :: down, slips
    integer :: state
    associate (now => motion_of_row(m, ev, k), one_sided => m%s%constraints(m%s%permanent + k)%item%one_sided)
      state = relation(m, ev, x, k)
      down = fallen(most_roots*(number(m, k) - 1) + 1)
      slips = abs(state) == row_slips .and. .not. one_sided
      x%breaks(k) = state == row_stuck .and. down
      x%rests(k) = state == row_stuck .or. abs(now%rate) <= now%still .or. (slips .and. down)
      if (one_sided) x%rests(k) = -x%side(k)*now%rate <= now%still
      if (.not. x%rests(k)) call set_relation(m, ev, x, k, nint(sign(1.0_wp, now%rate))*row_slips)
      if (.not. x%rests(k) .or. state == row_stuck) return
      call hold(m, ev, x, k)
      least = resting*ev%rows%largest
      if (x%fresh(k)) least = -now%noise - reached*now%compliance*abs(ev%lambda(row(m, k)))
      if (slips .and. .not. down .and. state*now%acceleration > least) call set_relation(m, ev, x, k, state)
    end associate
  end subroutine see_whether_it_rests

  !> The states of the rows at rest. ok is false where no states meet the laws; `pressed` is then a stop that a drive presses, 0 if
  !> there is none. The last evaluation is that of the states found.
  subroutine settle_rows(m, ev, at, fallen, x, ok, pressed)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(motion_state), intent(in) :: at
    logical, intent(in) :: fallen(:)             !! (roots of the elements) those that have fallen to zero
    type(resting_set), intent(in) :: x
    logical, intent(out) :: ok
    integer, intent(out) :: pressed              !! its number among the elements that switch
    integer :: k
    call look(m, ev, at)
    ok = .true.
    pressed = 0
    if (any(x%rests)) call settle(m, ev, at, x, ok, pressed)
    call note_pads(m, ev, fallen)
    do k = 1, size(x%side)
      associate (item => m%s%constraints(m%s%permanent + k)%item)
        if (item%one_sided .and. .not. item%holds(ev%switches%state(number(m, k)))) ev%switches%memory(number(m, k)) = 0.0_wp
      end associate
    end do
  end subroutine settle_rows

  !> Keeps the signs of the normal forces of rows that slip: one that has just fallen to zero changes.
  subroutine note_pads(m, ev, fallen)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    logical, intent(in) :: fallen(:)             !! (roots of the elements)
    integer :: k
    do k = 1, size(m%s%friction)
      associate (x => ev%switches, law => m%s%friction(k), n => most_roots*(m%s%friction(k)%number - 1))
        associate (i => law%number)
          if (abs(x%state(i)) == row_slips) x%memory(i) = law%pad_code(ev%lambda, x%memory(i), fallen(n + 2:n + 3))
        end associate
      end associate
    end do
  end subroutine note_pads

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
  subroutine look(m, ev, at)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(motion_state), intent(in) :: at
    ev%broken = .false.
    call evaluate_motion(m, ev, at)
  end subroutine look

  !> Sorts the rows at rest, after an evaluation in which all of them hold.
  subroutine settle(m, ev, at, x, ok, pressed)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(motion_state), intent(in) :: at
    type(resting_set), intent(in) :: x
    logical, intent(out) :: ok
    integer, intent(out) :: pressed
    type(verdict) :: found(size(x%rests))
    integer :: start(size(ev%switches%state))    ! states in which all that may hold do
    logical :: spent(size(x%rests))              ! that it was at its bound has taken it off
    integer :: pass, k
    pressed = 0
    if (ev%schur%singular) call sort_dependent(m, ev, at, x, pressed)
    ok = pressed == 0
    if (.not. ok) return
    start = ev%switches%state
    spent = x%breaks .and. x%side /= 0           ! a stop whose force has come to nothing
    do k = 1, size(spent)
      if (.not. spent(k)) cycle
      call release(m, ev, x, k)
      call look(m, ev, at)
    end do
    do pass = 1, 4*size(x%rests) + 4
      call judge(m, ev, x, spent, found)
      ok = fulfilled(found)
      if (ok) then
        if (all_carried(m, ev, x)) exit
        call look(m, ev, at)
        cycle
      end if
      if (pass == 1 .and. count(found%over > 0.0_wp) > 1 .and. .not. ev%switches%shared) then
        call approach(m, ev, at, x)
        cycle
      end if
      if (any(found%way /= 0)) then
        call change_released(m, ev, x, found%way)
      else
        k = maxloc(found%over, 1, x%side /= 0 .and. found%over > 0.0_wp)   ! stops first: what they share may be rounding
        if (k == 0) k = maxloc(found%over, 1)
        spent(k) = .true.
        call release(m, ev, x, k)
      end if
      call look(m, ev, at)
    end do
    ok = ok .and. .not. ev%broken
    if (ev%switches%shared .and. (.not. ok .or. slides(m, ev, x))) call find_shares(m, ev, at, x, start, ok)
  end subroutine settle

  !> Whether what is carried still depends on rows that hold: else it is left to move.
  logical function all_carried(m, ev, x) result(yes)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(resting_set), intent(in) :: x
    integer :: k, state
    logical :: carried
    yes = .true.
    do k = 1, size(x%rests)
      state = relation(m, ev, x, k)
      if (.not. x%rests(k) .or. state == row_stuck .or. abs(state) == row_slips) cycle
      carried = depends(m, ev, k)
      if (carried) cycle
      yes = .false.
      call set_relation(m, ev, x, k, merge(sign(1, state), -x%side(k), x%side(k) == 0)*row_slips)
    end do
  end function all_carried

  !> Whether all meet their laws.
  pure logical function fulfilled(found) result(yes)
    type(verdict), intent(in) :: found(:)
    yes = .not. (any(found%way /= 0) .or. any(found%over > 0.0_wp))
  end function fulfilled

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

  !> Where rows at rest share the load and the passes have not found how: all choices of rows that take their limits, which are
  !> the corners of what the shares may be. Else the states stay as they are.
  subroutine find_shares(m, ev, at, x, start, ok)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(motion_state), intent(in) :: at
    type(resting_set), intent(in) :: x
    integer, intent(in) :: start(:)              !! (elements that switch) states in which all that may hold do
    logical, intent(inout) :: ok                 !! states are found
    type(verdict) :: found(size(x%rests))
    type(resting_set) :: limits
    integer :: before(size(start))               ! (elements that switch)
    logical :: none(size(x%rests)), reached_before
    integer, parameter :: either(0:2) = [row_stuck, row_carried, -row_carried]
    integer, allocatable :: holds(:)
    integer :: k, choice
    none = .false.
    reached_before = ok
    limits = x
    limits%breaks = any(x%breaks)
    before = ev%switches%state
    ev%switches%state = start
    holds = pack([(k, k=1, size(none))], [(x%rests(k) .and. relation(m, ev, x, k) == row_stuck, k=1, size(none))])
    if (size(holds) <= most_shared) then
      do choice = 1, 3**size(holds) - 1
        ev%switches%state = start
        do k = 1, size(holds)
          call set_relation(m, ev, x, holds(k), either(mod(choice/3**(k - 1), 3)))
        end do
        call look(m, ev, at)
        call judge(m, ev, limits, none, found)
        if (ev%broken .or. .not. fulfilled(found)) cycle
        ok = all_carried(m, ev, x)               ! else limits are in balance by chance
        if (ok) return
      end do
    end if
    ev%switches%state = before
    ok = reached_before
    call look(m, ev, at)
  end subroutine find_shares

  !> Where several rows are beyond their bounds: what each one alone would do is no guide to what they do together. Rows that hold
  !> give way, a = creep S_tt f, ever less: with much of that each one is judged by its own load, and states change on the way to
  !> none. With limits that are given they follow the minimum of a convex function (theory.md, section 13).
  subroutine approach(m, ev, at, x)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(motion_state), intent(in) :: at
    type(resting_set), intent(in) :: x
    logical :: changed
    real(wp) :: bound(2)                         ! [N]
    integer :: level, pass, k
    do level = 1, most_levels
      ev%creep = 100*0.1_wp**level
      do pass = 1, most_passes
        call look(m, ev, at)
        changed = .false.
        do k = 1, size(x%rests)
          if (.not. x%rests(k)) cycle
          associate (now => motion_of_row(m, ev, k), f => ev%lambda(row(m, k)), state => relation(m, ev, x, k))
            bound = bounds(m, ev, x, k)
            if (state == row_stuck .and. (f < bound(1) .or. f > bound(2))) then
              call set_relation(m, ev, x, k, nint(sign(1.0_wp, f))*row_slips)
            else if (abs(state) == row_slips .and. state*now%acceleration < ev%creep*now%compliance*abs(f)) then
              call set_relation(m, ev, x, k, row_stuck)
            else
              cycle
            end if
            changed = .true.
          end associate
        end do
        if (.not. changed) exit
      end do
    end do
    ev%creep = 0.0_wp
    call look(m, ev, at)
  end subroutine approach

  !> Where rows at rest depend on others: those that depend on rows that always hold are carried by these, without a force, or move
  !> as these accelerate them; those that depend on other rows at rest share the load with them.
  subroutine sort_dependent(m, ev, at, x, pressed)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(motion_state), intent(in) :: at
    type(resting_set), intent(in) :: x
    integer, intent(out) :: pressed              !! number of a stop into which they drive a body, 0: none
    logical :: carried(size(x%rests))
    integer :: k
    pressed = 0
    carried = .false.
    ev%schur%off(m%s%permanent_rows + 1:) = .true.
    do k = 1, size(carried)
      if (x%rests(k)) carried(k) = depends(m, ev, k)
      if (carried(k)) call set_relation(m, ev, x, k, row_idle)
    end do
    call look(m, ev, at)
    ev%switches%shared = ev%schur%singular
    do k = 1, size(carried)
      associate (now => motion_of_row(m, ev, k))
        if (.not. carried(k) .or. abs(now%acceleration) <= resting*ev%rows%largest) cycle
        if (x%side(k)*now%acceleration > 0.0_wp) pressed = number(m, k)
        call set_relation(m, ev, x, k, nint(sign(1.0_wp, now%acceleration))*row_slips)
      end associate
    end do
    if (any(carried)) call look(m, ev, at)
  end subroutine sort_dependent

  !> What the rows at rest miss of their laws. What is within rounding, or of a row at its limit within `resting` of it, counts for
  !> nothing, so that neither sticking nor slipping would be wrong there. A stop that nothing presses but for rounding is open.
  subroutine judge(m, ev, x, spent, found)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    type(resting_set), intent(in) :: x
    logical, intent(in) :: spent(:)              !! (rows that switch) that it was at its bound has taken it off
    type(verdict), intent(out) :: found(:)       !! (rows that switch)
    real(wp) :: least, slack, limit              ! [m/s2], [N], [N]
    integer :: k, state
    do k = 1, size(found)
      if (.not. x%rests(k)) cycle
      associate (now => motion_of_row(m, ev, k), f => ev%lambda(row(m, k)), stop => x%side(k) /= 0, breaks => x%breaks(k))
        state = relation(m, ev, x, k)
        slack = now%noise/now%compliance
        if (stop) slack = slack + resting*ev%rows%strongest
        if (state == row_stuck .and. stop) then
          if (x%side(k)*f <= slack) found(k)%over = 2 - x%side(k)*f/max(slack, tiny(1.0_wp))
        else if (state == row_stuck) then
          limit = maxval(bounds(m, ev, x, k))
          slack = slack + resting*limit
          if (breaks .and. .not. spent(k)) slack = -reached*limit - now%noise/now%compliance
          if (abs(f) > limit + slack) found(k)%over = abs(f)/max(limit, tiny(1.0_wp))
        else
          least = resting*ev%rows%largest
          if (abs(state) == row_slips) least = now%noise + merge(reached, resting, breaks)*now%compliance*abs(f)
          if (stop) least = max(least, 2*now%noise + 2*resting*now%compliance*ev%rows%strongest)
          if (stop .and. breaks) cycle           ! its force has come to nothing: it is off
          if (abs(now%acceleration) > least) found(k)%way = nint(sign(1.0_wp, now%acceleration))
          if (abs(state) == row_slips .and. state == found(k)%way) found(k)%way = 0
        end if
      end associate
    end do
  end subroutine judge

  !> Rows at rest that are off, one reason after the other: where one is carried by a force along the motion that would begin, its
  !> force changes sign, and what was taken off holds again; one that would move against its force or into its stop holds again;
  !> those that are carried no longer slip or open.
  subroutine change_released(m, ev, x, way)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(resting_set), intent(in) :: x
    integer, intent(in) :: way(:)                !! (rows that switch) in which they move against the law, else 0
    integer :: k, state(size(way))
    logical, dimension(size(way)) :: slips, turns
    state = [(relation(m, ev, x, k), k=1, size(way))]
    slips = x%rests .and. abs(state) == row_slips
    turns = abs(state) == row_carried .and. state*way < 0
    if (any(turns)) then
      where (turns) state = -state
      where (slips) state = row_stuck
    else if (any(slips .and. way /= 0)) then
      state(findloc(slips .and. way /= 0, .true., 1)) = row_stuck
    else
      where (way /= 0) state = merge(row_stuck, way*row_slips, way == x%side)
    end if
    do k = 1, size(way)
      if (x%rests(k)) call set_relation(m, ev, x, k, state(k))
    end do
  end subroutine change_released

  !> Takes off a row that is beyond a bound.
  subroutine release(m, ev, x, k)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(resting_set), intent(in) :: x
    integer, intent(in) :: k                     !! its number among those that switch
    integer :: side
    side = nint(sign(1.0_wp, ev%lambda(row(m, k))))
    if (x%side(k) /= 0) side = -x%side(k)
    call set_relation(m, ev, x, k, side*row_slips)
    if (.not. ev%switches%shared) return
    ev%schur%off(row(m, k)) = .true.
    if (depends(m, ev, k)) call set_relation(m, ev, x, k, side*row_carried)
  end subroutine release

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
    ev%switches%memory(number(m, k)) = m%s%constraints(m%s%permanent + k)%item%place(ev%p, x%side(k))
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

  !> Between which its multiplier holds it at rest [N].
  pure function bounds(m, ev, x, k)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    type(resting_set), intent(in) :: x
    integer, intent(in) :: k
    real(wp) :: bounds(2)
    bounds = m%s%constraints(m%s%permanent + k)%item%bounds(x%side(k), ev%lambda)
  end function bounds

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
