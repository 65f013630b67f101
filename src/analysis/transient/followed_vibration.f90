!> Whether a run by tolerance spends its steps on a vibration that no column shows. From time to time the ends of 256 steps are
!> looked at. Where the error that limits the step swings regularly, the steps follow a vibration. Where all columns swing by less
!> than a thousandth of their ranges, `accuracy` would ask for less. Between these looks a step costs nothing more.
module followed_vibration
  use kinds, only: wp, ip
  use archive, only: value_archive
  use column_ranges, only: column_range
  use posix, only: tell
  use scene_run, only: run_state
  use sensors, only: read_sensors
  use stored_pass, only: compared_names, compared_row
  use summary_text, only: json_number, summary_record
  use text, only: es_text
  use time_stepper, only: stepper
  implicit none (type, external)
  private

  integer(ip), parameter :: first_look = 4096  !! accepted steps before the first look; twice as many before each next one
  integer, parameter :: samples = 256          !! ends of steps of a look
  integer, parameter :: least_swings = 6       !! half periods within it
  real(wp), parameter :: regular = 3.0_wp      !! longest half period, of the mean one [-]
  real(wp), parameter :: noticed = 1.0e-3_wp   !! part of a column's range: the accuracy of a deck that asks for none [-]

  !> The watch, the look under way, and what was found.
  type, public :: vibration_watch
    logical :: active = .false.
    integer(ip) :: next = first_look           !! accepted steps at the next sample
    integer :: count = 0                       !! samples of the look under way
    integer :: unknown = 0                     !! that limited the step when it began
    real(wp) :: t(samples) = 0.0_wp            !! [s]
    real(wp) :: error(samples) = 0.0_wp        !! of that unknown in the step that ends there [of it, or per second]
    real(wp), allocatable :: values(:, :)      !! (columns, samples) [of the column]
    type(column_range) :: seen                 !! values of all columns so far
    real(wp), allocatable :: y(:)              !! (ny) work: a state [m, rad], [m/s, rad/s], [J]
    integer :: column = 0                      !! that shows most of the vibration that was found, 0: none was
    integer :: body = 0                        !! that it limited
    real(wp) :: frequency = 0.0_wp             !! [Hz]
    real(wp) :: share = 0.0_wp                 !! of the column's range [-]
  contains
    procedure :: begin
    procedure :: limit
    procedure :: look
    procedure :: lines
    procedure :: exchange
  end type vibration_watch

contains

  !> Begins, with the number of columns.
  pure subroutine begin(self, columns)
    class(vibration_watch), intent(inout) :: self
    integer, intent(in) :: columns
    self%active = .true.
    allocate (self%values(columns, samples), source=0.0_wp)
    call self%seen%begin(columns)
  end subroutine begin

  !> Attempts of steps up to the next sample.
  pure subroutine limit(self, steps, most)
    class(vibration_watch), intent(in) :: self
    integer(ip), intent(in) :: steps           !! accepted so far
    integer, intent(inout) :: most
    if (self%active) most = int(max(1_ip, min(int(most, ip), self%next - steps)))
  end subroutine limit

  !> Takes a sample, where one is due.
  subroutine look(self, run, method)
    class(vibration_watch), intent(inout) :: self
    type(run_state), intent(inout) :: run
    class(stepper), intent(in) :: method
    if (self%active .and. method%steps >= self%next) call take_sample(self, run, method)
  end subroutine look

  !> Takes a sample, and judges them after the last one.
  subroutine take_sample(self, run, method)
    class(vibration_watch), intent(inout) :: self
    type(run_state), intent(inout) :: run
    class(stepper), intent(in) :: method
    real(wp) :: dy(size(method%y))             ! [of the state, per second]
    real(wp) :: sensors(run%list%columns)      ! [of the column]
    logical :: ok
    if (.not. allocated(self%y)) self%y = method%y      ! a restart has none
    if (self%count == 0) self%unknown = 0
    self%count = self%count + 1
    self%t(self%count) = method%t
    self%error(self%count) = 0.0_wp
    call method%limiting_error(self%y, self%unknown, self%error(self%count))
    call run%sys%evaluate_on_manifold(method%t, self%y, .true., dy, ok)
    call read_sensors(run%list, run%sys%m, run%sys%ev, self%y, sensors)
    self%values(:, self%count) = compared_row(run, self%y, sensors)
    call self%seen%note(self%values(:, self%count))
    self%next = method%steps + 1
    ok = ok .and. self%unknown > 0 .and. self%unknown <= 2*run%sys%m%s%nq
    if (ok .and. self%count < samples) return
    if (ok) call judge(self, run)
    self%count = 0
    self%next = 2*method%steps
    if (self%column > 0) call tell(run%d%path//': note: '//words(self, run))
    self%active = self%column == 0
  end subroutine take_sample

  !> Whether the samples show a vibration of which the columns show next to nothing.
  subroutine judge(self, run)
    class(vibration_watch), intent(inout) :: self
    type(run_state), intent(in) :: run
    real(wp), dimension(size(self%values, 1)) :: range, share   ! [of the column], [-]
    real(wp) :: zero(samples), half            ! times, mean half period [s]
    integer :: k, n
    n = 0
    associate (t => self%t, x => self%error)
      do k = 2, samples
        if (x(k)*x(k - 1) >= 0.0_wp) cycle
        n = n + 1
        zero(n) = t(k - 1) + (t(k) - t(k - 1))*x(k - 1)/(x(k - 1) - x(k))
      end do
    end associate
    if (n <= least_swings) return
    half = (zero(n) - zero(1))/(n - 1)
    if (maxval(zero(2:n) - zero(1:n - 1)) > regular*half) return
    range = self%seen%moved(run%sys%m%s, compared_names(run), run%d%transient%t_end)
    share = 0.0_wp
    where (range > 0.0_wp) share = maxval(abs(fast_parts(self%t, self%values, n/2)), 2)/range
    if (size(share) == 0 .or. maxval(range) <= 0.0_wp .or. any(share > noticed)) return
    self%column = maxloc(share, 1)
    self%share = share(self%column)
    self%body = count(run%sys%m%s%qo(:size(run%sys%m%s%bodies)) < 1 + mod(self%unknown - 1, run%sys%m%s%nq))
    self%frequency = 0.5_wp/half
  end subroutine judge

  !> Signals less the polynomials that come closest to them. One of half as many degrees as a vibration has swings takes away what
  !> is slower than a third of its frequency.
  pure function fast_parts(t, x, degree) result(y)
    real(wp), intent(in) :: t(:)               !! (samples) [s]
    real(wp), intent(in) :: x(:, :)            !! (signals, samples) [any]
    integer, intent(in) :: degree
    real(wp) :: y(size(x, 1), size(t))         !! [any]
    real(wp) :: p(size(t)), before(size(t), 0:degree)   ! orthonormal polynomials [-]
    integer :: k, j
    y = x
    p = 1.0_wp
    do k = 0, degree
      do j = 0, k - 1
        p = p - dot_product(before(:, j), p)*before(:, j)
      end do
      before(:, k) = p/norm2(p)
      y = y - spread(matmul(y, before(:, k)), 2, size(t))*spread(before(:, k), 1, size(x, 1))
      p = (2*t - t(1) - t(size(t)))/(t(size(t)) - t(1))*before(:, k)
    end do
  end function fast_parts

  !> What was found.
  function words(self, run) result(text)
    class(vibration_watch), intent(in) :: self
    type(run_state), intent(in) :: run
    character(:), allocatable :: text
    character(80), allocatable :: names(:)
    names = compared_names(run)
    text = 'steps follow a vibration near'//es_text(self%frequency, 1)//' Hz of body "'// &
           trim(run%sys%m%s%bodies(self%body)%name)//'", of which no column shows more than'//es_text(self%share, 1)// &
           ' of its range ('//trim(names(self%column))//' shows most); accuracy=1e-3 in place of method and tolerance need not '// &
           'follow it'
  end function words

  !> The same in the summary.
  subroutine lines(self, run, text)
    class(vibration_watch), intent(in) :: self
    type(run_state), intent(in) :: run
    type(summary_record), intent(inout) :: text
    if (self%column == 0) return
    call text%line('  '//words(self, run))
    call text%member('followed_frequency', json_number(self%frequency))   ! [Hz]
    call text%member('followed_share', json_number(self%share))
  end subroutine lines

  !> Saves or restores the watch.
  subroutine exchange(self, a)
    class(vibration_watch), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    call a%exchange(self%active)
    if (.not. allocated(self%values)) return
    call a%exchange(self%next)
    call a%exchange(self%count)
    call a%exchange(self%unknown)
    call a%exchange(self%column)
    call a%exchange(self%body)
    call a%exchange(self%frequency)
    call a%exchange(self%share)
    call self%seen%exchange(a)
    if (self%count > 0) call a%exchange(self%t, self%error)
    if (self%count > 0) call a%exchange(self%values)
  end subroutine exchange
end module followed_vibration
