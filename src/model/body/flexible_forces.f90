!> The explicit forces of a flexible body on its elastic coordinates: inertia, elastic and viscoelastic forces, Rayleigh damping.
!> Nothing is allocated; a kind is asked once a body or a segment, never for an element.
module flexible_forces
  use kinds, only: wp
  use body, only: body_model
  use chain_kernel, only: chain_deformations, chain_forces
  use elastic_operators, only: inertia_forces, damping_forces
  implicit none (type, external)
  private
  public :: elastic_forces

contains

  !> Adds to b%elastic_force theta'^2 m q + 2 theta' Z q' - dV/dq - C q' - GHM and to b%angle_coupling -Z q (theory.md, section 3).
  !> On entry b%qx, b%vx hold the coordinates and rates.
  subroutine elastic_forces(b, edof, factors, z, zd, thetad, zdd, qmq, qmv, power)
    type(body_model), intent(inout) :: b
    integer, intent(in), contiguous :: edof(:, :)       !! of the body or of one like it: constants read for many bodies
    real(wp), intent(in), contiguous :: factors(:, :)   !! the same [m, kg, N m, ...]
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
      call b%basis%deform(b, b%qx, b%d)
    end if
    if (size(b%segments) > 0) then
      call copy_values(size(b%d), b%d, b%ds)
      do r = 1, size(b%segments)
        associate (segment => b%segments(r))
          call segment%follow(segment%width, b%d(1, segment%first), z, zd, zdd, b%ds(1, segment%first), power)
        end associate
      end do
      call inertia_and_stress(b, edof, factors, b%ds, thetad, qmq, qmv)
    else
      call inertia_and_stress(b, edof, factors, b%d, thetad, qmq, qmv)
    end if
    if (b%rayleigh) call damping_forces(b%op, b%nf, b%vx(1), b%elastic_force(1), power)
  end subroutine elastic_forces

  !> y = x, as one piece of memory.
  pure subroutine copy_values(n, x, y)
    integer, intent(in) :: n
    real(wp), intent(in) :: x(n)            !! [any]
    real(wp), intent(out) :: y(n)           !! [any]
    y = x
  end subroutine copy_values

  !> Inertia and elastic forces: of a chain in one loop over its elements, else by the operators.
  subroutine inertia_and_stress(b, edof, factors, ds, thetad, qmq, qmv)
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
      call b%basis%add_stress(b, ds, b%qx, -1.0_wp, b%elastic_force)
    end if
  end subroutine inertia_and_stress

  !> Lumps on a chain: theta'^2 mu u, 2 theta' mu H^T-terms; their rotary inertia belongs to m_ff alone.
  subroutine lump_forces(b, thetad, qmq, qmv)
    type(body_model), intent(inout) :: b
    real(wp), intent(in) :: thetad          !! [rad/s]
    real(wp), intent(inout) :: qmq, qmv     !! [kg m2], [kg m2/s]
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
end module flexible_forces
