!> Rigid stops that bodies hit: velocities after the impact (theory.md, section 10). An impact takes no time: positions stay,
!> velocities jump by impulses of the stops, of the joints and of the drives. With u the speeds at which stops open and
!> W = J M^-1 J^T under the joints, the impulses L of all stops that are hit at once solve (Newton's restitution in the form of
!> Moreau and Glocker)
!>
!>   u+ + e u- = W L + (1 + e) u- >= 0,   L >= 0,   (u+ + e u-).L = 0
!>
!> Which of the stops at which nothing moves any more are closed is found with the friction of joints (`resting_rows`).
module impacts
  use kinds, only: wp
  use complementarity, only: solve_complementarity
  use contact_mass, only: no_motion
  use dynamics, only: evaluate_motion, motion_state
  use evaluation_results, only: evaluation, conditions_of, motion_of_row, row_power
  use force_element, only: by_position, most_roots, watched_roots
  use joint_response, only: apply_multipliers
  use joint_system, only: add_row_motion
  use marker_motion, only: marker_kinematics
  use mechanism, only: mechanism_model
  use stop_row, only: stop_row_model
  use stops, only: stop_open, stop_rebound, stop_touching
  use switching, only: event_list, switch_event
  implicit none (type, external)
  private
  public :: pass_impacts, close_entered

  real(wp), parameter :: entered = 1.0e-12_wp         !! a penetration that is not rounding, of the scene's size [-]

  !> Results of a pass over the rigid stops beside the state.
  type, public :: impact_result
    integer, allocatable :: side(:)           !! (rows that switch) limit that is touched: 1 upper, -1 lower one; 0: none
    integer :: conflict = 0                   !! number of a stop that drives or other stops press beyond its limit; 0: none
    real(wp), allocatable :: lost(:)          !! (switching elements) energy [J]
    real(wp), allocatable :: impulse(:)       !! (switching elements) largest of this pass [N s] or [N m s]
    real(wp), allocatable :: yield(:)         !! (rows that switch) opening speed by a unit impulse of a touched stop [1/kg]
    real(wp), allocatable :: restitution(:)   !! (rows that switch) of a touched stop [-]
    real(wp) :: work = 0.0_wp                 !! of drives [J]
    real(wp), allocatable :: integrated(:)    !! energies of the sources that sensors integrate [J]
  end type impact_result

  !> The stops that are touched.
  type :: contact_set
    integer :: n = 0
    integer, allocatable :: element(:), place(:), row(:)   !! numbers among the elements and the rows that switch, and of the row
    integer, allocatable :: side(:)           !! 1 upper limit, -1 lower one
    logical, allocatable :: closed(:)         !! so far
    real(wp), allocatable :: e(:)             !! restitution [-]
    real(wp), allocatable :: response(:, :)   !! (nq, n) velocities by a unit impulse of each [1/kg, 1/(kg m)]
    real(wp), allocatable :: joints(:, :)     !! (rows, n) impulses of the joints and drives by it [-]
    real(wp), allocatable :: w(:, :)          !! (n, n) opening speeds by it [1/kg]
    real(wp), allocatable :: alone(:)         !! (n) own opening speeds by it without joints [1/kg]
  end type contact_set

contains

  !> Passes all rigid stops that are touched at a state, some of which may have just been hit: velocities, events. Which stops and
  !> joints with friction hold then is not said: those that held still do.
  subroutine pass_impacts(m, ev, at, fallen, list, x)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(motion_state), intent(inout) :: at
    logical, intent(in) :: fallen(:)          !! (roots)
    type(event_list), intent(inout) :: list
    type(impact_result), intent(out) :: x
    type(contact_set) :: c
    integer, allocatable :: before(:)         ! states
    integer :: i
    allocate (x%lost(size(m%s%switching)), x%impulse(size(m%s%switching)), source=0.0_wp)
    allocate (x%integrated(size(m%s%integrated)), source=0.0_wp)
    allocate (x%side(size(m%s%constraints) - m%s%permanent), source=0)
    allocate (x%yield(size(x%side)), x%restitution(size(x%side)), source=0.0_wp)
    if (m%s%stop_rows == 0) return
    call find_contacts(m, ev, at%q, at%v, fallen, c)
    if (c%n == 0) return
    before = ev%switches%state
    ev%switches%state(size(m%s%switching) + 1:) = by_position     ! friction has no impulses
    ev%switches%state(c%element) = stop_open
    call evaluate_motion(m, ev, at)
    call find_responses(m, ev, c)
    call strike(m, ev, at%t, at%q, at%v, c, list, x)
    ev%switches%state = before
    x%side(c%place) = c%side
    x%yield(c%place) = [(c%w(i, i), i=1, c%n)]
    x%restitution(c%place) = c%e
  end subroutine pass_impacts

  !> For an equilibrium, at its last evaluation: closes the rigid stops that are entered; where none is, opens those that pull.
  subroutine close_entered(m, ev, changed)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    logical, intent(out) :: changed
    real(wp) :: x                             ! [m] or [rad]
    logical :: beyond
    integer :: k, pass
    changed = .false.
    do pass = 1, 2
      do k = size(m%s%constraints) - m%s%stop_rows + 1, size(m%s%constraints)
        select type (row => m%s%constraints(k)%item)
        class is (stop_row_model)
          associate (state => ev%switches%state(row%switch_number), event_value => ev%switches%event_value(row%switch_number))
            if (pass == 1 .and. .not. row%holds(state)) then
              x = row%position(ev%p)
              beyond = row%weight()*max(x - row%upper, row%lower - x) > entered*m%s%size
              if (beyond) state = merge(stop_touching, -stop_touching, x > row%upper)
              if (beyond) event_value = row%weight()*merge(row%upper, row%lower, state > 0)
              changed = changed .or. beyond
            else if (pass == 2 .and. row%holds(state) .and. state*ev%lambda(row%first) < 0.0_wp) then
              state = stop_open
              event_value = 0.0_wp
              changed = .true.
            end if
          end associate
        end select
      end do
      if (changed) return
    end do
  end subroutine close_entered

  !> Rigid stops that are closed or touched without a force, or whose limit is reached.
  subroutine find_contacts(m, ev, q, v, fallen, c)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in), contiguous :: q(:), v(:)   !! (nq) [m, rad] and per second
    logical, intent(in) :: fallen(:)          !! (roots)
    type(contact_set), intent(out) :: c
    type(watched_roots) :: roots
    logical :: down(most_roots)
    integer :: k, i, side
    allocate (c%element(0), c%place(0), c%row(0), c%side(0), c%closed(0), c%e(0))
    call marker_kinematics(m, ev, q, v)
    do k = 1, size(m%s%constraints) - m%s%permanent
      select type (row => m%s%constraints(m%s%permanent + k)%item)
      class is (stop_row_model)
        i = row%switch_number
        down = fallen(most_roots*(i - 1) + 1:most_roots*i)
        side = sign(1, ev%switches%state(i))
        if (ev%switches%state(i) == stop_open) then
          call m%s%forces(m%s%switching(i))%item%roots(ev%p, conditions_of(m, ev, m%s%switching(i)), roots)
          if (.not. any(down .or. roots%g <= roots%zero)) cycle
          side = merge(1, -1, roots%g(1) <= roots%g(2))
        end if
        c%element = [c%element, i]
        c%place = [c%place, k]
        c%row = [c%row, row%first]
        c%side = [c%side, side]
        c%closed = [c%closed, row%holds(ev%switches%state(i))]
        c%e = [c%e, row%restitution]
      end select
    end do
    c%n = size(c%element)
  end subroutine find_contacts

  !> Velocities by unit impulses of the touched stops, with the factors of an evaluation in which their rows are off.
  subroutine find_responses(m, ev, c)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(contact_set), intent(inout) :: c
    real(wp) :: mu(m%s%rows), motion(m%s%rows), u(m%s%nq)   ! [-], [1/kg], [1/kg, 1/(kg m)]
    integer :: i
    allocate (c%response(m%s%nq, c%n), c%joints(m%s%rows, c%n), c%w(c%n, c%n), c%alone(c%n))
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
      if (c%w(i, i) > no_motion*c%alone(i)) cycle
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
    real(wp), dimension(c%n) :: u, still, after, impulse   ! opening speeds before, so small none, after [m/s], [N s]
    real(wp) :: b(c%n)                        ! [m/s]
    real(wp), allocatable :: part(:)          ! [N s]
    integer, allocatable :: chosen(:)
    logical :: met(c%n), solved
    integer :: pass, i
    do pass = 1, 4*c%n + 4
      do i = 1, c%n
        associate (row => motion_of_row(m, ev, c%place(i)))
          u(i) = -c%side(i)*row%rate
          still(i) = row%still
        end associate
      end do
      met = u < -still
      if (.not. any(met)) return
      chosen = pack([(i, i=1, c%n)], u <= still)      ! stops of which none may be entered: W x + b >= 0, x >= 0, one of both zero
      b = merge((1 + c%e)*u, 0.0_wp, met)
      part = b(chosen)
      call solve_complementarity(c%w(chosen, chosen), b(chosen), part, solved)
      impulse = 0.0_wp
      impulse(chosen) = part
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
          if (met(i) .and. .not. c%closed(i)) call list%add(switch_event(t, n, stop_open, c%side(i)*stop_rebound, -u(i)/weight))
        end associate
      end do
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
end module impacts
