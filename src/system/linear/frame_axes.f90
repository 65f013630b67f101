!> Vectors of all coordinates whose frames' components are turned between the frames' own axes and global ones, at the angles
!> of the last `set_frames`; displacements of markers and forces on them by such vectors in the frames' own axes.
module frame_axes
  use kinds, only: wp
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: to_global, to_body, turn_to_body, displacement_at, add_force

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

  !> Displacement of a marker, global, and turn of its section, from the unknowns.
  pure function displacement_at(m, ev, k, x) result(d)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: k                   !! marker
    real(wp), intent(in) :: x(:)               !! (n) [m], [rad]
    real(wp) :: d(3), u(3)                     !! [m], [m], [rad]
    integer :: b, i
    d = 0.0_wp
    b = m%s%markers(k)%body
    if (b == 0) return
    i = m%s%qo(b)
    u = m%s%markers(k)%displacement(ev%p%rho(:, k), x(i + 1:i + 3), x(i + 4:i + 3 + m%s%bodies(b)%nf))
    d = [ev%frame%to_global(b, u(1:2)), u(3)]
  end function displacement_at

  !> Adds a wrench (global force, moment) on a marker as generalised forces.
  pure subroutine add_force(m, ev, k, f, y)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: k                   !! marker
    real(wp), intent(in) :: f(3)               !! [N], [N m]
    real(wp), intent(inout) :: y(:)            !! (n) [N], [N m]
    real(wp) :: w(3)
    integer :: b, i
    b = m%s%markers(k)%body
    if (b == 0) return
    i = m%s%qo(b)
    w = [ev%frame%to_body(b, f(1:2)), f(3)]
    call m%s%markers(k)%add_wrench(ev%p%rho(:, k), w, y(i + 1:i + 3), y(i + 4:i + 3 + m%s%bodies(b)%nf))
  end subroutine add_force
end module frame_axes
