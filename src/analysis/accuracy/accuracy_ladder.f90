!> The ladder of passes that keeps the accuracy of a deck (theory.md, section 12): one method, each pass with a tenth of the
!> tolerance or half the step of the one before, until two agree. Counts decide, never clocks, so that a deck always makes the
!> same passes. With check_error there are two: the deck's, which is the result, and a finer one, which tells its errors. Twice the
!> step would cost less and tell less: it is unstable above half of the stable bound.
module accuracy_ladder
  use kinds, only: wp, ip
  use archive, only: value_archive
  use deck_records, only: deck, transient_record
  use choose_stepper, only: method_order
  use step_counts, only: actual_step
  use summary_text, only: summary_record
  use text, only: either, es_text, to_text
  implicit none (type, external)
  private
  public :: has_fixed_steps, setting_words, smallest_accuracy

  !> How a pass ended.
  integer, parameter, public :: under_way = 0, finished = 1, given_up = 2, lost_pass = 3

  real(wp), parameter :: most_slow = 3.0_wp    !! comparisons in a row whose difference is not halved: it does not converge [-]
  real(wp), parameter, public :: tighter = 0.1_wp      !! tolerance of a pass, of that before it [-]
  real(wp), parameter, public :: least = 1.0e-13_wp    !! tolerance [-]
  real(wp), parameter :: coarsest = 1.0e-2_wp  !! tolerance [-]
  real(wp), parameter :: step_evaluations = 7.0_wp     !! of a step of dopri5: six of its tableau, one behind the projection [-]

  !> A pass: what it is to be, and what it has shown. The checkpoint keeps its words.
  type, public :: pass_record
    integer :: outcome = under_way
    character(24) :: method = ''
    real(wp) :: setting = 0.0_wp              !! tolerance [-], of methods of fixed steps the step [s]
    real(wp) :: budget = huge(1.0_wp)         !! cost at which it is given up [-]
    real(wp) :: cost = 0.0_wp                 !! in explicit evaluations [-]
    real(wp) :: reached = 0.0_wp              !! [s]
    real(wp) :: mean_step = 0.0_wp            !! [s]
    real(wp) :: apart = -1.0_wp               !! largest difference from the other pass over what is asked, < 0: not known [-]
    real(wp) :: differ_at = -1.0_wp           !! when the event sequences of both differ, < 0: they do not [s]
    real(wp) :: residual = 0.0_wp             !! largest, of its energy balance [J]
    real(wp) :: share = 0.0_wp                !! the same, of the energy that moved [-]
    integer :: other = 0                      !! pass with which it was compared, 0: none
    integer :: column = 0                     !! with the largest difference
  end type pass_record

  !> A ladder.
  type, public :: pass_ladder
    logical :: active = .false.
    logical :: estimates = .false.            !! a finer pass tells the errors of the first one
    logical :: over = .false.
    logical :: kept = .false.                 !! the accuracy is
    integer :: count = 0                      !! passes, with the one under way
    type(pass_record), allocatable :: passes(:)
    integer :: stored = 0                     !! pass whose rows are stored, 0: none
    integer :: delivered = 0                  !! pass whose files have their names, 0: none
    character(160) :: choice = ''             !! why the method
    character(96) :: because = ''             !! of which column the pass under way is made
    character(160) :: reason = ''             !! why the accuracy is not kept
    real(wp), allocatable :: apart(:)         !! (columns, then events) last difference over what is asked [-]
    real(wp), allocatable :: slow(:)          !! how many times in a row it was not halved [-]
    real(wp), allocatable :: absolute(:)      !! (columns) asked where the range alone does not set it, else 0 [of the column]
    type(summary_record) :: found             !! what the summary says of the pass that is delivered
    type(transient_record), private :: asked  !! the deck's
    real(wp), private :: accuracy = 0.0_wp    !! the smallest one asked [-]
    real(wp), private :: first_step = 0.0_wp  !! of a method of fixed steps [s]
    real(wp), private :: stable = 0.0_wp      !! step of dopri5; huge: nothing limits it [s]
  contains
    procedure :: begin
    procedure :: set
    procedure :: error_ratio
    procedure :: end_pass
    procedure :: words
    procedure :: exchange
  end type pass_ladder

contains

  !> The first pass. Radau runs first where anything vibrates; it is given up for dopri5 at a third of what that costs at its stable
  !> step, since radau mostly takes two finer passes, which cost more, and steps of dopri5 hardly depend on its tolerance. Where
  !> stops yield, that step is not known before they touch.
  subroutine begin(self, d, bounds, columns)
    class(pass_ladder), intent(inout) :: self
    type(deck), intent(in) :: d
    real(wp), intent(in) :: bounds(2)         !! stable steps of rk4 and dopri5; huge: nothing limits them [s]
    integer, intent(in) :: columns            !! that are compared
    logical :: yielding
    self%active = .true.
    self%asked = d%transient
    self%stable = bounds(2)
    self%estimates = d%transient%check_error
    self%accuracy = smallest_accuracy(d)
    allocate (self%passes(0))
    allocate (self%apart(columns + 1), source=huge(1.0_wp))
    allocate (self%slow(columns + 1), source=0.0_wp)
    allocate (self%absolute(columns), source=0.0_wp)
    associate (r => d%transient)
      self%first_step = r%output_step
      if (self%estimates) call add(self, pass_record(method=r%method))
      if (self%estimates) return
      if (r%method == 'rk4') self%first_step = actual_step(r%output_step, min(bounds(1), r%output_step))
      yielding = .not. all(d%stops%rigid)
      if (.not. r%free_method) then
        call take_method(self, r%method, '')
      else if (bounds(2) < huge(1.0_wp) .or. yielding) then
        call take_method(self, 'radau', 'radau resolves the motion in a third of the evaluations of dopri5 at its stable step')
        if (yielding) self%choice = 'stops that yield may limit the steps of dopri5'
        if (.not. yielding) self%passes(1)%budget = step_evaluations*r%t_end/bounds(2)/3
      else
        call take_method(self, 'dopri5', 'nothing limits steps of dopri5 but accuracy')
      end if
    end associate
  end subroutine begin

  !> The smallest accuracy that a deck asks of its columns.
  pure real(wp) function smallest_accuracy(d) result(accuracy)
    type(deck), intent(in) :: d
    accuracy = d%transient%accuracy           ! [-]
    if (size(d%sensors) > 0) accuracy = minval(merge(d%sensors%accuracy, accuracy, d%sensors%accuracy > 0.0_wp))
  end function smallest_accuracy

  !> Whether a method is refined by its step, not by a tolerance.
  pure logical function has_fixed_steps(method) result(yes)
    character(*), intent(in) :: method
    yes = method == 'rk4' .or. method == 'generalized_alpha'
  end function has_fixed_steps

  !> Setting of a pass.
  function setting_words(pass) result(words)
    type(pass_record), intent(in) :: pass
    character(:), allocatable :: words
    words = ', tolerance '//to_text(pass%setting)
    if (has_fixed_steps(pass%method)) words = ', step '//to_text(pass%setting)//' s'
  end function setting_words

  !> The pass under way, for the line of progress.
  function words(self)
    class(pass_ladder), intent(in) :: self
    character(:), allocatable :: words
    words = either('second run: ', '', self%estimates .and. self%count == 2)
    if (self%active .and. .not. self%estimates) words = 'pass '//to_text(self%count)//' ('//trim(self%passes(self%count)%method)// &
                             setting_words(self%passes(self%count))//trim(self%because)//'): '
  end function words

  !> The next pass.
  subroutine add(self, pass)
    class(pass_ladder), intent(inout) :: self
    type(pass_record), intent(in) :: pass
    self%passes = [self%passes, pass]
    self%count = size(self%passes)
  end subroutine add

  !> The first pass of a method, and why it is that one. Columns of radau err by about its tolerance, those of dopri5 by ten times
  !> that: it begins one rung further down. Two passes fit above the least tolerance.
  subroutine take_method(self, method, choice)
    class(pass_ladder), intent(inout) :: self
    character(*), intent(in) :: method
    character(*), intent(in) :: choice
    real(wp) :: setting                       ! [-] or [s]
    setting = self%accuracy
    if (method == 'dopri5') setting = tighter*setting
    setting = told(max(min(setting, coarsest), least/tighter))
    if (has_fixed_steps(method)) setting = self%first_step
    self%choice = choice
    call add(self, pass_record(method=method, setting=setting))
  end subroutine take_method

  !> A tolerance as it is told.
  real(wp) function told(tolerance)
    real(wp), intent(in) :: tolerance         !! [-]
    character(8) :: digits
    digits = es_text(tolerance, 1)
    read (digits, *) told                     ! [-]
  end function told

  !> Gives the transient the method and the setting of the pass under way. Where stability sets the steps of dopri5 a tolerance does
  !> not, and two passes would err alike: the steps of a finer one are shorter as those of a method of order 5 are.
  pure subroutine set(self, r)
    class(pass_ladder), intent(in) :: self
    type(transient_record), intent(inout) :: r
    if (self%estimates) then
      if (self%count == 2) call refine_asked(self, r)
      return
    end if
    associate (pass => self%passes(self%count))
      r%method = pass%method(:len(r%method))
      r%adaptive = .not. has_fixed_steps(pass%method)
      r%tolerance = pass%setting
      r%step = pass%setting
      r%max_step = 0.0_wp
      if (pass%method /= 'dopri5' .or. self%count == 1) return
      associate (before => self%passes(self%count - 1))
        if (before%method == 'dopri5') r%max_step = tighter**0.2_wp*before%mean_step
      end associate
    end associate
  end subroutine set

  !> The second one of two runs: half the step, or a tenth of the tolerance. Steps that stability limits are as long whatever the
  !> tolerance.
  pure subroutine refine_asked(self, r)
    class(pass_ladder), intent(in) :: self
    type(transient_record), intent(inout) :: r
    real(wp) :: longest                       ! [s]
    if (.not. r%adaptive) then
      r%step = actual_step(r%output_step, r%step)/2
      return
    end if
    longest = merge(self%stable, huge(1.0_wp), r%method == 'dopri5')
    if (r%max_step > 0.0_wp) longest = min(longest, r%max_step)
    if (longest < huge(1.0_wp)) r%max_step = longest/2
    r%tolerance = tighter*r%tolerance
    r%first_step = r%first_step/2
  end subroutine refine_asked

  !> Error of the first one of two runs over the difference (Richardson). With the tolerance errors fall to a fifth or less of what
  !> they were, as with half the step of a method of order 2.
  pure real(wp) function error_ratio(self) result(ratio)   ! [-]
    class(pass_ladder), intent(in) :: self
    integer :: order
    order = merge(2, method_order(self%asked%method), self%asked%adaptive)
    ratio = merge(1/(1 - 0.5_wp**order), 1.0_wp, self%estimates)
  end function error_ratio

  !> Takes the end of the pass under way and decides what follows: another pass, or nothing.
  subroutine end_pass(self, pass, apart, late)
    class(pass_ladder), intent(inout) :: self
    type(pass_record), intent(in) :: pass     !! that pass as it has ended
    real(wp), intent(in) :: apart(:)          !! (columns, then events) differences over what is asked; empty: not compared [-]
    logical, intent(in) :: late               !! `most_seconds` are over
    character(:), allocatable :: other
    logical :: agree, stuck                   ! in all that was compared; where not, no finer pass has helped
    agree = .false.
    stuck = .false.
    self%passes(self%count) = pass
    if (self%estimates) then
      self%over = self%count == 2 .or. pass%outcome /= finished
      if (pass%outcome == finished) self%delivered = 1
      if (.not. self%over) call add(self, pass_record(method=pass%method))
      return
    end if
    self%stored = 0                           ! rows were put over those of the pass before
    if (pass%outcome == finished) then
      self%stored = self%count
      self%delivered = self%count
    end if
    if (size(apart) > 0) then
      self%slow = merge(self%slow + 1, 0.0_wp, apart > 1.0_wp .and. apart > 0.5_wp*self%apart)
      self%apart = apart
      agree = all(apart <= 1.0_wp)
      stuck = all(apart <= 1.0_wp .or. self%slow >= most_slow)
    end if
    if (late) then
      call finish(self, 'most_seconds ended the search')
    else if (pass%outcome == given_up) then
      call take_method(self, 'dopri5', 'the stable step of dopri5 asks for less than radau')
    else if (pass%outcome == lost_pass) then
      other = either('radau', 'dopri5', pass%method == 'dopri5')
      if (count(self%passes(:self%count)%outcome == lost_pass) > 1) then
        call finish(self, 'passes failed')
      else if (self%asked%free_method) then
        call take_method(self, other, trim(pass%method)//' failed')
      else
        call refine(self, pass)
      end if
    else if (agree) then
      call finish(self, '')
    else if (stuck) then
      call finish(self, 'finer passes do not converge (rounding or chaos)')
      if (apart(size(apart)) > 1.0_wp) self%reason = 'finer passes have other sequences of events'
    else
      call refine(self, pass)
    end if
  end subroutine end_pass

  !> The same method follows, more finely.
  subroutine refine(self, pass)
    class(pass_ladder), intent(inout) :: self
    type(pass_record), intent(in) :: pass
    real(wp) :: setting                       ! [-] or [s]
    setting = told(tighter*pass%setting)
    if (has_fixed_steps(pass%method)) then
      setting = actual_step(self%asked%output_step, pass%setting)/2
    else if (pass%setting < 2*least) then
      call finish(self, 'tolerances end at 1e-13')
      return
    end if
    call add(self, pass_record(method=pass%method, setting=setting))
  end subroutine refine

  !> The ladder ends.
  subroutine finish(self, reason)
    class(pass_ladder), intent(inout) :: self
    character(*), intent(in) :: reason        !! why the accuracy is not kept; empty: it is
    self%over = .true.
    self%kept = len(reason) == 0
    self%reason = reason
  end subroutine finish

  !> Saves or restores a ladder between two portions of a pass.
  subroutine exchange(self, a)
    class(pass_ladder), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    integer(ip), allocatable :: words(:)
    if (.not. self%active) return
    words = transfer(self%passes, [0_ip])
    call a%exchange(words)
    self%passes = transfer(words, self%passes)
    self%count = size(self%passes)
    call a%exchange(self%stored, self%delivered, self%choice, self%because)
    call self%found%exchange(a)
    call a%exchange(self%apart, self%slow, self%absolute)
  end subroutine exchange
end module accuracy_ladder
