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
  end type sine_model

contains

  !> At frequency 0 a constant.
  pure subroutine sine_value(self, t, left_limit, h)
    class(sine_model), intent(in) :: self
    real(wp), intent(in) :: t           !! [s]
    logical, intent(in) :: left_limit   !! limit from below: the same
    real(wp), intent(out) :: h(-1:2)    !! [unit s, unit, unit/s, unit/s2]
    real(wp) :: x
    x = self%omega*t + self%phase
    h(-1) = self%offset*t
    if (abs(self%omega) > 0.0_wp) then
      h(-1) = h(-1) - self%amplitude/self%omega*cos(x)
    else
      h(-1) = h(-1) + self%amplitude*sin(self%phase)*t
    end if
    h(0) = self%offset + self%amplitude*sin(x)
    h(1) = self%amplitude*self%omega*cos(x)
    h(2) = -self%amplitude*self%omega**2*sin(x)
  end subroutine sine_value
end module sine_history
