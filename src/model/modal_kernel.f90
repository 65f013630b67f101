!> Generalised elastic forces of a flexible body in a truncated modal basis: mass-normalised modes, so m_ff = 1;
!> GHM kept per mode and per distinct viscoelastic material (theory.md, section 5).
module modal_kernel
  use kinds, only: wp
  use body, only: body_model
  implicit none (type, external)
  private
  public :: modal_forces, modal_dissipation

contains

  !> The modal twin of nodal_forces: adds to b%fx, sets b%tx = -Z q. On entry b%qx, b%vx hold coordinates and rates.
  subroutine modal_forces(b, z, zd, thetad, zdd, qmq, qmv, power)
    type(body_model), intent(inout) :: b
    real(wp), intent(in) :: z(*), zd(*)     !! (b%nz) dissipative coordinates and rates
    real(wp), intent(in) :: thetad          !! frame rate [rad/s]
    real(wp), intent(inout) :: zdd(*)       !! (b%nz) dissipative accelerations
    real(wp), intent(out) :: qmq, qmv       !! translational part [kg m2], [kg m2/s]
    real(wp), intent(out) :: power          !! dissipated [W]
    integer :: n, r, k, i, j
    real(wp) :: w2, two_zw, s
    n = b%nf
    power = 0.0_wp
    qmq = dot_product(b%qx(1:n), b%qx(1:n))
    qmv = dot_product(b%qx(1:n), b%vx(1:n))
    do i = 1, n
      b%fx(i) = b%fx(i) + (thetad**2 - b%omega2(i))*b%qx(i)
    end do
    do j = 1, n
      do i = 1, n
        b%fx(i) = b%fx(i) + 2*thetad*b%zmodal(i, j)*b%vx(j)
        b%tx(i) = b%tx(i) - b%zmodal(i, j)*b%qx(j)
      end do
    end do
    if (b%rotary) then   ! the rotary inertia of lumps does not multiply theta'
      do j = 1, n
        do i = 1, n
          s = b%jmodal(i, j)*b%qx(j)
          b%fx(i) = b%fx(i) - thetad**2*s
          qmq = qmq - b%qx(i)*s
          qmv = qmv - b%vx(i)*s
        end do
      end do
    end if
    if (b%rayleigh) then
      do j = 1, n
        do i = 1, n
          s = b%cmodal(i, j)*b%vx(j)
          b%fx(i) = b%fx(i) - s
          power = power + b%vx(i)*s
        end do
      end do
    end if
    do r = 1, size(b%runs)
      b%d(:, 1) = 0.0_wp
      b%ds(:, 1) = 0.0_wp
      associate (run => b%runs(r))
        do k = 1, size(run%alpha)
          w2 = run%omega(k)**2
          two_zw = 2*run%zeta(k)*run%omega(k)
          i = run%offset + (k - 1)*n
          do j = 1, n
            s = b%qx(j) - z(i + j)
            zdd(i + j) = w2*s - two_zw*zd(i + j)
            b%ds(j, 1) = b%ds(j, 1) + run%alpha(k)*s
          end do
        end do
        do j = 1, n
          do i = 1, n
            b%fx(i) = b%fx(i) - run%stiffness(i, j)*b%ds(j, 1)
          end do
        end do
      end associate
    end do
    power = power + modal_dissipation(b, zd)
  end subroutine modal_forces

  !> Power dissipated by GHM [W].
  pure function modal_dissipation(b, zd) result(power)
    type(body_model), intent(in) :: b
    real(wp), intent(in) :: zd(*)           !! (b%nz)
    real(wp) :: power, part
    integer :: r, k, i, j, o
    power = 0.0_wp
    do r = 1, size(b%runs)
      associate (run => b%runs(r))
        do k = 1, size(run%alpha)
          o = run%offset + (k - 1)*b%nf
          part = 0.0_wp
          do j = 1, b%nf
            do i = 1, b%nf
              part = part + zd(o + i)*run%stiffness(i, j)*zd(o + j)
            end do
          end do
          power = power + 2*run%alpha(k)*run%zeta(k)/run%omega(k)*part
        end do
      end associate
    end do
  end function modal_dissipation
end module modal_kernel
