!> Times at which the equations of a scene are not smooth: breakpoints of the histories of its loads, drives and controllers. Orders
!> are those of the accelerations: 0 where they jump, 1 where their slope jumps.
module breakpoint_list
  use kinds, only: wp
  use history, only: breakpoint, merged
  use scene_model, only: scene
  implicit none (type, external)
  private
  public :: scene_breakpoints

contains

  !> Breakpoints inside (0, t_end) up to an order, ascending; at equal times (to rounding) the lowest order counts.
  subroutine scene_breakpoints(s, t_end, most_order, list)
    type(scene), intent(in) :: s
    real(wp), intent(in) :: t_end              !! [s]
    integer, intent(in) :: most_order
    type(breakpoint), allocatable, intent(out) :: list(:)
    integer :: k
    allocate (list(0))
    do k = 1, size(s%forces)
      list = merged(list, s%forces(k)%item%breakpoints(t_end))
    end do
    do k = 1, size(s%constraints)
      list = merged(list, s%constraints(k)%item%breakpoints(t_end))
    end do
    do k = 1, size(s%controllers)
      list = merged(list, s%controllers(k)%breakpoints(t_end))
    end do
    list = pack(list, list%order <= most_order)
  end subroutine scene_breakpoints
end module breakpoint_list
