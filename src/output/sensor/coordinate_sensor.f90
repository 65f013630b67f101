!> An elastic coordinate of a body with its rate and acceleration.
module coordinate_sensor
  use kinds, only: wp
  use sensor, only: observation, sensor_model, harmonic_motion
  implicit none (type, external)
  private

  !> One coordinate.
  type, extends(sensor_model), public :: coordinate_sensor_model
    integer :: index = 0                      !! number of the coordinate of the body
  contains
    procedure :: read => read_coordinate
    procedure :: respond
  end type coordinate_sensor_model

contains

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
  subroutine respond(self, at, motion, x)
    class(coordinate_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    complex(wp), intent(inout) :: x(:)        !! [m, rad] and per second
    x(1:3) = motion%x(at%m%s%qo(self%marker%body) + 3 + self%index)*motion%s**[0, 1, 2]
  end subroutine respond
end module coordinate_sensor
