!> Gears, belts and planetary sets: the ratio of two turns, both measured from a carrier. They act by moments alone.
module gear_joint
  use kinds, only: wp
  use constraint, only: constraint_model, constraint_rows
  use marker, only: marker_states
  implicit none (type, external)
  private

  !> size ((angle_a - angle_c) - ratio (angle_b - angle_c) - angle) = 0.
  type, extends(constraint_model), public :: gear_model
    real(wp) :: ratio = 1.0_wp            !! turns of a for one of b, both from the carrier [-]
    real(wp) :: angle = 0.0_wp            !! the same sum of the deck's angles [rad]
  contains
    procedure :: evaluate => gear_row
    procedure :: acts_on => gear_acts_on
  end type gear_model

contains

  !> The row.
  pure subroutine gear_row(self, t, p, r)
    class(gear_model), intent(in) :: self
    real(wp), intent(in) :: t   !! [s]
    type(marker_states), intent(in) :: p
    type(constraint_rows), intent(inout) :: r
    associate (i => self%first)
      call r%empty(i)
      r%sa(i) = self%size
      r%sb(i) = -self%size*self%ratio
      r%sc(i) = self%size*(self%ratio - 1.0_wp)
      r%phi(i) = self%size*((p%angle(self%ia) - p%angle(self%ic)) - self%ratio*(p%angle(self%ib) - p%angle(self%ic)) - self%angle)
    end associate
  end subroutine gear_row

  !> It acts on section angles alone.
  pure function gear_acts_on(self) result(yes)
    class(gear_model), intent(in) :: self
    logical :: yes(6)
    yes = [.false., .false., .true., .false., .false., .true.]
  end function gear_acts_on
end module gear_joint
