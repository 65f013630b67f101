!> The generalized-alpha method as a transient sees it. A step is in `alpha_newton`.
module alpha_stepper
  use kinds, only: wp
  use archive, only: value_archive
  use alpha_error, only: error_vector, remember_error
  use alpha_newton, only: near_length, solve_trial, take_trial
  use alpha_start, only: start_method, change_step
  use alpha_state, only: alpha_solver, set_up_alpha, same_step, pack, exchange_alpha
  use generalized_alpha, only: chung_hulbert
  use implicit_march, only: implicit_stepper, exchange_march
  use second_order_system, only: second_order_ode
  use summary_text, only: summary_record
  implicit none (type, external)
  private

  real(wp), parameter :: aim = 0.04_wp        !! local errors add up over a run: the part of the tolerance that each may take [-]

  !> The method.
  type, extends(implicit_stepper), public :: alpha_march
    real(wp) :: spectral_radius = 0.9_wp      !! [-]
    type(alpha_solver) :: solver
    logical :: fresh = .false.                !! the method's variables started here, no step has been accepted since
    real(wp), allocatable :: error(:)         !! (n) adaptive: estimated local error [unit of each unknown]
  contains
    procedure :: set_up
    procedure :: limit_first_step
    procedure :: solve_step
    procedure :: measure_step
    procedure :: take_step
    procedure :: pack_state
    procedure :: interpolate
    procedure :: limiting
    procedure :: account
    procedure :: implicit_work
    procedure :: exchange
  end type alpha_march

contains

  !> Work space.
  subroutine set_up(self, system)
    class(alpha_march), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    call system%start_implicit(.false.)
    self%order = 3
    self%patience = 12
    self%error = self%y
    call set_up_alpha(self%solver, system, chung_hulbert(self%spectral_radius))
  end subroutine set_up

  !> First step: the accelerations alone move nothing by more than a small part of its scale.
  subroutine limit_first_step(self, system)
    class(alpha_march), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp) :: a
    call start_method(self%solver, system, self%t, self%h, self%y)
    a = maxval(abs(self%solver%vd(1:self%solver%nq))*self%solver%measure%unit)
    if (a*self%h**2 > self%settings%tolerance) self%h = sqrt(self%settings%tolerance/a)
  end subroutine limit_first_step

  !> Tries a step; where its size is new the method's variables change first.
  subroutine solve_step(self, system, h, ok)
    class(alpha_march), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: h                 !! [s]
    logical, intent(out) :: ok
    logical :: same
    same = same_step(self%solver, h)
    if (self%roots%locating) same = abs(h - self%solver%now%h) <= 0.0_wp
    if (.not. self%started .or. (self%fresh .and. .not. same)) then
      call start_method(self%solver, system, self%t, h, self%y)
      self%started = .true.
      self%fresh = .true.
    else if (.not. same) then
      call change_step(self%solver, system, h, merge(near_length, 0.0_wp, self%roots%locating))
    end if
    if (self%passes) then
      self%dense_times = [self%t, h]
      call pack_ends(self%solver, self%dense(:, 1:2))
    end if
    call solve_trial(self%solver, system, self%tried, self%roots%locating, ok)
    self%solver%stale = self%roots%locating   ! another step of this length has its own factors
  end subroutine solve_step

  !> The estimated error. Next to singular positions the equations' accelerations amplify the rounding of positions without bound:
  !> a step is refused only where the method's own ones say the same.
  subroutine measure_step(self, system, h, error)
    class(alpha_march), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: h                 !! [s]
    real(wp), intent(out) :: error            !! [-]
    call error_vector(self%solver, system, self%tried, .false., self%error)
    call pack(self%solver, self%solver%x1, self%solver%v1, self%solver%energy%sums, self%trial)
    error = self%norm%measure(self%error, self%trial, h, aim*self%settings%tolerance)
    if (error > 1.0_wp) then
      call error_vector(self%solver, system, self%tried, .true., self%error)
      error = min(error, self%norm%measure(self%error, self%trial, h, aim*self%settings%tolerance))
    end if
    if (.not. error < huge(1.0_wp)) error = huge(1.0_wp)
  end subroutine measure_step

  !> Accepts the trial step.
  subroutine take_step(self, system, h)
    class(alpha_march), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: h                 !! [s]
    if (self%settings%adaptive) then
      call remember_error(self%solver)
      call self%norm%watch(self%trial)
    end if
    call take_trial(self%solver, system, self%tried)
    self%removed = self%solver%energy%removed
    self%fresh = .false.
    if (self%passes) call pack_ends(self%solver, self%dense(:, 3:4))
    call self%end_step(system, h, self%solver%x(1:self%solver%nq))
  end subroutine take_step

  !> The method's own state, whose rates are not projected.
  subroutine pack_state(self, tried, y)
    class(alpha_march), intent(in) :: self
    logical, intent(in) :: tried
    real(wp), intent(inout) :: y(:)           !! (n) [unit of each unknown]
    if (tried) then
      call pack(self%solver, self%solver%x1, self%solver%v1, self%solver%energy%sums, y)
    else
      call pack(self%solver, self%solver%x, self%solver%v, self%solver%energy%sums, y)
    end if
  end subroutine pack_state

  !> The state, and the unknown with the largest error.
  subroutine limiting(self, y, unknown)
    class(alpha_march), intent(in) :: self
    real(wp), intent(inout) :: y(:)           !! (n) [unit of each unknown]
    integer, intent(out) :: unknown
    call self%pack_state(.false., y)
    unknown = self%norm%worst(self%error, .false.)
  end subroutine limiting

  !> The method's state and its rates, from which Hermite's interpolation follows.
  pure subroutine pack_ends(solver, y)
    type(alpha_solver), intent(in) :: solver
    real(wp), intent(inout) :: y(:, :)        !! (n, 2) [unit of each unknown], the same per second
    call pack(solver, solver%x, solver%v, solver%energy%sums, y(:, 1))
    call pack(solver, solver%v, solver%vd, solver%energy%powers, y(:, 2))
  end subroutine pack_ends

  !> Hermite interpolation.
  subroutine interpolate(self, time, y)
    class(alpha_march), intent(in) :: self
    real(wp), intent(in) :: time              !! [s]
    real(wp), intent(inout) :: y(:)           !! (n) [unit of each unknown]
    real(wp) :: x
    associate (h => self%dense_times(2))
      x = (time - self%dense_times(1))/h
      y = matmul(self%dense, [(1 + 2*x)*(1 - x)**2, h*x*(1 - x)**2, x**2*(3 - 2*x), -h*x**2*(1 - x)])
    end associate
  end subroutine interpolate

  !> Processor time of an iteration with its share of the matrices is 3.5 times that of an explicit evaluation, as the median of ten
  !> random scenes (2.4 to 5.4; `make bench`).
  pure real(wp) function implicit_work(self) result(work)
    class(alpha_march), intent(in) :: self
    work = 3.5_wp*self%solver%newton%iterations   ! [-]
  end function implicit_work

  !> Newton iterations and factorisations.
  subroutine account(self, text)
    class(alpha_march), intent(in) :: self
    type(summary_record), intent(inout) :: text
    call text%figure('  Newton iterations: ', 'newton_iterations', self%solver%newton%iterations)
    call text%figure(', factorisations of elastic blocks: constant ', 'constant_factorisations', self%solver%newton%factors(1))
    call text%figure(', exact ', 'exact_factorisations', self%solver%newton%factors(2))
    call self%account_failures(text)
  end subroutine account

  !> Saves or restores the march.
  subroutine exchange(self, a)
    class(alpha_march), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    call exchange_march(self, a)
    call a%exchange(self%fresh)
    call exchange_alpha(self%solver, a)
  end subroutine exchange
end module alpha_stepper
