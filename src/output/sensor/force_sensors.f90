!> Forces of springs and stops along what they resist.
module force_sensors
  use kinds, only: wp
  use evaluation_results, only: conditions_of
  use force_element, only: conditions
  use measure, only: measured
  use sensor, only: observation, sensor_model, harmonic_motion, pair_motion
  use springs, only: spring_model
  use stops, only: stop_contact, stop_model, stop_touching
  implicit none (type, external)
  private

  !> A spring's force and deformation.
  type, extends(sensor_model), public :: spring_sensor_model
    integer :: element = 0                    !! its number among the force elements
  contains
    procedure :: read => read_spring
    procedure :: respond => spring_amplitude
  end type spring_sensor_model

  !> The force with which a stop pushes, its gap to the nearest limit (negative: penetration), its state.
  type, extends(sensor_model), public :: stop_sensor_model
    integer :: element = 0                    !! its number among the force elements
  contains
    procedure :: read => read_stop
    procedure :: respond => stop_amplitude
  end type stop_sensor_model

contains

  !> As evaluated.
  subroutine read_spring(self, at, x)
    class(spring_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! [N], [m] or [N m], [rad]
    type(measured) :: now
    x(1:2) = [at%ev%action(self%element)%force, 0.0_wp]
    select type (f => at%m%s%forces(self%element)%item)
    class is (spring_model)
      now = f%deformation(at%ev%p)
      x(2) = now%x - f%unprestressed(at%ev%options%prestress)
    end select
  end subroutine read_spring

  !> With its stiffness at s.
  subroutine spring_amplitude(self, at, motion, x)
    class(spring_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    complex(wp), intent(inout) :: x(:)        !! [N], [m] or [N m], [rad]
    type(measured) :: now
    real(wp) :: stiffness
    select type (f => at%m%s%forces(self%element)%item)
    class is (spring_model)
      now = f%deformation(at%ev%p)
      stiffness = f%present_stiffness(conditions_of(at%m, at%ev, self%element), now%x)
      x(2) = sum(now%g*pair_motion(at, f%ia, f%ib, motion%x))
      x(1) = (stiffness*(1 + f%law%ratio(motion%s)) + motion%s*f%damping)*x(2)
    end select
  end subroutine spring_amplitude

  !> As evaluated.
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
      if (f%rigid .and. abs(c%state) == stop_touching) x(1) = f%row_force(with)
      x(2) = -c%depth
      x(3) = c%state
    end select
  end subroutine read_stop

  !> With stiffness and damping where it touches.
  subroutine stop_amplitude(self, at, motion, x)
    class(stop_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    complex(wp), intent(inout) :: x(:)        !! [N], [m], [-] or [N m], [rad], [-]
    type(stop_contact) :: c
    type(conditions) :: with
    real(wp) :: stiffness, damping
    complex(wp) :: u(6), depth                ! [m], [rad]
    select type (f => at%m%s%forces(self%element)%item)
    class is (stop_model)
      with = conditions_of(at%m, at%ev, self%element)
      call f%contact(at%ev%p, with, c)
      stiffness = 0.0_wp
      damping = 0.0_wp
      if (abs(c%state) == stop_touching) call f%slopes(with, c%depth, c%rate, stiffness, damping)
      u = pair_motion(at, f%ia, f%ib, motion%x)
      depth = sum(c%g*u)
      x(1) = stiffness*depth + damping*(motion%s*depth + c%side*sum(f%measure%turning(at%ev%p)*u))
      x(2) = -depth
      x(3) = 0.0_wp
    end select
  end subroutine stop_amplitude
end module force_sensors
