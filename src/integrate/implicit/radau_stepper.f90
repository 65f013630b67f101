!> The Radau IIA method as a transient sees it: fixed steps, or steps by the estimated error with the step prediction of Hairer &
!> Wanner (IV.8) and continuous output. Ends of steps are put onto the constraints.
module radau_stepper
  use kinds, only: wp, ip
  use archive, only: value_archive
  use ode_system, only: ode, is_bounded
  use radau_error, only: measure_error, removed_energy
  use radau_method, only: radau_iia, lagrange_weights
  use radau_stages, only: radau_stage_values, set_up_stages, start_stages, solve_stages, exchange_stages
  use second_order_system, only: sensible, out_of_shape
  use stage_system, only: stage_ode
  use step_control, only: error_norm
  use step_counts, only: step_count
  use summary_text, only: summary_record
  use text, only: to_text
  use time_stepper, only: stepper, step_end, exchange_common, reached, paused, lost, trouble_size, trouble_manifold, &
                          trouble_accuracy, trouble_iteration, trouble_shape
  implicit none (type, external)
  private

  real(wp), parameter :: safety = 0.9_wp           !! on the step that the error model predicts [-]
  real(wp), parameter :: most_shrink = 8.0_wp, most_growth = 5.0_wp   !! of a step [-]
  real(wp), parameter :: same = 1.2_wp             !! growth of a step that does not pay new factors [-]
  real(wp), parameter :: hopeless_steps = 1.0e11_wp   !! to the end of the run, in every step: it would never end
  integer, parameter :: hopeless_halvings = 16     !! of a fixed step: likewise
  integer, parameter :: most_halvings = 30         !! of a fixed step that fails
  integer, parameter :: patience = 20000           !! hopeless steps in a row

  !> The method.
  type, extends(stepper), public :: radau_march
    logical :: adaptive = .false.
    real(wp) :: step = 0.0_wp                 !! fixed: as written in the deck [s]
    real(wp) :: tolerance = 0.0_wp            !! adaptive [-]
    real(wp) :: first_step = 0.0_wp           !! adaptive [s], 0: chosen by the method
    real(wp) :: max_step = huge(1.0_wp)       !! adaptive [s]
    real(wp), allocatable :: stops(:)         !! times of breakpoints, ascending; the last is the end of the run [s]
    logical, allocatable :: jumps(:)          !! whether accelerations jump there
    type(error_norm) :: norm
    type(radau_stage_values) :: stages
    logical :: started = .false.              !! the state at the start of the step stands
    logical :: after_rejection = .false.
    integer(ip) :: done = 0                   !! fixed: steps done in the present interval
    integer :: level = 0                      !! fixed: the step is divided into 2**level parts
    integer(ip) :: failures = 0               !! steps that Newton's method could not solve
    integer :: hopeless = 0                   !! steps in a row from which the run would never end
    real(wp) :: h = 0.0_wp                    !! adaptive: next step [s], 0: to be chosen
    real(wp) :: last(2) = 0.0_wp              !! adaptive: last accepted step [s] and its error [-]
    real(wp), allocatable :: dense(:, :)      !! (n, 4) start and stages of the last step [unit of each unknown]
    real(wp), allocatable :: bend(:, :)       !! (nq, 2) accelerations at its ends [m/s2, rad/s2]
    real(wp) :: dense_times(2) = 0.0_wp       !! where that step began, its size [s]
    integer, allocatable :: group(:)          !! (nq) groups in which a state is judged
    real(wp), allocatable :: weight(:)        !! (nq) [m or rad a unit]
    real(wp), allocatable :: scale(:)         !! (groups) [m, rad]
    logical, allocatable :: grows(:)          !! (groups)
  contains
    procedure :: begin
    procedure :: advance
    procedure :: exchange
    procedure :: account
  end type radau_march

contains

  !> Takes the state; accelerations follow with the first step.
  subroutine begin(self, system, t, y)
    class(radau_march), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in) :: y(:)              !! (n) [unit of each unknown]
    real(wp), allocatable :: whole(:)
    self%t = t
    self%y = y
    self%trial = y
    call self%norm%watch(y)
    select type (system)
    class is (stage_ode)
      call system%start_implicit()
      call system%start_stages()
      call set_up_stages(self%stages, system, radau_iia())
      call system%measures(self%group, self%weight, whole, self%scale, self%grows)
      allocate (self%dense(size(y), 4), self%bend(system%nq, 2), source=0.0_wp)
      call system%derivative(t, y, .false., self%trial)
    end select
    self%trial = y
  end subroutine begin

  !> Marches towards an output time (see `time_stepper`).
  subroutine advance(self, system, from, to, most, y, outcome)
    class(radau_march), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: from, to          !! [s]
    integer, intent(in) :: most
    real(wp), intent(inout) :: y(:)           !! (n) [unit of each unknown]
    integer, intent(out) :: outcome
    integer :: attempt
    attempt = 0
    outcome = paused
    select type (system)
    class is (stage_ode)
      do while (self%t < to)
        if (attempt == most) return
        attempt = attempt + 1
        if (self%adaptive) call controlled_step(self, system, from, to, outcome)
        if (.not. self%adaptive) call fixed_step(self, system, from, to, outcome)
        if (outcome == lost) return
      end do
      call output(self, system, to, y, outcome)
    end select
  end subroutine advance

  !> Tries one of the equal steps of an output interval, or a part of one that failed.
  subroutine fixed_step(self, system, from, to, outcome)
    class(radau_march), intent(inout) :: self
    class(stage_ode), intent(inout) :: system
    real(wp), intent(in) :: from, to          !! [s]
    integer, intent(inout) :: outcome         !! set where the solution is lost
    real(wp) :: h, whole
    integer :: next
    integer(ip) :: n
    logical :: ok, at_stop
    n = step_count(from, to, self%step)
    whole = (to - from)/real(n, wp)
    call step_end(self%t, whole/2**self%level, [merge(to, from + real(self%done + 1, wp)*whole, self%done + 1 == n)], next, h, &
                  self%tried, at_stop)
    if (abs(h - whole) <= 1.0e-9_wp*whole) h = whole        ! without the rounding of times
    call ready(self, system)
    call solve_stages(self%stages, system, self%norm, self%t, h, 0.0_wp, ok)
    self%hopeless = merge(self%hopeless + 1, 0, self%level >= hopeless_halvings)
    if (ok) then
      call accept(self, system, h, outcome)
      self%level = max(self%level - 1, 0)
      if (at_stop) self%done = merge(0_ip, self%done + 1, self%done + 1 == n)
    else
      call refuse(self)
      self%failures = self%failures + 1
      self%level = self%level + 1
      if (self%level > most_halvings .or. self%hopeless >= patience) call give_up(self, trouble_iteration, outcome)
    end if
  end subroutine fixed_step

  !> Tries one step of the adaptive march.
  subroutine controlled_step(self, system, from, to, outcome)
    class(radau_march), intent(inout) :: self
    class(stage_ode), intent(inout) :: system
    real(wp), intent(in) :: from, to          !! [s]
    integer, intent(inout) :: outcome         !! set where the solution is lost
    real(wp) :: h, error, end
    integer :: next
    logical :: at_stop, ok
    end = self%stops(size(self%stops))
    call ready(self, system)
    if (.not. self%h > 0.0_wp) call choose_step(self, to - from)
    call step_end(self%t, min(self%h, self%max_step), self%stops, next, h, self%tried, at_stop)
    call solve_stages(self%stages, system, self%norm, self%t, h, self%tolerance, ok)
    self%hopeless = merge(self%hopeless + 1, 0, end - self%t > hopeless_steps*h .and. .not. at_stop)
    error = huge(1.0_wp)
    if (ok) then
      call pack_stage(self, 3, self%trial)
      call measure_error(self%stages, system, self%norm, self%trial, self%tolerance, &
                         self%after_rejection .or. .not. self%stages%past_h > 0.0_wp, error)
    end if
    if (error > 1.0_wp) then
      call refuse(self)
      if (.not. ok) self%failures = self%failures + 1
      self%h = 0.5_wp*h
      if (ok) self%h = h*min(0.9_wp, max(1/most_shrink, safety*error**(-0.25_wp)))
      if (self%h > max(16*spacing(self%t), 1.0e-15_wp*end) .and. self%hopeless < patience) return
      call give_up(self, merge(trouble_accuracy, trouble_iteration, ok), outcome)
      return
    end if
    call accept(self, system, h, outcome)
    if (outcome == lost) return
    call next_step(self, h, error, at_stop)
  end subroutine controlled_step

  !> The next step: by the last two errors (Gustafsson), and the same one where it could hardly grow.
  subroutine next_step(self, h, error, at_stop)
    class(radau_march), intent(inout) :: self
    real(wp), intent(in) :: h                 !! accepted step [s]
    real(wp), intent(in) :: error             !! [-]
    logical, intent(in) :: at_stop            !! cut short: the step before it goes on
    real(wp) :: factor, err
    err = max(error, 1.0e-10_wp)
    factor = safety*err**(-0.25_wp)
    if (self%last(1) > 0.0_wp) factor = min(factor, safety*h/self%last(1)*(self%last(2)/err**2)**0.25_wp)
    factor = min(most_growth, max(1/most_shrink, factor))
    if (self%after_rejection) factor = min(factor, 1.0_wp)
    self%after_rejection = .false.
    self%last = [h, max(1.0e-2_wp, err)]
    if (factor >= 1.0_wp .and. factor <= same) factor = 1.0_wp
    if (at_stop) self%h = max(self%h, factor*h)
    if (.not. at_stop) self%h = factor*h
    if (.not. self%started) self%h = 0.0_wp
  end subroutine next_step

  !> First step, or the first one after a jump: rates and accelerations change values and rates by a part of their scales whose
  !> fourth power is the tolerance.
  subroutine choose_step(self, interval)
    class(radau_march), intent(inout) :: self
    real(wp), intent(in) :: interval          !! between outputs [s]
    real(wp) :: change
    self%h = min(interval, self%max_step, self%stops(size(self%stops)) - self%t)
    self%last = 0.0_wp
    if (self%first_step > 0.0_wp .and. self%steps == 0) then
      self%h = min(self%first_step, self%h)
      return
    end if
    associate (s => self%stages, e => self%trial)
      e = 0.0_wp
      e(1:s%nq) = self%h*s%v0
      e(s%nq + 1:2*s%nq) = self%h*s%a0
      change = self%norm%measure(e, self%y, self%h, self%tolerance**0.25_wp)
      if (change > 1.0_wp) self%h = self%h/change
    end associate
  end subroutine choose_step

  !> The state at the start of a step.
  subroutine ready(self, system)
    class(radau_march), intent(inout) :: self
    class(stage_ode), intent(inout) :: system
    if (self%started) return
    associate (s => self%stages)
      s%q0 = self%y(1:s%nq)
      s%v0 = self%y(s%nq + 1:2*s%nq)
      s%inner%z0 = self%y(2*s%nq + 1:2*s%nq + s%nz)
      s%inner%zd0(1:s%nzd) = self%y(2*s%nq + s%nz + 1:2*s%nq + s%nz + s%nzd)
      call start_stages(s, system, self%t)
    end associate
    self%started = .true.
  end subroutine ready

  !> A step that is tried again.
  subroutine refuse(self)
    class(radau_march), intent(inout) :: self
    self%rejected = self%rejected + 1
    self%after_rejection = .true.
  end subroutine refuse

  !> The solution is lost.
  subroutine give_up(self, trouble, outcome)
    class(radau_march), intent(inout) :: self
    integer, intent(in) :: trouble
    integer, intent(inout) :: outcome
    call pack_stage(self, 3, self%trial)
    self%trouble = trouble
    outcome = lost
  end subroutine give_up

  !> A stage in the system's layout, without the quadratures.
  pure subroutine pack_stage(self, i, y)
    class(radau_march), intent(in) :: self
    integer, intent(in) :: i
    real(wp), intent(inout) :: y(:)           !! (n) [unit of each unknown]
    associate (s => self%stages)
      y(1:s%nq) = s%q(:, i)
      y(s%nq + 1:2*s%nq) = s%v(:, i)
      y(2*s%nq + 1:2*s%nq + s%nz) = s%inner%z(:, i)
      y(2*s%nq + s%nz + 1:2*s%nq + s%nz + s%nzd) = s%inner%zd(1:s%nzd, i)
    end associate
  end subroutine pack_stage

  !> The stages become the state: quadratures, the end put onto the constraints; where accelerations jump there the method starts
  !> anew.
  subroutine accept(self, system, h, outcome)
    class(radau_march), intent(inout) :: self
    class(stage_ode), intent(inout) :: system
    real(wp), intent(in) :: h                 !! [s]
    integer, intent(inout) :: outcome
    real(wp) :: power(2, 3)                   ! [W]
    integer :: i, n
    logical :: ok
    n = size(self%y)
    associate (s => self%stages)
      do i = 1, 3
        call system%stage_powers(s%t + s%method%c(i)*h, s%q(:, i), s%v(:, i), s%lambda(:, i), s%inner%z(:, i), s%inner%zd(:, i), &
                                 power(:, i))
      end do
      self%dense(:, 1) = self%y
      self%dense_times = [self%t, h]
      do i = 1, 3
        call pack_stage(self, i, self%dense(:, i + 1))
        self%dense(n - 1:, i + 1) = self%y(n - 1:) + h*matmul(power, s%method%a(i, :))
      end do
      self%removed = self%removed + removed_energy(s, system)
      self%bend(:, 1) = s%a0
      s%past(:, 0) = s%v0
      s%past(:, 1:3) = s%v
      s%past_lambda = s%lambda
      s%past_h = h
      s%q0 = s%q(:, 3)
      s%v0 = s%v(:, 3)
      s%a0 = s%a(:, 3)
      s%inner%z0 = s%inner%z(:, 3)
      s%inner%zd0 = s%inner%zd(:, 3)
      call system%close(self%tried, s%q0, s%v0, s%a0)
      self%bend(:, 2) = s%a0
      self%y = self%dense(:, 4)
      self%y(1:s%nq) = s%q0
      self%y(s%nq + 1:2*s%nq) = s%v0
      if (.not. is_bounded(self%y)) then
        self%trial = self%y
        self%trouble = trouble_size
        outcome = lost
        return
      end if
      call self%norm%watch(self%y)
      call self%count_step(self%tried, h)
      do i = 1, s%nq
        associate (g => self%group(i))
          if (self%grows(g)) self%scale(g) = max(self%scale(g), self%weight(i)*abs(s%q0(i)))
        end associate
      end do
      i = system%health(s%q0, self%scale)
    end associate
    if (i /= sensible) then
      call give_up(self, merge(trouble_shape, trouble_size, i == out_of_shape), outcome)
      return
    end if
    do i = 1, size(self%stops)
      if (.not. self%jumps(i) .or. abs(self%stops(i) - self%t) > 1.0e-9_wp*h) cycle
      call system%report(self%t, self%y, ok)
      self%started = .false.
    end do
  end subroutine accept

  !> The state at an output time, on the manifold and with its evaluation: within the last step rates and positions are those of
  !> the polynomial of degree 5 that has both ends' positions, rates and accelerations, all else is that of degree 3 of the stages.
  subroutine output(self, system, to, y, outcome)
    class(radau_march), intent(inout) :: self
    class(stage_ode), intent(inout) :: system
    real(wp), intent(in) :: to                !! [s]
    real(wp), intent(inout) :: y(:)           !! (n) [unit of each unknown]
    integer, intent(out) :: outcome
    real(wp) :: s, x(3), d(3)
    integer :: i, nq
    logical :: ok
    y = self%y
    if (self%t > to) then
      associate (h => self%dense_times(2))
        s = (to - self%dense_times(1))/h
        y = matmul(self%dense, lagrange_weights([0.0_wp, self%stages%method%c], s))
        nq = self%stages%nq
        do i = 1, nq                          ! q + s h v + s2/2 h2 a + s3 (x1 + x2 s + x3 s2) with the three values at the end
          associate (q => self%dense(i, 1), v => h*self%dense(nq + i, 1), a => h**2*self%bend(i, 1))
            d = [self%y(i) - q - v - 0.5_wp*a, h*self%y(nq + i) - v - a, h**2*self%bend(i, 2) - a]
            x = [10*d(1) - 4*d(2) + 0.5_wp*d(3), -15*d(1) + 7*d(2) - d(3), 6*d(1) - 3*d(2) + 0.5_wp*d(3)]
            y(i) = q + s*(v + s*(0.5_wp*a + s*(x(1) + s*(x(2) + s*x(3)))))
            y(nq + i) = (v + s*(a + s*(3*x(1) + s*(4*x(2) + s*5*x(3)))))/h
          end associate
        end do
      end associate
    end if
    ok = is_bounded(y)
    if (ok) call system%report(to, y, ok)
    outcome = reached
    if (ok .and. is_bounded(y)) return
    call self%give_back(to, y, merge(trouble_manifold, trouble_size, is_bounded(y)))
    outcome = lost
  end subroutine output

  !> The method's own work.
  subroutine account(self, text)
    class(radau_march), intent(in) :: self
    type(summary_record), intent(inout) :: text
    call text%figure('  Newton iterations: ', 'newton_iterations', self%stages%iterations)
    call text%figure(' of three stages; evaluations of the residual: ', 'residual_evaluations', self%stages%residuals)
    call text%figure('; matrices: ', 'matrices', self%stages%renewals)
    call text%member('newton_failures', to_text(self%failures))
    if (self%failures > 0) call text%words%add('; Newton''s method failed '//to_text(self%failures)// &
      ' times, and the step was '//trim(merge('tried smaller', 'halved       ', self%adaptive)))
    call text%line('')
  end subroutine account

  !> Saves or restores the march.
  subroutine exchange(self, a)
    class(radau_march), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    call exchange_common(self, a)
    call a%exchange(self%started)
    call a%exchange(self%after_rejection)
    call a%exchange(self%done)
    call a%exchange(self%level)
    call a%exchange(self%failures)
    call a%exchange(self%hopeless)
    call a%exchange(self%h)
    call a%exchange(self%last)
    call a%exchange(self%norm%largest)
    call a%exchange(self%dense)
    call a%exchange(self%bend)
    call a%exchange(self%dense_times)
    call a%exchange(self%scale)
    call exchange_stages(self%stages, a)
  end subroutine exchange
end module radau_stepper
