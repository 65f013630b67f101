!> Output and error of a controller, and whether its output is at a limit.
module controller_sensor
  use kinds, only: wp
  use controller, only: free
  use sensor, only: observation, sensor_model, harmonic_motion, quantity_amplitude
  implicit none (type, external)
  private

  !> Quantity, output and reference of a controller.
  type, extends(sensor_model), public :: controller_sensor_model
    integer :: controller = 0                 !! its number
  contains
    procedure :: read => read_controller
    procedure :: respond
  end type controller_sensor_model

contains

  !> As evaluated.
  subroutine read_controller(self, at, x)
    class(controller_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! [any], [m, rad, or per second], [-]
    associate (c => at%ev%control(self%controller))
      x(1:3) = [c%output, c%error, real(c%limited, wp)]
    end associate
  end subroutine read_controller

  !> By its transfer function without limits.
  subroutine respond(self, at, motion, x)
    class(controller_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    complex(wp), intent(inout) :: x(:)        !! [any], [m, rad, or per second], [-]
    complex(wp) :: sensed                     ! [m, rad, or per second]
    associate (c => at%m%s%controllers(self%controller))
      sensed = quantity_amplitude(at, motion, c%quantity, at%m%s%markers, at%ev%p)
      x(1) = c%response(free, motion%s)*sensed
      x(2) = -c%delayed(motion%s)*sensed
      x(3) = 0.0_wp
    end associate
  end subroutine respond
end module controller_sensor
