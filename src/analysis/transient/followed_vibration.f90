!> Whether a run by tolerance spends its steps on a vibration that no column shows. Now and then the ends of some steps in a row are
!> looked at: where the unknown that limits the step swings regularly about a slower motion, and all columns swing by less than a
!> thousandth of their ranges, `accuracy` would ask for less. A step itself costs what it costs without this watch.
module followed_vibration
  use kinds, only: wp, ip
  use archive, only: value_archive
  use column_ranges, only: column_range
  use compared_columns, only: compared_names, compared_row
  use posix, only: tell
  use scene_run, only: run_state
  use summary_text, only: summary_record
  use text, only: es_text
  use time_stepper, only: stepper
  implicit none (type, external)
  private

  integer(ip), parameter :: first_look = 4096  !! accepted steps before the first look; twice as many before each next one
  integer, parameter :: samples = 128          !! ends of steps of a look
  integer, parameter :: most_apart = 16        !! steps between two of them
  integer, parameter :: least_swings = 6       !! half periods within it
  real(wp), parameter :: regular = 2.0_wp      !! longest half period, of the mean one [-]
  real(wp), parameter :: noticed = 1.0e-3_wp   !! part of a column's range: the accuracy of a deck that asks for none [-]

  !> The watch, the look under way, and what was found.
  type, public :: vibration_watch
    logical :: active = .false.
    integer(ip) :: begins = first_look         !! accepted steps at the start of a look
    integer(ip) :: next = first_look           !! accepted steps at the next sample
    integer :: apart = 1                       !! steps between two samples
    integer :: count = 0                       !! samples of the look under way
    integer :: unknown = 0                     !! that limited the step when it began
    real(wp) :: t(samples) = 0.0_wp            !! [s]
    real(wp) :: rate(samples) = 0.0_wp         !! of that unknown [m/s, rad/s]
    real(wp), allocatable :: values(:, :)      !! (columns, samples) [of the column]
    type(column_range) :: seen                 !! values of all columns so far
    real(wp), allocatable :: y(:)              !! (ny) work: a state [m, rad], [m/s, rad/s], [J]
    integer :: column = 0                      !! that shows most of the vibration that was found, 0: none was
    integer :: body = 0                        !! that it limited
    real(wp) :: frequency = 0.0_wp             !! [Hz]
    real(wp) :: steps = 0.0_wp                 !! of a period [-]
    real(wp) :: share = 0.0_wp                 !! of the column's range [-]
    real(wp) :: at = 0.0_wp                    !! [s]
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

  !> Takes a sample, where one is due. Where too few swings are seen every second sample goes, and the look lasts twice as long.
  subroutine look(self, run, method)
    class(vibration_watch), intent(inout) :: self
    type(run_state), intent(inout) :: run
    class(stepper), intent(in) :: method
    integer :: unknown, n
    logical :: ok
    if (.not. self%active .or. method%steps < self%next) return
    if (.not. allocated(self%y)) self%y = method%y      ! a restart has none
    call method%limiting(self%y, unknown)
    unknown = rate_of(run, unknown)
    if (self%count == 0) self%unknown = unknown
    call run%sys%report(method%t, self%y, ok)
    self%count = self%count + 1
    self%t(self%count) = method%t
    if (unknown > 0) self%rate(self%count) = self%y(self%unknown)
    call compared_row(run, self%y, self%values(:, self%count))
    call self%seen%note(self%values(:, self%count))
    self%next = method%steps + self%apart
    ok = ok .and. unknown > 0
    if (ok .and. self%count < samples) return
    if (ok) call judge(self, run, n)
    if (ok .and. n <= least_swings .and. self%apart < most_apart) then
      self%count = samples/2
      self%t(:self%count) = self%t(2::2)
      self%rate(:self%count) = self%rate(2::2)
      self%values(:, :self%count) = self%values(:, 2::2)
      self%apart = 2*self%apart
      return
    end if
    self%count = 0
    self%apart = 1
    self%begins = max(2*self%begins, method%steps)
    self%next = self%begins
    if (self%column > 0) call tell(run%d%path//': note: '//words(self, run))
    if (self%column > 0) self%active = .false.
  end subroutine look

  !> The rate of a coordinate among all unknowns; 0: it has none.
  pure integer function rate_of(run, unknown) result(rate)
    type(run_state), intent(in) :: run
    integer, intent(in) :: unknown
    rate = 0
    associate (nq => run%sys%m%s%nq)
      if (unknown > 0 .and. unknown <= 2*nq) rate = nq + 1 + mod(unknown - 1, nq)
    end associate
  end function rate_of

  !> The body whose rate an unknown is.
  pure integer function body_of(run, rate) result(body)
    type(run_state), intent(in) :: run
    integer, intent(in) :: rate
    associate (s => run%sys%m%s)
      do body = size(s%bodies), 2, -1
        if (rate - s%nq > s%qo(body)) return
      end do
    end associate
  end function body_of

  !> Whether the samples show a vibration of which the columns show next to nothing; how often it swings through zero in them.
  subroutine judge(self, run, n)
    class(vibration_watch), intent(inout) :: self
    type(run_state), intent(in) :: run
    integer, intent(out) :: n
    real(wp) :: x(samples)                     ! [of the column]
    real(wp), dimension(size(self%values, 1)) :: range, share   ! [of the column], [-]
    real(wp) :: crossings(samples), mean       ! [s]
    integer :: k
    x = swings(self%t, self%rate)
    n = 0
    do k = 2, samples
      if (x(k)*x(k - 1) >= 0.0_wp) cycle
      n = n + 1
      crossings(n) = self%t(k - 1) + (self%t(k) - self%t(k - 1))*x(k - 1)/(x(k - 1) - x(k))
    end do
    if (n <= least_swings) return
    mean = (crossings(n) - crossings(1))/(n - 1)
    if (maxval(crossings(2:n) - crossings(1:n - 1)) > regular*mean) return
    range = self%seen%moved(run%sys%m%s, compared_names(run), run%d%transient%t_end)
    share = 0.0_wp
    do k = 1, size(range)
      if (range(k) > 0.0_wp) share(k) = maxval(abs(swings(self%t, self%values(k, :))))/range(k)
    end do
    if (size(share) == 0 .or. maxval(range) <= 0.0_wp .or. any(share > noticed)) return
    self%column = maxloc(share, 1)
    self%share = share(self%column)
    self%body = body_of(run, self%unknown)
    self%frequency = 0.5_wp/mean
    self%steps = 2*mean*self%apart*(samples - 1)/(self%t(samples) - self%t(1))
    self%at = self%t(samples)
  end subroutine judge

  !> A signal less the polynomial of third degree that comes closest to it.
  pure function swings(t, x) result(y)
    real(wp), intent(in) :: t(samples)         !! [s]
    real(wp), intent(in) :: x(samples)         !! [any]
    real(wp) :: y(samples)                     !! [any]
    real(wp) :: p(samples, 0:3)                ! orthonormal polynomials [-]
    integer :: k, j
    y = x
    do k = 0, 3
      p(:, k) = ((2*t - t(1) - t(samples))/(t(samples) - t(1)))**k
      do j = 0, k - 1
        p(:, k) = p(:, k) - dot_product(p(:, j), p(:, k))*p(:, j)
      end do
      p(:, k) = p(:, k)/norm2(p(:, k))
      y = y - dot_product(p(:, k), y)*p(:, k)
    end do
  end function swings

  !> What was found.
  function words(self, run) result(text)
    class(vibration_watch), intent(in) :: self
    type(run_state), intent(in) :: run
    character(:), allocatable :: text
    character(80), allocatable :: names(:)
    names = compared_names(run)
    text = 'steps follow a vibration near'//es_text(self%frequency, 1)//' Hz of body "'// &
           trim(run%sys%m%s%bodies(self%body)%name)//'",'//es_text(self%steps, 1)//' steps a period at t ='//es_text(self%at, 3)// &
           ' s, of which no column shows more than'//es_text(self%share, 1)//' of its range ('//trim(names(self%column))// &
           ' shows most); accuracy=1e-3 in place of method and tolerance need not follow it'
  end function words

  !> The same in the summary.
  subroutine lines(self, run, text)
    class(vibration_watch), intent(in) :: self
    type(run_state), intent(in) :: run
    type(summary_record), intent(inout) :: text
    if (self%column == 0) return
    call text%line('  '//words(self, run))
    call text%figure('  that vibration: ', 'followed_frequency', self%frequency, 3)
    call text%figure(' Hz, ', 'followed_share', self%share, 3, rest=' of the range of that column')
  end subroutine lines

  !> Saves or restores the watch.
  subroutine exchange(self, a)
    class(vibration_watch), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    call a%exchange(self%active)
    call a%exchange(self%begins)
    call a%exchange(self%next)
    call a%exchange(self%apart)
    call a%exchange(self%count)
    call a%exchange(self%unknown)
    call a%exchange(self%column)
    call a%exchange(self%body)
    call a%exchange(self%frequency)
    call a%exchange(self%steps)
    call a%exchange(self%share)
    call a%exchange(self%at)
    if (.not. allocated(self%values)) return
    call self%seen%exchange(a)
    if (self%count > 0) call a%exchange(self%t, self%rate)
    if (self%count > 0) call a%exchange(self%values)
  end subroutine exchange
end module followed_vibration
