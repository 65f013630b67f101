!> The elastic motion of a body in its own axes: displacement and rotation of a node, a coordinate with its derivatives.
module elastic_sensors
  use kinds, only: wp
  use sensor, only: observation, sensor_model, harmonic_motion, elastic_motion
  implicit none (type, external)
  private

  !> A node's deflection.
  type, extends(sensor_model), public :: deflection_sensor_model
  contains
    procedure :: read => read_deflection
    procedure :: respond => deflection_amplitude
  end type deflection_sensor_model

  !> One coordinate.
  type, extends(sensor_model), public :: coordinate_sensor_model
    integer :: index = 0                      !! its number among those of the body
  contains
    procedure :: read => read_coordinate
    procedure :: respond => coordinate_amplitude
  end type coordinate_sensor_model

contains

  !> From the elastic coordinates.
  subroutine read_deflection(self, at, x)
    class(deflection_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! [m], [m], [rad]
    associate (i => at%m%s%qo(self%marker%body) + 3, n => at%m%s%bodies(self%marker%body)%nf)
      x(1:3) = self%marker%elastic(at%y(i + 1:i + n))
    end associate
  end subroutine read_deflection

  !> The same of amplitudes.
  subroutine deflection_amplitude(self, at, motion, x)
    class(deflection_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    complex(wp), intent(inout) :: x(:)        !! [m], [m], [rad]
    x(1:3) = elastic_motion(at%m, self%marker, motion%x)
  end subroutine deflection_amplitude

  !> Coordinate and rate from the state, acceleration from the evaluation.
  subroutine read_coordinate(self, at, x)
    class(coordinate_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! [m, rad] and per second
    associate (i => at%m%s%qo(self%marker%body) + 3 + self%index)
      x(1:3) = [at%y(i), at%y(at%m%s%nq + i), at%ev%a(i)]
    end associate
  end subroutine read_coordinate

  !> The unknown of the linearisation and its derivatives.
  subroutine coordinate_amplitude(self, at, motion, x)
    class(coordinate_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    complex(wp), intent(inout) :: x(:)        !! [m, rad] and per second
    x(1:3) = motion%x(at%m%s%qo(self%marker%body) + 3 + self%index)*motion%s**[0, 1, 2]
  end subroutine coordinate_amplitude
end module elastic_sensors
