!> Forces that follow the frame of their body.
module body_force
  use kinds, only: wp
  use force_element, only: conditions
  use marker, only: marker_states
  use point_force, only: point_force_model
  implicit none (type, external)
  private

  !> A force in the frame's axes; the builder sets in_frame.
  type, extends(point_force_model), public :: body_force_model
  contains
    procedure :: unit_wrench
  end type body_force_model

contains

  !> The wrench: the force turned with the frame.
  pure function unit_wrench(self, p, with) result(w)
    class(body_force_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp) :: w(3)                       !! [N, N m]
    associate (c => with%axes(1), s => with%axes(2))
      w = [c*self%f(1) - s*self%f(2), s*self%f(1) + c*self%f(2), 0.0_wp]
    end associate
  end function unit_wrench
end module body_force
