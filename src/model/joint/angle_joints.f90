!> Constraints of section angles alone: rotation drives; gears, belts and planetary sets. They act by moments.
module angle_joints
  use kinds, only: wp
  use constraint, only: constraint_model, constraint_rows
  use history, only: drive_values
  use marker, only: marker_states
  implicit none (type, external)
  private

  !> One row between section angles.
  type, abstract, extends(constraint_model) :: angle_model
  contains
    procedure :: acts_on => angle_acts_on
  end type angle_model

  !> size (angle_a - angle_b - target(t)) = 0: the angle follows a history, directly or by its rate.
  type, extends(angle_model), public :: rotation_model
  contains
    procedure :: evaluate => rotation_row
    procedure :: measure => angle_between
  end type rotation_model

  !> size ((angle_a - angle_c) - ratio (angle_b - angle_c) - angle) = 0: two turns, both measured from a carrier c.
  type, extends(angle_model), public :: gear_model
    real(wp) :: ratio = 1.0_wp            !! turns of a for one of b, both from the carrier [-]
    real(wp) :: angle = 0.0_wp            !! the same sum of the deck's angles [rad]
  contains
    procedure :: evaluate => gear_row
  end type gear_model

contains

  !> It acts on section angles alone.
  pure function angle_acts_on(self) result(yes)
    class(angle_model), intent(in) :: self
    logical :: yes(6)
    yes = [.false., .false., .true., .false., .false., .true.]
  end function angle_acts_on

  !> The row of a drive.
  pure subroutine rotation_row(self, t, p, r)
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
  end subroutine rotation_row

  !> The angle of a minus that of b.
  pure real(wp) function angle_between(self, p) result(x)   ! [rad]
    class(rotation_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    x = p%angle(self%ia) - p%angle(self%ib)
  end function angle_between

  !> The row of a gear.
  pure subroutine gear_row(self, t, p, r)
    class(gear_model), intent(in) :: self
    real(wp), intent(in) :: t   !! [s]
    type(marker_states), intent(in) :: p
    type(constraint_rows), intent(inout) :: r
    associate (i => self%first)
      r%sa(i) = self%size
      r%sb(i) = -self%size*self%ratio
      r%sc(i) = self%size*(self%ratio - 1.0_wp)
      r%phi(i) = self%size*((p%angle(self%ia) - p%angle(self%ic)) - self%ratio*(p%angle(self%ib) - p%angle(self%ic)) - self%angle)
    end associate
  end subroutine gear_row
end module angle_joints
