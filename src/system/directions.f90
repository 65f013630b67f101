!> Lines between two markers that need a direction at the start: distance joints, torques about a centre, springs under load.
module directions
  use kinds, only: wp
  use errors, only: failure, status_bad_input
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: require_directions

contains

  !> Refuses an assembled scene in which the ends of such a line coincide, by name.
  subroutine require_directions(self, ev, gap, fail)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: gap              !! distance up to which markers coincide [m]
    type(failure), intent(inout) :: fail
    character(:), allocatable :: text
    integer :: k
    do k = 1, size(self%s%constraints)
      associate (c => self%s%constraints(k)%item)
        text = c%fault(gap)
        if (len(text) > 0) call fail%raise(status_bad_input, 'joint "'//trim(c%name)//'": '//text)
      end associate
    end do
    do k = 1, size(self%s%forces)
      associate (f => self%s%forces(k)%item)
        text = f%fault(ev%p, gap)
        if (len(text) > 0) call fail%raise(status_bad_input, trim(f%group)//' "'//trim(f%name)//'": '//text)
      end associate
    end do
  end subroutine require_directions
end module directions
