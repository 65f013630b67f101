!> Embedded pairs of explicit methods with step control, continuous output and stops at the breakpoints of histories (Hairer,
!> Norsett and Wanner, Solving Ordinary Differential Equations I, II.4 to II.6). The end of a step is projected before its
!> derivative is taken: the last stage is then the first of the next step also where states are projected.
!>
!> Errors are measured relative to the groups of the error norm, for values, rates and derivatives of rates, and a local error
!> may at most be the tolerance. Undamped, local errors add up over the run's length T, so that the tolerance of a step is a
!> share of it: for values and rates h/T times `run_tolerances`. Derivatives show the errors of fast vibrations, whose sum is
!> known: for a vibration of frequency omega with z = i h omega the estimate is z5/1200 and the error 2.8e-4 z6, h omega/3
!> times the estimate, which makes omega T/3 estimates after T/h steps; hence `slope_tolerances`/(omega T). The error of a
!> derivative is the difference quotient (f(y + s e) - f(y))/s along the error e of the state.
module adaptive_pair
  use kinds, only: wp, ip
  use archive, only: value_archive
  use event_location, only: begin_roots, find_event, keep_roots, restart_roots, next_fall, pass_event
  use fixed_step, only: fixed_stepper
  use ode_system, only: ode, is_bounded
  use step_control, only: step_controller, value_rounding
  use time_stepper, only: step_end, trouble_size, trouble_manifold, trouble_accuracy
  implicit none (type, external)
  private

  real(wp), parameter :: run_tolerances = 300.0_wp   !! sum of all estimates of values and rates in a run, in tolerances [-]
  real(wp), parameter :: slope_tolerances = 200.0_wp !! the same for derivatives, times omega T [-]
  real(wp), parameter :: least_share = 1.0e-3_wp   !! of the tolerance that a step must keep, however long the run is [-]
  real(wp), parameter :: quotient_step = 1.0e-7_wp   !! error whose difference quotient is taken, of the scales [-]
  real(wp), parameter :: least_step = 1.0e-13_wp   !! of the run's length: with shorter steps a run would not end [-]
  integer(ip), parameter :: noise_interval = 100     !! steps after which the rounding of derivatives is measured again

  !> The method, whose tableau has weights of the error and the extension.
  type, extends(fixed_stepper), public :: adaptive_stepper
    real(wp) :: h = 0.0_wp                    !! next step [s], 0: to be chosen
    type(step_controller) :: control
    real(wp), allocatable :: last(:)            !! (n) derivative at the end of the step, its last stage [unit/s]
    real(wp), allocatable :: error(:)         !! (n) estimated error of the step [unit]
    real(wp), allocatable :: moved(:)         !! (n) the end of the step moved along the error [unit]
    real(wp), allocatable :: slope(:)         !! (n) the derivative there, then the error of the derivative [unit/s]
    real(wp), allocatable :: dense(:, :)      !! (n, 5) coefficients of the last step [unit]
    real(wp) :: dense_start = 0.0_wp          !! where that step began [s]
    real(wp) :: dense_step = 0.0_wp           !! its size [s]
    logical :: reaches_output = .false.       !! the step that is tried reaches an output time
  contains
    procedure :: begin
    procedure :: attempt
    procedure :: try_step
    procedure :: accept_step
    procedure :: keep_path
    procedure :: restart
    procedure :: output_state
    procedure :: exchange
  end type adaptive_stepper

contains

  !> Starts at a state.
  subroutine begin(self, system, t, y)
    class(adaptive_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in) :: y(:)              !! (n) [unit]
    call self%prepare(size(y))
    self%control%order = self%method%order
    allocate (self%last(size(y)), self%error(size(y)), self%moved(size(y)), self%slope(size(y)), self%dense(size(y), 5), &
              source=0.0_wp)
    self%t = t
    self%y = y
    self%trial = y
    self%h = self%settings%first_step
    call self%norm%watch(y)
    call begin_roots(self, system)
    call measure_noise(self, system)
    call system%derivative(t, y, .false., self%k(:, 1))
    call self%norm%watch_slopes(self%k(:, 1), .false.)
  end subroutine begin

  !> Measures the rounding error of the derivative: its change when the state changes in its last digits. The system's
  !> last evaluation is then the one at the changed state.
  subroutine measure_noise(self, system)
    class(adaptive_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    call change_last_digits(self)
    call system%derivative(self%t, self%y, .false., self%last)
    call system%derivative(self%t, self%moved, .false., self%slope)
    self%slope = self%slope - self%last
    call self%norm%watch_slopes(self%slope, .true.)
  end subroutine measure_noise

  !> Moves the state in its last digits.
  subroutine change_last_digits(self)
    class(adaptive_stepper), intent(inout) :: self
    integer :: k
    do k = 1, size(self%y)
      self%moved(k) = self%y(k)*(1 + merge(value_rounding, -value_rounding, mod(k, 2) == 0))
    end do
  end subroutine change_last_digits

  !> The state at an output time within the last step.
  subroutine output_state(self, system, to, y, ok)
    class(adaptive_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: to                !! [s]
    real(wp), intent(inout) :: y(:)           !! (n) [unit]
    logical, intent(out) :: ok
    real(wp) :: s
    ok = .true.
    if (self%t > to) then
      s = (to - self%dense_start)/self%dense_step
      y = self%dense(:, 1) + s*(self%dense(:, 2) + (1 - s)*(self%dense(:, 3) + s*(self%dense(:, 4) + (1 - s)*self%dense(:, 5))))
      call system%evaluate_on_manifold(to, y, .true., self%error, ok)
      if (.not. ok) call self%keep_lost_state(to, y, trouble_manifold)
    else
      y = self%y
      call system%derivative(to, y, .true., self%error)
    end if
  end subroutine output_state

  !> Tries a step of the size that the last error asks for, or passes an event.
  subroutine attempt(self, system, from, to)
    class(adaptive_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: from, to          !! last and next output time [s]
    real(wp) :: h, wanted, err
    logical :: at_stop, at_event, ok
    if (self%roots%pending) then
      call pass_event(self, system)
      return
    end if
    if (.not. self%h > 0.0_wp) call choose_step(self, system, to - from)
    wanted = min(self%h, self%settings%max_step, system%resting_step)
    call step_end(self%t, wanted, self%settings%stops, self%next_stop, h, self%tried, at_stop)
    self%reaches_output = self%tried >= to
    err = -1.0_wp                             ! the step is lost
    call self%try_step(system, h, ok)
    if (ok) call measure_error(self, system, h, err)
    if (err > 1.0_wp .and. self%control%after_rejection .and. system%has_manifold) call allow_for_rounding(self, system, h, err)
    at_event = .false.
    if (err >= 0.0_wp .and. err <= 1.0_wp .and. system%roots > 0) then
      call find_event(self, system, h, at_event, ok)
      if (.not. ok) err = -1.0_wp
      if (ok .and. at_event .and. h > 0.0_wp) call measure_error(self, system, h, err)
      if (err >= 0.0_wp .and. err <= 1.0_wp) call keep_roots(self, system, h, at_event)
    end if
    if (err < 0.0_wp .or. err > 1.0_wp) then
      self%rejected = self%rejected + 1
      self%h = self%control%refused(h, err)
      if (ok .and. system%roots > 0) self%h = min(self%h, next_fall(self, system, h))
      if (self%h > max(16*spacing(self%t), least_step*self%settings%stops(size(self%settings%stops)))) return
      self%trouble = merge(trouble_accuracy, self%cause, err > 0.0_wp)
      return
    end if
    if (h > 0.0_wp) call self%accept_step(system, h)
    if (at_event) return
    self%h = self%control%accepted(h, err)
    if (mod(self%steps, noise_interval) == 0) call measure_noise(self, system)
    if (.not. at_stop) return
    call restart_roots(self, system)
    self%h = max(self%h, wanted)
    call system%derivative(self%t, self%y, .false., self%k(:, 1))
    if (self%settings%jumps(self%next_stop)) self%h = 0.0_wp
    if (self%settings%jumps(self%next_stop)) call self%control%restart()
  end subroutine attempt

  !> The trial becomes the state.
  subroutine accept_step(self, system, h)
    class(adaptive_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: h                 !! [s]
    if (self%reaches_output) call keep_dense(self, h)
    self%y = self%trial
    self%k(:, 1) = self%last
    call self%norm%watch(self%y)
    call self%norm%watch_slopes(self%last, .false.)
    call self%count_step(self%tried, h)
  end subroutine accept_step

  !> The continuous extension, by powers.
  subroutine keep_path(self, h)
    class(adaptive_stepper), intent(inout) :: self
    real(wp), intent(in) :: h                 !! [s]
    call keep_dense(self, h)
    associate (d => self%dense, p => self%path)
      p(:, 0) = d(:, 1)
      p(:, 1) = d(:, 2) + d(:, 3)
      p(:, 2) = d(:, 4) + d(:, 5) - d(:, 3)
      p(:, 3) = -(d(:, 4) + 2*d(:, 5))
      p(:, 4) = d(:, 5)
    end associate
    self%degree = 4
  end subroutine keep_path

  !> Goes on after an event: the first step is chosen anew.
  subroutine restart(self, system, ok)
    class(adaptive_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    logical, intent(out) :: ok
    call self%fixed_stepper%restart(system, ok)
    self%h = 0.0_wp
    call self%control%restart()
  end subroutine restart

  !> The stages of a step, its projected end and the error; not ok where the step is lost.
  subroutine try_step(self, system, h, ok)
    class(adaptive_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: h                 !! [s]
    logical, intent(out) :: ok
    call self%fixed_stepper%try_step(system, h, ok)
    if (.not. ok) return
    call system%derivative(self%tried, self%trial, .true., self%last)
    self%cause = trouble_size
    ok = is_bounded(self%last)
    if (ok) call self%weighted(self%method%error, h, self%last, self%error)
  end subroutine try_step

  !> Where a step is refused again, measures how much of its error is rounding: the change of the estimate when the start changes in
  !> its last digits. Near singular positions rounding is amplified beyond any tolerance; a smaller step would not help.
  subroutine allow_for_rounding(self, system, h, err)
    class(adaptive_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: h                 !! [s]
    real(wp), intent(inout) :: err            !! [-]
    real(wp), dimension(size(self%y)) :: y, slope, rounding   ! start [unit], its derivative [unit/s], of the error [unit]
    logical :: ok, again
    y = self%y
    slope = self%k(:, 1)
    rounding = self%error
    call change_last_digits(self)
    self%y = self%moved
    call system%derivative(self%t, self%y, .false., self%k(:, 1))
    call system%project(self%t, self%y, ok)
    if (ok) call system%derivative(self%t, self%y, .false., self%k(:, 1))
    if (ok) call self%try_step(system, h, ok)
    rounding = self%error - rounding
    self%y = y
    self%k(:, 1) = slope
    if (.not. ok) return
    call self%try_step(system, h, again)
    if (again) call measure_error(self, system, h, err, rounding)
  end subroutine allow_for_rounding

  !> The error of a step over what is allowed.
  subroutine measure_error(self, system, h, err, rounding)
    class(adaptive_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: h                 !! [s]
    real(wp), intent(out) :: err              !! [-]
    real(wp), intent(in), optional :: rounding(:)   !! (n) what of the error is rounding; else the last digits [unit]
    real(wp) :: length, allowed, s
    integer :: k
    length = self%settings%stops(size(self%settings%stops))
    allowed = self%settings%tolerance*min(1.0_wp, max(least_share, run_tolerances*h/length))
    self%moved = epsilon(1.0_wp)*abs(self%trial)
    if (present(rounding)) self%moved = max(abs(rounding), self%moved)
    err = self%norm%measure(self%error, self%trial, h, allowed, self%moved)
    if (err > 1.0_wp .or. .not. err*allowed > tiny(1.0_wp) .or. .not. self%norm%fastest > 0.0_wp) return
    s = quotient_step/(err*allowed)
    do k = 1, size(self%y)
      self%moved(k) = self%trial(k) + s*self%error(k)
    end do
    call system%derivative(self%tried, self%moved, .true., self%slope)
    do k = 1, size(self%y)
      self%slope(k) = (self%slope(k) - self%last(k))/s
    end do
    allowed = self%settings%tolerance*min(1.0_wp, max(least_share, slope_tolerances/(self%norm%fastest*length)))
    err = max(err, self%norm%measure_slopes(self%slope, self%last, h, length, allowed))
  end subroutine measure_error

  !> Coefficients of the continuous extension over the step from y to trial (reference, II.6).
  subroutine keep_dense(self, h)
    class(adaptive_stepper), intent(inout) :: self
    real(wp), intent(in) :: h                 !! [s]
    integer :: k
    real(wp) :: change, curve
    self%dense_start = self%t
    self%dense_step = h
    do k = 1, size(self%y)
      change = self%trial(k) - self%y(k)
      curve = h*self%k(k, 1) - change
      self%dense(k, 1) = self%y(k)
      self%dense(k, 2) = change
      self%dense(k, 3) = curve
      self%dense(k, 4) = change - h*self%last(k) - curve
    end do
    call self%weighted(self%method%dense, h, self%last, self%dense(:, 5))
  end subroutine keep_dense

  !> First step from the state, its derivative and an estimate of the second derivative (reference, II.4).
  subroutine choose_step(self, system, interval)
    class(adaptive_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: interval          !! between outputs, the longest first guess [s]
    real(wp) :: d0, d1, d2, h
    associate (k1 => self%k(:, 1), rest => self%settings%stops(size(self%settings%stops)) - self%t)
      h = min(interval, rest, self%settings%max_step, system%longest_step)
      d0 = self%norm%measure(self%y, self%y, h, self%settings%tolerance)
      d1 = self%norm%measure(k1, self%y, h, self%settings%tolerance)
      if (d1*h > 0.01_wp*d0 .and. d0 > 1.0e-5_wp) h = 0.01_wp*d0/d1
      self%trial = self%y + h*k1
      self%h = h*1.0e-3_wp
      if (.not. is_bounded(self%trial)) return
      call system%derivative(self%t + h, self%trial, .true., self%last)
      if (.not. is_bounded(self%last)) return
      self%error = self%last - k1
      d2 = self%norm%measure(self%error, self%y, h, self%settings%tolerance)
      self%h = min(100*h, rest, self%settings%max_step, system%longest_step)
      d1 = h*max(d1, d2)                      ! changes in a step of h, in tolerances: the reference's rule with h as unit of time
      if (d1 > tiny(d1)) self%h = min(self%h, h*(0.01_wp/d1)**(1.0_wp/self%method%order))
    end associate
  end subroutine choose_step

  !> Saves or restores the march.
  subroutine exchange(self, a)
    class(adaptive_stepper), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    call self%fixed_stepper%exchange(a)
    call a%exchange(self%h, self%control%last_error, self%control%after_rejection, self%dense_start, self%dense_step)
    call a%exchange(self%norm%largest, self%norm%steepest, self%norm%noise)
    call a%exchange(self%dense)
  end subroutine exchange
end module adaptive_pair
