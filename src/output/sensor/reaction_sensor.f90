!> Force of a joint or drive on its body a, and moment about its marker a: -(gradient)^T lambda, the joint's friction included.
module reaction_sensor
  use kinds, only: wp
  use constraint, only: marker_stiffness
  use sensor, only: observation, sensor_model, harmonic_motion, scene_motion
  implicit none (type, external)
  private

  !> A reaction.
  type, extends(sensor_model), public :: reaction_sensor_model
    integer, allocatable :: constraints(:)    !! its number, joints before drives, and that of its friction, if any
  contains
    procedure :: read => read_reaction
    procedure :: respond
  end type reaction_sensor_model

contains

  !> From the multipliers.
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
  subroutine respond(self, at, motion, x)
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
        x(1:3) = x(1:3) - matmul(t%k(1:3, 1:3), scene_motion(at%m, at%ev, c%ia, motion%x)) &
                 - matmul(t%k(1:3, 4:6), scene_motion(at%m, at%ev, c%ib, motion%x))
        do i = c%first, c%first + c%rows - 1
          x(1:3) = x(1:3) - [at%ev%rows%na(:, i), at%ev%rows%sa(i)]*motion%lambda(i)
        end do
      end associate
    end do
  end subroutine respond
end module reaction_sensor
