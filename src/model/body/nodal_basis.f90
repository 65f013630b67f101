!> Flexible bodies in nodal coordinates: deformations element by element, the forces that they ask for, their energy.
module nodal_basis
  use kinds, only: wp
  use banded, only: band_factor, band_solve, band_solve_two, same_factor
  use beam_element, only: beam_geometry, bending
  use body, only: body_model, elastic_basis, elastic_work
  use element_law, only: add_geometric, axial_force, forces_of, parts_of, segment_of, stiffness_part
  use layered_element, only: most_coordinates
  use marker, only: marker_model
  use segment_model, only: strain_product
  use triplets, only: triplet_matrix
  implicit none (type, external)
  private
  public :: to_element

  !> A basis of nodal coordinates.
  type, extends(elastic_basis), public :: nodal_model
    type(band_factor) :: mff                        !! factor of m_ff
    logical :: straight = .true.                    !! all elements along body x
  contains
    procedure :: deform
    procedure :: add_stress
    procedure :: solve_mass
    procedure :: strain_parts
    procedure :: largest_force
    procedure :: element_strain
    procedure :: add_stiffness
    procedure :: nodal_values
    procedure :: attach
    procedure :: same
  end type nodal_model

contains

  !> Deformations (e, phi1, phi2) of every element, or (phi1, phi2) without axial deformation.
  pure subroutine deform(self, b, q, d)
    class(nodal_model), intent(in) :: self
    type(body_model), intent(in) :: b
    real(wp), intent(in), contiguous :: q(0:)       !! (0:nf) coordinates, entry 0 is zero [m, rad]
    real(wp), intent(inout), contiguous :: d(:, :)  !! (nd, ne) [m, rad, rad]
    call element_deformations(b%ne, b%nd, b%nf, b%elements, b%stiffening, self%straight, b%edof, q, d)
  end subroutine deform

  !> The same as plain arrays, with the terms of stiffening or without.
  pure subroutine element_deformations(ne, nd, nf, elements, stiffening, straight, edof, q, d)
    integer, intent(in) :: ne, nd, nf
    type(beam_geometry), intent(in) :: elements(ne)
    logical, intent(in) :: stiffening, straight
    integer, intent(in) :: edof(6, ne)
    real(wp), intent(in) :: q(0:nf)                 !! [m, rad]
    real(wp), intent(inout) :: d(nd, ne)            !! [m, rad, rad]
    real(wp) :: a(6), psi
    integer :: e
    do e = 1, ne
      a = q(edof(:, e))
      if (.not. straight) call to_element(elements(e)%c, elements(e)%s, a)
      psi = (a(5) - a(2))/elements(e)%length
      associate (p1 => d(nd - 1, e), p2 => d(nd, e))
        p1 = a(3) - psi
        p2 = a(6) - psi
        if (nd == 3) d(1, e) = a(4) - a(1)
        if (stiffening) d(1, e) = d(1, e) + elements(e)%length*(0.5_wp*psi**2 + (2*p1**2 - p1*p2 + 2*p2**2)/30)
      end associate
    end do
  end subroutine element_deformations

  !> Turns the displacements of an element from body axes into element axes.
  pure subroutine to_element(c, s, a)
    real(wp), intent(in) :: c, s                    !! of the element angle [-]
    real(wp), intent(inout) :: a(6)                 !! [m, rad], or forces [N, N m]
    real(wp) :: u, v
    u = a(1); v = a(2)
    a(1) = c*u + s*v
    a(2) = c*v - s*u
    u = a(4); v = a(5)
    a(4) = c*u + s*v
    a(5) = c*v - s*u
  end subroutine to_element

  !> Forces along and across an element and end moments that its deformations ask for: D ds, with the terms of stiffening, whose
  !> chord turns by psi.
  pure function element_stress(g, nd, stiffening, d, ds, psi) result(s)
    type(beam_geometry), intent(in) :: g
    integer, intent(in) :: nd                       !! 3, or 2 without axial deformation
    logical, intent(in) :: stiffening
    real(wp), intent(in) :: d(nd), ds(nd)           !! deformations, and with the terms' differences [m, rad, rad]
    real(wp), intent(in) :: psi                     !! [rad]
    real(wp) :: s(4)                                !! axial, transverse [N], end moments [N m]
    real(wp) :: n
    s(1) = 0.0_wp
    if (nd == 3) s(1) = g%ea_l*ds(1)
    s(3) = g%ei_l*(bending(1, 1)*ds(nd - 1) + bending(1, 2)*ds(nd))
    s(4) = g%ei_l*(bending(2, 1)*ds(nd - 1) + bending(2, 2)*ds(nd))
    if (stiffening) then
      n = s(1)*g%length/30
      s(3) = s(3) + n*(4*d(2) - d(3))
      s(4) = s(4) + n*(4*d(3) - d(2))
    end if
    s(2) = (s(3) + s(4))/g%length
    if (stiffening) s(2) = s(2) - s(1)*psi
  end function element_stress

  !> Adds B^T D ds of all elements, with the terms of stiffening, times a factor to f: forces that the deformations ask for.
  pure subroutine add_stress(self, b, d, ds, q, factor, f)
    class(nodal_model), intent(in) :: self
    type(body_model), intent(in) :: b
    real(wp), intent(in), contiguous :: d(:, :), ds(:, :)   !! (nd, ne) deformations, and with terms' differences [m, rad, rad]
    real(wp), intent(in), contiguous :: q(0:)       !! (0:nf) coordinates, entry 0 is zero [m, rad]
    real(wp), intent(in) :: factor                  !! 1, or -1 for forces that they exert [-]
    real(wp), intent(inout), contiguous :: f(0:)    !! (0:nf) [N, N m], entry 0 is thrown away
    call add_elements(b%ne, b%nd, b%nf, b%elements, b%stiffening, self%straight, b%edof, d, ds, q, factor, f)
  end subroutine add_stress

  !> The same as plain arrays.
  pure subroutine add_elements(ne, nd, nf, elements, stiffening, straight, edof, d, ds, q, factor, f)
    integer, intent(in) :: ne, nd, nf
    type(beam_geometry), intent(in) :: elements(ne)
    logical, intent(in) :: stiffening, straight
    integer, intent(in) :: edof(6, ne)
    real(wp), intent(in) :: d(nd, ne), ds(nd, ne)   !! [m, rad, rad]
    real(wp), intent(in) :: q(0:nf)                 !! [m, rad]
    real(wp), intent(in) :: factor                  !! [-]
    real(wp), intent(inout) :: f(0:nf)              !! [N, N m]
    real(wp) :: s(4), y(6), a(6), psi               ! [N, N m], [N, N m], [m, rad], turn of the chord [rad]
    integer :: e, k
    psi = 0.0_wp
    do e = 1, ne
      if (stiffening) then
        a = q(edof(:, e))
        if (.not. straight) call to_element(elements(e)%c, elements(e)%s, a)
        psi = (a(5) - a(2))/elements(e)%length
      end if
      s = factor*element_stress(elements(e), nd, stiffening, d(1, e), ds(1, e), psi)
      y = [-s(1), s(2), s(3), s(1), -s(2), s(4)]
      if (.not. straight) call to_element(elements(e)%c, -elements(e)%s, y)
      do k = 1, 6
        f(edof(k, e)) = f(edof(k, e)) + y(k)
      end do
    end do
  end subroutine add_elements

  !> m_ff^-1 x and m_ff^-1 y by the band factor of m_ff.
  pure subroutine solve_mass(self, n, work, x, y)
    class(nodal_model), intent(in) :: self
    integer, intent(in) :: n
    real(wp), intent(inout) :: work(2, n)           !! [any]
    real(wp), intent(inout) :: x(n)                 !! [N, N m], then [m/s2, rad/s2]
    real(wp), intent(inout), optional :: y(n)       !! likewise [N, N m]
    if (present(y)) then
      call band_solve_two(self%mff, n, x, y, work)
    else
      call band_solve(self%mff, n, x, work)
    end if
  end subroutine solve_mass

  !> Twice the axial strain energy and twice that of bending; nothing slips.
  pure function strain_parts(self, b, q, d) result(parts)
    class(nodal_model), intent(in) :: self
    type(body_model), intent(in) :: b
    real(wp), intent(in) :: q(:)                    !! (nf) [m, rad]
    real(wp), intent(in), contiguous, optional :: d(:, :)   !! (nd, ne) [m, rad, rad]
    real(wp) :: parts(3)                            !! [J]
    real(wp), allocatable :: linear(:, :)           ! of the linear strain [m, rad, rad]
    if (present(d)) then
      parts(1:2) = energies(b, d)
    else
      allocate (linear(b%nd, b%ne))
      call element_deformations(b%ne, b%nd, b%nf, b%elements, .false., self%straight, b%edof, [0.0_wp, q], linear)
      parts(1:2) = energies(b, linear)
    end if
    parts(3) = 0.0_wp
  end function strain_parts

  !> Twice the energies of extensions and of bending.
  pure function energies(b, d) result(parts)
    type(body_model), intent(in) :: b
    real(wp), intent(in), contiguous :: d(:, :)     !! (nd, ne) [m, rad, rad]
    real(wp) :: parts(2)                            !! [J]
    integer :: e
    parts = 0.0_wp
    do e = 1, b%ne
      parts = parts + strain_product(1, b%nd, [b%elements(e)%ea_l], [b%elements(e)%ei_l], d(:, e), d(:, e))
    end do
  end function energies

  !> Axial and shear forces.
  pure real(wp) function largest_force(self, b, w) result(force)   ! [N]
    class(nodal_model), intent(in) :: self
    type(body_model), intent(in) :: b
    type(elastic_work), intent(in) :: w
    complex(wp) :: f(3)                             ! [N], [N m]
    integer :: e
    force = 0.0_wp
    do e = 1, b%ne
      f = forces_of(b, e, cmplx(self%element_strain(b, e, w), kind=wp))
      force = max(force, abs(f(1)), abs(f(2) + f(3))/b%elements(e)%length)
    end do
  end function largest_force

  !> (e, phi1, phi2) of an element, as the last evaluation left them.
  pure function element_strain(self, b, e, w) result(d)
    class(nodal_model), intent(in) :: self
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                        !! element
    type(elastic_work), intent(in) :: w
    real(wp), allocatable :: d(:)                   !! [m, rad, rad]
    d = [spread(0.0_wp, 1, 3 - b%nd), w%ds(:, e)]
  end function element_strain

  !> Adds element by element B^T D B at the present deformation, which viscoelastic terms multiply, and the geometric stiffness.
  pure subroutine add_stiffness(self, b, first, q, w, stiffness, segments)
    class(nodal_model), intent(in) :: self
    type(body_model), intent(in) :: b
    integer, intent(in) :: first                    !! coordinates before
    real(wp), intent(in) :: q(:)                    !! (nf) [m, rad]
    type(elastic_work), intent(in) :: w
    type(triplet_matrix), intent(inout) :: stiffness
    type(triplet_matrix), intent(inout) :: segments(:)
    real(wp) :: k(most_coordinates, most_coordinates), x(0:b%nf)
    integer :: e, r, n, part, at(size(b%edof, 1))
    x(0) = 0.0_wp
    x(1:) = q
    n = size(at)
    do e = 1, b%ne
      at = merge(first + b%edof(:, e), 0, b%edof(:, e) > 0)
      do part = 1, parts_of(b, e)
        k = 0.0_wp
        if (b%stiffening) then
          call stiffness_part(b, e, part, k, x(b%edof(:6, e)))
        else
          call stiffness_part(b, e, part, k)
        end if
        r = segment_of(b, e, part)
        if (r > 0 .and. r <= size(segments)) call segments(r)%add_block(at, at, k(:n, :n))
        if (b%stiffening .and. part == 1) call add_geometric(b, e, axial_force(b, e, w%ds), k)
        call stiffness%add_block(at, at, k(:n, :n))
      end do
    end do
  end subroutine add_stiffness

  !> They are the coordinates.
  pure subroutine nodal_values(self, n, at, q, a)
    class(nodal_model), intent(in) :: self
    integer, intent(in) :: n
    integer, intent(in) :: at(n)                    !! their numbers, 0: removed
    real(wp), intent(in) :: q(:)                    !! (nf) [m, rad]
    real(wp), intent(out) :: a(n)                   !! [m, rad]
    integer :: k
    do k = 1, n
      if (at(k) > 0) then
        a(k) = q(at(k))
      else
        a(k) = 0.0_wp
      end if
    end do
  end subroutine nodal_values

  !> A marker moves by the coordinates of its node.
  pure subroutine attach(self, b, p)
    class(nodal_model), intent(in) :: self
    type(body_model), intent(in) :: b
    type(marker_model), intent(inout) :: p
    p%dof = b%dof(:3, p%node)
  end subroutine attach

  !> Compares the factor of m_ff.
  pure logical function same(self, other)
    class(nodal_model), intent(in) :: self
    class(elastic_basis), intent(in) :: other
    same = .false.
    select type (other)
    class is (nodal_model)
      if (same_type_as(self, other)) same = same_factor(self%mff, other%mff)
    end select
  end function same
end module nodal_basis
