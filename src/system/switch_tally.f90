!> Figures of the summary about elements that switch: their events by the state after them, first and last, and of contacts the
!> largest force and penetration and the fewest steps. Between the ends of a step the penetration follows the cubic with the values
!> and rates at both ends. Of the friction of a joint: how often it sticks and slips, how far it slides, how long it is at rest, how
!> near it comes to its limit there.
module switch_tally
  use kinds, only: wp, ip
  use force_element, only: conditions
  use friction_law, only: row_parted, sliding
  use stops, only: share_of_contact, share_of_flight, stop_model
  implicit none (type, external)
  private

  real(wp), parameter :: near_end = 0.25_wp   !! of a contact: there its force is that of its beginning or end [-]

  !> Of one element. The checkpoint keeps its words.
  type, public :: element_tally
    integer(ip) :: touched(2) = 0             !! at the upper and lower limit
    integer(ip) :: opened = 0
    integer(ip) :: let_go = 0                 !! still touching, but without force
    integer(ip) :: pressed = 0                !! acts again
    real(wp) :: first = 0.0_wp, last = 0.0_wp !! times of the first and the last one [s]
    real(wp) :: force = 0.0_wp                !! largest [N] or [N m]
    real(wp) :: depth = 0.0_wp                !! largest penetration [m] or [rad]
    real(wp) :: impulse = 0.0_wp              !! of rigid stops: largest [N s] or [N m s]
    integer :: steps = 0                      !! of the present contact
    real(wp) :: mass = huge(1.0_wp)           !! that hits the stop in it [kg] or [kg m2]
    real(wp) :: time = huge(1.0_wp)           !! its estimated duration [s]
    real(wp) :: age = 0.0_wp                  !! time since its beginning [s]
    real(wp) :: longest = huge(1.0_wp)        !! step that it allows [s]
    real(wp) :: to_end = 0.0_wp               !! from its beginning, or to its end by depth and rate [s]
    real(wp) :: briefest = huge(1.0_wp)       !! contact that has ended [s]
    integer :: fewest = huge(1)               !! steps of a contact that has ended
  contains
    procedure :: count => count_events
    procedure :: note_contact
    procedure :: note_impact
    procedure :: note_rigid
    procedure :: note_event
    procedure :: note_step
    procedure :: graded
  end type element_tally

  !> Of one joint. The checkpoint keeps its words.
  type, public :: joint_tally
    integer(ip) :: sticks = 0                 !! events: it came to rest
    integer(ip) :: slips = 0                  !! it broke away
    integer(ip) :: turns = 0                  !! it went on the other way
    real(wp) :: slid = 0.0_wp                 !! to and fro until the last step [m] or [rad]
    real(wp) :: position = 0.0_wp             !! where it was then [m] or [rad]
    real(wp) :: rest = 0.0_wp                 !! time at rest [s]
    real(wp) :: share = 0.0_wp                !! largest one of the limit at rest [-]
    logical :: undetermined = .false.         !! its present share is not determined by rigid bodies
    real(wp) :: unknown = 0.0_wp              !! how long that was so [s]
  contains
    procedure :: note_event => note_friction
    procedure :: note_rest
  end type joint_tally


contains

  !> All events.
  elemental integer(ip) function count_events(self) result(n)
    class(element_tally), intent(in) :: self
    n = sum(self%touched) + self%opened + self%let_go + self%pressed
  end function count_events

  !> Counts an event.
  pure subroutine note_event(self, t, from, to)
    class(element_tally), intent(inout) :: self
    real(wp), intent(in) :: t                 !! [s]
    integer, intent(in) :: from, to           !! states before and after it: 0, 1 or -1 touching, 2 or -2 without force
    if (self%count() == 0) self%first = t
    self%last = t
    if (from == 0) then
      self%touched = self%touched + merge([1, 0], [0, 1], to > 0)
    else if (to == 0) then
      self%opened = self%opened + 1
    else if (abs(to) > abs(from)) then
      self%let_go = self%let_go + 1
    else
      self%pressed = self%pressed + 1
    end if
    if (to /= 0) return
    if (self%steps > 0) self%fewest = min(self%fewest, self%steps)
    if (self%age > 0.0_wp) self%briefest = min(self%briefest, self%age)
    self%steps = 0
    self%age = 0.0_wp
    self%longest = huge(1.0_wp)
  end subroutine note_event

  !> A contact begins: steps must be a part of it.
  pure subroutine note_contact(self, mass, time)
    class(element_tally), intent(inout) :: self
    real(wp), intent(in) :: mass              !! that meets the stop [kg] or [kg m2]
    real(wp), intent(in) :: time              !! estimated duration [s]
    self%mass = mass
    self%time = time
    self%age = 0.0_wp
    self%to_end = 0.0_wp
    self%longest = share_of_contact*time
  end subroutine note_contact

  !> A rigid stop has been hit: the first step after it must be a part of the flight to the next impact.
  pure subroutine note_impact(self, impulse, flight)
    class(element_tally), intent(inout) :: self
    real(wp), intent(in) :: impulse           !! [N s] or [N m s]
    real(wp), intent(in) :: flight            !! [s]
    self%impulse = max(self%impulse, impulse)
    self%longest = share_of_flight*flight
  end subroutine note_impact

  !> Notes an accepted step of a rigid stop.
  pure subroutine note_rigid(self, state, force)
    class(element_tally), intent(inout) :: self
    integer, intent(in) :: state              !! 0: open
    real(wp), intent(in) :: force(2)          !! with which it pushes at both ends, where it is closed [N]
    self%longest = huge(1.0_wp)
    if (state /= 0) self%force = max(self%force, maxval(force, mask=force < huge(1.0_wp)))
  end subroutine note_rigid

  !> Notes an accepted step of an element that is not open. A contact that lasts is no impact any more: explicit steps have to
  !> follow its stiffness, others are free.
  pure subroutine note_step(self, stop, with, explicit, h, g, rate)
    class(element_tally), intent(inout) :: self
    class(stop_model), intent(in) :: stop     !! that element
    type(conditions), intent(in) :: with      !! with its state in the step
    logical, intent(in) :: explicit           !! the method's steps have to follow the stiffness
    real(wp), intent(in) :: h                 !! [s]
    real(wp), intent(in) :: g(0:1), rate(0:1) !! penetration at both ends, and its rates [m], [m/s] or [rad], [rad/s]
    integer, parameter :: parts(2) = [2, 16]  ! two show whether there is a maximum between the ends at all
    real(wp) :: depth(0:maxval(parts)), force(0:maxval(parts)), speed, s
    real(wp) :: stiffness, damping            ! [N/m], [N s/m] or [N m/rad], [N m s/rad]
    integer :: i, j, n
    self%steps = self%steps + 1
    do j = 1, size(parts)
      n = parts(j)
      do i = 0, n
        s = real(i, wp)/n
        depth(i) = g(0) + s**2*(3 - 2*s)*(g(1) - g(0)) + h*s*(1 - s)*((1 - s)*rate(0) - s*rate(1))
        speed = 6*s*(1 - s)*(g(1) - g(0))/h + (1 - s)*(1 - 3*s)*rate(0) + s*(3*s - 2)*rate(1)
        force(i) = stop%contact_force(with, depth(i), speed)
      end do
      if (.not. (arched(depth) .or. arched(force))) exit
    end do
    self%depth = max(self%depth, peak(depth(:n)))
    self%force = max(self%force, peak(force(:n)))
    self%age = self%age + h
    self%to_end = max(g(1), 0.0_wp)/max(abs(rate(1)), tiny(1.0_wp))
    if (0.5_wp*self%age > self%time) self%longest = huge(1.0_wp)
    if (.not. explicit) return
    call stop%slopes(with, maxval(depth(:n)), maxval(rate), stiffness, damping)
    ! explicit methods follow a mass on it: c h/m at most 2, where they are stable, and sqrt(k/m) h at most 0.5, where they hardly
    ! damp its vibration
    self%longest = min(self%longest, 1/max(tiny(1.0_wp), 0.5_wp*damping/self%mass + &
                                                                   2*sqrt(max(stiffness, 0.0_wp)/self%mass)))
  end subroutine note_step

  !> A force that begins and ends as the power n of time, its derivatives without bound there, leaves a method of order p the order
  !> n + 1 with equal steps. Steps that grow as the power (p-n)/p of the time x from there err by the same in the same time, since
  !> h^p x^(n-p) is constant; the first step is as long as such a step at its end.
  pure real(wp) function graded(self, h, order, power) result(longest)   ! [s]
    class(element_tally), intent(in) :: self
    real(wp), intent(in) :: h                 !! far from there [s]
    integer, intent(in) :: order
    real(wp), intent(in) :: power             !! n; huge: the force is smooth [-]
    real(wp) :: first, part, growth           ! [s], [s], [-]
    longest = h
    if (order <= power + 1) return
    part = near_end*self%time
    if (h >= part) return
    growth = (order - power)/order
    first = part*(h/part)**(1/(1 - growth))
    longest = h*(min(part, max(self%to_end, first))/part)**growth
  end function graded

  !> Whether the parabola through three equidistant values has its maximum between them.
  pure logical function arched(x) result(yes)
    real(wp), intent(in) :: x(0:)             !! the first three are meant [any]
    yes = 4*x(1) > 3*x(0) + x(2) .and. 4*x(1) > x(0) + 3*x(2)
  end function arched

  !> The largest of equidistant values, by the parabola through it and its neighbours.
  pure real(wp) function peak(x)              ! [any]
    real(wp), intent(in) :: x(0:)             !! [any]
    real(wp) :: bend
    integer :: i
    i = maxloc(x, 1) - 1
    peak = x(i)
    if (i == 0 .or. i == ubound(x, 1)) return
    bend = 2*x(i) - x(i - 1) - x(i + 1)
    if (bend > 0.0_wp) peak = x(i) + (x(i + 1) - x(i - 1))**2/(8*bend)
  end function peak

  !> Counts an event.
  pure subroutine note_friction(self, before, after)
    class(joint_tally), intent(inout) :: self
    integer, intent(in) :: before, after      !! states of the row
    if (sliding(before) == sliding(after) .or. any([before, after] == row_parted)) return   ! another pad, or none, presses
    if (sliding(after) == 0) then
      self%sticks = self%sticks + 1
    else if (sliding(before) == 0) then
      self%slips = self%slips + 1
    else
      self%turns = self%turns + 1
    end if
  end subroutine note_friction

  !> An accepted step at rest.
  pure subroutine note_rest(self, h, share)
    class(joint_tally), intent(inout) :: self
    real(wp), intent(in) :: h                 !! [s]
    real(wp), intent(in) :: share             !! of the limit [-]
    self%rest = self%rest + h
    self%share = max(self%share, share)
    if (self%undetermined) self%unknown = self%unknown + h
  end subroutine note_rest
end module switch_tally
