!> The equations of one body at a trial state (positions, rates, accelerations), rigid, nodal or modal: residual, and tangent
!> a2 M + a1 C + a0 K in frozen axes, where dR'' = a2 dR, dR' = a1 dR and dR is resolved in the body's axes. Residual in body axes,
!> b = A^T (R'' - g), p = I1 + S q (theory.md, sections 2 to 5):
!>
!>   F_R = m b + H p theta'' - theta'2 p + 2 theta' H S q' + S q''
!>   F_theta = (H p).b + (I11 + 2 I1f q + q^T m q) theta'' + 2 theta' (I1f q' + q^T m q') + (c0 + q^T Z) q''
!>   F_f = S^T b + c0 theta'' - theta'2 I1f^T + m (q'' - theta'2 q) - Z (2 theta' q' + theta'' q) + J q'' + C q' + elastic
!>
!> The elastic coordinates' own block is left to who factors it: its inertia has the factors a2, -(2 theta' a1 + theta'' a0) and
!> -theta'2 a0 of m_ff, Z and m.
module body_terms
  use kinds, only: wp
  use body, only: body_model, elastic_work
  use elastic_operators, only: inertia_products, add_product
  use marker, only: turn
  implicit none (type, external)
  private
  public :: body_residual, body_tangent, set_up_terms

  !> Residual, tangent and work space of one body.
  type, public :: body_equations
    integer :: n = 0                         !! elastic coordinates
    real(wp), allocatable :: factor(:)       !! (segments) 1 + sum of alpha (1 - g) over a segment's terms [-]
    real(wp), allocatable :: history_strain(:, :) !! sum of alpha z0 over the terms: what they keep at zero deformation [m, rad]
    type(elastic_work) :: w                  !! coordinates and deformations of the last residual
    real(wp) :: frame(3) = 0.0_wp            !! residual of the frame [N, N, N m]
    real(wp), allocatable :: elastic(:)      !! (0:n) residual of the elastic coordinates [N, N m]
    real(wp) :: block(3, 3) = 0.0_wp         !! tangent of the frame [N/m, N, N m]
    real(wp) :: origin(2) = 0.0_wp           !! rows of the origin: origin(1) S + origin(2) H S; its columns: a2 S^T [kg/s2]
    real(wp), allocatable :: column(:)       !! (0:n) tangent of the elastic residual by the angle [N, N m]
    real(wp), allocatable :: row(:)          !! (0:n) tangent of the angle's residual by the elastic coordinates [N, N m]
    real(wp), allocatable :: x(:, :), y(:, :), mx(:, :), zy(:, :)   !! (2, n) operands and products of the inertia [m, kg m, ...]
  end type body_equations

contains

  !> Work space of a body.
  subroutine set_up_terms(t, body)
    type(body_equations), intent(out) :: t
    type(body_model), intent(in) :: body
    if (.not. body%flexible) return
    t%n = body%nf
    allocate (t%factor(size(body%segments)), source=1.0_wp)
    call t%w%allocate(body)
    t%history_strain = t%w%d
    allocate (t%elastic(0:body%nf), t%column(0:body%nf), t%row(0:body%nf), t%x(2, body%nf), t%y(2, body%nf), t%mx(2, body%nf), &
              t%zy(2, body%nf), source=0.0_wp)
  end subroutine set_up_terms

  !> The residual without what acts on markers.
  subroutine body_residual(t, body, q, v, a, b)
    type(body_equations), intent(inout) :: t
    type(body_model), intent(in) :: body
    real(wp), intent(in), contiguous :: q(:)     !! (3 + n) the body's coordinates [m, rad, ...]
    real(wp), intent(in), contiguous :: v(:)     !! (3 + n) rates [m/s, rad/s, ...]
    real(wp), intent(in), contiguous :: a(:)     !! (3 + n) accelerations [m/s2, rad/s2, ...]
    real(wp), intent(in) :: b(2)                 !! A^T (R'' - g) [m/s2]
    real(wp) :: p(2), hp(2), sq(2), sv(2), sa(2), w, wd, turning
    integer :: k
    w = v(3)
    wd = a(3)
    p = body%i1
    hp = turn(body%i1)
    sv = 0.0_wp
    sa = 0.0_wp
    turning = body%i11*wd
    if (t%n > 0) then
      associate (shape => body%shape)
        sq = 0.0_wp
        t%elastic = 0.0_wp
        if (body%rayleigh) call add_product(body%op%symmetric, body%op%c, v(4:), t%elastic(1:))
        call add_elastic(t, body, q(4:))
        do k = 1, t%n
          t%y(1, k) = 2*w*v(3 + k) + wd*q(3 + k)
          t%y(2, k) = a(3 + k)
          t%x(1, k) = t%y(2, k) - w**2*q(3 + k)
          t%x(2, k) = t%y(1, k)
        end do
        call inertia_products(body%op, t%n, t%x, t%y, t%mx, t%zy)
        do k = 1, t%n
          sq = sq + shape%sbar(k, :)*q(3 + k)
          sv = sv + shape%sbar(k, :)*v(3 + k)
          sa = sa + shape%sbar(k, :)*t%y(2, k)
          turning = turning + shape%c0(k)*t%y(2, k) + 2*shape%i1f(k)*(w*v(3 + k) + wd*q(3 + k)) &
                    + q(3 + k)*(t%mx(2, k) + t%zy(2, k))
          t%elastic(k) = t%elastic(k) + shape%sbar(k, 1)*b(1) + shape%sbar(k, 2)*b(2) + shape%c0(k)*wd &
                         - w**2*shape%i1f(k) + t%mx(1, k) - t%zy(1, k)
        end do
        if (body%op%rotary) call add_product(body%op%symmetric, body%op%j, t%y(2, :), t%elastic(1:))
        p = p + sq
        hp = hp + turn(sq)
      end associate
    end if
    t%frame(1:2) = body%mass*b + wd*hp - w**2*p + 2*w*turn(sv) + sa
    t%frame(3) = dot_product(hp, b) + turning
  end subroutine body_residual

  !> Adds the elastic forces with those of the viscoelastic terms, condensed.
  subroutine add_elastic(t, body, q)
    type(body_equations), intent(inout) :: t
    type(body_model), intent(in) :: body
    real(wp), intent(in) :: q(:)                 !! (n) elastic coordinates [m, rad, ...]
    integer :: r, e
    t%w%q(1:) = q
    call body%basis%deform(body, t%w%q, t%w%d)
    t%w%ds = t%w%d
    do r = 1, size(body%segments)
      do e = body%segments(r)%first, body%segments(r)%last
        t%w%ds(:, e) = t%factor(r)*t%w%d(:, e) - t%history_strain(:, e)
      end do
    end do
    call body%basis%add_stress(body, t%w%d, t%w%ds, t%w%q, 1.0_wp, t%elastic)
  end subroutine add_elastic

  !> The tangent a2 M + a1 C + a0 K of the frame, and of what couples the angle and the elastic coordinates; markers' parts not.
  subroutine body_tangent(t, body, a2, a1, a0, q, v, a, b)
    type(body_equations), intent(inout) :: t
    type(body_model), intent(in) :: body
    real(wp), intent(in) :: a2                   !! [1/s2] where the tangent is to be a stiffness
    real(wp), intent(in) :: a1                   !! [1/s] likewise
    real(wp), intent(in) :: a0                   !! [-] likewise
    real(wp), intent(in), contiguous :: q(:), v(:), a(:)   !! (3 + n) as in body_residual [m, rad, ...]
    real(wp), intent(in) :: b(2)                 !! [m/s2]
    real(wp) :: p(2), sv(2), sa(2), w, wd, mtt, mttd
    integer :: k
    w = v(3)
    wd = a(3)
    p = body%i1
    sv = 0.0_wp
    sa = 0.0_wp
    mtt = body%i11
    mttd = 0.0_wp
    t%origin = [a2 - a0*w**2, 2*a1*w + a0*wd]
    if (t%n > 0) then
      do k = 1, t%n
        t%x(1, k) = q(3 + k)
        t%x(2, k) = v(3 + k)
        t%y(1, k) = a2*q(3 + k) + 2*a1*v(3 + k)
        t%y(2, k) = a0*a(3 + k) - a2*q(3 + k)
      end do
      call inertia_products(body%op, t%n, t%x, t%y, t%mx, t%zy)
      associate (sbar => body%shape%sbar, i1f => body%shape%i1f, c0 => body%shape%c0)
        do k = 1, t%n
          p = p + sbar(k, :)*q(3 + k)
          sv = sv + sbar(k, :)*v(3 + k)
          sa = sa + sbar(k, :)*a(3 + k)
          mtt = mtt + q(3 + k)*(2*i1f(k) + t%mx(1, k))
          mttd = mttd + 2*(i1f(k)*v(3 + k) + q(3 + k)*t%mx(2, k))
          associate (both => a2*c0(k) + a0*(sbar(k, 1)*b(2) - sbar(k, 2)*b(1)), centrifugal => i1f(k) &
                     + t%mx(1, k))
            t%column(k) = both - 2*a1*w*centrifugal - t%zy(1, k)
            t%row(k) = both + 2*(a1*w + a0*wd)*centrifugal + 2*a0*w*t%mx(2, k) + t%zy(2, k)
          end associate
        end do
      end associate
    end if
    t%block = 0.0_wp
    t%block(1, 1) = a2*body%mass
    t%block(2, 2) = a2*body%mass
    t%block(1, 3) = -t%origin(1)*p(2) - t%origin(2)*p(1) - 2*a1*sv(2) - a0*(2*w*sv(1) + sa(2))
    t%block(2, 3) = t%origin(1)*p(1) - t%origin(2)*p(2) + 2*a1*sv(1) - a0*(2*w*sv(2) - sa(1))
    t%block(3, 1) = -a2*p(2)
    t%block(3, 2) = a2*p(1)
    t%block(3, 3) = a2*mtt + a1*mttd - a0*dot_product(p, b)
  end subroutine body_tangent

end module body_terms
