!> The markers where constraints act on flexible bodies: what a unit force there does to the body's elastic coordinates,
!> columns m_ff^-1 E_k^T, and the compliances E_i m_ff^-1 E_j^T between the markers (theory.md, section 7). All constant.
module attachments
  use kinds, only: wp
  use body, only: body_model
  use mechanism, only: mechanism_model, flexible_attachments
  use marker, only: marker_model
  implicit none (type, external)
  private
  public :: attach_markers

contains

  !> Attachments of every flexible body.
  subroutine attach_markers(self)
    type(mechanism_model), intent(inout) :: self
    logical, allocatable :: acts(:, :)           !! (3, markers) whether constraints act on u, v and the rotation of a marker
    type(marker_model), allocatable :: markers(:)   !! of one body
    integer, allocatable :: local(:)
    integer :: k, b
    allocate (local(size(self%s%markers)), source=0)
    allocate (acts(3, size(self%s%markers)), source=.false.)
    do k = 1, size(self%s%constraints)
      associate (c => self%s%constraints(k)%item)
        acts(:, [c%ia, c%ib]) = acts(:, [c%ia, c%ib]) .or. reshape(c%acts_on(), [3, 2])
      end associate
    end do
    do b = 1, size(self%s%bodies)
      if (.not. self%s%bodies(b)%flexible) cycle
      call list_markers(self, b, local)
      associate (at => self%attached(b), body => self%s%bodies(b))
        allocate (markers(size(at%marker)))
        do k = 1, size(markers)
          markers(k) = self%s%markers(at%marker(k))
        end do
        call number_columns(markers, acts(:, at%marker), at%column)
        call fill_columns(markers, body, at)
        call fill_compliances(markers, body, at)
      end associate
      deallocate (markers)
    end do
  end subroutine attach_markers

  !> Lists the markers at the ends of rows on one body, each once, and the number of each end's marker in that list.
  pure subroutine list_markers(self, b, local)
    type(mechanism_model), intent(inout) :: self
    integer, intent(in) :: b
    integer, intent(inout) :: local(:)           !! work space: zero on the markers of this body
    integer :: k, n, e
    n = 0
    do e = self%incidence%first(b), self%incidence%first(b + 1) - 1
      k = self%incidence%marker(e)
      if (local(k) == 0) then
        n = n + 1
        local(k) = n
      end if
      self%incidence%attachment(e) = local(k)
    end do
    allocate (self%attached(b)%marker(n))
    do e = self%incidence%first(b), self%incidence%first(b + 1) - 1
      self%attached(b)%marker(self%incidence%attachment(e)) = self%incidence%marker(e)
    end do
  end subroutine list_markers

  !> Numbers the columns that are needed: where a constraint acts on a coordinate that the body has.
  pure subroutine number_columns(markers, acts, column)
    type(marker_model), intent(in) :: markers(:) !! (na) attached markers of one body
    logical, intent(in) :: acts(:, :)            !! (3, na)
    integer, allocatable, intent(out) :: column(:, :)   !! (3, na) 0: none needed
    integer :: i, c, nc
    allocate (column(3, size(markers)), source=0)
    nc = 0
    do i = 1, size(markers)
      do c = 1, 3
        if (.not. (acts(c, i) .and. markers(i)%moves(c))) cycle
        nc = nc + 1
        column(c, i) = nc
      end do
    end do
  end subroutine number_columns

  !> The columns m_ff^-1 E_k^T.
  subroutine fill_columns(markers, body, at)
    type(marker_model), intent(in) :: markers(:) !! (na) attached markers of the body
    type(body_model), intent(in) :: body
    type(flexible_attachments), intent(inout) :: at
    real(wp) :: work(2, body%nf)                 ! [any]
    integer :: i, c, nc
    nc = max(0, maxval(at%column))
    allocate (at%columns(body%nf, nc), source=0.0_wp)
    do i = 1, size(markers)
      do c = 1, 3
        if (at%column(c, i) == 0) cycle
        associate (x => at%columns(:, at%column(c, i)))
          call markers(i)%add_elastic_forces(merge(1.0_wp, 0.0_wp, [1, 2, 3] == c), x)
          call body%basis%solve_mass(body%nf, work, x)
        end associate
      end do
    end do
  end subroutine fill_columns

  !> Compliances between the markers, and E_k m_ff^-1 S-bar^T.
  pure subroutine fill_compliances(markers, body, at)
    type(marker_model), intent(in) :: markers(:) !! (na) attached markers of the body
    type(body_model), intent(in) :: body
    type(flexible_attachments), intent(inout) :: at
    integer :: n, i, j, c
    n = size(markers)
    allocate (at%compliance(3, 3, n, n), at%ep(3, 2, n), source=0.0_wp)
    do i = 1, n
      at%ep(:, 1, i) = markers(i)%elastic(body%shape%pmat(:, 1))
      at%ep(:, 2, i) = markers(i)%elastic(body%shape%pmat(:, 2))
      do j = 1, n
        do c = 1, 3
          if (at%column(c, j) > 0) at%compliance(:, c, i, j) = markers(i)%elastic(at%columns(:, at%column(c, j)))
        end do
      end do
    end do
  end subroutine fill_compliances
end module attachments
