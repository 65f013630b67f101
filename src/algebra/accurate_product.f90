!> Sparse products summed in twice the working precision (Dekker 1971, Knuth: error-free product and sum). The stiffness of a
!> fine mesh cancels almost wholly in K x: with plain sums the error of the lowest mode grows with
!> the fourth power of the number of elements, with these it does not.
module accurate_product
  use kinds, only: wp
  implicit none (type, external)
  private
  public :: add_accurate

  real(wp), parameter :: splitter = 134217729.0_wp    !! 2^27 + 1: halves the digits of a number [-]

contains

  !> y = y + scale A x for a real matrix given by its entries, sorted by rows.
  pure subroutine add_accurate(rows, cols, values, rest, scale, x, y)
    integer, intent(in) :: rows(:), cols(:)           !! (entries)
    real(wp), intent(in) :: values(:)                 !! (entries) [any]
    real(wp), intent(in) :: rest(:)   !! (entries) what is left of the values after their rounding to working precision [as values]
    complex(wp), intent(in) :: scale                  !! [-]
    complex(wp), intent(in) :: x(:)                   !! (n) [any]
    complex(wp), intent(inout) :: y(:)                !! (n) [unit of values times unit of x]
    real(wp) :: high(2), low(2), v(2)                 ! real and imaginary part of one row; of x [any]
    integer :: k
    high = 0.0_wp
    low = 0.0_wp
    do k = 1, size(values)
      if (abs(values(k)) + abs(rest(k)) > 0.0_wp) then
        v = [x(cols(k))%re, x(cols(k))%im]
        call add_product(values(k), v, high, low)
        low = low + rest(k)*v
      end if
      if (k < size(values)) then
        if (rows(k + 1) == rows(k)) cycle
      end if
      y(rows(k)) = y(rows(k)) + scale*cmplx(high(1) + low(1), high(2) + low(2), wp)
      high = 0.0_wp
      low = 0.0_wp
    end do
  end subroutine add_accurate

  !> high + low = high + low + a b, the roundings of product and sum kept in low.
  pure subroutine add_product(a, b, high, low)
    real(wp), intent(in) :: a, b(2)   !! factors [any]
    real(wp), intent(inout) :: high(2), low(2)   !! sum and its collected roundings [unit of a b]
    real(wp) :: ah, al, p(2), s(2), t(2), bh(2), bl(2)
    p = a*b
    ah = splitter*a
    ah = ah - (ah - a)
    al = a - ah
    bh = splitter*b
    bh = bh - (bh - b)
    bl = b - bh
    s = high + p
    t = s - high
    low = low + (((high - (s - t)) + (p - t)) + (((ah*bh - p) + ah*bl + al*bh) + al*bl))
    high = s
  end subroutine add_product
end module accurate_product
