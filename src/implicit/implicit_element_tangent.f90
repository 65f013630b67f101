!> Tangents of a flexible body in nodal coordinates for the implicit method, element by element: what the frame's angle and the
!> elastic coordinates do to one another, and the elements' parts of the elastic block. Arrays and axes as in `implicit_element`.
module implicit_element_tangent
  use kinds, only: wp
  use beam_element, only: deformation_matrix
  use body, only: body_model
  use implicit_element, only: element_arrays, scatter
  implicit none (type, external)
  private
  public :: element_tangent, element_block, element_base

contains

  !> What the frame's angle and the elastic coordinates do to one another, from el%q, el%v, el%a:
  !> col = -Z (c1 q + 2 c2 q') - 2 c2 theta' m q, row = Z (q'' - c1 q) + m ((2 c2 theta' + 2 theta'') q + 2 theta' q'),
  !> added; and q^T m q, q^T m q'.
  subroutine element_tangent(el, w, wd, c1, c2, col, row, qmq, qmv)
    type(element_arrays), intent(inout) :: el
    real(wp), intent(in) :: w, wd            !! frame rate [rad/s] and acceleration [rad/s2]
    real(wp), intent(in) :: c1, c2           !! of the step [1/s2], [1/s]
    real(wp), intent(inout) :: col(0:), row(0:)
    real(wp), intent(out) :: qmq, qmv
    call tangent_products(el%ne, w, wd, c1, c2, el%w4, el%w6, el%l, el%q, el%v, el%a, el%f, el%g, qmq, qmv)
    call scatter(el, el%f, col)
    call scatter(el, el%g, row)
  end subroutine element_tangent

  !> The element vectors of element_tangent.
  pure subroutine tangent_products(n, w, wd, c1, c2, w4, w6, l, q, v, a, f, g, qmq, qmv)
    integer, intent(in) :: n
    real(wp), intent(in) :: w, wd, c1, c2
    real(wp), intent(in) :: w4(n), w6(n), l(n), q(n, 6), v(n, 6), a(n, 6)
    real(wp), intent(inout) :: f(n, 6), g(n, 6)
    real(wp), intent(out) :: qmq, qmv
    real(wp) :: q3, q6, v3, v6, p(6), r(6), y1, y2, y3, y4, y5, y6, x1, x2, x3, x4, x5, x6, kc, kr, kv, t
    integer :: e
    kc = -2*c2*w
    kr = 2*c2*w + 2*wd
    kv = 2*w
    qmq = 0.0_wp
    qmv = 0.0_wp
    do e = 1, n
      q3 = l(e)*q(e, 3)
      q6 = l(e)*q(e, 6)
      v3 = l(e)*v(e, 3)
      v6 = l(e)*v(e, 6)
      t = w4(e)
      p(1) = t*(140*q(e, 1) + 70*q(e, 4))
      p(4) = t*(70*q(e, 1) + 140*q(e, 4))
      p(2) = t*(156*q(e, 2) + 22*q3 + 54*q(e, 5) - 13*q6)
      p(3) = t*(22*q(e, 2) + 4*q3 + 13*q(e, 5) - 3*q6)
      p(5) = t*(54*q(e, 2) + 13*q3 + 156*q(e, 5) - 22*q6)
      p(6) = -t*(13*q(e, 2) + 3*q3 + 22*q(e, 5) - 4*q6)
      r(1) = t*(140*v(e, 1) + 70*v(e, 4))
      r(4) = t*(70*v(e, 1) + 140*v(e, 4))
      r(2) = t*(156*v(e, 2) + 22*v3 + 54*v(e, 5) - 13*v6)
      r(3) = t*(22*v(e, 2) + 4*v3 + 13*v(e, 5) - 3*v6)
      r(5) = t*(54*v(e, 2) + 13*v3 + 156*v(e, 5) - 22*v6)
      r(6) = -t*(13*v(e, 2) + 3*v3 + 22*v(e, 5) - 4*v6)
      qmq = qmq + q(e, 1)*p(1) + q(e, 2)*p(2) + q3*p(3) + q(e, 4)*p(4) + q(e, 5)*p(5) + q6*p(6)
      qmv = qmv + q(e, 1)*r(1) + q(e, 2)*r(2) + q3*r(3) + q(e, 4)*r(4) + q(e, 5)*r(5) + q6*r(6)
      y1 = -(c1*q(e, 1) + 2*c2*v(e, 1))      ! Z y of the column
      y2 = -(c1*q(e, 2) + 2*c2*v(e, 2))
      y3 = -(c1*q3 + 2*c2*v3)
      y4 = -(c1*q(e, 4) + 2*c2*v(e, 4))
      y5 = -(c1*q(e, 5) + 2*c2*v(e, 5))
      y6 = -(c1*q6 + 2*c2*v6)
      x1 = a(e, 1) - c1*q(e, 1)              ! Z x of the row
      x2 = a(e, 2) - c1*q(e, 2)
      x3 = l(e)*a(e, 3) - c1*q3
      x4 = a(e, 4) - c1*q(e, 4)
      x5 = a(e, 5) - c1*q(e, 5)
      x6 = l(e)*a(e, 6) - c1*q6
      t = w6(e)
      f(e, 1) = kc*p(1) + t*(21*y2 + 3*y3 + 9*y5 - 2*y6)
      f(e, 4) = kc*p(4) + t*(9*y2 + 2*y3 + 21*y5 - 3*y6)
      f(e, 2) = kc*p(2) - t*(21*y1 + 9*y4)
      f(e, 3) = l(e)*(kc*p(3) - t*(3*y1 + 2*y4))
      f(e, 5) = kc*p(5) - t*(9*y1 + 21*y4)
      f(e, 6) = l(e)*(kc*p(6) + t*(2*y1 + 3*y4))
      g(e, 1) = kr*p(1) + kv*r(1) + t*(21*x2 + 3*x3 + 9*x5 - 2*x6)
      g(e, 4) = kr*p(4) + kv*r(4) + t*(9*x2 + 2*x3 + 21*x5 - 3*x6)
      g(e, 2) = kr*p(2) + kv*r(2) - t*(21*x1 + 9*x4)
      g(e, 3) = l(e)*(kr*p(3) + kv*r(3) - t*(3*x1 + 2*x4))
      g(e, 5) = kr*p(5) + kv*r(5) - t*(9*x1 + 21*x4)
      g(e, 6) = l(e)*(kr*p(6) + kv*r(6) + t*(2*x1 + 3*x4))
    end do
  end subroutine tangent_products

  !> One element's part of the constant block c1 m + c2 C + K_eff (body axes).
  pure function element_base(el, e, c1, c2) result(x)
    type(element_arrays), intent(in) :: el
    integer, intent(in) :: e
    real(wp), intent(in) :: c1, c2           !! [1/s2], [1/s]
    real(wp) :: x(6, 6)
    x = (c1 + c2*el%rm(e))*el%me(:, :, e) + (el%kf(e) + c2*el%rk(e))*el%ke(:, :, e)
  end function element_base

  !> One element's part of the exact block c1 m + c2 (C - 2 theta' Z) + K_eff + geometric - theta'2 m - theta'' Z.
  pure function element_block(el, b, e, w, wd, c1, c2) result(x)
    type(element_arrays), intent(in) :: el
    type(body_model), intent(in) :: b
    integer, intent(in) :: e
    real(wp), intent(in) :: w, wd            !! [rad/s], [rad/s2]
    real(wp), intent(in) :: c1, c2
    real(wp) :: x(6, 6)
    x = (c1 + c2*el%rm(e) - w**2)*el%me(:, :, e) + (el%kf(e) + c2*el%rk(e))*el%ke(:, :, e) &
        - (2*c2*w + wd)*el%ze(:, :, e)
    if (el%stiffening) x = x + stiffening_block(el, b, e)
  end function element_block

  !> Geometric part of an element with stiffening, at el%q: K_t - K_linear.
  pure function stiffening_block(el, b, e) result(x)
    type(element_arrays), intent(in) :: el
    type(body_model), intent(in) :: b
    integer, intent(in) :: e
    real(wp) :: x(6, 6), t(3, 6), bp(6), be(6), bq(6), psi, p1, p2, n, s
    integer :: j
    t = deformation_matrix(b%elements(e))
    bp = [el%s(e), -el%c(e), 0.0_wp, -el%s(e), el%c(e), 0.0_wp]*el%il(e)     ! psi = bp q
    psi = (el%q(e, 5) - el%q(e, 2))*el%il(e)
    p1 = el%q(e, 3) - psi
    p2 = el%q(e, 6) - psi
    s = el%l(e)/30
    n = el%q(e, 4) - el%q(e, 1) + el%l(e)*(0.5_wp*psi**2 + (2*p1**2 - p1*p2 + 2*p2**2)/30)
    n = el%ea(e)*(el%kf(e)*n - el%hs(1, e))
    be = t(1, :)
    bq = el%l(e)*psi*bp + s*((4*p1 - p2)*t(2, :) + (4*p2 - p1)*t(3, :))      ! gradient of the quadratic strain
    do j = 1, 6
      x(:, j) = el%ea(e)*el%kf(e)*(be*bq(j) + bq*(be(j) + bq(j))) &
                + n*(el%l(e)*bp*bp(j) + s*(4*t(2, :)*t(2, j) + 4*t(3, :)*t(3, j) - t(2, :)*t(3, j) - t(3, :)*t(2, j)))
    end do
  end function stiffening_block
end module implicit_element_tangent
