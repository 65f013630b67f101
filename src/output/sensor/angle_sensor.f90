!> Angular acceleration of a section or frame.
module angle_sensor
  use kinds, only: wp
  use sensor, only: observation, sensor_model, harmonic_motion, marker_motion
  implicit none (type, external)
  private

  !> An angular acceleration.
  type, extends(sensor_model), public :: angle_sensor_model
  contains
    procedure :: read => read_angle
    procedure :: respond
  end type angle_sensor_model

contains

  !> Of the frame and the elastic rotation together.
  subroutine read_angle(self, at, x)
    class(angle_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! [rad/s2]
    real(wp) :: u(3)
    u = self%elastic_part(at%m, at%ev%a)
    x(1) = u(3)
    if (self%marker%body > 0) x(1) = x(1) + at%ev%a(at%m%s%qo(self%marker%body) + 3)
  end subroutine read_angle

  !> A rotation in the plane is the same in all axes.
  subroutine respond(self, at, motion, x)
    class(angle_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    complex(wp), intent(inout) :: x(:)        !! [rad/s2]
    complex(wp) :: w(3)
    w = marker_motion(at%m, self%marker, at%p%rho(:, self%number), motion%x)
    x(1) = w(3)*motion%s**2
  end subroutine respond
end module angle_sensor
