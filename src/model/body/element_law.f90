!> What is asked about one element of a body, plain or of layers, outside of steps: inertia, stiffness by the segments whose terms
!> multiply it, rows of its deformations and the forces that they ask for.
module element_law
  use kinds, only: wp
  use beam_element, only: deformation_law, deformation_matrix, deformation_stiffness, element_gyroscopic, element_mass, &
    element_rotation, geometric_stiffness, present_deformation_matrix, shape_integral, shape_moment
  use body, only: body_model
  use layered_element, only: layered_element_model, most_coordinates
  use marker, only: turn
  implicit none (type, external)
  private
  public :: add_geometric, axial_force, damping_of, forces_of, inertia_of, part_rows, parts_of, row_damping, row_energies, &
    row_layers, row_materials, rows_of, segment_of, stiffness_part, strain_products

  !> Inertia of an element, body axes, with room for as many coordinates as any element of the body has.
  type, public :: element_inertia
    real(wp), allocatable :: m(:, :), j(:, :) !! translational and rotary [kg, kg m, kg m2]
    real(wp), allocatable :: z(:, :)          !! Z [kg, kg m, kg m2]
    real(wp), allocatable :: c(:, :)          !! Rayleigh damping by the mass [kg/s, ...]
    real(wp), allocatable :: s(:, :)          !! (2, coordinates) integral of N [kg, kg m]
    real(wp), allocatable :: along(:)         !! integral of u0.N, u0 from the first node [kg m, kg m2]
    real(wp), allocatable :: turning(:)       !! integral of (H u0).N and of turns [kg m, kg m2]
  end type element_inertia

contains

  !> Inertia of an element.
  pure function inertia_of(b, e) result(x)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    type(element_inertia) :: x
    real(wp) :: sx(2, 6), d(2)
    integer :: k, n
    n = size(b%edof, 1)
    allocate (x%m(n, n), x%j(n, n), x%z(n, n), x%c(n, n), x%s(2, n), x%along(n), x%turning(n), source=0.0_wp)
    associate (g => b%elements(e))
      if (.not. allocated(b%layers)) then
        x%m(:6, :6) = element_mass(g)
        x%z(:6, :6) = element_gyroscopic(g)
        x%c(:6, :6) = g%ray_m*x%m(:6, :6)
        x%s(:, :6) = shape_integral(g)
        sx = shape_moment(g)
        d = b%x(:, b%en(2, e)) - b%x(:, b%en(1, e))
        do k = 1, 6
          x%along(k) = dot_product(d, sx(:, k))
          x%turning(k) = dot_product(turn(d), sx(:, k))
        end do
      else
        associate (kind => b%layers%kinds(b%layers%kind(e)))
          n = kind%coordinates
          x%m(:n, :n) = to_body(b, e, kind%m)
          x%j(:n, :n) = to_body(b, e, kind%j)
          x%z(:n, :n) = to_body(b, e, kind%z)
          x%c(:n, :n) = to_body(b, e, kind%c)
          x%s(:, :n) = matmul(reshape([g%c, g%s, -g%s, g%c], [2, 2]), matmul(kind%s, rotation(b, e, n)))
          x%along(:n) = matmul(kind%along, rotation(b, e, n))
          x%turning(:n) = matmul(kind%turning, rotation(b, e, n))
        end associate
      end if
    end associate
  end function inertia_of

  !> Coordinates in element axes from those in body axes.
  pure function rotation(b, e, n) result(t)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e, n
    real(wp) :: t(n, n)                       !! [-]
    integer :: k
    t = 0.0_wp
    t(:6, :6) = element_rotation(b%elements(e))
    do k = 7, n
      t(k, k) = 1.0_wp
    end do
  end function rotation

  !> A matrix from element into body axes.
  pure function to_body(b, e, a) result(t)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e
    real(wp), intent(in) :: a(:, :)           !! element axes [any]
    real(wp) :: t(size(a, 1), size(a, 1))     !! [any]
    t = rotation(b, e, size(a, 1))
    t = matmul(transpose(t), matmul(a, t))
  end function to_body

  !> Parts of an element's stiffness: rows that different segments follow, or none.
  pure integer function parts_of(b, e) result(n)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    n = 1
    if (allocated(b%layers)) n = count(b%layers%part(:, e) >= 0)
  end function parts_of

  !> The segment whose terms multiply a part of an element's stiffness; 0: none.
  pure integer function segment_of(b, e, part) result(segment)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    integer, intent(in) :: part
    integer :: r
    if (allocated(b%layers)) then
      segment = b%layers%part(part, e)
    else
      segment = 0
      do r = 1, size(b%segments)
        if (e >= b%segments(r)%first .and. e <= b%segments(r)%last) segment = r
      end do
    end if
  end function segment_of

  !> A part of an element's stiffness at E_R, body axes; with geometric stiffening at present coordinates, else at rest.
  pure subroutine stiffness_part(b, e, part, k, x)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    integer, intent(in) :: part
    real(wp), intent(inout) :: k(:, :)        !! (coordinates or more) [N/m, N, N m]
    real(wp), intent(in), optional :: x(6)    !! [m, rad]
    real(wp) :: d(3, 6)                       ! [-], [1/m]
    if (present(x)) then
      d = present_deformation_matrix(b%elements(e), x)
    else
      d = deformation_matrix(b%elements(e))
    end if
    if (allocated(b%layers)) then
      call layered_stiffness(b%layers%kinds(b%layers%kind(e)), part_rows(b, e, part), d, k)
    else
      k(:6, :6) = deformation_stiffness(b%elements(e), d)
    end if
  end subroutine stiffness_part

  !> 1 for the rows of a part, 0 for others.
  pure function part_rows(b, e, part) result(weight)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    integer, intent(in) :: part
    real(wp), allocatable :: weight(:)        !! [-]
    if (allocated(b%layers)) then
      weight = merge(1.0_wp, 0.0_wp, b%layers%row_part(:, e) == part)
    else
      weight = [1.0_wp, 1.0_wp, 1.0_wp]
    end if
  end function part_rows

  !> U^T K U with weights of the rows, from the deformations: nodal forces lose what the motion of small elements as rigid bodies
  !> cancels.
  pure function strain_products(b, e, weight, u) result(k)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    real(wp), intent(in) :: weight(:)         !! of each row; without layers the same for all [any]
    real(wp), intent(in) :: u(:, :)           !! (coordinates, columns) body axes [m, rad]
    real(wp) :: k(size(u, 2), size(u, 2))     !! [J]
    real(wp) :: d(3, size(u, 2))              ! [m, rad]
    real(wp), allocatable :: rows(:, :)       ! [m, rad]
    integer :: j
    d = matmul(deformation_matrix(b%elements(e)), u(:6, :))
    if (allocated(b%layers)) then
      associate (kind => b%layers%kinds(b%layers%kind(e)))
        rows = matmul(kind%rows(:, :3), d) + matmul(kind%rows(:, 4:), u(7:kind%coordinates, :))
        do j = 1, size(k, 2)
          k(:, j) = matmul(kind%stiffness*weight(:size(kind%stiffness))*rows(:, j), rows)
        end do
      end associate
    else
      k = weight(1)*matmul(transpose(d), matmul(deformation_law(b%elements(e)), d))
    end if
  end function strain_products

  !> The stiffness of an element of layers, its rows with weights.
  pure subroutine layered_stiffness(kind, weight, d, k)
    type(layered_element_model), intent(in) :: kind
    real(wp), intent(in) :: weight(:)         !! (rows or more) [any]
    real(wp), intent(in) :: d(3, 6)           !! (e, phi1, phi2) from coordinates [-], [1/m]
    real(wp), intent(inout) :: k(:, :)        !! [N/m, N, N m]
    real(wp) :: row(most_coordinates)         ! [-], [1/m]
    integer :: i, j, n
    n = kind%coordinates
    k(:n, :n) = 0.0_wp
    do i = 1, size(kind%stiffness)
      if (.not. abs(weight(i)) > 0.0_wp) cycle
      row(:6) = matmul(kind%rows(i, :3), d)
      row(7:n) = kind%rows(i, 4:)
      do j = 1, n
        k(:n, j) = k(:n, j) + weight(i)*kind%stiffness(i)*row(j)*row(:n)
      end do
    end do
  end subroutine layered_stiffness

  !> Rayleigh damping of an element, by its mass and stiffness.
  pure subroutine damping_of(b, e, x, c)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    type(element_inertia), intent(in) :: x
    real(wp), intent(inout) :: c(:, :)        !! (coordinates or more) [kg/s, ...]
    if (allocated(b%layers)) then
      call layered_stiffness(b%layers%kinds(b%layers%kind(e)), row_damping(b, e), deformation_matrix(b%elements(e)), c)
    else
      c(:6, :6) = b%elements(e)%ray_k*deformation_stiffness(b%elements(e), deformation_matrix(b%elements(e)))
    end if
    c(:size(x%c, 1), :size(x%c, 1)) = x%c + c(:size(x%c, 1), :size(x%c, 1))
  end subroutine damping_of

  !> Adds the geometric stiffness of an axial force.
  pure subroutine add_geometric(b, e, n, k)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    real(wp), intent(in) :: n                 !! terms' part included [N]
    real(wp), intent(inout) :: k(:, :)        !! [N/m, N, N m]
    k(:6, :6) = k(:6, :6) + geometric_stiffness(b%elements(e), n)
  end subroutine add_geometric

  !> Axial force of an element.
  pure real(wp) function axial_force(b, e, ds) result(n)   ! [N]
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    real(wp), intent(in) :: ds(:, :)          !! deformations of the body with terms' differences [m, rad]
    integer :: i
    if (allocated(b%layers)) then
      n = 0.0_wp
      associate (kind => b%layers%kinds(b%layers%kind(e)))
        do i = 1, size(kind%stiffness)
          n = n + kind%force(1, i)*ds(1, b%layers%row(i, e))
        end do
      end associate
    else
      n = b%elements(e)%ea_l*ds(1, e)
    end if
  end function axial_force

  !> Rows of an element's deformations, linear ones or with stiffening their change about present coordinates: (e, phi1, phi2), or
  !> those of its layers.
  pure function rows_of(b, e, a, now) result(d)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    real(wp), intent(in) :: a(:)              !! coordinates, body axes [m, rad]
    real(wp), intent(in), optional :: now(:)  !! [m, rad]
    real(wp), allocatable :: d(:)             !! [m, rad]
    real(wp) :: ends(3)                       ! (e, phi1, phi2) [m, rad]
    if (b%stiffening .and. present(now)) then
      ends = matmul(present_deformation_matrix(b%elements(e), now(:6)), a(:6))
    else
      ends = matmul(deformation_matrix(b%elements(e)), a(:6))
    end if
    if (allocated(b%layers)) then
      associate (kind => b%layers%kinds(b%layers%kind(e)))
        d = matmul(kind%rows, [ends, a(7:kind%coordinates)])
      end associate
    else
      d = ends
    end if
  end function rows_of

  !> Forces conjugate to (e, phi1, phi2).
  pure function forces_of(b, e, d) result(f)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    complex(wp), intent(in) :: d(:)           !! rows, terms' differences included [m, rad]
    complex(wp) :: f(3)                       !! [N], [N m]
    if (allocated(b%layers)) then
      f = matmul(b%layers%kinds(b%layers%kind(e))%force(:3, :), d)
    else
      f = matmul(deformation_law(b%elements(e)), d)
    end if
    if (.not. b%axial) f(1) = 0.0_wp
  end function forces_of

  !> The material whose terms follow each row, 0: none.
  pure function row_materials(b, e) result(material)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    integer, allocatable :: material(:)
    integer :: segment
    if (allocated(b%layers)) then
      material = b%layers%kinds(b%layers%kind(e))%material
    else
      segment = b%elements(e)%material
      material = [segment, segment, segment]
    end if
  end function row_materials

  !> The layer of each row; without layers 0.
  pure function row_layers(b, e) result(layer)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    integer, allocatable :: layer(:)
    if (allocated(b%layers)) then
      layer = b%layers%kinds(b%layers%kind(e))%layer
    else
      layer = [0, 0, 0]
    end if
  end function row_layers

  !> Twice the energy of each row at E_R; without layers a product of a row with all.
  pure function row_energies(b, e, d) result(energy)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    real(wp), intent(in) :: d(:)              !! rows [m, rad]
    real(wp), allocatable :: energy(:)        !! [J]
    if (allocated(b%layers)) then
      energy = b%layers%kinds(b%layers%kind(e))%stiffness*d**2
    else
      energy = d*matmul(deformation_law(b%elements(e)), d)
    end if
  end function row_energies

  !> Rayleigh stiffness coefficient of each row.
  pure function row_damping(b, e) result(ray_k)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    real(wp), allocatable :: ray_k(:)         !! [s]
    if (allocated(b%layers)) then
      ray_k = b%layers%kinds(b%layers%kind(e))%ray_k
    else
      ray_k = spread(b%elements(e)%ray_k, 1, 3)
    end if
  end function row_damping
end module element_law
