!> Search of a cycle, a start from which the motion repeats, by Newton's method in a growing space of differences, and Arnoldi's
!> method for the multipliers about it (theory.md, section 15). One turn a difference; a cycle costs about as many turns as there
!> are multipliers that a few plain turns do not damp.
module cycle_search
  use kinds, only: wp
  use archive, only: value_archive
  use checkpoint, only: write_checkpoint
  use difference_space, only: direction_space, ritz_pairs
  use errors, only: failure, status_signal
  use progress, only: progress_line
  use scene_run, only: run_state, no_output
  use sorting, only: sort_by_number
  use switching, only: event_list, switch_event
  use text, only: either, es_text, to_text
  use turn_log, only: turn_result
  use turn_map, only: period_map, difference
  implicit none (type, external)
  private

  real(wp), parameter :: inner = 1.0e-3_wp           !! what a step may leave of the change [-]
  real(wp), parameter :: enough = 0.1_wp             !! the same, of the tolerance [-]
  real(wp), parameter :: most_of_period = 0.2_wp     !! by which a step may change it [-]
  real(wp), parameter :: new = 0.1_wp                !! of a new direction is orthogonal to those before, at least [-]
  integer, parameter :: few = 10                     !! plain turns that are cheaper than a space

  !> A cycle that is sought, or found.
  type, public :: cycle_state
    type(period_map) :: map
    type(turn_result) :: turn                        !! the last turn from an iterate; after the search that which repeats best
    real(wp) :: period = 0.0_wp                      !! of it [s]
    logical :: free_period = .false.                 !! it is an unknown
    real(wp) :: residual = huge(1.0_wp)              !! largest change of an unknown in that turn, of its scale [-]
    logical :: found = .false.
    integer :: turns = 0                             !! all turns so far
    integer :: turns_to_cycle = 0                    !! of them for the cycle
    integer :: most_turns = 300
    real(wp) :: tolerance = 1.0e-9_wp                !! largest change of a cycle [-]
    type(progress_line) :: line
    type(failure) :: fail                            !! a signal, or a checkpoint that could not be written
    type(switch_event) :: changed                    !! an event of a turn that another turn had not; element 0: none
    real(wp) :: again = 0.0_wp                       !! change in a second turn, where bodies move on [-]
    real(wp) :: start_error = -1.0_wp                !! change of the start by twice the steps, of the scales; < 0: not known [-]
    type(turn_result) :: coarse                      !! the turn with half the steps
    type(direction_space) :: space                   !! of the multipliers
    type(ritz_pairs) :: pairs
    real(wp), allocatable :: error(:)                !! (pairs) of the multipliers; of steps, too, where they have been halved [-]
    integer :: wanted = 0                            !! pairs that were asked for, and found
    integer :: time = 0                              !! the pair that belongs to time, where the period is an unknown
    logical :: grazes = .false.                      !! events change on both sides of the cycle
  contains
    procedure :: find_cycle
    procedure :: search_again
    procedure :: halve_steps
    procedure :: turn_again
    procedure :: find_multipliers
  end type cycle_state

contains

  !> The next turn: that of a checkpoint, where it has it. Else, where the deck asks for checkpoints, it is kept in one.
  subroutine make_turn(self, run, x, period, turn, held)
    class(cycle_state), intent(inout) :: self
    type(run_state), intent(inout) :: run
    real(wp), intent(in) :: x(:)                     !! (ny) its start [m, rad], [m/s, rad/s], [J]
    real(wp), intent(in) :: period                   !! [s]
    type(turn_result), intent(out) :: turn
    integer, intent(in), optional :: held(:)         !! (elements that switch) states whose rows hold at the start
    type(value_archive) :: a
    integer :: signal
    logical :: ok
    associate (list => run%turns, interval => run%d%transient%checkpoint_interval)
      if (list%played == list%count) then
        call self%map%march(x, period, held, turn, signal)
        if (signal > 0) call self%fail%raise(status_signal + signal, 'stopped by signal '//to_text(signal)//' after '// &
                                             to_text(list%count)//' turns; biela --restart continues from there')
        if (signal == 0) call list%add(turn)
        ok = signal == 0
        if (ok .and. interval > 0.0_wp) ok = .not. aint(list%count*period/interval) > aint((list%count - 1)*period/interval)
        if (.not. ok) then
          call a%begin_saving()
          if (run%model_found) call run%exchange_model(a)
          call list%exchange(a)
          call write_checkpoint(run%folder, run%d%text, run%d%settings, a, ok)
          if (.not. ok) call no_output(run, self%fail)
        end if
        self%found = self%found .and. .not. self%fail%happened()
        if (self%fail%happened()) return
      end if
      list%played = list%played + 1
      turn = list%items(list%played)
    end associate
    if (self%turns == 0) call self%map%divide(turn)
    self%turns = self%turns + 1
    call self%line%tell('turn '//to_text(self%turns)// &
                        either(' (multipliers)', ': repeats to '//es_text(self%residual, 1), self%found)//'   ')
  end subroutine make_turn

  !> Newton's method until the motion repeats to the tolerance. While the change falls so fast that few turns are left, steps keep
  !> the space that they have; at first it is empty, which makes them plain turns. Where a step leads farther away, plain turns
  !> follow, each time one more.
  subroutine find_cycle(self, run, x, period)
    class(cycle_state), intent(inout) :: self
    type(run_state), intent(inout) :: run
    real(wp), intent(in) :: x(:)                     !! (ny) the first start [m, rad], [m/s, rad/s], [J]
    real(wp), intent(in) :: period                   !! the first one [s]
    type(direction_space) :: space
    type(turn_result) :: now, next
    type(switch_event) :: event                      ! that only one of both has
    real(wp), allocatable :: r(:)                    ! change in a turn [-]
    real(wp) :: last                                 ! its size one step before [-]
    integer :: plain, k
    logical :: kept, better                          ! the space is; the step leads nearer
    self%residual = huge(1.0_wp)
    self%found = .false.
    call make_turn(self, run, x, period, now)
    self%turn = now
    call space%clear(size(self%map%compared))
    last = huge(1.0_wp)
    plain = 1
    do while (.not. (self%fail%happened() .or. now%lost))
      r = self%map%change(now)
      if (maxval(abs(r)) < self%residual) then
        self%residual = maxval(abs(r))
        self%turn = now
      end if
      self%found = self%residual < self%tolerance
      if (self%found .or. self%turns >= self%most_turns) exit
      kept = norm2(r) < last
      if (kept) kept = log(self%tolerance/maxval(abs(r)))/log(norm2(r)/last) <= merge(few, space%count + 1, space%count == 0)
      last = norm2(r)
      if (.not. kept) call space%clear(size(r))
      call step(self, run, now, space, space%count > 0 .or. .not. kept, next)
      if (self%fail%happened()) return
      event = difference_of(now%events, next%events)
      if (event%element > 0) self%changed = event
      better = .not. next%lost
      if (better) better = norm2(self%map%change(next)) < last
      if (better) now = next
      if (better .or. kept) cycle
      do k = 1, min(plain, self%most_turns - self%turns)   ! on and on, as the machine runs alone
        call make_turn(self, run, self%map%moved(now%start, self%map%change(now)), now%period, next)
        if (self%fail%happened()) return
        if (next%lost) exit
        now = next
      end do
      if (next%lost) exit
      plain = plain + 1
      last = huge(1.0_wp)
    end do
    self%period = self%turn%period
    self%turns_to_cycle = self%turns
  end subroutine find_cycle

  !> The cycle of another map, from the start of the last one.
  subroutine search_again(self, run)
    class(cycle_state), intent(inout) :: self
    type(run_state), intent(inout) :: run
    real(wp), allocatable :: x(:)
    x = self%turn%start
    call self%find_cycle(run, x, (self%turn%period))
  end subroutine search_again

  !> The same cycle with twice the steps, which tells the error of the first one.
  subroutine halve_steps(self, run)
    class(cycle_state), intent(inout) :: self
    type(run_state), intent(inout) :: run
    self%coarse = self%turn
    self%map%steps = 2*self%map%steps
    call self%search_again(run)
    self%start_error = maxval(abs(self%map%scaled(self%turn%start) - self%map%scaled(self%coarse%start)))
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

  !> Newton's step from a turn, and the turn there. The space grows until it explains the change but for a small part; what it
  !> does not explain is left to the turn, which damps it.
  subroutine step(self, run, now, space, grows, next)
    class(cycle_state), intent(inout) :: self
    type(run_state), intent(inout) :: run
    type(turn_result), intent(in) :: now
    type(direction_space), intent(inout) :: space
    logical, intent(in) :: grows                     !! the space may grow
    type(turn_result), intent(out) :: next
    real(wp), allocatable :: c(:), slope(:)
    real(wp), dimension(size(self%map%compared)) :: r, rest, v, asked, w   ! [-]
    real(wp) :: period, second                       ! [s], [-]
    r = self%map%change(now)
    slope = [real(wp) ::]
    if (self%free_period) slope = self%map%scaled(now%slope)*now%period
    do
      call space%fit(r, slope, c, rest)
      if (.not. grows .or. self%turns >= self%most_turns .or. space%count >= size(r)) exit
      asked = self%map%tangent(now, rest)
      if (norm2(asked) <= max(inner*norm2(r), enough*self%tolerance)) exit
      asked = across(asked)
      asked = across(self%map%tangent(now, asked/max(norm2(asked), tiny(1.0_wp))))
      if (norm2(asked) < new) exit                   ! the joints allow no other direction
      asked = asked/norm2(asked)
      call one_quotient(self, run, now, asked, .false., v, w, second)
      if (self%fail%happened()) return
      call space%add(asked, v, w)
    end do
    rest = rest + matmul(space%basis(:, :space%count), c(:space%count))   ! the joints make v of it, as in the quotients
    period = now%period
    if (self%free_period) period = period*(1 + max(-most_of_period, min(most_of_period, c(size(c)))))
    call make_turn(self, run, self%map%moved(now%start, rest), period, next)
  contains
    !> What of a direction is across those of the space, and across the slope: the phase stays.
    function across(x) result(y)
      real(wp), intent(in) :: x(:)                   !! [-]
      real(wp) :: y(size(x))                         ! [-]
      y = space%rest_of(x)
      if (size(slope) > 0) y = y - slope*dot_product(slope, y)/dot_product(slope, slope)
    end function across
  end subroutine step

  !> A difference quotient along a direction: between a turn and one from a moved start, or between two moved ones. Of a turn whose
  !> events are others nothing is used.
  subroutine one_quotient(self, run, base, asked, central, v, w, second)
    class(cycle_state), intent(inout) :: self
    type(run_state), intent(inout) :: run
    type(turn_result), intent(in) :: base
    real(wp), intent(in) :: asked(:)                 !! direction, of length 1 [-]
    logical, intent(in) :: central
    real(wp), intent(out) :: v(:), w(:)              !! direction that was moved along, its image [-]
    real(wp), intent(out) :: second                  !! size of the second difference, over the difference [-]
    type(turn_result) :: side
    real(wp), dimension(size(asked), 2) :: from, to  ! [-]
    real(wp) :: h                                    ! [-]
    logical :: good(2)
    type(switch_event) :: changed
    integer :: k
    good = .false.
    do k = 1, 2
      if (k == 2 .and. good(1) .and. .not. central) exit
      h = (3 - 2*k)*difference
      call make_turn(self, run, self%map%moved(base%start, h*asked), base%period, side, base%states)
      if (self%fail%happened()) return
      good(k) = .not. side%lost
      if (good(k)) changed = difference_of(base%events, side%events)
      good(k) = good(k) .and. changed%element == 0
      from(:, k) = (self%map%scaled(side%start) - self%map%scaled(base%start))/h
      to(:, k) = (self%map%scaled(side%end) - self%map%scaled(base%end))/h
    end do
    second = 0.0_wp
    if (all(good)) second = norm2(to(:, 1) - to(:, 2))
    if (.not. any(good)) then
      self%changed = changed
      self%grazes = self%found
    end if
    h = merge(0.5_wp, 1.0_wp, all(good))
    k = merge(2, 1, good(2))                         ! that of the first turn, where neither is good
    v = h*from(:, k)
    w = h*to(:, k)
    if (all(good)) v = v + h*from(:, 1)
    if (all(good)) w = w + h*to(:, 1)
  end subroutine one_quotient

  !> The first event that only one of two turns has, element by element; element 0: none.
  type(switch_event) function difference_of(a, b) result(event)
    type(event_list), intent(in) :: a, b
    type(switch_event), allocatable :: x(:), y(:)
    integer :: k, n
    x = by_element(a)
    y = by_element(b)
    n = min(size(x), size(y))
    k = findloc(x(:n)%element == y(:n)%element .and. x(:n)%to == y(:n)%to, .false., 1)
    if (k == 0) k = n + 1
    if (k <= size(x)) event = x(k)
    if (k > size(y)) return
    if (event%element == 0 .or. y(k)%element < event%element) event = y(k)
  end function difference_of

  !> The events of a turn, those of each element in their order.
  pure function by_element(list) result(events)
    type(event_list), intent(in) :: list
    type(switch_event), allocatable :: events(:)
    integer, allocatable :: first(:), sorted(:)
    allocate (events(0))
    if (list%count == 0) return
    call sort_by_number(list%items(:list%count)%element, maxval(list%items(:list%count)%element), first, sorted)
    events = list%items(sorted)
  end function by_element

  !> Arnoldi's method about the cycle, until the wanted multipliers are known to their goal or nothing is left to find.
  subroutine find_multipliers(self, run, number)
    class(cycle_state), intent(inout) :: self
    type(run_state), intent(inout) :: run
    integer, intent(in) :: number                    !! that are told
    real(wp), parameter :: goal = 1.0e-7_wp          ! what the space leaves of them [-]
    real(wp), parameter :: negligible = 10.0_wp      ! a direction with so little in it is rounding, of that of quotients [-]
    real(wp), dimension(size(self%map%compared)) :: v, asked, w   ! [-]
    real(wp) :: second, seconds, rounding            ! [-]
    complex(wp), allocatable :: before(:)            ! multipliers of half the steps [-]
    integer :: k
    if (number == 0) return
    before = [complex(wp) ::]
    if (self%start_error >= 0.0_wp) before = self%pairs%value
    self%pairs%value = [complex(wp) ::]
    seconds = 0.0_wp
    rounding = self%map%noise/difference
    call self%space%clear(size(v))
    asked = self%map%tangent(self%turn, [(cos(real(k, wp)**2), k=1, size(v))])   ! which excites all
    do while (norm2(asked) > negligible*rounding)
      asked = asked/norm2(asked)
      call one_quotient(self, run, self%turn, asked, .true., v, w, second)
      if (self%fail%happened()) return
      asked = self%space%rest_of(v)
      if (norm2(asked) < new) exit                   ! the joints allow no other direction
      seconds = max(seconds, second)
      call self%space%add(asked/norm2(asked), v, w)
      call self%space%ritz(self%pairs)
      self%wanted = min(self%space%count, number + merge(1, 0, self%free_period))
      associate (p => self%pairs, n => self%wanted)
        if (n < self%space%count .and. p%value(n)%im > 0.0_wp) n = n + 1
        if (self%space%count > number .and. maxval(p%residual(:n)*p%condition(:n)) < goal) exit
      end associate
      if (self%space%count >= size(v) .or. self%turns > self%most_turns + 1000) exit
      asked = self%space%rest_of(w)
    end do
    associate (p => self%pairs)
      self%wanted = min(self%wanted, count(abs(p%value) > 100*rounding))
      self%error = [(p%condition(k)*(p%residual(k) + seconds**2 + rounding), k=1, self%wanted)]
      do k = 1, merge(self%wanted, 0, size(before) > 0)
        self%error(k) = max(self%error(k), minval(abs(before - p%value(k))))
      end do
      asked = self%map%scaled(self%turn%slope)
      if (self%free_period) self%time = maxloc([(abs(dot_product(p%vector(:, k), cmplx(asked, 0.0_wp, wp))), k=1, self%wanted)], 1)
    end associate
  end subroutine find_multipliers
end module cycle_search
