!> Histories one after another, each in a time of its own that begins when the one before ends.
module sequence_history
  use kinds, only: wp, ip
  use history, only: history_model, history_box, breakpoint, breakpoint_order, evaluate_shifted, merged, rounding_of
  implicit none (type, external)
  private

  !> Before the first and after the last part the value stays; a periodic one repeats.
  type, extends(history_model), public :: sequence_model
    type(history_box), allocatable :: parts(:)
    real(wp), allocatable :: begins(:)       !! times at which parts begin, and the end of the last [s]
    real(wp), allocatable :: area(:)         !! integral up to each of them [unit s]
  contains
    procedure :: set => set_sequence
    procedure :: evaluate => sequence_value
    procedure :: antiderivative => sequence_area
    procedure, private :: locate
    procedure, private :: ends_of
  end type sequence_model

contains

  !> Times of the parts, breakpoints inside and between them; the parts are set.
  subroutine set_sequence(self, start, durations, periodic)
    class(sequence_model), intent(inout) :: self
    real(wp), intent(in) :: start            !! when the first part begins [s]
    real(wp), intent(in) :: durations(:)     !! of the parts [s]
    logical, intent(in) :: periodic          !! after the last part the first one comes again
    real(wp), dimension(0:2) :: before, after, size_of
    type(breakpoint), allocatable :: list(:)
    integer :: k, n
    n = size(durations)
    allocate (self%begins(n + 1), self%area(n + 1))
    self%begins(1) = start
    if (periodic) self%period = sum(durations)
    if (periodic) self%begins(1) = modulo(start, self%period)   ! in the first turn: later ones keep their digits
    self%area(1) = 0.0_wp
    size_of = 0.0_wp
    do k = 1, n
      associate (part => self%parts(k)%item)
        self%begins(k + 1) = self%begins(k) + durations(k)
        self%area(k + 1) = self%area(k) + part%integral(durations(k))
        call part%evaluate(0.5_wp*durations(k), .false., after)
        size_of(0) = max(size_of(0), abs(after(0)))
      end associate
    end do
    do k = 1, n + 1
      call self%ends_of(k, before, after)
      size_of(0) = max(size_of(0), abs(before(0)), abs(after(0)))
    end do
    size_of(1:2) = size_of(0)/minval(durations)**[1, 2]
    allocate (self%breaks(0))
    do k = 1, n + 1
      call self%ends_of(k, before, after)
      list = [breakpoint(self%begins(k), breakpoint_order(before, after, size_of))]
      if (periodic .and. k > n) exit
      self%breaks = merged(self%breaks, list)
      if (k > n) exit
      list = self%parts(k)%item%breakpoints(durations(k))
      list%time = list%time + self%begins(k)
      self%breaks = merged(self%breaks, list)
    end do
  end subroutine set_sequence

  !> Value and derivatives on both sides of the time at which part k begins; outside all parts they stay.
  pure recursive subroutine ends_of(self, k, before, after)
    class(sequence_model), intent(in) :: self
    integer, intent(in) :: k                      !! part, or one more: the end of the last
    real(wp), intent(out) :: before(0:2), after(0:2)    !! [unit, unit/s, unit/s2]
    integer :: n, last, next
    n = size(self%parts)
    last = merge(n, k - 1, k == 1)
    next = merge(1, k, k > n)
    call self%parts(last)%item%evaluate(self%begins(last + 1) - self%begins(last), .true., before)
    call self%parts(next)%item%evaluate(0.0_wp, .false., after)
    if (self%period > 0.0_wp) return
    if (k == 1) before = [after(0), 0.0_wp, 0.0_wp]
    if (k > n) after = [before(0), 0.0_wp, 0.0_wp]
  end subroutine ends_of

  !> The part that counts at a time, and the time in it; 0: before the first one, the number of parts + 1: after the last.
  pure subroutine locate(self, t, shift, turn, k, x)
    class(sequence_model), intent(in) :: self
    real(wp), intent(in) :: t           !! [s]
    real(wp), intent(in) :: shift       !! added where the part is chosen: to see a breakpoint from one side [s]
    integer(ip), intent(out) :: turn    !! periods before
    integer, intent(out) :: k           !! the part
    real(wp), intent(out) :: x          !! time since it began [s]
    turn = 0
    if (self%period > 0.0_wp) turn = floor((t + shift - self%begins(1))/self%period, ip)
    x = t - turn*self%period
    k = count(self%begins <= x + shift)
    if (self%period > 0.0_wp) k = min(max(k, 1), size(self%parts))
    x = x - self%begins(max(k, 1))
  end subroutine locate

  !> Value and two derivatives.
  pure recursive subroutine sequence_value(self, t, left_limit, h)
    class(sequence_model), intent(in) :: self
    real(wp), intent(in) :: t           !! [s]
    logical, intent(in) :: left_limit   !! limit from below
    real(wp), intent(out) :: h(0:2)     !! [unit, unit/s, unit/s2]
    real(wp) :: x, before(0:2)
    integer(ip) :: turn
    integer :: k
    call self%locate(t, merge(-1, 1, left_limit)*rounding_of(t), turn, k, x)
    if (k < 1) then
      call self%ends_of(1, h, before)
    else if (k > size(self%parts)) then
      call self%ends_of(k, before, h)
    else
      call evaluate_shifted(self%parts(k)%item, x, 2*rounding_of(t), left_limit, h)
    end if
  end subroutine sequence_value

  !> An antiderivative.
  pure recursive function sequence_area(self, t) result(f)
    class(sequence_model), intent(in) :: self
    real(wp), intent(in) :: t           !! [s]
    real(wp) :: f                       !! [unit s]
    real(wp) :: x, h(0:2), before(0:2)
    integer(ip) :: turn
    integer :: k
    call self%locate(t, 0.0_wp, turn, k, x)
    f = turn*self%area(size(self%area)) + self%area(max(k, 1))
    if (k < 1) then
      call self%ends_of(1, h, before)
      f = f + h(0)*x
    else if (k > size(self%parts)) then
      call self%ends_of(k, before, h)
      f = f + h(0)*x
    else
      f = f + self%parts(k)%item%integral(x)
    end if
  end function sequence_area
end module sequence_history
