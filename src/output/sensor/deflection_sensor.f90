!> Elastic displacement and rotation of a node, in the axes of its body.
module deflection_sensor
  use kinds, only: wp
  use sensor, only: observation, sensor_model, harmonic_motion, elastic_motion
  implicit none (type, external)
  private

  !> A node's deflection.
  type, extends(sensor_model), public :: deflection_sensor_model
  contains
    procedure :: read => read_deflection
    procedure :: respond
  end type deflection_sensor_model

contains

  !> From the elastic coordinates.
  subroutine read_deflection(self, at, x)
    class(deflection_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! [m], [m], [rad]
    x(1:3) = self%elastic_part(at%m, at%y)
  end subroutine read_deflection

  !> The same, of the unknowns of the linearisation.
  subroutine respond(self, at, motion, x)
    class(deflection_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    complex(wp), intent(inout) :: x(:)        !! [m], [m], [rad]
    x(1:3) = elastic_motion(at%m, self%marker, motion%x)
  end subroutine respond
end module deflection_sensor
