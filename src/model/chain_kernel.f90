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
    real(wp), intent(in) :: factors(10, ne)
    real(wp), intent(in) :: qx(0:nf)        !! coordinates, entry 0 is zero
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
  pure subroutine chain_forces(ne, nd, nf, edof, factors, ds, thetad, qx, vx, fx, tx, qmq, qmv)
    integer, intent(in) :: ne, nd, nf
    integer, intent(in) :: edof(6, ne)
    real(wp), intent(in) :: factors(10, ne)
    real(wp), intent(in) :: ds(nd, ne)      !! deformations with GHM differences
    real(wp), intent(in) :: thetad          !! [rad/s]
    real(wp), intent(in) :: qx(0:nf), vx(0:nf)          !! coordinates and rates, entry 0 is zero
    real(wp), intent(inout) :: fx(0:nf), tx(0:nf)       !! entry 0 is thrown away
    real(wp), intent(out) :: qmq, qmv       !! q^T m q [kg m2], q^T m q' [kg m2/s]
    real(wp) :: q1(3), q2(3), v1(3), v2(3)  ! u, v, l r of both nodes and their rates
    real(wp) :: m(3), m2(3), f(3), f2(3), z(3), z2(3)   ! m q, other forces and Z q of both nodes
    real(wp) :: l, il, wz, wzl, n, p1, p2, s, w2
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
      l = factors(1, e)
      q1 = q2                               ! rotations as they are so far
      v1 = v2
      q2 = [qx(edof(4, e)), qx(edof(5, e)), qx(edof(6, e))]
      v2 = [vx(edof(4, e)), vx(edof(5, e)), vx(edof(6, e))]
      associate (u1 => q1(1), w1 => q1(2), r1 => l*q1(3), u2 => q2(1), w22 => q2(2), r2 => l*q2(3))
        m(1) = m2(1) + factors(3, e)*(2*u1 + u2)
        m2(1) = factors(3, e)*(u1 + 2*u2)
        m(2) = m2(2) + factors(4, e)*(156*w1 + 54*w22 + (22*r1 - 13*r2))
        m2(2) = factors(4, e)*(54*w1 + 156*w22 + (13*r1 - 22*r2))
        m(3) = m2(3) + factors(5, e)*(22*w1 + 13*w22 + (4*r1 - 3*r2))
        m2(3) = -factors(5, e)*(13*w1 + 22*w22 + (3*r1 - 4*r2))
        wz = factors(6, e)
        wzl = factors(7, e)
        z(1) = z2(1) + wz*(21*w1 + 9*w22 + (3*r1 - 2*r2))
        z2(1) = wz*(9*w1 + 21*w22 + (2*r1 - 3*r2))
        z(2) = z2(2) - wz*(21*u1 + 9*u2)
        z2(2) = -wz*(9*u1 + 21*u2)
        z(3) = z2(3) - wzl*(3*u1 + 2*u2)
        z2(3) = wzl*(2*u1 + 3*u2)
      end associate
      n = 0.0_wp
      if (nd == 3) n = factors(8, e)*ds(1, e)
      p1 = factors(10, e)*(2*ds(nd - 1, e) + ds(nd, e))
      p2 = factors(10, e)*(ds(nd - 1, e) + 2*ds(nd, e))
      il = factors(2, e)
      s = (p1 + p2)*il
      wz = 2*thetad*wz
      wzl = 2*thetad*wzl
      associate (u1 => v1(1), w1 => v1(2), r1 => l*v1(3), u2 => v2(1), w22 => v2(2), r2 => l*v2(3))
        f(1) = f2(1) + wz*(21*w1 + 9*w22 + (3*r1 - 2*r2)) + n
        f2(1) = wz*(9*w1 + 21*w22 + (2*r1 - 3*r2)) - n
        f(2) = f2(2) - wz*(21*u1 + 9*u2) - s
        f2(2) = s - wz*(9*u1 + 21*u2)
        f(3) = f2(3) - wzl*(3*u1 + 2*u2) - p1
        f2(3) = wzl*(2*u1 + 3*u2) - p2
      end associate
      call add_node(nf, edof(1, e), w2, q1, v1, m, f, z, fx, tx, qmq, qmv)
    end do
    call add_node(nf, edof(4, ne), w2, q2, v2, m2, f2, z2, fx, tx, qmq, qmv)
  end subroutine chain_forces

  !> Adds a node's sums to the body's vectors.
  pure subroutine add_node(nf, dof, w2, q, v, m, f, z, fx, tx, qmq, qmv)
    integer, intent(in) :: nf
    integer, intent(in) :: dof(3)
    real(wp), intent(in) :: w2              !! theta'^2 [rad2/s2]
    real(wp), intent(in) :: q(3), v(3), m(3), f(3), z(3)
    real(wp), intent(inout) :: fx(0:nf), tx(0:nf)
    real(wp), intent(inout) :: qmq, qmv
    qmq = qmq + (q(1)*m(1) + q(2)*m(2) + q(3)*m(3))
    qmv = qmv + (v(1)*m(1) + v(2)*m(2) + v(3)*m(3))
    fx(dof(1)) = fx(dof(1)) + (w2*m(1) + f(1))
    fx(dof(2)) = fx(dof(2)) + (w2*m(2) + f(2))
    fx(dof(3)) = fx(dof(3)) + (w2*m(3) + f(3))
    tx(dof(1)) = tx(dof(1)) - z(1)
    tx(dof(2)) = tx(dof(2)) - z(2)
    tx(dof(3)) = tx(dof(3)) - z(3)
  end subroutine add_node
end module chain_kernel
