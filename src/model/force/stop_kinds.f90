!> Kinds of stops by the quantity that they limit: the angle between the sections of two markers, the position of a along a line
!> through b, or the distance of both (a pin with clearance).
module stop_kinds
  use kinds, only: wp
  use force_element, only: watched_roots
  use marker, only: marker_states
  use measures, only: angle_between, circle_curvature, distance_between, line_curvature, place_along
  use stops, only: stop_model
  implicit none (type, external)
  private

  !> Limits of the angle between two sections.
  type, extends(stop_model), public :: rotation_stop
  contains
    procedure :: measure => rotation_measure
    procedure :: acts_on => rotation_acts_on
  end type rotation_stop

  !> Limits of the position of a along a line that passes through b and turns with its section.
  type, extends(stop_model), public :: position_stop
    real(wp) :: direction = 0.0_wp         !! from section b [rad]
  contains
    procedure :: measure => position_measure
    procedure :: curvature => position_curvature
    procedure :: acts_on => position_acts_on
  end type position_stop

  !> A pin in a hole: the upper limit is the radial gap.
  type, extends(stop_model), public :: clearance_stop
  contains
    procedure :: measure => clearance_measure
    procedure :: curvature => clearance_curvature
    procedure :: opening_root => clearance_root
    procedure :: in_all_directions => always
    procedure :: acts_on => clearance_acts_on
  end type clearance_stop

contains

  !> The angle of a minus that of b.
  pure subroutine rotation_measure(self, p, x, xd, g)
    class(rotation_stop), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(out) :: x             !! [rad]
    real(wp), intent(out) :: xd            !! [rad/s]
    real(wp), intent(out) :: g(6)          !! [-]
    call angle_between(p, self%ia, self%ib, x, xd, g)
  end subroutine rotation_measure

  !> It acts by moments.
  pure function rotation_acts_on(self) result(yes)
    class(rotation_stop), intent(in) :: self
    logical :: yes(6)
    yes = [.false., .false., .true., .false., .false., .true.]
  end function rotation_acts_on

  !> n.(r_a - r_b), n at `direction` from section b.
  pure subroutine position_measure(self, p, x, xd, g)
    class(position_stop), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(out) :: x             !! [m]
    real(wp), intent(out) :: xd            !! [m/s]
    real(wp), intent(out) :: g(6)          !! global axes [-], [m]
    call place_along(p, self%ia, self%ib, self%direction, x, xd, g)
  end subroutine position_measure

  !> The line turns with section b.
  pure subroutine position_curvature(self, p, h)
    class(position_stop), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(out) :: h(6, 6)       !! [-], [m]
    call line_curvature(p, self%ia, self%ib, self%direction, h)
  end subroutine position_curvature

  !> It acts by forces, and turns b.
  pure function position_acts_on(self) result(yes)
    class(position_stop), intent(in) :: self
    logical :: yes(6)
    yes = [.true., .true., .false., .true., .true., .true.]
  end function position_acts_on

  !> |r_a - r_b|. A pin in the middle of its hole moves in any direction towards the limit: along x.
  pure subroutine clearance_measure(self, p, x, xd, g)
    class(clearance_stop), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(out) :: x             !! [m]
    real(wp), intent(out) :: xd            !! [m/s]
    real(wp), intent(out) :: g(6)          !! global axes [-]
    call distance_between(p, self%ia, self%ib, x, xd, g)
    if (x > 0.0_wp) return
    g = [1.0_wp, 0.0_wp, 0.0_wp, -1.0_wp, 0.0_wp, 0.0_wp]
    xd = p%v(1, self%ia) - p%v(1, self%ib)
  end subroutine clearance_measure

  !> As where it touches, wherever the pin is.
  pure subroutine clearance_curvature(self, p, h)
    class(clearance_stop), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(out) :: h(6, 6)       !! [1/m]
    real(wp) :: x, xd, g(6)
    call self%measure(p, x, xd, g)
    call circle_curvature(g, max(x, 0.5_wp*self%upper), h)
  end subroutine clearance_curvature

  !> (gap^2 - x^2)/(2 gap), smooth where pin and hole are concentric.
  pure subroutine clearance_root(self, x, xd, watched)
    class(clearance_stop), intent(in) :: self
    real(wp), intent(in) :: x              !! [m]
    real(wp), intent(in) :: xd             !! [m/s]
    type(watched_roots), intent(inout) :: watched
    watched%g(1) = 0.5_wp*(self%upper - x)*(1 + x/self%upper)
    watched%rate(1) = -xd*x/self%upper
  end subroutine clearance_root

  !> Its direction turns with the pin.
  pure logical function always(self)
    class(clearance_stop), intent(in) :: self
    always = .true.
  end function always

  !> It acts by forces.
  pure function clearance_acts_on(self) result(yes)
    class(clearance_stop), intent(in) :: self
    logical :: yes(6)
    yes = [.true., .true., .false., .true., .true., .false.]
  end function clearance_acts_on
end module stop_kinds
