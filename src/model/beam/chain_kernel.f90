!> The element loop of a straight beam whose elements follow one another, with linear strain: what a node shares with the
!> next element stays in registers, axial and bending terms are written apart, constants come ready from the set-up.
!> Factors of an element, in this order: l [m], 1/l [1/m], w/6 [kg], w/420 [kg], w l/420 [kg m], w/60 [kg],
!> w l/60 [kg m], EA/l [N/m], EI/l [N m], 2 EI/l [N m], w its mass.
module chain_kernel
  use kinds, only: wp
  implicit none (type, external)
  private
  public :: chain_deformations, chain_forces, element_factors

contains

  !> The factors of one element.
  pure function element_factors(length, mass, ea_l, ei_l) result(f)
    real(wp), intent(in) :: length          !! [m]
    real(wp), intent(in) :: mass            !! [kg]
    real(wp), intent(in) :: ea_l            !! [N/m]
    real(wp), intent(in) :: ei_l            !! [N m]
    real(wp) :: f(10)
    f = [length, 1.0_wp/length, mass/6, mass/420, mass*length/420, mass/60, mass*length/60, ea_l, ei_l, 2*ei_l]
  end function element_factors

  !> Deformations of every element (theory.md, section 4).
  pure subroutine chain_deformations(ne, nd, nf, edof, factors, qx, d)
    integer, intent(in) :: ne, nd, nf
    integer, intent(in) :: edof(6, ne)
    real(wp), intent(in) :: factors(10, ne) !! constants of the elements, units in the header [m, kg, N m, ...]
    real(wp), intent(in) :: qx(0:nf)        !! coordinates, entry 0 is zero [m, rad]
    real(wp), intent(inout) :: d(nd, ne)    !! [m, rad, rad]
    real(wp) :: psi
    integer :: e
    if (nd == 3) then
      do e = 1, ne
        psi = (qx(edof(5, e)) - qx(edof(2, e)))*factors(2, e)
        d(1, e) = qx(edof(4, e)) - qx(edof(1, e))
        d(2, e) = qx(edof(3, e)) - psi
        d(3, e) = qx(edof(6, e)) - psi
      end do
    else
      do e = 1, ne
        psi = (qx(edof(5, e)) - qx(edof(2, e)))*factors(2, e)
        d(1, e) = qx(edof(3, e)) - psi
        d(2, e) = qx(edof(6, e)) - psi
      end do
    end if
  end subroutine chain_deformations

  !> Adds theta'^2 m q + 2 theta' Z q' - dV/dq to fx and -Z q to tx (theory.md, sections 2 to 4); one node a turn.
  pure subroutine chain_forces(ne, nd, nf, edof, factors, ds, thetad, qx, vx, elastic_force, angle_coupling, qmq, qmv)
    integer, intent(in) :: ne, nd, nf
    integer, intent(in) :: edof(6, ne)
    real(wp), intent(in) :: factors(10, ne) !! constants of the elements, units in the header [m, kg, N m, ...]
    real(wp), intent(in) :: ds(nd, ne)      !! deformations with terms' differences [m, rad, rad]
    real(wp), intent(in) :: thetad          !! [rad/s]
    real(wp), intent(in) :: qx(0:nf), vx(0:nf)          !! coordinates and rates, entry 0 is zero [m, rad], [m/s, rad/s]
    real(wp), intent(inout) :: elastic_force(0:nf)   !! Q_f, entry 0 is thrown away [N, N m]
    real(wp), intent(inout) :: angle_coupling(0:nf)  !! m_theta_f, likewise [kg m, kg m2]
    real(wp), intent(out) :: qmq, qmv       !! q^T m q [kg m2], q^T m q' [kg m2/s]
    real(wp) :: q1(3), q2(3), v1(3), v2(3)  ! coordinates of both nodes and their rates
    real(wp) :: m(3), m2(3), f(3), f2(3), z(3), z2(3)   ! m q, other forces and Z q of both nodes
    real(wp) :: w2
    integer :: e
    w2 = thetad**2
    qmq = 0.0_wp
    qmv = 0.0_wp
    m2 = 0.0_wp
    f2 = 0.0_wp
    z2 = 0.0_wp
    q2 = [qx(edof(1, 1)), qx(edof(2, 1)), qx(edof(3, 1))]
    v2 = [vx(edof(1, 1)), vx(edof(2, 1)), vx(edof(3, 1))]
    do e = 1, ne
      q1 = q2
      v1 = v2
      q2 = [qx(edof(4, e)), qx(edof(5, e)), qx(edof(6, e))]
      v2 = [vx(edof(4, e)), vx(edof(5, e)), vx(edof(6, e))]
      call mass_products(factors(:, e), q1, q2, m, m2)
      call gyroscopic_products(1.0_wp, factors(:, e), q1, q2, z, z2)
      call gyroscopic_products(2*thetad, factors(:, e), v1, v2, f, f2)
      call add_elastic(nd, factors(:, e), ds(:, e), f, f2)
      call add_node(nf, edof(1, e), w2, q1, v1, m, f, z, elastic_force, angle_coupling, qmq, qmv)
    end do
    call add_node(nf, edof(4, ne), w2, q2, v2, m2, f2, z2, elastic_force, angle_coupling, qmq, qmv)
  end subroutine chain_forces

  !> Adds to the sums of the element's first node, which the element before began, and begins those of its second: m x.
  pure subroutine mass_products(factors, x1, x2, y1, y2)
    real(wp), intent(in) :: factors(10)     !! constants of the element, units in the header [m, kg, N m, ...]
    real(wp), intent(in) :: x1(3), x2(3)    !! u [m], v [m], rotation [rad] of both nodes
    real(wp), intent(out) :: y1(3)          !! [kg m], [kg m], [kg m2]
    real(wp), intent(inout) :: y2(3)        !! on entry of the first node, then of the second [kg m], [kg m], [kg m2]
    real(wp) :: r1, r2
    r1 = factors(1)*x1(3)
    r2 = factors(1)*x2(3)
    y1(1) = y2(1) + factors(3)*(2*x1(1) + x2(1))
    y2(1) = factors(3)*(x1(1) + 2*x2(1))
    y1(2) = y2(2) + factors(4)*(156*x1(2) + 54*x2(2) + (22*r1 - 13*r2))
    y2(2) = factors(4)*(54*x1(2) + 156*x2(2) + (13*r1 - 22*r2))
    y1(3) = y2(3) + factors(5)*(22*x1(2) + 13*x2(2) + (4*r1 - 3*r2))
    y2(3) = -factors(5)*(13*x1(2) + 22*x2(2) + (3*r1 - 4*r2))
  end subroutine mass_products

  !> The same of c Z x (theory.md, section 2).
  pure subroutine gyroscopic_products(c, factors, x1, x2, y1, y2)
    real(wp), intent(in) :: c               !! [-], or twice the frame's rate [rad/s]
    real(wp), intent(in) :: factors(10)     !! constants of the element, units in the header [m, kg, N m, ...]
    real(wp), intent(in) :: x1(3), x2(3)    !! of both nodes: coordinates or rates [m, rad] or [m/s, rad/s]
    real(wp), intent(out) :: y1(3)          !! of the first node [kg m, kg m2], or [N, N m] with a rate
    real(wp), intent(inout) :: y2(3)        !! on entry of the first node, then of the second [as y1]
    real(wp) :: r1, r2, wz, wzl
    r1 = factors(1)*x1(3)
    r2 = factors(1)*x2(3)
    wz = c*factors(6)
    wzl = c*factors(7)
    y1(1) = y2(1) + wz*(21*x1(2) + 9*x2(2) + (3*r1 - 2*r2))
    y2(1) = wz*(9*x1(2) + 21*x2(2) + (2*r1 - 3*r2))
    y1(2) = y2(2) - wz*(21*x1(1) + 9*x2(1))
    y2(2) = -wz*(9*x1(1) + 21*x2(1))
    y1(3) = y2(3) - wzl*(3*x1(1) + 2*x2(1))
    y2(3) = wzl*(2*x1(1) + 3*x2(1))
  end subroutine gyroscopic_products

  !> Adds the elastic forces -B^T D d of one element to those of its nodes (theory.md, section 4).
  pure subroutine add_elastic(nd, factors, ds, y1, y2)
    integer, intent(in) :: nd               !! 3, or 2 without axial deformation
    real(wp), intent(in) :: factors(10)     !! constants of the element, units in the header [m, kg, N m, ...]
    real(wp), intent(in) :: ds(nd)          !! deformations with terms' differences [m, rad, rad]
    real(wp), intent(inout) :: y1(3), y2(3) !! [N], [N], [N m]
    real(wp) :: n, p1, p2, s                ! normal force [N], end moments [N m], transverse force [N]
    n = 0.0_wp
    if (nd == 3) n = factors(8)*ds(1)
    p1 = factors(10)*(2*ds(nd - 1) + ds(nd))
    p2 = factors(10)*(ds(nd - 1) + 2*ds(nd))
    s = (p1 + p2)*factors(2)
    y1(1) = y1(1) + n
    y2(1) = y2(1) - n
    y1(2) = y1(2) - s
    y2(2) = y2(2) + s
    y1(3) = y1(3) - p1
    y2(3) = y2(3) - p2
  end subroutine add_elastic

  !> Adds a node's sums to the body's vectors.
  pure subroutine add_node(nf, dof, w2, q, v, m, f, z, elastic_force, angle_coupling, qmq, qmv)
    integer, intent(in) :: nf
    integer, intent(in) :: dof(3)
    real(wp), intent(in) :: w2              !! theta'^2 [rad2/s2]
    real(wp), intent(in) :: q(3), v(3), m(3), f(3), z(3)   !! of the node [m, rad], [m/s, rad/s], [kg m], [N], [kg m]
    real(wp), intent(inout) :: elastic_force(0:nf)   !! Q_f, entry 0 is thrown away [N, N m]
    real(wp), intent(inout) :: angle_coupling(0:nf)  !! m_theta_f, likewise [kg m, kg m2]
    real(wp), intent(inout) :: qmq, qmv                    !! sums q^T m q [kg m2], q^T m q' [kg m2/s]
    qmq = qmq + (q(1)*m(1) + q(2)*m(2) + q(3)*m(3))
    qmv = qmv + (v(1)*m(1) + v(2)*m(2) + v(3)*m(3))
    elastic_force(dof(1)) = elastic_force(dof(1)) + (w2*m(1) + f(1))
    elastic_force(dof(2)) = elastic_force(dof(2)) + (w2*m(2) + f(2))
    elastic_force(dof(3)) = elastic_force(dof(3)) + (w2*m(3) + f(3))
    angle_coupling(dof(1)) = angle_coupling(dof(1)) - z(1)
    angle_coupling(dof(2)) = angle_coupling(dof(2)) - z(2)
    angle_coupling(dof(3)) = angle_coupling(dof(3)) - z(3)
  end subroutine add_node
end module chain_kernel
