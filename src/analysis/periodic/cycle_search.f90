!> Search of a cycle, a start from which the motion repeats, by the differences of the turns made on the way, and Arnoldi's method
!> for the multipliers about it (theory.md, section 15). A cycle costs about as many turns as there are multipliers that a few plain
!> turns do not damp.
module cycle_search
  use kinds, only: wp
  use archive, only: value_archive
  use checkpoint, only: write_checkpoint
  use difference_space, only: direction_space, ritz_pairs
  use errors, only: failure, status_signal
  use progress, only: progress_line
  use scene_run, only: run_state, no_output
  use switching, only: event_list, switch_event
  use text, only: either, es_text, to_text
  use turn_log, only: exchange_turns, turn_result
  use turn_map, only: period_map
  implicit none (type, external)
  private

  real(wp), parameter :: most_of_period = 0.2_wp     !! by which a step may change it [-]

  !> A cycle that is sought, or found.
  type, public :: cycle_state
    type(period_map) :: map
    type(turn_result) :: turn                        !! the last turn from an iterate; after the search that which repeats best
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
    associate (log => run%turns, interval => run%d%transient%checkpoint_interval)
      log%saving = log%saving .or. log%complete()
      if (log%saving) then
        call self%map%march(x, period, held, turn, signal)
        if (signal > 0) call self%fail%raise(status_signal + signal, 'stopped by signal '//to_text(signal)//' after '// &
                                             to_text(self%turns)//' turns; biela --restart continues from there')
        ok = signal == 0
        if (ok) call turn%exchange(log)
        if (ok .and. interval > 0.0_wp) ok = .not. aint((self%turns + 1)*period/interval) > aint(self%turns*period/interval)
        if (.not. ok) then
          call a%begin_saving()
          if (run%model_found) call run%exchange_model(a)
          call exchange_turns(run%turns, a)
          call write_checkpoint(run%folder, run%d%text, run%d%settings, a, ok)
          if (.not. ok) call no_output(run, self%fail)
        end if
        self%found = self%found .and. .not. self%fail%happened()
        if (self%fail%happened()) return
      else
        call turn%exchange(log)
      end if
    end associate
    if (self%turns == 0) call self%map%divide(turn)
    self%turns = self%turns + 1
    call self%line%tell('turn '//to_text(self%turns)// &
                        either(' (multipliers)', ': repeats to '//es_text(self%residual, 1), self%found)//'   ')
  end subroutine make_turn

  !> Steps until the motion repeats to the tolerance. A step that leads farther away is learned from and made anew; where that does,
  !> too, plain turns follow, each time one more.
  subroutine find_cycle(self, run)
    class(cycle_state), intent(inout) :: self        !! in: start and period of its turn are those of the first one
    type(run_state), intent(inout) :: run
    type(direction_space) :: space
    type(turn_result) :: now
    real(wp) :: change                               ! in a turn [-]
    integer :: plain, ahead, failed                  ! plain turns the last time, still to come; as of `step`
    self%residual = huge(1.0_wp)
    self%found = .false.
    call make_turn(self, run, self%turn%start, self%turn%period, now)
    self%turn = now
    call space%clear(size(self%map%compared))
    plain = 0
    ahead = 0
    failed = 0
    do while (.not. (self%fail%happened() .or. now%lost))
      change = maxval(abs(self%map%change(now)))
      if (change < self%residual) self%turn = now
      self%residual = min(change, self%residual)
      self%found = self%residual < self%tolerance
      if (self%found .or. self%turns >= self%most_turns) exit
      if (ahead > 0) then                            ! on and on, as the machine runs alone
        ahead = ahead - 1
        call make_turn(self, run, self%map%moved(now%start, self%map%change(now)), (now%period), now)
        cycle
      end if
      call step(self, run, space, now, failed)
      if (failed < 2) cycle
      call space%clear(size(self%map%compared))
      failed = 0
      plain = plain + 1
      ahead = plain
    end do
    self%turns_to_cycle = self%turns
  end subroutine find_cycle

  !> Where bodies move on: a second turn from where they are then, which differs where their place matters.
  subroutine turn_again(self, run)
    class(cycle_state), intent(inout) :: self
    type(run_state), intent(inout) :: run
    type(turn_result) :: next
    if (.not. self%map%moves_on) return
    call make_turn(self, run, self%turn%end, self%turn%period, next)
    if (self%fail%happened()) return
    self%again = huge(1.0_wp)
    if (.not. next%lost) self%again = maxval(abs(self%map%change(next)))
  end subroutine turn_again

  !> A step from a turn, and the turn there. It takes the map for linear as the differences of the last turns show it; what these do
  !> not explain of the change is left to the turn, which damps it: the first step is a plain turn.
  subroutine step(self, run, space, now, failed)
    class(cycle_state), intent(inout) :: self
    type(run_state), intent(inout) :: run
    type(direction_space), intent(inout) :: space
    type(turn_result), intent(inout) :: now          !! that turn, and the next one, where it repeats better
    integer, intent(inout) :: failed                 !! steps in a row that did not lead there; twice where the turn was lost
    type(turn_result) :: next
    type(switch_event) :: event                      ! that only one of both has
    real(wp), dimension(size(self%map%compared)) :: r, rest, rates, v   ! [-]
    real(wp), allocatable :: c(:), slope(:)
    real(wp) :: longer                               ! change of the period, of it [-]
    r = self%map%change(now)
    rates = self%map%scaled(now%slope)*now%period
    slope = pack(rates, self%free_period)
    call space%fit(r, slope, c, rest)
    longer = 0.0_wp
    if (self%free_period) longer = max(-most_of_period, min(most_of_period, c(size(c))))
    rest = rest + matmul(space%v(:, :space%count), c(:space%count))
    call make_turn(self, run, self%map%moved(now%start, rest), now%period*(1 + longer), next)
    if (self%fail%happened()) return
    event = difference_of(now%events, next%events)
    if (event%element > 0) self%changed = event
    failed = failed + merge(2, 1, next%lost)
    if (next%lost) return
    v = self%map%scaled(next%start) - self%map%scaled(now%start)
    call space%learn(v, v + self%map%change(next) - r - rates*longer)
    if (norm2(self%map%change(next)) >= norm2(r)) return
    now = next
    failed = 0
  end subroutine step

  !> A central difference quotient along a direction, between turns from moved starts; that between one of them and the cycle where
  !> the other has other events.
  subroutine one_quotient(self, run, asked, v, w, second)
    class(cycle_state), intent(inout) :: self
    type(run_state), intent(inout) :: run
    real(wp), intent(in) :: asked(:)                 !! direction, of length 1 [-]
    real(wp), intent(out) :: v(:), w(:)              !! direction that was moved along, its image [-]
    real(wp), intent(out) :: second                  !! size of the second difference, over the difference [-]
    type(turn_result) :: side
    real(wp), dimension(size(asked), 2) :: from, to  ! [-]
    real(wp) :: h                                    ! [-]
    logical :: good(2)
    type(switch_event) :: changed
    integer :: k
    do k = 1, 2
      h = (3 - 2*k)*self%map%difference
      associate (base => self%turn)
        call make_turn(self, run, self%map%moved(base%start, h*asked), base%period, side, base%states)
        if (self%fail%happened()) return
        good(k) = .not. side%lost
        if (good(k)) changed = difference_of(base%events, side%events)
        good(k) = good(k) .and. changed%element == 0
        from(:, k) = (self%map%scaled(side%start) - self%map%scaled(base%start))/h
        to(:, k) = (self%map%scaled(side%end) - self%map%scaled(base%end))/h
      end associate
    end do
    second = 0.0_wp
    if (all(good)) second = norm2(to(:, 1) - to(:, 2))
    self%grazes = self%grazes .or. .not. any(good)
    if (.not. any(good)) self%changed = changed
    if (.not. any(good)) good(1) = .true.
    v = matmul(from, merge(1.0_wp, 0.0_wp, good))/count(good)
    w = matmul(to, merge(1.0_wp, 0.0_wp, good))/count(good)
  end subroutine one_quotient

  !> The first event that only one of two turns has, element by element; element 0: none.
  type(switch_event) function difference_of(a, b) result(event)
    type(event_list), intent(in) :: a, b
    type(switch_event), allocatable :: x(:), y(:)
    integer :: element, k
    associate (of_a => a%items(:a%count), of_b => b%items(:b%count))
      do element = 1, maxval([0, of_a%element, of_b%element])
        x = pack(of_a, of_a%element == element)
        y = pack(of_b, of_b%element == element)
        do k = 1, min(size(x), size(y))
          if (x(k)%to /= y(k)%to) exit
        end do
        if (k <= size(y)) event = y(k)
        if (k <= size(x)) event = x(k)
        if (event%element > 0) return
      end do
    end associate
  end function difference_of

  !> Arnoldi's method about the cycle, until the wanted multipliers are known to their goal or nothing is left to find.
  subroutine find_multipliers(self, run, number)
    class(cycle_state), intent(inout) :: self
    type(run_state), intent(inout) :: run
    integer, intent(in) :: number                    !! that are told
    real(wp), parameter :: negligible = 10.0_wp      ! a direction with so little in it is rounding, of that of quotients [-]
    real(wp), dimension(size(self%map%compared)) :: v, asked, w   ! [-]
    real(wp) :: second, seconds                      ! [-]
    complex(wp), allocatable :: before(:)            ! multipliers of half the steps [-]
    complex(wp), allocatable :: known(:)             ! the wanted ones, before a start anew [-]
    integer :: k, starts
    logical :: anew
    if (number == 0) return
    before = [complex(wp) ::]
    if (self%start_error >= 0.0_wp) before = self%pairs%value
    self%pairs%value = [complex(wp) ::]
    seconds = 0.0_wp
    call self%space%clear(size(v))
    starts = 0
    anew = .true.
    do
      if (anew) then                                 ! one start shows of a multiple one a single vector
        starts = starts + 1
        asked = self%map%tangent(self%turn, [(cos(starts*real(k, wp)**2), k=1, size(v))])   ! which excites all
        asked = self%space%rest_of(asked/max(norm2(asked), tiny(1.0_wp)))
      end if
      if (norm2(asked) <= negligible*self%map%noise) exit
      asked = asked/norm2(asked)
      call one_quotient(self, run, asked, v, w, second)
      if (self%fail%happened()) return
      k = self%space%count
      call self%space%add(v, w)
      if (self%space%count == k) exit                ! the joints allow no other direction
      seconds = max(seconds, second)
      call self%space%ritz(self%pairs)
      self%wanted = min(self%space%count, number + merge(1, 0, self%free_period))
      if (is_known(self%wanted + merge(1, 0, allocated(known)))) then   ! after a start anew with the next one: none is hidden
        associate (now => self%pairs%value(:self%wanted))
          anew = .not. allocated(known)
          if (.not. anew) anew = maxval(abs(now - known)) > sqrt(self%map%noise)
          if (.not. anew) exit
          known = now
        end associate
      else
        asked = self%space%rest_of(w)
        anew = norm2(asked) <= negligible*self%map%noise
      end if
      if (self%space%count >= size(v) .or. self%turns > self%most_turns + 1000) exit
    end do
    associate (p => self%pairs)
      self%wanted = min(self%wanted, count(abs(p%value) > 100*self%map%noise))
      self%error = [(p%condition(k)*(p%residual(k) + seconds**2 + self%map%noise), k=1, self%wanted)]
      do k = 1, merge(self%wanted, 0, size(before) > 0)
        self%error(k) = max(self%error(k), minval(abs(before - p%value(k))))
      end do
      asked = self%map%scaled(self%turn%slope)
      if (self%free_period) self%time = maxloc([(abs(dot_product(p%vector(:, k), cmplx(asked, 0.0_wp, wp))), k=1, self%wanted)], 1)
    end associate
  contains
    !> Whether so many of the largest are known, with the second one of a pair.
    pure logical function is_known(n) result(yes)
      integer, intent(in) :: n
      integer :: last
      associate (p => self%pairs)
        last = min(n, self%space%count)
        if (last < self%space%count .and. p%value(last)%im > 0.0_wp) last = last + 1
        yes = self%space%count > n .and. maxval(p%residual(:last)*p%condition(:last)) < self%map%noise
      end associate
    end function is_known
  end subroutine find_multipliers
end module cycle_search
