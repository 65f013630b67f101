!> Vectors of all coordinates whose frames' components are turned between the frames' own axes and global ones, at the angles
!> of the last `set_frames`.
module frame_axes
  use kinds, only: wp
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: to_global, to_body, turn_to_body

contains

  !> Frames' components from body axes into global ones.
  pure function to_global(m, ev, x) result(y)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: x(:)             !! (nq) [any]
    real(wp) :: y(size(x))
    integer :: b, i
    y = x
    do b = 1, size(m%s%bodies)
      i = m%s%qo(b)
      y(i + 1:i + 2) = ev%frame%to_global(b, x(i + 1:i + 2))
    end do
  end function to_global

  !> And back.
  pure function to_body(m, ev, x) result(y)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: x(:)             !! (nq) [any]
    real(wp) :: y(size(x))
    y = x
    call turn_to_body(m, ev, y)
  end function to_body

  !> The same in place.
  pure subroutine turn_to_body(m, ev, x)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(inout), contiguous :: x(:)   !! (nq) [any]
    real(wp) :: vector(2)                    ! without it the compiler allocates a copy [any]
    integer :: b, i
    do b = 1, size(m%s%bodies)
      i = m%s%qo(b)
      vector = ev%frame%to_body(b, x(i + 1:i + 2))
      x(i + 1:i + 2) = vector
    end do
  end subroutine turn_to_body
end module frame_axes
