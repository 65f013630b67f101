!> Residual and tangent of one body for the implicit method. Unknowns: eta = A^T dR, dtheta, dq_f; the elastic block
!> B = c1 m_ff + c2 (C - 2 theta' Z) + K_eff - theta'2 m - theta'' Z is banded, the frame borders it (theory.md, section 7).
!> Derivatives of the inertia residuals
!>
!>   F_R = m b + H p theta'' - theta'2 p + 2 theta' H S q' + S q''          b = A^T (R'' - g), p = I1 + S q
!>   F_theta = (H p).b + m_tt theta'' + 2 theta' (I1f q' + q^T m q') + m_tf q''
!>   F_f = S^T b + m_tf^T theta'' - theta'2 (I1f^T + m q) - 2 theta' Z q' + m_ff q'' + elastic
module implicit_bodies
  use kinds, only: wp
  use body, only: body_model
  use generalized_alpha, only: alpha_step
  use implicit_element, only: gather, element_residual
  use implicit_element_tangent, only: element_tangent
  use implicit_model, only: implicit_body
  implicit none (type, external)
  private
  public :: body_residual, body_tangent

contains

  !> Inertia, elastic and damping residual of a body at the trial state, in body axes: t%rr and t%ff.
  subroutine body_residual(t, bo, q, v, a, b)
    type(implicit_body), intent(inout) :: t
    type(body_model), intent(inout) :: bo
    real(wp), intent(in) :: q(:), v(:), a(:)   !! the body's own coordinates, rates, accelerations
    real(wp), intent(in) :: b(2)               !! A^T (R'' - g) [m/s2]
    real(wp) :: p(2), sv(2), sa(2), w, wd, qmx, ix, ca, x
    integer :: k, n
    w = v(3)
    wd = a(3)
    n = t%nf
    p = bo%i1
    if (n == 0) then
      t%rr(1) = bo%mass*b(1) - wd*p(2) - w**2*p(1)
      t%rr(2) = bo%mass*b(2) + wd*p(1) - w**2*p(2)
      t%rr(3) = p(1)*b(2) - p(2)*b(1) + bo%i11*wd
      return
    end if
    sv = 0.0_wp
    sa = 0.0_wp
    ix = 0.0_wp
    ca = 0.0_wp
    do k = 1, n
      p = p + bo%sbar(k, :)*q(3 + k)
      sv = sv + bo%sbar(k, :)*v(3 + k)
      sa = sa + bo%sbar(k, :)*a(3 + k)
      ix = ix + bo%i1f(k)*(2*w*v(3 + k) + 2*wd*q(3 + k))
      ca = ca + bo%c0(k)*a(3 + k)
      t%ff(k) = bo%sbar(k, 1)*b(1) + bo%sbar(k, 2)*b(2) + bo%c0(k)*wd - w**2*bo%i1f(k)
    end do
    if (bo%modal) then
      call modal_residual(t, bo, q(4:), v(4:), a(4:), w, wd, qmx)
    else
      call load_elements(t, q(4:), v(4:), a(4:))
      call element_residual(t%el, w, wd, t%ff, qmx)
      do k = 1, size(bo%lumps)
        call lump_residual(t, bo, k, w, wd, q, v, a, x)
        qmx = qmx + x
      end do
    end if
    t%rr(1) = bo%mass*b(1) - wd*p(2) - w**2*p(1) - 2*w*sv(2) + sa(1)
    t%rr(2) = bo%mass*b(2) + wd*p(1) - w**2*p(2) + 2*w*sv(1) + sa(2)
    t%rr(3) = p(1)*b(2) - p(2)*b(1) + bo%i11*wd + ix + ca + qmx
  end subroutine body_residual

  !> Coordinates, rates and accelerations of all elements.
  subroutine load_elements(t, q, v, a)
    type(implicit_body), intent(inout) :: t
    real(wp), intent(in) :: q(:), v(:), a(:)   !! (nf)
    t%x(1:t%nf) = q(1:t%nf)
    call gather(t%el, t%x, t%el%q)
    t%x(1:t%nf) = v(1:t%nf)
    call gather(t%el, t%x, t%el%v)
    t%x(1:t%nf) = a(1:t%nf)
    call gather(t%el, t%x, t%el%a)
  end subroutine load_elements

  !> A lump's part of the residual.
  pure subroutine lump_residual(t, bo, k, w, wd, q, v, a, qmx)
    type(implicit_body), intent(inout) :: t
    type(body_model), intent(in) :: bo
    integer, intent(in) :: k                   !! lump
    real(wp), intent(in) :: w, wd              !! [rad/s], [rad/s2]
    real(wp), intent(in) :: q(:), v(:), a(:)   !! the body's own
    real(wp), intent(out) :: qmx               !! q^T m (2 theta' q' + theta'' q) + q^T Z q''
    real(wp) :: x(2), y(2), mu
    integer :: i, j, r
    i = bo%dof(1, bo%lumps(k)%node)
    j = bo%dof(2, bo%lumps(k)%node)
    r = bo%dof(3, bo%lumps(k)%node)
    mu = bo%lumps(k)%mass
    x = 0.0_wp
    y = 0.0_wp
    qmx = 0.0_wp
    if (i > 0) then
      x(1) = a(3 + i) - w**2*q(3 + i)
      y(1) = 2*w*v(3 + i) + wd*q(3 + i)
      qmx = qmx + mu*q(3 + i)*y(1)
    end if
    if (j > 0) then
      x(2) = a(3 + j) - w**2*q(3 + j)
      y(2) = 2*w*v(3 + j) + wd*q(3 + j)
      qmx = qmx + mu*q(3 + j)*y(2)
    end if
    if (i > 0 .and. j > 0) qmx = qmx + mu*(q(3 + i)*a(3 + j) - q(3 + j)*a(3 + i))
    t%ff(i) = t%ff(i) + mu*(x(1) - y(2))
    t%ff(j) = t%ff(j) + mu*(x(2) + y(1))
    if (r > 0) t%ff(r) = t%ff(r) + bo%lumps(k)%inertia*a(3 + r)
  end subroutine lump_residual

  !> The modal twin: m_ff = 1, its translational part 1 - J.
  pure subroutine modal_residual(t, bo, q, v, a, w, wd, qmx)
    type(implicit_body), intent(inout) :: t
    type(body_model), intent(in) :: bo
    real(wp), intent(in) :: q(:), v(:), a(:)   !! (nf)
    real(wp), intent(in) :: w, wd
    real(wp), intent(out) :: qmx
    real(wp) :: y
    integer :: i, j
    qmx = 0.0_wp
    do i = 1, t%nf
      t%ff(i) = t%ff(i) + a(i) - w**2*q(i) - t%hm(i)
      qmx = qmx + q(i)*(2*w*v(i) + wd*q(i))
    end do
    do j = 1, t%nf
      y = 2*w*v(j) + wd*q(j)
      do i = 1, t%nf
        t%ff(i) = t%ff(i) + t%stiff(i, j)*q(j) + bo%cmodal(i, j)*v(j) - bo%zmodal(i, j)*y + bo%jmodal(i, j)*w**2*q(j)
        qmx = qmx + q(i)*(bo%zmodal(i, j)*a(j) - bo%jmodal(i, j)*y)
      end do
    end do
  end subroutine modal_residual

  !> Tangent of the frame t%trr, column t%col and row t%row of its angle, and the row of its origin, at the state of the
  !> last body_residual (whose element arrays are used).
  subroutine body_tangent(t, bo, now, q, v, a, b)
    type(implicit_body), intent(inout) :: t
    type(body_model), intent(in) :: bo
    type(alpha_step), intent(in) :: now
    real(wp), intent(in) :: q(:), v(:), a(:)   !! the body's own
    real(wp), intent(in) :: b(2)               !! [m/s2]
    real(wp) :: p(2), sv(2), sa(2), w, wd, qmq, qmv, iq, iv
    integer :: k
    w = v(3)
    wd = a(3)
    p = bo%i1
    sv = 0.0_wp
    sa = 0.0_wp
    iq = 0.0_wp
    iv = 0.0_wp
    qmq = 0.0_wp
    qmv = 0.0_wp
    do k = 1, t%nf
      p = p + bo%sbar(k, :)*q(3 + k)
      sv = sv + bo%sbar(k, :)*v(3 + k)
      sa = sa + bo%sbar(k, :)*a(3 + k)
      iq = iq + bo%i1f(k)*q(3 + k)
      iv = iv + bo%i1f(k)*v(3 + k)
      t%col(k) = now%c1*bo%c0(k) - 2*now%c2*w*bo%i1f(k) + bo%sbar(k, 1)*b(2) - bo%sbar(k, 2)*b(1)
      t%row(k) = now%c1*bo%c0(k) + (2*now%c2*w + 2*wd)*bo%i1f(k) + bo%sbar(k, 1)*b(2) - bo%sbar(k, 2)*b(1)
    end do
    if (bo%modal) then
      call modal_tangent(t, bo, now, q(4:), v(4:), a(4:), w, wd, qmq, qmv)
    else if (t%nf > 0) then
      call element_tangent(t%el, w, wd, now%c1, now%c2, t%col, t%row, qmq, qmv)
      do k = 1, size(bo%lumps)
        call lump_tangent(t, bo, k, now, w, wd, q, v, a, qmq, qmv)
      end do
    end if
    t%k1 = now%c1 - w**2
    t%k2 = 2*now%c2*w + wd
    t%trr = 0.0_wp
    t%trr(1, 1) = now%c1*bo%mass
    t%trr(2, 2) = now%c1*bo%mass
    t%trr(1, 3) = -(now%c1 - w**2)*p(2) - (2*now%c2*w + wd)*p(1) - 2*now%c2*sv(2) - 2*w*sv(1) - sa(2)
    t%trr(2, 3) = (now%c1 - w**2)*p(1) - (2*now%c2*w + wd)*p(2) + 2*now%c2*sv(1) - 2*w*sv(2) + sa(1)
    t%trr(3, 1) = -now%c1*p(2)
    t%trr(3, 2) = now%c1*p(1)
    t%trr(3, 3) = now%c1*(bo%i11 + 2*iq + qmq) + 2*now%c2*(iv + qmv) - dot_product(p, b)
  end subroutine body_tangent

  !> A lump's part of column and row.
  pure subroutine lump_tangent(t, bo, k, now, w, wd, q, v, a, qmq, qmv)
    type(implicit_body), intent(inout) :: t
    type(body_model), intent(in) :: bo
    integer, intent(in) :: k
    type(alpha_step), intent(in) :: now
    real(wp), intent(in) :: w, wd, q(:), v(:), a(:)
    real(wp), intent(inout) :: qmq, qmv
    real(wp) :: u(2), ud(2), udd(2), mu, y(2), x(2), z(2)
    integer :: i, c, d(2)
    d = bo%dof(1:2, bo%lumps(k)%node)
    mu = bo%lumps(k)%mass
    u = 0.0_wp
    ud = 0.0_wp
    udd = 0.0_wp
    do c = 1, 2
      i = d(c)
      if (i == 0) cycle
      u(c) = q(3 + i)
      ud(c) = v(3 + i)
      udd(c) = a(3 + i)
    end do
    qmq = qmq + mu*dot_product(u, u)
    qmv = qmv + mu*dot_product(u, ud)
    y = now%c1*u + 2*now%c2*ud
    x = udd - now%c1*u
    z = (2*now%c2*w + 2*wd)*u + 2*w*ud
    t%col(d(1)) = t%col(d(1)) + mu*(-y(2) - 2*now%c2*w*u(1))
    t%col(d(2)) = t%col(d(2)) + mu*(y(1) - 2*now%c2*w*u(2))
    t%row(d(1)) = t%row(d(1)) + mu*(x(2) + z(1))
    t%row(d(2)) = t%row(d(2)) + mu*(-x(1) + z(2))
  end subroutine lump_tangent

  !> The modal twin of element_tangent.
  pure subroutine modal_tangent(t, bo, now, q, v, a, w, wd, qmq, qmv)
    type(implicit_body), intent(inout) :: t
    type(body_model), intent(in) :: bo
    type(alpha_step), intent(in) :: now
    real(wp), intent(in) :: q(:), v(:), a(:)   !! (nf)
    real(wp), intent(in) :: w, wd
    real(wp), intent(out) :: qmq, qmv
    real(wp) :: z, jj, kr, kc
    integer :: i, j
    kc = -2*now%c2*w
    kr = 2*now%c2*w + 2*wd
    qmq = 0.0_wp
    qmv = 0.0_wp
    do i = 1, t%nf
      qmq = qmq + q(i)*q(i)
      qmv = qmv + q(i)*v(i)
      t%col(i) = t%col(i) + kc*q(i)
      t%row(i) = t%row(i) + kr*q(i) + 2*w*v(i)
    end do
    do j = 1, t%nf
      do i = 1, t%nf
        z = bo%zmodal(i, j)
        jj = bo%jmodal(i, j)
        t%col(i) = t%col(i) - z*(now%c1*q(j) + 2*now%c2*v(j)) - kc*jj*q(j)
        t%row(i) = t%row(i) + z*(a(j) - now%c1*q(j)) - jj*(kr*q(j) + 2*w*v(j))
        qmq = qmq - q(i)*jj*q(j)
        qmv = qmv - q(i)*jj*v(j)
      end do
    end do
  end subroutine modal_tangent
end module implicit_bodies
