!> What rows transmit: reactions of joints and drives, friction of joints. Both come from the multipliers of the rows.
module row_sensors
  use kinds, only: wp
  use constraint, only: marker_stiffness
  use friction_law, only: sliding
  use sensor, only: observation, sensor_model, harmonic_motion, pair_motion
  implicit none (type, external)
  private

  !> Force on body a and moment about marker a, -(gradient)^T lambda, friction of the joint included.
  type, extends(sensor_model), public :: reaction_sensor_model
    integer, allocatable :: constraints(:)    !! the joint or drive, and the joint's friction, if any
  contains
    procedure :: read => read_reaction
    procedure :: respond => reaction_amplitude
  end type reaction_sensor_model

  !> Friction: force or moment on body a along the freedom of the joint, rate of sliding, state, share of the limit that acts.
  type, extends(sensor_model), public :: friction_sensor_model
    integer :: constraint = 0                 !! number of the tangential row among the constraints
  contains
    procedure :: read => read_friction
    procedure :: respond => friction_amplitude
  end type friction_sensor_model

contains

  !> At the present directions of the rows.
  subroutine read_reaction(self, at, x)
    class(reaction_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! [N], [N], [N m]
    integer :: i, k
    x(1:3) = 0.0_wp
    do k = 1, size(self%constraints)
      associate (c => at%m%s%constraints(self%constraints(k))%item)
        do i = c%first, c%first + c%rows - 1
          x(1:2) = x(1:2) - at%ev%rows%na(:, i)*at%ev%lambda(i)
          x(3) = x(3) - at%ev%rows%sa(i)*at%ev%lambda(i)
        end do
      end associate
    end do
  end subroutine read_reaction

  !> By changes of the multipliers and of the direction in which they act.
  subroutine reaction_amplitude(self, at, motion, x)
    class(reaction_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    complex(wp), intent(inout) :: x(:)        !! [N], [N], [N m]
    type(marker_stiffness) :: t
    integer :: i, k
    x(1:3) = 0.0_wp
    do k = 1, size(self%constraints)
      associate (c => at%m%s%constraints(self%constraints(k))%item)
        call c%geometric(at%ev%p, at%ev%lambda, t)
        x(1:3) = x(1:3) - matmul(t%k(1:3, :), pair_motion(at, c%ia, c%ib, motion%x))
        do i = c%first, c%first + c%rows - 1
          x(1:3) = x(1:3) - [at%ev%rows%na(:, i), at%ev%rows%sa(i)]*motion%lambda(i)
        end do
      end associate
    end do
  end subroutine reaction_amplitude

  !> From the motion of both markers along the row.
  subroutine read_friction(self, at, x)
    class(friction_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! [N], [m/s], [-], [-] or [N m], [rad/s], [-], [-]
    real(wp) :: unit                          ! of the row in those of its motion [-], [m]
    associate (row => at%m%s%constraints(self%constraint)%item, law => at%m%s%friction(self%constraint - at%m%s%permanent))
      associate (r => at%ev%rows, p => at%ev%p, i => row%first, state => at%ev%switches%state(row%switch_number))
        unit = row%weight()
        x(1) = -unit*at%ev%lambda(i)
        x(2) = (dot_product(r%na(:, i), p%v(:, row%ia)) + dot_product(r%nb(:, i), p%v(:, row%ib)) &
                + r%sa(i)*p%rate(row%ia) + r%sb(i)*p%rate(row%ib))/unit
        x(3) = sliding(state)
        x(4) = law%share(state, at%ev%lambda, r%pressed(i))
      end associate
    end associate
  end subroutine read_friction

  !> What sticks takes forces; what slips acts as a constant force.
  subroutine friction_amplitude(self, at, motion, x)
    class(friction_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    complex(wp), intent(inout) :: x(:)        !! [N], [m/s], [-], [-] or [N m], [rad/s], [-], [-]
    real(wp) :: unit                          ! [-], [m]
    x(1:4) = 0.0_wp
    associate (row => at%m%s%constraints(self%constraint)%item)
      associate (r => at%ev%rows, i => row%first)
        unit = row%weight()
        if (r%off(i)) then
          x(2) = motion%s*sum([r%na(:, i), r%sa(i), r%nb(:, i), r%sb(i)]*pair_motion(at, row%ia, row%ib, motion%x))/unit
        else
          x(1) = -unit*motion%lambda(i)
        end if
      end associate
    end associate
  end subroutine friction_amplitude
end module row_sensors
