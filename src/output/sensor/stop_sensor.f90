!> Force, gap and state of a stop.
module stop_sensor
  use kinds, only: wp
  use evaluation_results, only: conditions_of
  use force_element, only: conditions
  use sensor, only: observation, sensor_model, harmonic_motion, scene_motion
  use stops, only: stop_contact, stop_model, stop_touching
  implicit none (type, external)
  private

  !> A stop's force.
  type, extends(sensor_model), public :: stop_sensor_model
    integer :: element = 0                    !! its number among the force elements
  contains
    procedure :: read => read_stop
    procedure :: respond
  end type stop_sensor_model

contains

  !> The force with which it pushes, what is left to the nearest limit (negative: penetration), its state.
  subroutine read_stop(self, at, x)
    class(stop_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! [N], [m], [-] or [N m], [rad], [-]
    type(stop_contact) :: c
    type(conditions) :: with
    select type (f => at%m%s%forces(self%element)%item)
    class is (stop_model)
      with = conditions_of(at%m, at%ev, self%element)
      call f%contact(at%ev%p, with, c)
      x(1) = at%ev%action(self%element)%force
      if (f%rigid .and. abs(c%state) == stop_touching) x(1) = f%pressing(with)
      x(2) = -c%depth
      x(3) = c%state
    end select
  end subroutine read_stop

  !> With stiffness and damping where it touches.
  subroutine respond(self, at, motion, x)
    class(stop_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    complex(wp), intent(inout) :: x(:)        !! [N], [m], [-] or [N m], [rad], [-]
    type(stop_contact) :: c
    type(conditions) :: with
    real(wp) :: stiffness, damping, turning(6)
    complex(wp) :: u(6), depth                ! [m], [rad]
    select type (f => at%m%s%forces(self%element)%item)
    class is (stop_model)
      with = conditions_of(at%m, at%ev, self%element)
      call f%contact(at%ev%p, with, c)
      call f%slopes(at%ev%p, with, c, stiffness, damping, turning)
      u(1:3) = scene_motion(at%m, at%ev, f%ia, motion%x)
      u(4:6) = scene_motion(at%m, at%ev, f%ib, motion%x)
      depth = sum(c%g*u)
      x(1) = stiffness*depth + damping*(motion%s*depth + sum(turning*u))
      x(2) = -depth
      x(3) = 0.0_wp
    end select
  end subroutine respond
end module stop_sensor
