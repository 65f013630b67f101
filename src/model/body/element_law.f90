!> What is asked about one element of a body outside of steps: inertia, stiffness by the segments whose terms multiply it, rows of
!> its deformations and the forces that they ask for.
module element_law
  use kinds, only: wp
  use beam_element, only: deformation_matrix, element_rotation, geometric_stiffness, present_deformation_matrix
  use body, only: body_model
  use layered_element, only: element_inertia, most_coordinates
  implicit none (type, external)
  private
  public :: add_geometric, forces_of, inertia_of, parts_of, rows_of, stiffness_part, strain_products, weighted_stiffness

contains

  !> Inertia of an element, body axes, with room for as many coordinates as any element of the body has.
  pure function inertia_of(b, e) result(x)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    type(element_inertia) :: x
    real(wp) :: t(size(b%edof, 1), size(b%edof, 1))   ! coordinates in element axes from those in body axes [-]
    integer :: k, n
    n = size(b%edof, 1)
    t = 0.0_wp
    t(:6, :6) = element_rotation(b%elements(e))
    do k = 7, n
      t(k, k) = 1.0_wp
    end do
    associate (g => b%elements(e), kind => b%layers%kinds(b%layers%kind(e)))
      x%m = turned(kind%m)
      x%j = turned(kind%j)
      x%z = turned(kind%z)
      x%c = turned(kind%c)
      k = kind%coordinates
      x%s = matmul(reshape([g%c, g%s, -g%s, g%c], [2, 2]), matmul(kind%s, t(:k, :)))
      x%along = matmul(kind%along, t(:k, :))
      x%turning = matmul(kind%turning, t(:k, :))
    end associate
  contains
    !> A matrix from element into body axes.
    pure function turned(a) result(y)
      real(wp), intent(in) :: a(:, :)         !! element axes [any]
      real(wp) :: y(n, n)                     !! [any]
      y = matmul(transpose(t(:size(a, 1), :)), matmul(a, t(:size(a, 1), :)))
    end function turned
  end function inertia_of

  !> Parts of an element's stiffness: rows that different segments follow, or none.
  pure integer function parts_of(b, e) result(n)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    n = count(b%layers%part(:, e) >= 0)
  end function parts_of

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
    call weighted_stiffness(b, e, merge(1.0_wp, 0.0_wp, b%layers%row_part(:, e) == part), d, k)
  end subroutine stiffness_part

  !> The stiffness of an element at E_R, its rows with weights.
  pure subroutine weighted_stiffness(b, e, weight, d, k)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    real(wp), intent(in) :: weight(:)         !! (rows or more) [any]
    real(wp), intent(in) :: d(3, 6)           !! (e, phi1, phi2) from coordinates [-], [1/m]
    real(wp), intent(inout) :: k(:, :)        !! [N/m, N, N m]
    real(wp) :: row(most_coordinates)         ! [-], [1/m]
    integer :: i, j, n
    associate (kind => b%layers%kinds(b%layers%kind(e)))
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
    end associate
  end subroutine weighted_stiffness

  !> U^T K U with weights of the rows, from the deformations: nodal forces lose what the motion of small elements as rigid bodies
  !> cancels.
  pure function strain_products(b, e, weight, u) result(k)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    real(wp), intent(in) :: weight(:)         !! of each row [any]
    real(wp), intent(in) :: u(:, :)           !! (coordinates, columns) body axes [m, rad]
    real(wp) :: k(size(u, 2), size(u, 2))     !! [J]
    real(wp), allocatable :: rows(:, :)       ! [m, rad]
    integer :: j
    associate (kind => b%layers%kinds(b%layers%kind(e)))
      rows = matmul(kind%rows(:, :3), matmul(deformation_matrix(b%elements(e)), u(:6, :))) + &
             matmul(kind%rows(:, 4:), u(7:kind%coordinates, :))
      do j = 1, size(k, 2)
        k(:, j) = matmul(kind%stiffness*weight(:size(kind%stiffness))*rows(:, j), rows)
      end do
    end associate
  end function strain_products

  !> Adds the geometric stiffness of the axial force.
  pure subroutine add_geometric(b, e, ds, k)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    real(wp), intent(in) :: ds(:, :)          !! (1, rows) deformations of the body with terms' differences [m, rad]
    real(wp), intent(inout) :: k(:, :)        !! [N/m, N, N m]
    associate (force => b%layers%kinds(b%layers%kind(e))%force)
      k(:6, :6) = k(:6, :6) + geometric_stiffness(b%elements(e), &
                                                  dot_product(force(1, :), ds(1, b%layers%row(:size(force, 2), e))))
    end associate
  end subroutine add_geometric

  !> Rows of an element's deformations, linear ones or with stiffening their change about present coordinates.
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
    associate (kind => b%layers%kinds(b%layers%kind(e)))
      d = matmul(kind%rows, [ends, a(7:kind%coordinates)])
    end associate
  end function rows_of

  !> Forces conjugate to (e, phi1, phi2).
  pure function forces_of(b, e, d) result(f)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    complex(wp), intent(in) :: d(:)           !! rows, terms' differences included [m, rad]
    complex(wp) :: f(3)                       !! [N], [N m]
    f = matmul(b%layers%kinds(b%layers%kind(e))%force(:3, :), d)
    if (.not. b%axial) f(1) = 0.0_wp
  end function forces_of
end module element_law
