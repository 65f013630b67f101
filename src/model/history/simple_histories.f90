!> Histories of few numbers: polynomial, sine, pulse, and smooth rises from one value to another (ramp, cycloid), of which each
!> says its shape.
module simple_histories
  use kinds, only: wp, pi
  use history, only: history_model, reached
  implicit none (type, external)
  private

  !> c0 + c1 t + c2 t2 + ...
  type, extends(history_model), public :: polynomial_model
    real(wp), allocatable :: c(:)       !! coefficients [unit/s^k]
  contains
    procedure :: evaluate => polynomial_value
  end type polynomial_model

  !> offset + amplitude sin(omega t + phase)
  type, extends(history_model), public :: sine_model
    real(wp) :: offset = 0.0_wp         !! [unit]
    real(wp) :: amplitude = 0.0_wp      !! [unit]
    real(wp) :: omega = 0.0_wp          !! [rad/s]
    real(wp) :: phase = 0.0_wp          !! [rad]
  contains
    procedure :: evaluate => sine_value
    procedure :: steepest => sine_slope
  end type sine_model

  !> The value from start until finish.
  type, extends(history_model), public :: pulse_model
    real(wp) :: value = 0.0_wp          !! [unit]
    real(wp) :: start = 0.0_wp          !! [s]
    real(wp) :: finish = 0.0_wp         !! [s]
  contains
    procedure :: evaluate => pulse_value
  end type pulse_model

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

  !> 10 s3 - 15 s4 + 6 s5
  type, extends(rise_model), public :: ramp_model
  contains
    procedure, nopass :: shape => quintic
  end type ramp_model

  !> s - sin(2 pi s)/(2 pi)
  type, extends(rise_model), public :: cycloid_model
  contains
    procedure, nopass :: shape => cycloid
  end type cycloid_model

contains

  !> Horner's scheme.
  pure subroutine polynomial_value(self, t, left_limit, h)
    class(polynomial_model), intent(in) :: self
    real(wp), intent(in) :: t           !! [s]
    logical, intent(in) :: left_limit   !! limit from below: the same
    real(wp), intent(out) :: h(-1:2)    !! [unit s, unit, unit/s, unit/s2]
    integer :: k
    h = 0.0_wp
    do k = size(self%c), 1, -1
      h(2) = h(2)*t + 2*h(1)
      h(1) = h(1)*t + h(0)
      h(0) = h(0)*t + self%c(k)
      h(-1) = h(-1)*t + self%c(k)/k
    end do
    h(-1) = h(-1)*t
  end subroutine polynomial_value

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

  !> Where it passes its offset.
  pure recursive real(wp) function sine_slope(self) result(slope)   ! [unit/s]
    class(sine_model), intent(in) :: self
    slope = abs(self%amplitude*self%omega)
  end function sine_slope

  !> The derivatives are zero on both sides of the jumps.
  pure subroutine pulse_value(self, t, left_limit, h)
    class(pulse_model), intent(in) :: self
    real(wp), intent(in) :: t           !! [s]
    logical, intent(in) :: left_limit   !! limit from below
    real(wp), intent(out) :: h(-1:2)    !! [unit s, unit, unit/s, unit/s2]
    h = 0.0_wp
    h(-1) = self%value*(min(max(t, self%start), self%finish) - self%start)
    if (reached(t, self%start, left_limit) .and. .not. reached(t, self%finish, left_limit)) h(0) = self%value
  end subroutine pulse_value

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

  !> Integral, value and two derivatives.
  pure subroutine quintic(s, f)
    real(wp), intent(in) :: s           !! from 0 to 1 [-]
    real(wp), intent(out) :: f(-1:2)    !! [-]
    f(-1) = s**4*(2.5_wp + s*(s - 3))
    f(0) = s**3*(10 + s*(6*s - 15))
    f(1) = 30*s**2*(1 + s*(s - 2))
    f(2) = 60*s*(1 + s*(2*s - 3))
  end subroutine quintic

  !> Integral, value and two derivatives.
  pure subroutine cycloid(s, f)
    real(wp), intent(in) :: s           !! from 0 to 1 [-]
    real(wp), intent(out) :: f(-1:2)    !! [-]
    f(-1) = s**2/2 + (cos(2*pi*s) - 1)/(4*pi**2)
    f(0) = s - sin(2*pi*s)/(2*pi)
    f(1) = 1 - cos(2*pi*s)
    f(2) = 2*pi*sin(2*pi*s)
  end subroutine cycloid
end module simple_histories
