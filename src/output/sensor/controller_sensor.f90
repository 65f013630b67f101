!> Output and error of a controller, and whether its output is at a limit.
module controller_sensor
  use kinds, only: wp
  use controller, only: free
  use sensor, only: observation, sensor_model, harmonic_motion, marker_moves
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
    complex(wp) :: place(6), rate(6)          ! of both markers [m, rad], [m/s, rad/s]
    real(wp) :: by_place(6), by_rate(6)       ! [-], [m], [1/s]
    associate (c => at%m%s%controllers(self%controller), q => at%m%s%controllers(self%controller)%quantity)
      call q%gradient(at%ev%p, by_place, by_rate)
      call marker_moves(at, motion, at%m%s%markers(q%ia), at%ev%p, q%ia, place(1:3), rate(1:3))
      call marker_moves(at, motion, at%m%s%markers(q%ib), at%ev%p, q%ib, place(4:6), rate(4:6))
      sensed = sum(by_place*place) + sum(by_rate*rate)
      x(1) = c%response(free, motion%s)*sensed
      x(2) = -c%delayed(motion%s)*sensed
      x(3) = 0.0_wp
    end associate
  end subroutine respond
end module controller_sensor
