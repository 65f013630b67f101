!> Coulomb's law of a joint: up to which tangential force its surfaces stick, and with which they slip, from the joint's own
!> multipliers (theory.md, section 13). A pin presses by the size of its force, a slider by its normal force, a prismatic joint by
!> those of two pads, which also take its moment. A stop that yields presses by its force, which follows from the motion.
module friction_law
  use kinds, only: wp
  implicit none (type, external)
  private
  public :: force_of, pressure_of, slip_forces, sliding

  !> States: sticks; slips in the direction of its sign; at rest without sticking, as other rows carry it, with the static
  !> limit in the direction of its sign, or with no force; the stop that would press is open.
  integer, parameter, public :: row_stuck = 0, row_slips = 1, row_at_limit = 2, row_unloaded = 3, row_parted = 4
  integer, parameter, public :: on_pin = 1, on_line = 2, on_pads = 3, on_stop = 4   !! what presses
  integer, parameter, public :: most_pads = 2

  !> The law, and where the multipliers stand that it is about.
  type, public :: coulomb_law
    integer :: contact = on_pin
    real(wp) :: kinetic = 0.0_wp          !! coefficient of friction of surfaces that slip [-]
    real(wp) :: static = 0.0_wp           !! of surfaces that stick, not less [-]
    real(wp) :: preload = 0.0_wp          !! part of the limit without reaction, of surfaces that slip [N]; of a pin [N m]
    real(wp) :: static_preload = 0.0_wp   !! of surfaces that stick, not less [N]; of a pin [N m]
    real(wp) :: radius = 0.0_wp           !! of a pin [m]
    real(wp) :: distance = 0.0_wp         !! between two pads [m]
    real(wp) :: size = 1.0_wp             !! the scene's size, weight of angle rows [m]
    integer :: row = 0                    !! its tangential row
    integer :: first = 0, rows = 0        !! first row of its joint, how many it has
    integer :: number = 0                 !! among the elements that switch
    integer :: element = 0                !! of a stop: its number among the force elements
  contains
    procedure :: force_slope
    procedure :: limit
    procedure :: share
    procedure :: pads
    procedure :: pad_signs
    procedure :: normal_signs
  end type coulomb_law

contains

  !> The friction of all rows that are off, from the joints' multipliers.
  pure subroutine slip_forces(laws, states, lambda, pressed, f, strongest)
    type(coulomb_law), intent(in) :: laws(:)
    integer, intent(in) :: states(:)      !! of all elements that switch
    real(wp), intent(in), contiguous :: lambda(:)   !! multipliers of all rows [N]
    real(wp), intent(in), contiguous :: pressed(:)  !! (rows) force of the stop of a row [N]
    real(wp), intent(inout), contiguous :: f(:)     !! (rows) zero elsewhere [N]
    real(wp), intent(out) :: strongest    !! the largest [N]
    integer :: k
    strongest = 0.0_wp
    do k = 1, size(laws)
      associate (law => laws(k))
        f(law%row) = force_of(law, states(law%number), lambda, pressed(law%row))
        strongest = max(strongest, abs(f(law%row)))
      end associate
    end do
  end subroutine slip_forces

  !> The multiplier of its row where that is off. With the signs of the pads' normal forces at the last event, that of a joint that
  !> slips goes on beyond their zeros as before: a step ends there at an event.
  pure real(wp) function force_of(law, state, lambda, pressed, event_value) result(f)   ! [N]
    type(coulomb_law), intent(in) :: law
    integer, intent(in) :: state
    real(wp), intent(in) :: lambda(:)     !! multipliers of all rows [N]
    real(wp), intent(in) :: pressed       !! force of its stop [N]
    real(wp), intent(in), optional :: event_value   !! holds those signs [-]
    f = 0.0_wp
    if (abs(state) == row_slips) f = sign(1, state)*law%limit(.false., lambda, pressed)
    if (abs(state) == row_slips .and. present(event_value)) then
      f = f + sign(law%kinetic, real(state, wp))*sum(law%pads(lambda)*law%pad_signs(event_value) - abs(law%pads(lambda)))
    end if
    if (abs(state) == row_at_limit) f = sign(1, state)*law%limit(.true., lambda, pressed)
  end function force_of

  !> Derivatives of that force by the joint's multipliers; what they are 0 for is 0.
  pure function force_slope(self, state, lambda, event_value) result(d)
    class(coulomb_law), intent(in) :: self
    integer, intent(in) :: state
    real(wp), intent(in) :: lambda(:)     !! multipliers of all rows [N]
    real(wp), intent(in), optional :: event_value   !! as in `force_of` [-]
    real(wp) :: d(2)                      ! [-]
    real(wp) :: y(2), p(most_pads), mu
    d = 0.0_wp
    mu = 0.0_wp
    if (abs(state) == row_slips) mu = sign(self%kinetic, real(state, wp))
    if (abs(state) == row_at_limit) mu = sign(self%static, real(state, wp))
    if (self%contact == on_stop) return
    p = sign(1.0_wp, self%pads(lambda))
    if (present(event_value) .and. abs(state) == row_slips) p = self%pad_signs(event_value)
    y = 0.0_wp                            ! the joint's multipliers that press [N]
    y(:self%rows) = lambda(self%first:self%first + self%rows - 1)
    select case (self%contact)
    case (on_pin)
      if (norm2(y) > tiny(1.0_wp)) d = mu*self%radius/self%size*y/norm2(y)
    case (on_line)
      d(1) = p(1)*mu
    case default
      p = 0.5_wp*p*mu
      d = [p(1) + p(2), 2*self%size/self%distance*(p(1) - p(2))]
    end select
  end function force_slope

  !> Largest tangential force of surfaces that stick or slip; of a pin the moment over the size.
  pure real(wp) function limit(law, stick, lambda, pressed) result(c)   ! [N]
    class(coulomb_law), intent(in) :: law
    logical, intent(in) :: stick
    real(wp), intent(in) :: lambda(:)     !! multipliers of all rows [N]
    real(wp), intent(in) :: pressed       !! force of its stop [N]
    c = merge(law%static_preload, law%preload, stick)/merge(law%size, 1.0_wp, law%contact == on_pin) + &
        merge(law%static, law%kinetic, stick)*(pressure_of(law, lambda) + pressed)
  end function limit

  !> What the coefficient of friction multiplies of multipliers; of a pin times the radius over the size.
  pure real(wp) function pressure_of(law, lambda) result(pressure)   ! [N]
    type(coulomb_law), intent(in) :: law
    real(wp), intent(in) :: lambda(:)     !! multipliers of all rows [N]
    if (law%contact == on_pin) then
      pressure = law%radius/law%size*sqrt(lambda(law%first)**2 + lambda(law%first + 1)**2)
    else
      pressure = sum(abs(law%pads(lambda)))
    end if
  end function pressure_of

  !> Normal forces of the pads; a line has one, a pin or a stop none.
  pure function pads(self, lambda) result(n)
    class(coulomb_law), intent(in) :: self
    real(wp), intent(in) :: lambda(:)     !! multipliers of all rows [N]
    real(wp) :: n(most_pads)              ! [N]
    n = 0.0_wp
    if (self%contact == on_line) n(1) = lambda(self%first)
    if (self%contact == on_pads) n = 0.5_wp*lambda(self%first) + [1, -1]*self%size/self%distance*lambda(self%first + 1)
  end function pads

  !> Signs of the pads' normal forces while a row slips, kept as 0 to 3 as its event value.
  pure function pad_signs(self, event_value) result(s)
    class(coulomb_law), intent(in) :: self
    real(wp), intent(in) :: event_value   !! [-]
    real(wp) :: s(most_pads)              ! [-]
    s = 1.0_wp - 2*[mod(nint(event_value), 2), nint(event_value)/2]
  end function pad_signs

  !> The same from the multipliers.
  pure real(wp) function normal_signs(self, lambda) result(event_value)   ! [-]
    class(coulomb_law), intent(in) :: self
    real(wp), intent(in) :: lambda(:)     !! multipliers of all rows [N]
    event_value = dot_product([1, 2], merge(1, 0, self%pads(lambda) < 0.0_wp))
  end function normal_signs

  !> The direction in which a joint slides in a state, 0 at rest.
  elemental integer function sliding(state)
    integer, intent(in) :: state
    sliding = merge(sign(1, state), 0, abs(state) == row_slips)
  end function sliding

  !> Part of its limit that acts: 1 where it slips. A row at rest has no more, but an evaluation beside an event may.
  pure real(wp) function share(self, state, lambda, pressed)   ! [-]
    class(coulomb_law), intent(in) :: self
    integer, intent(in) :: state
    real(wp), intent(in) :: lambda(:)     !! multipliers of all rows [N]
    real(wp), intent(in) :: pressed       !! force of its stop [N]
    share = merge(1.0_wp, 0.0_wp, abs(lambda(self%row)) > 0.0_wp)
    if (abs(state) == row_slips) return
    associate (force => abs(lambda(self%row)))
      share = min(1.0_wp, force/max(self%limit(.true., lambda, pressed), tiny(1.0_wp)))   ! a stop may have just parted
    end associate
  end function share
end module friction_law
