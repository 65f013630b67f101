!> Products of short vectors and small inverses.
module small_matrices
  use kinds, only: wp, number
  implicit none (type, external)
  private
  public :: outer, invert3, solve_small

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

  !> Inverse of a 3 x 3 matrix by elimination with pivots, in place.
  pure subroutine invert3(a, inverse, bad)
    real(number), intent(in) :: a(3, 3)            !! [any]
    real(number), intent(out) :: inverse(3, 3)     !! [1/any]
    logical, intent(out) :: bad
    real(number) :: w(3, 3), row(3), x             ! rows as columns [any]
    integer :: k, i, p, pivots(3)
    w = transpose(a)
    do k = 1, 3
      p = k
      do i = k + 1, 3
        if (abs(w(k, i)) > abs(w(k, p))) p = i
      end do
      bad = .not. (abs(w(k, p)) > 0.0_wp .and. abs(w(k, p)) < huge(1.0_wp))
      if (bad) exit
      pivots(k) = p
      row = w(:, p)
      w(:, p) = w(:, k)
      x = 1.0_wp/row(k)
      row(k) = 1.0_wp
      row = row*x
      w(:, k) = row
      do i = 1, 3
        if (i == k) cycle
        x = w(k, i)
        w(k, i) = 0.0_wp
        w(:, i) = w(:, i) - x*row
      end do
    end do
    if (bad) pivots = 1
    do k = 3, 1, -1
      row = w(k, :)
      w(k, :) = w(pivots(k), :)
      w(pivots(k), :) = row
    end do
    inverse = transpose(w)
  end subroutine invert3

  !> Solves a x = b by Gauss elimination with row exchanges; pivots that vanish become rounding.
  pure subroutine solve_small(a, b)
    complex(wp), intent(inout) :: a(:, :)   !! overwritten [any]
    complex(wp), intent(inout) :: b(:)      !! right-hand side, then solution [any]
    complex(wp) :: row(size(b)), x, factor
    integer :: i, j, k
    do k = 1, size(b)
      i = k - 1 + maxloc(abs(a(k:, k)), 1)
      row = a(k, :)
      a(k, :) = a(i, :)
      a(i, :) = row
      x = b(k)
      b(k) = b(i)
      b(i) = x
      if (.not. abs(a(k, k)) > 0.0_wp) a(k, k) = epsilon(1.0_wp)*max(1.0_wp, maxval(abs(a)))
      do j = 1, size(b)
        if (j == k) cycle
        factor = a(j, k)/a(k, k)
        a(j, :) = a(j, :) - factor*a(k, :)
        b(j) = b(j) - factor*b(k)
      end do
    end do
    do k = 1, size(b)
      b(k) = b(k)/a(k, k)
    end do
  end subroutine solve_small
end module small_matrices
