!> Profiles: plane curves that a follower touches, in the axes of the section that carries them. What is asked of a curve is the
!> foot of a point, from which its normal goes through the point, and its support p(alpha), how far it reaches in a direction.
module profile
  use kinds, only: wp, pi
  implicit none (type, external)
  private

  integer, parameter :: circle_points = 96   !! of a picture
  real(wp), parameter, public :: no_piece = huge(1.0_wp)   !! no piece of a law goes on beyond its ends: the law itself is meant

  !> The place of a profile that is nearest to a point.
  type, public :: profile_foot
    real(wp) :: distance = 0.0_wp            !! of the point, negative within the profile [m]
    real(wp) :: n(2) = [1.0_wp, 0.0_wp]      !! outward normal [-]
    real(wp) :: curvature = 0.0_wp           !! of the profile, positive where it is convex [1/m]
    real(wp) :: angle = 0.0_wp               !! the argument of a law there [rad]
    real(wp) :: advance = 0.0_wp             !! of it with the point along the tangent [rad/m]
  end type profile_foot

  !> How far it reaches in a direction.
  type, public :: profile_reach
    real(wp) :: p(0:2) = 0.0_wp              !! the support, with two derivatives [m]
    real(wp) :: angle = 0.0_wp               !! the argument of a law at the place that is farthest [rad]
    real(wp) :: advance = 0.0_wp             !! of it with the direction [-]
  end type profile_reach

  !> Bounds of what a follower sees of it.
  type, public :: profile_bends
    real(wp) :: bend = 0.0_wp                !! largest second derivative of the gap by the coordinates of what moves [1/m]
    real(wp) :: lever = 0.0_wp               !! of a flat face: coordinate over turn, so that the gap changes no faster [m]
  end type profile_bends

  !> The way along it up to a place.
  type, public :: profile_way
    real(wp) :: length = 0.0_wp              !! of the profile, along the normal's quarter turn [m]
    real(wp) :: angle = 0.0_wp               !! of the normal [rad]
    real(wp) :: bending = 0.0_wp             !! of the curvature with the length [1/m2]
    real(wp) :: round = 0.0_wp               !! length of all of it, while the normal turns once; of an open one 0 [m]
  end type profile_way

  !> A profile.
  type, abstract, public :: profile_model
    character(32) :: name = ''
    logical :: round = .false.               !! a circle: turning changes nothing
  contains
    procedure(nearest_place), deferred :: nearest
    procedure(reach_of), deferred :: support
    procedure(way_up_to), deferred :: way
    procedure(bends_of), deferred :: bends
    procedure(points_of), deferred :: outline
  end type profile_model

  abstract interface
    !> The nearest place to a point.
    pure type(profile_foot) function nearest_place(self, d, piece) result(foot)
      import :: profile_model, profile_foot, wp
      class(profile_model), intent(in) :: self
      real(wp), intent(in) :: d(2)           !! [m]
      real(wp), intent(in) :: piece          !! argument of a law on a piece that goes on beyond its ends, or no_piece [rad]
    end function nearest_place
    !> Largest n(alpha).c of a convex profile.
    pure type(profile_reach) function reach_of(self, alpha, piece) result(reach)
      import :: profile_model, profile_reach, wp
      class(profile_model), intent(in) :: self
      real(wp), intent(in) :: alpha          !! of the direction n [rad]
      real(wp), intent(in) :: piece          !! as of the nearest place [rad]
    end function reach_of
    !> The way up to a place.
    pure type(profile_way) function way_up_to(self, angle, n, piece) result(way)
      import :: profile_model, profile_way, wp
      class(profile_model), intent(in) :: self
      real(wp), intent(in) :: angle          !! the argument of a law there [rad]
      real(wp), intent(in) :: n(2)           !! outward normal [-]
      real(wp), intent(in) :: piece          !! as of the nearest place [rad]
    end function way_up_to
    !> Bounds for a roller that touches it or is farther away, or for a flat face.
    pure type(profile_bends) function bends_of(self, radius, flat) result(b)
      import :: profile_model, profile_bends, wp
      class(profile_model), intent(in) :: self
      real(wp), intent(in) :: radius         !! of the roller [m]
      logical, intent(in) :: flat
    end function bends_of
    !> Points all along it, for pictures.
    pure function points_of(self) result(c)
      import :: profile_model, wp
      class(profile_model), intent(in) :: self
      real(wp), allocatable :: c(:, :)       ! (2, points) [m]
    end function points_of
  end interface

  !> A circle about the origin; its free side is the outside, or the inside of a hollow one, whose radius is negative.
  type, extends(profile_model), public :: circle_model
    real(wp) :: radius = 0.0_wp              !! of curvature [m]
  contains
    procedure :: nearest => circle_nearest
    procedure :: support => circle_support
    procedure :: way => circle_way
    procedure :: bends => circle_bends
    procedure :: outline => circle_outline
  end type circle_model

contains

  !> On the line through the centre.
  pure type(profile_foot) function circle_nearest(self, d, piece) result(foot)
    class(circle_model), intent(in) :: self
    real(wp), intent(in) :: d(2)             !! [m]
    real(wp), intent(in) :: piece            !! not used [rad]
    real(wp) :: r
    r = sign(sqrt(d(1)**2 + d(2)**2), self%radius)
    foot%n(1) = sign(1.0_wp, self%radius)
    if (abs(r) > 0.0_wp) foot%n = d/r
    foot%distance = r - self%radius
    foot%curvature = 1/self%radius
  end function circle_nearest

  !> Its radius.
  pure type(profile_reach) function circle_support(self, alpha, piece) result(reach)
    class(circle_model), intent(in) :: self
    real(wp), intent(in) :: alpha            !! [rad]
    real(wp), intent(in) :: piece            !! not used [rad]
    reach%p(0) = self%radius
  end function circle_support

  !> By the normal alone.
  pure type(profile_way) function circle_way(self, angle, n, piece) result(way)
    class(circle_model), intent(in) :: self
    real(wp), intent(in) :: angle            !! not used [rad]
    real(wp), intent(in) :: n(2)             !! outward normal [-]
    real(wp), intent(in) :: piece            !! not used [rad]
    way%angle = atan2(n(2), n(1))
    way%length = self%radius*way%angle
    way%round = 2*pi*self%radius
  end function circle_way

  !> Of the distance from its centre; a face sees no turn of it.
  pure type(profile_bends) function circle_bends(self, radius, flat) result(b)
    class(circle_model), intent(in) :: self
    real(wp), intent(in) :: radius           !! [m]
    logical, intent(in) :: flat
    if (.not. flat) b%bend = 1/max(abs(self%radius + radius), sqrt(tiny(1.0_wp)))
  end function circle_bends

  !> Round about.
  pure function circle_outline(self) result(c)
    class(circle_model), intent(in) :: self
    real(wp), allocatable :: c(:, :)         ! (2, points) [m]
    integer :: k
    c = self%radius*reshape([([cos(2*pi*k/circle_points), sin(2*pi*k/circle_points)], k=0, circle_points)], [2, circle_points + 1])
  end function circle_outline
end module profile
