!> Stops: one-sided contacts that yield. A stop limits a measure x: an angle, a position along a line, a distance (a pin with
!> clearance). Beyond a limit, by the
!> penetration d, it pushes back with
!>
!>   F = K d^n (1 + chi d')                                   (Hunt & Crossley 1975)
!>
!> and never pulls. Where a restitution e is stated, chi = y/v0 with v0 = d' at touching and y solved for, so that two free masses
!> part with e v0 (theory.md, section 10). States:
!> - open;
!> - touching;
!> - let go: still beyond the limit, but the factor 1 + chi d' is negative, so that no force acts.
!> Events lead from one to another. Where no state is kept, it follows from the position.
!>
!> A rigid stop does not yield: impacts make velocities jump (`impacts`), and while it is closed a constraint row of its own acts
!> (`stop_row`). Its states: open; touching, that is closed; unloaded: it touches, but other rows already prevent its motion.
module stops
  use kinds, only: wp, pi
  use constraint, only: marker_stiffness
  use force_element, only: force_model, conditions, element_action, watched_roots, bilateral, by_position, root_rounding
  use marker, only: marker_states
  use measure, only: measured, sunken, together
  use small_matrices, only: outer
  use text, only: either, to_text
  implicit none (type, external)
  private
  public :: rebound_factor

  integer, parameter, public :: stop_open = 0, stop_touching = 1, stop_let_go = 2   !! negative ones: of the lower limit
  integer, parameter, public :: stop_unloaded = 2, stop_rebound = 3   !! of rigid stops; the last one only says what an event was

  real(wp), parameter, public :: slowest_touch = 1.0e-3_wp   !! least v0 that a restitution is taken from, in sizes or rad [1/s]
  real(wp), parameter, public :: example_depth = 0.01_wp     !! penetration at which an open stop is described [size or rad]

  real(wp), parameter, public :: share_of_contact = 0.1_wp   !! a step that follows a contact, of the contact [-]
  real(wp), parameter, public :: share_of_flight = 0.3_wp    !! the first step after a rebound, of the flight to the next [-]

  !> A stop.
  type, extends(force_model), public :: stop_model
    real(wp) :: lower = -huge(1.0_wp)      !! limits of x; a huge one does not exist [m] or [rad]
    real(wp) :: upper = huge(1.0_wp)       !! [m] or [rad]
    real(wp) :: hardness = 0.0_wp          !! K [N/m^n] or [N m/rad^n]
    real(wp) :: exponent = 1.5_wp          !! n [-]
    real(wp) :: chi = 0.0_wp               !! damping, where it is stated [s/m] or [s/rad]
    real(wp) :: rebound = 0.0_wp           !! y, where a restitution is stated [-]
    real(wp) :: assembled = 0.0_wp         !! penetration of the assembled scene, negative: of the lower limit [m] or [rad]
    logical :: rigid = .false.             !! does not yield
    real(wp) :: restitution = 1.0_wp       !! e of a rigid one [-]
  contains
    procedure :: contact
    procedure :: slopes
    procedure :: force_slopes
    procedure :: damping_factor
    procedure :: scaled
    procedure :: stiffness_at
    procedure :: impact_time
    procedure :: speed_to
    procedure :: act => stop_act
    procedure :: tangent => stop_tangent
    procedure :: rate_components => stop_rate_components
    procedure :: energy => stop_energy
    procedure :: init_from_assembly => stop_from_assembly
    procedure :: check => check_start
    procedure :: measured_text
    procedure :: row_force
    procedure :: roots => stop_roots
    procedure :: switch => stop_switch
    procedure :: state_word => stop_word
    procedure :: contact_force => stop_force      !! of a penetration and its rate
    procedure :: smoothness => power_of_time      !! power of the time with which its force begins and ends
  end type stop_model

  !> Where a stop touches.
  type, public :: stop_contact
    integer :: state = stop_open
    integer :: side = 0                    !! 1: the upper limit, -1: the lower one, 0: open
    real(wp) :: depth = 0.0_wp             !! penetration; open: minus the distance to the nearest limit [m] or [rad]
    real(wp) :: rate = 0.0_wp              !! its rate [m/s] or [rad/s]
    real(wp) :: elastic = 0.0_wp           !! K d^n [N] or [N m]
    real(wp) :: force = 0.0_wp             !! F [N] or [N m]
    real(wp) :: g(6) = 0.0_wp              !! gradient of the penetration by x, y, section angle of a, then of b [-], [m]
  end type stop_contact

contains

  !> y of a restitution e: ln((1+y)/(1-ey)) = y(1+e), 0 for e = 1. With p(y) = (ln(1+y) - y)/y^2 + 1/2, which has no cancellation
  !> left, it reads p(y) - e^2 p(-ey) = (1-e)(1+e)/2, and its left side grows from 0 to infinity between 0 and 1/e: bisection.
  pure real(wp) function rebound_factor(e) result(y)   ! [-]
    real(wp), intent(in) :: e              !! 0 < e <= 1 [-]
    real(wp) :: low, high
    low = 0.0_wp
    high = 1/e
    do
      y = 0.5_wp*(low + high)
      if (y <= low .or. y >= high) exit
      if (p(y) - e**2*p(-e*y) < 0.5_wp*(1 - e)*(1 + e)) then
        low = y
      else
        high = y
      end if
    end do
    if (e >= 1.0_wp) y = 0.0_wp
  contains
    !> (ln(1+x) - x)/x^2 + 1/2 = x/3 - x^2/4 + ...
    pure real(wp) function p(x)
      real(wp), intent(in) :: x            !! > -1 [-]
      integer :: k
      if (abs(x) > 0.5_wp) then
        p = (log(1 + x) - x)/x**2 + 0.5_wp
        return
      end if
      p = 0.0_wp
      do k = 60, 3, -1
        p = merge(1.0_wp, -1.0_wp, mod(k, 2) == 1)/k + x*p
      end do
      p = p*x
    end function p
  end function rebound_factor

  !> Where it touches, and what it does there. A state that is kept counts beyond what the position says, so that trials of a step
  !> feel smooth forces; only a trial on this side of the limit feels none.
  pure subroutine contact(self, p, with, c)
    class(stop_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    type(stop_contact), intent(out) :: c
    type(measured) :: now
    real(wp) :: ratio
    integer :: side
    call self%measure%measure(p, now)
    side = merge(1, -1, now%x - self%upper >= self%lower - now%x)
    if (all(with%state /= [by_position, bilateral, stop_open])) side = sign(1, with%state)
    c%depth = now%x - self%upper
    if (side < 0) c%depth = self%lower - now%x
    c%depth = c%depth - (1 - with%prestress)*max(side*self%assembled, 0.0_wp)
    c%rate = side*now%rate
    c%g = side*now%g
    ratio = self%damping_factor(c%rate, with)
    c%state = with%state
    if (with%state == by_position) then
      c%state = side*merge(stop_touching, stop_let_go, ratio >= 0.0_wp)
      if (c%depth <= 0.0_wp) c%state = stop_open
    end if
    if (c%state == bilateral) c%state = stop_open
    if (c%state == stop_open) return
    c%side = side
    c%elastic = self%hardness*max(c%depth, 0.0_wp)**self%exponent
    if (abs(c%state) == stop_touching) c%force = c%elastic*ratio
  end subroutine contact

  !> 1 + chi d', with the speed at the present touching.
  pure real(wp) function damping_factor(self, rate, with)      ! [-]
    class(stop_model), intent(in) :: self
    real(wp), intent(in) :: rate           !! of the penetration [m/s] or [rad/s]
    type(conditions), intent(in) :: with
    damping_factor = 1 + present_damping(self, with)*rate
  end function damping_factor

  !> chi. A restitution says nothing of motions about a contact that no touching began: none there.
  pure real(wp) function present_damping(self, with) result(chi)   ! [s/m] or [s/rad]
    class(stop_model), intent(in) :: self
    type(conditions), intent(in) :: with
    chi = self%chi
    if (self%rebound > 0.0_wp .and. with%event_value > 0.0_wp) chi = self%rebound/with%event_value
  end function present_damping

  !> A penetration, or its rate, that is stated in sizes or rad.
  pure real(wp) function scaled(self, x)               ! [m] or [rad], and per second
    class(stop_model), intent(in) :: self
    real(wp), intent(in) :: x              !! in sizes or rad, and per second [-]
    scaled = x*merge(1.0_wp, self%size, self%angular)
  end function scaled

  !> n K d^(n-1).
  pure real(wp) function stiffness_at(self, depth) result(k)   ! [N/m] or [N m/rad]
    class(stop_model), intent(in) :: self
    real(wp), intent(in) :: depth          !! [m] or [rad]
    k = self%exponent*self%hardness*max(depth, 0.0_wp)**(self%exponent - 1)
  end function stiffness_at

  !> How long an elastic impact lasts: c d/v0 with the deepest penetration d = ((n+1) m v0^2/(2K))^(1/(n+1)), and
  !> c = 2 sqrt(pi) G(1+1/(n+1))/G(1/2+1/(n+1)): pi for n = 1, 2.943 for n = 1.5. A large y of the restitution shortens what is fast
  !> in it.
  pure real(wp) function impact_time(self, mass, speed) result(time)   ! [s]
    class(stop_model), intent(in) :: self
    real(wp), intent(in) :: mass           !! that meets it [kg] or [kg m2]
    real(wp), intent(in) :: speed          !! [m/s] or [rad/s]
    real(wp) :: a
    time = huge(1.0_wp)
    if (.not. speed > 0.0_wp) return
    a = 1/(self%exponent + 1)
    time = 2*sqrt(pi)*gamma(1 + a)/gamma(0.5_wp + a)*(mass*speed**2/(2*a*self%hardness))**a/speed
    time = time/max(1.0_wp, 0.25_wp*max(self%rebound, self%chi*speed))
  end function impact_time

  !> The speed at touching from which a free mass comes to rest at a penetration; a rate that it has there counts by its energy.
  !> With s = d'/v0 the motion obeys m s ds/(1 + y s) = -K d^n dd/v0^2, and the integral of s/(1 + y s) from 0 to 1 is
  !> (y - ln(1 + y))/y^2, 1/2 for y = 0.
  pure real(wp) function speed_to(self, mass, depth, rate) result(speed)   ! [m/s] or [rad/s]
    class(stop_model), intent(in) :: self
    real(wp), intent(in) :: mass           !! that meets it [kg] or [kg m2]
    real(wp), intent(in) :: depth          !! [m] or [rad]
    real(wp), intent(in) :: rate           !! [m/s] or [rad/s]
    real(wp) :: share
    share = 0.5_wp
    if (self%rebound > 0.01_wp) share = (self%rebound - log(1 + self%rebound))/self%rebound**2
    speed = sqrt(rate**2 + self%hardness*max(depth, 0.0_wp)**(self%exponent + 1)/((self%exponent + 1)*mass*share))
  end function speed_to

  !> The force against the penetration; what damping takes, or what a contact loses that lets go.
  pure subroutine stop_act(self, p, with, z, zd, zdd, x)
    class(stop_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp), intent(in) :: z(*), zd(*)    !! not used [-]
    real(wp), intent(inout) :: zdd(*)      !! left as they are [-]
    type(element_action), intent(inout) :: x
    type(stop_contact) :: c
    call self%contact(p, with, c)
    x%force = c%force
    x%dissipated = (c%force - c%elastic)*c%rate
    x%a = -c%force*c%g(1:3)
    x%b = -c%force*c%g(4:6)
  end subroutine stop_act

  !> At touching the stiffness is that of penetrations.
  pure subroutine stop_tangent(self, p, with, part, force, k)
    class(stop_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp), intent(in) :: part(2)        !! factors of stiffness and damping [-]
    real(wp), intent(in) :: force          !! present force; the contact says it itself [N] or [N m]
    type(marker_stiffness), intent(inout) :: k
    type(stop_contact) :: c
    type(measured) :: now
    real(wp) :: stiffness, damping
    integer :: side
    k%k = 0.0_wp
    k%c = 0.0_wp
    if (with%state == stop_open) return
    call self%contact(p, with, c)
    if (with%state == bilateral) then
      stiffness = self%stiffness_at(self%scaled(example_depth))
      call self%measure%measure(p, now)
      side = merge(1, -1, now%x - self%upper >= self%lower - now%x)
      ! pressed, it holds along a bend, too
      call self%tangent_along(p, stiffness, 0.0_wp, side*stiffness*self%scaled(example_depth), k)
      if (self%in_all_directions()) k%k = stiffness*together
      return
    end if
    if (abs(c%state) /= stop_touching) return
    call self%slopes(with, c%depth, c%rate, stiffness, damping)
    call self%tangent_along(p, part(1)*stiffness, part(2)*damping, c%side*c%force, k)
  end subroutine stop_tangent

  !> Its damping grows with its force: it sees the rates of all that it acts on.
  pure function stop_rate_components(self) result(list)
    class(stop_model), intent(in) :: self
    integer, allocatable :: list(:)
    list = self%components()
  end function stop_rate_components

  !> Derivatives of the force of a stop that touches by penetration and by its rate.
  pure subroutine slopes(self, with, depth, rate, stiffness, damping)
    class(stop_model), intent(in) :: self
    type(conditions), intent(in) :: with
    real(wp), intent(in) :: depth          !! [m] or [rad]
    real(wp), intent(in) :: rate           !! [m/s] or [rad/s]
    real(wp), intent(out) :: stiffness, damping   !! [N/m], [N s/m] or [N m/rad], [N m s/rad]
    stiffness = self%stiffness_at(depth)*self%damping_factor(rate, with)
    damping = self%hardness*max(depth, 0.0_wp)**self%exponent*present_damping(self, with)
  end subroutine slopes

  !> The same by the places of the markers (x, y, section angle of a, then of b) and by their rates.
  pure subroutine force_slopes(self, p, with, by_place, by_rate)
    class(stop_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp), intent(out) :: by_place(6)   !! [N/m], [N]
    real(wp), intent(out) :: by_rate(6)    !! [N s/m], [N s]
    type(stop_contact) :: c
    real(wp) :: stiffness, damping
    call self%contact(p, with, c)
    by_place = 0.0_wp
    by_rate = 0.0_wp
    if (abs(c%state) /= stop_touching) return
    call self%slopes(with, c%depth, c%rate, stiffness, damping)
    by_place = stiffness*c%g + damping*c%side*self%measure%turning(p)
    by_rate = damping*c%g
  end subroutine force_slopes

  !> K d^(n+1)/(n+1) [J].
  pure real(wp) function stop_energy(self, p, z, zd) result(energy)
    class(stop_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: z(*), zd(*)    !! not used [-]
    type(stop_contact) :: c
    call self%contact(p, conditions(), c)
    energy = c%elastic*max(c%depth, 0.0_wp)/(self%exponent + 1)
  end function stop_energy

  !> The penetration of the assembled scene, from which prestress grows.
  subroutine stop_from_assembly(self, p, gap)
    class(stop_model), intent(inout) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: gap            !! not used [m]
    type(stop_contact) :: c
    call self%contact(p, conditions(), c)
    self%assembled = c%side*c%depth
  end subroutine stop_from_assembly

  !> Limits that exclude the assembled position are told with all values; a rigid stop cannot begin there.
  pure subroutine check_start(self, p, gap, fault, warning)
    class(stop_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: gap            !! distance up to which markers coincide [m]
    character(:), allocatable, intent(out) :: fault, warning
    type(stop_contact) :: c
    fault = ''
    warning = ''
    call self%contact(p, conditions(), c)
    if (self%rigid .and. c%depth*merge(self%size, 1.0_wp, self%angular) > gap) fault = 'it is rigid, and it begins beyond its '// &
      'limit: it '//self%measured_text(p)//'; expected bodies within the limits, or stiffness'
    if (.not. self%rigid .and. c%depth > root_rounding*self%size) warning = 'begins beyond its limit: it '// &
      self%measured_text(p)//', and it pushes with '//to_text(self%hardness*c%depth**self%exponent)// &
      either(' N m', ' N', self%angular)
    if (self%measure%sunk(p)) fault = 'it begins '//sunken//'; expected bodies beside the profile'
  end subroutine check_start

  !> Its quantity beside its limits, as part of a sentence.
  pure function measured_text(self, p) result(text)
    class(stop_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    character(:), allocatable :: text
    type(measured) :: now
    call self%measure%measure(p, now)
    text = 'measures '//to_text(now%x)//either(' rad', ' m', self%angular)//', allowed is'
    if (self%lower > -huge(1.0_wp)) text = text//' from '//to_text(self%lower)
    if (self%upper < huge(1.0_wp)) text = text//' up to '//to_text(self%upper)
  end function measured_text

  !> Open: the distances to both limits. Touching or let go: the penetration, and the factor of the force.
  !> Of a rigid one that is closed: the force.
  pure subroutine stop_roots(self, p, with, watched)
    class(stop_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    type(watched_roots), intent(out) :: watched
    type(stop_contact) :: c
    type(measured) :: now
    if (with%state == stop_open) then
      call self%measure%measure(p, now)
      call distances(self, now%x, now%rate, watched)
    else if (self%rigid) then
      if (abs(with%state) == stop_touching) watched%g(1) = self%row_force(with)
      watched%rate(1) = huge(1.0_wp)
      watched%zero(1) = 0.0_wp
      return
    else
      call self%contact(p, with, c)
      watched%g(1) = c%depth
      watched%rate(1) = c%rate
      if (present_damping(self, with) > 0.0_wp) then
        watched%g(2) = self%damping_factor(c%rate, with)*merge(1, -1, abs(with%state) == stop_touching)
        watched%rate(2) = huge(1.0_wp)
      end if
    end if
    if (self%angular) then
      watched%zero(1) = root_rounding*max(1.0_wp, abs(p%angle(self%ia)), abs(p%angle(self%ib)))
    else
      watched%zero(1) = root_rounding*max(self%size, norm2(p%r(:, self%ia)), norm2(p%r(:, self%ib)))
    end if
    if (with%state == stop_open) watched%zero(2) = watched%zero(1)
  end subroutine stop_roots

  !> The distances to both limits; of a pin in its hole (gap^2 - x^2)/(2 gap), smooth where they are concentric, also of a ball
  !> in its bowl, whose x is what is left of the gap.
  pure subroutine distances(self, x, xd, watched)
    class(stop_model), intent(in) :: self
    real(wp), intent(in) :: x              !! [m] or [rad]
    real(wp), intent(in) :: xd             !! [m/s] or [rad/s]
    type(watched_roots), intent(inout) :: watched
    if (self%measure%radial) then
      watched%g(1) = 0.5_wp*(self%upper - x)*(1 + x/self%upper)
      watched%rate(1) = -xd*x/self%upper
    else if (self%upper < huge(1.0_wp)) then
      watched%g(1) = self%upper - x
      watched%rate(1) = -xd
    end if
    if (self%lower > -huge(1.0_wp)) then
      watched%g(2) = x - self%lower
      watched%rate(2) = xd
    end if
    associate (most => self%measure%span)
      if (most > 0.0_wp) watched%g(2) = x*(1 - 0.5_wp*x/most)
      if (most > 0.0_wp) watched%rate(2) = xd*(1 - x/most)
    end associate
  end subroutine distances

  !> Touching keeps the speed of it, at least the floor; a contact that lets go and presses again keeps that of its touching.
  pure subroutine stop_switch(self, p, with, which, state, event_value)
    class(stop_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    integer, intent(in) :: which           !! the root that fell to zero; 0: no event
    integer, intent(out) :: state
    real(wp), intent(out) :: event_value   !! [m/s] or [rad/s]
    type(measured) :: now
    integer :: side
    event_value = with%event_value
    if (which == 0) then
      call start_contact(self, p, with, state, event_value)
    else if (with%state == stop_open) then
      call self%measure%measure(p, now)
      side = merge(1, -1, which == 1)
      state = side*stop_touching
      event_value = max(side*now%rate, self%scaled(slowest_touch))
    else if (which == 1) then
      state = stop_open
      event_value = 0.0_wp
    else
      state = sign(merge(stop_let_go, stop_touching, abs(with%state) == stop_touching), with%state)
    end if
  end subroutine stop_switch

  !> The state of a position that no event has led to: beyond a limit, or on it and not leaving, it touches with the speed that it
  !> has, at least the floor. Where it leaves so fast that the stop would pull, it has let go.
  pure subroutine start_contact(self, p, with, state, event_value)
    class(stop_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    integer, intent(out) :: state
    real(wp), intent(out) :: event_value   !! [m/s] or [rad/s]
    type(conditions) :: unknown
    type(watched_roots) :: watched
    type(stop_contact) :: c
    unknown = with
    unknown%state = stop_open
    call self%roots(p, unknown, watched)
    state = stop_open
    event_value = 0.0_wp
    if (self%rigid) return                 ! `impacts` closes it
    if (minval(watched%g) > watched%zero(1)) return
    state = merge(1, -1, watched%g(1) <= watched%g(2))*stop_touching
    unknown%state = state
    call self%contact(p, unknown, c)
    if (c%depth <= watched%zero(1) .and. c%rate < 0.0_wp) then
      state = stop_open
    else
      event_value = max(c%rate, self%scaled(slowest_touch))
      unknown%event_value = event_value
      if (self%damping_factor(c%rate, unknown) < 0.0_wp) state = sign(stop_let_go, state)
    end if
  end subroutine start_contact

  !> With what a rigid stop pushes, by the multiplier of its row.
  pure real(wp) function row_force(self, with) result(force)   ! [N] or [N m]
    class(stop_model), intent(in) :: self
    type(conditions), intent(in) :: with
    force = 0.0_wp
    if (abs(with%state) /= stop_touching) return
    force = sign(1, with%state)*with%multiplier
    if (self%angular) force = self%size*force
  end function row_force

  !> F of a stop that touches.
  pure real(wp) function stop_force(self, with, depth, rate) result(force)   ! [N] or [N m]
    class(stop_model), intent(in) :: self
    type(conditions), intent(in) :: with
    real(wp), intent(in) :: depth          !! [m] or [rad]
    real(wp), intent(in) :: rate           !! [m/s] or [rad/s]
    force = 0.0_wp
    if (abs(with%state) == stop_touching) force = self%hardness*max(depth, 0.0_wp)**self%exponent*self%damping_factor(rate, with)
  end function stop_force

  !> A force that begins as d^n has only n smooth derivatives by time, unless n is a whole number.
  pure real(wp) function power_of_time(self) result(power)   ! [-]
    class(stop_model), intent(in) :: self
    power = huge(1.0_wp)
    if (abs(self%exponent - nint(self%exponent)) > 0.0_wp) power = self%exponent
  end function power_of_time

  !> A state in a word: `open`; the limit that it touches; `_free` where it has let go of it.
  pure function stop_word(self, state) result(word)
    class(stop_model), intent(in) :: self
    integer, intent(in) :: state
    character(:), allocatable :: word
    word = 'upper'
    if (state < 0) word = 'lower'
    if (abs(state) == stop_let_go) word = word//either('_unloaded', '_free', self%rigid)
    if (abs(state) == stop_rebound) word = word//'_rebound'
    if (state == stop_open) word = 'open'
  end function stop_word
end module stops
