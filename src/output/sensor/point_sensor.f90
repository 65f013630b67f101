!> Position, velocity or acceleration of a material point, global axes. Where a body turns, velocities and accelerations of the
!> linear response contain the turn of its axes.
module point_sensor
  use kinds, only: wp
  use marker, only: turn
  use sensor, only: observation, sensor_model, harmonic_motion, marker_motion, vector_to_global
  implicit none (type, external)
  private

  !> A point's motion.
  type, extends(sensor_model), public :: point_sensor_model
    integer :: order = 0                      !! derivative: 0 position, 1 velocity, 2 acceleration
  contains
    procedure :: read => read_point
    procedure :: respond
  end type point_sensor_model

contains

  !> At the present position of the point.
  subroutine read_point(self, at, x)
    class(point_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! [m], [m/s] or [m/s2]
    real(wp) :: u(3)
    integer :: i
    x(1:2) = 0.0_wp
    if (self%order == 0) x(1:2) = at%p%r(:, self%number)
    if (self%order == 1) x(1:2) = at%p%v(:, self%number)
    if (self%order < 2 .or. self%marker%body == 0) return
    associate (b => self%marker%body)
      i = at%m%s%qo(b)
      u = self%elastic_part(at%m, at%ev%a)
      u(1:2) = u(1:2) + at%ev%a(i + 3)*turn(at%p%rho(:, self%number))
      x(1:2) = at%ev%a(i + 1:i + 2) + at%p%bias(:, self%number) + at%ev%frame%to_global(b, u(1:2))
    end associate
  end subroutine read_point

  !> w, its rate w' + theta' H w, or w'' + 2 theta' H w' + theta'' H w - theta'^2 w.
  subroutine respond(self, at, motion, x)
    class(point_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    complex(wp), intent(inout) :: x(:)        !! [m], [m/s] or [m/s2]
    complex(wp) :: w(3), turned(2)
    real(wp) :: rate, change                  ! theta', theta'' [1/s], [1/s2]
    w = marker_motion(at%m, self%marker, at%p%rho(:, self%number), motion%x)
    turned = [-w(2), w(1)]
    rate = 0.0_wp
    change = 0.0_wp
    associate (b => self%marker%body, s => motion%s)
      if (b > 0) rate = at%y(at%m%s%nq + at%m%s%qo(b) + 3)
      if (b > 0) change = at%ev%a(at%m%s%qo(b) + 3)
      select case (self%order)
      case (0)
        x(1:2) = w(1:2)
      case (1)
        x(1:2) = s*w(1:2) + rate*turned
      case default
        x(1:2) = s**2*w(1:2) + (2*rate*s + change)*turned - rate**2*w(1:2)
      end select
      x(1:2) = vector_to_global(at%ev, b, x(1:2))
    end associate
  end subroutine respond
end module point_sensor
