!> A rise by a polynomial of degree five.
module ramp_history
  use kinds, only: wp
  use rise_history, only: rise_model
  implicit none (type, external)
  private

  !> 10 s3 - 15 s4 + 6 s5
  type, extends(rise_model), public :: ramp_model
  contains
    procedure, nopass :: shape => quintic
  end type ramp_model

contains

  !> Integral, value and two derivatives.
  pure subroutine quintic(s, f)
    real(wp), intent(in) :: s           !! from 0 to 1 [-]
    real(wp), intent(out) :: f(-1:2)    !! [-]
    f(-1) = s**4*(2.5_wp + s*(s - 3))
    f(0) = s**3*(10 + s*(6*s - 15))
    f(1) = 30*s**2*(1 + s*(s - 2))
    f(2) = 60*s*(1 + s*(2*s - 3))
  end subroutine quintic
end module ramp_history
