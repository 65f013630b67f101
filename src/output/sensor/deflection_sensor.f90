!> Elastic displacement and rotation of a node, in the axes of its body.
module deflection_sensor
  use kinds, only: wp
  use mechanism, only: mechanism_model
  use sensor, only: observation, sensor_model, harmonic_motion, elastic_motion, suffix_length
  implicit none (type, external)
  private

  !> A node's deflection.
  type, extends(sensor_model), public :: deflection_sensor_model
  contains
    procedure :: columns
    procedure :: read => read_deflection
    procedure :: respond
  end type deflection_sensor_model

contains

  !> Two displacements and a rotation.
  subroutine columns(self, m, list)
    class(deflection_sensor_model), intent(in) :: self
    type(mechanism_model), intent(in) :: m
    character(suffix_length), allocatable, intent(out) :: list(:)
    list = [character(suffix_length) :: '.u[m]', '.v[m]', '.r[rad]']
  end subroutine columns

  !> From the elastic coordinates.
  subroutine read_deflection(self, at, x)
    class(deflection_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! [m], [m], [rad]
    x(1:3) = self%elastic_part(at%m, at%y)
  end subroutine read_deflection

  !> Linear in them.
  subroutine respond(self, at, motion, x)
    class(deflection_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    complex(wp), intent(inout) :: x(:)        !! [m], [m], [rad]
    x(1:3) = elastic_motion(at%m, self%marker, motion%x)
  end subroutine respond
end module deflection_sensor
