!> Work space of implicit methods for a mechanism: the equations of the bodies at a trial state, internal variables condensed, and
!> the dynamic stiffness that solves for corrections (`condensed_system`). `newton_equations` fills it.
module newton_system
  use kinds, only: wp
  use body_terms, only: body_equations, set_up_terms
  use border_row_lists, only: row_lists, list_rows, order_rows
  use condensed_system, only: condensed_matrix, set_up_condensed
  use condensed_terms, only: condensed_term, list_terms
  use force_element, only: by_position
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: set_up_newton

  !> Equations and dynamic stiffness of a mechanism.
  type, public :: newton_matrix
    type(body_equations), allocatable :: eq(:)   !! (bodies)
    type(condensed_matrix) :: t
    type(condensed_term), allocatable :: terms(:)
    logical :: stages = .false.              !! residuals are given the internal variables of stages
    real(wp), allocatable :: offset(:)       !! (nz) dissipative coordinates at zero deformation [m, rad]
    real(wp), allocatable :: element_z(:), element_zd(:) !! (nz) of force elements at the trial state [m, rad], unused rates
    real(wp), allocatable :: wrench(:, :)    !! (3, markers) residual force (body axes) and moment [N, N m]
  end type newton_matrix

contains

  !> Work space of a mechanism.
  subroutine set_up_newton(self, m)
    type(newton_matrix), intent(out) :: self
    type(mechanism_model), intent(in) :: m
    type(row_lists) :: lists
    integer :: b, nz, k
    nz = m%s%nz
    allocate (self%offset(nz), self%element_z(nz), self%element_zd(nz), source=0.0_wp)
    allocate (self%wrench(3, size(m%s%markers)), source=0.0_wp)
    call list_terms(m%s, self%terms)
    allocate (self%eq(size(m%s%bodies)))
    do b = 1, size(self%eq)
      call set_up_terms(self%eq(b), m%s%bodies(b))
    end do
    call list_rows(lists, m, [(by_position, k=1, size(m%s%switching))])   ! room for elements in every state
    call order_rows(lists)
    call set_up_condensed(self%t, m, lists)
  end subroutine set_up_newton
end module newton_system
