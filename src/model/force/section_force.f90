!> Forces that follow the section on which they act.
module section_force
  use kinds, only: wp
  use force_element, only: conditions
  use marker, only: marker_states, turn
  use point_force, only: point_force_model
  implicit none (type, external)
  private

  !> A force in the section's axes.
  type, extends(point_force_model), public :: section_force_model
  contains
    procedure :: unit_wrench
    procedure :: unit_tangent
    procedure :: components
  end type section_force_model

contains

  !> The wrench: the force turned with the section.
  pure function unit_wrench(self, p, with) result(w)
    class(section_force_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp) :: w(3), c, s                 !! [N, N m]
    c = cos(p%angle(self%ia))
    s = sin(p%angle(self%ia))
    w = [c*self%f(1) - s*self%f(2), s*self%f(1) + c*self%f(2), 0.0_wp]
  end function unit_wrench

  !> It turns with the section's angle.
  pure function unit_tangent(self, p, with) result(k)
    class(section_force_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp) :: k(3, 3), w(3)              !! [N/m, N]
    w = self%unit_wrench(p, with)
    k = 0.0_wp
    k(1:2, 3) = -turn(w(1:2))
  end function unit_tangent

  !> Its tangent joins the force and the angle of the section.
  pure function components(self) result(list)
    class(section_force_model), intent(in) :: self
    integer, allocatable :: list(:)
    list = [1, 2, 3]
  end function components
end module section_force
