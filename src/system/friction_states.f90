!> Which joints with friction stick, which slip: the resting set of a position, by passes (theory.md, section 13). All joints at
!> rest stick first. A share beyond its static limit is taken off: its joint slips, or is carried at its limit where the others hold
!> it all the same. Where a joint at rest is accelerated by rows that always hold (a dead centre, a drive), it slips with them.
module friction_states
  use kinds, only: wp
  use dynamics, only: evaluate_motion, motion_state
  use evaluation_results, only: evaluation, motion_of_row
  use friction_row, only: friction_model, creeping, grip, stopped, row_stuck, row_slips, row_carried, row_idle
  use friction_shares, only: dependent_rows
  use mechanism, only: mechanism_model
  use root_watch, only: by_position, most_roots, root_rounding
  implicit none (type, external)
  private
  public :: settle_friction, comes_to_rest

  real(wp), parameter :: still = 1.0e-10_wp      !! an acceleration so small is none, of the largest without multipliers [-]
  real(wp), parameter :: reached = 1.0e-6_wp     !! a share so near to its limit is there after an event that says so [-]

contains

  !> States of joints with friction after events, or of a position that no event has led to. ok is false where no states meet the
  !> law. The last evaluation is that of the states found.
  subroutine settle_friction(m, ev, at, fallen, ok)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(motion_state), intent(in) :: at
    logical, intent(in) :: fallen(:)             !! (roots of the rows) those that have fallen to zero
    logical, intent(out) :: ok
    logical, dimension(size(m%s%switching_rows)) :: rests, breaks
    call look(m, ev, at)
    call find_resting(m, ev, fallen, rests, breaks)
    ev%switches%shared = .false.
    ok = .true.
    call look(m, ev, at)
    if (any(rests)) call settle(m, ev, at, rests, breaks, ok)
    call note_pads(m, ev, fallen)
  end subroutine settle_friction

  !> Keeps the signs of the normal forces of rows that slip: one that has just fallen to zero changes.
  subroutine note_pads(m, ev, fallen)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    logical, intent(in) :: fallen(:)             !! (roots of the rows)
    integer :: k
    do k = 1, size(m%s%switching_rows)
      select type (c => m%s%constraints(m%s%switching_rows(k))%item)
      class is (friction_model)
        associate (x => ev%switches, i => c%switch_number, n => most_roots*(k - 1))
          if (abs(x%state(i)) == row_slips) x%memory(i) = c%pad_code(ev%lambda, x%memory(i), fallen(n + 2:n + 3))
        end associate
      end select
    end do
  end subroutine note_pads

  !> Whether a row that slips has neither a rate nor an acceleration, as behind a drive that has come to rest.
  logical function comes_to_rest(m, ev) result(yes)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer :: k
    yes = .false.
    do k = 1, size(m%s%switching_rows)
      associate (x => motion_of_row(m, ev, k))
        yes = yes .or. (abs(x%state) == row_slips .and. abs(x%rate) <= stopped*m%s%size .and. &
                        abs(x%acceleration) <= still*ev%rows%largest)
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

  !> Rows that are at rest: those stick, from the present position unless they stuck before. Others slip with their rates.
  subroutine find_resting(m, ev, fallen, rests, breaks)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    logical, intent(in) :: fallen(:)             !! (roots of the rows)
    logical, intent(out) :: rests(:)             !! (rows that switch)
    logical, intent(out) :: breaks(:)            !! (rows that switch) it stuck, and has come to its limit
    integer :: k
    breaks = .false.
    do k = 1, size(rests)
      select type (c => m%s%constraints(m%s%switching_rows(k))%item)
      class is (friction_model)
        associate (x => motion_of_row(m, ev, k), state => ev%switches%state(c%switch_number), &
                   memory => ev%switches%memory(c%switch_number), down => fallen(most_roots*(k - 1) + 1:most_roots*k))
          rests(k) = state == row_stuck .or. abs(x%rate) <= merge(creeping, stopped, abs(state) > row_slips)*c%size
          if (abs(state) == row_slips) rests(k) = rests(k) .or. down(1)
          if (rests(k) .and. state /= row_stuck) memory = c%measure(ev%p)
          breaks(k) = state == row_stuck .and. down(1)
          if (rests(k)) then
            state = row_stuck
          else
            state = nint(sign(1.0_wp, x%rate))*row_slips
          end if
        end associate
      end select
    end do
  end subroutine find_resting

  !> Sorts the rows at rest, after an evaluation in which all of them stick.
  subroutine settle(m, ev, at, rests, breaks, ok)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(motion_state), intent(in) :: at
    logical, intent(in) :: rests(:)              !! (rows that switch)
    logical, intent(inout) :: breaks(:)          !! (rows that switch) at the limit, to rounding: spent
    logical, intent(out) :: ok
    integer :: pass
    logical :: changed
    if (ev%schur%singular .and. .not. m%redundant) call sort_dependent(m, ev, at, rests)
    do pass = 1, 4*size(rests) + 4
      call check_released(m, ev, rests, changed)
      if (.not. changed) call release_worst(m, ev, rests, breaks, changed)
      ok = .not. changed
      if (ok) exit
      call look(m, ev, at)
    end do
  end subroutine settle

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
        if (.not. carried(k) .or. abs(x%acceleration) <= still*ev%rows%largest) cycle
        ev%switches%state(number(m, k)) = nint(sign(1.0_wp, x%acceleration))*row_slips
      end associate
    end do
    if (any(carried)) call look(m, ev, at)
  end subroutine sort_dependent

  !> Rows at rest that are off, one reason after the other: where one is carried by a force along the motion that would begin, its
  !> force changes sign, and what was taken off sticks again; one that would move against its force sticks again; those that are
  !> carried no longer slip.
  subroutine check_released(m, ev, rests, changed)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    logical, intent(in) :: rests(:)              !! (rows that switch)
    logical, intent(out) :: changed
    integer :: way(size(rests))                  ! in which it is accelerated
    real(wp) :: least                            ! acceleration that is one [m/s2]
    logical, dimension(size(rests)) :: slips, turns
    integer :: k
    way = 0
    do k = 1, size(rests)
      associate (x => motion_of_row(m, ev, k))
        least = merge(root_rounding, still, abs(x%state) == row_slips)*ev%rows%largest
        if (rests(k) .and. abs(x%acceleration) > least) way(k) = nint(sign(1.0_wp, x%acceleration))
      end associate
    end do
    associate (state => ev%switches%state(number(m, 1):))
      slips = rests .and. abs(state) == row_slips
      turns = abs(state) == row_carried .and. state*way < 0
      changed = any(way /= 0 .and. state /= row_stuck .and. .not. (slips .and. state == way))
      if (any(turns)) then
        where (turns) state = -state
        where (slips) state = row_stuck
      else if (any(slips .and. state*way < 0)) then
        state(findloc(slips .and. state*way < 0, .true., 1)) = row_stuck
      else
        where (way /= 0 .and. state /= row_stuck) state = way*row_slips
      end if
    end associate
  end subroutine check_released

  !> Takes off the row that is farthest beyond its static limit.
  subroutine release_worst(m, ev, rests, breaks, changed)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    logical, intent(in) :: rests(:)              !! (rows that switch)
    logical, intent(inout) :: breaks(:)          !! (rows that switch) at the limit, to rounding
    logical, intent(out) :: changed
    real(wp) :: share, worst, limit
    integer :: k, which, side
    worst = 1.0_wp
    which = 0
    do k = 1, size(rests)
      select type (c => m%s%constraints(m%s%switching_rows(k))%item)
      class is (friction_model)
        if (ev%switches%state(c%switch_number) /= row_stuck) cycle
        limit = c%sticking_limit(ev%lambda)
        limit = limit*(1 + grip) + root_rounding*maxval(abs(ev%lambda))
        share = abs(ev%lambda(c%first))/max(limit, tiny(1.0_wp))
        if (breaks(k) .and. share > 1 - reached) share = max(share, 1 + epsilon(1.0_wp))
        if (share <= worst) cycle
        worst = share
        which = k
        side = nint(sign(1.0_wp, ev%lambda(c%first)))
      end select
    end do
    changed = which > 0
    if (.not. changed) return
    breaks(which) = .false.
    associate (state => ev%switches%state(number(m, which)))
      state = side*row_slips
      if (.not. ev%switches%shared) return
      ev%schur%off(row(m, which)) = .true.
      if (depends(m, ev, which)) state = side*row_carried
    end associate
  end subroutine release_worst

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
    number = size(m%s%switching) + k
  end function number

  !> Its number among all rows.
  pure integer function row(m, k)
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: k
    row = m%s%constraints(m%s%switching_rows(k))%item%first
  end function row
end module friction_states
