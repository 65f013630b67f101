!> Which method and which tolerance keep the accuracy that a deck asks of its sensors (theory.md, section 12): what passes have cost
!> and shown, and which one comes next. Counts decide, never clocks, so that the same deck always makes the same passes.
module accuracy_search
  use kinds, only: wp, ip
  use archive, only: value_archive
  use deck_records, only: deck, transient_record
  use step_counts, only: actual_step
  use stored_pass, only: pass_rows
  use summary_text, only: summary_record
  use text, only: es_text
  implicit none (type, external)
  private
  public :: has_fixed_steps, smallest_accuracy

  !> How a pass ended.
  integer, parameter, public :: under_way = 0, finished = 1, given_up = 2, lost_pass = 3
  !> What a pass is for: a guess of the cost; the results; a look for vibrations that other methods damp.
  integer, parameter, public :: pilot = 1, member = 2, witness = 3

  integer, parameter, public :: most_passes = 16
  real(wp), parameter :: pilot_tolerance = 1.0e-3_wp   !! where the accuracy is finer [-]
  real(wp), parameter :: farthest = 1.0e-2_wp          !! ratio of settings up to which powers are believed [-]
  real(wp), parameter :: coarsest = 1.0e-2_wp          !! tolerance [-]
  real(wp), parameter :: tenth = 0.1_wp                !! tolerance of dopri5 at first, over the accuracy [-]
  real(wp), parameter :: least_tolerance = 1.0e-13_wp  !! [-]
  real(wp), parameter :: step_evaluations = 7.0_wp     !! of a step of dopri5 with its projection [-]
  real(wp), parameter :: growth = 1.7_wp               !! of the cost of radau, for a tenth of the tolerance [-]
  real(wp), parameter :: witness_share = 0.25_wp       !! cost of a witness at most, of the pass that it looks at [-]
  real(wp), parameter :: hopeless = 4.0_wp             !! a pass is given up that costs so much more than expected [-]
  real(wp), parameter :: least_budget = 1.0e4_wp       !! evaluations that are not worth a second thought [-]
  real(wp), parameter :: safe_share = 0.97_wp          !! of the stable bound, for rk4 [-]

  !> A pass that has been made.
  type, public :: pass_record
    integer :: role = pilot
    integer :: outcome = under_way
    character(20) :: method = ''
    real(wp) :: setting = 0.0_wp              !! tolerance [-], of methods of fixed steps the step [s]
    real(wp) :: budget = huge(1.0_wp)         !! cost at which it is given up [-]
    real(wp) :: expected = 0.0_wp             !! cost, by the passes before [-]
    real(wp) :: cost = 0.0_wp                 !! in explicit evaluations [-]
    real(wp) :: reached = 0.0_wp              !! [s]
    integer :: other = 0                      !! pass with which it was compared, 0: none
    real(wp) :: apart = -1.0_wp               !! largest difference from that over what is asked, < 0: not known [-]
    real(wp) :: worst = -1.0_wp               !! estimated error of the worst column over what is asked, < 0: not known [-]
    integer :: column = 0                     !! that column
    real(wp) :: differ_at = -1.0_wp           !! when the event sequences of both differ, < 0: they do not [s]
  end type pass_record

  !> A search.
  type, public :: pass_search
    logical :: active = .false.
    logical :: over = .false.
    logical :: kept = .false.                 !! the accuracy is
    integer :: count = 0                      !! passes, with the one under way
    type(pass_record) :: passes(most_passes)
    integer :: stored = 0                     !! pass whose rows are stored, 0: none
    integer :: delivered = 0                  !! pass whose files have their names, 0: none
    character(160) :: choice = ''             !! why the method
    character(160) :: reason = ''             !! why the accuracy is not kept
    type(pass_rows) :: rows
    type(summary_record) :: found             !! what the summary says of the pass that is delivered
    real(wp), allocatable :: witnessed(:)     !! (columns) what a witness has beside the results, of what is asked, < 0: unknown [-]
    logical, private :: free = .false.        !! of methods
    logical, private :: rings = .false.       !! vibrations that a pass may damp do not die by themselves
    real(wp), private :: accuracy = 0.0_wp    !! the smallest one asked [-]
    real(wp), private :: explicit_cost = 0.0_wp   !! of dopri5 at its stable step over the run, 0: nothing vibrates [-]
    real(wp), private :: first_step = 0.0_wp  !! of a method of fixed steps [s]
    real(wp), private :: output_step = 0.0_wp  !! [s]
    integer, private :: stalls = 0            !! refinements without effect
    integer(ip) :: began = 0                  !! count of the clock, for `most_seconds` alone
    logical :: alone = .false.                !! a pilot of a model, of which nothing is delivered
  contains
    procedure :: begin
    procedure :: set
    procedure :: spent
    procedure :: comparison
    procedure :: judge
    procedure :: exchange
  end type pass_search

contains

  !> A search for a deck's transient.
  subroutine begin(self, d, bounds, rings, columns, outputs, began)
    class(pass_search), intent(inout) :: self
    type(deck), intent(in) :: d
    real(wp), intent(in) :: bounds(2)         !! safe steps of rk4 and dopri5; huge: nothing limits them [s]
    logical, intent(in) :: rings              !! the vibration that limits steps is hardly damped
    integer, intent(in) :: columns            !! that are compared
    integer(ip), intent(in) :: outputs        !! rows after that of t = 0
    integer(ip), intent(in) :: began          !! count of the clock
    type(pass_record) :: first
    self%active = .true.
    self%rings = rings
    self%began = began
    associate (r => d%transient)
      self%free = r%free_method
      self%accuracy = smallest_accuracy(d)
      if (bounds(2) < huge(1.0_wp)) self%explicit_cost = step_evaluations*r%t_end/bounds(2)
      self%output_step = r%output_step
      self%first_step = r%output_step
      if (r%method == 'rk4') self%first_step = actual_step(r%output_step, min(safe_share*bounds(1), r%output_step))
      allocate (self%rows%values(columns, 0:outputs), source=0.0_wp)
      allocate (self%witnessed(columns), source=-1.0_wp)
      if (.not. self%free) then
        first = pass_record(member, method=r%method, setting=first_setting(self, r%method))
      else if (self%explicit_cost > 0.0_wp) then
        first = pass_record(pilot, method='radau', setting=min(max(self%accuracy, pilot_tolerance), coarsest), &
                            budget=0.5_wp*self%explicit_cost)
      else
        first = pass_record(member, method='dopri5', setting=first_setting(self, 'dopri5'))
        self%choice = 'nothing limits steps of dopri5 but accuracy'
      end if
    end associate
    call add(self, first)
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

  !> The next pass.
  subroutine add(self, pass)
    class(pass_search), intent(inout) :: self
    type(pass_record), intent(in) :: pass
    if (self%count == most_passes) then
      call finish(self, .false., 'the error does not fall below the accuracy in 16 passes')
      return
    end if
    self%count = self%count + 1
    self%passes(self%count) = pass
    self%passes(self%count)%expected = expected_cost(self)
  end subroutine add

  !> What the last pass will cost, from those before it.
  pure real(wp) function expected_cost(self) result(cost)
    class(pass_search), intent(in) :: self
    integer :: k
    associate (pass => self%passes(self%count))
      cost = merge(self%explicit_cost, 0.0_wp, pass%method == 'dopri5')   ! [-]
      do k = 1, self%count - 1
        associate (before => self%passes(k))
          if (before%method /= pass%method .or. before%outcome /= finished) cycle
          cost = before%cost*growth**max(0.0_wp, log10(before%setting/pass%setting))
        end associate
      end do
      cost = min(cost, pass%budget)
    end associate
  end function expected_cost

  !> Gives the transient the method and the setting of the pass under way.
  pure subroutine set(self, r)
    class(pass_search), intent(in) :: self
    type(transient_record), intent(inout) :: r
    associate (pass => self%passes(self%count))
      r%method = pass%method
      r%adaptive = .not. has_fixed_steps(pass%method)
      r%tolerance = pass%setting
      r%step = pass%setting
    end associate
  end subroutine set

  !> Whether the pass under way has cost more than it may, or the search has taken its time and has results.
  logical function spent(self, cost, most_seconds) result(yes)
    class(pass_search), intent(in) :: self
    real(wp), intent(in) :: cost              !! so far [-]
    real(wp), intent(in) :: most_seconds      !! [s]
    yes = late(self, most_seconds) .or. cost > self%passes(self%count)%budget
  end function spent

  !> Whether the search has taken its time and has results.
  logical function late(self, most_seconds) result(yes)
    class(pass_search), intent(in) :: self
    real(wp), intent(in) :: most_seconds      !! [s]
    integer(ip) :: now, rate
    yes = .false.
    if (self%delivered == 0 .and. .not. self%alone .or. .not. most_seconds < huge(1.0_wp)) return
    call system_clock(now, rate)
    yes = real(now - self%began, wp) > most_seconds*real(rate, wp)
  end function late

  !> Errors fall at least with this power of the tolerance, or of a fixed step: half the order.
  pure real(wp) function power(method)
    character(*), intent(in) :: method
    power = 0.6_wp                            ! [-]
    if (method == 'rk4') power = 2.0_wp
    if (method == 'generalized_alpha') power = 1.0_wp
  end function power

  !> Error of the finer of two passes over the difference of both, as it is expected to be: two methods have errors of their own.
  pure real(wp) function expected_ratio(a, b) result(ratio)
    type(pass_record), intent(in) :: a, b     !! b: the finer one
    real(wp) :: part                          ! its error, of the coarser one's [-]
    ratio = 1.0_wp                            ! [-]
    if (a%method /= b%method) return
    part = max(b%setting/a%setting, farthest)**power(a%method)
    ratio = part/(1 - part)
  end function expected_ratio

  !> The same of the pass under way and the stored one, as it is believed: passes of radau that damp what rings have errors of
  !> their own, too.
  pure real(wp) function comparison(self) result(ratio)
    class(pass_search), intent(in) :: self
    ratio = 1.0_wp                            ! [-]
    if (self%stored == 0) return
    associate (a => self%passes(self%stored), b => self%passes(self%count))
      if (.not. (b%method == 'radau' .and. self%rings)) ratio = expected_ratio(a, b)
    end associate
  end function comparison

  !> Tolerance or step of the next pass over that of the last one: so much finer that its error is what is asked, by the error that
  !> the last one is expected to have; where that is less, or no pass of this method is there to tell, as if it were just that.
  pure real(wp) function finer(self, pass) result(factor)
    class(pass_search), intent(in) :: self
    type(pass_record), intent(in) :: pass     !! the last one
    real(wp) :: error                         ! over what is asked [-]
    error = 1.0_wp
    if (pass%other > 0) then
      associate (before => self%passes(pass%other))
        if (before%method == pass%method) error = max(error, pass%apart*expected_ratio(before, pass))
      end associate
    end if
    factor = (1/(1 + error))**(1/power(pass%method))   ! [-]
  end function finer

  !> Takes the end of the pass under way and decides on the next one, or ends the search.
  subroutine judge(self, end, most_seconds)
    class(pass_search), intent(inout) :: self
    type(pass_record), intent(in) :: end      !! that pass as it has ended
    real(wp), intent(in) :: most_seconds      !! [s]
    type(pass_record) :: pass
    pass = end
    pass%other = self%stored
    self%passes(self%count) = pass
    if (pass%outcome == finished .and. pass%role /= witness) then
      call self%rows%turn()
      self%stored = self%count
      self%delivered = self%count
      self%witnessed = -1.0_wp
    else
      if (pass%role /= witness) self%rows%whole = .false.     ! rows were put over those of the pass before
      if (pass%role /= witness) self%stored = 0
      call self%rows%forget()
    end if
    if (late(self, most_seconds)) then
      call finish(self, .false., 'most_seconds ended the search')
    else if (pass%role == pilot) then
      call choose(self, pass)
    else if (pass%role == witness) then
      call hear(self, pass)
    else if (pass%outcome == finished) then
      call refine(self, pass)
    else
      call replace(self, pass)
    end if
  end subroutine judge

  !> The method, after the pilot.
  subroutine choose(self, pass)
    class(pass_search), intent(inout) :: self
    type(pass_record), intent(in) :: pass     !! of the pilot
    real(wp) :: cost                          ! of radau at the accuracy, as far as the pilot tells [-]
    cost = pass%cost*growth**log10(pass%setting/(first_setting(self, 'radau')*finer(self, pass)))
    if (pass%outcome /= finished) cost = cost*self%output_step*ubound(self%rows%values, 2)/max(pass%reached, self%output_step)
    if (pass%outcome == finished .and. cost < self%explicit_cost) then
      self%choice = 'radau resolves the motion at less cost than the stable step of dopri5 asks for'
      if (pass%setting > first_setting(self, 'radau')) then
        call add(self, pass_record(member, method='radau', setting=first_setting(self, 'radau')))
      else
        call add_finer(self, pass)
      end if
    else
      self%choice = 'the stable step of dopri5 asks for less than radau'
      call add(self, pass_record(member, method='dopri5', setting=first_setting(self, 'dopri5'), &
                                 budget=hopeless*max(self%explicit_cost, cost, least_budget)))
    end if
  end subroutine choose

  !> What follows a pass of the results: nothing, a witness, a finer pass, or the other method.
  subroutine refine(self, pass)
    class(pass_search), intent(inout) :: self
    type(pass_record), intent(in) :: pass
    logical :: leaves_radau                   ! dopri5 may follow: it has not cost too much
    leaves_radau = self%free .and. pass%method == 'radau' .and. self%explicit_cost < huge(1.0_wp)
    if (pass%worst >= 0.0_wp .and. pass%worst <= 1.0_wp) then
      if (pass%method == 'dopri5') then
        call finish(self, .true., '')
      else
        call add(self, pass_record(witness, method='dopri5', setting=max(1.0e-3_wp*self%accuracy, least_tolerance), &
                                   budget=witness_share*pass%cost))
      end if
    else if (leaves_radau .and. falls_slowly(self, pass)) then
      self%choice = 'errors of radau fall as slowly as where it damps vibrations that a column shows'
      call add(self, pass_record(member, method='dopri5', setting=first_setting(self, 'dopri5')))
    else if (stuck(self, pass)) then
      return
    else if (leaves_radau .and. pass%cost*growth**(-log10(finer(self, pass))) > self%explicit_cost) then
      self%choice = 'the next pass of radau would cost more than the stable step of dopri5 asks for'
      call add(self, pass_record(member, method='dopri5', setting=first_setting(self, 'dopri5')))
    else
      call add_finer(self, pass)
    end if
  end subroutine refine

  !> The same method, more finely.
  subroutine add_finer(self, pass)
    class(pass_search), intent(inout) :: self
    type(pass_record), intent(in) :: pass
    character(8) :: digits
    real(wp) :: setting                       ! [-] or [s]
    setting = pass%setting*finer(self, pass)
    if (has_fixed_steps(pass%method)) then
      setting = actual_step(self%output_step, setting)
    else
      digits = es_text(setting, 1)            ! tolerances are told as they are
      read (digits, *) setting
    end if
    if (setting < least_tolerance .and. .not. has_fixed_steps(pass%method)) then
      call finish(self, .false., 'tolerances end at 1e-13')
    else
      call add(self, pass_record(member, method=pass%method, setting=setting))
    end if
  end subroutine add_finer

  !> Whether differences of three passes of one method fall with less than half the power that is expected.
  pure logical function falls_slowly(self, pass) result(yes)
    class(pass_search), intent(in) :: self
    type(pass_record), intent(in) :: pass     !! the finest
    yes = .false.
    if (pass%other == 0) return
    associate (before => self%passes(pass%other))
      if (before%method /= pass%method .or. before%other == 0) return
      associate (first => self%passes(before%other))
        if (first%method /= pass%method) return
        yes = pass%apart > before%apart*(before%setting/first%setting)**(0.5_wp*power(pass%method))
      end associate
    end associate
  end function falls_slowly

  !> Whether finer passes do not help: rounding, chaos. The search is then over.
  logical function stuck(self, pass) result(yes)
    class(pass_search), intent(inout) :: self
    type(pass_record), intent(in) :: pass
    if (falls_slowly(self, pass)) self%stalls = self%stalls + 1
    yes = self%stalls == 2
    if (yes .and. pass%differ_at >= 0.0_wp) then
      call finish(self, .false., 'finer passes have other sequences of events: the motion cannot be predicted')
    else if (yes) then
      call finish(self, .false., 'finer passes come no closer: rounding or chaos')
    end if
  end function stuck

  !> What a witness tells of the pass before it.
  subroutine hear(self, pass)
    class(pass_search), intent(inout) :: self
    type(pass_record), intent(in) :: pass     !! of the witness
    if (pass%worst <= 1.0_wp) then
      call finish(self, .true., '')
    else if (self%free .and. self%explicit_cost < huge(1.0_wp)) then
      self%choice = 'radau damps vibrations that a column shows'
      call add(self, pass_record(member, method='dopri5', setting=first_setting(self, 'dopri5')))
    else
      call add_finer(self, self%passes(self%stored))
    end if
  end subroutine hear

  !> What follows a pass that was lost or cost too much: the other method, where it has not been tried.
  subroutine replace(self, pass)
    class(pass_search), intent(inout) :: self
    type(pass_record), intent(in) :: pass
    character(20) :: other
    other = merge('radau               ', 'dopri5              ', pass%method == 'dopri5')
    if (self%free .and. .not. any(self%passes(1:self%count)%method == other .and. &
                                  self%passes(1:self%count)%role == member)) then
      self%choice = trim(pass%method)//trim(merge(' was lost                    ', ' cost far more than expected ', &
                                                  pass%outcome == lost_pass))
      if (other == 'radau') self%explicit_cost = huge(1.0_wp)
      call add(self, pass_record(member, method=other, setting=first_setting(self, trim(other))))
    else
      call finish(self, .false., trim(merge('a finer pass was lost               ', &
                                            'a finer pass cost far more than this', pass%outcome == lost_pass)))
    end if
  end subroutine replace

  !> The search is over.
  subroutine finish(self, kept, reason)
    class(pass_search), intent(inout) :: self
    logical, intent(in) :: kept
    character(*), intent(in) :: reason        !! why it is not; else nothing
    self%over = .true.
    self%kept = kept
    if (.not. kept) self%reason = reason
  end subroutine finish

  !> Saves or restores a search between two portions of a pass.
  subroutine exchange(self, a)
    class(pass_search), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    integer :: k
    if (.not. self%active) return
    call a%exchange(self%count)
    do k = 1, min(self%count, most_passes)
      associate (pass => self%passes(k))
        call a%exchange(pass%role)
        call a%exchange(pass%outcome)
        call a%exchange(pass%method)
        call a%exchange(pass%setting)
        call a%exchange(pass%budget)
        call a%exchange(pass%expected)
        call a%exchange(pass%cost)
        call a%exchange(pass%reached)
        call a%exchange(pass%other)
        call a%exchange(pass%apart)
        call a%exchange(pass%worst)
        call a%exchange(pass%column)
        call a%exchange(pass%differ_at)
      end associate
    end do
    call a%exchange(self%witnessed)
    call a%exchange(self%stored)
    call a%exchange(self%delivered)
    call a%exchange(self%choice)
    call a%exchange(self%reason)
    call self%found%exchange(a)
    call a%exchange(self%explicit_cost)
    call a%exchange(self%stalls)
    call self%rows%exchange(a)
  end subroutine exchange
end module accuracy_search
