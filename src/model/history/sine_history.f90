!> A sine about an offset.
module sine_history
  use kinds, only: wp
  use history, only: history_model
  implicit none (type, external)
  private

  !> offset + amplitude sin(omega t + phase)
  type, extends(history_model), public :: sine_model
    real(wp) :: offset = 0.0_wp         !! [unit]
    real(wp) :: amplitude = 0.0_wp      !! [unit]
    real(wp) :: omega = 0.0_wp          !! [rad/s]
    real(wp) :: phase = 0.0_wp          !! [rad]
  contains
    procedure :: evaluate => sine_value
    procedure :: antiderivative => sine_area
  end type sine_model

contains

  !> Value and two derivatives.
  pure subroutine sine_value(self, t, left_limit, h)
    class(sine_model), intent(in) :: self
    real(wp), intent(in) :: t           !! [s]
    logical, intent(in) :: left_limit   !! limit from below: the same
    real(wp), intent(out) :: h(0:2)     !! [unit, unit/s, unit/s2]
    real(wp) :: x
    x = self%omega*t + self%phase
    h(0) = self%offset + self%amplitude*sin(x)
    h(1) = self%amplitude*self%omega*cos(x)
    h(2) = -self%amplitude*self%omega**2*sin(x)
  end subroutine sine_value

  !> An antiderivative.
  pure function sine_area(self, t) result(f)
    class(sine_model), intent(in) :: self
    real(wp), intent(in) :: t           !! [s]
    real(wp) :: f                       !! [unit s]
    f = self%offset*t
    if (abs(self%omega) > 0.0_wp) then
      f = f - self%amplitude/self%omega*cos(self%omega*t + self%phase)
    else
      f = f + self%amplitude*sin(self%phase)*t
    end if
  end function sine_area
end module sine_history
