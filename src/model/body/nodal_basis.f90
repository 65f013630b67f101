!> Flexible bodies in nodal coordinates: rows of deformations element by element, the forces that they ask for, their energy
!> (theory.md, sections 4 and 16). Each row of an element is a column of the deformations; the rows that one segment follows stand
!> side by side.
module nodal_basis
  use kinds, only: wp
  use banded, only: band_factor, band_solve, band_solve_two, same_factor
  use beam_element, only: beam_geometry
  use body, only: body_model, elastic_basis, elastic_work
  use element_law, only: add_geometric, forces_of, parts_of, stiffness_part
  use layered_element, only: layered_element_model, most_coordinates
  use marker, only: marker_model
  use triplets, only: triplet_matrix
  implicit none (type, external)
  private

  !> A basis of nodal coordinates.
  type, extends(elastic_basis), public :: nodal_model
    type(band_factor) :: mff                        !! factor of m_ff
    logical :: straight = .true.                    !! all elements along body x
    integer, allocatable :: at(:, :)                !! (0:6, ne) column of an element's first row, its ends' coordinates
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

  !> Rows of all elements.
  pure subroutine deform(self, b, q, d)
    class(nodal_model), intent(in) :: self
    type(body_model), intent(in) :: b
    real(wp), intent(in), contiguous :: q(0:)       !! (0:nf) coordinates, entry 0 is zero [m, rad]
    real(wp), intent(inout), contiguous :: d(:, :)  !! (1, rows of all elements) [m, rad]
    call element_rows(b, b%ne, b%elements, self%at, b%stiffening, self%straight, q, d)
  end subroutine deform

  !> As plain arrays, with the terms of stiffening or without. Of one layer the rows are (e, phi2 - phi1, (phi1 + phi2)/2), or the
  !> last two without axial deformation.
  pure subroutine element_rows(b, ne, elements, at, stiffening, straight, q, d)
    type(body_model), intent(in) :: b
    integer, intent(in) :: ne
    type(beam_geometry), intent(in) :: elements(ne)
    integer, intent(in) :: at(0:6, ne)
    logical, intent(in) :: stiffening, straight
    real(wp), intent(in) :: q(0:*)                  !! (0:nf) [m, rad]
    real(wp), intent(inout) :: d(*)                 !! (rows of all elements) [m, rad]
    real(wp) :: a(6), psi, slope(2), x(most_coordinates)
    integer :: e, i
    do e = 1, ne
      associate (g => elements(e))
        a = q(at(1:, e))
        if (.not. straight) call to_element(g%c, g%s, a)
        psi = (a(5) - a(2))/g%length
        a(4) = a(4) - a(1)
        if (stiffening) then
          slope = end_slopes(g, a, psi)
          a(4) = a(4) + g%length*(0.5_wp*psi**2 + (2*slope(1)**2 - slope(1)*slope(2) + 2*slope(2)**2)/30)
        end if
        if (g%turn_l > 0.0_wp) then
          i = at(0, e)
          if (b%axial) then
            d(i) = a(4)
            i = i + 1
          end if
          d(i) = a(6) - a(3)
          d(i + 1) = 0.5_wp*(a(3) + a(6)) - psi
        else
          associate (k => b%layers%kinds(b%layers%kind(e)))
            x(:3) = [a(4), a(3) - psi, a(6) - psi]
            x(4:k%deformations) = q(b%edof(7:k%coordinates, e))
            do i = 1, size(k%stiffness)
              d(b%layers%row(i, e)) = dot_product(k%rows(i, :), x(:k%deformations))
            end do
          end associate
        end if
      end associate
    end do
  end subroutine element_rows

  !> Slopes of an element's axis at both ends against the chord.
  pure function end_slopes(g, a, psi) result(slope)
    type(beam_geometry), intent(in) :: g
    real(wp), intent(in) :: a(6)                    !! coordinates, element axes [m, rad]
    real(wp), intent(in) :: psi                     !! turn of the chord [rad]
    real(wp) :: slope(2)                            !! [rad]
    slope = [a(3), a(6)] - psi - g%softening*(0.5_wp*(a(3) + a(6)) - psi)
  end function end_slopes

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

  !> Adds the forces that the deformations ask for, with the terms of stiffening, times a factor to f.
  pure subroutine add_stress(self, b, d, ds, q, factor, f)
    class(nodal_model), intent(in) :: self
    type(body_model), intent(in) :: b
    real(wp), intent(in), contiguous :: d(:, :), ds(:, :)   !! (1, rows) deformations, and with terms' differences [m, rad]
    real(wp), intent(in), contiguous :: q(0:)       !! (0:nf) coordinates, entry 0 is zero [m, rad]
    real(wp), intent(in) :: factor                  !! 1, or -1 for forces that they exert [-]
    real(wp), intent(inout), contiguous :: f(0:)    !! (0:nf) [N, N m], entry 0 is thrown away
    call add_elements(b, b%ne, b%elements, self%at, self%straight, ds, q, factor, f)
  end subroutine add_stress

  !> As plain arrays.
  pure subroutine add_elements(b, ne, elements, at, straight, ds, q, factor, f)
    type(body_model), intent(in) :: b
    integer, intent(in) :: ne
    type(beam_geometry), intent(in) :: elements(ne)
    integer, intent(in) :: at(0:6, ne)
    logical, intent(in) :: straight
    real(wp), intent(in) :: ds(*)                   !! (rows of all elements) [m, rad]
    real(wp), intent(in) :: q(0:*)                  !! (0:nf) [m, rad]
    real(wp), intent(in) :: factor                  !! [-]
    real(wp), intent(inout) :: f(0:*)               !! (0:nf) [N, N m]
    real(wp) :: h(most_coordinates), a(6), y(6), slope(2), m(2), n, psi
    integer :: e, i
    do e = 1, ne
      associate (g => elements(e))
        if (g%turn_l > 0.0_wp) then
          i = at(0, e)
          h(1) = 0.0_wp
          if (b%axial) then
            h(1) = factor*g%ea_l*ds(i)
            i = i + 1
          end if
          y(2) = factor*g%ei_l*ds(i)
          y(3) = 0.5_wp*factor*g%turn_l*ds(i + 1)
          h(2) = y(3) - y(2)
          h(3) = y(3) + y(2)
        else
          associate (k => b%layers%kinds(b%layers%kind(e)))
            h(:k%deformations) = 0.0_wp
            do i = 1, size(k%stiffness)
              h(:k%deformations) = h(:k%deformations) + k%force(:, i)*(factor*ds(b%layers%row(i, e)))
            end do
            do i = 7, k%coordinates
              f(b%edof(i, e)) = f(b%edof(i, e)) + h(i - 3)
            end do
          end associate
        end if
        y(2) = 0.0_wp
        if (b%stiffening) then
          a = q(at(1:, e))
          if (.not. straight) call to_element(g%c, g%s, a)
          psi = (a(5) - a(2))/g%length
          slope = end_slopes(g, a, psi)
          n = h(1)*g%length/30
          m = n*[4*slope(1) - slope(2), 4*slope(2) - slope(1)]
          h(2:3) = h(2:3) + m - 0.5_wp*g%softening*sum(m)
          y(2) = -h(1)*psi
        end if
        y(2) = y(2) + (h(2) + h(3))/g%length
        y = [-h(1), y(2), h(2), h(1), -y(2), h(3)]
        if (.not. straight) call to_element(g%c, -g%s, y)
        do i = 1, 6
          f(at(i, e)) = f(at(i, e)) + y(i)
        end do
      end associate
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

  !> Twice the energies of axial forces, of bending with what it stretches, and of layers that slip.
  pure recursive function strain_parts(self, b, q, d) result(parts)
    class(nodal_model), intent(in) :: self
    type(body_model), intent(in) :: b
    real(wp), intent(in) :: q(:)                    !! (nf) [m, rad]
    real(wp), intent(in), contiguous, optional :: d(:, :)   !! (1, rows of all elements) [m, rad]
    real(wp) :: parts(3)                            !! [J]
    real(wp), allocatable :: x(:, :)                ! [m, rad]
    real(wp) :: force, axial, all, slip, one        ! [N], twice energies [J]
    logical :: slides                               ! where layers slip, their stretch counts with the slip
    integer :: e, i
    if (.not. present(d)) then
      allocate (x(1, self%columns))
      call element_rows(b, b%ne, b%elements, self%at, .false., self%straight, [0.0_wp, q], x)
      parts = self%strain_parts(b, q, x)
      return
    end if
    parts = 0.0_wp
    do e = 1, b%ne
      associate (g => b%elements(e), kind => b%layers%kinds(b%layers%kind(e)), row => b%layers%row(:, e))
        if (g%turn_l > 0.0_wp) then                  ! rows as in element_rows
          i = self%at(0, e)
          if (b%axial) then
            parts(1) = parts(1) + g%ea_l*d(1, i)**2
            i = i + 1
          end if
          parts(2) = parts(2) + g%ei_l*d(1, i)**2 + g%turn_l*d(1, i + 1)**2
          cycle
        end if
        slides = kind%coordinates > 6
        force = 0.0_wp
        all = 0.0_wp
        slip = 0.0_wp
        do i = 1, size(kind%stiffness)
          one = kind%stiffness(i)*d(1, row(i))**2
          force = force + kind%force(1, i)*d(1, row(i))
          all = all + one
          if (slides .and. (kind%shear(i) .or. .not. kind%angle(i))) slip = slip + one
        end do
        axial = force**2/g%ea_l
        if (slides) slip = slip - axial
        parts = parts + [axial, all - axial - slip, slip]
      end associate
    end do
  end function strain_parts

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

  !> Rows of an element, as the last evaluation left them.
  pure function element_strain(self, b, e, w) result(d)
    class(nodal_model), intent(in) :: self
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                        !! element
    type(elastic_work), intent(in) :: w
    real(wp), allocatable :: d(:)                   !! [m, rad]
    d = w%ds(1, b%layers%row(:size(b%layers%kinds(b%layers%kind(e))%stiffness), e))
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
    real(wp) :: k(max(most_coordinates, size(b%edof, 1)), max(most_coordinates, size(b%edof, 1))), x(0:b%nf)
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
        r = b%layers%part(part, e)
        if (r > 0 .and. r <= size(segments)) call segments(r)%add_block(at, at, k(:n, :n))
        if (b%stiffening .and. part == 1) call add_geometric(b, e, w%ds, k)
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
    type is (nodal_model)
      same = same_factor(self%mff, other%mff)
    end select
  end function same
end module nodal_basis
