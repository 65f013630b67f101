!> Forces that are constant in global axes but for their history.
module point_force
  use kinds, only: wp
  use force_element, only: conditions
  use load, only: load_model
  use marker, only: marker_states
  implicit none (type, external)
  private

  !> It acts by a force on its marker.
  type, extends(load_model), public :: point_force_model
    real(wp) :: f(2) = 0.0_wp              !! [N]
  contains
    procedure :: unit_wrench
    procedure :: acts_on
  end type point_force_model

contains

  !> It acts by a force on its marker.
  pure function acts_on(self) result(yes)
    class(point_force_model), intent(in) :: self
    logical :: yes(6)
    yes = [.true., .true., .false., .false., .false., .false.]
  end function acts_on

  !> The wrench: the force as the deck gives it.
  pure function unit_wrench(self, p, with) result(w)
    class(point_force_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp) :: w(3)                       !! [N, N m]
    w = [self%f, 0.0_wp]
  end function unit_wrench
end module point_force
