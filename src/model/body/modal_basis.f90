!> Flexible bodies in a truncated modal basis: mass-normalised modes, so that m_ff = 1. Their deformations are the amplitudes,
!> once for every viscoelastic material (theory.md, section 5).
module modal_basis
  use kinds, only: wp
  use body, only: body_model, elastic_basis
  implicit none (type, external)
  private

  !> The kind.
  type, extends(elastic_basis), public :: modal_model
  contains
    procedure, nopass :: deform
    procedure, nopass :: add_stress
    procedure, nopass :: strain_energy
    procedure, nopass :: displacement
  end type modal_model

contains

  !> The amplitudes.
  pure subroutine deform(b, qx, d)
    type(body_model), intent(in) :: b
    real(wp), intent(in), contiguous :: qx(0:)      !! (0:nf) [m kg^1/2]
    real(wp), intent(inout), contiguous :: d(:, :)  !! (nf, segments) [m kg^1/2]
    integer :: r
    do r = 1, size(d, 2)
      d(:, r) = qx(1:)
    end do
  end subroutine deform

  !> Omega2 q, and of every material K (ds - d).
  pure subroutine add_stress(b, ds, qx, factor, f)
    type(body_model), intent(in) :: b
    real(wp), intent(in), contiguous :: ds(:, :)    !! (nf, segments) [m kg^1/2]
    real(wp), intent(in), contiguous :: qx(0:)      !! (0:nf) [m kg^1/2]
    real(wp), intent(in) :: factor                  !! [-]
    real(wp), intent(inout), contiguous :: f(0:)    !! (0:nf) [m kg^1/2/s2]
    integer :: r, j
    f(1:) = f(1:) + factor*b%omega2*qx(1:)
    do r = 1, size(b%segments)
      do j = 1, b%nf
        f(1:) = f(1:) + b%segments(r)%stiffness(:, j)*(factor*(ds(j, r) - b%d(j, r)))
      end do
    end do
  end subroutine add_stress

  !> q^T Omega2 q/2.
  pure function strain_energy(b) result(energy)
    type(body_model), intent(in) :: b
    real(wp) :: energy                        !! [J]
    energy = 0.5_wp*sum(b%omega2*b%qx(1:b%nf)**2)
  end function strain_energy

  !> Sums over the modes.
  pure function displacement(b, node, q) result(u)
    type(body_model), intent(in) :: b
    integer, intent(in) :: node
    real(wp), intent(in) :: q(:)              !! (nf) [m kg^1/2]
    real(wp) :: u(3)                          !! [m, m, rad]
    integer :: k
    u = 0.0_wp
    do k = 1, b%nf
      u = u + b%psi(3*node - 2:3*node, k)*q(k)
    end do
  end function displacement
end module modal_basis
