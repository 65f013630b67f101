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
    integer :: i, j
    i = self%first
    j = i + 1
    r%na(:, i) = [1.0_wp, 0.0_wp]
    r%na(:, j) = [0.0_wp, 1.0_wp]
    r%nb(:, i) = [-1.0_wp, 0.0_wp]
    r%nb(:, j) = [0.0_wp, -1.0_wp]
    r%sa(i) = 0.0_wp
    r%sa(j) = 0.0_wp
    r%sb(i) = 0.0_wp
    r%sb(j) = 0.0_wp
    r%phi(i) = p%r(1, self%ia) - p%r(1, self%ib)
    r%phi(j) = p%r(2, self%ia) - p%r(2, self%ib)
    r%phi_t(i) = 0.0_wp
    r%phi_t(j) = 0.0_wp
    r%acceleration_bias(i) = 0.0_wp
    r%acceleration_bias(j) = 0.0_wp
    if (self%welded) call self%hold_angle(i + 2, self%angle, p, r)
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
