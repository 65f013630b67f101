!> L D L^T of symmetric band matrices, where a small pivot shows that a row depends on others. Kept by columns, s(i, j) = S(j+i, j),
!> L below the diagonal and 1/D on it. Half band width 3, a chain of revolute joints, has loops of its own.
module band_ldl
  use kinds, only: wp
  implicit none (type, external)
  private
  public :: eliminate, substitute, subtract_product

contains

  !> L D L^T of a band matrix in place; good is false at the first pivot below tol times its diagonal entry.
  pure subroutine eliminate(n, kd, f, s, tol, good)
    integer, intent(in) :: n, kd
    real(wp), intent(inout) :: f(0:kd, n + kd)   !! the matrix on entry, its factor on return: L [-] and 1/D [1/any]
    real(wp), intent(in) :: s(0:kd, n)           !! the matrix, whose diagonal pivots are compared with [any]
    real(wp), intent(in) :: tol               !! [-]; negative: never give up
    logical, intent(out) :: good
    if (kd == 3) then
      call factor_band3(n, f, s, tol, good)
    else
      call factor_band(n, kd, f, s, tol, good)
    end if
  end subroutine eliminate

  !> Any half band width. Columns beyond n are zero, so loops need not end at the last row.
  pure subroutine factor_band(n, kd, f, s, tol, good)
    integer, intent(in) :: n, kd
    real(wp), intent(inout) :: f(0:kd, n + kd)   !! the matrix on entry, its factor on return: L [-] and 1/D [1/any]
    real(wp), intent(in) :: s(0:kd, n)           !! the matrix, whose diagonal pivots are compared with [any]
    real(wp), intent(in) :: tol                  !! as in eliminate [-]
    logical, intent(out) :: good
    real(wp) :: d, l
    integer :: i, j, k
    good = .true.
    do j = 1, n
      call invert_pivot(f(0, j), s(0, j), tol, d, good)
      if (.not. good) return
      f(0, j) = d
      do i = 1, kd
        l = f(i, j)*f(0, j)
        do k = i, kd
          f(k - i, j + i) = f(k - i, j + i) - l*f(k, j)
        end do
      end do
      do i = 1, kd
        f(i, j) = f(i, j)*f(0, j)
      end do
    end do
  end subroutine factor_band

  !> Half band width 3: a chain of revolute joints.
  pure subroutine factor_band3(n, f, s, tol, good)
    integer, intent(in) :: n
    real(wp), intent(inout) :: f(0:3, n + 3)   !! the matrix on entry, its factor on return: L [-] and 1/D [1/any]
    real(wp), intent(in) :: s(0:3, n)          !! the matrix, whose diagonal pivots are compared with [any]
    real(wp), intent(in) :: tol                !! as in eliminate [-]
    logical, intent(out) :: good
    real(wp) :: d, u1, u2, u3, l1, l2, l3
    integer :: j
    good = .true.
    do j = 1, n
      call invert_pivot(f(0, j), s(0, j), tol, d, good)
      if (.not. good) return
      u1 = f(1, j); u2 = f(2, j); u3 = f(3, j)
      l1 = u1*d; l2 = u2*d; l3 = u3*d
      f(0, j) = d
      f(1, j) = l1
      f(2, j) = l2
      f(3, j) = l3
      f(0, j + 1) = f(0, j + 1) - l1*u1
      f(1, j + 1) = f(1, j + 1) - l1*u2
      f(2, j + 1) = f(2, j + 1) - l1*u3
      f(0, j + 2) = f(0, j + 2) - l2*u2
      f(1, j + 2) = f(1, j + 2) - l2*u3
      f(0, j + 3) = f(0, j + 3) - l3*u3
    end do
  end subroutine factor_band3

  !> The inverse of a pivot; good is false where the pivot is below tol times its diagonal entry.
  pure subroutine invert_pivot(pivot, diagonal, tol, inverse, good)
    real(wp), intent(in) :: pivot, diagonal   !! of the factored and of the given matrix [any]
    real(wp), intent(in) :: tol               !! [-]
    real(wp), intent(out) :: inverse          !! 1 over the pivot [1/any]
    logical, intent(inout) :: good
    inverse = 1.0_wp
    good = pivot > tol*diagonal
    if (.not. good) return
    inverse = 1.0_wp/merge(pivot, max(diagonal, tiny(1.0_wp)), pivot > 0.0_wp)   ! below 0: rounding of a shifted matrix
  end subroutine invert_pivot

  !> Forward and backward substitution.
  pure subroutine substitute(n, kd, f, x)
    integer, intent(in) :: n, kd
    real(wp), intent(in) :: f(0:kd, n + kd)   !! factor: L [-] and 1/D [1/any]
    real(wp), intent(inout) :: x(n + kd)      !! right-hand side, then solution; zero beyond n, before and after [any]
    integer :: i, j
    if (kd == 3) then
      call substitute3(n, f, x)
      return
    end if
    do j = 1, n
      do i = 1, kd
        x(j + i) = x(j + i) - f(i, j)*x(j)
      end do
    end do
    do j = n, 1, -1
      x(j) = x(j)*f(0, j)
      do i = 1, kd
        x(j) = x(j) - f(i, j)*x(j + i)
      end do
    end do
  end subroutine substitute

  !> The same with half band width 3: the last three unknowns stay in registers.
  pure subroutine substitute3(n, f, x)
    integer, intent(in) :: n
    real(wp), intent(in) :: f(0:3, n + 3)   !! factor: L [-] and 1/D [1/any]
    real(wp), intent(inout) :: x(n + 3)     !! likewise [any]
    real(wp) :: a, b, c, y
    integer :: j
    a = x(1)
    b = x(2)
    c = x(3)
    do j = 1, n
      y = a
      x(j) = y
      a = b - f(1, j)*y
      b = c - f(2, j)*y
      c = x(j + 3) - f(3, j)*y
    end do
    a = 0.0_wp
    b = 0.0_wp
    c = 0.0_wp
    do j = n, 1, -1
      y = ((x(j)*f(0, j) - f(3, j)*c) - f(2, j)*b) - f(1, j)*a
      x(j) = y
      c = b
      b = a
      a = y
    end do
  end subroutine substitute3

  !> r <- r - S x.
  pure subroutine subtract_product(n, kd, s, x, r)
    integer, intent(in) :: n, kd
    real(wp), intent(in) :: s(0:kd, n), x(n)   !! matrix and vector [any]
    real(wp), intent(inout) :: r(n)            !! [unit of s times unit of x]
    integer :: i, j
    do j = 1, n
      r(j) = r(j) - s(0, j)*x(j)
      do i = 1, min(kd, n - j)
        r(j + i) = r(j + i) - s(i, j)*x(j)
        r(j) = r(j) - s(i, j)*x(j + i)
      end do
    end do
  end subroutine subtract_product
end module band_ldl
