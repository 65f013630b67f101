!> Nodal coordinates of bodies of layered sections and of sections that shear (theory.md, section 16). Each row of an element is a
!> column of the deformations; the rows that one segment follows stand side by side.
module layered_basis
  use kinds, only: wp
  use beam_element, only: beam_geometry
  use body, only: body_model, elastic_work
  use layered_element, only: layered_element_model, most_coordinates
  use nodal_basis, only: nodal_model, to_element
  implicit none (type, external)
  private

  !> A basis of nodal coordinates with layers.
  type, extends(nodal_model), public :: layered_model
  contains
    procedure :: deform
    procedure :: add_stress
    procedure :: strain_parts
    procedure :: element_strain
  end type layered_model

contains

  !> Rows of all elements.
  pure subroutine deform(self, b, q, d)
    class(layered_model), intent(in) :: self
    type(body_model), intent(in) :: b
    real(wp), intent(in), contiguous :: q(0:)       !! (0:nf) coordinates, entry 0 is zero [m, rad]
    real(wp), intent(inout), contiguous :: d(:, :)  !! (1, rows of all elements) [m, rad]
    call all_rows(self, b, b%stiffening, q, d)
  end subroutine deform

  !> The same, with the terms of stiffening or without.
  pure subroutine all_rows(self, b, stiffening, q, d)
    class(layered_model), intent(in) :: self
    type(body_model), intent(in) :: b
    logical, intent(in) :: stiffening
    real(wp), intent(in), contiguous :: q(0:)       !! (0:nf) [m, rad]
    real(wp), intent(inout), contiguous :: d(:, :)  !! (1, rows of all elements) [m, rad]
    real(wp) :: x(most_coordinates), psi, slope(2)
    integer :: e
    do e = 1, b%ne
      associate (kind => b%layers%kinds(b%layers%kind(e)))
        call element_deformations(b%elements(e), self%straight, q(b%edof(:, e)), x, psi, slope)
        if (stiffening) x(1) = x(1) + kind%length*(0.5_wp*psi**2 + (2*slope(1)**2 - slope(1)*slope(2) + 2*slope(2)**2)/30)
        call add_rows(size(kind%stiffness), kind%deformations, kind%rows, x, b%layers%row(1, e), d)
      end associate
    end do
  end subroutine all_rows

  !> Linear deformations of an element, the turn of its chord and the slopes of its axis at both ends against the chord.
  pure subroutine element_deformations(g, straight, a, x, psi, slope)
    type(beam_geometry), intent(in) :: g
    logical, intent(in) :: straight                 !! along body x
    real(wp), intent(in) :: a(:)                    !! coordinates, body axes [m, rad]
    real(wp), intent(inout) :: x(most_coordinates)  !! (e, phi1, phi2, cores) [m, rad]
    real(wp), intent(out) :: psi, slope(2)          !! [rad]
    real(wp) :: ends(6), half
    integer :: i
    ends = a(:6)
    if (.not. straight) call to_element(g%c, g%s, ends)
    psi = (ends(5) - ends(2))/g%length
    x(1) = ends(4) - ends(1)
    x(2) = ends(3) - psi
    x(3) = ends(6) - psi
    do i = 7, size(a)
      x(i - 3) = a(i)
    end do
    half = 0.5_wp*g%softening*(x(2) + x(3))
    slope = x(2:3) - half
  end subroutine element_deformations

  !> Rows of an element from its deformations.
  pure subroutine add_rows(rows, n, matrix, x, at, d)
    integer, intent(in) :: rows, n
    real(wp), intent(in) :: matrix(rows, n)         !! [-], [m]
    real(wp), intent(in) :: x(n)                    !! [m, rad]
    integer, intent(in) :: at(rows)                 !! places of the rows
    real(wp), intent(inout) :: d(*)                 !! [m, rad]
    real(wp) :: y(rows)
    integer :: j
    y = 0.0_wp
    do j = 1, n
      y = y + matrix(:, j)*x(j)
    end do
    d(at) = y
  end subroutine add_rows

  !> Adds the forces that the deformations ask for, times a factor.
  pure subroutine add_stress(self, b, d, ds, q, factor, f)
    class(layered_model), intent(in) :: self
    type(body_model), intent(in) :: b
    real(wp), intent(in), contiguous :: d(:, :), ds(:, :)   !! (1, rows) deformations, and with terms' differences [m, rad]
    real(wp), intent(in), contiguous :: q(0:)       !! (0:nf) [m, rad]
    real(wp), intent(in) :: factor                  !! 1, or -1 for forces that they exert [-]
    real(wp), intent(inout), contiguous :: f(0:)    !! (0:nf) [N, N m], entry 0 is thrown away
    real(wp) :: x(most_coordinates), h(most_coordinates), y(6), psi, slope(2), m(2), n
    integer :: e, i
    do e = 1, b%ne
      associate (kind => b%layers%kinds(b%layers%kind(e)), g => b%elements(e), at => b%edof(:, e))
        call element_forces(kind%deformations, size(kind%stiffness), kind%force, b%layers%row(1, e), ds, h)
        h(:kind%deformations) = factor*h(:kind%deformations)
        y(2) = 0.0_wp
        if (b%stiffening) then
          call element_deformations(g, self%straight, q(at), x, psi, slope)
          n = h(1)*g%length/30
          m = n*[4*slope(1) - slope(2), 4*slope(2) - slope(1)]
          h(2:3) = h(2:3) + m - 0.5_wp*g%softening*sum(m)
          y(2) = -h(1)*psi
        end if
        y(2) = y(2) + (h(2) + h(3))/g%length
        y = [-h(1), y(2), h(2), h(1), -y(2), h(3)]
        if (.not. self%straight) call to_element(g%c, -g%s, y)
        do i = 1, 6
          f(at(i)) = f(at(i)) + y(i)
        end do
        do i = 7, kind%coordinates
          f(at(i)) = f(at(i)) + h(i - 3)
        end do
      end associate
    end do
  end subroutine add_stress

  !> Forces conjugate to an element's deformations.
  pure subroutine element_forces(n, rows, matrix, at, ds, h)
    integer, intent(in) :: n, rows
    real(wp), intent(in) :: matrix(n, rows)         !! [N/m], [N], [N m]
    integer, intent(in) :: at(rows)                 !! places of the rows
    real(wp), intent(in) :: ds(*)                   !! [m, rad]
    real(wp), intent(out) :: h(n)                   !! [N, N m]
    integer :: i
    h = 0.0_wp
    do i = 1, rows
      h = h + matrix(:, i)*ds(at(i))
    end do
  end subroutine element_forces

  !> Twice the energies of axial forces, of bending with what it stretches, and of layers that slip.
  pure function strain_parts(self, b, q, d) result(parts)
    class(layered_model), intent(in) :: self
    type(body_model), intent(in) :: b
    real(wp), intent(in) :: q(:)                    !! (nf) [m, rad]
    real(wp), intent(in), contiguous, optional :: d(:, :)   !! (1, rows of all elements) [m, rad]
    real(wp) :: parts(3)                            !! [J]
    real(wp), allocatable :: x(:, :)                ! [m, rad]
    real(wp) :: axial                               ! force, then twice its energy [N], [J]
    integer :: e, i, part, rest
    allocate (x(1, self%columns))
    if (present(d)) then
      x = d
    else
      call all_rows(self, b, .false., [0.0_wp, q], x)
    end if
    parts = 0.0_wp
    do e = 1, b%ne
      associate (kind => b%layers%kinds(b%layers%kind(e)), row => b%layers%row(:, e))
        rest = merge(3, 2, kind%coordinates > 6)     ! where layers slip, their stretch counts with the slip
        axial = 0.0_wp
        do i = 1, size(kind%stiffness)
          axial = axial + kind%force(1, i)*x(1, row(i))
          part = merge(rest, 2, kind%shear(i) .or. .not. kind%angle(i))
          parts(part) = parts(part) + kind%stiffness(i)*x(1, row(i))**2
        end do
        axial = axial**2/b%elements(e)%ea_l
        parts(1) = parts(1) + axial
        parts(rest) = parts(rest) - axial
      end associate
    end do
  end function strain_parts

  !> Rows of an element, as the last evaluation left them.
  pure function element_strain(self, b, e, w) result(d)
    class(layered_model), intent(in) :: self
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                        !! element
    type(elastic_work), intent(in) :: w
    real(wp), allocatable :: d(:)                   !! [m, rad]
    d = w%ds(1, b%layers%row(:size(b%layers%kinds(b%layers%kind(e))%stiffness), e))
  end function element_strain
end module layered_basis
