!> Energies of one body (theory.md, sections 2, 4, 5). Used at output times only.
module body_energy
  use kinds, only: wp
  use beam_element, only: element_mass
  use body, only: body_model, ghm_run
  use nodal_kernel, only: deformations, sum_runs
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
    w = [c*v(1) + s*v(2), c*v(2) - s*v(1)]    ! velocity of the origin in body axes
    p = b%i1
    mtt = b%i11
    cross = 0.0_wp
    vmv = 0.0_wp
    energy = 0.0_wp
    if (b%flexible) then
      p = p + matmul(qf, b%sbar)
      energy = dot_product(w, matmul(vf, b%sbar))
      call elastic_products(b, qf, vf, mtt, cross, vmv)
      mtt = mtt + 2*dot_product(b%i1f, qf)
      cross = cross + dot_product(b%c0, vf)
    end if
    energy = energy + 0.5_wp*b%mass*dot_product(w, w) + v(3)*(w(2)*p(1) - w(1)*p(2)) + 0.5_wp*mtt*v(3)**2 &
             + v(3)*cross + 0.5_wp*vmv
  end function kinetic_energy

  !> Adds q^T m q (translational) to mtt, q^T Z v to cross and v^T m_ff v to vmv.
  subroutine elastic_products(b, qf, vf, mtt, cross, vmv)
    type(body_model), intent(inout) :: b
    real(wp), intent(in) :: qf(:), vf(:)
    real(wp), intent(inout) :: mtt, cross, vmv
    real(wp) :: m(6, 6), a(6), v(6), w
    integer :: e, k, i
    if (b%modal) then
      mtt = mtt + dot_product(qf, qf)
      if (b%rotary) mtt = mtt - dot_product(qf, matmul(b%jmodal, qf))
      cross = cross + dot_product(qf, matmul(b%zmodal, vf))
      vmv = vmv + dot_product(vf, vf)
      return
    end if
    b%qx(1:b%nf) = qf
    b%vx(1:b%nf) = vf
    do e = 1, b%ne
      m = element_mass(b%elements(e))
      a = b%qx(b%edof(:, e))
      v = b%vx(b%edof(:, e))
      mtt = mtt + dot_product(a, matmul(m, a))
      vmv = vmv + dot_product(v, matmul(m, v))
      cross = cross + gyroscopic_product(b%elements(e)%mass, b%elements(e)%length, b%elements(e)%c, b%elements(e)%s, a, v)
    end do
    do k = 1, size(b%lumps)
      associate (l => b%lumps(k))
        a(1:3) = [(b%qx(b%dof(i, l%node)), i=1, 3)]
        v(1:3) = [(b%vx(b%dof(i, l%node)), i=1, 3)]
        w = l%mass
        mtt = mtt + w*dot_product(a(1:2), a(1:2))
        cross = cross + w*(a(1)*v(2) - a(2)*v(1))
        vmv = vmv + w*dot_product(v(1:2), v(1:2)) + l%inertia*v(3)**2
      end associate
    end do
  end subroutine elastic_products

  !> a^T Z v of one element, from coordinates in body axes.
  pure function gyroscopic_product(w, l, c, s, a, v) result(x)
    real(wp), intent(in) :: w                 !! element mass [kg]
    real(wp), intent(in) :: l                 !! length [m]
    real(wp), intent(in) :: c, s              !! of the element angle [-]
    real(wp), intent(in) :: a(6), v(6)
    real(wp) :: x, u1, u2, v1, v2, p1, p2, q1, q2
    u1 = c*a(1) + s*a(2); v1 = c*a(2) - s*a(1)
    u2 = c*a(4) + s*a(5); v2 = c*a(5) - s*a(4)
    p1 = c*v(1) + s*v(2); q1 = c*v(2) - s*v(1)
    p2 = c*v(4) + s*v(5); q2 = c*v(5) - s*v(4)
    x = w/60*(u1*(21*q1 + 3*l*v(3) + 9*q2 - 2*l*v(6)) + u2*(9*q1 + 2*l*v(3) + 21*q2 - 3*l*v(6)) &
              - p1*(21*v1 + 3*l*a(3) + 9*v2 - 2*l*a(6)) - p2*(9*v1 + 2*l*a(3) + 21*v2 - 3*l*a(6)))
  end function gyroscopic_product

  !> Strain energy with what GHM stores [J].
  function strain_energy(b, qf, z, zd) result(energy)
    type(body_model), intent(inout) :: b
    real(wp), intent(in) :: qf(:)             !! (nf)
    real(wp), intent(in) :: z(:), zd(:)       !! (b%nz)
    real(wp) :: energy
    integer :: e, r
    energy = 0.0_wp
    if (.not. b%flexible) return
    if (b%modal) then
      energy = modal_strain(b, qf, z, zd)
      return
    end if
    b%qx(1:b%nf) = qf
    call deformations(b, b%qx, b%d)
    do e = 1, b%ne
      if (b%nd == 3) energy = energy + 0.5_wp*b%elements(e)%ea_l*b%d(1, e)**2
      associate (p1 => b%d(b%nd - 1, e), p2 => b%d(b%nd, e))
        energy = energy + 2*b%elements(e)%ei_l*(p1**2 + p1*p2 + p2**2)
      end associate
    end do
    do r = 1, size(b%runs)
      energy = energy + run_energy(b, b%runs(r), z(b%runs(r)%offset + 1:), zd(b%runs(r)%offset + 1:))
    end do
  end function strain_energy

  !> Stored by the dissipative coordinates of one run; b%d holds the deformations.
  function run_energy(b, run, z, zd) result(energy)
    type(body_model), intent(in) :: b
    type(ghm_run), intent(in) :: run
    real(wp), intent(in) :: z(:), zd(:)
    real(wp) :: energy
    real(wp), allocatable :: x(:)
    integer :: k, n
    n = run%width
    allocate (x(n*size(run%alpha)))
    x(:) = z(1:n*size(run%alpha))
    do k = 1, size(run%alpha)
      x((k - 1)*n + 1:k*n) = reshape(b%d(:, run%first:run%last), [n]) - x((k - 1)*n + 1:k*n)
    end do
    energy = 0.5_wp*(sum_runs(b, run, x, run%alpha) + sum_runs(b, run, zd, run%alpha/run%omega**2))
  end function run_energy

  !> Strain energy of a modal body.
  function modal_strain(b, qf, z, zd) result(energy)
    type(body_model), intent(in) :: b
    real(wp), intent(in) :: qf(:), z(:), zd(:)
    real(wp) :: energy
    integer :: r, k, o
    energy = 0.5_wp*sum(b%omega2*qf**2)
    do r = 1, size(b%runs)
      associate (run => b%runs(r), n => b%nf)
        do k = 1, size(run%alpha)
          o = run%offset + (k - 1)*n
          energy = energy + 0.5_wp*run%alpha(k)*(quadratic(run%stiffness, qf - z(o + 1:o + n)) &
                                                 + quadratic(run%stiffness, zd(o + 1:o + n))/run%omega(k)**2)
        end do
      end associate
    end do
  end function modal_strain

  !> x^T K x.
  pure function quadratic(k, x) result(y)
    real(wp), intent(in) :: k(:, :), x(:)
    real(wp) :: y
    y = dot_product(x, matmul(k, x))
  end function quadratic
end module body_energy
