!> Weighted sums and products of other histories.
module sum_history
  use kinds, only: wp
  use history, only: history_model, history_box, breakpoint, breakpoint_order, merged
  implicit none (type, external)
  private

  !> What is made of other histories; its corners are theirs.
  type, abstract, extends(history_model), public :: compound_model
    type(history_box), allocatable :: parts(:)
  contains
    procedure :: breakpoints => all_breakpoints
    procedure :: marks => marks_of_parts
    procedure :: lowest_order => order_of_parts
    procedure :: keep_corners => keep_all_corners
    procedure :: next_corner => nearest_corner
  end type compound_model

  !> The sum of factor times history.
  type, extends(compound_model), public :: sum_model
    real(wp), allocatable :: factors(:)      !! [-]
  contains
    procedure :: evaluate => sum_value
    procedure :: breakpoints => sum_breakpoints
    procedure :: steepest => steepest_sum
  end type sum_model

  !> The product of the parts.
  type, extends(compound_model), public :: product_model
  contains
    procedure :: evaluate => product_value
  end type product_model

contains

  !> The same sum of the parts' values.
  pure recursive subroutine sum_value(self, t, left_limit, h)
    class(sum_model), intent(in) :: self
    real(wp), intent(in) :: t           !! [s]
    logical, intent(in) :: left_limit   !! limit from below
    real(wp), intent(out) :: h(-1:2)    !! [unit s, unit, unit/s, unit/s2]
    real(wp) :: g(-1:2)
    integer :: k
    h = 0.0_wp
    do k = 1, size(self%parts)
      call self%parts(k)%item%evaluate(t, left_limit, g)
      h = h + self%factors(k)*g
    end do
  end subroutine sum_value

  !> By the rule of products. There is no antiderivative in closed form: drives by a rate, which need one, do not take a product.
  pure recursive subroutine product_value(self, t, left_limit, h)
    class(product_model), intent(in) :: self
    real(wp), intent(in) :: t           !! [s]
    logical, intent(in) :: left_limit   !! limit from below
    real(wp), intent(out) :: h(-1:2)    !! [unit s] 0, [unit, unit/s, unit/s2]
    real(wp) :: g(-1:2)
    integer :: k
    h = [0.0_wp, 1.0_wp, 0.0_wp, 0.0_wp]
    do k = 1, size(self%parts)
      call self%parts(k)%item%evaluate(t, left_limit, g)
      h(0:) = [h(0)*g(0), h(1)*g(0) + h(0)*g(1), h(2)*g(0) + 2*h(1)*g(1) + h(0)*g(2)]
    end do
  end subroutine product_value

  !> Breakpoints of all parts.
  pure recursive function all_breakpoints(self, until) result(list)
    class(compound_model), intent(in) :: self
    real(wp), intent(in) :: until       !! [s]
    type(breakpoint), allocatable :: list(:)
    integer :: k
    allocate (list(0))
    do k = 1, size(self%parts)
      list = merged(list, self%parts(k)%item%breakpoints(until))
    end do
  end function all_breakpoints

  !> Those of all parts.
  pure recursive function marks_of_parts(self) result(times)
    class(compound_model), intent(in) :: self
    real(wp), allocatable :: times(:)        !! [s]
    integer :: k
    allocate (times(0))
    do k = 1, size(self%parts)
      times = [times, self%parts(k)%item%marks()]
    end do
  end function marks_of_parts

  !> The same; where two of them cancel, what is left of them.
  pure recursive function sum_breakpoints(self, until) result(list)
    class(sum_model), intent(in) :: self
    real(wp), intent(in) :: until       !! [s]
    type(breakpoint), allocatable :: list(:)
    real(wp), dimension(-1:2) :: before, after, one, other, most
    integer :: i, k
    list = all_breakpoints(self, until)
    do i = 1, size(list)
      before = 0.0_wp
      after = 0.0_wp
      most = 0.0_wp
      do k = 1, size(self%parts)
        call self%parts(k)%item%evaluate(list(i)%time, .true., one)
        call self%parts(k)%item%evaluate(list(i)%time, .false., other)
        before = before + self%factors(k)*one
        after = after + self%factors(k)*other
        most = max(most, abs(self%factors(k))*max(abs(one), abs(other)))
      end do
      list(i)%order = max(list(i)%order, breakpoint_order(before(0:), after(0:), most(0:)))
    end do
  end function sum_breakpoints

  !> The lowest one of all parts.
  pure recursive integer function order_of_parts(self) result(order)
    class(compound_model), intent(in) :: self
    integer :: k
    order = minval([(self%parts(k)%item%lowest_order(), k=1, size(self%parts))])
  end function order_of_parts

  !> Corners are those of the parts.
  recursive subroutine keep_all_corners(self, most_order)
    class(compound_model), intent(inout) :: self
    integer, intent(in) :: most_order
    integer :: k
    do k = 1, size(self%parts)
      call self%parts(k)%item%keep_corners(most_order)
    end do
  end subroutine keep_all_corners

  !> The nearest one of all parts.
  pure recursive real(wp) function nearest_corner(self, t, above) result(corner)   ! [s]
    class(compound_model), intent(in) :: self
    real(wp), intent(in) :: t           !! [s]
    logical, intent(in) :: above
    integer :: k
    corner = merge(huge(1.0_wp), -huge(1.0_wp), above)
    do k = 1, size(self%parts)
      associate (x => self%parts(k)%item%next_corner(t, above))
        corner = merge(min(corner, x), max(corner, x), above)
      end associate
    end do
  end function nearest_corner

  !> No more than that of all parts together.
  pure recursive real(wp) function steepest_sum(self) result(slope)   ! [unit/s]
    class(sum_model), intent(in) :: self
    integer :: k
    slope = sum([(abs(self%factors(k))*self%parts(k)%item%steepest(), k=1, size(self%parts))])
  end function steepest_sum
end module sum_history
