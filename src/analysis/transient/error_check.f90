!> Estimated errors of sensor columns (check_error=.true.): a second run of the same model with half the step, or a tenth of
!> the tolerance, goes beside the first, row by row. It is the more accurate one, so that the difference is the error of the
!> first run, but for a share that the method's order tells (Richardson). Twice the step would cost less and tell less: it
!> is unstable above half of the stable bound, and where vibrations are not resolved the order says nothing. Both runs share
!> times of rows, signals, checkpoints; the first run is the same, to the last bit, with the second one and without.
!>
!> A pass of a search (accuracy=...) is compared with the stored rows of another pass instead, in the same way.
module error_check
  use kinds, only: wp, ip
  use archive, only: value_archive
  use choose_stepper, only: make_stepper, method_order
  use deck_records, only: transient_record
  use energy_balance, only: balance_watch
  use mechanism_ode, only: mechanism_system
  use sensors, only: sensor_list, read_sensors
  use step_counts, only: actual_step
  use switching, only: event_list, switch_event
  use time_stepper, only: stepper, reached, diverged
  implicit none (type, external)
  private

  real(wp), parameter, public :: tighter = 0.1_wp   !! tolerance of the second run, or pass, of the first one's [-]
  real(wp), parameter :: controlled = 4.0_wp/3.0_wp  !! error over difference: errors fall to a tenth or a fifth with it [-]

  !> The second run and what it has shown.
  type, public :: error_watch
    logical :: active = .false.
    logical :: stored = .false.               !! the other run is a pass before this one
    class(mechanism_system), allocatable :: sys
    class(stepper), allocatable :: method
    type(balance_watch) :: balance
    real(wp), allocatable :: y(:)             !! (ny) state at its last row [m, rad], [m/s, rad/s], [J]
    real(wp), allocatable :: values(:)        !! (columns) of that row [of the column]
    real(wp), allocatable :: error(:)         !! (columns) largest difference so far [of the column]
    real(wp) :: error_ratio = 1.0_wp               !! error of the first run over the difference [-]
    integer(ip) :: done = -1                  !! rows done after that of t = 0
    real(wp) :: diverged_at = -1.0_wp         !! time at which the second run diverged, < 0: it is not [s]
    type(event_list) :: waiting               !! events of the first run that the second one has not had yet
    type(event_list) :: others                !! events of the second run that the first one has not had yet
    integer(ip) :: matched = 0                !! events of both runs
    real(wp) :: event_error = 0.0_wp          !! largest difference of their times [s]
    real(wp) :: differ_at = -1.0_wp           !! time from which the events of both runs differ, < 0: they do not [s]
    real(wp), allocatable :: agreed(:)        !! (columns) largest difference before that time [of the column]
    logical, private :: between = .false.     !! the present row lies between an event of one run and that of the other
  contains
    procedure :: begin
    procedure :: begin_stored
    procedure :: start
    procedure :: behind
    procedure :: advance
    procedure :: match_events
    procedure :: compare
    procedure :: exchange
  end type error_watch

contains

  !> A second run from the state in which the first one starts.
  subroutine begin(self, sys, r, fastest, stable, y, columns)
    class(error_watch), intent(inout) :: self
    class(mechanism_system), intent(in) :: sys
    type(transient_record), intent(in) :: r
    real(wp), intent(in) :: fastest           !! largest frequency of the scene, where it is known [rad/s]
    real(wp), intent(in) :: stable            !! safe bound of the step of an explicit method [s]
    real(wp), intent(in) :: y(:)              !! (ny) [m, rad], [m/s, rad/s], [J]
    integer, intent(in) :: columns            !! of all sensors
    type(transient_record) :: finer
    finer = r
    finer%first_step = r%first_step/2
    finer%max_step = r%max_step/2
    if (r%adaptive) then
      finer%tolerance = tighter*r%tolerance
      if (stable < huge(stable)) then         ! steps that stability limits are as long whatever the tolerance
        finer%max_step = stable/2
        if (r%max_step > 0.0_wp) finer%max_step = min(r%max_step, stable)/2
      end if
      self%error_ratio = controlled
    else
      finer%step = actual_step(r%output_step, r%step)/2
      self%error_ratio = 1.0_wp/(1.0_wp - 0.5_wp**method_order(r%method))
    end if
    self%active = .true.
    allocate (self%sys, source=sys)
    self%sys%ev%evaluations = 0
    call make_stepper(finer, sys%m%s, fastest, self%method)
    self%y = y
    allocate (self%values(columns), self%error(columns), self%agreed(columns), source=0.0_wp)
    call self%method%begin(self%sys, 0.0_wp, y)
    call self%balance%begin(self%sys%m, r%t_end)
  end subroutine begin

  !> A pass is compared with the rows of another one.
  pure subroutine begin_stored(self, columns)
    class(error_watch), intent(inout) :: self
    integer, intent(in) :: columns
    self%active = .true.
    self%stored = .true.
    allocate (self%values(columns), self%error(columns), self%agreed(columns), source=0.0_wp)
  end subroutine begin_stored

  !> The row of t = 0, which both runs share.
  subroutine start(self, values, balance)
    class(error_watch), intent(inout) :: self
    real(wp), intent(in) :: values(:)         !! (columns) [of the column]
    type(balance_watch), intent(in) :: balance
    self%values = values
    self%balance = balance
    self%done = 0
  end subroutine start

  !> Whether the second run has yet to reach a row.
  pure function behind(self, row) result(yes)
    class(error_watch), intent(in) :: self
    integer(ip), intent(in) :: row
    logical :: yes
    yes = self%active .and. .not. self%stored .and. self%diverged_at < 0.0_wp .and. self%done < row
  end function behind

  !> A few steps of the second run towards its next row.
  subroutine advance(self, list, from, to, most)
    class(error_watch), intent(inout) :: self
    type(sensor_list), intent(inout) :: list
    real(wp), intent(in) :: from, to          !! last and next row [s]
    integer, intent(in) :: most               !! steps
    integer :: outcome, k
    call self%method%advance(self%sys, from, to, most, self%y, outcome)
    if (outcome == diverged) self%diverged_at = self%method%tried
    if (outcome /= reached) return
    do k = 1, self%sys%events%count
      call self%others%add(self%sys%events%items(k))
    end do
    self%sys%events%count = 0
    associate (m => self%sys%m, ev => self%sys%ev)
      call read_sensors(list, m, ev, self%y, self%values)
      call self%balance%read(m, ev, self%y, .false.)
    end associate
    if (self%balance%diverged()) self%diverged_at = to
    call self%balance%count(self%method%steps)
    self%done = self%done + 1
  end subroutine advance

  !> Compares the events of the first run up to a row with those of the second, element by element: two elements may switch in
  !> either order within the errors of their times. What one run has had and the other not a row later has no counterpart: from
  !> there on the runs are two motions.
  subroutine match_events(self, first, last)
    class(error_watch), intent(inout) :: self
    type(event_list), intent(in) :: first     !! events of the first run since the last row
    real(wp), intent(in) :: last              !! time of that row [s]
    type(switch_event) :: a, b
    integer :: k, n
    if (self%differ_at >= 0.0_wp) self%others%count = 0
    if (.not. self%active .or. self%diverged_at >= 0.0_wp .or. self%differ_at >= 0.0_wp) return
    do k = 1, first%count
      call self%waiting%add(first%items(k))
    end do
    associate (mine => self%waiting, other => self%others)
      k = 1
      do while (k <= mine%count .and. self%differ_at < 0.0_wp)
        a = mine%items(k)
        n = 0
        if (other%count > 0) n = findloc(other%items(1:other%count)%element, a%element, 1)
        if (n == 0) then
          k = k + 1
          cycle
        end if
        b = other%items(n)
        if (a%from == b%from .and. a%to == b%to) then
          self%matched = self%matched + 1
          self%event_error = max(self%event_error, abs(a%t - b%t))
        else
          self%differ_at = min(a%t, b%t)
        end if
        call mine%remove(k)
        call other%remove(n)
      end do
      self%between = mine%count + other%count > 0
      if (self%differ_at >= 0.0_wp) return
      if (mine%count > 0) then
        if (mine%items(1)%t < last) self%differ_at = mine%items(1)%t
      end if
      if (other%count > 0) then
        if (other%items(1)%t < last) self%differ_at = other%items(1)%t
      end if
    end associate
  end subroutine match_events

  !> Compares a row of the first run with that of the second, also beyond events that differ: a finer pass may come closer.
  subroutine compare(self, values)
    class(error_watch), intent(inout) :: self
    real(wp), intent(in) :: values(:)         !! (columns) [of the column]
    if (.not. self%active) return
    if (self%diverged_at >= 0.0_wp .or. (self%between .and. self%differ_at < 0.0_wp)) return
    self%error = max(self%error, abs(values - self%values))
    if (self%differ_at < 0.0_wp) self%agreed = self%error
  end subroutine compare

  !> Saves or restores the second run.
  subroutine exchange(self, a)
    class(error_watch), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    if (.not. self%active) return
    call a%exchange(self%error, self%agreed)
    call self%waiting%exchange(a)
    call self%others%exchange(a)
    call a%exchange(self%matched, self%event_error, self%differ_at)
    if (self%stored) return
    call a%exchange(self%done, self%diverged_at)
    call a%exchange(self%y, self%values)
    call self%balance%exchange(a)
    call self%method%exchange(a)
    call self%sys%exchange_switches(a)
    call a%exchange(self%sys%ev%evaluations, self%sys%ev%schur%was_ill_conditioned)
  end subroutine exchange
end module error_check
