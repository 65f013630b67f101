!> Histories: functions of time that scale loads and lead drives (input/README.md, &history). A kind is a file: an antiderivative
!> in closed form, its value and two derivatives, and the times at which it is not smooth.
module history
  use kinds, only: wp, ip
  use step_counts, only: rounding_of
  implicit none (type, external)
  private
  public :: history_model, history_box, breakpoint, reached, merged, breakpoint_order, locate

  real(wp), parameter :: negligible = 1.0e-6_wp   !! a jump smaller than this share of the history's size is rounding [-]

  !> A time at which a history is not smooth: order 0 a jump, 1 a jump of slope, 2 of curvature, 3 of the third derivative.
  type :: breakpoint
    real(wp) :: time = 0.0_wp   !! [s]
    integer :: order = 0        !! derivative that jumps
  end type breakpoint

  !> A history. Values carry the unit of what it scales.
  type, abstract :: history_model
    character(32) :: name = ''               !! that of the deck
    character(:), allocatable :: remedy      !! what a user can do where a drive cannot follow it
    type(breakpoint), allocatable :: breaks(:) !! times at which it is not smooth, ascending; not allocated: none
    real(wp) :: period = 0.0_wp              !! after which it, and they, repeat; 0: never [s]
    real(wp), allocatable :: corners(:)      !! those of them at which a function of motion changes its piece (`history_pieces`) [s]
  contains
    procedure(values_at_time), deferred :: evaluate
    procedure :: breakpoints => repeated_breaks
    procedure :: marks
    procedure :: lowest_order
    procedure :: keep_corners
    procedure :: next_corner
    procedure :: steepest
    procedure :: vanishes
  end type history_model

  !> Makes an array of different kinds possible.
  type :: history_box
    class(history_model), allocatable :: item   !! one history
  end type history_box

  abstract interface
    !> An antiderivative that is continuous in time, value and two derivatives at t.
    pure subroutine values_at_time(self, t, left_limit, h)
      import :: history_model, wp
      class(history_model), intent(in) :: self
      real(wp), intent(in) :: t           !! [s]
      logical, intent(in) :: left_limit   !! the limit from below: a jump at t (of the value or a derivative) does not act yet
      real(wp), intent(out) :: h(-1:2)    !! [unit s, unit, unit/s, unit/s2]
    end subroutine values_at_time
  end interface

contains

  !> Breakpoints inside (0, until), ascending.
  pure function repeated_breaks(self, until) result(list)
    class(history_model), intent(in) :: self
    real(wp), intent(in) :: until       !! [s]
    type(breakpoint), allocatable :: list(:)
    integer(ip) :: first, last, k
    integer :: i
    allocate (list(0))
    if (.not. allocated(self%breaks)) return
    first = 0
    last = 0
    if (self%period > 0.0_wp) then
      first = floor(-maxval(self%breaks%time)/self%period, ip)
      last = ceiling((until - minval(self%breaks%time))/self%period, ip)
    end if
    list = [((breakpoint(self%breaks(i)%time + k*self%period, self%breaks(i)%order), i=1, size(self%breaks)), k=first, last)]
    list = pack(list, list%time > rounding_of(self%period) .and. list%time < until)   ! one at 0 acts from the start
  end function repeated_breaks

  !> Times at which it is not smooth, each once: of what repeats those of one period.
  pure recursive function marks(self) result(times)
    class(history_model), intent(in) :: self
    real(wp), allocatable :: times(:)   !! [s]
    allocate (times(0))
    if (allocated(self%breaks)) times = self%breaks%time
  end function marks

  !> The lowest derivative that jumps anywhere.
  pure recursive integer function lowest_order(self) result(order)
    class(history_model), intent(in) :: self
    order = huge(order)
    if (allocated(self%breaks)) order = minval(self%breaks%order)
  end function lowest_order

  !> Keeps the breakpoints up to an order as corners.
  recursive subroutine keep_corners(self, most_order)
    class(history_model), intent(inout) :: self
    integer, intent(in) :: most_order
    allocate (self%corners(0))
    if (allocated(self%breaks)) self%corners = pack(self%breaks%time, self%breaks%order <= most_order)
  end subroutine keep_corners

  !> The next corner above or below a time, beyond the rounding of times; huge: there is none.
  pure recursive real(wp) function next_corner(self, t, above) result(corner)   ! [s]
    class(history_model), intent(in) :: self
    real(wp), intent(in) :: t           !! [s]
    logical, intent(in) :: above
    real(wp) :: from, before            ! where the search begins, length of the periods before [s]
    integer :: n, low, high, k
    n = size(self%corners)
    corner = merge(huge(1.0_wp), -huge(1.0_wp), above)
    if (n == 0) return
    from = rounding_of(maxval(abs([t, self%period, self%corners(1)])))
    from = t + merge(from, -from, above)
    before = 0.0_wp
    if (self%period > 0.0_wp) before = self%period*floor((from - self%corners(1))/self%period, ip)
    low = 0
    high = n + 1
    do while (high - low > 1)           ! corners 1 to low lie below
      k = (low + high)/2
      if (self%corners(k) + before <= from) then
        low = k
      else
        high = k
      end if
    end do
    k = merge(high, low, above)
    if (k >= 1 .and. k <= n) then
      corner = self%corners(k) + before
    else if (self%period > 0.0_wp) then
      corner = self%corners(merge(1, n, above)) + (before + merge(self%period, -self%period, above))
    end if
  end function next_corner

  !> The largest slope, of cubic pieces between breakpoints; of a history without them that at 0.
  pure recursive real(wp) function steepest(self) result(slope)   ! [unit/s]
    class(history_model), intent(in) :: self
    real(wp), dimension(-1:2) :: a, b, between
    integer :: i
    call self%evaluate(0.0_wp, .false., a)
    slope = abs(a(1))
    if (.not. allocated(self%breaks)) return
    do i = 1, size(self%breaks) - 1
      associate (from => self%breaks(i)%time, to => self%breaks(i + 1)%time)
        call self%evaluate(from, .false., a)
        call self%evaluate(to, .true., b)
        call self%evaluate(0.5_wp*(from + to), .false., between)
        slope = max(slope, abs(a(1)), abs(b(1)), abs(between(1)))
        if (.not. a(2)*b(2) < 0.0_wp) cycle        ! the slope's own extreme
        call self%evaluate(from + (to - from)*a(2)/(a(2) - b(2)), .false., between)
        slope = max(slope, abs(between(1)))
      end associate
    end do
  end function steepest

  !> Whether it is zero at 0 or at a breakpoint, or has both signs there.
  pure logical function vanishes(self) result(yes)
    class(history_model), intent(in) :: self
    real(wp) :: h(-1:2), least, most, size_of
    integer :: i
    call self%evaluate(0.0_wp, .false., h)
    least = h(0)
    most = h(0)
    size_of = abs(h(0))
    if (allocated(self%breaks)) then
      do i = 1, size(self%breaks)
        call self%evaluate(self%breaks(i)%time, .false., h)
        least = min(least, h(0))
        most = max(most, h(0))
      end do
      size_of = max(abs(least), abs(most))
    end if
    yes = least <= negligible*size_of .and. most >= -negligible*size_of
  end function vanishes

  !> Whether time t has reached a breakpoint, within the rounding of times that are sums of steps.
  pure logical function reached(t, at, left_limit) result(yes)
    real(wp), intent(in) :: t, at       !! [s]
    logical, intent(in) :: left_limit   !! limit from below
    yes = merge(t - at >= rounding_of(max(abs(t), abs(at))), at - t <= rounding_of(max(abs(t), abs(at))), left_limit)
  end function reached

  !> The interval in which a time lies, and how far into it; 0: before the first, size(begins): after the last one. Of a period it
  !> is one of those within, whatever rounding says.
  pure subroutine locate(begins, period, t, left_limit, shift, turn, i, x)
    real(wp), intent(in) :: begins(:)   !! of the intervals, and the end of the last [s]
    real(wp), intent(in) :: period      !! 0: never [s]
    real(wp), intent(in) :: t           !! [s]
    logical, intent(in) :: left_limit   !! an interval that begins at t does not count yet
    real(wp), intent(out) :: shift      !! rounding of times, towards that side: added where the interval is chosen [s]
    integer(ip), intent(out) :: turn    !! periods before
    integer, intent(out) :: i
    real(wp), intent(out) :: x          !! time since it began [s]
    integer :: j, k
    turn = 0
    i = 0
    j = size(begins) + 1
    shift = merge(-1, 1, left_limit)*rounding_of(max(abs(t), merge(period + begins(1), 0.0_wp, period > 0.0_wp)))
    if (period > 0.0_wp) then
      turn = floor((t + shift - begins(1))/period, ip)
      i = 1
      j = j - 1
    end if
    x = t - turn*period
    do while (j - i > 1)
      k = (i + j)/2
      if (begins(k) <= x + shift) then
        i = k
      else
        j = k
      end if
    end do
    x = x - begins(max(1, i))
  end subroutine locate

  !> Order of the lowest derivative that differs between two sides of a breakpoint.
  pure integer function breakpoint_order(before, after, size) result(order)
    real(wp), intent(in) :: before(0:2), after(0:2)   !! value and two derivatives [unit, unit/s, unit/s2]
    real(wp), intent(in) :: size(0:2)                 !! of them over the whole history [unit, unit/s, unit/s2]
    do order = 0, 2
      if (abs(after(order) - before(order)) > negligible*size(order)) return
    end do
  end function breakpoint_order

  !> Two ascending lists as one; of several breakpoints at one time, to rounding, the lowest order counts.
  pure function merged(a, b) result(list)
    type(breakpoint), intent(in) :: a(:), b(:)
    type(breakpoint), allocatable :: list(:)
    type(breakpoint) :: next
    integer :: i, j, n
    logical :: from_a
    allocate (list(size(a) + size(b)))
    i = 1
    j = 1
    n = 0
    do while (i <= size(a) .or. j <= size(b))
      from_a = j > size(b)
      if (.not. from_a .and. i <= size(a)) from_a = a(i)%time <= b(j)%time
      if (from_a) then
        next = a(i)
        i = i + 1
      else
        next = b(j)
        j = j + 1
      end if
      if (n > 0) then
        if (next%time - list(n)%time <= rounding_of(next%time)) then
          list(n)%order = min(list(n)%order, next%order)
          cycle
        end if
      end if
      n = n + 1
      list(n) = next
    end do
    list = list(1:n)
  end function merged
end module history
