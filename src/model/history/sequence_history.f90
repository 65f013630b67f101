!> Histories one after another, each in a time of its own that begins when the one before ends.
module sequence_history
  use kinds, only: wp, ip
  use history, only: history_model, history_box, breakpoint, breakpoint_order, locate, merged
  implicit none (type, external)
  private

  integer, parameter :: samples = 4                !! within a part, that show how large its slopes are
  real(wp), parameter :: slope_rounding = 1.0e-9_wp !! share of values by which slopes are known, where jumps of 1e-6 count [-]

  !> Before the first and after the last part the value stays; a periodic one repeats.
  type, extends(history_model), public :: sequence_model
    type(history_box), allocatable :: parts(:)
    real(wp), allocatable :: begins(:)       !! times at which parts begin, and the end of the last [s]
    real(wp), allocatable :: area(:)         !! added to each part's antiderivative; the last: integral of all parts [unit s]
    real(wp) :: outside(2) = 0.0_wp          !! value before the first part and after the last one [unit]
  contains
    procedure :: set => set_sequence
    procedure :: evaluate => sequence_value
  end type sequence_model

contains

  !> Times of the parts, breakpoints inside and between them; the parts are set.
  subroutine set_sequence(self, start, durations, periodic)
    class(sequence_model), intent(inout) :: self
    real(wp), intent(in) :: start            !! when the first part begins [s]
    real(wp), intent(in) :: durations(:)     !! of the parts [s]
    logical, intent(in) :: periodic          !! after the last part the first one comes again
    real(wp), dimension(-1:2, size(durations) + 1) :: before, after   ! limits from below and above where parts begin
    real(wp) :: inner(-1:2), part_size(2, size(durations)), size_of(0:2)
    type(breakpoint), allocatable :: list(:)
    integer :: j, k, n
    n = size(durations)
    allocate (self%area(n + 1))
    self%begins = running_sum(start, durations)
    if (periodic) then
      self%begins = running_sum(0.0_wp, durations)
      self%period = self%begins(n + 1)
      self%begins = running_sum(modulo(start, self%period), durations)   ! in the first turn: later ones keep their digits
    end if
    self%area(n + 1) = 0.0_wp
    size_of = 0.0_wp
    do k = 1, n
      associate (part => self%parts(k)%item)
        call part%evaluate(0.0_wp, .false., after(:, k))
        call part%evaluate(durations(k), .true., before(:, k + 1))
        part_size(:, k) = max(abs(after(1:, k)), abs(before(1:, k + 1)))
        size_of(0) = max(size_of(0), abs(after(0, k)), abs(before(0, k + 1)))
        do j = 1, samples
          call part%evaluate(j*(durations(k)/(samples + 1)), .false., inner)
          part_size(:, k) = max(part_size(:, k), abs(inner(1:)))
          size_of(0) = max(size_of(0), abs(inner(0)))
        end do
        self%area(k) = self%area(n + 1) - after(-1, k)
        self%area(n + 1) = self%area(n + 1) + (before(-1, k + 1) - after(-1, k))
      end associate
    end do
    do k = 1, n                              ! what is rounding of values is so of slopes, over the length of the part
      part_size(:, k) = max(part_size(:, k), slope_rounding*size_of(0)/durations(k)**[1, 2])
    end do
    self%outside = [after(0, 1), before(0, n + 1)]
    before(:, 1) = [0.0_wp, self%outside(1), 0.0_wp, 0.0_wp]
    after(:, n + 1) = [0.0_wp, self%outside(2), 0.0_wp, 0.0_wp]
    if (periodic) before(:, 1) = before(:, n + 1)
    allocate (self%breaks(0))
    do k = 1, n + 1
      if (periodic .and. k > n) exit
      size_of(1:) = max(part_size(:, min(k, n)), part_size(:, merge(k - 1, merge(n, 1, periodic), k > 1)))
      list = [breakpoint(self%begins(k), breakpoint_order(before(0:, k), after(0:, k), size_of))]
      self%breaks = merged(self%breaks, list)
      if (k > n) exit
      list = self%parts(k)%item%breakpoints(durations(k))
      list%time = list%time + self%begins(k)
      self%breaks = merged(self%breaks, list)
    end do
  end subroutine set_sequence

  !> Sums of the first terms, each but once rounded (Knuth's exact sum of two).
  pure function running_sum(first, terms) result(sums)
    real(wp), intent(in) :: first            !! [s]
    real(wp), intent(in) :: terms(:)         !! [s]
    real(wp) :: sums(size(terms) + 1)        ! [s]
    real(wp) :: rounded, before, lost, added   ! sum, the last one, what it has lost, what of a term has been added [s]
    integer :: k
    rounded = first
    lost = 0.0_wp
    sums(1) = first
    do k = 1, size(terms)
      before = rounded
      rounded = before + terms(k)
      added = rounded - before
      lost = lost + ((before - (rounded - added)) + (terms(k) - added))
      sums(k + 1) = rounded + lost
    end do
  end function running_sum

  !> Those of the part that counts, its antiderivative moved to where the part before ends. The part's own time is a difference of
  !> two, and may lie on the wrong side of a breakpoint: the part is evaluated a little beside and taken back by its slopes.
  pure recursive subroutine sequence_value(self, t, left_limit, h)
    class(sequence_model), intent(in) :: self
    real(wp), intent(in) :: t           !! [s]
    logical, intent(in) :: left_limit   !! limit from below
    real(wp), intent(out) :: h(-1:2)    !! [unit s, unit, unit/s, unit/s2]
    real(wp) :: x, shift                ! [s]
    integer(ip) :: turn
    integer :: k
    call locate(self%begins, self%period, t, left_limit, shift, turn, k, x)
    if (k < 1) then
      h = self%outside(1)*[x, 1.0_wp, 0.0_wp, 0.0_wp]
    else if (k > size(self%parts)) then
      h = self%outside(2)*[x, 1.0_wp, 0.0_wp, 0.0_wp]
      h(-1) = h(-1) + self%area(k)
    else
      call self%parts(k)%item%evaluate(x + 2*shift, left_limit, h)
      h(:1) = h(:1) - 2*shift*h(0:)
      h(-1) = h(-1) + self%area(k) + turn*self%area(size(self%area))
    end if
  end subroutine sequence_value
end module sequence_history
