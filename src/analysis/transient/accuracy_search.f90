!> Which method and which tolerance keep the accuracy that a deck asks of its sensors (theory.md, section 12): what passes have cost
!> and shown, and which one comes next. Counts decide, never clocks, so that the same deck always makes the same passes.
module accuracy_search
  use kinds, only: wp, ip
  use archive, only: value_archive
  use deck_records, only: deck, transient_record
  use step_counts, only: actual_step
  use stored_pass, only: pass_rows
  use summary_text, only: summary_record
  use text, only: es_text, to_text
  implicit none (type, external)
  private
  public :: has_fixed_steps, setting_words, smallest_accuracy

  !> How a pass ended.
  integer, parameter, public :: under_way = 0, finished = 1, given_up = 2, lost_pass = 3
  !> What a pass is for: a guess of the cost; the results; a look for vibrations that other methods damp.
  integer, parameter, public :: pilot = 1, member = 2, witness = 3

  integer, parameter :: most_passes = 16
  integer, parameter :: most_slow = 3          !! passes in a row that come closer too slowly, after which none follows
  real(wp), parameter :: pilot_tolerance = 1.0e-3_wp   !! where the accuracy is finer [-]
  real(wp), parameter :: farthest = 1.0e-2_wp          !! smallest ratio of settings at which powers are believed [-]
  real(wp), parameter :: coarsest = 1.0e-2_wp          !! tolerance [-]
  real(wp), parameter :: tenth = 0.1_wp                !! tolerance of the first dopri5 pass, over the accuracy [-]
  real(wp), parameter :: least_tolerance = 1.0e-13_wp  !! [-]
  real(wp), parameter :: step_evaluations = 7.0_wp     !! of a step of dopri5 with its projection [-]
  real(wp), parameter :: growth = 1.7_wp               !! of the cost for a tenth of the tolerance [-]
  real(wp), parameter :: witness_share = 0.25_wp       !! cost of a witness at most, of the pass that it looks at [-]
  real(wp), parameter :: hopeless = 4.0_wp             !! cost of dopri5 over that of radau at which it is given up [-]
  real(wp), parameter :: safe_share = 0.97_wp          !! of the stable bound, for rk4 [-]

  !> A pass: what it is to be, and what it has shown. The checkpoint keeps its words.
  type, public :: pass_record
    integer :: role = pilot
    integer :: outcome = under_way
    character(24) :: method = ''
    real(wp) :: setting = 0.0_wp              !! tolerance [-], of methods of fixed steps the step [s]
    real(wp) :: budget = huge(1.0_wp)         !! cost at which it is given up [-]
    real(wp) :: cost = 0.0_wp                 !! in explicit evaluations [-]
    real(wp) :: reached = 0.0_wp              !! [s]
    real(wp) :: apart = -1.0_wp               !! largest difference from the other pass over what is asked, < 0: not known [-]
    real(wp) :: differ_at = -1.0_wp           !! when the event sequences of both differ, < 0: they do not [s]
    integer :: other = 0                      !! pass with which it was compared, 0: none
    integer :: column = 0                     !! with the largest difference
  end type pass_record

  !> A search.
  type, public :: pass_search
    logical :: active = .false.
    logical :: over = .false.
    logical :: kept = .false.                 !! the accuracy is
    logical :: of_model = .false.             !! one pilot of a model: nothing is delivered
    integer :: count = 0                      !! passes, with the one under way
    type(pass_record) :: passes(most_passes)
    integer :: stored = 0                     !! pass whose rows are stored, 0: none
    integer :: delivered = 0                  !! pass whose files have their names, 0: none
    character(160) :: choice = ''             !! why the method
    character(160) :: reason = ''             !! why the accuracy is not kept
    type(pass_rows) :: rows
    type(summary_record) :: found             !! what the summary says of the pass that is delivered
    real(wp), allocatable :: witnessed(:)     !! (columns) what a witness has beside the results, of what is asked, < 0: unknown [-]
    integer(ip) :: began = 0                  !! count of the clock, for `most_seconds` alone
    type(transient_record), private :: asked  !! the deck's
    real(wp), private :: accuracy = 0.0_wp    !! the smallest one asked [-]
    real(wp), private :: explicit_cost = 0.0_wp   !! of dopri5 at its stable step; 0: nothing vibrates; huge: it has failed [-]
    real(wp), private :: first_step = 0.0_wp  !! of a method of fixed steps [s]
  contains
    procedure :: begin
    procedure :: set
    procedure :: spent
    procedure :: ratio
    procedure :: error_of
    procedure :: predicted_cost
    procedure :: judge
    procedure :: exchange
  end type pass_search

contains

  !> A search for a deck's transient.
  subroutine begin(self, d, bounds, columns, outputs, began)
    class(pass_search), intent(inout) :: self
    type(deck), intent(in) :: d
    real(wp), intent(in) :: bounds(2)         !! safe steps of rk4 and dopri5; huge: nothing limits them [s]
    integer, intent(in) :: columns            !! that are compared
    integer(ip), intent(in) :: outputs        !! rows after that of t = 0
    integer(ip), intent(in) :: began          !! count of the clock
    self%active = .true.
    self%began = began
    self%asked = d%transient
    self%accuracy = smallest_accuracy(d)
    allocate (self%rows%values(columns, 0:outputs), source=0.0_wp)
    allocate (self%witnessed(columns), source=-1.0_wp)
    associate (r => d%transient)
      if (bounds(2) < huge(1.0_wp)) self%explicit_cost = step_evaluations*r%t_end/bounds(2)
      self%first_step = r%output_step
      if (r%method == 'rk4') self%first_step = actual_step(r%output_step, min(safe_share*bounds(1), r%output_step))
      if (.not. r%free_method) then
        call take_method(self, r%method, '')
      else if (self%explicit_cost > 0.0_wp) then
        call add(self, pass_record(pilot, method='radau', setting=max(first_setting(self, 'radau'), pilot_tolerance), &
                                   budget=0.5_wp*self%explicit_cost))
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

  !> Where a method begins. dopri5 also measures accelerations, so that its columns err by some ten tolerances.
  pure real(wp) function first_setting(self, method) result(setting)
    class(pass_search), intent(in) :: self
    character(*), intent(in) :: method
    setting = self%accuracy                   ! [-]
    if (method == 'dopri5') setting = tenth*self%accuracy
    setting = max(min(setting, coarsest), least_tolerance/tenth)   ! a finer pass is possible
    if (has_fixed_steps(method)) setting = self%first_step
  end function first_setting

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

  !> The next pass.
  subroutine add(self, pass)
    class(pass_search), intent(inout) :: self
    type(pass_record), intent(in) :: pass
    if (self%count == most_passes) then
      call finish(self, 'the error does not fall below the accuracy in 16 passes')
      return
    end if
    self%count = self%count + 1
    self%passes(self%count) = pass
  end subroutine add

  !> The first pass of a method, and why it is that one.
  subroutine take_method(self, method, choice, budget)
    class(pass_search), intent(inout) :: self
    character(*), intent(in) :: method
    character(*), intent(in) :: choice
    real(wp), intent(in), optional :: budget  !! [-]
    self%choice = choice
    call add(self, pass_record(member, method=method, setting=first_setting(self, method)))
    if (present(budget)) self%passes(self%count)%budget = budget
  end subroutine take_method

  !> What a pass will cost, from the last one of the same method.
  pure real(wp) function predicted_cost(self, method, setting) result(cost)
    class(pass_search), intent(in) :: self
    character(*), intent(in) :: method
    real(wp), intent(in) :: setting           !! [-] or [s]
    integer :: k
    cost = merge(self%explicit_cost, 0.0_wp, method == 'dopri5')   ! [-]
    do k = 1, self%count
      associate (before => self%passes(k))
        if (before%method /= method .or. .not. any(before%outcome == [finished, given_up])) cycle
        cost = before%cost*self%asked%t_end/max(before%reached, self%asked%output_step)
        if (has_fixed_steps(method)) cost = cost*before%setting/setting
        if (.not. has_fixed_steps(method)) cost = cost*growth**log10(before%setting/setting)
      end associate
    end do
  end function predicted_cost

  !> Gives the transient the method and the setting of the pass under way. A finer pass of dopri5 takes shorter steps where
  !> stability sets them, too: else both passes err alike there.
  pure subroutine set(self, r)
    class(pass_search), intent(in) :: self
    type(transient_record), intent(inout) :: r
    real(wp) :: part                          ! tolerance, of the first one [-]
    real(wp) :: cost                          ! of dopri5 where stability sets all steps [-]
    associate (pass => self%passes(self%count), before => self%passes(:self%count - 1))
      r%method = pass%method(:len(r%method))
      r%adaptive = .not. has_fixed_steps(pass%method)
      r%tolerance = pass%setting
      r%step = pass%setting
      r%max_step = 0.0_wp
      part = pass%setting/first_setting(self, pass%method)
      cost = min(self%explicit_cost, minval(before%cost, before%method == 'dopri5' .and. before%role == member))
      if (pass%method /= 'dopri5' .or. .not. cost > 0.0_wp) return
      if (part < 1.0_wp) r%max_step = step_evaluations*self%asked%t_end/cost*part**0.2_wp
    end associate
  end subroutine set

  !> Whether the pass under way has cost more than it may, or the search has taken its time and has results. A pass of the results
  !> goes on unless its whole cost, at the rate so far, is far more.
  logical function spent(self, cost, reached, most_seconds) result(yes)
    class(pass_search), intent(in) :: self
    real(wp), intent(in) :: cost              !! so far [-]
    real(wp), intent(in) :: reached           !! [s]
    real(wp), intent(in) :: most_seconds      !! [s]
    integer(ip) :: now, rate
    associate (pass => self%passes(self%count))
      yes = cost > pass%budget
      if (yes .and. pass%role == member .and. .not. self%of_model) yes = cost*self%asked%t_end > hopeless*pass%budget*reached
    end associate
    if (self%delivered == 0 .and. .not. self%of_model .or. .not. most_seconds < huge(1.0_wp)) return
    call system_clock(now, rate)
    yes = yes .or. real(now - self%began, wp) > most_seconds*real(rate, wp)
  end function spent

  !> Errors fall at least with this power of the tolerance, or of a fixed step: half the order.
  pure real(wp) function power(method)
    character(*), intent(in) :: method
    power = 0.6_wp                            ! [-]
    if (method == 'rk4') power = 2.0_wp
    if (method == 'generalized_alpha') power = 1.0_wp
  end function power

  !> Error of a pass over its difference from the one that it is compared with: two methods and two motions have errors of their
  !> own, and so have passes whose differences do not fall as they should.
  pure real(wp) function ratio(self, pass)
    class(pass_search), intent(in) :: self
    type(pass_record), intent(in) :: pass
    real(wp) :: part                          ! its error, of that of the other one [-]
    ratio = 1.0_wp                            ! [-]
    if (pass%other == 0 .or. pass%differ_at >= 0.0_wp .or. slow_passes(self, pass, 1.0_wp) > 0) return
    associate (before => self%passes(pass%other))
      if (before%method /= pass%method) return
      part = max(pass%setting/before%setting, farthest)**power(pass%method)
      ratio = part/(1 - part)
    end associate
  end function ratio

  !> Estimated error of the worst column of a pass over what is asked; < 0: not known.
  pure real(wp) function error_of(self, pass) result(error)
    class(pass_search), intent(in) :: self
    type(pass_record), intent(in) :: pass
    error = pass%apart*self%ratio(pass)       ! [-]
  end function error_of

  !> Tolerance or step of the next pass over that of the last one: so much finer that its error is what is asked, by the error that
  !> the last one has; where that is less, or no pass of this method is there to tell, as if it were just that.
  pure real(wp) function finer(self, pass) result(factor)
    class(pass_search), intent(in) :: self
    type(pass_record), intent(in) :: pass     !! the last one
    real(wp) :: error                         ! over what is asked [-]
    error = 1.0_wp
    if (pass%other > 0) then
      if (self%passes(pass%other)%method == pass%method) error = max(error, self%error_of(pass))
    end if
    factor = max((1/(1 + error))**(1/power(pass%method)), farthest)   ! [-]
  end function finer

  !> How many passes of one method in a row, the last one and those before it, differ by more than a part of the power of their
  !> settings explains.
  pure recursive integer function slow_passes(self, pass, part) result(n)
    class(pass_search), intent(in) :: self
    type(pass_record), intent(in) :: pass     !! the finest
    real(wp), intent(in) :: part              !! [-]
    n = 0
    if (pass%other == 0) return
    associate (before => self%passes(pass%other))
      if (before%method /= pass%method .or. before%other == 0) return
      associate (first => self%passes(before%other))
        if (first%method /= pass%method) return
        if (pass%apart > before%apart*(before%setting/first%setting)**(part*power(pass%method))) then
          n = 1 + slow_passes(self, before, part)
        end if
      end associate
    end associate
  end function slow_passes

  !> Takes the end of the pass under way and decides what follows: another pass, or nothing.
  subroutine judge(self, pass)
    class(pass_search), intent(inout) :: self
    type(pass_record), intent(in) :: pass     !! that pass as it has ended
    logical :: may_change                     ! dopri5 may take over from radau
    character(:), allocatable :: why, other
    integer :: last                           ! pass of the other method for the results, 0: none
    real(wp) :: cost                          ! of the next pass of radau [-]
    self%passes(self%count) = pass
    if (pass%role /= witness) then
      self%witnessed = -1.0_wp
      self%stored = 0                         ! rows were put over those of the pass before
      if (pass%outcome == finished) then
        call self%rows%turn()
        self%stored = self%count
        self%delivered = self%count
      end if
    end if
    call self%rows%forget()
    may_change = self%asked%free_method .and. self%explicit_cost < huge(1.0_wp)
    if (self%spent(0.0_wp, 0.0_wp, self%asked%most_seconds)) then
      call finish(self, 'most_seconds ended the search')
    else if (pass%role == pilot) then
      cost = self%predicted_cost('radau', first_setting(self, 'radau')*finer(self, pass))
      why = 'radau resolves the motion at less cost than the stable step of dopri5 asks for'
      if (pass%outcome /= finished .or. cost > self%explicit_cost) then
        call take_method(self, 'dopri5', 'the stable step of dopri5 asks for less than radau', cost)
      else if (pass%setting > first_setting(self, 'radau')) then
        call take_method(self, 'radau', why)
      else
        self%choice = why
        call refine(self, pass)
      end if
    else if (pass%role == witness) then
      if (pass%apart <= 1.0_wp) then
        call finish(self, '')
      else if (may_change) then
        call take_method(self, 'dopri5', 'radau damps vibrations that a column shows')
      else
        call refine(self, self%passes(self%stored))
      end if
    else if (pass%outcome /= finished) then   ! the other method, where it has not been lost; radau goes on where it was left
      other = trim(merge('radau ', 'dopri5', pass%method == 'dopri5'))
      why = trim(merge(' was lost                    ', ' cost far more than expected ', pass%outcome == lost_pass))
      associate (before => self%passes(1:self%count))
        last = findloc(before%method == other .and. before%role == member, .true., 1, back=.true.)
      end associate
      if (.not. may_change) then
        call finish(self, 'a finer pass'//why)
      else if (last == 0) then
        call take_method(self, other, trim(pass%method)//why)
      else if (other == 'radau' .and. self%passes(last)%outcome == finished) then
        self%choice = trim(pass%method)//why
        call refine(self, self%passes(last))
      else
        call finish(self, 'a finer pass'//why)
      end if
      if (other == 'radau') self%explicit_cost = huge(1.0_wp)   ! it is not tried again
    else if (pass%apart >= 0.0_wp .and. self%error_of(pass) <= 1.0_wp) then
      if (pass%method == 'dopri5') then
        call finish(self, '')
      else
        call add(self, pass_record(witness, method='dopri5', setting=max(1.0e-3_wp*self%accuracy, least_tolerance), &
                                   budget=witness_share*pass%cost))
      end if
    else if (may_change .and. pass%method == 'radau') then
      cost = self%predicted_cost('radau', pass%setting*finer(self, pass))
      if (cost < self%explicit_cost) then
        call refine(self, pass)
      else
        call take_method(self, 'dopri5', 'the next pass of radau would cost more than the stable step of dopri5 asks for', cost)
      end if
    else if (slow_passes(self, pass, 0.5_wp) < most_slow) then
      call refine(self, pass)
    else if (pass%differ_at >= 0.0_wp) then
      call finish(self, 'finer passes have other sequences of events: the motion cannot be predicted')
    else
      call finish(self, 'finer passes come no closer: rounding or chaos')
    end if
  end subroutine judge

  !> The same method follows, more finely.
  subroutine refine(self, pass)
    class(pass_search), intent(inout) :: self
    type(pass_record), intent(in) :: pass
    character(8) :: digits
    real(wp) :: setting                       ! [-] or [s]
    setting = pass%setting*finer(self, pass)
    if (has_fixed_steps(pass%method)) then
      setting = actual_step(self%asked%output_step, setting)
    else if (pass%setting <= least_tolerance) then
      call finish(self, 'tolerances end at 1e-13')
      return
    else
      digits = es_text(max(setting, least_tolerance), 1)     ! tolerances are told as they are
      read (digits, *) setting
    end if
    call add(self, pass_record(member, method=pass%method, setting=setting))
  end subroutine refine

  !> The search is over.
  subroutine finish(self, reason)
    class(pass_search), intent(inout) :: self
    character(*), intent(in) :: reason        !! why the accuracy is not kept; empty: it is
    self%over = .true.
    self%kept = len(reason) == 0
    self%reason = reason
  end subroutine finish

  !> Saves or restores a search between two portions of a pass.
  subroutine exchange(self, a)
    class(pass_search), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    real(wp), allocatable :: words(:)         ! of the passes [any]
    if (.not. self%active) return
    call a%exchange(self%count)
    words = transfer(self%passes, [0.0_wp])
    call a%exchange(words)
    self%passes = transfer(words, self%passes)
    call a%exchange(self%stored)
    call a%exchange(self%delivered)
    call a%exchange(self%choice)
    call self%found%exchange(a)
    call a%exchange(self%explicit_cost)
    call self%rows%exchange(a)
  end subroutine exchange
end module accuracy_search
