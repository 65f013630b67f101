!> Energies of one body (theory.md, sections 2, 4, 5). Used at output times only.
module body_energy
  use kinds, only: wp
  use body, only: body_model
  use elastic_operators, only: bilinear
  implicit none (type, external)
  private
  public :: kinetic_energy, strain_energy

contains

  !> Kinetic energy of a body from its frame's state and its elastic coordinates [J].
  function kinetic_energy(b, c, s, v, qf, vf) result(energy)
    type(body_model), intent(inout) :: b
    real(wp), intent(in) :: c, s              !! of the frame angle [-]
    real(wp), intent(in) :: v(3)              !! frame rates: global x, y [m/s] and angle [rad/s]
    real(wp), intent(in) :: qf(:), vf(:)      !! (nf) elastic coordinates and rates
    real(wp) :: energy, p(2), w(2), mtt, cross, vmv
    integer :: k
    w(1) = c*v(1) + s*v(2)                    ! velocity of the origin in body axes
    w(2) = c*v(2) - s*v(1)
    p = b%i1
    mtt = b%i11
    cross = 0.0_wp
    vmv = 0.0_wp
    energy = 0.0_wp
    if (b%flexible) then
      call elastic_products(b, qf, vf, mtt, cross, vmv)
      do k = 1, b%nf
        p(1) = p(1) + b%sbar(k, 1)*qf(k)
        p(2) = p(2) + b%sbar(k, 2)*qf(k)
        energy = energy + (w(1)*b%sbar(k, 1) + w(2)*b%sbar(k, 2))*vf(k)
        mtt = mtt + 2*b%i1f(k)*qf(k)
        cross = cross + b%c0(k)*vf(k)
      end do
    end if
    energy = energy + 0.5_wp*b%mass*dot_product(w, w) + v(3)*(w(2)*p(1) - w(1)*p(2)) + 0.5_wp*mtt*v(3)**2 &
             + v(3)*cross + 0.5_wp*vmv
  end function kinetic_energy

  !> Adds q^T m q (translational) to mtt, q^T Z v to cross and v^T m_ff v to vmv.
  pure subroutine elastic_products(b, qf, vf, mtt, cross, vmv)
    type(body_model), intent(in) :: b
    real(wp), intent(in) :: qf(:), vf(:)      !! (nf) [m, rad] and per second
    real(wp), intent(inout) :: mtt            !! [kg m2]
    real(wp), intent(inout) :: cross          !! [kg m2/s]
    real(wp), intent(inout) :: vmv            !! [kg m2/s2]
    mtt = mtt + bilinear(b%op%even, b%op%m, qf, qf)
    cross = cross + bilinear(b%op%odd, b%op%z, qf, vf)
    vmv = vmv + bilinear(b%op%even, b%op%m, vf, vf)
    if (b%op%rotary) vmv = vmv + bilinear(b%op%even, b%op%j, vf, vf)
  end subroutine elastic_products

  !> Strain energy with what viscoelastic terms store [J].
  function strain_energy(b, qf, z, zd) result(energy)
    type(body_model), intent(inout) :: b
    real(wp), intent(in) :: qf(:)             !! (nf) [m, rad]
    real(wp), intent(in), contiguous :: z(:), zd(:)   !! (nz), (nzd) internal variables of the scene [m, rad] and per second
    real(wp) :: energy                        !! [J]
    integer :: r
    energy = 0.0_wp
    if (.not. b%flexible) return
    b%qx(1:b%nf) = qf
    call b%basis%deform(b, b%qx, b%d)
    energy = b%basis%strain_energy(b)
    do r = 1, size(b%segments)
      energy = energy + b%segments(r)%stored(b%segments(r)%width, b%d(1, b%segments(r)%first), z, zd)
    end do
  end function strain_energy
end module body_energy
