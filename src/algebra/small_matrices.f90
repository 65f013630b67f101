!> Products of short vectors and small inverses.
module small_matrices
  use kinds, only: wp, number
  implicit none (type, external)
  private
  public :: outer, invert3

contains

  !> Outer product a b^T of two vectors of six.
  pure function outer(a, b) result(m)
    real(wp), intent(in) :: a(6), b(6)     !! [any]
    real(wp) :: m(6, 6)                    !! [unit of a times unit of b]
    integer :: j
    do j = 1, 6
      m(:, j) = a*b(j)
    end do
  end function outer

  !> Inverse of a 3 x 3 matrix by elimination with pivots.
  pure subroutine invert3(a, inverse, bad)
    real(number), intent(in) :: a(3, 3)            !! [any]
    real(number), intent(out) :: inverse(3, 3)     !! [1/any]
    logical, intent(out) :: bad
    real(number) :: w(3, 6), row(6)
    integer :: k, i, p
    w = 0.0_wp
    w(:, 1:3) = a
    do k = 1, 3
      w(k, 3 + k) = 1.0_wp
    end do
    bad = .false.
    do k = 1, 3
      p = k - 1 + maxloc(abs(w(k:3, k)), 1)
      bad = bad .or. .not. (abs(w(p, k)) > 0.0_wp .and. abs(w(p, k)) < huge(1.0_wp))
      if (bad) exit
      row = w(p, :)
      w(p, :) = w(k, :)
      w(k, :) = row/row(k)
      do i = 1, 3
        if (i /= k) w(i, :) = w(i, :) - w(i, k)*w(k, :)
      end do
    end do
    inverse = w(:, 4:6)
  end subroutine invert3
end module small_matrices
