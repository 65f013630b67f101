!> A polynomial of time.
module polynomial_history
  use kinds, only: wp
  use history, only: history_model
  implicit none (type, external)
  private

  !> c0 + c1 t + c2 t2 + ...
  type, extends(history_model), public :: polynomial_model
    real(wp), allocatable :: c(:)       !! coefficients [unit/s^k]
  contains
    procedure :: evaluate => polynomial_value
  end type polynomial_model

contains

  !> Horner's scheme.
  pure subroutine polynomial_value(self, t, left_limit, h)
    class(polynomial_model), intent(in) :: self
    real(wp), intent(in) :: t           !! [s]
    logical, intent(in) :: left_limit   !! limit from below: the same
    real(wp), intent(out) :: h(-1:2)    !! [unit s, unit, unit/s, unit/s2]
    integer :: k
    h = 0.0_wp
    do k = size(self%c), 1, -1
      h(2) = h(2)*t + 2*h(1)
      h(1) = h(1)*t + h(0)
      h(0) = h(0)*t + self%c(k)
      h(-1) = h(-1)*t + self%c(k)/k
    end do
    h(-1) = h(-1)*t
  end subroutine polynomial_value
end module polynomial_history
