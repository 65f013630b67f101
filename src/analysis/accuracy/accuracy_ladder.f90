!> The ladder of passes that keeps the accuracy of a deck (theory.md, section 12): one method, each pass with a tenth of the
!> tolerance or half the step of the one before, until two agree. Counts decide, never clocks, so that a deck always makes the
!> same passes. With check_error there are two: the deck's, which is the result, and a finer one, which tells its errors.
module accuracy_ladder
  use kinds, only: wp, ip
  use archive, only: value_archive
  use deck_records, only: deck, transient_record
  use step_counts, only: actual_step
  use summary_text, only: summary_record
  use tableaux, only: method_tableau, tableau
  use text, only: either, es_text, to_text
  implicit none (type, external)
  private
  public :: smallest_accuracy

  !> How a pass ended.
  integer, parameter, public :: under_way = 0, finished = 1, given_up = 2, lost_pass = 3

  integer, parameter :: most_halvings = 30     !! of steps: more than a run could take
  real(wp), parameter :: first_look = 300.0_wp !! cost of some forty steps of dopri5, the first ones among them [-]
  real(wp), parameter :: limited = 0.5_wp      !! steps over the stable one from which stability may set them [-]
  real(wp), parameter :: dearer = 3.0_wp       !! passes of radau, with the finer ones that follow, beside those of dopri5 [-]
  real(wp), parameter :: little = 0.25_wp      !! what a pass may cost more than its budget where that is all that is left [-]
  integer, parameter :: most_slow = 3          !! passes in a row that do not halve the least difference: it does not converge
  real(wp), parameter, public :: half = 0.5_wp      !! what a finer pass leaves of a difference that converges, at most [-]
  real(wp), parameter, public :: tighter = 0.1_wp   !! tolerance of a pass, of that before it [-]
  real(wp), parameter, public :: least = 1.0e-13_wp !! tolerance [-]

  !> A pass: what it is to be, and what it has shown. The checkpoint keeps its words.
  type, public :: pass_record
    character(24) :: method = ''
    logical :: fixed = .false.                !! refined by its step, not by a tolerance
    real(wp) :: setting = 0.0_wp              !! tolerance [-] or step [s]
    logical :: watched = .false.              !! given up where another method may be cheaper
    real(wp) :: budget = huge(1.0_wp)         !! cost that it may have by then, in explicit evaluations [-]
    real(wp) :: next = first_look             !! cost at which is looked at it again [-]
    real(wp) :: looked(2) = 0.0_wp            !! cost [-] and time [s] of the last look
    integer :: outcome = under_way
    real(wp) :: cost = 0.0_wp                 !! [-]
    real(wp) :: reached = 0.0_wp              !! [s]
    real(wp) :: mean_step = 0.0_wp            !! [s]
    real(wp) :: residual = 0.0_wp             !! largest, of its energy balance [J]
    character(80) :: column = ''              !! with the largest difference from the pass before; empty: not compared
    real(wp) :: apart = 0.0_wp                !! that difference over what is asked [-]
    real(wp) :: differ_at = -1.0_wp           !! when the event sequences of both differ, < 0: they do not [s]
  end type pass_record

  !> A ladder.
  type, public :: pass_ladder
    logical :: active = .false.
    logical :: estimates = .false.            !! a finer pass tells the errors of the first one
    logical :: over = .false.
    integer :: count = 0                      !! passes, with the one under way
    type(pass_record), allocatable :: passes(:)
    character(64) :: reason = ''              !! why the accuracy is not kept
    real(wp), allocatable :: apart(:, :)      !! (columns and events, passes) differences over what is asked; huge: none [-]
    type(summary_record) :: found             !! what the summary says of the pass that is delivered
    type(transient_record), private :: asked  !! the deck's
    real(wp), private :: accuracy = 0.0_wp    !! the smallest one asked [-]
    real(wp), private :: stable(2) = 0.0_wp   !! steps of rk4 and dopri5; huge: nothing limits them [s]
  contains
    procedure :: begin
    procedure :: set
    procedure :: delivered
    procedure :: look
    procedure :: end_pass
    procedure :: words
    procedure :: exchange
  end type pass_ladder

contains

  !> The first pass. Dopri5 runs first, unless stops yield: where they stay closed its steps fall, and nothing tells by how much.
  subroutine begin(self, d, stable, columns)
    class(pass_ladder), intent(inout) :: self
    type(deck), intent(in) :: d
    real(wp), intent(in) :: stable(2)         !! steps of rk4 and dopri5; huge: nothing limits them [s]
    integer, intent(in) :: columns            !! that are compared
    self%active = .true.
    self%asked = d%transient
    self%stable = stable
    self%estimates = d%transient%check_error
    self%accuracy = smallest_accuracy(d)
    allocate (self%passes(0), self%apart(columns + 1, 0))
    associate (r => d%transient, yield => .not. all(d%stops%rigid))
      if (self%estimates) then
        call add(self, pass_record(r%method, .not. r%adaptive, merge(r%tolerance, r%step, r%adaptive)))
      else
        call take_method(self, either(either('radau', 'dopri5', yield), r%method, r%free_method))
        self%passes%watched = r%free_method .and. .not. yield
      end if
    end associate
  end subroutine begin

  !> Gives up a pass under way. One of dopri5: where stability sets its steps and it has not done half of its work, radau may be
  !> cheaper, in steps of the motion. One of radau: where it comes to cost more than a part of what dopri5 would, by the steps that
  !> this took. What is left is told by the steps since the last look: the start of a run is often dearer than the rest.
  pure subroutine look(self, cost, t, give_up)
    class(pass_ladder), intent(inout) :: self
    real(wp), intent(in) :: cost              !! so far [-]
    real(wp), intent(in) :: t                 !! [s]
    logical, intent(inout) :: give_up
    type(tableau) :: dopri5
    real(wp) :: rest                          ! cost of what is left [-]
    associate (pass => self%passes(self%count))
      if (.not. (pass%watched .and. cost > pass%next .and. t > pass%looked(2))) return
      associate (spent => cost - pass%looked(1), done => t - pass%looked(2))
        rest = (self%asked%t_end - t)*spent/done
        if (pass%method == 'dopri5') then
          dopri5 = method_tableau('dopri5')   ! and an evaluation behind the projection
          give_up = give_up .or. (done*(dopri5%stages + 1)/spent > limited*self%stable(2) .and. rest > cost)
          pass%next = 2*cost
          pass%budget = cost + rest
        else
          give_up = give_up .or. (cost >= pass%budget .and. cost + rest > (1 + little)*pass%budget)
          pass%next = merge(cost + rest, min(2*cost, pass%budget), cost >= pass%budget)
        end if
      end associate
      pass%looked = [cost, t]
    end associate
  end subroutine look

  !> The smallest accuracy that a deck asks of its columns.
  pure real(wp) function smallest_accuracy(d) result(accuracy)
    type(deck), intent(in) :: d
    accuracy = d%transient%accuracy           ! [-]
    if (size(d%sensors) > 0) accuracy = minval(merge(d%sensors%accuracy, accuracy, d%sensors%accuracy > 0.0_wp))
  end function smallest_accuracy

  !> The pass under way, and the column that makes it necessary, for the line of progress.
  function words(self)
    class(pass_ladder), intent(in) :: self
    character(:), allocatable :: words
    words = ''
    if (.not. self%active) return
    associate (pass => self%passes(self%count), before => self%passes(max(1, self%count - 1)))
      words = 'pass '//to_text(self%count)//' ('//trim(pass%method)//either(', step ', ', tolerance ', pass%fixed)// &
              to_text(pass%setting)//either(' s', '', pass%fixed)
      if (before%differ_at >= 0.0_wp) then
        words = words//', for the sequence of events'
      else if (before%apart > 1.0_wp) then
        words = words//', for '//trim(before%column)
      end if
      words = words//'): '
    end associate
  end function words

  !> The next pass.
  subroutine add(self, pass)
    class(pass_ladder), intent(inout) :: self
    type(pass_record), intent(in) :: pass
    self%passes = [self%passes, pass]
    self%count = size(self%passes)
  end subroutine add

  !> The first pass of a method. Columns of radau err by about its tolerance, those of dopri5 by ten times that: it begins one rung
  !> further down. Two passes fit above the least tolerance.
  subroutine take_method(self, method)
    class(pass_ladder), intent(inout) :: self
    character(*), intent(in) :: method
    real(wp) :: longest                       ! [s]
    if (method == 'rk4' .or. method == 'generalized_alpha') then
      longest = self%asked%output_step
      if (method == 'rk4') longest = min(longest, self%stable(1))
      call add(self, pass_record(method, .true., actual_step(self%asked%output_step, longest)))
    else
      call add(self, pass_record(method, .false., told(max(self%accuracy*merge(tighter, 1.0_wp, method == 'dopri5'), &
                                                           least/tighter))))
    end if
  end subroutine take_method

  !> The same method follows, more finely.
  subroutine refine(self)
    class(pass_ladder), intent(inout) :: self
    type(pass_record) :: last
    last = self%passes(self%count)
    call add(self, pass_record(last%method, last%fixed, told(tighter*last%setting)))
    if (last%fixed) self%passes(self%count)%setting = actual_step(self%asked%output_step, last%setting)/2
  end subroutine refine

  !> A tolerance as it is told.
  real(wp) function told(tolerance)
    real(wp), intent(in) :: tolerance         !! [-]
    character(8) :: digits
    digits = es_text(tolerance, 1)
    read (digits, *) told                     ! [-]
  end function told

  !> Gives the transient the method and the setting of the pass under way. Where stability or `max_step` sets the steps a tolerance
  !> does not, and two passes would err alike: the steps of a finer one are shorter as those of a method of order 5 are.
  pure subroutine set(self, r)
    class(pass_ladder), intent(in) :: self
    type(transient_record), intent(inout) :: r
    real(wp), parameter :: shorter = tighter**(1/5.0_wp)   ! steps of order 5, by theory [-]
    if (self%estimates .and. self%count == 1) return
    associate (pass => self%passes(self%count), before => self%passes(max(1, self%count - 1)))
      r%method = pass%method(:len(r%method))
      r%adaptive = .not. pass%fixed
      r%every_break = .true.
      r%parts = merge(2**min(self%count - 1, most_halvings), 1, pass%fixed)
      r%tolerance = pass%setting
      r%step = pass%setting
      r%max_step = shorter*self%asked%max_step
      if (self%stable(2) < huge(1.0_wp) .and. self%count > 1 .and. all([pass%method, before%method] == 'dopri5')) then
        r%max_step = shorter*before%mean_step
      end if
    end associate
  end subroutine set

  !> Number of the pass whose results are the run's so far, 0: none.
  pure integer function delivered(self) result(k)
    class(pass_ladder), intent(in) :: self
    k = 0
    if (allocated(self%passes)) k = findloc(self%passes%outcome, finished, 1, back=.true.)
    if (self%estimates) k = min(k, 1)
  end function delivered

  !> Takes the end of the pass under way and decides what follows: another pass, or nothing.
  subroutine end_pass(self, pass, apart, late)
    class(pass_ladder), intent(inout) :: self
    type(pass_record), intent(in) :: pass     !! that pass as it has ended
    real(wp), intent(in) :: apart(:)          !! (columns, then events) differences over what is asked; huge: not compared [-]
    logical, intent(in) :: late               !! `most_seconds` are over
    self%passes(self%count) = pass
    self%apart = reshape([self%apart, apart], [size(apart), self%count])
    self%over = .true.
    if (self%estimates) then
      self%over = self%count == 2 .or. pass%outcome /= finished
      if (.not. self%over) call refine(self)
    else if (late) then
      self%reason = 'most_seconds ended the search'
    else if (pass%outcome == lost_pass .and. count(self%passes%outcome == lost_pass) > 1) then
      self%reason = 'passes failed'
    else if (pass%outcome == given_up .or. pass%outcome == lost_pass .and. self%asked%free_method) then
      self%over = .false.
      call take_method(self, either('radau', 'dopri5', pass%method == 'dopri5'))
      associate (next => self%passes(self%count))
        next%watched = pass%outcome == given_up .and. next%method == 'radau'
        next%budget = pass%budget/dearer
      end associate
    else if (all(apart <= 1.0_wp)) then
      return
    else if (all(apart <= 1.0_wp .or. is_slow(self%apart))) then
      self%reason = 'finer passes do not converge (rounding or chaos)'
      if (apart(size(apart)) > 1.0_wp) self%reason = 'finer passes have other sequences of events'
    else if (.not. pass%fixed .and. pass%setting < 2*least) then
      self%reason = 'tolerances end at 1e-13'
    else
      self%over = .false.
      call refine(self)
    end if
  end subroutine end_pass

  !> Where the last passes have not halved the least difference of those before.
  pure function is_slow(apart) result(slow)
    real(wp), intent(in) :: apart(:, :)       !! (columns and events, passes) differences; huge: not compared [-]
    logical :: slow(size(apart, 1))
    integer :: n
    n = max(0, size(apart, 2) - most_slow)
    associate (before => minval(apart(:, :n), 2))
      slow = before < huge(1.0_wp) .and. minval(apart(:, n + 1:), 2) > half*before
    end associate
  end function is_slow

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
    call self%found%exchange(a)
    if (.not. a%saving) self%apart = reshape([real(wp) ::], [size(self%apart, 1), self%count - 1], [0.0_wp])
    call a%exchange(self%apart)
  end subroutine exchange
end module accuracy_ladder
