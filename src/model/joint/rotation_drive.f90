!> Rotation drive: the angle of frame or section a minus that of b follows a history, directly or by its rate.
module rotation_drive
  use kinds, only: wp
  use constraint, only: constraint_model, constraint_rows
  use history, only: drive_values
  use marker, only: marker_states
  implicit none (type, external)
  private

  !> size (angle_a - angle_b - target(t)) = 0.
  type, extends(constraint_model), public :: rotation_model
  contains
    procedure :: evaluate => rotation_rows
    procedure :: measure => angle_between
    procedure :: acts_on => rotation_acts_on
  end type rotation_model

contains

  !> The row.
  pure subroutine rotation_rows(self, t, p, r)
    class(rotation_model), intent(in) :: self
    real(wp), intent(in) :: t   !! [s]
    type(marker_states), intent(in) :: p
    type(constraint_rows), intent(inout) :: r
    real(wp) :: h(0:2)
    integer :: i
    i = self%first
    call drive_values(self%target, self%rate, self%origin, t, r%left_limit, h)
    call self%hold_angle(i, h(0), p, r)
    r%phi_t(i) = -self%size*h(1)
    r%acceleration_bias(i) = -self%size*h(2)
  end subroutine rotation_rows

  !> It acts on section angles alone.
  pure function rotation_acts_on(self) result(yes)
    class(rotation_model), intent(in) :: self
    logical :: yes(6)
    yes = [.false., .false., .true., .false., .false., .true.]
  end function rotation_acts_on

  !> The angle of a minus that of b.
  pure function angle_between(self, p) result(x)
    class(rotation_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp) :: x   !! [rad]
    x = p%angle(self%ia) - p%angle(self%ib)
  end function angle_between
end module rotation_drive
