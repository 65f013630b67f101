!> Which joints with friction stick, which slip: the resting set of a position, by passes (theory.md, section 13). All joints at
!> rest stick first. A share beyond its static limit is taken off: its joint slips, or is carried at its limit where the others hold
!> it all the same. Where joints share the load, corners of what the shares may be are tried last. Where a joint at rest is
!> accelerated by rows that always hold (a dead centre, a drive), it slips with them.
module friction_states
  use kinds, only: wp
  use dynamics, only: evaluate_motion, motion_state
  use evaluation_results, only: evaluation, motion_of_row
  use friction_law, only: row_stuck, row_slips, row_carried, row_idle
  use friction_shares, only: dependent_rows
  use mechanism, only: mechanism_model
  use root_watch, only: by_position, most_roots, resting, root_rounding
  implicit none (type, external)
  private
  public :: hold_resting, settle_friction, comes_to_rest

  real(wp), parameter :: reached = 1.0e-6_wp     !! a share so near to its limit is there after an event that says so [-]
  integer, parameter :: most_levels = 16         !! tenths of the creep before, from 10 to rounding
  integer, parameter :: most_passes = 10         !! of a level
  integer, parameter :: most_shared = 6          !! rows of which all choices are tried

contains

  !> Joints with friction that are at rest after events, or at a position that no event has led to, stick; their rates are to be
  !> taken off before they are settled.
  subroutine hold_resting(m, ev, at, fallen, rests, breaks)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(motion_state), intent(in) :: at
    logical, intent(in) :: fallen(:)             !! (roots of the rows) those that have fallen to zero
    logical, intent(out) :: rests(:)             !! (rows that switch)
    logical, intent(out) :: breaks(:)            !! (rows that switch) it stuck, and has come to its limit
    call look(m, ev, at)
    call find_resting(m, ev, fallen, rests, breaks)
    ev%switches%shared = .false.
    if (any(rests)) call look(m, ev, at)
  end subroutine hold_resting

  !> Their states. ok is false where no states meet the law. The last evaluation is that of the states found.
  subroutine settle_friction(m, ev, at, fallen, rests, breaks, ok)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(motion_state), intent(in) :: at
    logical, intent(in) :: fallen(:)             !! (roots of the rows) those that have fallen to zero
    logical, intent(in) :: rests(:), breaks(:)   !! (rows that switch)
    logical, intent(out) :: ok
    call look(m, ev, at)
    ok = .true.
    if (any(rests)) call settle(m, ev, at, rests, breaks, ok)
    call note_pads(m, ev, fallen)
  end subroutine settle_friction

  !> Keeps the signs of the normal forces of rows that slip: one that has just fallen to zero changes.
  subroutine note_pads(m, ev, fallen)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    logical, intent(in) :: fallen(:)             !! (roots of the rows)
    integer :: k
    do k = 1, size(m%s%friction)
      associate (x => ev%switches, law => m%s%friction(k), n => most_roots*(k - 1))
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
        yes = yes .or. (abs(x%state) == row_slips .and. abs(x%rate) <= resting*m%s%size + root_rounding*x%speed .and. &
                        abs(x%acceleration) <= resting*ev%rows%largest)
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

  !> Rows that are at rest: those stick, from the present position unless they stuck before, but for those that have just begun to
  !> slip and go on. Others slip with their rates.
  subroutine find_resting(m, ev, fallen, rests, breaks)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    logical, intent(in) :: fallen(:)             !! (roots of the rows)
    logical, intent(out) :: rests(:)             !! (rows that switch)
    logical, intent(out) :: breaks(:)            !! (rows that switch) it stuck, and has come to its limit
    integer :: k
    breaks = .false.
    do k = 1, size(rests)
      associate (x => motion_of_row(m, ev, k), state => ev%switches%state(number(m, k)), &
                 memory => ev%switches%memory(number(m, k)), down => fallen(most_roots*(k - 1) + 1))
        rests(k) = state == row_stuck .or. abs(x%rate) <= resting*m%s%size + root_rounding*x%speed
        if (abs(state) == row_slips) rests(k) = rests(k) .or. down
        breaks(k) = state == row_stuck .and. down
        if (rests(k) .and. state /= row_stuck) memory = m%s%constraints(m%s%permanent + k)%item%measure(ev%p)
        if (.not. rests(k)) then
          state = nint(sign(1.0_wp, x%rate))*row_slips
        else if (abs(state) /= row_slips .or. down .or. state*x%acceleration <= resting*ev%rows%largest) then
          state = row_stuck
        end if
      end associate
    end do
  end subroutine find_resting

  !> Sorts the rows at rest, after an evaluation in which all of them stick.
  subroutine settle(m, ev, at, rests, breaks, ok)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(motion_state), intent(in) :: at
    logical, intent(in) :: rests(:)              !! (rows that switch)
    logical, intent(in) :: breaks(:)             !! (rows that switch) at the limit, to rounding
    logical, intent(out) :: ok
    real(wp) :: over(size(rests))                ! of rows that stick: share of the limit where it is beyond it, else 0 [-]
    integer :: way(size(rests))                  ! in which those that do not stick move against the law, else 0
    integer :: start(size(rests))
    logical :: spent(size(rests))
    integer :: pass
    if (ev%schur%singular .and. .not. m%redundant) call sort_dependent(m, ev, at, rests)
    start = ev%switches%state(number(m, 1):)
    spent = .false.
    do pass = 1, 4*size(rests) + 4
      call judge(m, ev, rests, breaks, spent, way, over)
      ok = .not. (any(way /= 0) .or. any(over > 0.0_wp))
      if (ok) exit
      if (pass == 1 .and. count(over > 0.0_wp) > 1 .and. .not. ev%switches%shared) then
        call approach(m, ev, at, rests)
        cycle
      end if
      spent = spent .or. (breaks .and. over > 0.0_wp)
      if (any(way /= 0)) then
        call change_released(rests, way, ev%switches%state(number(m, 1):))
      else
        call release(m, ev, maxloc(over, 1))
      end if
      call look(m, ev, at)
    end do
    ok = ok .and. .not. ev%broken
    if (.not. ev%switches%shared) return
    associate (state => ev%switches%state(number(m, 1):))
      if (.not. ok .or. any(rests .and. abs(state) == row_slips)) call find_shares(m, ev, at, rests, start, any(breaks), ok)
    end associate
  end subroutine settle

  !> Where rows at rest share the load and the passes have not found how: all choices of rows that take their limits, which are
  !> the corners of what the shares may be. Else the states stay as they are.
  subroutine find_shares(m, ev, at, rests, start, breaks, ok)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(motion_state), intent(in) :: at
    logical, intent(in) :: rests(:)              !! (rows that switch)
    integer, intent(in) :: start(:)              !! (rows that switch) states in which all that may stick do
    logical, intent(in) :: breaks                !! one of them was at its limit, to rounding
    logical, intent(inout) :: ok                 !! states are found
    real(wp) :: over(size(rests))                ! [-]
    integer, dimension(size(rests)) :: way, found
    logical :: limits(size(rests)), none(size(rests))
    integer, parameter :: either(0:2) = [row_stuck, row_carried, -row_carried]
    integer, allocatable :: sticks(:)
    integer :: k, choice
    none = .false.
    limits = breaks
    sticks = pack([(k, k=1, size(rests))], rests .and. start == row_stuck)
    if (size(sticks) > most_shared) return
    associate (state => ev%switches%state(number(m, 1):))
      found = state
      do choice = 1, 3**size(sticks) - 1
        state = start
        state(sticks) = either(mod(choice/[(3**(k - 1), k=1, size(sticks))], 3))
        call look(m, ev, at)
        call judge(m, ev, rests, limits, none, way, over)
        if (ev%broken .or. any(way /= 0) .or. any(over > 0.0_wp)) cycle
        ok = .true.
        return
      end do
      state = found
    end associate
    call look(m, ev, at)
  end subroutine find_shares

  !> Where several rows are beyond their limits: what each one alone would do is no guide to what they do together. Rows that stick
  !> give way, a = creep S_tt f, ever less: with much of that each one is judged by its own load, and states change on the way to
  !> none. With limits that are given they follow the minimum of a convex function (theory.md, section 13).
  subroutine approach(m, ev, at, rests)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(motion_state), intent(in) :: at
    logical, intent(in) :: rests(:)              !! (rows that switch)
    logical :: changed
    integer :: level, pass, k
    do level = 1, most_levels
      ev%creep = 100*0.1_wp**level
      do pass = 1, most_passes
        call look(m, ev, at)
        changed = .false.
        do k = 1, size(rests)
          associate (state => ev%switches%state(number(m, k)), x => motion_of_row(m, ev, k), f => ev%lambda(row(m, k)))
            if (.not. rests(k)) cycle
            if (state == row_stuck .and. abs(f) > m%s%friction(k)%sticking_limit(ev%lambda)) then
              state = nint(sign(1.0_wp, f))*row_slips
            else if (abs(state) == row_slips .and. state*x%acceleration < ev%creep*x%compliance*abs(f)) then
              state = row_stuck
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

  !> Where rows at rest depend on others: those that depend on rows that always hold are carried by these, without a force, or slip
  !> as these accelerate them; those that depend on other rows at rest share the load with them.
  subroutine sort_dependent(m, ev, at, rests)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(motion_state), intent(in) :: at
    logical, intent(in) :: rests(:)              !! (rows that switch)
    logical :: carried(size(rests))
    integer :: k
    carried = .false.
    ev%schur%off(m%s%permanent_rows + 1:) = .true.
    do k = 1, size(rests)
      if (rests(k)) carried(k) = depends(m, ev, k)
      if (carried(k)) ev%switches%state(number(m, k)) = row_idle
    end do
    call look(m, ev, at)
    ev%switches%shared = ev%schur%singular
    do k = 1, size(rests)
      associate (x => motion_of_row(m, ev, k))
        if (.not. carried(k) .or. abs(x%acceleration) <= resting*ev%rows%largest) cycle
        ev%switches%state(number(m, k)) = nint(sign(1.0_wp, x%acceleration))*row_slips
      end associate
    end do
    if (any(carried)) call look(m, ev, at)
  end subroutine sort_dependent

  !> What the rows at rest miss of the law. What is within rounding, or of a row at its limit within `resting` of it, counts for
  !> nothing, so that neither sticking nor slipping would be wrong there.
  subroutine judge(m, ev, rests, breaks, spent, way, over)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    logical, intent(in) :: rests(:), breaks(:)   !! (rows that switch)
    logical, intent(in) :: spent(:)              !! (rows that switch) that it was at its limit has been judged
    integer, intent(out) :: way(:)               !! (rows that switch)
    real(wp), intent(out) :: over(:)             !! (rows that switch) [-]
    real(wp) :: limit, slack, least              ! [N], [N], [m/s2]
    integer :: k
    way = 0
    over = 0.0_wp
    do k = 1, size(rests)
      associate (x => motion_of_row(m, ev, k), f => abs(ev%lambda(row(m, k))))
        if (.not. rests(k)) cycle
        if (x%state == row_stuck) then
          limit = m%s%friction(k)%sticking_limit(ev%lambda)
          slack = resting*limit + x%noise/x%compliance
          if (breaks(k) .and. .not. spent(k)) slack = -reached*limit - x%noise/x%compliance
          if (f > limit + slack) over(k) = f/max(limit, tiny(1.0_wp))
        else
          least = resting*ev%rows%largest
          if (abs(x%state) == row_slips) least = x%noise + merge(reached, resting, breaks(k))*x%compliance*f
          if (abs(x%acceleration) > least) way(k) = nint(sign(1.0_wp, x%acceleration))
          if (abs(x%state) == row_slips .and. x%state == way(k)) way(k) = 0
        end if
      end associate
    end do
  end subroutine judge

  !> Rows at rest that are off, one reason after the other: where one is carried by a force along the motion that would begin, its
  !> force changes sign, and what was taken off sticks again; one that would move against its force sticks again; those that are
  !> carried no longer slip.
  pure subroutine change_released(rests, way, state)
    logical, intent(in) :: rests(:)              !! (rows that switch)
    integer, intent(in) :: way(:)                !! (rows that switch) in which they move against the law, else 0
    integer, intent(inout) :: state(:)           !! (rows that switch)
    logical, dimension(size(rests)) :: slips, turns
    slips = rests .and. abs(state) == row_slips
    turns = abs(state) == row_carried .and. state*way < 0
    if (any(turns)) then
      where (turns) state = -state
      where (slips) state = row_stuck
    else if (any(slips .and. way /= 0)) then
      state(findloc(slips .and. way /= 0, .true., 1)) = row_stuck
    else
      where (way /= 0) state = way*row_slips
    end if
  end subroutine change_released

  !> Takes off a row that is beyond its static limit.
  subroutine release(m, ev, k)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    integer, intent(in) :: k                     !! its number among those that switch
    associate (state => ev%switches%state(number(m, k)), side => nint(sign(1.0_wp, ev%lambda(row(m, k)))))
      state = side*row_slips
      if (.not. ev%switches%shared) return
      ev%schur%off(row(m, k)) = .true.
      if (depends(m, ev, k)) state = side*row_carried
    end associate
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

  !> Its number among the elements that switch.
  pure integer function number(m, k)
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: k
    number = m%s%friction(k)%number
  end function number

  !> Its number among all rows.
  pure integer function row(m, k)
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: k
    row = m%s%friction(k)%row
  end function row
end module friction_states
