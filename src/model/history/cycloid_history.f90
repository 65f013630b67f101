!> A rise by a cycloid.
module cycloid_history
  use kinds, only: wp, pi
  use rise_history, only: rise_model
  implicit none (type, external)
  private

  !> s - sin(2 pi s)/(2 pi)
  type, extends(rise_model), public :: cycloid_model
  contains
    procedure, nopass :: shape => cycloid
  end type cycloid_model

contains

  !> Integral, value and two derivatives.
  pure subroutine cycloid(s, f)
    real(wp), intent(in) :: s           !! from 0 to 1 [-]
    real(wp), intent(out) :: f(-1:2)    !! [-]
    f(-1) = s**2/2 + (cos(2*pi*s) - 1)/(4*pi**2)
    f(0) = s - sin(2*pi*s)/(2*pi)
    f(1) = 1 - cos(2*pi*s)
    f(2) = 2*pi*sin(2*pi*s)
  end subroutine cycloid
end module cycloid_history
