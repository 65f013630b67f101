!> The row of a rigid stop: while that is closed, what it measures keeps its limit.
module stop_row
  use kinds, only: wp
  use constraint, only: constraint_model
  use friction_law, only: row_stuck, row_slips, row_unloaded
  use marker, only: marker_states
  use stops, only: stop_unloaded, stop_open, stop_touching
  implicit none (type, external)
  private

  !> Its measure and its markers are those of the stop.
  type, extends(constraint_model), public :: stop_row_model
    real(wp) :: lower, upper                   !! limits of x, as those of its stop [m] or [rad]
    real(wp) :: restitution                    !! e of its stop [-]
  contains
    procedure :: holds => closed
    procedure :: relation => relation_of
    procedure :: state_of => state_by
    procedure :: bounds => pushes
    procedure :: place => limit
  end type stop_row_model

contains

  !> While the stop is closed.
  pure logical function closed(self, state) result(yes)
    class(stop_row_model), intent(in) :: self
    integer, intent(in) :: state
    yes = abs(state) == stop_touching
  end function closed

  !> Closed it holds; open it lets its bodies move away from the limit; else it needs no force.
  pure integer function relation_of(self, state, side) result(relation)
    class(stop_row_model), intent(in) :: self
    integer, intent(in) :: state
    integer, intent(in) :: side                !! the limit: 1 upper, -1 lower
    relation = row_unloaded
    if (abs(state) == stop_touching) relation = row_stuck
    if (state == stop_open) relation = -side*row_slips
  end function relation_of

  !> The state by that.
  pure integer function state_by(self, state, side) result(other)
    class(stop_row_model), intent(in) :: self
    integer, intent(in) :: state               !! how it holds
    integer, intent(in) :: side                !! the limit: 1 upper, -1 lower
    other = side*stop_unloaded
    if (state == row_stuck) other = side*stop_touching
    if (abs(state) == row_slips) other = stop_open
  end function state_by

  !> It never pulls.
  pure function pushes(self, side, lambda, pressed) result(bounds)
    class(stop_row_model), intent(in) :: self
    integer, intent(in) :: side                !! the limit: 1 upper, -1 lower
    real(wp), intent(in) :: lambda(:)          !! not used [N]
    real(wp), intent(in) :: pressed            !! not used [N]
    real(wp) :: bounds(2)                      ! [N]
    bounds = merge([0, 1], [-1, 0], side > 0)*huge(1.0_wp)
  end function pushes

  !> The limit.
  pure real(wp) function limit(self, p, side) result(x)   ! [m]
    class(stop_row_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    integer, intent(in) :: side                !! 1 upper, -1 lower
    x = self%weight()*merge(self%upper, self%lower, side > 0)
  end function limit
end module stop_row
