!> Friction of a joint: force or moment on body a along its freedom, rate at which it slides, state, share of the limit that acts.
module friction_sensor
  use kinds, only: wp
  use sensor, only: observation, sensor_model, harmonic_motion, scene_motion
  implicit none (type, external)
  private

  !> A joint's friction.
  type, extends(sensor_model), public :: friction_sensor_model
    integer :: row = 0                        !! its tangential row's number among the constraints
  contains
    procedure :: read => read_friction
    procedure :: respond
  end type friction_sensor_model

contains

  !> From the multiplier of its row.
  subroutine read_friction(self, at, x)
    class(friction_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! [N], [m/s], [-], [-] or [N m], [rad/s], [-], [-]
    real(wp) :: unit                          ! of the row in those of its motion [-], [m]
    associate (row => at%m%s%constraints(self%row)%item, law => at%m%s%friction(self%row - at%m%s%permanent))
      associate (r => at%ev%rows, p => at%ev%p, i => row%first, state => at%ev%switches%state(row%switch_number))
        unit = merge(row%size, 1.0_wp, row%angular)
        x(1) = -unit*at%ev%lambda(i)
        x(2) = (dot_product(r%na(:, i), p%v(:, row%ia)) + dot_product(r%nb(:, i), p%v(:, row%ib)) &
                + r%sa(i)*p%rate(row%ia) + r%sb(i)*p%rate(row%ib))/unit
        x(3) = law%slides(state)
        x(4) = law%share(state, at%ev%lambda)
      end associate
    end associate
  end subroutine read_friction

  !> What sticks takes forces; what slips acts as a constant force.
  subroutine respond(self, at, motion, x)
    class(friction_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    complex(wp), intent(inout) :: x(:)        !! [N], [m/s], [-], [-] or [N m], [rad/s], [-], [-]
    complex(wp) :: a(3), b(3)                 ! [m], [rad]
    real(wp) :: unit                          ! [-], [m]
    x(1:4) = 0.0_wp
    associate (row => at%m%s%constraints(self%row)%item)
      associate (r => at%ev%rows, i => row%first)
        unit = merge(row%size, 1.0_wp, row%angular)
        a = scene_motion(at%m, at%ev, row%ia, motion%x)
        b = scene_motion(at%m, at%ev, row%ib, motion%x)
        if (.not. r%off(i)) x(1) = -unit*motion%lambda(i)
        if (r%off(i)) x(2) = motion%s*(sum(r%na(:, i)*a(1:2) + r%nb(:, i)*b(1:2)) + r%sa(i)*a(3) + r%sb(i)*b(3))/unit
      end associate
    end associate
  end subroutine respond
end module friction_sensor
