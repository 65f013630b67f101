!> Revolute and weld joints: the markers coincide; a weld also keeps the relative angle of the sections.
module pin_joint
  use kinds, only: wp
  use constraint, only: constraint_model, constraint_rows
  use marker, only: marker_states
  implicit none (type, external)
  private

  !> r_a - r_b = 0 and, welded, angle_a - angle_b = angle.
  type, extends(constraint_model), public :: pin_model
    logical :: welded = .false.
    real(wp) :: angle = 0.0_wp            !! angle of section a minus that of section b [rad]
  contains
    procedure :: evaluate => pin_rows
    procedure :: release_angle => weld_release
    procedure :: acts_on => pin_acts_on
  end type pin_model

contains

  !> Rows of the joint.
  pure subroutine pin_rows(self, t, p, r)
    class(pin_model), intent(in) :: self
    real(wp), intent(in) :: t   !! [s]
    type(marker_states), intent(in) :: p
    type(constraint_rows), intent(inout) :: r
    integer :: i, k
    do k = 1, 2
      i = self%first + k - 1
      call r%empty(i)
      r%na(k, i) = 1.0_wp
      r%nb(k, i) = -1.0_wp
      r%phi(i) = p%r(k, self%ia) - p%r(k, self%ib)
    end do
    if (self%welded) call self%hold_angle(self%first + 2, self%angle, p, r)
  end subroutine pin_rows

  !> A weld becomes a pin.
  subroutine weld_release(self, released)
    class(pin_model), intent(inout) :: self
    logical, intent(out) :: released
    released = self%welded
    self%welded = .false.
    self%rows = 2
  end subroutine weld_release

  !> A weld acts on section angles, too.
  pure function pin_acts_on(self) result(yes)
    class(pin_model), intent(in) :: self
    logical :: yes(6)
    yes = [.true., .true., self%welded, .true., .true., self%welded]
  end function pin_acts_on
end module pin_joint
