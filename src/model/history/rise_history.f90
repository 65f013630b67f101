!> A smooth rise from one value to another: what ramp and cycloid have in common. Their shapes differ.
module rise_history
  use kinds, only: wp
  use history, only: history_model
  implicit none (type, external)
  private

  !> Constant before start and after finish.
  type, abstract, extends(history_model), public :: rise_model
    real(wp) :: low = 0.0_wp            !! value before [unit]
    real(wp) :: high = 0.0_wp           !! value after [unit]
    real(wp) :: start = 0.0_wp          !! [s]
    real(wp) :: finish = 1.0_wp         !! [s]
  contains
    procedure(shape_of_rise), deferred, nopass :: shape
    procedure :: evaluate => rise_value
  end type rise_model

  abstract interface
    !> From (0, 0) to (1, 1): the integral from 0, the value, two derivatives.
    pure subroutine shape_of_rise(s, f)
      import :: wp
      real(wp), intent(in) :: s         !! from 0 to 1 [-]
      real(wp), intent(out) :: f(-1:2)  !! [-]
    end subroutine shape_of_rise
  end interface

contains

  !> Value and first two derivatives are continuous.
  pure subroutine rise_value(self, t, left_limit, h)
    class(rise_model), intent(in) :: self
    real(wp), intent(in) :: t           !! [s]
    logical, intent(in) :: left_limit   !! limit from below: the same
    real(wp), intent(out) :: h(-1:2)    !! [unit s, unit, unit/s, unit/s2]
    real(wp) :: f(-1:2), width
    width = self%finish - self%start
    call self%shape(min(max((t - self%start)/width, 0.0_wp), 1.0_wp), f)
    h = (self%high - self%low)*[width*f(-1) + max(t - self%finish, 0.0_wp), f(0), f(1)/width, f(2)/width**2]
    h(-1:0) = h(-1:0) + self%low*[t - self%start, 1.0_wp]
    if (t >= self%finish) h(0:2) = [self%high, 0.0_wp, 0.0_wp]
  end subroutine rise_value
end module rise_history
