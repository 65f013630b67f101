!> Elastic displacement and rotation of a node, in the axes of its body.
module deflection_sensor
  use kinds, only: wp
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  use marker, only: marker_states
  use sensor, only: sensor_model, elastic_motion, suffix_length
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
  subroutine read_deflection(self, m, ev, p, q, v, z, x)
    class(deflection_sensor_model), intent(in) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: q(:), v(:)        !! (nq) [m, rad] and per second
    real(wp), intent(in) :: z(:)              !! (nz) [m, rad]
    real(wp), intent(inout) :: x(:)           !! [m], [m], [rad]
    x(1:3) = self%elastic_part(m, q)
  end subroutine read_deflection

  !> Linear in them.
  subroutine respond(self, m, ev, w, q, v, s, x, lambda, y)
    class(deflection_sensor_model), intent(in) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    complex(wp), intent(in) :: w(3)           !! [m, rad]
    real(wp), intent(in) :: q(:), v(:)        !! (nq) [m, rad] and per second
    complex(wp), intent(in) :: s              !! [1/s]
    complex(wp), intent(in) :: x(:)           !! (nq) [m, rad]
    complex(wp), intent(in) :: lambda(:)      !! (rows) [N]
    complex(wp), intent(inout) :: y(:)        !! [m], [m], [rad]
    y(1:3) = elastic_motion(m, self%marker, x)
  end subroutine respond
end module deflection_sensor
