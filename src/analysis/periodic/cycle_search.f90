!> Search of a cycle, a start from which the motion repeats, by Newton's method in a growing space of differences, and Arnoldi's
!> method for the multipliers about it (theory.md, section 15). One turn a difference; a cycle costs about as many turns as there
!> are multipliers that a few plain turns do not damp.
module cycle_search
  use kinds, only: wp
  use archive, only: value_archive
  use checkpoint, only: write_checkpoint
  use difference_space, only: direction_space, ritz_pairs
  use errors, only: failure, status_signal
  use mechanism_ode, only: mechanism_system
  use progress, only: progress_line
  use scene_run, only: run_state, no_output
  use switching, only: event_list, switch_event
  use text, only: either, es_text, to_text
  use turn_log, only: turn_result
  use turn_map, only: period_map
  implicit none (type, external)
  private

  real(wp), parameter :: difference = 1.0e-4_wp      !! of a difference quotient, of the scales [-]
  real(wp), parameter :: inner = 1.0e-3_wp           !! what a step may leave of the change [-]
  real(wp), parameter :: enough = 0.1_wp             !! the same, of the tolerance [-]
  real(wp), parameter :: most_of_period = 0.2_wp     !! by which a step may change it [-]
  integer, parameter :: most_slow = 4                !! Newton steps without half the change
  integer, parameter :: most_halves = 1              !! of a Newton step
  integer, parameter :: plain = 10                   !! turns then

  !> A cycle that is sought, or found.
  type, public :: cycle_state
    type(period_map) :: map
    type(turn_result) :: turn                        !! the last turn from an iterate
    real(wp) :: period = 0.0_wp                      !! [s]
    logical :: free_period = .false.                 !! it is an unknown
    real(wp), allocatable :: x(:)                    !! (ny) the iterate [m, rad], [m/s, rad/s], [J]
    real(wp) :: residual = huge(1.0_wp)              !! largest change of an unknown in that turn, of its scale [-]
    logical :: found = .false.
    integer :: turns = 0                             !! all turns so far
    integer :: steps = 0                             !! of a turn
    real(wp) :: start_error = -1.0_wp                !! change of the start by twice the steps, of the scales; < 0: not known [-]
    real(wp), allocatable :: coarse(:)               !! (ny) the start with half the steps [m, rad], [m/s, rad/s], [J]
    integer :: turns_to_cycle = 0                    !! of them for the cycle
    integer :: most_turns = 300
    real(wp) :: tolerance = 1.0e-9_wp                !! largest change of a cycle [-]
    type(progress_line) :: line
    type(failure) :: fail                            !! a signal, or a checkpoint that could not be written
    logical :: lost_first = .false.                  !! the first turn did not come to its end
    type(direction_space) :: space                   !! of the multipliers
    type(ritz_pairs) :: pairs
    real(wp), allocatable :: error(:)                !! (pairs) of the multipliers; of steps, too, where they have been halved [-]
    integer :: wanted = 0                            !! pairs that were asked for, and found
    integer :: time = 0                              !! the pair that belongs to time, where the period is an unknown
    logical :: grazes = .false.                      !! events change on both sides of the cycle
    type(switch_event) :: changed                    !! an event of a turn that another turn had not; element 0: none
    real(wp) :: again = 0.0_wp                       !! change in a second turn, where bodies move on [-]
  contains
    procedure :: begin
    procedure :: find_cycle
    procedure :: search_again
    procedure :: halve_steps
    procedure :: turn_again
    procedure :: find_multipliers
  end type cycle_state

contains

  !> The first turn, from the present state. Where it has events a plain turn follows: those of a start that has not settled say
  !> little of the cycle's.
  subroutine begin(self, run)
    class(cycle_state), intent(inout) :: self
    type(run_state), intent(inout) :: run
    type(turn_result) :: next
    logical :: taken
    call make_turn(self, run, self%x, self%period, self%turn)
    if (self%fail%happened()) return
    self%lost_first = self%turn%lost
    if (self%lost_first) return
    call self%map%set_scales(self%turn%range, self%period)
    if (self%free_period .or. self%turn%events%count == 0) return
    associate (r => self%map%change(self%turn))
      if (maxval(abs(r)) < self%tolerance) return
      call make_turn(self, run, plain_start(self, self%turn), self%period, next)
      if (self%fail%happened() .or. next%lost) return
      taken = norm2(self%map%change(next)) < norm2(r)
      if (.not. taken) taken = .not. same_events(self%turn%events, next%events, self%changed)
      if (taken) self%turn = next
    end associate
  end subroutine begin

  !> The next turn: that of a checkpoint, where it has it. Else, where the deck asks for checkpoints, it is kept in one.
  subroutine make_turn(self, run, x, period, turn, held)
    class(cycle_state), intent(inout) :: self
    type(run_state), intent(inout) :: run
    real(wp), intent(in) :: x(:)                     !! (ny) its start [m, rad], [m/s, rad/s], [J]
    real(wp), intent(in) :: period                   !! [s]
    type(turn_result), intent(out) :: turn
    integer, intent(in), optional :: held(:)         !! (elements that switch) states whose rows hold at the start
    integer, allocatable :: states(:)
    integer :: signal
    logical :: due
    due = .false.
    turn%steps = self%steps
    associate (list => run%turns, interval => run%d%transient%checkpoint_interval)
      if (list%played == list%count) then
        states = [integer ::]
        if (present(held)) states = held
        call self%map%march(x, period, self%turns == 0, states, turn, signal)
        if (signal > 0) then
          call self%fail%raise(status_signal + signal, 'stopped by signal '//to_text(signal)//' after '//to_text(list%count)// &
                               ' turns; biela --restart continues from there')
        else
          call list%add(turn)
        end if
        if (interval > 0.0_wp) due = aint(list%count*period/interval) > aint((list%count - 1)*period/interval)
        if (due .or. signal > 0) call keep_turns(run, self%fail)
        self%found = self%found .and. .not. self%fail%happened()
        if (self%fail%happened()) return
      end if
      list%played = list%played + 1
      turn = list%items(list%played)
    end associate
    self%turns = self%turns + 1
    self%steps = turn%steps
    call self%line%tell('turn '//to_text(self%turns)// &
                        either(' (multipliers)', ': repeats to '//es_text(self%residual, 1), self%found)//'   ')
  end subroutine make_turn

  !> Writes a checkpoint of all turns.
  subroutine keep_turns(run, fail)
    type(run_state), intent(inout) :: run
    type(failure), intent(inout) :: fail
    type(value_archive) :: a
    logical :: ok
    call a%begin_saving()
    if (run%model_found) call run%exchange_model(a)
    call run%turns%exchange(a)
    call write_checkpoint(run%folder, run%d%text, run%d%settings, a, ok)
    if (.not. ok) call no_output(run, fail)
  end subroutine keep_turns

  !> Newton's method until the motion repeats to the tolerance, or is found not to.
  subroutine find_cycle(self, run)
    class(cycle_state), intent(inout) :: self
    type(run_state), intent(inout) :: run
    type(direction_space) :: space
    type(turn_result) :: next, best
    real(wp), allocatable :: r(:), last(:)           ! change in the turn, in the one before [-]
    real(wp) :: best_period, period, target          ! [s], [s], [-]
    real(wp), allocatable :: x(:)
    integer :: slow, rescues, k
    logical :: ok
    best = self%turn
    best_period = self%period
    target = huge(1.0_wp)
    slow = 0
    rescues = 0
    last = [real(wp) ::]
    call space%clear(size(self%map%compared))
    do
      r = self%map%change(self%turn)
      if (maxval(abs(r)) < self%residual) then
        self%residual = maxval(abs(r))
        best = self%turn
        best_period = self%period
      end if
      self%found = self%residual < self%tolerance
      if (self%found .or. self%turns >= self%most_turns) exit
      slow = slow + 1
      if (self%residual < 0.5_wp*target) slow = 0
      if (slow == 0) target = self%residual
      if (slow > most_slow) then
        rescues = rescues + 1
        if (rescues > 2) exit
        self%turn = best
        self%period = best_period
        call space%clear(size(r))
        do k = 1, plain
          call make_turn(self, run, plain_start(self, self%turn), self%period, next)
          if (self%fail%happened()) return
          if (next%lost) exit
          ok = same_events(self%turn%events, next%events, self%changed)
          self%turn = next
        end do
        target = huge(1.0_wp)
        slow = 0
        self%residual = huge(1.0_wp)
        last = [real(wp) ::]
        cycle
      end if
      if (size(last) > 0) then
        if (.not. worth_keeping(space, norm2(r)/norm2(last), self%tolerance/self%residual)) call space%clear(size(r))
      end if
      last = r
      call step(self, run, space, r, x, period)
      if (self%fail%happened()) return
      ok = .false.
      do k = 0, most_halves                          ! of a step that is lost, or leads farther away
        call make_turn(self, run, self%turn%start + (x - self%turn%start)*0.5_wp**k, &
                       self%period + (period - self%period)*0.5_wp**k, next)
        if (self%fail%happened()) return
        if (next%lost) cycle
        ok = norm2(self%map%change(next)) < norm2(r)
        if (ok) exit
        if (.not. same_events(self%turn%events, next%events, self%changed)) exit
      end do
      if (ok) then
        self%period = self%period + (period - self%period)*0.5_wp**k
      else
        call space%clear(size(r))
        call make_turn(self, run, plain_start(self, self%turn), self%period, next)
        if (self%fail%happened()) return
        if (next%lost) exit
      end if
      self%turn = next
    end do
    self%turn = best
    self%period = best_period
    self%turns_to_cycle = self%turns
  end subroutine find_cycle

  !> The cycle of another map, from the start of the last one.
  subroutine search_again(self, run, first)
    class(cycle_state), intent(inout) :: self
    type(run_state), intent(inout) :: run
    real(wp), intent(inout), optional :: first       !! largest change in its first turn, of the scales [-]
    type(turn_result) :: last
    last = self%turn
    self%residual = huge(1.0_wp)
    self%found = .false.
    call make_turn(self, run, last%start, self%period, self%turn)
    if (self%fail%happened() .or. self%turn%lost) return
    if (present(first)) first = maxval(abs(self%map%change(self%turn)))
    call self%find_cycle(run)
  end subroutine search_again

  !> The same cycle with twice the steps, which tells the error of the first one.
  subroutine halve_steps(self, run)
    class(cycle_state), intent(inout) :: self
    type(run_state), intent(inout) :: run
    type(turn_result) :: coarse
    coarse = self%turn
    self%coarse = coarse%start
    self%steps = 2*self%steps
    call self%search_again(run, self%start_error)
    if (self%fail%happened() .or. self%turn%lost) return
    associate (moved => abs(self%map%scaled(self%turn%start) - self%map%scaled(coarse%start)))
      self%start_error = max(self%start_error, maxval(moved))
    end associate
  end subroutine halve_steps

  !> Where bodies move on: a second turn from where they are then, which differs where their place matters.
  subroutine turn_again(self, run)
    class(cycle_state), intent(inout) :: self
    type(run_state), intent(inout) :: run
    type(turn_result) :: next
    if (.not. self%map%moves_on) return
    call make_turn(self, run, self%turn%end, self%period, next)
    if (self%fail%happened()) return
    self%again = huge(1.0_wp)
    if (.not. next%lost) self%again = maxval(abs(self%map%change(next)))
  end subroutine turn_again

  !> Whether a space of other states leads to the goal in fewer turns than a new one, which takes as many and one.
  pure logical function worth_keeping(space, fall, goal) result(yes)
    type(direction_space), intent(in) :: space
    real(wp), intent(in) :: fall                     !! of the change by the last step [-]
    real(wp), intent(in) :: goal                     !! still to be gone [-]
    yes = fall < 1.0_wp
    if (yes) yes = log(goal)/log(fall) <= space%count + 1
  end function worth_keeping

  !> Where a turn has ended, less whole turns and what does not repeat: the start of a plain turn.
  function plain_start(self, turn) result(x)
    type(cycle_state), intent(in) :: self
    type(turn_result), intent(in) :: turn
    real(wp) :: x(size(turn%start))                  ! [m, rad], [m/s, rad/s], [J]
    x = self%map%moved(turn%start, self%map%change(turn))
  end function plain_start

  !> Newton's step: the space grows until it explains the change but for a small part, which is left to the turn itself.
  subroutine step(self, run, space, r, x, period)
    class(cycle_state), intent(inout) :: self
    type(run_state), intent(inout) :: run
    type(direction_space), intent(inout) :: space
    real(wp), intent(in) :: r(:)                     !! change in the turn [-]
    real(wp), allocatable, intent(out) :: x(:)       !! (ny) the next start [m, rad], [m/s, rad/s], [J]
    real(wp), intent(out) :: period                  !! [s]
    real(wp), allocatable :: c(:), slope(:)
    real(wp) :: rest(size(r)), v(size(r)), asked(size(r)), w(size(r)), second   ! [-]
    slope = [real(wp) ::]
    if (self%free_period) slope = self%map%scaled(self%turn%slope)*self%period
    do
      call space%fit(r, slope, c, rest)
      if (norm2(rest) <= max(inner*norm2(r), enough*self%tolerance)) exit
      if (self%turns >= self%most_turns .or. space%count >= size(r)) exit
      asked = space%rest_of(rest)
      if (norm2(asked) <= inner*norm2(rest)) exit    ! no direction is left
      asked = asked/norm2(asked)
      call one_quotient(self, run, asked, .false., v, w, second)
      if (self%fail%happened()) return
      call space%add(asked, v, w)
    end do
    if (self%map%moves_on) then                      ! the joints take what is not compared along, as in the quotients
      rest = rest + matmul(space%basis(:, :space%count), c(:space%count))
    else
      rest = rest + matmul(space%v(:, :space%count), c(:space%count))
    end if
    x = self%map%moved(self%turn%start, rest)
    period = self%period
    if (self%free_period) period = period*(1 + max(-most_of_period, min(most_of_period, c(size(c)))))
  end subroutine step

  !> A difference quotient along a direction: between the cycle's turn and one from a moved start, or between two moved ones. Of a
  !> turn whose events are others than those of the cycle nothing is used.
  subroutine one_quotient(self, run, asked, central, v, w, second)
    class(cycle_state), intent(inout) :: self
    type(run_state), intent(inout) :: run
    real(wp), intent(in) :: asked(:)                 !! direction, of length 1 [-]
    logical, intent(in) :: central
    real(wp), intent(out) :: v(:), w(:)              !! direction that was moved along, its image [-]
    real(wp), intent(out) :: second                  !! size of the second difference, over the difference [-]
    type(turn_result) :: side(2)
    real(wp), dimension(size(asked), 2) :: from, to  ! [-]
    real(wp) :: sign_of                              ! [-]
    logical :: good(2)
    type(switch_event) :: changed
    integer :: k
    good = .false.
    do k = 1, 2
      sign_of = 3 - 2*k
      if (k == 2 .and. good(1) .and. .not. central) exit
      call make_turn(self, run, self%map%moved(self%turn%start, sign_of*difference*asked), self%period, side(k), &
                     self%turn%states)
      if (self%fail%happened()) return
      good(k) = .not. side(k)%lost
      if (good(k)) good(k) = same_events(self%turn%events, side(k)%events, changed)
      from(:, k) = sign_of*(self%map%scaled(side(k)%start) - self%map%scaled(self%turn%start))/difference
      to(:, k) = sign_of*(self%map%scaled(side(k)%end) - self%map%scaled(self%turn%end))/difference
    end do
    second = 0.0_wp
    if (all(good)) then
      second = norm2(to(:, 1) - to(:, 2))
      v = (from(:, 1) + from(:, 2))/2
      w = (to(:, 1) + to(:, 2))/2
    else
      if (.not. any(good) .and. self%found) self%grazes = .true.
      if (self%grazes) self%changed = changed
      k = merge(1, 2, good(1) .or. .not. good(2))
      v = from(:, k)
      w = to(:, k)
    end if
  end subroutine one_quotient

  !> Whether two turns have the same events, element by element.
  logical function same_events(a, b, changed) result(yes)
    type(event_list), intent(in) :: a, b
    type(switch_event), intent(inout) :: changed     !! the first event that only one of them has, else as it was
    type(switch_event), allocatable :: x(:), y(:)
    integer :: i, k
    yes = .true.
    do i = 1, maxval([last_element(a), last_element(b)])
      x = events_of(a, i)
      y = events_of(b, i)
      do k = 1, max(size(x), size(y))
        yes = k <= min(size(x), size(y))
        if (yes) yes = x(k)%to == y(k)%to
        if (yes) cycle
        if (k <= size(x)) changed = x(k)
        if (k > size(x)) changed = y(k)
        return
      end do
    end do
  contains
    !> The largest number of an element in a list.
    pure integer function last_element(list)
      type(event_list), intent(in) :: list
      last_element = 0
      if (list%count > 0) last_element = maxval(list%items(1:list%count)%element)
    end function last_element
  end function same_events

  !> The events of one element.
  pure function events_of(list, element) result(events)
    type(event_list), intent(in) :: list
    integer, intent(in) :: element
    type(switch_event), allocatable :: events(:)
    events = [switch_event ::]
    if (list%count > 0) events = pack(list%items(1:list%count), list%items(1:list%count)%element == element)
  end function events_of

  !> Arnoldi's method about the cycle, until the wanted multipliers are known to their goal or nothing is left to find.
  subroutine find_multipliers(self, run, number)
    class(cycle_state), intent(inout) :: self
    type(run_state), intent(inout) :: run
    integer, intent(in) :: number                    !! that are told
    real(wp), parameter :: goal = 1.0e-7_wp          ! what the space leaves of them [-]
    real(wp), parameter :: new = 0.1_wp              ! of a direction that is new is orthogonal to those before, at least [-]
    real(wp), parameter :: negligible = 10.0_wp      ! a direction with so little in it is rounding, of that of quotients [-]
    real(wp) :: v(size(self%map%compared)), asked(size(v)), w(size(v)), second, seconds   ! [-]
    complex(wp), allocatable :: before(:)            ! multipliers of half the steps [-]
    integer :: k
    if (number == 0) return
    before = [complex(wp) ::]
    if (self%start_error >= 0.0_wp) before = self%pairs%value
    self%pairs%value = [complex(wp) ::]
    seconds = 0.0_wp
    call first_direction(self, asked)
    call self%space%clear(size(v))
    do
      call one_quotient(self, run, asked, .true., v, w, second)
      if (self%fail%happened()) return
      if (norm2(self%space%rest_of(v)) < new) exit   ! the joints allow no other direction
      seconds = max(seconds, second)
      call self%space%add(asked, v, w)
      call self%space%ritz(self%pairs)
      self%wanted = min(self%space%count, number + merge(1, 0, self%free_period))
      if (self%wanted < self%space%count .and. self%pairs%value(self%wanted)%im > 0.0_wp) self%wanted = self%wanted + 1
      asked = self%space%rest_of(w)
      if (self%space%count >= size(v) .or. self%turns > self%most_turns + 1000) exit
      if (norm2(asked) <= negligible*self%map%noise/difference) exit
      asked = asked/norm2(asked)
      if (self%space%count <= number) cycle
      associate (p => self%pairs)
        if (maxval(p%residual(:self%wanted)*p%condition(:self%wanted)) < goal) exit
      end associate
    end do
    associate (p => self%pairs)
      self%wanted = min(self%wanted, count(abs(p%value) > 100*self%map%noise/difference))
      self%error = [(p%condition(k)*(p%residual(k) + seconds**2 + self%map%noise/difference), k=1, self%wanted)]
      do k = 1, merge(self%wanted, 0, size(before) > 0)
        self%error(k) = max(self%error(k), minval(abs(before - p%value(k))))
      end do
      if (self%free_period .and. self%wanted > 0) then
        asked = self%map%scaled(self%turn%slope)
        self%time = maxloc([(abs(dot_product(p%vector(:, k), cmplx(asked, 0.0_wp, wp))), k=1, self%wanted)], 1)
      end if
    end associate
  end subroutine find_multipliers

  !> A direction that excites all: pseudo-random numbers, put onto the manifold.
  subroutine first_direction(self, x)
    class(cycle_state), intent(in) :: self
    real(wp), intent(out) :: x(:)                    !! [-]
    class(mechanism_system), allocatable :: system
    real(wp), allocatable :: y(:)
    integer :: k, seed
    logical :: ok
    seed = 12345
    do k = 1, size(x)
      seed = mod(16807*seed, 65537)
      x(k) = seed/65537.0_wp - 0.5_wp
    end do
    x = x/norm2(x)
    allocate (system, source=self%map%system)
    y = self%map%moved(self%turn%start, difference*x)
    call self%map%put(system, y, self%turn%states, ok)
    if (ok) x = self%map%scaled(y) - self%map%scaled(self%turn%start)
    x = x/max(norm2(x), tiny(1.0_wp))
  end subroutine first_direction
end module cycle_search
