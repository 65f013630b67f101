!> Generalised elastic forces of a flexible body in nodal coordinates, element by element, with GHM in deformation
!> space. One pass computes the deformations, one the dissipative coordinates, one the forces. Nothing is allocated and
!> nothing is virtual inside a loop; beams of linear strain take the short way of `chain_kernel`.
module nodal_kernel
  use kinds, only: wp
  use body, only: body_model
  use chain_kernel, only: chain_deformations, chain_forces
  use ghm_kernel, only: advance_segment, relax_segment, segment_dissipation, copy_values
  implicit none (type, external)
  private
  public :: nodal_forces, deformations, linear_deformations, element_stress, stress_forces
  public :: gather, mass_times, gyroscopic_times

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
    if (b%rayleigh) call rayleigh_forces(b, power)
    call lump_forces(b, thetad, qmq, qmv)
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

  !> The element loop: inertia and elastic forces of every element.
  subroutine element_forces(b, edof, factors, ds, thetad, qmq, qmv)
    type(body_model), intent(inout) :: b
    integer, intent(in), contiguous :: edof(:, :)       !! as above
    real(wp), intent(in), contiguous :: factors(:, :)
    real(wp), intent(in), contiguous :: ds(:, :)    !! (nd, ne) deformations with GHM differences
    real(wp), intent(in) :: thetad          !! [rad/s]
    real(wp), intent(out) :: qmq, qmv
    real(wp) :: a(6), v(6), ma(6), za(6), zv(6), f(6), n, fpsi, m1, m2, q, w2, il
    integer :: e, k
    if (b%chain) then
      call chain_forces(b%ne, b%nd, b%nf, edof, factors, ds, thetad, b%qx, b%vx, b%elastic_force, b%angle_coupling, qmq, qmv)
      return
    end if
    w2 = thetad**2
    qmq = 0.0_wp
    qmv = 0.0_wp
    do e = 1, b%ne
      call gather(b, e, b%qx, a)
      call gather(b, e, b%vx, v)
      call mass_times(b%elements(e)%mass, b%elements(e)%length, a, ma)
      call gyroscopic_times(b%elements(e)%mass, b%elements(e)%length, a, za)
      call gyroscopic_times(b%elements(e)%mass, b%elements(e)%length, v, zv)
      do k = 1, 6
        qmq = qmq + a(k)*ma(k)
        qmv = qmv + v(k)*ma(k)
        f(k) = w2*ma(k) + 2*thetad*zv(k)
      end do
      call element_stress(b, e, b%d(:, e), ds(:, e), n, fpsi, m1, m2)
      il = b%factors(2, e)
      q = (m1 + m2)*il
      if (b%stiffening) q = q - n*(a(5) - a(2))*il
      f(1) = f(1) + n
      f(4) = f(4) - n
      f(2) = f(2) - q
      f(5) = f(5) + q
      f(3) = f(3) - m1
      f(6) = f(6) - m2
      if (.not. b%straight) then
        call to_element(b%elements(e)%c, -b%elements(e)%s, f)
        call to_element(b%elements(e)%c, -b%elements(e)%s, za)
      end if
      do k = 1, 6
        b%elastic_force(b%edof(k, e)) = b%elastic_force(b%edof(k, e)) + f(k)
        b%angle_coupling(b%edof(k, e)) = b%angle_coupling(b%edof(k, e)) - za(k)
      end do
    end do
  end subroutine element_forces

  !> Adds B^T D ds of all elements, with the terms of stiffening, to f: forces that the deformations ask for.
  pure subroutine stress_forces(b, ds, qx, f)
    type(body_model), intent(in) :: b
    real(wp), intent(in), contiguous :: ds(:, :)    !! (nd, ne) deformations, GHM differences included [m, rad, rad]
    real(wp), intent(in), contiguous :: qx(0:)      !! (0:nf) coordinates, entry 0 is zero [m, rad]
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
        f(b%edof(k, e)) = f(b%edof(k, e)) + y(k)
      end do
    end do
  end subroutine stress_forces

  !> m a for one element in its own axes.
  pure subroutine mass_times(w, l, a, ma)
    real(wp), intent(in) :: w               !! element mass [kg]
    real(wp), intent(in) :: l               !! length [m]
    real(wp), intent(in) :: a(6)
    real(wp), intent(out) :: ma(6)
    real(wp) :: wb, r1, r2
    wb = w/420
    r1 = l*a(3)
    r2 = l*a(6)
    ma(1) = wb*(140*a(1) + 70*a(4))
    ma(4) = wb*(70*a(1) + 140*a(4))
    ma(2) = wb*(156*a(2) + 22*r1 + 54*a(5) - 13*r2)
    ma(3) = wb*l*(22*a(2) + 4*r1 + 13*a(5) - 3*r2)
    ma(5) = wb*(54*a(2) + 13*r1 + 156*a(5) - 22*r2)
    ma(6) = -wb*l*(13*a(2) + 3*r1 + 22*a(5) - 4*r2)
  end subroutine mass_times

  !> Z a for one element in its own axes.
  pure subroutine gyroscopic_times(w, l, a, za)
    real(wp), intent(in) :: w               !! element mass [kg]
    real(wp), intent(in) :: l               !! length [m]
    real(wp), intent(in) :: a(6)
    real(wp), intent(out) :: za(6)
    real(wp) :: wb, r1, r2
    wb = w/60
    r1 = l*a(3)
    r2 = l*a(6)
    za(1) = wb*(21*a(2) + 3*r1 + 9*a(5) - 2*r2)
    za(4) = wb*(9*a(2) + 2*r1 + 21*a(5) - 3*r2)
    za(2) = -wb*(21*a(1) + 9*a(4))
    za(3) = -wb*l*(3*a(1) + 2*a(4))
    za(5) = -wb*(9*a(1) + 21*a(4))
    za(6) = wb*l*(2*a(1) + 3*a(4))
  end subroutine gyroscopic_times

  !> Rayleigh damping, element by element: -(a m + b K) q' with K linear at E_R; adds the power.
  subroutine rayleigh_forces(b, power)
    type(body_model), intent(inout) :: b
    real(wp), intent(inout) :: power        !! [W]
    real(wp) :: v(6), f(6)
    integer :: e, k
    do e = 1, b%ne
      call gather(b, e, b%vx, v)
      call damping_times(b, e, v, f)
      power = power + dot_product(v, f)
      if (.not. b%straight) call to_element(b%elements(e)%c, -b%elements(e)%s, f)
      do k = 1, 6
        b%elastic_force(b%edof(k, e)) = b%elastic_force(b%edof(k, e)) - f(k)
      end do
    end do
  end subroutine rayleigh_forces

  !> (a m + b K) v for one element in its own axes.
  pure subroutine damping_times(b, e, v, f)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e
    real(wp), intent(in) :: v(6)
    real(wp), intent(out) :: f(6)
    real(wp) :: psi, n, m1, m2, q
    associate (g => b%elements(e))
      call mass_times(g%mass, g%length, v, f)
      f = g%ray_m*f
      psi = (v(5) - v(2))/g%length
      n = 0.0_wp
      if (b%nd == 3) n = g%ray_k*g%ea_l*(v(4) - v(1))
      m1 = g%ray_k*g%ei_l*(4*(v(3) - psi) + 2*(v(6) - psi))
      m2 = g%ray_k*g%ei_l*(2*(v(3) - psi) + 4*(v(6) - psi))
      q = (m1 + m2)/g%length
      f(1) = f(1) - n
      f(2) = f(2) + q
      f(3) = f(3) + m1
      f(4) = f(4) + n
      f(5) = f(5) - q
      f(6) = f(6) + m2
    end associate
  end subroutine damping_times

  !> Lumps: theta'^2 mu u, 2 theta' mu H^T-terms; their rotary inertia belongs to m_ff alone.
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
