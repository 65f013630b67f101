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
  real(wp), parameter, public :: safety = 1.5_wp     !! on an error that is estimated, before it is told [-]
  integer, parameter :: most_failed = 2              !! steps in a row that lead farther away, each with one direction more

  !> A cycle that is sought, or found.
  type, public :: cycle_state
    type(period_map) :: map
    type(turn_result) :: turn                        !! in the search the turn that repeats best, then the cycle
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
    real(wp) :: again = 0.0_wp                       !! change in a second turn, or of what acts in it [-]
    real(wp) :: start_error = huge(1.0_wp)           !! of the start, of the scales, with safety; huge: not known [-]
    real(wp) :: period_error = huge(1.0_wp)          !! of a period that is sought; huge: not known [s]
    type(turn_result) :: other                       !! the cycle with other steps, which tells the errors
    real(wp) :: share = 0.0_wp                       !! of its difference that is told as the error; 0: there is no such cycle [-]
    type(direction_space) :: known                   !! differences of the turns of the search
    type(direction_space) :: space                   !! of the multipliers
    type(ritz_pairs) :: pairs
    real(wp), allocatable :: error(:)                !! (pairs) of the multipliers; huge: not known [-]
    integer :: wanted = 0                            !! pairs that were asked for, and found
    integer :: time = 0                              !! the pair that belongs to time, where the period is an unknown
    logical :: grazes = .false.                      !! events change on both sides of the cycle
  contains
    procedure :: find_cycle
    procedure :: go_on
    procedure :: shorten
    procedure :: rests
    procedure :: turn_again
    procedure :: find_multipliers
    procedure :: find_errors
  end type cycle_state

contains

  !> The next turn: that of a checkpoint, where it has it. Else, where the deck asks for checkpoints, it is kept in one.
  subroutine make_turn(self, run, x, period, turn, held, from)
    class(cycle_state), intent(inout) :: self
    type(run_state), intent(inout) :: run
    real(wp), intent(in) :: x(:)                     !! (ny) its start [m, rad], [m/s, rad/s], [J]
    real(wp), intent(in) :: period                   !! [s]
    type(turn_result), intent(out) :: turn
    integer, intent(in), optional :: held(:)         !! (elements that switch) states whose rows hold at the start
    real(wp), intent(in), optional :: from           !! time of the start; not given: 0 [s]
    type(value_archive) :: a
    real(wp) :: begins                               ! [s]
    integer :: signal
    logical :: ok
    begins = 0.0_wp
    if (present(from)) begins = from
    associate (log => run%turns, interval => run%d%transient%checkpoint_interval)
      log%saving = log%saving .or. log%complete()
      if (log%saving) then
        call self%map%march(x, begins, period, held, turn, signal)
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

  !> Steps until the motion repeats to the tolerance of its own ranges, and the next step would be no longer. A step that leads
  !> farther away is learned from and made anew; where that does so too often, plain turns follow, each time one more.
  subroutine find_cycle(self, run, go_on)
    class(cycle_state), intent(inout) :: self        !! in: start and period of its turn are those of the first one
    type(run_state), intent(inout) :: run
    logical, intent(in), optional :: go_on           !! with what is known of the map
    type(turn_result) :: now, before
    real(wp), allocatable :: scale(:), v(:)          ! before [m, rad], [m/s, rad/s]; [-]
    real(wp) :: change, ahead_of                     ! in a turn, by the next step [-]
    integer :: plain, ahead, failed                  ! plain turns the last time, still to come; as of `step`
    self%residual = huge(1.0_wp)
    self%found = .false.
    call make_turn(self, run, self%turn%start, self%turn%period, now)
    self%turn = now
    if (.not. present(go_on)) call self%known%clear(size(self%map%compared))
    plain = 0
    ahead = 0
    failed = 0
    do while (.not. (self%fail%happened() .or. now%lost))
      change = maxval(abs(self%map%change(now)))
      if (change < self%tolerance .and. .not. self%rests(now)) then
        scale = self%map%scale
        call self%map%find_scales(now)
        call self%known%rescale(scale/self%map%scale)
        self%residual = maxval(abs(self%map%change(self%turn)))
        change = maxval(abs(self%map%change(now)))
      end if
      if (change <= self%residual) self%turn = now
      self%residual = min(change, self%residual)
      ahead_of = 0.0_wp
      if (change < self%tolerance) ahead_of = maxval(abs(move_of(self, self%known, now)))
      self%found = self%residual < self%tolerance .and. (ahead_of < self%tolerance .or. failed >= most_failed)
      if (self%found .or. self%turns >= self%most_turns) exit
      if (ahead > 0) then                            ! on and on, as the machine runs alone
        ahead = ahead - 1
        before = now
        call make_turn(self, run, self%map%moved(now%start, self%map%change(now)), (now%period), now)
        if (self%fail%happened() .or. now%lost) cycle
        v = self%map%scaled(now%start) - self%map%scaled(before%start)
        call self%known%learn(v, v + self%map%change(now) - self%map%change(before))
        cycle
      end if
      call step(self, run, now, failed)
      if (failed < most_failed*(1 + plain)) cycle
      call self%known%clear(size(self%map%compared))
      failed = 0
      plain = plain + 1
      ahead = plain
    end do
    self%found = self%residual < self%tolerance .and. .not. self%fail%happened()
    self%turns_to_cycle = self%turns
  end subroutine find_cycle

  !> Whether nothing moves in a turn of a period that is sought.
  pure logical function rests(self, turn)
    class(cycle_state), intent(in) :: self
    type(turn_result), intent(in) :: turn
    rests = self%free_period
    if (rests) rests = maxval(abs(self%map%scaled(turn%slope)))*turn%period < sqrt(self%tolerance)
  end function rests

  !> Where the period was sought: the motion may repeat in a half, a third or a fifth of what was found.
  subroutine shorten(self, run)
    class(cycle_state), intent(inout) :: self        !! found
    type(run_state), intent(inout) :: run
    integer, parameter :: parts(3) = [2, 3, 5]
    type(cycle_state) :: whole
    type(turn_result) :: part
    integer :: k, steps
    if (.not. self%free_period .or. self%rests(self%turn)) return
    k = 1
    do while (k <= size(parts))
      steps = self%map%steps
      self%map%steps = (steps + parts(k) - 1)/parts(k)
      call make_turn(self, run, self%turn%start, self%turn%period/parts(k), part)
      if (self%fail%happened()) return
      if (.not. part%lost) then
        if (maxval(abs(self%map%change(part))) < sqrt(self%tolerance)) then
          whole%turn = self%turn
          self%turn = part
          call self%find_cycle(run)
          if (self%fail%happened()) return
          if (self%found .and. .not. self%rests(self%turn)) cycle
          self%turn = whole%turn
          self%found = .true.
        end if
      end if
      self%map%steps = steps
      k = k + 1
    end do
    self%residual = maxval(abs(self%map%change(self%turn)))
  end subroutine shorten

  !> A second turn from where the first one ends: it differs where the place of what moves on matters, where something winds up by
  !> whole turns of a body, or where a history goes on.
  subroutine turn_again(self, run)
    class(cycle_state), intent(inout) :: self
    type(run_state), intent(inout) :: run
    type(turn_result) :: next
    call make_turn(self, run, self%turn%end, self%turn%period, next, from=self%turn%period)
    if (self%fail%happened()) return
    self%again = huge(1.0_wp)
    if (next%lost) return
    self%again = max(maxval(abs(self%map%change(next))), self%map%change_of_work(self%turn, next, self%tolerance))
    if (size(self%pairs%value) > 0) self%again = self%again/max(1.0_wp, abs(self%pairs%value(1)))   ! what is left grows so
  end subroutine turn_again

  !> The move of the step from a turn [-]. It takes the map for linear as the differences of the last turns show it; what these do
  !> not explain of the change is left to the turn, which damps it: the first step is a plain turn.
  function move_of(self, space, now, longer) result(move)
    class(cycle_state), intent(in) :: self
    type(direction_space), intent(in) :: space
    type(turn_result), intent(in) :: now             !! that turn
    real(wp), intent(out), optional :: longer        !! change of the period, of it [-]
    real(wp), dimension(size(self%map%compared)) :: move, rates   ! [-]
    real(wp), allocatable :: c(:)
    rates = self%map%scaled(now%slope)*now%period
    call space%fit(self%map%change(now), pack(rates, self%free_period), c, move)
    move = move + matmul(space%v(:, :space%count), c(:space%count))
    if (.not. present(longer)) return
    longer = 0.0_wp
    if (self%free_period) longer = max(-most_of_period, min(most_of_period, c(size(c))))
  end function move_of

  !> A step from a turn, and the turn there.
  subroutine step(self, run, now, failed)
    class(cycle_state), intent(inout) :: self
    type(run_state), intent(inout) :: run
    type(turn_result), intent(inout) :: now          !! that turn, and the next one, where it repeats better
    integer, intent(inout) :: failed                 !! steps in a row that did not lead there; all where a turn was lost
    type(turn_result) :: next
    type(switch_event) :: event                      ! that only one of both has
    real(wp), dimension(size(self%map%compared)) :: r, move, v   ! [-]
    real(wp) :: longer                               ! change of the period, of it [-]
    r = self%map%change(now)
    move = move_of(self, self%known, now, longer)
    call make_turn(self, run, self%map%moved(now%start, move), now%period*(1 + longer), next)
    if (self%fail%happened()) return
    event = difference_of(now%events, next%events)
    if (event%element > 0) self%changed = event
    failed = failed + merge(most_failed, 1, next%lost)
    if (next%lost) return
    v = self%map%scaled(next%start) - self%map%scaled(now%start)
    call self%known%learn(v, v + self%map%change(next) - r - self%map%scaled(now%slope)*now%period*longer)
    if (norm2(self%map%change(next)) >= norm2(r)) return
    now = next
    failed = 0
  end subroutine step

  !> A central difference quotient along a direction, between turns from moved starts; that between one of them and the cycle where
  !> the other has other events.
  subroutine one_quotient(self, run, h, asked, v, w)
    class(cycle_state), intent(inout) :: self
    type(run_state), intent(inout) :: run
    real(wp), intent(in) :: h                        !! length of the moves [-]
    real(wp), intent(in) :: asked(:)                 !! direction, of length 1 [-]
    real(wp), intent(out) :: v(:), w(:)              !! direction that was moved along, its image [-]
    type(turn_result) :: side
    real(wp), dimension(size(asked), 2) :: from, to  ! [-]
    logical :: good(2)
    type(switch_event) :: changed
    integer :: k
    do k = 1, 2
      associate (base => self%turn, move => (3 - 2*k)*h)
        call make_turn(self, run, self%map%moved(base%start, move*asked), base%period, side, base%states)
        if (self%fail%happened()) return
        good(k) = .not. side%lost
        if (good(k)) changed = difference_of(base%events, side%events)
        good(k) = good(k) .and. changed%element == 0
        from(:, k) = (self%map%scaled(side%start) - self%map%scaled(base%start))/move
        to(:, k) = (self%map%scaled(side%end) - self%map%scaled(base%end))/move
      end associate
    end do
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

  !> Arnoldi's method about the cycle, until the wanted multipliers are known to rounding or nothing is left to find.
  subroutine find_multipliers(self, run, number)
    class(cycle_state), intent(inout) :: self
    type(run_state), intent(inout) :: run
    integer, intent(in) :: number                    !! that are told
    real(wp), parameter :: negligible = 10.0_wp      ! a direction with so little in it is rounding, of that of quotients [-]
    real(wp), parameter :: tiny_move = sqrt(epsilon(1.0_wp))   ! along it the map is a line but for rounding [-]
    real(wp), dimension(size(self%map%compared)) :: v, asked, w, twice   ! [-]
    complex(wp), allocatable :: known(:)             ! the wanted ones, before a start anew [-]
    logical :: complete                              ! nothing is left to find
    logical :: anew
    integer :: k, starts
    self%pairs%value = [complex(wp) ::]
    self%error = [real(wp) ::]
    self%wanted = 0
    self%time = 0
    call self%space%clear(size(v))
    if (number == 0) return
    starts = 0
    anew = .true.
    do
      if (anew) then                                 ! one start shows of a multiple one a single vector
        starts = starts + 1
        asked = self%map%tangent(self%turn, [(cos(starts*real(k, wp)**2), k=1, size(v))])   ! which excites all
        asked = self%space%rest_of(asked/max(norm2(asked), tiny(1.0_wp)))
      end if
      complete = norm2(asked) <= negligible*self%map%noise
      if (complete) exit
      asked = asked/norm2(asked)
      if (self%space%count == 0) then
        call one_quotient(self, run, tiny_move, asked, v, w)
        if (.not. self%fail%happened()) call one_quotient(self, run, 2*tiny_move, asked, v, twice)
        if (self%fail%happened()) return
        call self%map%find_rounding(4*tiny_move*abs(twice - w)/sqrt(10.0_wp))   ! ten: of ends that weigh 1, 1, 2 and 2
      end if
      call one_quotient(self, run, self%map%difference, asked, v, w)
      if (self%fail%happened()) return
      k = self%space%count
      call self%space%add(v, w)
      complete = self%space%count == k               ! the joints allow no other direction
      if (complete) exit
      call self%space%ritz(self%pairs)
      self%wanted = min(self%space%count, number + merge(1, 0, self%free_period))
      if (is_known(self%wanted + merge(1, 0, allocated(known)))) then   ! with the next one after a start anew
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
      complete = self%space%count >= size(v)
      if (complete .or. self%turns > self%most_turns + 1000) exit
    end do
    if (maxval(abs(move_of(self, self%space, self%turn))) >= self%tolerance) then   ! now that the map is known
      call search_beside(self, run)
      if (.not. self%found) return
    end if
    self%wanted = min(self%wanted, count(abs(self%pairs%value) > self%map%negligible))
    self%error = [(merge(0.0_wp, self%pairs%condition(k)*self%pairs%residual(k), complete), k=1, self%wanted)]
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

  !> Searches with the map as the multipliers have shown it, and its scales.
  subroutine search_beside(self, run)
    class(cycle_state), intent(inout) :: self
    type(run_state), intent(inout) :: run
    real(wp), allocatable :: scale(:)                ! [m, rad], [m/s, rad/s]
    scale = self%map%scale
    self%known = self%space
    call self%go_on(run)
    self%map%scale = scale
  end subroutine search_beside

  !> Searches on, with as many turns again.
  subroutine go_on(self, run)
    class(cycle_state), intent(inout) :: self
    type(run_state), intent(inout) :: run
    integer :: most
    most = self%most_turns
    self%most_turns = self%turns + most
    call self%find_cycle(run, go_on=.true.)
    self%most_turns = most
  end subroutine go_on

  !> Errors of start, period and multipliers, by another number of steps and other quotients along the vectors of the multipliers.
  !> The move of a quotient is changed so that its error, of order 2, grows by the same factor as that of the steps. What rounding
  !> does to a multiplier is added.
  subroutine find_errors(self, run)
    class(cycle_state), intent(inout) :: self        !! found, with its multipliers
    type(run_state), intent(inout) :: run
    type(turn_result) :: found
    complex(wp) :: value(self%wanted, 2)             ! multipliers, of these and of other steps [-]
    real(wp) :: residual, grown                      ! [-]
    integer :: steps, to_cycle, trial, k
    steps = self%map%steps
    to_cycle = self%turns_to_cycle
    found = self%turn
    residual = self%residual
    self%share = 0.0_wp
    call along_vectors(self%map%difference, value(:, 1))
    do trial = 1, 2
      self%map%steps = self%map%other_steps(fewer=trial == 1)
      grown = (real(steps, wp)/self%map%steps)**self%map%order
      self%turn = found
      call search_beside(self, run)
      if (self%fail%happened()) return
      if (self%found) exit
      self%map%steps = steps
    end do
    self%other = self%turn
    if (self%found) then
      self%share = safety/abs(grown - 1)
      self%start_error = self%share*maxval(abs(self%map%scaled(found%start) - self%map%scaled(self%other%start))) &
                         + maxval(abs(move_of(self, self%space, found)))
      self%period_error = self%share*abs(found%period - self%other%period)
      call along_vectors(self%map%difference*sqrt(grown), value(:, 2))
      self%error = self%error + self%share*abs(value(:, 1) - value(:, 2)) &
                   + [(safety*self%space%spread(self%pairs, k, self%map%rounding)/self%map%difference, k=1, self%wanted)]
      self%pairs%value(:self%wanted) = value(:, 1)
      do k = 1, self%wanted
        call spread_cluster(k)
      end do
    end if
    if (.not. self%found) self%error = huge(1.0_wp)
    self%turn = found
    self%residual = residual
    self%found = .not. self%fail%happened()
    self%turns_to_cycle = to_cycle
    self%map%steps = steps
    if (.not. self%free_period) return
    associate (p => self%pairs, n => self%wanted, along => cmplx(self%map%scaled(found%slope), 0.0_wp, wp))
      self%time = maxloc([(abs(dot_product(p%vector(:, k), along)), k=1, n)], 1, abs(p%value(:n) - 1) <= self%error .and. &
                         self%share > 0.0_wp)
    end associate
  contains
    !> The wanted multipliers to first order, by quotients along their vectors.
    subroutine along_vectors(h, value)
      real(wp), intent(in) :: h                      !! length of the moves [-]
      complex(wp), intent(out) :: value(:)           !! [-]
      real(wp), dimension(size(self%map%compared)) :: x, v, w   ! [-]
      complex(wp), dimension(size(self%map%compared)) :: moved, image   ! [-]
      complex(wp) :: part                            ! real or imaginary [-]
      integer :: k, i, before
      do k = 1, self%wanted
        before = max(1, k - 1)
        if (k > 1 .and. abs(self%pairs%value(k) - conjg(self%pairs%value(before))) <= 0.0_wp) then
          value(k) = conjg(value(before))
          cycle
        end if
        moved = 0.0_wp
        image = 0.0_wp
        do i = 1, 2
          x = merge(self%pairs%vector(:, k)%re, self%pairs%vector(:, k)%im, i == 1)
          part = merge((1.0_wp, 0.0_wp), (0.0_wp, 1.0_wp), i == 1)*norm2(x)
          if (norm2(x) <= 0.0_wp) cycle
          call one_quotient(self, run, h, x/norm2(x), v, w)
          if (self%fail%happened()) return
          moved = moved + part*v
          image = image + part*w
        end do
        value(k) = self%space%along(self%pairs, k, image)/self%space%along(self%pairs, k, moved)
      end do
    end subroutine along_vectors

    !> Where an error is not small against the distance of another multiplier, that is as likely as the one told.
    subroutine spread_cluster(k)
      integer, intent(in) :: k                       !! its number
      real(wp) :: nearest                            ! [-]
      integer :: i
      nearest = minval([huge(1.0_wp), (abs(self%pairs%value(i) - self%pairs%value(k)), i=1, k - 1), &
                        (abs(self%pairs%value(i) - self%pairs%value(k)), i=k + 1, size(self%pairs%value))])
      if (nearest < 4*self%error(k)) self%error(k) = self%error(k) + nearest/2
    end subroutine spread_cluster
  end subroutine find_errors
end module cycle_search
