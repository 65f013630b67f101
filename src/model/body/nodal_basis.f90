!> Flexible bodies in nodal coordinates: deformations element by element, the forces that they ask for, their energy.
module nodal_basis
  use kinds, only: wp
  use body, only: body_model, elastic_basis
  use chain_kernel, only: chain_deformations
  implicit none (type, external)
  private
  public :: linear_deformations, element_stress

  !> The kind.
  type, extends(elastic_basis), public :: nodal_model
  contains
    procedure, nopass :: deform => deformations
    procedure, nopass :: add_stress
    procedure, nopass :: strain_energy
    procedure, nopass :: displacement
  end type nodal_model

contains

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

  !> Of all elements.
  pure function strain_energy(b) result(energy)
    type(body_model), intent(in) :: b
    real(wp) :: energy                        !! [J]
    integer :: e
    energy = 0.0_wp
    do e = 1, b%ne
      if (b%nd == 3) energy = energy + 0.5_wp*b%elements(e)%ea_l*b%d(1, e)**2
      associate (p1 => b%d(b%nd - 1, e), p2 => b%d(b%nd, e))
        energy = energy + 2*b%elements(e)%ei_l*(p1**2 + p1*p2 + p2**2)
      end associate
    end do
  end function strain_energy

  !> The node's own coordinates.
  pure function displacement(b, node, q) result(u)
    type(body_model), intent(in) :: b
    integer, intent(in) :: node
    real(wp), intent(in) :: q(:)              !! (nf) [m, rad]
    real(wp) :: u(3)                          !! [m, m, rad]
    integer :: k
    u = 0.0_wp
    do k = 1, 3
      if (b%dof(k, node) > 0) u(k) = q(b%dof(k, node))
    end do
  end function displacement
end module nodal_basis
