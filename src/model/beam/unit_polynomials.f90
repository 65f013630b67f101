!> Real polynomials on the interval from 0 to 1, by their coefficients c(0), c(1), ...: values, antiderivatives, products, and where
!> the largest value is. Roots are found between those of the derivative, so that none is missed.
module unit_polynomials
  use kinds, only: wp
  implicit none (type, external)
  private
  public :: antiderivative, largest_at, product_of, value_at

  real(wp), parameter :: same = 1.0e-9_wp     !! values that differ by less, of their size, are one: the first place counts [-]

contains

  !> The value at x.
  pure real(wp) function value_at(c, x) result(y)   ! [of the polynomial]
    real(wp), intent(in) :: c(0:)             !! [of the polynomial]
    real(wp), intent(in) :: x                 !! [-]
    integer :: k
    y = 0.0_wp
    do k = ubound(c, 1), 0, -1
      y = y*x + c(k)
    end do
  end function value_at

  !> The integral from 0, with room for the coefficients of y.
  pure function antiderivative(c) result(y)
    real(wp), intent(in) :: c(0:)             !! [of the polynomial]
    real(wp) :: y(0:size(c))                  !! [of the polynomial]
    integer :: k
    y(0) = 0.0_wp
    do k = 1, size(c)
      y(k) = c(k - 1)/k
    end do
  end function antiderivative

  !> The product of two polynomials.
  pure function product_of(a, b) result(c)
    real(wp), intent(in) :: a(0:), b(0:)      !! [any]
    real(wp) :: c(0:size(a) + size(b) - 2)    !! [any]
    integer :: k
    c = 0.0_wp
    do k = 0, ubound(a, 1)
      c(k:k + ubound(b, 1)) = c(k:k + ubound(b, 1)) + a(k)*b
    end do
  end function product_of

  !> Where the size of a polynomial is largest: an end counts before places between that have no more.
  pure real(wp) function largest_at(c) result(x)   ! [-]
    real(wp), intent(in) :: c(0:)             !! [of the polynomial]
    real(wp) :: place(ubound(c, 1) + 1), largest   ! [-], [of the polynomial]
    integer :: n, k
    x = 0.0_wp
    if (ubound(c, 1) < 1) return
    place(1) = 1.0_wp
    call find_roots(slope_of(c), place(2:), n)
    largest = abs(c(0))
    do k = 1, n + 1
      if (abs(value_at(c, place(k))) <= (1 + same)*largest) cycle
      x = place(k)
      largest = abs(value_at(c, x))
    end do
  end function largest_at

  !> The derivative.
  pure function slope_of(c) result(y)
    real(wp), intent(in) :: c(0:)             !! [of the polynomial]
    real(wp) :: y(0:ubound(c, 1) - 1)         !! [of the polynomial]
    integer :: k
    do k = 1, ubound(c, 1)
      y(k - 1) = k*c(k)
    end do
  end function slope_of

  !> Where a polynomial changes its sign between 0 and 1, in ascending order.
  pure recursive subroutine find_roots(c, root, n)
    real(wp), intent(in) :: c(0:)             !! [of the polynomial]
    real(wp), intent(out) :: root(:)          !! (degree or more) [-]
    integer, intent(out) :: n                 !! number of them
    real(wp) :: turns(size(root)), low, high  ! places where it turns, ends of a piece that does not turn [-]
    integer :: k, pieces
    n = 0
    if (ubound(c, 1) < 1) return
    call find_roots(slope_of(c), turns, pieces)
    high = 0.0_wp
    do k = 1, pieces + 1
      low = high
      high = 1.0_wp
      if (k <= pieces) high = turns(k)
      if ((value_at(c, low) < 0.0_wp) .eqv. (value_at(c, high) < 0.0_wp)) cycle
      n = n + 1
      root(n) = root_between(c, low, high)
    end do
  end subroutine find_roots

  !> The root between two places with values of different signs: Newton's steps, halves where these leave the bracket.
  pure real(wp) function root_between(c, from, to) result(x)   ! [-]
    real(wp), intent(in) :: c(0:)             !! [of the polynomial]
    real(wp), intent(in) :: from, to          !! [-]
    real(wp) :: low, high, y, next            ! [-], [-], [of the polynomial], [-]
    logical :: rises
    low = from
    high = to
    rises = value_at(c, low) < 0.0_wp
    x = 0.5_wp*(low + high)
    do while (high - low > 4*epsilon(1.0_wp))
      y = value_at(c, x)
      if ((y < 0.0_wp) .eqv. rises) then
        low = x
      else
        high = x
      end if
      next = x - y/value_at(slope_of(c), x)
      if (.not. (next > low .and. next < high)) next = 0.5_wp*(low + high)
      if (abs(next - x) <= 4*epsilon(1.0_wp)) exit
      x = next
    end do
  end function root_between
end module unit_polynomials
