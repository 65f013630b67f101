!> LU factor with row pivots of a small band matrix that each step makes anew, in LAPACK's band storage: LAPACK's own calls cost
!> more than the arithmetic of the few entries of a column.
module band_lu
  use kinds, only: wp, number
  implicit none (type, external)
  private
  public :: factor_lu, solve_lu

contains

  !> Factors in place; entries above the band of the matrix have to be zero.
  pure subroutine factor_lu(n, kd, a, pivots, upper, bad)
    integer, intent(in) :: n, kd               !! order, half band width
    real(number), intent(inout) :: a(3*kd + 1, n)   !! a(2 kd + 1 + i - j, j): matrix, then its factors [any]
    integer, intent(out) :: pivots(n)          !! the row that changed places with each row
    integer, intent(out) :: upper              !! diagonals above the main one that the factor has
    logical, intent(out) :: bad                !! a pivot is zero
    real(number) :: x
    real(wp) :: largest                        ! entry below the diagonal [any]
    integer :: i, j, c, p, d, below, last
    d = 2*kd + 1
    bad = .false.
    upper = 0
    last = 1                                   ! last column in which the rows so far have entries
    do j = 1, n
      below = min(kd, n - j)
      p = 0
      largest = abs(a(d, j))
      do i = 1, below
        if (abs(a(d + i, j)) <= largest) cycle
        largest = abs(a(d + i, j))
        p = i
      end do
      pivots(j) = j + p
      bad = .not. largest > 0.0_wp
      if (bad) return
      last = max(last, min(j + p + kd, n))
      upper = max(upper, last - j)
      if (p > 0) then
        do c = j, last
          x = a(d + j - c, c)
          a(d + j - c, c) = a(d + j + p - c, c)
          a(d + j + p - c, c) = x
        end do
      end if
      x = 1.0_wp/a(d, j)
!GCC$ novector
      do i = 1, below
        a(d + i, j) = a(d + i, j)*x
      end do
      do c = j + 1, last
        x = a(d + j - c, c)
!GCC$ novector
        do i = 1, below
          a(d + j - c + i, c) = a(d + j - c + i, c) - x*a(d + i, j)
        end do
      end do
    end do
  end subroutine factor_lu

  !> Solves in place for the columns of x.
  pure subroutine solve_lu(n, kd, a, pivots, upper, columns, x)
    integer, intent(in) :: n, kd, upper, columns
    real(number), intent(in) :: a(3*kd + 1, n)      !! factors [any]
    integer, intent(in) :: pivots(n)
    real(number), intent(inout) :: x(n, columns)    !! right-hand sides, then solutions [any]
    real(number) :: y
    integer :: i, j, c, d
    d = 2*kd + 1
    do c = 1, columns
      do j = 1, n
        y = x(pivots(j), c)
        x(pivots(j), c) = x(j, c)
        x(j, c) = y
!GCC$ novector
        do i = 1, min(kd, n - j)
          x(j + i, c) = x(j + i, c) - y*a(d + i, j)
        end do
      end do
      do j = n, 1, -1
        y = x(j, c)/a(d, j)
        x(j, c) = y
!GCC$ novector
        do i = 1, min(upper, j - 1)
          x(j - i, c) = x(j - i, c) - y*a(d - i, j)
        end do
      end do
    end do
  end subroutine solve_lu
end module band_lu
