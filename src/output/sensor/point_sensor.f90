!> Acceleration of a material point, global axes. Where a body turns, that of the linear response contains the turn of its axes.
module point_sensor
  use kinds, only: wp
  use marker, only: turn
  use sensor, only: observation, sensor_model, harmonic_motion, marker_motion, vector_to_global
  implicit none (type, external)
  private

  !> A point's acceleration.
  type, extends(sensor_model), public :: point_sensor_model
  contains
    procedure :: read => read_point
    procedure :: respond
  end type point_sensor_model

contains

  !> At the present position of the point.
  subroutine read_point(self, at, x)
    class(point_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! [m/s2]
    real(wp) :: u(3)
    integer :: i
    x(1:2) = 0.0_wp
    if (self%marker%body == 0) return
    associate (b => self%marker%body)
      i = at%m%s%qo(b)
      u = self%elastic_part(at%m, at%ev%a)
      u(1:2) = u(1:2) + at%ev%a(i + 3)*turn(at%p%rho(:, self%number))
      x(1:2) = at%ev%a(i + 1:i + 2) + at%p%bias(:, self%number) + at%ev%frame%to_global(b, u(1:2))
    end associate
  end subroutine read_point

  !> w'' + 2 theta' H w' + theta'' H w - theta'^2 w.
  subroutine respond(self, at, motion, x)
    class(point_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    complex(wp), intent(inout) :: x(:)        !! [m/s2]
    complex(wp) :: w(3), turned(2)
    real(wp) :: rate, change                  ! theta', theta'' [1/s], [1/s2]
    w = marker_motion(at%m, self%marker, at%p%rho(:, self%number), motion%x)
    turned = [-w(2), w(1)]
    rate = 0.0_wp
    change = 0.0_wp
    associate (b => self%marker%body, s => motion%s)
      if (b > 0) rate = at%y(at%m%s%nq + at%m%s%qo(b) + 3)
      if (b > 0) change = at%ev%a(at%m%s%qo(b) + 3)
      x(1:2) = (s**2 - rate**2)*w(1:2) + (2*rate*s + change)*turned
      x(1:2) = vector_to_global(at%ev, b, x(1:2))
    end associate
  end subroutine respond
end module point_sensor
