!> The generalized-alpha method as a transient sees it: fixed steps, a failing one divided and tried again, or steps chosen
!> by the estimated error with continuous output; starts again where loads or drives jump. The mechanics of a step is in
!> `implicit_step`.
module alpha_stepper
  use kinds, only: wp, ip
  use archive, only: value_archive
  use dynamics, only: evaluate
  use generalized_alpha, only: chung_hulbert, next_step, step_memory
  use implicit_error, only: error_vector, own_error, compare_estimates, doubtful, back_to_equations, nearly_dependent, &
                            remember_error
  use implicit_limits, only: beyond_sense, sensible, out_of_shape
  use implicit_model, only: implicit_solver, set_up_implicit
  use implicit_start, only: start_method, change_step, reported_state, same_step, full_state
  use implicit_step, only: try_step, accept_step, undo_end, full_rates, exchange_solver
  use mechanism, only: mechanism_model
  use mechanism_ode, only: mechanism_system
  use ode_system, only: ode, sane
  use projection, only: project
  use singular, only: evaluate_branch
  use step_control, only: error_norm
  use time_stepper, only: stepper, exchange_common, step_count, step_end, reached, paused, lost, trouble_none, trouble_size, &
                          trouble_manifold, trouble_accuracy, trouble_iteration, trouble_shape
  implicit none (type, external)
  private

  real(wp), parameter :: aim = 0.04_wp        !! local errors add up over a run: the part of the tolerance that each may take [-]

  integer, parameter :: most_halvings = 30      !! of a fixed step that fails
  integer, parameter :: hopeless_halvings = 16  !! of every fixed step, ...
  real(wp), parameter :: hopeless_steps = 1.0e11_wp   !! or controlled steps to the end of the run, ...
  integer, parameter :: patience = 20000        !! told by so many steps in a row: the run would never end

  !> The method.
  type, extends(stepper), public :: implicit_stepper
    real(wp) :: spectral_radius = 0.9_wp      !! [-]
    logical :: adaptive = .false.
    real(wp) :: step = 0.0_wp                 !! fixed: as written in the deck [s]
    real(wp) :: tolerance = 0.0_wp            !! adaptive [-]
    real(wp) :: first_step = 0.0_wp           !! adaptive [s], 0: chosen by the method
    real(wp) :: max_step = huge(1.0_wp)       !! adaptive [s]
    real(wp), allocatable :: stops(:)         !! times of corners, ascending; the last is the end of the run [s]
    logical, allocatable :: jumps(:)          !! whether accelerations jump there
    type(implicit_solver) :: solver
    logical :: started = .false.              !! the method's own variables stand
    logical :: fresh = .false.                !! they started here, no step has been accepted since
    integer(ip) :: done = 0                   !! fixed: whole steps done in the present interval
    integer(ip) :: failures = 0               !! steps that Newton's method could not solve
    integer :: level = 0                      !! fixed: the step is divided into 2**level parts
    integer :: part = 0                       !! fixed: parts of it done
    integer :: hopeless = 0                   !! steps in a row from which the run would never end
    real(wp) :: h = 0.0_wp                    !! adaptive: next step [s], 0: to be chosen
    type(error_norm) :: norm                  !! adaptive
    real(wp), allocatable :: error(:)         !! (n) adaptive: estimated local error
    type(step_memory) :: memory               !! adaptive: errors since the step last changed
    real(wp), allocatable :: dense(:, :)      !! (n, 4) states and rates at both ends of the step that passed an output
    real(wp) :: dense_start = 0.0_wp          !! where that step began [s]
    real(wp) :: dense_step = 0.0_wp           !! its size [s]
  contains
    procedure :: begin
    procedure :: advance
    procedure :: exchange
    procedure :: account
  end type implicit_stepper

contains

  !> Takes the state; the method's own variables follow with the first step, whose size they need.
  subroutine begin(self, system, t, y)
    class(implicit_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in) :: y(:)              !! (n)
    self%t = t
    self%y = y
    self%trial = y
    if (self%adaptive) allocate (self%dense(size(y), 4), self%error(size(y)), source=0.0_wp)
    if (self%adaptive) call self%norm%watch(y)
    select type (system)
    class is (mechanism_system)
      call set_up_implicit(self%solver, system%m, chung_hulbert(self%spectral_radius))
      call system%derivative(t, y, .false., self%trial)
    end select
  end subroutine begin

  !> Marches towards an output time (see `time_stepper`).
  subroutine advance(self, system, from, to, most, y, outcome)
    class(implicit_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: from, to          !! [s]
    integer, intent(in) :: most
    real(wp), intent(inout) :: y(:)           !! (n)
    integer, intent(out) :: outcome
    outcome = lost
    select type (system)
    class is (mechanism_system)
      if (self%adaptive) then
        call advance_adaptive(self, system%m, from, to, most, y, outcome)
      else
        call advance_fixed(self, system%m, from, to, most, y, outcome)
      end if
    end select
  end subroutine advance

  !> Equal steps; one that fails is halved until it works, and the parts grow again as far as they fit.
  subroutine advance_fixed(self, m, from, to, most, y, outcome)
    class(implicit_stepper), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: from, to          !! [s]
    integer, intent(in) :: most
    real(wp), intent(inout) :: y(:)
    integer, intent(out) :: outcome
    integer(ip) :: n
    integer :: attempt
    real(wp) :: h
    logical :: ok
    n = step_count(to - from, self%step)
    h = (to - from)/real(n, wp)
    outcome = paused
    do attempt = 1, most
      self%tried = from + (real(self%done, wp) + real(self%part + 1, wp)/2**self%level)*h
      if (self%part + 1 == 2**self%level .and. self%done + 1 == n) self%tried = to
      call one_step(self, m, h/2**self%level, ok)
      if (.not. ok) then
        self%rejected = self%rejected + 1
        self%failures = self%failures + 1
        self%level = self%level + 1
        self%part = 2*self%part
        call count_hopeless(self, self%level >= hopeless_halvings)
        if (self%level <= most_halvings .and. self%hopeless < patience) cycle
        call give_up(self, m)
        outcome = lost
        return
      end if
      if (self%trouble /= trouble_none) then
        outcome = lost
        return
      end if
      call count_hopeless(self, self%level >= hopeless_halvings)
      self%part = self%part + 1
      do while (self%level > 0 .and. mod(self%part, 2) == 0)
        self%level = self%level - 1
        self%part = self%part/2
      end do
      if (self%level > 0) cycle
      self%part = 0
      self%done = self%done + 1
      if (self%done < n) cycle
      self%done = 0
      call finish_output(self, m, to, y, outcome)
      return
    end do
  end subroutine advance_fixed

  !> Counts steps in a row from which the run would never end.
  pure subroutine count_hopeless(self, yes)
    class(implicit_stepper), intent(inout) :: self
    logical, intent(in) :: yes
    self%hopeless = merge(self%hopeless + 1, 0, yes)
  end subroutine count_hopeless

  !> One step of size h from self%t to self%tried, accepted where Newton's method converges.
  subroutine one_step(self, m, h, ok)
    class(implicit_stepper), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: h                 !! [s]
    logical, intent(out) :: ok
    call ready(self, m, h)
    call try_step(self%solver, m, self%tried, ok)
    if (.not. ok) return
    call accept(self, m, h)
  end subroutine one_step

  !> The method's variables for a step of size h from self%t.
  subroutine ready(self, m, h)
    class(implicit_stepper), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: h                 !! [s]
    if (.not. self%started .or. (self%fresh .and. .not. same_step(self%solver, h))) then
      call start_method(self%solver, m, self%t, h, self%y)
      self%started = .true.
      self%fresh = .true.
    else if (.not. same_step(self%solver, h)) then
      call change_step(self%solver, m, self%t, h)
    end if
  end subroutine ready

  !> Accepts the trial step; where accelerations jump at its end the method starts anew from the projected state.
  subroutine accept(self, m, h)
    class(implicit_stepper), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: h                 !! [s]
    integer :: k
    call accept_step(self%solver, m, self%tried)
    self%fresh = .false.
    call self%count_step(self%tried, h)
    k = beyond_sense(self%solver, m)
    if (k /= sensible) then
      call give_up(self, m)
      self%trouble = merge(trouble_shape, trouble_size, k == out_of_shape)
      return
    end if
    do k = 1, size(self%stops)
      if (.not. self%jumps(k) .or. abs(self%stops(k) - self%t) > 1.0e-9_wp*h) cycle
      call reported_state(self%solver, m, self%t, self%y)
      self%started = .false.
    end do
  end subroutine accept

  !> The row's state: projected, with its evaluation.
  subroutine finish_output(self, m, to, y, outcome)
    class(implicit_stepper), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: to                !! [s]
    real(wp), intent(inout) :: y(:)
    integer, intent(out) :: outcome
    logical :: ok
    call reported_state(self%solver, m, to, self%y, ok)
    y = self%y
    call hand_over(self, to, y, ok, outcome)
  end subroutine finish_output

  !> An output state: reached, or lost where it is not on the manifold or not finite.
  subroutine hand_over(self, to, y, ok, outcome)
    class(implicit_stepper), intent(inout) :: self
    real(wp), intent(in) :: to                !! [s]
    real(wp), intent(in) :: y(:)
    logical, intent(in) :: ok                 !! whether the joints could be closed
    integer, intent(out) :: outcome
    if (ok .and. sane(y)) then
      self%removed = self%solver%removed
      outcome = reached
    else
      call self%give_back(to, y, merge(trouble_manifold, trouble_size, sane(y)))
      outcome = lost
    end if
  end subroutine hand_over

  !> Newton's method failed for good: the state that it left.
  subroutine give_up(self, m)
    class(implicit_stepper), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    integer :: nq
    nq = m%s%nq
    call full_state(self%solver, self%trial)
    self%trial(1:nq) = self%solver%q1
    self%trial(nq + 1:2*nq) = self%solver%v1
    self%trouble = trouble_iteration
    self%started = .false.
  end subroutine give_up

  !> Steps by the estimated error.
  subroutine advance_adaptive(self, m, from, to, most, y, outcome)
    class(implicit_stepper), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: from, to          !! [s]
    integer, intent(in) :: most
    real(wp), intent(inout) :: y(:)
    integer, intent(out) :: outcome
    integer :: attempt
    attempt = 0
    outcome = paused
    do while (self%t < to)
      if (attempt == most) return
      attempt = attempt + 1
      call controlled_step(self, m, from, to, outcome)
      if (outcome == lost) return
    end do
    call output_adaptive(self, m, to, y, outcome)
  end subroutine advance_adaptive

  !> Tries one step of the adaptive march.
  subroutine controlled_step(self, m, from, to, outcome)
    class(implicit_stepper), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: from, to          !! [s]
    integer, intent(inout) :: outcome         !! set where the solution is lost
    real(wp) :: h, error, end
    integer :: next
    logical :: at_stop, ok
    end = self%stops(size(self%stops))
    if (.not. self%h > 0.0_wp) call choose_step(self, m, to - from)
    call step_end(self%t, min(self%h, self%max_step), self%stops, next, h, self%tried, at_stop)
    call ready(self, m, h)
    if (self%tried >= to) then
      self%dense_start = self%t
      self%dense_step = h
      call full_state(self%solver, self%dense(:, 1))
      call full_rates(self%solver, self%dense(:, 2))
    end if
    call try_step(self%solver, m, self%tried, ok)
    call count_hopeless(self, end - self%t > hopeless_steps*h .and. .not. at_stop)
    error = 8.0_wp
    if (ok) call measure_step(self, m, h, error)
    if (.not. ok .or. error > 1.0_wp) then
      call undo_end(self%solver)
      self%rejected = self%rejected + 1
      if (.not. ok) self%failures = self%failures + 1
      self%h = next_step(self%memory, h, error)
      call back_to_equations(self%solver, m, self%t)
      if (self%h > max(16*spacing(self%t), 1.0e-15_wp*end) .and. self%hopeless < patience) return
      call give_up(self, m)
      if (ok) self%trouble = trouble_accuracy
      outcome = lost
      return
    end if
    call remember_error(self%solver)
    call self%norm%watch(self%trial)
    call accept(self, m, h)
    if (self%trouble /= trouble_none) then
      outcome = lost
      return
    end if
    if (self%tried >= to) then
      call full_state(self%solver, self%dense(:, 3))
      call full_rates(self%solver, self%dense(:, 4))
    end if
    if (at_stop) then                         ! cut short: the step before it goes on
      self%h = max(self%h, h)
    else
      self%h = next_step(self%memory, h, error)
    end if
    if (doubtful(self%solver) .or. abs(self%h - h) > 0.0_wp) call back_to_equations(self%solver, m, self%t)
    if (.not. self%started) self%h = 0.0_wp
  end subroutine controlled_step

  !> The estimated error of the trial step over what is allowed.
  subroutine measure_step(self, m, h, error)
    class(implicit_stepper), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: h                 !! [s]
    real(wp), intent(out) :: error            !! 1: just allowed [-]
    real(wp) :: own
    logical :: tight
    tight = self%solver%tight
    call error_vector(self%solver, m, self%tried, self%error, self%trial)
    error = self%norm%measure(self%error, self%trial, h, aim*self%tolerance)
    if (tight) then
      call own_error(self%solver, m, self%error)
      own = self%norm%measure(self%error, self%trial, h, aim*self%tolerance)
      if (nearly_dependent(m)) then
        if (error > 1.0_wp) error = min(error, own)
        own = 0.0_wp
      end if
      call compare_estimates(self%solver, error, own)
    end if
    if (.not. error < huge(1.0_wp)) error = huge(1.0_wp)
  end subroutine measure_step

  !> First step: the accelerations alone move nothing by more than a small part of its scale.
  subroutine choose_step(self, m, interval)
    class(implicit_stepper), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: interval          !! between outputs [s]
    real(wp) :: a
    self%h = min(interval, self%max_step, self%stops(size(self%stops)) - self%t)
    if (self%first_step > 0.0_wp .and. self%steps == 0) then
      self%h = min(self%first_step, self%h)
      return
    end if
    call start_method(self%solver, m, self%t, self%h, self%y)
    a = maxval(abs(self%solver%vd)*self%solver%unit)
    if (a*self%h**2 > self%tolerance) self%h = sqrt(self%tolerance/a)
  end subroutine choose_step

  !> The state at an output time within the last step, by Hermite interpolation, projected.
  subroutine output_adaptive(self, m, to, y, outcome)
    class(implicit_stepper), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: to                !! [s]
    real(wp), intent(inout) :: y(:)
    integer, intent(out) :: outcome
    real(wp) :: x, w(4)
    integer :: i
    logical :: ok
    x = (to - self%dense_start)/self%dense_step
    if (self%t <= to) x = 1.0_wp
    w = [(1 + 2*x)*(1 - x)**2, self%dense_step*x*(1 - x)**2, x**2*(3 - 2*x), -self%dense_step*x**2*(1 - x)]
    do i = 1, size(y)
      y(i) = w(1)*self%dense(i, 1) + w(2)*self%dense(i, 2) + w(3)*self%dense(i, 3) + w(4)*self%dense(i, 4)
    end do
    associate (nq => m%s%nq, nz => m%s%nz)
      m%left = .false.
      ok = sane(y)
      if (ok) then
        call evaluate(m, to, y(1:nq), y(nq + 1:2*nq), y(2*nq + 1:2*nq + nz), y(2*nq + nz + 1:2*nq + 2*nz))
        call project(m, to, y(1:nq), y(nq + 1:2*nq), y(2*nq + 1:2*nq + nz), y(2*nq + nz + 1:2*nq + 2*nz), ok)
        call evaluate_branch(m, to, y(1:nq), y(nq + 1:2*nq), y(2*nq + 1:2*nq + nz), y(2*nq + nz + 1:2*nq + 2*nz))
      end if
    end associate
    call hand_over(self, to, y, ok, outcome)
  end subroutine output_adaptive

  !> Newton iterations and factorisations, and steps that had to be divided.
  function account(self) result(text)
    class(implicit_stepper), intent(in) :: self
    character(:), allocatable :: text
    character(160) :: line
    write (line, '(a, i0, a, i0, a, i0)') 'Newton iterations: ', self%solver%iterations, &
      ', factorisations of elastic blocks: constant ', self%solver%constant_factors, ', exact ', self%solver%exact_factors
    text = trim(line)
    if (self%failures == 0) return
    write (line, '(a, i0, 2a)') '; Newton''s method failed ', self%failures, ' times, and the step was ', &
      trim(merge('tried smaller', 'halved       ', self%adaptive))
    text = text//trim(line)
  end function account

  !> Saves or restores the march.
  subroutine exchange(self, a)
    class(implicit_stepper), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    call exchange_common(self, a)
    call a%exchange(self%hopeless)
    call a%exchange(self%started)
    call a%exchange(self%fresh)
    call a%exchange(self%done)
    call a%exchange(self%failures)
    call a%exchange(self%level)
    call a%exchange(self%part)
    call a%exchange(self%h)
    call a%exchange(self%memory%worst)
    call a%exchange(self%memory%steps)
    if (self%adaptive) then
      call a%exchange(self%norm%largest)
      call a%exchange(self%dense)
      call a%exchange(self%dense_start)
      call a%exchange(self%dense_step)
    end if
    call exchange_solver(self%solver, a)
  end subroutine exchange
end module alpha_stepper
