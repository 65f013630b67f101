!> Small linear complementarity problems: w = A x + b with w >= 0, x >= 0 and w.x = 0, by Lemke's pivots (Cottle, Pang & Stone,
!> The Linear Complementarity Problem, 1992, 4.4). A is symmetric and positive semidefinite: where there is a solution at all, they
!> find one.
module complementarity
  use kinds, only: wp
  implicit none (type, external)
  private
  public :: solve_complementarity

  real(wp), parameter :: rounding = 1.0e-12_wp   !! entries of the scaled matrix below it count as zero [-]
  integer, parameter :: most_pivots = 50         !! for each unknown

contains

  !> Solves it; `solved` is false where w >= 0 cannot be met.
  pure subroutine solve_complementarity(a, b, x, solved)
    real(wp), intent(in) :: a(:, :)              !! (n, n) [any]
    real(wp), intent(in) :: b(:)                 !! (n) [any]
    real(wp), intent(out) :: x(:)                !! (n) [any]
    logical, intent(out) :: solved
    real(wp) :: t(size(b), 2*size(b) + 2)        ! w - A x - z = b; columns of w, x, the artificial z, b
    real(wp) :: scale(size(b)), largest          ! weights of the unknowns: a unit diagonal; largest b [any]
    integer :: basis(size(b)), n, i, row, enters, leaves
    n = size(b)
    x = 0.0_wp
    solved = .true.
    largest = 0.0_wp
    do i = 1, n
      scale(i) = 1.0_wp
      if (a(i, i) > 0.0_wp) scale(i) = 1/sqrt(a(i, i))
      largest = max(largest, abs(b(i))*scale(i))
    end do
    if (all(b >= 0.0_wp)) return
    t = 0.0_wp
    do i = 1, n
      t(i, i) = 1.0_wp
      t(i, n + 1:2*n) = -scale(i)*a(i, :)*scale
      basis(i) = i
    end do
    t(:, 2*n + 1) = -1.0_wp
    t(:, 2*n + 2) = scale*b/largest
    row = minloc(t(:, 2*n + 2), 1)
    enters = 2*n + 1
    do i = 1, most_pivots*n
      leaves = basis(row)
      call pivot(t, row, enters)
      basis(row) = enters
      if (leaves == 2*n + 1) exit
      enters = merge(leaves + n, leaves - n, leaves <= n)     ! the partner of what has left
      row = first_to_vanish(t, basis, enters)
      if (row == 0) exit
    end do
    solved = all(basis <= 2*n)
    do i = 1, n
      if (basis(i) > n .and. basis(i) <= 2*n) x(basis(i) - n) = largest*scale(basis(i) - n)*max(t(i, 2*n + 2), 0.0_wp)
    end do
  end subroutine solve_complementarity

  !> Row whose unknown falls to zero first while another one grows; at equal steps the artificial one, else the least of the rows in
  !> lexical order, so that no cycle arises. 0: none falls.
  pure integer function first_to_vanish(t, basis, enters) result(row)
    real(wp), intent(in) :: t(:, :)              !! [-]
    integer, intent(in) :: basis(:), enters
    real(wp) :: d
    integer :: i, j, n
    n = size(basis)
    row = 0
    do i = 1, n
      if (.not. t(i, enters) > rounding) cycle
      if (row == 0) then
        row = i
        cycle
      end if
      d = t(i, 2*n + 2)/t(i, enters) - t(row, 2*n + 2)/t(row, enters)
      if (abs(d) <= rounding) then
        d = merge(-1.0_wp, merge(1.0_wp, 0.0_wp, basis(row) == 2*n + 1), basis(i) == 2*n + 1)
        do j = 1, n
          if (abs(d) > rounding) exit
          d = t(i, j)/t(i, enters) - t(row, j)/t(row, enters)
        end do
      end if
      if (d < 0.0_wp) row = i
    end do
  end function first_to_vanish

  !> Gauss-Jordan elimination of a column by a row.
  pure subroutine pivot(t, row, column)
    real(wp), intent(inout) :: t(:, :)           !! [-]
    integer, intent(in) :: row, column
    integer :: i
    t(row, :) = t(row, :)/t(row, column)
    do i = 1, size(t, 1)
      if (i /= row) t(i, :) = t(i, :) - t(i, column)*t(row, :)
    end do
  end subroutine pivot
end module complementarity
