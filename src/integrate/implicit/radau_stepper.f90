!> The Radau IIA method as a transient sees it: step prediction of Hairer & Wanner (IV.8), continuous output. Ends of steps are put
!> onto the constraints.
module radau_stepper
  use kinds, only: wp
  use archive, only: value_archive
  use event_location, only: find_event, keep_roots, restart_roots, next_fall, pass_event
  use implicit_march, only: implicit_stepper, exchange_march, fixed_step, give_up, most_hopeless
  use ode_system, only: is_bounded, ode
  use radau_error, only: measure_error, removed_energy
  use radau_method, only: radau_iia, lagrange_weights
  use radau_stages, only: most_growth, radau_stage_values, set_up_stages, start_stages, solve_stages, exchange_stages
  use second_order_system, only: second_order_ode
  use summary_text, only: summary_record
  use time_stepper, only: step_end, trouble_size, trouble_iteration, trouble_accuracy
  implicit none (type, external)
  private

  integer, parameter :: error_order = 4            !! of the estimated error in the step
  integer, parameter :: steps_before_growth = 4    !! whose errors are seen before a step grows
  real(wp), parameter :: hopeless_steps = 1.0e11_wp   !! a step is hopeless where the rest of the run would take so many [-]
  real(wp), parameter :: failure_error = 8.0_wp    !! taken as the error of a step whose Newton iteration failed [-]
  real(wp), parameter :: safety = 0.85_wp          !! on the step that the error model predicts [-]
  real(wp), parameter :: prompt_growth = 2.0_wp    !! a step that may grow by more grows at once [-]
  real(wp), parameter :: least_growth = 1.2_wp     !! a step that may grow by less stays: new matrices would cost more [-]

  !> Errors since the step last changed.
  type :: step_memory
    real(wp) :: worst = 0.0_wp                !! over the tolerance [-]
    integer :: steps = 0
  end type step_memory

  !> The method.
  type, extends(implicit_stepper), public :: radau_march
    type(radau_stage_values) :: stages
    real(wp) :: h = 0.0_wp                    !! by tolerance: next step [s]
    type(step_memory) :: memory               !! by tolerance
    real(wp), allocatable :: dense(:, :)      !! (n, 4) start and stages of the last step [unit of each unknown]
    real(wp) :: dense_times(2) = 0.0_wp       !! where that step began, its size [s]
    real(wp), allocatable :: end_a(:, :)      !! (nq, 2) accelerations at the last step's ends [m/s2, rad/s2]
    real(wp), allocatable :: powers(:, :)     !! (quadratures, 0:3) of the last step's start and stages [W]
  contains
    procedure :: set_up
    procedure :: attempt
    procedure :: solve_step
    procedure :: measure_step
    procedure :: take_step
    procedure :: keep_path
    procedure :: pack_state
    procedure :: interpolate
    procedure :: report_work
    procedure :: implicit_work
    procedure :: exchange
  end type radau_march

contains

  !> Work space.
  subroutine set_up(self, system)
    class(radau_march), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    call system%start_implicit(.true.)
    call set_up_stages(self%stages, system, radau_iia())
    allocate (self%end_a(system%nq, 2), self%powers(system%quadratures, 0:3), self%dense(size(self%y), 4), &
              source=0.0_wp)
  end subroutine set_up

  !> Tries the next step and accepts it, or passes an event.
  subroutine attempt(self, system, from, to)
    class(radau_march), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: from, to          !! [s]
    if (self%settings%adaptive) then
      select type (system)
      class is (second_order_ode)
        call controlled_step(self, system, from, to)
      end select
    else
      call fixed_step(self, system, from, to)
    end if
  end subroutine attempt

  !> Tries one step of the size that the last error asks for; one that is cut short by a stop does not shorten the next.
  subroutine controlled_step(self, system, from, to)
    class(radau_march), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: from, to          !! [s]
    real(wp) :: h, error, next, end
    logical :: at_stop, at_event, ok
    if (self%roots%pending) then
      call pass_event(self, system)
      return
    end if
    associate (s => self%settings)
      end = s%stops(size(s%stops))
      if (.not. self%started) then
        self%h = min(to - from, s%max_step, end - self%t, system%longest_step)
        if (s%first_step > 0.0_wp .and. self%steps == 0) then
          self%h = min(s%first_step, self%h)
        else
          call limit_first_step(self, system)
        end if
      end if
      call step_end(self%t, min(self%h, s%max_step, system%resting_step), s%stops, self%next_stop, h, self%tried, at_stop)
    end associate
    self%hopeless = merge(self%hopeless + 1, 0, end - self%t > hopeless_steps*h .and. .not. at_stop)
    call self%try_step(system, h, ok)
    error = huge(1.0_wp)
    if (ok) call self%measure_step(system, error)
    at_event = .false.
    if (error <= 1.0_wp .and. system%roots > 0) then
      call find_event(self, system, h, at_event, ok)
      if (.not. ok) error = huge(1.0_wp)
      if (ok .and. at_event .and. h > 0.0_wp) call self%measure_step(system, error)
      if (error <= 1.0_wp) call keep_roots(self, system, h, at_event)
    end if
    if (error > 1.0_wp) then
      self%rejected = self%rejected + 1
      if (.not. ok) self%failures = self%failures + 1
      self%h = next_step(self, h, error)
      if (ok .and. system%roots > 0) self%h = min(self%h, next_fall(self, system, h))
      if (self%h > max(16*spacing(self%t), 1.0e-15_wp*end) .and. self%hopeless < most_hopeless) return
      call give_up(self, merge(trouble_accuracy, trouble_iteration, ok))
      return
    end if
    if (h > 0.0_wp) call self%accept_step(system, h)
    if (at_event) return
    if (at_stop) call restart_roots(self, system)
    next = next_step(self, h, error)
    self%h = merge(max(self%h, next), next, at_stop)
  end subroutine controlled_step

  !> Step that estimated errors ask for after one of size h. A new step means new matrices, and errors of a vibration come and go
  !> with its phase: a step grows where the worst error of several steps allows it, or at once where it may grow by much.
  real(wp) function next_step(self, h, error) result(next)   ! [s]
    class(radau_march), intent(inout) :: self
    real(wp), intent(in) :: h                 !! [s]
    real(wp), intent(in) :: error             !! its estimated error over what is allowed, huge: Newton's method failed [-]
    real(wp) :: factor                        ! [-]
    associate (m => self%memory)
      m%worst = max(m%worst, merge(error, failure_error, error < huge(1.0_wp)))
      m%steps = m%steps + 1
      factor = safety*max(m%worst, 1.0e-6_wp)**(-1.0_wp/error_order)
      next = h
      if (error > 1.0_wp) then
        next = h*max(0.2_wp, min(0.8_wp, factor))
      else if (factor > prompt_growth .or. (m%steps >= steps_before_growth .and. factor > least_growth)) then
        next = h*min(factor, most_growth)
      else if (m%steps < steps_before_growth) then
        return
      end if
      m = step_memory()
    end associate
  end function next_step

  !> First step, or the first one after a jump: rates and accelerations change values and rates by a part of their scales whose
  !> fourth power is the tolerance. The change grows with the step at least as its first power, at most as its second, since rates
  !> that are small have scales that shrink with the step: the square root of the change never makes the step too small.
  subroutine limit_first_step(self, system)
    class(radau_march), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), parameter :: enough = 1.1_wp    ! change at which the step stays [-]
    real(wp) :: change
    call ready(self, system)
    associate (s => self%stages, e => self%trial)
      e = 0.0_wp
      do
        e(1:s%nq) = self%h*s%v0
        e(s%nq + 1:2*s%nq) = self%h*s%a0
        change = self%norm%measure(e, self%y, self%h, self%settings%tolerance**0.25_wp)
        if (.not. (change > enough .and. change < huge(1.0_wp))) exit
        self%h = self%h/sqrt(change)
      end do
    end associate
  end subroutine limit_first_step

  !> The state at the start of a step.
  subroutine ready(self, system)
    class(radau_march), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
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

  !> Tries a step.
  subroutine solve_step(self, system, h, ok)
    class(radau_march), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: h                 !! [s]
    logical, intent(out) :: ok
    call ready(self, system)
    call solve_stages(self%stages, system, self%norm, self%t, h, self%settings%tolerance, self%roots%locating, ok)
  end subroutine solve_step

  !> The estimated error.
  subroutine measure_step(self, system, error)
    class(radau_march), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(out) :: error            !! [-]
    call pack_stage(self, 3, self%trial)
    call measure_error(self%stages, system, self%norm, self%trial, self%settings%tolerance, &
                       self%memory%steps == 0, error)
  end subroutine measure_step

  !> The state, or the last stage.
  subroutine pack_state(self, tried, y)
    class(radau_march), intent(in) :: self
    logical, intent(in) :: tried
    real(wp), intent(inout) :: y(:)           !! (n) [unit of each unknown]
    if (tried) call pack_stage(self, 3, y)
    if (.not. tried) y = self%y
  end subroutine pack_state

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

  !> The stages become the state: quadratures, the end put onto the constraints.
  subroutine take_step(self, system, h)
    class(radau_march), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: h                 !! [s]
    integer :: i, k, n
    n = size(self%y) - system%quadratures
    associate (s => self%stages)
      self%powers(:, 0) = s%powers0
      do i = 1, 3
        call system%powers(s%t + s%method%c(i)*h, s%q(:, i), s%v(:, i), s%lambda(:, i), s%inner%z(:, i), s%inner%zd(:, i), &
                                 self%powers(:, i))
      end do
      self%dense(:, 1) = self%y
      self%dense_times = [self%t, h]
      do i = 1, 3
        call pack_stage(self, i, self%dense(:, i + 1))
        do k = 1, system%quadratures
          self%dense(n + k, i + 1) = self%y(n + k) + h*dot_product(self%powers(k, 1:), s%method%a(i, :))
        end do
      end do
      s%powers0 = self%powers(:, 3)
      self%removed = self%removed + removed_energy(s, system)
      self%end_a(:, 1) = s%a0
      s%last_v(:, 0) = s%v0
      s%last_v(:, 1:3) = s%v
      s%last_lambda = s%lambda
      s%last_h = h
      s%q0 = s%q(:, 3)
      s%v0 = s%v(:, 3)
      s%a0 = s%a(:, 3)
      s%inner%z0 = s%inner%z(:, 3)
      s%inner%zd0 = s%inner%zd(:, 3)
      call close_gaps(s, system, self%tried)
      self%end_a(:, 2) = s%a0
      self%y = self%dense(:, 4)
      self%y(1:s%nq) = s%q0
      self%y(s%nq + 1:2*s%nq) = s%v0
      if (.not. is_bounded(self%y)) then
        self%trial = self%y
        self%trouble = trouble_size
        return
      end if
      call self%norm%watch(self%y)
      call self%end_step(system, h, s%q0)
    end associate
  end subroutine take_step

  !> Puts positions, then rates, then accelerations onto the constraints, by the real matrix: stiff coordinates follow in balance.
  subroutine close_gaps(s, system, t)
    type(radau_stage_values), intent(inout) :: s
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: t                 !! [s]
    integer :: k
    if (s%rows == 0) return
    associate (gap => s%work%gap, dx => s%work%dq(:, 1:1), mu => s%work%mu)
      do k = 1, 3
        call system%gaps(t, s%q0, s%v0, s%a0, s%a0, gap)
        call system%gap_correction(s%q0, gap(:, k:k), dx, mu)
        if (k == 1) s%q0 = s%q0 + dx(:, 1)
        if (k == 2) s%v0 = s%v0 + dx(:, 1)
        if (k == 3) s%a0 = s%a0 + dx(:, 1)
      end do
    end associate
  end subroutine close_gaps

  !> Rates and positions within a step are those of the polynomial of degree 5 that has both ends' positions, rates and
  !> accelerations. Energies are integrals of the powers' polynomial through the start and the stages. All else is that of degree 3
  !> of the stages. So are coordinates that stay below the tolerance: where they are stiff, their accelerations are noise.
  subroutine interpolate(self, time, y)
    class(radau_march), intent(in) :: self
    real(wp), intent(in) :: time              !! [s]
    real(wp), intent(inout) :: y(:)           !! (n) [unit of each unknown]
    real(wp), parameter :: gauss(2) = 0.5_wp*(1 + [-1, 1]/sqrt(3.0_wp))   ! exact for degree 3 [-]
    real(wp) :: s, x(3), d(3)
    integer :: i, first
    associate (h => self%dense_times(2), nq => self%stages%nq, nodes => [0.0_wp, self%stages%method%c])
      s = (time - self%dense_times(1))/h
      y = matmul(self%dense, lagrange_weights(nodes, s))
      first = size(y) - size(self%powers, 1) + 1
      y(first:) = self%dense(first:, 1) + 0.5_wp*s*h* &
                  matmul(self%powers, lagrange_weights(nodes, s*gauss(1)) + lagrange_weights(nodes, s*gauss(2)))
      do i = 1, nq                            ! q + s h v + s2/2 h2 a + s3 (x1 + x2 s + x3 s2) with the three values at the end
        if (self%norm%largest(self%norm%group(i)) < self%norm%floor(self%norm%group(i))) cycle
        associate (q => self%dense(i, 1), v => h*self%dense(nq + i, 1), a => h**2*self%end_a(i, 1))
          d = [self%y(i) - q - v - 0.5_wp*a, h*self%y(nq + i) - v - a, h**2*self%end_a(i, 2) - a]
          x = [10*d(1) - 4*d(2) + 0.5_wp*d(3), -15*d(1) + 7*d(2) - d(3), 6*d(1) - 3*d(2) + 0.5_wp*d(3)]
          y(i) = q + s*(v + s*(0.5_wp*a + s*(x(1) + s*(x(2) + s*x(3)))))
          y(nq + i) = (v + s*(a + s*(3*x(1) + s*(4*x(2) + s*5*x(3)))))/h
        end associate
      end do
    end associate
  end subroutine interpolate

  !> The same within the step that was tried, before its end is put onto the constraints.
  subroutine keep_path(self, h)
    class(radau_march), intent(inout) :: self
    real(wp), intent(in) :: h                 !! [s]
    real(wp) :: d(3)                          ! [unit of each unknown]
    integer :: i, k
    call self%pack_state(.false., self%path(:, 0))
    do k = 1, 3
      self%path(:, k) = self%path(:, 0)       ! quadratures stay
      call pack_stage(self, k, self%path(:, k))
      self%path(:, k) = self%path(:, k) - self%path(:, 0)
    end do
    self%path(:, 1:3) = matmul(self%path(:, 1:3), self%stages%method%powers)
    self%path(:, 4:) = 0.0_wp
    associate (s => self%stages, p => self%path)
      do i = 1, s%nq
        if (self%norm%largest(self%norm%group(i)) < self%norm%floor(self%norm%group(i))) cycle
        associate (v => h*s%v0(i), a => h**2*s%a0(i))
          d = [s%q(i, 3) - s%q0(i) - v - 0.5_wp*a, h*s%v(i, 3) - v - a, h**2*s%a(i, 3) - a]
          p(i, 1:) = [v, 0.5_wp*a, 10*d(1) - 4*d(2) + 0.5_wp*d(3), -15*d(1) + 7*d(2) - d(3), 6*d(1) - 3*d(2) + 0.5_wp*d(3)]
          p(s%nq + i, 0:4) = [(k*p(i, k)/h, k=1, 5)]
        end associate
      end do
    end associate
  end subroutine keep_path

  !> Processor time of a residual with its share of the matrices is 2.2 times that of an explicit evaluation, as the median of 24
  !> random scenes (1.4 to 3.2; `make bench`).
  pure real(wp) function implicit_work(self) result(work)
    class(radau_march), intent(in) :: self
    work = 2.2_wp*self%stages%residuals       ! [-]
  end function implicit_work

  !> The method's own work.
  subroutine report_work(self, text)
    class(radau_march), intent(in) :: self
    type(summary_record), intent(inout) :: text
    call text%say('  Newton iterations: {newton_iterations #} of three stages; evaluations of the residual: '// &
                  '{residual_evaluations #}; matrices: {matrices #}', &
                  [real(wp) :: self%stages%iterations, self%stages%residuals, self%stages%renewals])
    call self%report_failures(text)
  end subroutine report_work

  !> Saves or restores the march.
  subroutine exchange(self, a)
    class(radau_march), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    call exchange_march(self, a)
    call a%exchange(self%h, self%memory%worst, self%memory%steps)
    call a%exchange(self%dense_times)
    call a%exchange(self%end_a)
    call a%exchange(self%powers)
    call a%exchange(self%dense)
    call exchange_stages(self%stages, a)
  end subroutine exchange
end module radau_stepper
