!> Force of a joint or drive on its body a, and moment about its marker a: -(gradient)^T lambda.
module reaction_sensor
  use kinds, only: wp
  use constraint, only: marker_stiffness
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  use marker, only: marker_states
  use sensor, only: sensor_model, harmonic_motion, scene_motion, suffix_length
  implicit none (type, external)
  private

  !> A reaction.
  type, extends(sensor_model), public :: reaction_sensor_model
    integer :: constraint = 0                 !! its number, joints before drives
  contains
    procedure :: columns
    procedure :: read => read_reaction
    procedure :: respond
  end type reaction_sensor_model

contains

  !> Force and moment.
  subroutine columns(self, m, list)
    class(reaction_sensor_model), intent(in) :: self
    type(mechanism_model), intent(in) :: m
    character(suffix_length), allocatable, intent(out) :: list(:)
    list = [character(suffix_length) :: '.fx[N]', '.fy[N]', '.m[Nm]']
  end subroutine columns

  !> From the multipliers.
  subroutine read_reaction(self, m, ev, p, y, x)
    class(reaction_sensor_model), intent(in) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: y(:)              !! state [m, rad] and per second
    real(wp), intent(inout) :: x(:)           !! [N], [N], [N m]
    integer :: i
    x(1:3) = 0.0_wp
    associate (c => m%s%constraints(self%constraint)%item)
      do i = c%first, c%first + c%rows - 1
        x(1:2) = x(1:2) - ev%rows%na(:, i)*ev%lambda(i)
        x(3) = x(3) - ev%rows%sa(i)*ev%lambda(i)
      end do
    end associate
  end subroutine read_reaction

  !> With the change of its direction.
  subroutine respond(self, m, ev, p, y, motion, x)
    class(reaction_sensor_model), intent(in) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: y(:)              !! state [m, rad] and per second
    type(harmonic_motion), intent(in) :: motion
    complex(wp), intent(inout) :: x(:)        !! [N], [N], [N m]
    type(marker_stiffness) :: t
    integer :: i
    associate (c => m%s%constraints(self%constraint)%item)
      call c%geometric(ev%p, ev%lambda, t)
      x(1:3) = -matmul(t%k(1:3, 1:3), scene_motion(m, ev, c%ia, motion%x)) &
               - matmul(t%k(1:3, 4:6), scene_motion(m, ev, c%ib, motion%x))
      do i = c%first, c%first + c%rows - 1
        x(1:3) = x(1:3) - [ev%rows%na(:, i), ev%rows%sa(i)]*motion%lambda(i)
      end do
    end associate
  end subroutine respond
end module reaction_sensor
