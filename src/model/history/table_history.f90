!> A table of points with a cubic (or straight) piece between each two of them; constant outside, or periodic.
module table_history
  use kinds, only: wp, ip
  use history, only: history_model, breakpoint, breakpoint_order, locate
  implicit none (type, external)
  private

  !> Pieces c1 + c2 x + c3 x2 + c4 x3, x from the piece's first time.
  type, extends(history_model), public :: table_model
    real(wp), allocatable :: t(:)       !! times of the points [s]
    real(wp), allocatable :: c(:, :)    !! (4, 0:points) coefficients; 0 and the last: constant before and after [unit/s^k]
    real(wp), allocatable :: area(:)    !! integral from the first time to each point [unit s]
  contains
    procedure :: set => set_table
    procedure :: evaluate => table_value
  end type table_model

contains

  !> Pieces through the points (t, y) with given slopes at their ends; orders of the breakpoints from what differs there.
  subroutine set_table(self, t, y, slopes, periodic)
    class(table_model), intent(inout) :: self
    real(wp), intent(in) :: t(:)             !! [s]
    real(wp), intent(in) :: y(:)             !! values [unit]
    real(wp), intent(in) :: slopes(:, :)     !! (2, points - 1) at both ends of each piece [unit/s]
    logical, intent(in) :: periodic          !! the last point is the first of the next turn
    real(wp) :: w, chord, size_of(0:2)
    real(wp), dimension(-1:2) :: before, after
    integer :: i, n
    n = size(t)
    self%t = t
    if (periodic) then
      self%period = t(n) - t(1)
      self%t = modulo(t(1), self%period) + (t - t(1))     ! begins in the first turn: later ones keep their digits
    end if
    allocate (self%c(4, 0:n), self%area(n), source=0.0_wp)
    self%c(1, 0) = y(1)
    self%c(1, n) = y(n)
    do i = 1, n - 1
      w = t(i + 1) - t(i)
      chord = (y(i + 1) - y(i))/w
      self%c(:, i) = [y(i), slopes(1, i), (3*chord - 2*slopes(1, i) - slopes(2, i))/w, &
                      (slopes(1, i) + slopes(2, i) - 2*chord)/w**2]
      after = piece(self%c(:, i), w)
      self%area(i + 1) = self%area(i) + after(-1)
    end do
    size_of(0) = maxval(abs(y))
    size_of(1) = maxval(abs(y - y(1)))/(t(n) - t(1))
    size_of(2) = 2*maxval(abs(self%c(3, :)))
    allocate (self%breaks(n))
    do i = 1, n
      before = piece(self%c(:, i - 1), t(i) - t(max(1, i - 1)))
      after = piece(self%c(:, i), 0.0_wp)
      if (periodic .and. i == 1) before = piece(self%c(:, n - 1), t(n) - t(n - 1))
      if (periodic .and. i == n) after = piece(self%c(:, 1), 0.0_wp)
      self%breaks(i) = breakpoint(self%t(i), breakpoint_order(before(0:), after(0:), size_of))
    end do
    if (periodic) self%breaks = self%breaks(1:n - 1)
  end subroutine set_table

  !> Those of the piece.
  pure subroutine table_value(self, t, left_limit, h)
    class(table_model), intent(in) :: self
    real(wp), intent(in) :: t           !! [s]
    logical, intent(in) :: left_limit   !! limit from below
    real(wp), intent(out) :: h(-1:2)    !! [unit s, unit, unit/s, unit/s2]
    real(wp) :: x, shift                ! [s]
    integer(ip) :: turn
    integer :: i
    call locate(self%t, self%period, t, left_limit, shift, turn, i, x)
    h = piece(self%c(:, i), x)
    h(-1) = h(-1) + self%area(max(1, i)) + turn*self%area(size(self%area))
  end subroutine table_value

  !> Integral from 0, value and two derivatives of a cubic.
  pure function piece(c, x) result(h)
    real(wp), intent(in) :: c(4)        !! coefficients [unit/s^k]
    real(wp), intent(in) :: x           !! [s]
    real(wp) :: h(-1:2)                 !! [unit s, unit, unit/s, unit/s2]
    h = [x*(c(1) + x*(c(2)/2 + x*(c(3)/3 + x*c(4)/4))), &
         c(1) + x*(c(2) + x*(c(3) + x*c(4))), c(2) + x*(2*c(3) + 3*x*c(4)), 2*c(3) + 6*x*c(4)]
  end function piece
end module table_history
