!> Force and deformation of a spring.
module spring_sensor
  use kinds, only: wp
  use evaluation_results, only: conditions_of
  use sensor, only: observation, sensor_model, harmonic_motion, scene_motion
  use springs, only: spring_model
  implicit none (type, external)
  private

  !> A spring's force.
  type, extends(sensor_model), public :: spring_sensor_model
    integer :: element = 0                    !! its number among the force elements
  contains
    procedure :: read => read_spring
    procedure :: respond
  end type spring_sensor_model

contains

  !> As evaluated.
  subroutine read_spring(self, at, x)
    class(spring_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! [N], [m] or [N m], [rad]
    real(wp) :: rate, e(3)
    x(1) = at%ev%action(self%element)%force
    associate (f => at%m%s%forces(self%element)%item)
      call f%deformation(at%ev%p, x(2), rate, e)
      x(2) = x(2) - f%unprestressed(at%ev%options%prestress)
    end associate
  end subroutine read_spring

  !> With its stiffness at s.
  subroutine respond(self, at, motion, x)
    class(spring_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    complex(wp), intent(inout) :: x(:)        !! [N], [m] or [N m], [rad]
    real(wp) :: d, rate, e(3), stiffness
    associate (f => at%m%s%forces(self%element)%item)
      call f%deformation(at%ev%p, d, rate, e)
      x(2) = sum(e*(scene_motion(at%m, at%ev, f%ia, motion%x) - scene_motion(at%m, at%ev, f%ib, motion%x)))
      stiffness = f%stiffness
      select type (f)
      class is (spring_model)
        stiffness = f%present_stiffness(conditions_of(at%m, at%ev, self%element), d)
      end select
      x(1) = (stiffness*(1 + f%law%ratio(motion%s)) + motion%s*f%damping)*x(2)
    end associate
  end subroutine respond
end module spring_sensor
