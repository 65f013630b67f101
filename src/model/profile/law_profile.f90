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
  use table_history, only: table_model
  use marker, only: turn
  use profile, only: profile_reach
  implicit none (type, external)
  private

  real(wp), parameter :: same_angle = 1.0e-9_wp   !! angles so near are one [rad]

  !> The pitch curve of a roller.
  type, extends(curve_model), public :: law_model
    class(history_model), allocatable :: law !! the lift or the arm's angle [m] or [rad]
    logical :: clockwise = .false.           !! the cam turns so through the law
    real(wp) :: base(2) = 0.0_wp             !! offset, h0; of an arm: its pivot; of a face: 0, base_radius [m]
    real(wp) :: arm = 0.0_wp                 !! 0: none [m]
    real(wp), allocatable :: joints(:)         !! of its pieces, ascending, and a turn after the first [rad]
  contains
    procedure :: at => law_place
    procedure :: lift
    procedure :: cam_angle
    procedure :: pressure_angle
    procedure :: corners
    procedure :: leaves => leaves_piece
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

  !> The cam's angle in the law.
  pure real(wp) function cam_angle(self, v) result(angle)   ! from 0 to 2 pi [rad]
    class(law_model), intent(in) :: self
    real(wp), intent(in) :: v                !! [rad]
    angle = modulo(merge(v, -v, self%clockwise), 2*pi)
  end function cam_angle

  !> Where a derivative of the law up to an order jumps, ascending, from 0 to 2 pi; pieces are no longer than half a turn. None: it
  !> is smooth, or so are the pieces of a table but for their third derivatives, too many for events.
  function corners(self, most_order) result(list)
    class(law_model), intent(in) :: self
    integer, intent(in) :: most_order
    real(wp), allocatable :: list(:)         ! v [rad]
    class(history_model), allocatable :: law
    real(wp) :: first(-1:2), last(-1:2), t, ends(2)
    integer :: k, order
    order = most_order
    select type (law_of_table => self%law)
    class is (table_model)
      order = min(order, 2)
    end select
    allocate (law, source=self%law)
    call law%keep_corners(order)
    allocate (list(0))
    t = law%next_corner(-0.5_wp*same_angle, .true.)
    do while (t < 2*pi - same_angle)
      list = [list, t]
      t = law%next_corner(t, .true.)
    end do
    call law%evaluate(0.0_wp, .false., first)
    call law%evaluate(2*pi, .true., last)
    if (.not. law%period > 0.0_wp .and. (size(list) > 0 .or. abs(last(2) - first(2)) > same_angle*abs(first(2)))) then
      if (size(list) == 0) list = [0.0_wp]
      if (list(1) > same_angle) list = [0.0_wp, list]
    end if
    if (.not. self%clockwise) list = modulo(-list(size(list):1:-1), 2*pi)
    if (size(list) > 0) list = cshift(list, minloc(list, 1) - 1)
    k = 1
    do while (k <= size(list))
      ends = [list(k), list(1) + 2*pi]
      if (k < size(list)) ends(2) = list(k + 1)
      if (ends(2) - ends(1) > pi + same_angle) then
        list = [list(:k), 0.5_wp*sum(ends), list(k + 1:)]
      else
        k = k + 1
      end if
    end do
  end function corners

  !> How far v lies from the middle of a piece, and half the piece.
  pure subroutine from_middle(self, piece, v, x, half)
    class(law_model), intent(in) :: self
    integer, intent(in) :: piece
    real(wp), intent(in) :: v                !! [rad]
    real(wp), intent(out) :: x, half         !! [rad]
    half = 0.5_wp*(self%joints(piece + 1) - self%joints(piece))
    x = v - 0.5_wp*(self%joints(piece + 1) + self%joints(piece))
    x = x - 2*pi*anint(x/(2*pi))
  end subroutine from_middle

  !> Whether v is at or beyond an end of a piece, within what angles differ by rounding.
  pure logical function leaves_piece(self, piece, u) result(yes)
    class(law_model), intent(in) :: self
    integer, intent(in) :: piece             !! 0: none
    real(wp), intent(in) :: u                !! v [rad]
    real(wp) :: x, half
    yes = piece > 0
    if (.not. yes) return
    call from_middle(self, piece, u, x, half)
    yes = abs(x) > half - same_angle
  end function leaves_piece

  !> The law and two derivatives by v; beyond the ends of a piece the parabola that continues it.
  pure function lift(self, v, piece) result(s)
    class(law_model), intent(in) :: self
    real(wp), intent(in) :: v                !! [rad]
    integer, intent(in) :: piece             !! 0: none
    real(wp) :: s(0:2), h(-1:2)              ! [m] or [rad], per rad
    real(wp) :: x, half, d, angle
    logical :: from_below
    d = 0.0_wp
    from_below = .false.
    angle = self%cam_angle(v)
    if (self%leaves(piece, v)) then
      call from_middle(self, piece, v, x, half)
      d = x - sign(half, x)
      angle = self%cam_angle(v - d)
      from_below = x > 0.0_wp .eqv. self%clockwise
      if (from_below .and. angle < same_angle) angle = angle + 2*pi
      if (.not. from_below .and. angle > 2*pi - same_angle) angle = 0.0_wp
    end if
    call self%law%evaluate(angle, from_below, h)
    s = [h(0), merge(h(1), -h(1), self%clockwise), h(2)]
    s(0:1) = [s(0) + d*(s(1) + 0.5_wp*d*s(2)), s(1) + d*s(2)]
  end function lift

  !> Where the roller's centre is.
  pure type(curve_place) function law_place(self, u, piece) result(q)
    class(law_model), intent(in) :: self
    real(wp), intent(in) :: u                !! v [rad]
    integer, intent(in) :: piece             !! 0: none
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

  !> Tangent of the angle between the normal and the way of the follower.
  pure real(wp) function pressure_angle(self, u) result(angle)   ! [rad]
    class(law_model), intent(in) :: self
    real(wp), intent(in) :: u                !! v [rad]
    type(curve_place) :: q
    real(wp) :: s(0:2), n(2)
    s = self%lift(u, 0)
    q = self%at(u, 0)
    n = [cos(u)*q%n(1) + sin(u)*q%n(2), cos(u)*q%n(2) - sin(u)*q%n(1)]
    if (self%arm > 0.0_wp) n = [sin(s(0))*n(1) - cos(s(0))*n(2), cos(s(0))*n(1) + sin(s(0))*n(2)]
    if (self%arm > 0.0_wp) n = [n(2), abs(n(1))]
    angle = atan2(n(1), n(2))
  end function pressure_angle

  !> Where a flat face touches.
  pure type(curve_place) function flat_place(self, u, piece) result(q)
    class(flat_model), intent(in) :: self
    real(wp), intent(in) :: u                !! v [rad]
    integer, intent(in) :: piece             !! 0: none
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
    integer, intent(in) :: piece             !! 0: none
    reach%u = alpha - 0.5_wp*pi
    reach%advance = 1.0_wp
    reach%p = self%lift(reach%u, piece)
    reach%p(0) = self%base(2) + reach%p(0)
  end function flat_support

  !> On the spline.
  pure type(curve_place) function spline_place(self, u, piece) result(q)
    class(spline_model), intent(in) :: self
    real(wp), intent(in) :: u                !! length of chords [m]
    integer, intent(in) :: piece             !! not used
    real(wp) :: x(-1:2), y(-1:2)
    call self%x%evaluate(u, u > self%half, x)
    call self%y%evaluate(u, u > self%half, y)
    q = from_derivatives(u, reshape([x(0), y(0), x(1), y(1), x(2), y(2)], [2, 3]))
  end function spline_place
end module law_profile
