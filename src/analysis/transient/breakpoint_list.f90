!> Times at which the equations of a scene are not smooth: breakpoints of the histories of its loads and drives. Orders are
!> those of the accelerations: 0 where they jump, 1 where their slope jumps.
module breakpoint_list
  use kinds, only: wp
  use history, only: breakpoint, merged
  use scene_model, only: scene
  use text, only: es_text, to_text
  use step_counts, only: actual_step
  implicit none (type, external)
  private
  public :: scene_breakpoints, off_step

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
    list = pack(list, list%order <= most_order)
  end subroutine scene_breakpoints

  !> One sentence on the breakpoints that no fixed step ends at, empty where there are none.
  function off_step(s, t_end, output_step, step, order) result(text)
    type(scene), intent(in) :: s
    real(wp), intent(in) :: t_end, output_step, step   !! [s]
    integer, intent(in) :: order               !! of the method
    character(:), allocatable :: text
    type(breakpoint), allocatable :: list(:)
    real(wp) :: h, x
    integer :: k, n
    call scene_breakpoints(s, t_end, order - 2, list)
    h = actual_step(output_step, step)
    text = ''
    n = 0
    do k = 1, size(list)
      x = list(k)%time/h
      if (abs(x - anint(x)) <= 1.0e-9_wp*max(1.0_wp, x)) cycle
      n = n + 1
      if (n > 5) cycle
      if (n > 1) text = text//','
      text = text//' '//trim(adjustl(es_text(list(k)%time, 6)))//' s'
    end do
    if (n == 0) return
    if (n > 5) text = text//' ... ('//to_text(n)//' times)'
    text = 'histories have corners at t ='//text//', which are no multiples of the step: the method loses its order '// &
           'there; choose step and output_step so that steps end at them, or a tolerance instead of a step'
  end function off_step
end module breakpoint_list
