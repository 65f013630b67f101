!> Generalised elastic forces of a flexible body in a truncated modal basis: mass-normalised modes, so m_ff = 1;
!> viscoelastic terms kept per mode and per distinct viscoelastic material (theory.md, section 5).
module modal_kernel
  use kinds, only: wp
  use body, only: body_model
  use elastic_operators, only: inertia_forces, damping_forces
  implicit none (type, external)
  private
  public :: modal_forces

contains

  !> The modal twin of nodal_forces: adds to b%fx, sets b%tx = -Z q. On entry b%qx, b%vx hold coordinates and rates.
  subroutine modal_forces(b, z, zd, thetad, zdd, qmq, qmv, power)
    type(body_model), intent(inout) :: b
    real(wp), intent(in) :: z(*), zd(*)     !! (nz), (nzd) internal variables and rates [m kg^1/2] and per second
    real(wp), intent(in) :: thetad          !! frame rate [rad/s]
    real(wp), intent(inout) :: zdd(*)       !! (nz) their highest derivatives [m kg^1/2/s2], [m kg^1/2/s]
    real(wp), intent(out) :: qmq, qmv       !! translational part [kg m2], [kg m2/s]
    real(wp), intent(out) :: power          !! dissipated [W]
    integer :: r, k
    power = 0.0_wp
    call inertia_forces(b%op, b%nf, thetad, b%qx(1), b%vx(1), b%elastic_force(1), b%angle_coupling(1), qmq, qmv)
    do k = 1, b%nf
      b%elastic_force(k) = b%elastic_force(k) - b%omega2(k)*b%qx(k)
    end do
    if (b%rayleigh) call damping_forces(b%op, b%nf, b%vx(1), b%elastic_force(1), power)
    do r = 1, size(b%segments)
      call term_forces(b, r, z, zd, zdd, power)
    end do
  end subroutine modal_forces

  !> Highest derivatives of one material's internal variables, the force -K sum of alpha_k (q - z_k), and the power of the terms.
  pure subroutine term_forces(b, r, z, zd, zdd, power)
    type(body_model), intent(inout) :: b
    integer, intent(in) :: r                !! segment
    real(wp), intent(in) :: z(*), zd(*)     !! (nz), (nzd) internal variables and rates [m kg^1/2] and per second
    real(wp), intent(inout) :: zdd(*)       !! (nz) their highest derivatives [m kg^1/2/s2], [m kg^1/2/s]
    real(wp), intent(inout) :: power        !! dissipated [W]
    real(wp) :: s
    integer :: n, k, i, j
    n = b%nf
    b%ds(:, 1) = 0.0_wp
    associate (segment => b%segments(r), law => b%segments(r)%law)
      do k = 1, law%second
        i = segment%offset + (k - 1)*n
        do j = 1, n
          s = b%qx(j) - z(i + j)
          zdd(i + j) = (s - law%viscosity(k)*zd(i + j))/law%inertia(k)
          b%ds(j, 1) = b%ds(j, 1) + law%alpha(k)*s
        end do
        power = power + law%alpha(k)*law%viscosity(k)*modal_product(n, segment%stiffness, zd(i + 1:i + n))
      end do
      do k = law%second + 1, law%second + law%first
        i = segment%first_order + (k - law%second - 1)*n
        do j = 1, n
          s = b%qx(j) - z(i + j)
          zdd(i + j) = s/law%viscosity(k)
          b%ds(j, 1) = b%ds(j, 1) + law%alpha(k)*s
        end do
        power = power + law%alpha(k)*law%viscosity(k)*modal_product(n, segment%stiffness, zdd(i + 1:i + n))
      end do
      do j = 1, n
        do i = 1, n
          b%elastic_force(i) = b%elastic_force(i) - segment%stiffness(i, j)*b%ds(j, 1)
        end do
      end do
    end associate
  end subroutine term_forces

  !> x^T K x.
  pure real(wp) function modal_product(n, stiffness, x) result(total)
    integer, intent(in) :: n
    real(wp), intent(in) :: stiffness(n, n) !! [1/s2]
    real(wp), intent(in) :: x(n)            !! [any]
    integer :: i, j
    total = 0.0_wp
    do j = 1, n
      do i = 1, n
        total = total + x(i)*stiffness(i, j)*x(j)
      end do
    end do
  end function modal_product
end module modal_kernel
