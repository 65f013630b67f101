!> Steps of the generalized-alpha method chosen by the estimated error, with continuous output.
module alpha_adaptive
  use kinds, only: wp
  use alpha_march, only: alpha_steps, patience, count_hopeless, ready, accept, hand_over, give_up
  use generalized_alpha, only: next_step
  use alpha_error, only: error_vector, own_error, compare_estimates, doubtful, back_to_equations, remember_error
  use alpha_newton, only: try_step
  use alpha_start, only: start_method
  use alpha_state, only: pack_state, pack_rates
  use second_order_system, only: second_order_ode
  use ode_system, only: is_bounded
  use time_stepper, only: step_end, paused, lost, trouble_none, trouble_accuracy
  implicit none (type, external)
  private
  public :: advance_adaptive

  real(wp), parameter :: aim = 0.04_wp        !! local errors add up over a run: the part of the tolerance that each may take [-]
  real(wp), parameter :: hopeless_steps = 1.0e11_wp  !! to the end of the run, in every step: it would never end

contains

  !> Steps by the estimated error.
  subroutine advance_adaptive(self, system, from, to, most, y, outcome)
    class(alpha_steps), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
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
      call controlled_step(self, system, from, to, outcome)
      if (outcome == lost) return
    end do
    call output_adaptive(self, system, to, y, outcome)
  end subroutine advance_adaptive

  !> Tries one step of the adaptive march.
  subroutine controlled_step(self, system, from, to, outcome)
    class(alpha_steps), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: from, to          !! [s]
    integer, intent(inout) :: outcome         !! set where the solution is lost
    real(wp) :: h, error, end
    integer :: next
    logical :: at_stop, ok
    end = self%stops(size(self%stops))
    if (.not. self%h > 0.0_wp) call choose_step(self, system, to - from)
    call step_end(self%t, min(self%h, self%max_step), self%stops, next, h, self%tried, at_stop)
    call ready(self, system, h)
    if (self%tried >= to) then
      self%dense_start = self%t
      self%dense_step = h
      call pack_state(self%solver, self%dense(:, 1))
      call pack_rates(self%solver, self%dense(:, 2))
    end if
    call try_step(self%solver, system, self%tried, ok)
    call count_hopeless(self, end - self%t > hopeless_steps*h .and. .not. at_stop)
    error = 8.0_wp
    if (ok) call measure_step(self, system, h, error)
    if (.not. ok .or. error > 1.0_wp) then
      self%rejected = self%rejected + 1
      if (.not. ok) self%failures = self%failures + 1
      self%h = next_step(self%memory, h, error)
      call back_to_equations(self%solver, system, self%t)
      if (self%h > max(16*spacing(self%t), 1.0e-15_wp*end) .and. self%hopeless < patience) return
      call give_up(self)
      if (ok) self%trouble = trouble_accuracy
      outcome = lost
      return
    end if
    call remember_error(self%solver)
    call self%norm%watch(self%trial)
    call accept(self, system, h)
    if (self%trouble /= trouble_none) then
      outcome = lost
      return
    end if
    if (self%tried >= to) then
      call pack_state(self%solver, self%dense(:, 3))
      call pack_rates(self%solver, self%dense(:, 4))
    end if
    if (at_stop) then                         ! cut short: the step before it goes on
      self%h = max(self%h, h)
    else
      self%h = next_step(self%memory, h, error)
    end if
    if (doubtful(self%solver, system) .or. abs(self%h - h) > 0.0_wp) call back_to_equations(self%solver, system, self%t)
    if (.not. self%started) self%h = 0.0_wp
  end subroutine controlled_step

  !> The estimated error of the trial step over what is allowed.
  subroutine measure_step(self, system, h, error)
    class(alpha_steps), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: h                 !! [s]
    real(wp), intent(out) :: error            !! 1: just allowed [-]
    real(wp) :: own, pivot(2)
    logical :: tight
    tight = self%solver%error%tight
    call error_vector(self%solver, system, self%tried, self%error, self%trial)
    error = self%norm%measure(self%error, self%trial, h, aim*self%tolerance)
    if (tight) then
      call own_error(self%solver, system, self%error)
      own = self%norm%measure(self%error, self%trial, h, aim*self%tolerance)
      if (system%nearly_dependent()) then
        if (error > 1.0_wp) error = min(error, own)
        own = 0.0_wp
      end if
      pivot = system%weakest_row()
      call compare_estimates(self%solver, error, own, pivot(1))
    end if
    if (.not. error < huge(1.0_wp)) error = huge(1.0_wp)
  end subroutine measure_step

  !> First step: the accelerations alone move nothing by more than a small part of its scale.
  subroutine choose_step(self, system, interval)
    class(alpha_steps), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: interval          !! between outputs [s]
    real(wp) :: a
    self%h = min(interval, self%max_step, self%stops(size(self%stops)) - self%t)
    if (self%first_step > 0.0_wp .and. self%steps == 0) then
      self%h = min(self%first_step, self%h)
      return
    end if
    call start_method(self%solver, system, self%t, self%h, self%y)
    a = maxval(abs(self%solver%vd(1:self%solver%nq))*self%solver%measure%unit)
    if (a*self%h**2 > self%tolerance) self%h = sqrt(self%tolerance/a)
  end subroutine choose_step

  !> The state at an output time within the last step, by Hermite interpolation, projected.
  subroutine output_adaptive(self, system, to, y, outcome)
    class(alpha_steps), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
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
    ok = is_bounded(y)
    if (ok) call system%report(to, y, ok)
    call hand_over(self, to, y, ok, outcome)
  end subroutine output_adaptive
end module alpha_adaptive
