!> Coulomb's law of a joint: up to which tangential force its surfaces stick, and with which they slip, from the joint's own
!> multipliers (theory.md, section 13). A pin presses by the size of its force, a slider by its normal force, a prismatic joint by
!> those of two pads, which also take its moment.
module friction_law
  use kinds, only: wp
  implicit none (type, external)
  private

  integer, parameter, public :: on_pin = 1, on_line = 2, on_pads = 3   !! what presses
  integer, parameter, public :: most_pads = 2

  !> The law.
  type, public :: coulomb_law
    integer :: contact = on_pin
    real(wp) :: kinetic = 0.0_wp          !! coefficient of friction of surfaces that slip [-]
    real(wp) :: static = 0.0_wp           !! of surfaces that stick, not less [-]
    real(wp) :: preload = 0.0_wp          !! part of the limit without reaction [N]; of a pin [N m]
    real(wp) :: radius = 0.0_wp           !! of a pin [m]
    real(wp) :: distance = 0.0_wp         !! between two pads [m]
  contains
    procedure :: limit
    procedure :: slope
    procedure :: pads
    procedure :: pressure
  end type coulomb_law

contains

  !> Largest tangential force of the joint's multipliers; of a pin the moment over the size.
  pure real(wp) function limit(self, size_s, lambda, sticks) result(c)   ! [N]
    class(coulomb_law), intent(in) :: self
    real(wp), intent(in) :: size_s        !! the scene's size, weight of angle rows [m]
    real(wp), intent(in) :: lambda(:)     !! multipliers of the joint [N]
    logical, intent(in) :: sticks         !! the static limit
    c = self%preload + merge(self%static, self%kinetic, sticks)*self%pressure(size_s, lambda)
    if (self%contact == on_pin) c = c/size_s
  end function limit

  !> What the coefficient of friction multiplies.
  pure real(wp) function pressure(self, size_s, lambda)   ! [N]; of a pin [N m]
    class(coulomb_law), intent(in) :: self
    real(wp), intent(in) :: size_s        !! [m]
    real(wp), intent(in) :: lambda(:)     !! [N]
    if (self%contact == on_pin) then
      pressure = self%radius*sqrt(lambda(1)**2 + lambda(2)**2)
    else
      pressure = sum(abs(self%pads(size_s, lambda)))
    end if
  end function pressure

  !> Derivatives of the limit by the joint's multipliers.
  pure function slope(self, size_s, lambda, sticks) result(d)
    class(coulomb_law), intent(in) :: self
    real(wp), intent(in) :: size_s        !! [m]
    real(wp), intent(in) :: lambda(:)     !! [N]
    logical, intent(in) :: sticks
    real(wp) :: d(size(lambda))           ! [-]
    real(wp) :: p(most_pads), mu
    d = 0.0_wp
    mu = merge(self%static, self%kinetic, sticks)
    select case (self%contact)
    case (on_pin)
      if (any(abs(lambda(1:2)) > 0.0_wp)) d(1:2) = mu*self%radius/size_s*lambda(1:2)/norm2(lambda(1:2))
    case (on_line)
      d(1) = sign(mu, lambda(1))
    case default
      p = sign(0.5_wp*mu, self%pads(size_s, lambda))
      d(1:2) = [p(1) + p(2), 2*size_s/self%distance*(p(1) - p(2))]
    end select
  end function slope

  !> Normal forces of the pads; a line has one, a pin none.
  pure function pads(self, size_s, lambda) result(n)
    class(coulomb_law), intent(in) :: self
    real(wp), intent(in) :: size_s        !! [m]
    real(wp), intent(in) :: lambda(:)     !! [N]
    real(wp) :: n(most_pads)              ! [N]
    n = 0.0_wp
    if (self%contact == on_line) n(1) = lambda(1)
    if (self%contact == on_pads) n = 0.5_wp*lambda(1) + [1, -1]*size_s/self%distance*lambda(2)
  end function pads
end module friction_law
