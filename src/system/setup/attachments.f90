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
    integer, allocatable :: local(:)
    integer :: b
    allocate (local(size(self%s%markers)), source=0)
    do b = 1, size(self%s%bodies)
      associate (at => self%attached(b), body => self%s%bodies(b))
        if (.not. body%flexible) cycle
        call self%incidence%attach(self%s, b, local, at)
        call fill_columns(self%s%markers, body, at)
        call fill_compliances(self%s%markers, body, at)
      end associate
    end do
  end subroutine attach_markers

  !> The columns m_ff^-1 E_k^T.
  subroutine fill_columns(markers, body, at)
    type(marker_model), intent(in) :: markers(:) !! of the scene
    type(body_model), intent(in) :: body
    type(flexible_attachments), intent(inout) :: at
    real(wp) :: work(2, body%nf)                 ! [any]
    integer :: j
    allocate (at%columns(body%nf, size(at%owner)), source=0.0_wp)
    do j = 1, size(at%owner)
      call markers(at%marker(at%owner(j)))%add_elastic_forces(merge(1.0_wp, 0.0_wp, [1, 2, 3] == at%component(j)), at%columns(:, j))
      call body%basis%solve_mass(body%nf, work, at%columns(:, j))
    end do
  end subroutine fill_columns

  !> Compliances between the markers, and E_k m_ff^-1 S-bar^T.
  pure subroutine fill_compliances(markers, body, at)
    type(marker_model), intent(in) :: markers(:) !! of the scene
    type(body_model), intent(in) :: body
    type(flexible_attachments), intent(inout) :: at
    integer :: n, i, j
    n = size(at%marker)
    allocate (at%compliance(3, 3, n, n), at%ep(3, 2, n), source=0.0_wp)
    do i = 1, n
      associate (marker => markers(at%marker(i)))
        at%ep(:, 1, i) = marker%elastic(body%shape%pmat(:, 1))
        at%ep(:, 2, i) = marker%elastic(body%shape%pmat(:, 2))
        do j = 1, size(at%owner)
          at%compliance(:, at%component(j), i, at%owner(j)) = marker%elastic(at%columns(:, j))
        end do
      end associate
    end do
  end subroutine fill_compliances
end module attachments
