!> Rigid stops that bodies hit, rest on or leave: velocities after the impact, and which stops are closed then (theory.md, section
!> 10). An impact takes no time: positions stay, velocities jump by impulses of the stops, of the joints and of the drives. With u
!> the speeds at which stops open and W = J M^-1 J^T under the joints, the impulses L of all stops that are hit at once solve
!> (Newton's restitution in the form of Moreau and Glocker)
!>
!>   u+ + e u- = W L + (1 + e) u- >= 0,   L >= 0,   (u+ + e u-).L = 0
!>
!> Stops at which nothing moves any more are closed if the same problem of accelerations and forces has a pressing force for them:
!> x'' = W f + x''(free) >= 0, f >= 0, x''.f = 0.
module impacts
  use kinds, only: wp
  use complementarity, only: solve_complementarity
  use constraint, only: row_motion
  use dynamics, only: evaluate_motion, motion_state
  use evaluation_results, only: evaluation, conditions_of, motion_of_row, row_power
  use force_element, only: by_position, most_roots, root_rounding, watched_roots
  use friction_law, only: row_slips
  use joint_response, only: apply_multipliers
  use joint_system, only: add_row_motion
  use lapack, only: dgesv
  use marker_motion, only: marker_kinematics
  use mechanism, only: mechanism_model
  use root_watch, only: resting
  use stop_row, only: stop_row_model
  use stops, only: stop_idle, stop_open, stop_rebound, stop_touching
  use switching, only: event_list, switch_event
  implicit none (type, external)
  private
  public :: pass_impacts, close_entered

  real(wp), parameter :: least_rebound = 1.0e-11_wp   !! next height below which a stop closes, of the scene's size [-]
  real(wp), parameter :: immovable = 1.0e-10_wp       !! acceleration by a unit force that is zero, over that without joints [-]
  real(wp), parameter :: entered = 1.0e-12_wp         !! a penetration that is not rounding, of the scene's size [-]
  real(wp), parameter :: stopped = 1.0e-13_wp         !! a rate so small is zero, sizes a second [1/s]
  real(wp), parameter :: at_rest = 1.0e-12_wp         !! an acceleration so small is none, of the largest of all rows [-]

  !> Results of a pass over the rigid stops beside the state.
  type, public :: impact_result
    logical :: any = .false.                  !! some stop was touched
    integer :: conflict = 0                   !! number of a stop that drives or other stops press beyond its limit; 0: none
    real(wp), allocatable :: lost(:)          !! (switching elements) energy [J]
    real(wp), allocatable :: impulse(:)       !! (switching elements) largest of this pass [N s] or [N m s]
    real(wp), allocatable :: flight(:)        !! (switching elements) estimated time until it is hit again [s]
    real(wp) :: work = 0.0_wp                 !! of drives [J]
    real(wp), allocatable :: integrated(:)    !! energies of the sources that sensors integrate [J]
  end type impact_result

  !> The stops that are touched.
  type :: contact_set
    integer :: n = 0
    integer, allocatable :: element(:), place(:), row(:)   !! numbers among the elements and the rows that switch, and of the row
    integer, allocatable :: side(:)           !! 1 upper limit, -1 lower one
    logical, allocatable :: fallen(:)         !! its root has fallen: it is hit, or it was closed and its force ends
    logical, allocatable :: closed(:)         !! so far
    real(wp), allocatable :: e(:)             !! restitution [-]
    real(wp) :: still = 0.0_wp                !! a speed so small is rounding [m/s]
    real(wp), allocatable :: response(:, :)   !! (nq, n) velocities by a unit impulse of each [1/kg, 1/(kg m)]
    real(wp), allocatable :: joints(:, :)     !! (rows, n) impulses of the joints and drives by it [-]
    real(wp), allocatable :: w(:, :)          !! (n, n) opening speeds by it [1/kg]
    real(wp), allocatable :: alone(:)         !! (n) own opening speeds by it without joints [1/kg]
  end type contact_set

contains

  !> Passes all rigid stops that are touched at a state, some of which may have just been hit: velocities, states, events. The
  !> projection that follows sets the rates at stops that close to zero.
  subroutine pass_impacts(m, ev, at, fallen, list, x)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(motion_state), intent(inout) :: at
    logical, intent(in) :: fallen(:)          !! (roots)
    type(event_list), intent(inout) :: list
    type(impact_result), intent(out) :: x
    type(contact_set) :: c
    integer, allocatable :: others(:), before(:)   ! states
    allocate (x%lost(size(m%s%switching)), x%impulse(size(m%s%switching)), source=0.0_wp)
    allocate (x%flight(size(m%s%switching)), source=huge(1.0_wp))
    allocate (x%integrated(size(m%s%integrated)), source=0.0_wp)
    call find_contacts(m, ev, at%q, at%v, fallen, c)
    x%any = c%n > 0
    if (.not. x%any) return
    others = ev%switches%state(size(m%s%switching) + 1:)
    before = ev%switches%state(c%element)
    ev%switches%state(size(m%s%switching) + 1:) = by_position     ! friction has no impulses
    ev%switches%state(c%element) = stop_open
    call evaluate_motion(m, ev, at)
    call find_responses(m, ev, c)
    call strike(m, ev, at%t, at%q, at%v, c, list, x)
    ev%switches%state(size(m%s%switching) + 1:) = others
    if (any(x%impulse > 0.0_wp)) call slip_as_struck(m, ev)
    if (x%conflict == 0) then
      call evaluate_motion(m, ev, at)
      call find_responses(m, ev, c)
      call close_stops(m, ev, at%t, before, c, list, x)
    end if
    if (x%conflict > 0) return
    call evaluate_motion(m, ev, at)
  end subroutine pass_impacts

  !> For an equilibrium, at its last evaluation: closes the rigid stops that are entered; where none is, opens those that pull.
  subroutine close_entered(m, ev, changed)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    logical, intent(out) :: changed
    real(wp) :: x, xd, g(6)                   ! [m], [m/s] or [rad], [rad/s]; [-], [m]
    logical :: beyond
    integer :: k, pass
    changed = .false.
    do pass = 1, 2
      do k = size(m%s%constraints) - m%s%stop_rows + 1, size(m%s%constraints)
        select type (row => m%s%constraints(k)%item)
        class is (stop_row_model)
          associate (state => ev%switches%state(row%switch_number), memory => ev%switches%memory(row%switch_number))
            if (pass == 1 .and. .not. row%holds(state)) then
              call row%stop%measure(ev%p, x, xd, g)
              beyond = row%weight()*max(x - row%stop%upper, row%stop%lower - x) > entered*m%s%size
              if (beyond) state = merge(stop_touching, -stop_touching, x > row%stop%upper)
              if (beyond) memory = row%weight()*merge(row%stop%upper, row%stop%lower, state > 0)
              changed = changed .or. beyond
            else if (pass == 2 .and. row%holds(state) .and. state*ev%lambda(row%first) < 0.0_wp) then
              state = stop_open
              memory = 0.0_wp
              changed = .true.
            end if
          end associate
        end select
      end do
      if (changed) return
    end do
  end subroutine close_entered

  !> Rigid stops that are closed or idle, or whose limit is reached.
  subroutine find_contacts(m, ev, q, v, fallen, c)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in), contiguous :: q(:), v(:)   !! (nq) [m, rad] and per second
    logical, intent(in) :: fallen(:)          !! (roots)
    type(contact_set), intent(out) :: c
    type(watched_roots) :: roots
    logical :: down(most_roots)
    integer :: k, i, side
    allocate (c%element(0), c%place(0), c%row(0), c%side(0), c%fallen(0), c%closed(0), c%e(0))
    call marker_kinematics(m, ev, q, v)
    do k = 1, size(m%s%constraints) - m%s%permanent
      select type (row => m%s%constraints(m%s%permanent + k)%item)
      class is (stop_row_model)
        i = row%switch_number
        down = fallen(most_roots*(i - 1) + 1:most_roots*i)
        side = sign(1, ev%switches%state(i))
        if (ev%switches%state(i) == stop_open) then
          call row%stop%roots(ev%p, conditions_of(m, ev, m%s%switching(i)), roots)
          if (.not. any(down .or. roots%g <= roots%zero)) cycle
          side = merge(1, -1, roots%g(1) <= roots%g(2))
        end if
        c%element = [c%element, i]
        c%place = [c%place, k]
        c%row = [c%row, row%first]
        c%side = [c%side, side]
        c%fallen = [c%fallen, any(down)]
        c%closed = [c%closed, row%holds(ev%switches%state(i))]
        c%e = [c%e, row%stop%restitution]
      end select
    end do
    c%n = size(c%element)
    c%still = root_rounding*fastest(m, ev)
  end subroutine find_contacts

  !> Velocities by unit impulses of the touched stops, with the factors of an evaluation in which their rows are off.
  subroutine find_responses(m, ev, c)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(contact_set), intent(inout) :: c
    real(wp) :: mu(m%s%rows), motion(m%s%rows), u(m%s%nq)   ! [-], [1/kg], [1/kg, 1/(kg m)]
    integer :: i
    if (.not. allocated(c%w)) allocate (c%response(m%s%nq, c%n), c%joints(m%s%rows, c%n), c%w(c%n, c%n), c%alone(c%n))
    do i = 1, c%n
      mu = 0.0_wp
      mu(c%row(i)) = c%side(i)
      call apply_multipliers(m, ev, mu, u)
      motion = 0.0_wp
      call add_row_motion(m, ev, u, motion)
      c%alone(i) = -c%side(i)*motion(c%row(i))
      where (ev%rows%off) motion = 0.0_wp
      call ev%schur%solve(motion)
      c%joints(:, i) = motion
      call apply_multipliers(m, ev, motion, c%response(:, i))
      c%response(:, i) = c%response(:, i) + u
      motion = 0.0_wp
      call add_row_motion(m, ev, c%response(:, i), motion)
      c%w(:, i) = -c%side*motion(c%row)
    end do
    c%w = 0.5_wp*(c%w + transpose(c%w))
    do i = 1, c%n                             ! what drives hold does not move: the rest is rounding
      if (c%w(i, i) > immovable*c%alone(i)) cycle
      c%w(i, :) = 0.0_wp
      c%w(:, i) = 0.0_wp
    end do
  end subroutine find_responses

  !> Impacts, until no stop is hit any more: an impact at one of them may drive bodies against another one.
  subroutine strike(m, ev, t, q, v, c, list, x)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in), contiguous :: q(:)  !! (nq) [m, rad]
    real(wp), intent(inout), contiguous :: v(:)   !! (nq) [m/s, rad/s]
    type(contact_set), intent(inout) :: c
    type(event_list), intent(inout) :: list
    type(impact_result), intent(inout) :: x
    real(wp), dimension(c%n) :: u, after, impulse   ! opening speeds before and after [m/s], [N s]
    logical :: met(c%n), solved
    integer :: pass, i
    do pass = 1, 4*c%n + 4
      call opening_speeds(m, ev, c, u)
      met = u < -c%still .or. (c%fallen .and. .not. c%closed .and. u < 0.0_wp)
      if (.not. any(met)) return
      call push(c, u <= c%still, merge((1 + c%e)*u, 0.0_wp, met), impulse, solved)
      if (.not. solved) exit
      after = u + matmul(c%w, impulse)
      call add_work()
      v = v + matmul(c%response, impulse)
      x%work = x%work + dot_product(matmul(c%joints, impulse), ev%rows%phi_t)
      call marker_kinematics(m, ev, q, v)
      call add_work()
      do i = 1, c%n
        associate (n => c%element(i), weight => merge(m%s%size, 1.0_wp, m%s%forces(m%s%switching(c%element(i)))%item%angular))
          x%lost(n) = x%lost(n) - 0.5_wp*(after(i) + u(i))*impulse(i)
          x%impulse(n) = max(x%impulse(n), weight*impulse(i))
          if (c%closed(i) .or. u(i) >= -c%still - stopped*m%s%size) cycle   ! the rest is rounding
          call list%add(switch_event(t, n, stop_open, c%side(i)*stop_rebound, -u(i)/weight))
        end associate
      end do
      c%fallen = c%fallen .and. c%closed
    end do
    x%conflict = c%element(minloc(u, 1))
  contains
    !> Impulses of drives and joints work at the mean of the velocities before and after: half of it at each of them.
    subroutine add_work()
      integer :: k
      do k = 1, size(x%integrated)
        x%integrated(k) = x%integrated(k) + 0.5_wp*row_power(m, ev, m%s%integrated(k), matmul(c%joints, impulse))
      end do
    end subroutine add_work
  end subroutine strike

  !> Joints with friction that move after an impact slip in that direction, also those that stuck before.
  subroutine slip_as_struck(m, ev)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    integer :: k
    do k = 1, size(m%s%friction)
      associate (x => motion_of_row(m, ev, k), state => ev%switches%state(m%s%friction(k)%number))
        if (abs(x%rate) > resting*m%s%size + root_rounding*x%speed) state = nint(sign(1.0_wp, x%rate))*row_slips
      end associate
    end do
  end subroutine slip_as_struck

  !> Closes the stops at which nothing moves any more and which are pressed; opens the others.
  subroutine close_stops(m, ev, t, before, c, list, x)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev     !! evaluated, their rows off
    real(wp), intent(in) :: t                 !! [s]
    integer, intent(in) :: before(:)          !! states
    type(contact_set), intent(in) :: c
    type(event_list), intent(inout) :: list
    type(impact_result), intent(inout) :: x
    real(wp), dimension(c%n) :: u, free, a, force   ! opening speeds, accelerations without and with forces [m/s], [m/s2], [N]
    real(wp) :: least, date                   ! [m/s2], [s]
    real(wp) :: flight(c%n)                   ! to the next rebound, where that is not followed [s]
    logical, dimension(c%n) :: rests, low
    logical :: solved
    integer :: i, state
    call opening_speeds(m, ev, c, u)
    free = -c%side*ev%rows%acceleration(c%row)
    least = at_rest*max(maxval(abs(ev%a)), fastest(m, ev)**2/m%s%size)
    flight = 0.0_wp
    rests = u <= c%still .and. .not. (c%fallen .and. c%closed)
    do
      call push(c, rests, merge(free, 0.0_wp, abs(free) > least), force, solved)
      if (.not. solved) then
        x%conflict = c%element(minloc(free, 1, mask=rests))
        return
      end if
      a = free + matmul(c%w, force)
      low = .not. (rests .or. (c%fallen .and. c%closed)) .and. a < -least .and. u**2 < 2*abs(a)*least_rebound*m%s%size
      if (.not. any(low)) exit
      where (low) flight = 2*u/abs(a)
      rests = rests .or. low
    end do
    do i = 1, c%n
      associate (n => c%element(i))
        state = stop_open
        if (force(i) > 0.0_wp) state = c%side(i)*stop_touching
        if (rests(i) .and. .not. force(i) > 0.0_wp) then
          if (carried(i)) state = c%side(i)*stop_idle
        end if
        if (force(i) > 0.0_wp) x%lost(n) = x%lost(n) + 0.5_wp*max(u(i), 0.0_wp)**2/c%w(i, i)
        ev%switches%state(n) = state
        ev%switches%memory(n) = 0.0_wp
        if (force(i) > 0.0_wp) ev%switches%memory(n) = limit_of(c%place(i), c%side(i))
        if (.not. rests(i) .and. u(i) > 0.0_wp .and. a(i) < -least) x%flight(n) = 2*u(i)/abs(a(i))
        if (state == before(i)) cycle
        date = t
        if (force(i) > 0.0_wp .and. c%e(i) < 1.0_wp) date = t + flight(i)/(1 - c%e(i))
        call note(list, date, t, n, before(i), state)
      end associate
    end do
  contains
    !> Position at which the row of a closed stop holds [m].
    real(wp) function limit_of(k, side) result(limit)
      integer, intent(in) :: k, side
      limit = 0.0_wp
      select type (row => m%s%constraints(m%s%permanent + k)%item)
      class is (stop_row_model)
        limit = row%weight()*merge(row%stop%upper, row%stop%lower, side > 0)
      end select
    end function limit_of

    !> Whether closed stops keep stop i from moving, so that it needs no force.
    logical function carried(i) result(yes)
      integer, intent(in) :: i
      real(wp), allocatable :: w(:, :), x(:, :)
      integer, allocatable :: k(:), pivots(:)
      integer :: j, info
      k = pack([(j, j=1, c%n)], force > 0.0_wp)
      yes = size(k) > 0 .and. c%w(i, i) > immovable*c%alone(i)
      if (.not. yes) return
      w = c%w(k, k)
      x = c%w(k, [i])
      allocate (pivots(size(k)))
      call dgesv(size(k), 1, w, size(k), pivots, x, size(k), info)
      yes = info == 0
      if (yes) yes = c%w(i, i) - dot_product(c%w(k, i), x(:, 1)) <= immovable*c%w(i, i)
    end function carried
  end subroutine close_stops

  !> Impulses or forces of the chosen stops that let none of them be entered: W x + b >= 0, x >= 0, one of both zero.
  subroutine push(c, chosen, b, x, solved)
    type(contact_set), intent(in) :: c
    logical, intent(in) :: chosen(:)
    real(wp), intent(in) :: b(:)              !! [m/s] or [m/s2]
    real(wp), intent(out) :: x(:)             !! [N s] or [N]
    logical, intent(out) :: solved
    real(wp) :: part(count(chosen))           ! [N s] or [N]
    integer, allocatable :: k(:)
    integer :: i
    k = pack([(i, i=1, c%n)], chosen)
    call solve_complementarity(c%w(k, k), b(k), part, solved)
    x = unpack(part, chosen, spread(0.0_wp, 1, c%n))
  end subroutine push

  !> Notes a new state. An impact without a rebound and the state after it are one event.
  subroutine note(list, date, t, element, from, to)
    type(event_list), intent(inout) :: list
    real(wp), intent(in) :: date, t           !! of the event; now [s]
    integer, intent(in) :: element            !! its number among those that switch
    integer, intent(in) :: from, to           !! states
    integer :: k
    do k = 1, list%count
      associate (x => list%items(k))
        if (date > t .or. x%element /= element .or. abs(x%t - t) > 0.0_wp .or. abs(x%to) /= stop_rebound) cycle
        x%to = to
        return
      end associate
    end do
    call list%add(switch_event(date, element, from, to))
  end subroutine note

  !> Speeds at which the touched stops open; those of their rows [m/s].
  subroutine opening_speeds(m, ev, c, u)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    type(contact_set), intent(in) :: c
    real(wp), intent(out) :: u(:)             !! [m/s]
    type(row_motion) :: x
    integer :: i
    do i = 1, c%n
      x = motion_of_row(m, ev, c%place(i))
      u(i) = -c%side(i)*x%rate
    end do
  end subroutine opening_speeds

  !> The fastest marker, angles counting times the scene's size.
  pure real(wp) function fastest(m, ev)       ! [m/s]
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    fastest = maxval(abs(ev%p%v)) + m%s%size*maxval(abs(ev%p%rate))
  end function fastest
end module impacts
