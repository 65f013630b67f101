!> Generalised elastic forces of a flexible body in nodal coordinates, element by element, with GHM in deformation
!> space. One pass computes the deformations, one the dissipative coordinates, one the forces. Nothing is allocated and
!> nothing is virtual inside a loop; beams of linear strain take the short way of `chain_kernel`.
module nodal_kernel
  use kinds, only: wp
  use body, only: body_model
  use chain_kernel, only: chain_deformations, chain_forces
  use elastic_operators, only: inertia_forces, damping_forces
  use ghm_kernel, only: advance_segment, relax_segment, segment_dissipation, copy_values
  implicit none (type, external)
  private
  public :: nodal_forces, deformations, linear_deformations, element_stress, add_stress

contains

  !> Adds to b%fx: theta'^2 m q + 2 theta' Z q' - dV/dq - C q' - GHM; sets b%tx = -Z q (theory.md, section 3).
  !> On entry b%qx, b%vx hold the coordinates and rates. Lumps included.
  subroutine nodal_forces(b, edof, factors, z, zd, thetad, zdd, qmq, qmv, power)
    type(body_model), intent(inout) :: b
    integer, intent(in), contiguous :: edof(:, :)       !! of the body or of one like it: constants read for many bodies
    real(wp), intent(in), contiguous :: factors(:, :)   !! the same
    real(wp), intent(in) :: z(*), zd(*)     !! (nz) internal variables, (nzd) rates of those of second order [m, rad] and per s
    real(wp), intent(in) :: thetad          !! frame rate [rad/s]
    real(wp), intent(inout) :: zdd(*)       !! (nz) their highest derivatives [m/s2, rad/s2], [m/s, rad/s]
    real(wp), intent(out) :: qmq, qmv       !! q^T m q [kg m2] and q^T m q' [kg m2/s], translational part of m_ff
    real(wp), intent(out) :: power          !! dissipated by viscoelastic terms and Rayleigh damping [W]
    integer :: r
    power = 0.0_wp
    if (b%chain) then
      call chain_deformations(b%ne, b%nd, b%nf, edof, factors, b%qx, b%d)
    else
      call deformations(b, b%qx, b%d)
    end if
    if (size(b%segments) > 0) then
      call copy_values(size(b%d), b%d, b%ds)
      do r = 1, size(b%segments)
        associate (segment => b%segments(r))
          call advance_segment(segment, segment%width, b%d(1, segment%first), z(segment%offset + 1), zd(segment%offset + 1), &
                               zdd(segment%offset + 1), b%ds(1, segment%first))
          power = power + segment_dissipation(b, segment, 1, segment%law%second, zd(segment%offset + 1))
          if (segment%law%first == 0) cycle
          call relax_segment(segment, segment%width, b%d(1, segment%first), z(segment%first_order + 1), zdd(segment%first_order &
              + 1), b%ds(1, segment%first))
          power = power + segment_dissipation(b, segment, segment%law%second + 1, segment%law%second + segment%law%first, &
                                              zdd(segment%first_order + 1))
        end associate
      end do
      call element_forces(b, edof, factors, b%ds, thetad, qmq, qmv)
    else
      call element_forces(b, edof, factors, b%d, thetad, qmq, qmv)
    end if
    if (b%rayleigh) call damping_forces(b%op, b%nf, b%vx(1), b%elastic_force(1), power)
  end subroutine nodal_forces

  !> Deformations (e, phi1, phi2) of every element, or (phi1, phi2) without axial deformation.
  pure subroutine deformations(b, qx, d)
    type(body_model), intent(in) :: b
    real(wp), intent(in), contiguous :: qx(0:)      !! (0:nf) coordinates, entry 0 is zero
    real(wp), intent(inout), contiguous :: d(:, :)  !! (nd, ne) [m, rad, rad]
    real(wp) :: a(6), psi
    integer :: e
    if (b%chain) then
      call chain_deformations(b%ne, b%nd, b%nf, b%edof, b%factors, qx, d)
      return
    end if
    call linear_deformations(b, qx, d)
    if (.not. b%stiffening .or. b%nd < 3) return
    do e = 1, b%ne
      call gather(b, e, qx, a)
      psi = (a(5) - a(2))*b%factors(2, e)
      associate (p1 => d(b%nd - 1, e), p2 => d(b%nd, e))
        d(1, e) = d(1, e) + b%elements(e)%length*(0.5_wp*psi**2 + (2*p1**2 - p1*p2 + 2*p2**2)/30)
      end associate
    end do
  end subroutine deformations

  !> The same without geometric stiffening.
  pure subroutine linear_deformations(b, qx, d)
    type(body_model), intent(in) :: b
    real(wp), intent(in), contiguous :: qx(0:)      !! (0:nf) coordinates, entry 0 is zero
    real(wp), intent(inout), contiguous :: d(:, :)  !! (nd, ne) [m, rad, rad]
    real(wp) :: a(6), psi
    integer :: e
    do e = 1, b%ne
      call gather(b, e, qx, a)
      psi = (a(5) - a(2))*b%factors(2, e)
      d(b%nd - 1, e) = a(3) - psi
      d(b%nd, e) = a(6) - psi
      if (b%nd == 3) d(1, e) = a(4) - a(1)
    end do
  end subroutine linear_deformations

  !> Coordinates (or rates) of an element in its own axes.
  pure subroutine gather(b, e, x, a)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e
    real(wp), intent(in), contiguous :: x(0:)       !! (0:nf)
    real(wp), intent(out) :: a(6)
    integer :: k
    do k = 1, 6
      a(k) = x(b%edof(k, e))
    end do
    if (.not. b%straight) call to_element(b%elements(e)%c, b%elements(e)%s, a)
  end subroutine gather

  !> Turns the displacements of an element from body axes into element axes.
  pure subroutine to_element(c, s, a)
    real(wp), intent(in) :: c, s            !! of the element angle [-]
    real(wp), intent(inout) :: a(6)
    real(wp) :: u, v
    u = a(1); v = a(2)
    a(1) = c*u + s*v
    a(2) = c*v - s*u
    u = a(4); v = a(5)
    a(4) = c*u + s*v
    a(5) = c*v - s*u
  end subroutine to_element

  !> Force and end moments conjugate to the element's deformations: D ds, with the extra terms of stiffening.
  !> Returned as force along the element, the moment conjugate to the chord's turn, and the two end moments.
  pure subroutine element_stress(b, e, d, ds, n, fpsi, m1, m2)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e
    real(wp), intent(in) :: d(:)            !! (nd) deformations [m, rad, rad]
    real(wp), intent(in) :: ds(:)           !! (nd) the same with GHM differences
    real(wp), intent(out) :: n              !! conjugate to e [N]
    real(wp), intent(out) :: fpsi           !! stiffening: n/30 L, factor of the quadratic terms [N m]
    real(wp), intent(out) :: m1, m2         !! conjugate to phi1, phi2 [N m]
    real(wp) :: kb
    kb = b%elements(e)%ei_l
    n = 0.0_wp
    fpsi = 0.0_wp
    if (b%nd == 3) n = b%elements(e)%ea_l*ds(1)
    m1 = kb*(4*ds(b%nd - 1) + 2*ds(b%nd))
    m2 = kb*(2*ds(b%nd - 1) + 4*ds(b%nd))
    if (b%stiffening) then
      fpsi = n*b%elements(e)%length/30
      m1 = m1 + fpsi*(4*d(2) - d(3))
      m2 = m2 + fpsi*(4*d(3) - d(2))
    end if
  end subroutine element_stress

  !> Inertia and elastic forces: of a chain in one loop over its elements, else by the operators.
  subroutine element_forces(b, edof, factors, ds, thetad, qmq, qmv)
    type(body_model), intent(inout) :: b
    integer, intent(in), contiguous :: edof(:, :)       !! as above
    real(wp), intent(in), contiguous :: factors(:, :)   !! as above [m, kg, N m, ...]
    real(wp), intent(in), contiguous :: ds(:, :)    !! (nd, ne) deformations with GHM differences [m, rad, rad]
    real(wp), intent(in) :: thetad          !! [rad/s]
    real(wp), intent(out) :: qmq, qmv       !! [kg m2], [kg m2/s]
    if (b%chain) then
      call chain_forces(b%ne, b%nd, b%nf, edof, factors, ds, thetad, b%qx, b%vx, b%elastic_force, b%angle_coupling, qmq, qmv)
      call lump_forces(b, thetad, qmq, qmv)
    else
      call inertia_forces(b%op, b%nf, thetad, b%qx(1), b%vx(1), b%elastic_force(1), b%angle_coupling(1), qmq, qmv)
      call add_stress(b, ds, b%qx, -1.0_wp, b%elastic_force)
    end if
  end subroutine element_forces

  !> Adds B^T D ds of all elements, with the terms of stiffening, times a factor to f: forces that the deformations ask for.
  pure subroutine add_stress(b, ds, qx, factor, f)
    type(body_model), intent(in) :: b
    real(wp), intent(in), contiguous :: ds(:, :)    !! (nd, ne) deformations, GHM differences included [m, rad, rad]
    real(wp), intent(in), contiguous :: qx(0:)      !! (0:nf) coordinates, entry 0 is zero [m, rad]
    real(wp), intent(in) :: factor                  !! 1, or -1 for forces that they exert [-]
    real(wp), intent(inout), contiguous :: f(0:)    !! (0:nf) [N, N m], entry 0 is thrown away
    real(wp) :: y(6), a(6), n, fpsi, m1, m2, q
    integer :: e, k
    do e = 1, b%ne
      call element_stress(b, e, b%d(:, e), ds(:, e), n, fpsi, m1, m2)
      q = (m1 + m2)*b%factors(2, e)
      if (b%stiffening) then
        call gather(b, e, qx, a)
        q = q - n*(a(5) - a(2))*b%factors(2, e)
      end if
      y = [-n, q, m1, n, -q, m2]
      if (.not. b%straight) call to_element(b%elements(e)%c, -b%elements(e)%s, y)
      do k = 1, 6
        f(b%edof(k, e)) = f(b%edof(k, e)) + factor*y(k)
      end do
    end do
  end subroutine add_stress

  !> Lumps on a chain: theta'^2 mu u, 2 theta' mu H^T-terms; their rotary inertia belongs to m_ff alone.
  subroutine lump_forces(b, thetad, qmq, qmv)
    type(body_model), intent(inout) :: b
    real(wp), intent(in) :: thetad          !! [rad/s]
    real(wp), intent(inout) :: qmq, qmv
    real(wp) :: u(2), v(2), mu
    integer :: k, i, j
    do k = 1, size(b%lumps)
      i = b%dof(1, b%lumps(k)%node)
      j = b%dof(2, b%lumps(k)%node)
      mu = b%lumps(k)%mass
      u(1) = b%qx(i)
      u(2) = b%qx(j)
      v(1) = b%vx(i)
      v(2) = b%vx(j)
      qmq = qmq + mu*dot_product(u, u)
      qmv = qmv + mu*dot_product(u, v)
      b%elastic_force(i) = b%elastic_force(i) + mu*(thetad**2*u(1) + 2*thetad*v(2))
      b%elastic_force(j) = b%elastic_force(j) + mu*(thetad**2*u(2) - 2*thetad*v(1))
      b%angle_coupling(i) = b%angle_coupling(i) - mu*u(2)
      b%angle_coupling(j) = b%angle_coupling(j) + mu*u(1)
    end do
  end subroutine lump_forces
end module nodal_kernel
