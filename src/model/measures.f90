!> Measures between two markers a and b: angle, distance, position along a line. Each is stated here once, with its rate, its
!> gradient and its second derivative by x, y, section angle of a, then of b, global axes; quantities, stops and joints on lines
!> use them.
module measures
  use kinds, only: wp
  use marker, only: marker_states, turn
  implicit none (type, external)
  private
  public :: angle_between, distance_between, circle_curvature, place_along, line_curvature

contains

  !> The section angle of a minus that of b.
  pure subroutine angle_between(p, a, b, x, xd, g)
    type(marker_states), intent(in) :: p
    integer, intent(in) :: a, b
    real(wp), intent(out) :: x             !! [rad]
    real(wp), intent(out) :: xd            !! [rad/s]
    real(wp), intent(out) :: g(6)          !! [-]
    x = p%angle(a) - p%angle(b)
    xd = p%rate(a) - p%rate(b)
    g = [0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp, 0.0_wp, -1.0_wp]
  end subroutine angle_between

  !> |r_a - r_b|, with the direction from b to a: none where they coincide.
  pure subroutine distance_between(p, a, b, x, xd, g)
    type(marker_states), intent(in) :: p
    integer, intent(in) :: a, b
    real(wp), intent(out) :: x             !! [m]
    real(wp), intent(out) :: xd            !! [m/s]
    real(wp), intent(out) :: g(6)          !! [-]
    real(wp) :: e(2)
    e = p%r(:, a) - p%r(:, b)
    x = hypot(e(1), e(2))
    e = e/max(x, tiny(1.0_wp))
    xd = dot_product(e, p%v(:, a) - p%v(:, b))
    g = [e, 0.0_wp, -e, 0.0_wp]
  end subroutine distance_between

  !> Second derivative of a distance x: its direction turns, 1/x across it.
  pure subroutine circle_curvature(g, x, h)
    real(wp), intent(in) :: g(6)           !! gradient of the distance [-]
    real(wp), intent(in) :: x              !! [m]
    real(wp), intent(out) :: h(6, 6)       !! [1/m]
    real(wp) :: across(6)
    integer :: k
    across = [-g(2), g(1), 0.0_wp, g(2), -g(1), 0.0_wp]
    do k = 1, 6
      h(:, k) = across*(across(k)/x)
    end do
  end subroutine circle_curvature

  !> n.(r_a - r_b), n at an angle from section b.
  pure subroutine place_along(p, a, b, direction, x, xd, g)
    type(marker_states), intent(in) :: p
    integer, intent(in) :: a, b
    real(wp), intent(in) :: direction      !! of n from section b [rad]
    real(wp), intent(out) :: x             !! [m]
    real(wp), intent(out) :: xd            !! [m/s]
    real(wp), intent(out) :: g(6)          !! [-], [m]
    real(wp) :: n(2), d(2), angle
    angle = p%angle(b) + direction
    n = [cos(angle), sin(angle)]
    d = p%r(:, a) - p%r(:, b)
    x = dot_product(n, d)
    g = [n, 0.0_wp, -n, dot_product(turn(n), d)]
    xd = dot_product(n, p%v(:, a) - p%v(:, b)) + g(6)*p%rate(b)
  end subroutine place_along

  !> Its second derivative: the line turns with section b.
  pure subroutine line_curvature(p, a, b, direction, h)
    type(marker_states), intent(in) :: p
    integer, intent(in) :: a, b
    real(wp), intent(in) :: direction      !! of n from section b [rad]
    real(wp), intent(out) :: h(6, 6)       !! [-], [m]
    real(wp) :: n(2), angle
    angle = p%angle(b) + direction
    n = [cos(angle), sin(angle)]
    h = 0.0_wp
    h(1:2, 6) = turn(n)
    h(4:5, 6) = -turn(n)
    h(6, 1:5) = h(1:5, 6)
    h(6, 6) = -dot_product(n, p%r(:, a) - p%r(:, b))
  end subroutine line_curvature
end module measures
