!> The dynamic stiffness T(c1, c2) = c1 M + c2 C + K of a mechanism at a trial state, bordered by the joints, in structure: per
!> body a factored elastic block with the columns T0^-1 S-bar^T and T0^-1 E^T, frames condensed to 3 x 3 matrices, and a border of
!> constraint rows and of the displacements on which force elements and curved joints act. What it is made of, set up once;
!> `newton_equations` fills it (theory.md, section 7).
module newton_system
  use kinds, only: wp, ip
  use body_terms, only: body_equations, set_up_terms
  use border_row_lists, only: list_rows, order_rows
  use border_rows, only: row_system
  use elastic_block, only: block_factor
  use condensed_terms, only: condensed_term, list_terms
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: set_up_newton

  !> Markers of a flexible body where rows act: columns of the inverse block, and what markers see of them.
  type, public :: marker_columns
    integer :: na = 0                        !! such markers
    logical :: whole = .false.               !! the columns belong to the whole block, not to T0
    integer, allocatable :: marker(:)        !! (na) their numbers
    integer, allocatable :: column(:, :)     !! (3, na) column of each component, 0: none
    integer, allocatable :: marker_of(:), component_of(:)  !! (nc) marker (1 to na) and component of each column
    real(wp), allocatable :: xs(:, :)        !! (n, 2) T0^-1 S-bar^T [m/N kg ...]
    real(wp), allocatable :: xe(:, :)        !! (n, nc) T0^-1 E^T [m/N ...]
    real(wp), allocatable :: compliance(:, :, :, :)   !! (3, 3, na, na) E_i T0^-1 E_j^T [m/N ...]
    real(wp), allocatable :: exs(:, :, :)    !! (3, 2, na) E_k T0^-1 S-bar^T [kg m/N ...]
    real(wp), allocatable :: sxe(:, :)       !! (2, nc) S-bar T0^-1 E^T [kg m/N ...]
    real(wp) :: pss(2, 2) = 0.0_wp           !! S-bar T0^-1 S-bar^T [kg2 m/N ...]
    real(wp), allocatable :: exy(:, :)       !! (3, na) E_k T0^-1 times the angle's column [m, rad]
    real(wp), allocatable :: exf(:, :)       !! (3, na) E_k T0^-1 times the residual [m, rad]
    real(wp), allocatable :: rxe(:)          !! (nc) the angle's row times T0^-1 E^T [-, m]
    real(wp), allocatable :: load(:)         !! (nc) forces of the rows on the columns [N, N m]
  end type marker_columns

  !> One body's share.
  type, public :: newton_body
    type(body_equations) :: eq
    type(block_factor) :: block
    type(marker_columns) :: at
    real(wp) :: inverse(3, 3) = 0.0_wp       !! of the condensed frame [m/N, rad/N]
    real(wp) :: free(3) = 0.0_wp             !! frame's correction without rows [m, m, rad]
  end type newton_body

  !> The whole.
  type, public :: newton_matrix
    real(wp) :: c1 = 0.0_wp                  !! [1/s2]
    real(wp) :: c2 = 0.0_wp                  !! [1/s]
    logical :: whole = .false.               !! the whole elastic blocks stand in the last tangent, not T0
    logical :: solved = .false.              !! the elastic residuals have been solved
    type(newton_body), allocatable :: b(:)
    type(row_system) :: rows
    type(condensed_term), allocatable :: terms(:)
    real(wp), allocatable :: q(:)            !! (nq) positions of the last stage's residual [m, rad]
    real(wp), allocatable :: offset(:)       !! (nz) what the terms' past gives z at zero deformation [m, rad]
    real(wp), allocatable :: element_factor(:)   !! (force elements) stiffness with the terms condensed over the static one [-]
    real(wp), allocatable :: element_z(:), element_zd(:) !! (nz) of force elements at the trial state [m, rad], unused rates
    real(wp), allocatable :: wrench(:, :)    !! (3, markers) residual force (body axes) and moment [N, N m]
    integer(ip) :: base_factors = 0          !! of T0 blocks so far
    integer(ip) :: whole_factors = 0         !! of whole blocks so far
  end type newton_matrix

contains

  !> Work space of a mechanism.
  subroutine set_up_newton(self, m)
    type(newton_matrix), intent(out) :: self
    type(mechanism_model), intent(in) :: m
    integer :: b, nz
    nz = m%s%nz
    allocate (self%offset(nz), self%element_z(nz), self%element_zd(nz), source=0.0_wp)
    allocate (self%wrench(3, size(m%s%markers)), source=0.0_wp)
    allocate (self%element_factor(size(m%s%forces)), source=1.0_wp)
    call list_terms(m%s, self%terms)
    call list_rows(self%rows, m)
    call order_rows(self%rows)
    allocate (self%b(size(m%s%bodies)))
    do b = 1, size(self%b)
      call set_up_terms(self%b(b)%eq, m%s%bodies(b))
      if (.not. m%s%bodies(b)%flexible) cycle
      call self%b(b)%block%set_up(m%s%bodies(b)%op)
      call number_columns(self%b(b)%at, self%rows, m, b)
    end do
  end subroutine set_up_newton

  !> Markers and columns of one flexible body.
  subroutine number_columns(at, r, m, b)
    type(marker_columns), intent(inout) :: at
    type(row_system), intent(inout) :: r
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: b
    integer, allocatable :: local(:)
    logical, allocatable :: wanted(:, :)         !! (3, markers) components that rows may see
    integer :: k, c, e, nc, n
    allocate (local(size(m%s%markers)), source=0)
    allocate (wanted(3, size(m%s%markers)), source=.false.)
    do e = r%first(b), r%first(b + 1) - 1
      k = r%marker(e)
      if (local(k) == 0) then
        at%na = at%na + 1
        local(k) = at%na
      end if
      r%local(e) = local(k)
      wanted(:, k) = wanted(:, k) .or. r%acts(:, e)
    end do
    allocate (at%marker(at%na), at%column(3, at%na), at%marker_of(3*at%na), at%component_of(3*at%na), source=0)
    nc = 0
    do k = 1, size(local)
      if (local(k) == 0) cycle
      at%marker(local(k)) = k
      do c = 1, 3
        if (.not. wanted(c, k) .or. .not. m%s%markers(k)%moves(c)) cycle
        nc = nc + 1
        at%column(c, local(k)) = nc
        at%marker_of(nc) = local(k)
        at%component_of(nc) = c
      end do
    end do
    n = m%s%bodies(b)%nf
    allocate (at%xs(n, 2), at%xe(n, nc), at%compliance(3, 3, at%na, at%na), at%exs(3, 2, at%na), at%exy(3, at%na), &
              at%exf(3, at%na), at%sxe(2, nc), at%rxe(nc), at%load(nc), source=0.0_wp)
  end subroutine number_columns
end module newton_system
