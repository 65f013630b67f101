!> Acceleration of a point or of the angle of a section, against that of another marker. Where a body turns, that of the linear
!> response contains the turn of its axes.
module acceleration_sensor
  use kinds, only: wp
  use marker, only: turn
  use sensor, only: observation, sensor_model, harmonic_motion, marker_motion, vector_to_global
  implicit none (type, external)
  private

  !> Components of an acceleration in global axes.
  type, extends(sensor_model), public :: acceleration_sensor_model
    integer :: first = 1, last = 2            !! 1: x, 2: y, 3: angle
    integer :: against = 0                    !! number of the other marker among those of all sensors
  contains
    procedure :: read => read_acceleration
    procedure :: respond
  end type acceleration_sensor_model

contains

  !> The difference of both markers.
  subroutine read_acceleration(self, at, x)
    class(acceleration_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! [m/s2] or [rad/s2]
    real(wp) :: a(3)
    a = acceleration(at, self%number) - acceleration(at, self%against)
    x(1:self%last - self%first + 1) = a(self%first:self%last)
  end subroutine read_acceleration

  !> The same of amplitudes.
  subroutine respond(self, at, motion, x)
    class(acceleration_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    complex(wp), intent(inout) :: x(:)        !! [m/s2] or [rad/s2]
    complex(wp) :: a(3)
    a = amplitude(at, motion, self%number) - amplitude(at, motion, self%against)
    x(1:self%last - self%first + 1) = a(self%first:self%last)
  end subroutine respond

  !> Acceleration of a marker and of its section's angle; the ground has none.
  pure function acceleration(at, k) result(a)
    type(observation), intent(in) :: at
    integer, intent(in) :: k                  !! marker
    real(wp) :: a(3)                          !! [m/s2, rad/s2]
    a = 0.0_wp
    if (at%markers(k)%body == 0) return
    associate (b => at%markers(k)%body, i => at%m%s%qo(at%markers(k)%body), n => at%m%s%bodies(at%markers(k)%body)%nf)
      a = at%markers(k)%elastic(at%ev%a(i + 4:i + 3 + n))
      a(1:2) = at%ev%a(i + 1:i + 2) + at%p%bias(:, k) + at%ev%frame%to_global(b, a(1:2) + at%ev%a(i + 3)*turn(at%p%rho(:, k)))
      a(3) = a(3) + at%ev%a(i + 3)
    end associate
  end function acceleration

  !> Its amplitude: w'' + 2 theta' H w' + theta'' H w - theta'^2 w of the displacement w in body axes, turned into global ones.
  pure function amplitude(at, motion, k) result(a)
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    integer, intent(in) :: k                  !! marker
    complex(wp) :: a(3), w(3)                 !! [m/s2, rad/s2], [m, rad]
    real(wp) :: rate, change                  ! theta', theta'' [1/s], [1/s2]
    a = 0.0_wp
    if (at%markers(k)%body == 0) return
    associate (b => at%markers(k)%body, i => at%m%s%qo(at%markers(k)%body), s => motion%s)
      rate = at%y(at%m%s%nq + i + 3)
      change = at%ev%a(i + 3)
      w = marker_motion(at%m, at%markers(k), at%p%rho(:, k), motion%x)
      a = s**2*w
      a(1:2) = vector_to_global(at%ev, b, a(1:2) - rate**2*w(1:2) + (2*rate*s + change)*[-w(2), w(1)])
    end associate
  end function amplitude
end module acceleration_sensor
