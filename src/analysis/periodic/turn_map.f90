!> The map of one turn (theory.md, section 15): a start is put onto the manifold and marched over one period, in the same number of
!> steps each time, so that the map is smooth in its start and in the period. Events are located in each turn. Nothing is written.
module turn_map
  use kinds, only: wp, pi
  use choose_stepper, only: make_stepper, method_order
  use controls, only: switch_on_controls
  use deck_records, only: transient_record
  use energy, only: energies
  use error_groups, only: group_unknowns
  use force_element, only: stage_transient
  use mechanism_ode, only: mechanism_system
  use posix, only: caught_signal
  use scene_run, only: run_state
  use sensors, only: read_sensors
  use step_control, only: error_norm, least_scale
  use step_monitor, only: method_number
  use step_counts, only: actual_step, step_count
  use stops, only: stop_model, stop_open
  use stored_pass, only: least_range
  use time_stepper, only: root_watch, stepper, paused, reached
  use turn_log, only: turn_result
  implicit none (type, external)
  private

  real(wp), parameter :: whole_turn = 2*pi           ! [rad]
  real(wp), parameter :: least_share = 0.03_wp       ! least scale, of the largest of its kind: smaller moves are rounding [-]
  integer, parameter :: looks = 64                   ! at a turn, at least, for its ranges

  !> The map.
  type, public :: period_map
    class(mechanism_system), allocatable :: system   !! before any turn
    type(transient_record) :: r                      !! method and steps
    integer :: steps = 0                             !! of a turn; 0: the first one tells
    integer, allocatable :: compared(:)              !! numbers of the unknowns that repeat
    logical, allocatable :: turning(:)               !! (compared) angles of frames: they repeat up to whole turns
    logical :: moves_on = .false.                    !! some frames need not repeat
    real(wp), allocatable :: scale(:)                !! (compared) [m, rad], [m/s, rad/s]
    real(wp) :: difference = 0.0_wp                  !! of a central quotient, whose errors are least there, of the scales [-]
    real(wp) :: noise = 0.0_wp                       !! what rounding of the map makes of such a quotient [-]
    real(wp), allocatable :: rounding(:)             !! (compared) of the map, of the scales [-]
    integer :: order = 1                             !! of the method
    real(wp) :: negligible = 1.0e-6_wp               !! a multiplier so small is none [-]
  contains
    procedure :: begin
    procedure :: march
    procedure :: divide
    procedure :: find_scales
    procedure :: find_rounding
    procedure :: other_steps
    procedure :: change
    procedure :: change_of_work
    procedure :: scaled
    procedure :: moved
    procedure :: tangent
    procedure :: columns_after
  end type period_map

contains

  !> Which unknowns repeat, and the system from which each turn starts. Controllers are switched on: their states are unknowns now.
  !> Where the deck asks for an accuracy, method and steps are those of a first pass (theory.md, section 12).
  subroutine begin(self, run)
    class(period_map), intent(inout) :: self
    type(run_state), intent(inout) :: run
    logical, allocatable :: repeats(:), angle(:)
    integer :: k
    run%sys%options%stage = stage_transient
    if (allocated(self%system)) deallocate (self%system)
    allocate (self%system, source=run%sys)
    self%r = run%d%transient
    associate (r => self%r, bounds => run%stable_steps)
      if (r%accuracy > 0.0_wp) then
        if (r%free_method) r%method = merge('radau ', 'dopri5', any(bounds < huge(1.0_wp)))
        r%tolerance = r%accuracy/10
        r%adaptive = r%method /= 'rk4'
        if (.not. r%adaptive) r%step = min(r%output_step, bounds(method_number(r%method)))
      end if
      self%order = method_order(r%method)
      self%negligible = merge(1.0e-6_wp, 2.0e-5_wp, r%method /= 'radau')
    end associate
    associate (s => self%system%m%s, p => run%d%periodic)
      self%system%has_manifold = s%rows > 0
      call switch_on_controls(self%system%m, self%system%ev, run%y(1:s%nq), run%y(s%nq + 1:2*s%nq), run%y(2*s%nq + 1:2*s%nq + s%nz))
      allocate (repeats(s%ny), angle(s%ny), source=.false.)
      repeats(1:2*s%nq + s%nz + s%nzd) = .true.
      angle(s%qo + 3) = .true.
      self%moves_on = size(p%moves_on) > 0
      do k = 1, size(p%moves_on)
        repeats(s%qo(p%moves_on(k)) + 1:s%qo(p%moves_on(k)) + 3) = [.false., .false., any(p%angle_repeats == p%moves_on(k))]
      end do
      do k = 1, size(s%controllers)                  ! a sample at t = 0 computes its output anew
        if (s%controllers(k)%sampled > 0) repeats(2*s%nq + s%controllers(k)%first + s%controllers(k)%sampled) = .false.
      end do
      self%compared = pack([(k, k=1, s%ny)], repeats)
      self%turning = pack(angle, repeats)
      call self%find_rounding([(0.0_wp, k=1, size(self%compared))])
    end associate
  end subroutine begin

  !> A turn. The first one, where the deck gives a tolerance, takes its steps by that; as many equal ones are as fine as those of
  !> the tenth of the period that takes most.
  subroutine march(self, x, from, period, held, turn, signal)
    class(period_map), intent(in) :: self
    real(wp), intent(in) :: x(:)                     !! (ny) the start [m, rad], [m/s, rad/s], [J]
    real(wp), intent(in) :: from                     !! its time [s]
    real(wp), intent(in) :: period                   !! [s]
    integer, intent(in), optional :: held(:)         !! (elements that switch) states whose rows hold at the start
    type(turn_result), intent(inout) :: turn
    integer, intent(out) :: signal                   !! that came; 0: none
    class(mechanism_system), allocatable :: system
    class(stepper), allocatable :: method
    type(transient_record) :: r
    real(wp), dimension(size(x)) :: y, low, high     ! [m, rad], [m/s, rad/s], [J]
    real(wp) :: potential, strain(size(self%system%m%s%bodies))   ! [J]
    integer :: outcome, in_tenth(10), k
    logical :: ok, first
    first = self%steps == 0
    r = self%r
    r%t_end = from + period
    r%output_step = period
    r%adaptive = first .and. r%adaptive
    turn%period = period
    turn%steps = self%steps
    if (first .and. .not. r%adaptive) turn%steps = int(step_count(0.0_wp, period, actual_step(self%r%output_step, r%step)))
    if (.not. r%adaptive) r%step = period/turn%steps
    y = x
    call start(self, y, from, period, held, system, ok)
    turn%start = y
    if (ok) call system%start_switching(from, y, given=.true.)
    turn%states = system%ev%switches%state
    call make_stepper(r, system%m%s, 0.0_wp, method)
    call method%begin(system, from, y)
    low = y
    high = y
    in_tenth = 0
    signal = 0
    outcome = paused
    do while (ok .and. outcome == paused)
      call method%advance(system, from, from + period, merge(1, max(1, self%steps/looks), first), y, outcome)
      low = min(low, method%y)
      high = max(high, method%y)
      k = min(10, 1 + int(10*(method%t - from)/period))
      in_tenth(k) = in_tenth(k) + 1
      signal = caught_signal()
      if (signal > 0) exit
    end do
    if (r%adaptive) turn%steps = 10*maxval(in_tenth)
    turn%lost = outcome /= reached
    turn%at = method%tried
    turn%end = y
    turn%slope = y
    call system%derivative(from + period, y, .true., turn%slope)
    turn%events = system%events
    do k = 1, system%m%s%stops
      select type (stop => system%m%s%forces(system%m%s%switching(k))%item)
      class is (stop_model)                          ! its force depends on the speed at touching, which the state does not tell
        if (stop%rebound > 0.0_wp .and. system%ev%switches%state(k) /= stop_open) turn%remembers = k
      end select
    end do
    turn%range = high - low
    associate (s => system%m%s)
      call energies(system%m, system%ev, y(:s%nq), y(s%nq + 1:2*s%nq), y(2*s%nq + 1:2*s%nq + s%nz), &
                    y(2*s%nq + s%nz + 1:2*s%nq + s%nz + s%nzd), turn%kinetic, potential, strain)
    end associate
    method%roots = root_watch()                      ! gfortran 12 frees the first of two components of one type alone
  end subroutine march

  !> A system at a start, put onto the joints, and onto the rows that hold in given states: what is at rest at the start of a cycle
  !> is so beside it, too.
  subroutine start(self, y, from, period, held, system, ok)
    class(period_map), intent(in) :: self
    real(wp), intent(inout) :: y(:)                  !! (ny) [m, rad], [m/s, rad/s], [J]
    real(wp), intent(in) :: from                     !! its time [s]
    real(wp), intent(in) :: period                   !! [s]
    integer, intent(in), optional :: held(:)         !! (elements that switch) such states
    class(mechanism_system), allocatable, intent(out) :: system
    logical, intent(out) :: ok
    real(wp) :: slope(size(y))                       ! [the same per second]
    integer, allocatable :: states(:)
    integer :: k
    allocate (system, source=self%system)
    system%output_step = period
    associate (s => system%m%s, x => system%ev%switches)
      y(2*s%nq + s%nz + s%nzd + 1:) = 0.0_wp
      call system%evaluate_on_manifold(from, y, .false., slope, ok)
      if (present(held)) then
        states = x%state
        do k = s%permanent + 1, size(s%constraints)
          associate (row => s%constraints(k)%item, i => s%constraints(k)%item%switch_number)
            if (.not. row%holds(held(i))) cycle
            x%state(i) = held(i)
            x%event_value(i) = row%place(system%ev%p, sign(1, held(i)))
          end associate
        end do
        system%has_manifold = .true.
        if (any(x%state /= states)) call system%evaluate_on_manifold(from, y, .false., slope, ok)
        system%has_manifold = self%system%has_manifold
        x%state = states
      end if
    end associate
  end subroutine start

  !> What of a move from the start of a turn the joints and resting rows allow, by a small part of it.
  function tangent(self, turn, x) result(allowed)
    class(period_map), intent(in) :: self
    type(turn_result), intent(in) :: turn
    real(wp), intent(in) :: x(:)                     !! (compared) [-]
    real(wp) :: allowed(size(x)), y(size(turn%start)), h   ! [-]; [m, rad], [m/s, rad/s], [J]; [-]
    class(mechanism_system), allocatable :: system
    logical :: ok
    h = self%difference/max(norm2(x), tiny(1.0_wp))
    y = self%moved(turn%start, h*x)
    call start(self, y, 0.0_wp, turn%period, turn%states, system, ok)
    allowed = (self%scaled(y) - self%scaled(turn%start))/h
  end function tangent

  !> Columns of sensors at the start of a turn that goes on from a turn's end.
  function columns_after(self, run, turn) result(values)
    class(period_map), intent(in) :: self
    type(run_state), intent(inout) :: run
    type(turn_result), intent(in) :: turn
    real(wp) :: values(run%list%columns)             ! [of the column]
    class(mechanism_system), allocatable :: system
    real(wp), dimension(size(turn%start)) :: y, slope   ! [m, rad], [m/s, rad/s], [J], and per second
    logical :: ok
    y = self%moved(turn%start, self%change(turn))
    call start(self, y, 0.0_wp, turn%period, system=system, ok=ok)
    call system%start_switching(0.0_wp, y, given=.true.)
    call system%derivative(0.0_wp, y, .false., slope)
    call read_sensors(run%list, system%m, system%ev, y, values)
  end function columns_after

  !> Steps and scales by the first turn.
  subroutine divide(self, turn)
    class(period_map), intent(inout) :: self
    type(turn_result), intent(in) :: turn
    self%steps = turn%steps
    if (.not. turn%lost) call self%find_scales(turn)
  end subroutine divide

  !> Scales by a turn. An unknown's scale is the range of the largest in its group, at least a thirtieth of the
  !> largest group of its kind; where nothing of that kind moves, a thousandth of the scene's size. Angles have at most a radian,
  !> rates at least what a vibration of the values' scale has at the frequency of the cycle: those of a steady turn rest.
  subroutine find_scales(self, turn)
    class(period_map), intent(inout) :: self
    type(turn_result), intent(in) :: turn
    integer, parameter :: kinds_of_group = 12, angle = 3   ! of a body, rates included; that of its frame's angle
    type(error_norm) :: norm
    real(wp) :: range(size(turn%start)), largest, still   ! largest of a kind; so little is rest [m, rad], [m/s, rad/s]
    integer :: g, n
    call group_unknowns(self%system%m%s, norm)
    range = 0.0_wp
    range(self%compared) = turn%range(self%compared)
    call norm%watch(range)
    n = kinds_of_group*size(self%system%m%s%bodies)
    do g = 1, size(norm%largest)
      largest = norm%largest(g)
      if (g <= n) largest = maxval(norm%largest(1 + mod(g - 1, kinds_of_group):n:kinds_of_group))
      still = norm%floor(g)
      if (norm%rate(g)) still = still*whole_turn/turn%period
      norm%scale(g) = max(norm%largest(g), least_share*largest)
      if (largest <= still) norm%scale(g) = least_range/least_scale*still
      if (g <= n .and. mod(g, kinds_of_group) == angle) norm%scale(g) = min(norm%scale(g), 1.0_wp)
      if (norm%rate(g)) norm%scale(g) = max(norm%scale(g), norm%scale(g - 1)*whole_turn/turn%period)
    end do
    self%scale = norm%scale(norm%group(self%compared))
  end subroutine find_scales

  !> Rounding of the map, by what it makes of changes that are next to none; of it the quotient whose errors are least.
  subroutine find_rounding(self, seen)
    class(period_map), intent(inout) :: self
    real(wp), intent(in) :: seen(:)                  !! (compared) [-]
    real(wp) :: largest                              ! [-]
    self%rounding = max(seen, epsilon(1.0_wp))
    largest = maxval(self%rounding)
    self%difference = largest**(1.0_wp/3)
    self%noise = largest/self%difference
  end subroutine find_rounding

  !> Another number of steps, which tells the errors of the present one: a quarter fewer, or a third more.
  pure integer function other_steps(self, fewer) result(steps)
    class(period_map), intent(in) :: self
    logical, intent(in) :: fewer
    steps = self%steps + max(1, self%steps/3)
    if (fewer .and. self%steps > 1) steps = self%steps - max(1, self%steps/4)
  end function other_steps

  !> What has changed between the start and the end of a turn, less whole turns, over the scales.
  pure function change(self, turn) result(r)
    class(period_map), intent(in) :: self
    type(turn_result), intent(in) :: turn
    real(wp) :: r(size(self%compared))               ! [-]
    r = turn%end(self%compared) - turn%start(self%compared)
    where (self%turning) r = r - whole_turn*anint(r/whole_turn)
    r = r/self%scale
  end function change

  !> What a turn does otherwise than the one before it: work of loads and drives, losses, all that is integrated. It is compared
  !> with the largest of them, and with what the tolerance lets the kinetic energy change.
  pure real(wp) function change_of_work(self, before, turn, tolerance) result(r)   ! [-]
    class(period_map), intent(in) :: self
    type(turn_result), intent(in) :: before, turn
    real(wp), intent(in) :: tolerance                !! of a cycle [-]
    integer :: first
    associate (s => self%system%m%s)
      first = 2*s%nq + s%nz + s%nzd + 1
    end associate
    r = maxval(abs(turn%end(first:) - before%end(first:))) &
        /max(maxval(before%range(first:)), tolerance**0.25_wp*before%kinetic, tiny(1.0_wp))
  end function change_of_work

  !> Unknowns that repeat, over their scales.
  pure function scaled(self, y) result(x)
    class(period_map), intent(in) :: self
    real(wp), intent(in) :: y(:)                     !! (ny) [m, rad], [m/s, rad/s], [J]
    real(wp) :: x(size(self%compared))               ! [-]
    x = y(self%compared)/self%scale
  end function scaled

  !> A state moved by a multiple of a direction.
  pure function moved(self, y, x) result(other)
    class(period_map), intent(in) :: self
    real(wp), intent(in) :: y(:)                     !! (ny) [m, rad], [m/s, rad/s], [J]
    real(wp), intent(in) :: x(:)                     !! (compared) [-]
    real(wp) :: other(size(y))                       ! [m, rad], [m/s, rad/s], [J]
    other = y
    other(self%compared) = y(self%compared) + self%scale*x
  end function moved
end module turn_map
