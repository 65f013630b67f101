!> Curves of profiles: the discs that move a follower by a law, and splines through points. With v minus the cam's angle, the cam's
!> section sees the follower of a law at P(v) = A(v) q(v), where q is its place in the axes in which the cam turns:
!>
!>   q = (offset, h0 + s), or pivot + arm (cos s, sin s)      P' = A (H q + q')      P'' = A (-q + 2 H q' + q'')
!>
!> and a flat face in the direction v + pi/2, at the support p = base_radius + s.
module law_profile
  use kinds, only: wp, pi
  use curve_profile, only: curve_model, curve_place
  use history, only: history_model
  use history_pieces, only: piece_value
  use marker, only: turn
  use profile, only: no_piece, profile_reach
  implicit none (type, external)
  private

  !> The pitch curve of a roller.
  type, extends(curve_model), public :: law_model
    class(history_model), allocatable :: law !! the lift or the arm's angle over the cam's, by turns, with its corners [m] or [rad]
    real(wp) :: base(2) = 0.0_wp             !! offset, h0; of an arm: its pivot; of a face: 0, base_radius [m]
    real(wp) :: arm = 0.0_wp                 !! 0: none [m]
  contains
    procedure :: at => law_place
    procedure :: lift
    procedure :: pressure_angle
  end type law_model

  !> The disc of a flat face.
  type, extends(law_model), public :: flat_model
  contains
    procedure :: at => flat_place
    procedure :: support => flat_support
  end type flat_model

  !> A curve by its coordinates over the length of its chords.
  type, extends(curve_model), public :: spline_model
    class(history_model), allocatable :: x, y   !! [m]
    real(wp) :: half = 0.0_wp                !! of the length, beyond which pieces are those before their points [m]
  contains
    procedure :: at => spline_place
  end type spline_model

contains

  !> The law and two derivatives by v; beyond the ends of a piece the parabola that continues it.
  pure function lift(self, v, piece) result(s)
    class(law_model), intent(in) :: self
    real(wp), intent(in) :: v                !! [rad]
    real(wp), intent(in) :: piece            !! [rad]
    real(wp) :: s(0:2), h(-1:2), angle       ! [m] or [rad], per rad; [rad]
    angle = self%sense*v
    if (piece < no_piece) then
      call piece_value(self%law, angle + 2*pi*anint((piece - angle)/(2*pi)), piece, s)
    else
      call self%law%evaluate(angle, .false., h)
      s = h(0:)
    end if
    s(1) = self%sense*s(1)
  end function lift

  !> Where the roller's centre is.
  pure type(curve_place) function law_place(self, u, piece) result(q)
    class(law_model), intent(in) :: self
    real(wp), intent(in) :: u                !! v [rad]
    real(wp), intent(in) :: piece            !! [rad]
    real(wp) :: s(0:2), e(2), p(2, 0:2)      ! [m] or [rad]
    s = self%lift(u, piece)
    if (self%arm > 0.0_wp) then
      e = self%arm*[cos(s(0)), sin(s(0))]
      p = reshape([self%base + e, s(1)*turn(e), s(2)*turn(e) - s(1)**2*e], [2, 3])
    else
      p = reshape([self%base(1), self%base(2) + s(0), 0.0_wp, s(1), 0.0_wp, s(2)], [2, 3])
    end if
    p(:, 2) = -p(:, 0) + 2*turn(p(:, 1)) + p(:, 2)
    p(:, 1) = turn(p(:, 0)) + p(:, 1)
    q = from_derivatives(u, matmul(reshape([cos(u), sin(u), -sin(u), cos(u)], [2, 2]), p))
  end function law_place

  !> A place from the curve's point and two derivatives.
  pure type(curve_place) function from_derivatives(u, p) result(q)
    real(wp), intent(in) :: u                !! [any]
    real(wp), intent(in) :: p(2, 0:2)        !! [m], [m/any], [m/any2]
    q%u = u
    q%c = p(:, 0)
    q%speed = norm2(p(:, 1))
    q%n = -turn(p(:, 1))/q%speed
    q%curvature = -dot_product(q%n, p(:, 2))/q%speed**2
  end function from_derivatives

  !> The angle between the normal and the way of the follower, which is y, or across its arm.
  pure real(wp) function pressure_angle(self, u) result(angle)   ! from 0 to pi/2 [rad]
    class(law_model), intent(in) :: self
    real(wp), intent(in) :: u                !! v [rad]
    type(curve_place) :: q
    real(wp) :: s(0:2), along(2)
    s = self%lift(u, no_piece)
    q = self%at(u, no_piece)
    along = [cos(u), sin(u)]
    if (self%arm > 0.0_wp) along = [cos(u + s(0)), sin(u + s(0))]
    angle = atan2(abs(dot_product(along, q%n)), abs(dot_product(turn(along), q%n)))
  end function pressure_angle

  !> Where a flat face touches.
  pure type(curve_place) function flat_place(self, u, piece) result(q)
    class(flat_model), intent(in) :: self
    real(wp), intent(in) :: u                !! v [rad]
    real(wp), intent(in) :: piece            !! [rad]
    type(profile_reach) :: reach
    reach = self%support(u + 0.5_wp*pi, piece)
    q%u = u
    q%n = [-sin(u), cos(u)]
    q%c = reach%p(0)*q%n + reach%p(1)*turn(q%n)
    q%speed = reach%p(0) + reach%p(2)
    q%curvature = 1/sign(max(abs(q%speed), sqrt(tiny(1.0_wp))), q%speed)
  end function flat_place

  !> The law itself.
  pure type(profile_reach) function flat_support(self, alpha, piece) result(reach)
    class(flat_model), intent(in) :: self
    real(wp), intent(in) :: alpha            !! [rad]
    real(wp), intent(in) :: piece            !! [rad]
    reach%p = self%lift(alpha - 0.5_wp*pi, piece)
    reach%p(0) = self%base(2) + reach%p(0)
    reach%angle = self%sense*(alpha - 0.5_wp*pi)
    reach%advance = self%sense
  end function flat_support

  !> On the spline.
  pure type(curve_place) function spline_place(self, u, piece) result(q)
    class(spline_model), intent(in) :: self
    real(wp), intent(in) :: u                !! length of chords [m]
    real(wp), intent(in) :: piece            !! not used [rad]
    real(wp) :: x(-1:2), y(-1:2)
    call self%x%evaluate(u, u > self%half, x)
    call self%y%evaluate(u, u > self%half, y)
    q = from_derivatives(u, reshape([x(0), y(0), x(1), y(1), x(2), y(2)], [2, 3]))
  end function spline_place
end module law_profile
