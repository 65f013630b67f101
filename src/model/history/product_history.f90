!> A product of other histories.
module product_history
  use kinds, only: wp
  use history, only: breakpoint, merged, steepest
  use sum_history, only: sum_model
  implicit none (type, external)
  private

  !> The product of the parts; its corners are theirs, as those of a sum.
  type, extends(sum_model), public :: product_model
  contains
    procedure :: evaluate => product_value
    procedure :: breakpoints => product_breakpoints
    procedure :: steepest => steepest_product
  end type product_model

contains

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
  pure recursive function product_breakpoints(self, until) result(list)
    class(product_model), intent(in) :: self
    real(wp), intent(in) :: until       !! [s]
    type(breakpoint), allocatable :: list(:)
    integer :: k
    allocate (list(0))
    do k = 1, size(self%parts)
      list = merged(list, self%parts(k)%item%breakpoints(until))
    end do
  end function product_breakpoints

  !> As of a history that is no sum; the breaks are those of the parts.
  pure recursive real(wp) function steepest_product(self) result(slope)   ! [unit/s]
    class(product_model), intent(in) :: self
    slope = steepest(self)
  end function steepest_product
end module product_history
