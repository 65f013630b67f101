!> Power that a drive, force or spring puts into the mechanism, or that a joint passes to its body a.
module power_sensor
  use evaluation_results, only: power_of
  use kinds, only: wp
  use scene_model, only: power_source
  use sensor, only: nonlinear_sensor, observation
  implicit none (type, external)
  private

  !> A power.
  type, extends(nonlinear_sensor), public :: power_sensor_model
    type(power_source) :: source
  contains
    procedure :: read => read_power
  end type power_sensor_model

contains

  !> As evaluated.
  subroutine read_power(self, at, x)
    class(power_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! [W]
    x(1) = power_of(at%m, at%ev, self%source)
  end subroutine read_power
end module power_sensor
