!> Energies of one body (theory.md, sections 2, 4, 5). Used at output times only.
module body_energy
  use kinds, only: wp
  use body, only: body_model, viscoelastic_segment
  use elastic_operators, only: inertia_products, mass_product
  use ghm_kernel, only: segment_product
  use nodal_kernel, only: deformations
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
    real(wp), dimension(2, b%nf) :: x, mx, zx ! both vectors and their products [m, kg m, ...]
    x(1, :) = qf
    x(2, :) = vf
    call inertia_products(b%op, b%nf, x, x, mx, zx)
    mtt = mtt + dot_product(qf, mx(1, :))
    cross = cross + dot_product(qf, zx(2, :))
    call mass_product(b%op, vf, mx(2, :))
    vmv = vmv + dot_product(vf, mx(2, :))
  end subroutine elastic_products

  !> Strain energy with what viscoelastic terms store [J].
  function strain_energy(b, qf, z, zd) result(energy)
    type(body_model), intent(inout) :: b
    real(wp), intent(in) :: qf(:)             !! (nf) [m, rad]
    real(wp), intent(in), contiguous :: z(:), zd(:)   !! (nz), (nzd) internal variables of the scene [m, rad] and per second
    real(wp) :: energy                        !! [J]
    integer :: e, r, k, n
    energy = 0.0_wp
    if (.not. b%flexible) return
    b%qx(1:b%nf) = qf
    if (b%modal) then
      energy = 0.5_wp*sum(b%omega2*qf**2)
    else
      call deformations(b, b%qx, b%d)
      do e = 1, b%ne
        if (b%nd == 3) energy = energy + 0.5_wp*b%elements(e)%ea_l*b%d(1, e)**2
        associate (p1 => b%d(b%nd - 1, e), p2 => b%d(b%nd, e))
          energy = energy + 2*b%elements(e)%ei_l*(p1**2 + p1*p2 + p2**2)
        end associate
      end do
    end if
    do r = 1, size(b%segments)
      associate (segment => b%segments(r), law => b%segments(r)%law)
        n = segment%width
        do k = 1, law%second
          energy = energy + 0.5_wp*law%alpha(k)*(difference_product(b, segment, z(segment%offset + (k - 1)*n + 1:segment%offset &
              + k*n)) &
                   + law%inertia(k)*twice_energy(b, segment, zd(segment%offset + (k - 1)*n + 1:segment%offset + k*n)))
        end do
        do k = 1, law%first
          energy = energy + 0.5_wp*law%alpha(law%second + k) &
                   *difference_product(b, segment, z(segment%first_order + (k - 1)*n + 1:segment%first_order + k*n))
        end do
      end associate
    end do
  end function strain_energy

  !> (d - z)^T D (d - z) over a segment, whose deformations the body holds [J].
  pure function difference_product(b, segment, z) result(product)
    type(body_model), intent(in) :: b
    type(viscoelastic_segment), intent(in) :: segment
    real(wp), intent(in), contiguous :: z(:)  !! (width) [m, rad]
    real(wp) :: product                       !! [J]
    real(wp) :: x(3)                          ! differences of an element [m, rad]
    integer :: e, j
    product = 0.0_wp
    if (b%modal) then
      do j = 1, b%nf
        product = product + (b%qx(j) - z(j))*dot_product(segment%stiffness(:, j), b%qx(1:b%nf) - z)
      end do
    else
      do e = segment%first, segment%last
        j = (e - segment%first)*b%nd
        x(1:b%nd) = b%d(:, e) - z(j + 1:j + b%nd)
        product = product + segment_product(b%nd, 1, b%factors(:, e), x, x)
      end do
    end if
  end function difference_product

  !> x^T D x over a segment, or x^T K x of a material's modal stiffness [J for deformations].
  pure function twice_energy(b, segment, x) result(product)
    type(body_model), intent(in) :: b
    type(viscoelastic_segment), intent(in) :: segment
    real(wp), intent(in), contiguous :: x(:)  !! (width) [m, rad] or per second
    real(wp) :: product                       !! [J]
    integer :: j
    product = 0.0_wp
    if (b%modal) then
      do j = 1, b%nf
        product = product + x(j)*dot_product(segment%stiffness(:, j), x)
      end do
    else
      product = segment_product(b%nd, segment%last - segment%first + 1, b%factors(:, segment%first:segment%last), x, x)
    end if
  end function twice_energy
end module body_energy
