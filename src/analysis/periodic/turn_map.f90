!> The map of one turn (theory.md, section 15): a start is put onto the manifold and marched over one period, in the same number of
!> steps each time, so that the map is smooth in its start and in the period. Events are located in each turn. Nothing is written.
module turn_map
  use kinds, only: wp, ip, pi
  use choose_stepper, only: make_stepper
  use controls, only: switch_on_controls
  use deck_records, only: transient_record
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
  use time_stepper, only: root_watch, stepper, paused, reached
  use turn_log, only: turn_result
  implicit none (type, external)
  private

  real(wp), parameter :: whole_turn = 2*pi           ! [rad]
  real(wp), parameter :: bins = 8.0_wp               ! of lengths of steps in a power of two [-]

  !> The map.
  type, public :: period_map
    class(mechanism_system), allocatable :: system    !! before any turn
    type(transient_record) :: r                      !! method and steps
    integer, allocatable :: compared(:)              !! numbers of the unknowns that repeat
    logical, allocatable :: turning(:)               !! (compared) angles of frames: they repeat up to whole turns
    logical :: moves_on = .false.                    !! some frames need not repeat
    real(wp), allocatable :: scale(:)                !! (compared) [m, rad], [m/s, rad/s]
    real(wp) :: noise = 0.0_wp                       !! rounding of the map, of the scales [-]
  contains
    procedure :: begin
    procedure :: march
    procedure :: set_scales
    procedure :: change
    procedure :: scaled
    procedure :: moved
    procedure :: put
    procedure :: columns_at
  end type period_map

contains

  !> Which unknowns repeat, and the system from which each turn starts. Controllers are switched on: their states are unknowns now.
  subroutine begin(self, run)
    class(period_map), intent(inout) :: self
    type(run_state), intent(inout) :: run
    logical, allocatable :: repeats(:), angle(:)
    integer :: b, k
    run%sys%options%stage = stage_transient
    if (allocated(self%system)) deallocate (self%system)
    allocate (self%system, source=run%sys)
    self%r = run%d%transient
    call choose_steps(self%r, run%stable_steps)
    self%noise = merge(1.0e-12_wp, 1.0e-10_wp, self%r%method /= 'radau')
    associate (s => self%system%m%s)
      self%system%has_manifold = s%rows > 0
      call switch_on_controls(self%system%m, self%system%ev, run%y(1:s%nq), run%y(s%nq + 1:2*s%nq), run%y(2*s%nq + 1:2*s%nq + s%nz))
      allocate (repeats(s%ny), angle(s%ny), source=.false.)
      repeats(1:2*s%nq + s%nz + s%nzd) = .true.
      self%moves_on = size(run%d%periodic%moves_on) > 0
      do k = 1, size(run%d%periodic%moves_on)
        b = s%qo(run%d%periodic%moves_on(k))
        repeats(b + 1:b + 3) = [.false., .false., any(run%d%periodic%angle_repeats == run%d%periodic%moves_on(k))]
      end do
      angle(s%qo + 3) = .true.
      do k = 1, size(s%controllers)               ! a sample at t = 0 computes its output anew
        if (s%controllers(k)%sampled > 0) repeats(2*s%nq + s%controllers(k)%first + s%controllers(k)%sampled) = .false.
      end do
      self%compared = pack([(k, k=1, s%ny)], repeats)
      self%turning = pack(angle, repeats)
    end associate
  end subroutine begin

  !> Method and steps of the first turn, where the deck asks for an accuracy: those of a first pass (theory.md, section 12).
  subroutine choose_steps(r, stable_steps)
    type(transient_record), intent(inout) :: r
    real(wp), intent(in) :: stable_steps(:)          !! of explicit methods [s]
    integer :: k
    if (.not. r%accuracy > 0.0_wp) return
    if (r%free_method) r%method = merge('radau ', 'dopri5', any(stable_steps < huge(1.0_wp)))
    r%tolerance = r%accuracy/10
    k = method_number(r%method)
    r%adaptive = r%method /= 'rk4'
    if (k > 0 .and. .not. r%adaptive) r%step = min(r%output_step, stable_steps(k))
  end subroutine choose_steps

  !> A turn. The first one, where the deck gives a tolerance, takes its steps by that and says how many equal ones are as fine.
  subroutine march(self, x, period, first, held, turn, signal)
    class(period_map), intent(in) :: self
    real(wp), intent(in) :: x(:)                     !! (ny) the start [m, rad], [m/s, rad/s], [J]
    real(wp), intent(in) :: period                   !! [s]
    logical, intent(in) :: first
    integer, intent(in) :: held(:)                   !! (elements that switch, or none) states whose rows hold at the start
    type(turn_result), intent(inout) :: turn         !! on entry its number of steps, after the first
    integer, intent(out) :: signal                   !! that came; 0: none
    class(mechanism_system), allocatable :: system
    class(stepper), allocatable :: method
    type(transient_record) :: r
    real(wp), dimension(size(x)) :: y, low, high     ! [m, rad], [m/s, rad/s], [J]
    real(wp) :: passed(0:240)                        ! of the period, by the length of steps [-]
    real(wp) :: before                               ! [s]
    integer :: outcome, portion, k
    logical :: ok
    allocate (system, source=self%system)
    r = self%r
    r%t_end = period
    r%output_step = period
    if (first .and. .not. r%adaptive) turn%steps = int(step_count(0.0_wp, period, actual_step(self%r%output_step, r%step)))
    r%adaptive = first .and. r%adaptive
    if (.not. r%adaptive) r%step = period/turn%steps
    system%output_step = period
    y = x
    call self%put(system, y, held, ok)
    turn%start = y
    if (ok) call system%start_switching(0.0_wp, y, given=.true.)
    turn%states = system%ev%switches%state
    call make_stepper(r, system%m%s, 0.0_wp, method)
    call method%begin(system, 0.0_wp, y)
    portion = 64
    if (first) portion = max(1, min(64, turn%steps/100))
    if (r%adaptive) portion = 1
    low = y
    high = y
    passed = 0.0_wp
    signal = 0
    outcome = paused
    do while (ok .and. outcome == paused)
      before = method%t
      call method%advance(system, 0.0_wp, period, portion, y, outcome)
      low = min(low, method%y)
      high = max(high, method%y)
      if (r%adaptive .and. method%t > before) call note_step(passed, (method%t - before)/period)
      signal = caught_signal()
      if (signal > 0) exit
    end do
    turn%lost = outcome /= reached
    turn%at = method%tried
    turn%end = y
    turn%slope = y
    call system%derivative(period, y, .true., turn%slope)
    turn%events = system%events
    turn%remembers = findloc([(remembers(system, k), k=1, system%m%s%stops)], .true., 1)
    turn%range = [real(wp) ::]
    if (first) turn%range = high - low
    if (r%adaptive) turn%steps = as_fine(passed)
    method%roots = root_watch()                      ! gfortran 12 frees the first of two components of one type alone
  end subroutine march

  !> Columns of sensors at t = 0 from a start.
  function columns_at(self, run, start) result(values)
    class(period_map), intent(in) :: self
    type(run_state), intent(inout) :: run
    real(wp), intent(in) :: start(:)                 !! (ny) [m, rad], [m/s, rad/s], [J]
    real(wp) :: values(run%list%columns)             ! [of the column]
    class(mechanism_system), allocatable :: system
    real(wp), dimension(size(start)) :: y, slope     ! [m, rad], [m/s, rad/s], [J], and per second
    logical :: ok
    allocate (system, source=self%system)
    y = start
    call self%put(system, y, [integer ::], ok)
    call system%start_switching(0.0_wp, y, given=.true.)
    call system%derivative(0.0_wp, y, .false., slope)
    call read_sensors(run%list, system%m, system%ev, y, values)
  end function columns_at

  !> Whether a stop touches whose force depends on the speed at touching, which the state does not tell.
  logical function remembers(system, i) result(yes)
    type(mechanism_system), intent(in) :: system
    integer, intent(in) :: i                         !! the stop's number among the elements that switch
    yes = .false.
    associate (s => system%m%s)
      select type (stop => s%forces(s%switching(i))%item)
      class is (stop_model)
        yes = stop%rebound > 0.0_wp .and. system%ev%switches%state(i) /= stop_open
      end select
    end associate
  end function remembers

  !> Puts a start onto the joints, and onto the rows that hold in given states: what is at rest at the start of a cycle is so beside
  !> it, too.
  subroutine put(self, system, y, held, ok)
    class(period_map), intent(in) :: self
    type(mechanism_system), intent(inout) :: system
    real(wp), intent(inout) :: y(:)                  !! (ny) [m, rad], [m/s, rad/s], [J]
    integer, intent(in) :: held(:)                   !! (elements that switch, or none) such states
    logical, intent(out) :: ok
    real(wp) :: slope(size(y))                       ! [the same per second]
    integer, allocatable :: states(:)
    integer :: k
    associate (s => system%m%s)
      y(2*s%nq + s%nz + s%nzd + 1:) = 0.0_wp
    end associate
    call system%evaluate_on_manifold(0.0_wp, y, .false., slope, ok)
    if (size(held) == 0) return
    states = system%ev%switches%state
    do k = system%m%s%permanent + 1, size(system%m%s%constraints)
      associate (row => system%m%s%constraints(k)%item, x => system%ev%switches)
        if (.not. row%holds(held(row%switch_number))) cycle
        x%state(row%switch_number) = held(row%switch_number)
        x%event_value(row%switch_number) = row%place(system%ev%p, sign(1, held(row%switch_number)))
      end associate
    end do
    if (any(system%ev%switches%state /= states)) then
      system%has_manifold = .true.
      call system%evaluate_on_manifold(0.0_wp, y, .false., slope, ok)
      system%has_manifold = self%system%has_manifold
    end if
    system%ev%switches%state = states
  end subroutine put

  !> Notes the time that a step takes among steps of its length, in eighths of a power of two of the period.
  pure subroutine note_step(passed, h)
    real(wp), intent(inout) :: passed(0:)            !! of the period [-]
    real(wp), intent(in) :: h                        !! of the period [-]
    associate (k => min(ubound(passed, 1), max(0, floor(-bins*log(h)/log(2.0_wp)))))
      passed(k) = passed(k) + h
    end associate
  end subroutine note_step

  !> So many equal steps are as fine as those that pass the first tenth of the time, the shortest first.
  pure integer function as_fine(passed) result(steps)
    real(wp), intent(in) :: passed(0:)               !! of the period [-]
    integer :: k
    do k = ubound(passed, 1), 1, -1
      if (sum(passed(k:)) > 0.1_wp*sum(passed)) exit
    end do
    steps = ceiling(2.0_wp**((k + 1)/bins))
  end function as_fine

  !> Scales of the unknowns: the range of the largest in the group of each, at least a thousandth of the largest group of its kind;
  !> where nothing of that kind moves, a thousandth of the scene's size. Angles have at most a radian.
  subroutine set_scales(self, range, period)
    class(period_map), intent(inout) :: self
    real(wp), intent(in) :: range(:)                 !! (ny) in the first turn [m, rad], [m/s, rad/s], [J]
    real(wp), intent(in) :: period                   !! [s]
    integer, parameter :: kinds_of_group = 12        ! of a body, rates included
    real(wp), parameter :: least = 1.0e-3_wp         ! of the largest of a kind, or of the scene's size [-]
    type(error_norm) :: norm
    real(wp), allocatable :: of_group(:)             ! [m, rad], [m/s, rad/s]
    real(wp) :: largest, still                       ! of a kind; so little is rest [m, rad], [m/s, rad/s]
    integer, allocatable :: kind(:)                  ! of each group
    integer :: g, k
    call group_unknowns(self%system%m%s, norm)
    allocate (of_group(size(norm%floor)), source=0.0_wp)
    do k = 1, size(self%compared)
      associate (x => of_group(norm%group(self%compared(k))))
        x = max(x, range(self%compared(k)))
      end associate
    end do
    kind = [(g, g=1, size(of_group))]
    associate (n => kinds_of_group*size(self%system%m%s%bodies))
      kind(:n) = 1 + mod(kind(:n) - 1, kinds_of_group)
    end associate
    do g = 1, size(of_group)
      largest = maxval(of_group, kind == kind(g))
      still = norm%floor(g)
      if (norm%rate(g)) still = still*whole_turn/period
      norm%scale(g) = max(of_group(g), least*largest)
      if (largest <= still) norm%scale(g) = least/least_scale*still
    end do
    self%scale = norm%scale(norm%group(self%compared))
    where (self%turning) self%scale = min(self%scale, 1.0_wp)
  end subroutine set_scales

  !> What has changed between the start and the end of a turn, less whole turns, over the scales.
  pure function change(self, turn) result(r)
    class(period_map), intent(in) :: self
    type(turn_result), intent(in) :: turn
    real(wp) :: r(size(self%compared))               ! [-]
    r = turn%end(self%compared) - turn%start(self%compared)
    where (self%turning) r = r - whole_turn*anint(r/whole_turn)
    r = r/self%scale
  end function change

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
