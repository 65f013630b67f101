!> The dynamic stiffness of a mechanism at a trial state,
!>
!>   T(c1, c2) = c1 M + c2 C + K + sum_r sum_k alpha_rk (1 - g_k) K_r      g = 1/(1 + viscosity c2 + inertia c1)
!>
!> bordered by the joints, in structure: per body a factored elastic block with the columns T0^-1 S-bar^T and T0^-1 E^T, frames
!> condensed to 3 x 3 matrices, and a border of constraint rows and of the displacements on which force elements and curved joints
!> act (theory.md, section 7). What it is made of, set up once.
module condensed_system
  use kinds, only: wp, number
  use border_row_lists, only: row_lists
  use border_rows, only: row_system, set_up_rows
  use elastic_block, only: block_factor
  use mechanism, only: mechanism_model
  use row_sides, only: attached_markers
  implicit none (type, external)
  private
  public :: condensed_matrix, condensed_body, set_up_condensed, change_rows

  !> Markers of a flexible body where rows act: columns of the inverse block, and what markers see of them.
  type, extends(attached_markers) :: marker_columns
    logical :: full_block = .false.               !! the columns belong to the full block, not to T0
    real(number), allocatable :: xs(:, :)        !! (n, 2) T0^-1 S-bar^T [m/N kg ...]
    real(number), allocatable :: xe(:, :)        !! (n, nc) T0^-1 E^T [m/N ...]
    real(number), allocatable :: compliance(:, :, :, :)   !! (3, 3, na, na) E_i T0^-1 E_j^T [m/N ...]
    real(number), allocatable :: exs(:, :, :)    !! (3, 2, na) E_k T0^-1 S-bar^T [kg m/N ...]
    real(number), allocatable :: sxe(:, :)       !! (2, nc) S-bar T0^-1 E^T [kg m/N ...]
    real(number) :: pss(2, 2) = 0.0_wp           !! S-bar T0^-1 S-bar^T [kg2 m/N ...]
    real(number), allocatable :: exy(:, :)       !! (3, na) E_k T0^-1 times the angle's column [m, rad]
    real(number), allocatable :: exf(:, :)       !! (3, na) E_k T0^-1 times the residual [m, rad]
    real(number), allocatable :: rxe(:)          !! (nc) the angle's row times T0^-1 E^T [-, m]
    real(number), allocatable :: load(:)         !! (nc) forces of the rows on the columns [N, N m]
  end type marker_columns

  !> One body's share: a residual, then what solves it, and the tangent.
  type :: condensed_body
    integer :: n = 0                         !! elastic coordinates
    real(number) :: force(3) = 0.0_wp        !! residual of the frame, body axes [N, N, N m]
    real(number), allocatable :: elastic(:)  !! (n) residual of the elastic coordinates, then T0^-1 times it [N, N m], [m, rad]
    real(number) :: frame(3, 3) = 0.0_wp     !! tangent of the frame [N/m, N, N m]
    real(number) :: origin(2) = 0.0_wp       !! rows of the origin: origin(1) S + origin(2) H S; its columns: c1 S^T [kg/s2]
    real(number), allocatable :: column(:)   !! (n) tangent of the elastic residual by the angle, then T0^-1 times it [N, m, ...]
    real(number), allocatable :: row(:)      !! (n) tangent of the angle's residual by the elastic coordinates [N, N m]
    type(block_factor) :: block
    type(marker_columns) :: at
    real(number) :: inverse(3, 3) = 0.0_wp   !! of the condensed frame [m/N, rad/N]
    real(number) :: free(3) = 0.0_wp         !! frame's correction without rows [m, m, rad]
  end type condensed_body

  !> The condensed dynamic stiffness of a mechanism.
  type :: condensed_matrix
    real(number) :: c1 = 0.0_wp              !! [1/s2]
    real(number) :: c2 = 0.0_wp              !! [1/s]
    logical :: full_block = .false.               !! the full elastic blocks stand in the last tangent, not T0
    logical :: factored = .false.            !! T0 has a factor: with 1e28 1/s beside slow motion rounding may leave none
    logical :: solved = .false.              !! the elastic residuals have been solved
    type(condensed_body), allocatable :: b(:)
    type(row_system) :: rows
    real(number), allocatable :: element_factor(:)   !! (force elements) stiffness with the terms condensed over the static one [-]
  end type condensed_matrix

contains

  !> Work space of a mechanism.
  subroutine set_up_condensed(self, m, lists)
    type(condensed_matrix), intent(out) :: self
    type(mechanism_model), intent(in) :: m
    type(row_lists), intent(in) :: lists
    integer, allocatable :: local(:)
    integer :: b
    allocate (local(size(m%s%markers)), source=0)
    call set_up_rows(self%rows, lists)
    allocate (self%element_factor(size(m%s%forces)), self%b(size(m%s%bodies)))
    do b = 1, size(self%b)
      associate (x => self%b(b), body => m%s%bodies(b))
        if (.not. body%flexible) cycle
        x%n = body%nf
        allocate (x%elastic(x%n), x%column(x%n), x%row(x%n))
        call x%block%set_up(body%op, size(body%segments))
        call self%rows%attach(m%s, b, local, x%at)
        associate (at => x%at, n => x%n, na => size(x%at%marker), nc => size(x%at%owner))
          allocate (at%xs(n, 2), at%xe(n, nc), at%compliance(3, 3, na, na), at%exs(3, 2, na), at%exy(3, na), at%exf(3, na), &
                    at%sxe(2, nc), at%rxe(nc), at%load(nc))
        end associate
      end associate
    end do
  end subroutine set_up_condensed

  !> Other rows, whose markers are among those of the set-up. The bodies keep their factors.
  subroutine change_rows(self, m, lists)
    type(condensed_matrix), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(row_lists), intent(in) :: lists
    integer :: b, e
    call set_up_rows(self%rows, lists)
    do b = 1, size(self%b)
      if (.not. m%s%bodies(b)%flexible) cycle
      do e = self%rows%first(b), self%rows%first(b + 1) - 1
        self%rows%attachment(e) = findloc(self%b(b)%at%marker, self%rows%marker(e), 1)
      end do
    end do
  end subroutine change_rows
end module condensed_system
