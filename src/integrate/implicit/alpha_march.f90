!> The march of the generalized-alpha method that fixed and controlled steps share: its state, the method's variables for a
!> step, acceptance, starting again where loads or drives jump, what is left of a run that is lost.
module alpha_march
  use kinds, only: wp, ip
  use archive, only: value_archive
  use generalized_alpha, only: step_memory
  use alpha_newton, only: accept_step
  use alpha_start, only: start_method, change_step
  use alpha_state, only: alpha_solver, same_step, pack_state, exchange_alpha
  use second_order_system, only: second_order_ode, sensible, out_of_shape
  use ode_system, only: is_bounded
  use step_control, only: error_norm
  use summary_text, only: summary_record
  use text, only: to_text
  use time_stepper, only: stepper, exchange_common, reached, lost, trouble_size, trouble_manifold, trouble_iteration, trouble_shape
  implicit none (type, external)
  private
  public :: count_hopeless, ready, accept, hand_over, give_up

  integer, parameter, public :: patience = 20000  !! hopeless steps in a row: the run would never end

  !> A march with its state.
  type, abstract, extends(stepper), public :: alpha_steps
    real(wp) :: spectral_radius = 0.9_wp      !! [-]
    logical :: adaptive = .false.
    real(wp) :: step = 0.0_wp                 !! fixed: as written in the deck [s]
    real(wp) :: tolerance = 0.0_wp            !! adaptive [-]
    real(wp) :: first_step = 0.0_wp           !! adaptive [s], 0: chosen by the method
    real(wp) :: max_step = huge(1.0_wp)       !! adaptive [s]
    real(wp), allocatable :: stops(:)         !! times of breakpoints, ascending; the last is the end of the run [s]
    logical, allocatable :: jumps(:)          !! whether accelerations jump there
    type(alpha_solver) :: solver
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
    procedure :: exchange
    procedure :: account
  end type alpha_steps

contains

  !> Counts steps in a row from which the run would never end.
  pure subroutine count_hopeless(self, yes)
    class(alpha_steps), intent(inout) :: self
    logical, intent(in) :: yes
    self%hopeless = merge(self%hopeless + 1, 0, yes)
  end subroutine count_hopeless

  !> The method's variables for a step of size h from self%t.
  subroutine ready(self, system, h)
    class(alpha_steps), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: h                 !! [s]
    if (.not. self%started .or. (self%fresh .and. .not. same_step(self%solver, h))) then
      call start_method(self%solver, system, self%t, h, self%y)
      self%started = .true.
      self%fresh = .true.
    else if (.not. same_step(self%solver, h)) then
      call change_step(self%solver, system, self%t, h)
    end if
  end subroutine ready

  !> Accepts the trial step; where accelerations jump at its end the method starts anew from the projected state.
  subroutine accept(self, system, h)
    class(alpha_steps), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: h                 !! [s]
    integer :: k
    logical :: ok
    call accept_step(self%solver, system, self%tried)
    self%fresh = .false.
    call self%count_step(self%tried, h)
    k = system%health(self%solver%x(1:self%solver%nq), self%solver%measure%scale)
    if (k /= sensible) then
      call give_up(self)
      self%trouble = merge(trouble_shape, trouble_size, k == out_of_shape)
      return
    end if
    do k = 1, size(self%stops)
      if (.not. self%jumps(k) .or. abs(self%stops(k) - self%t) > 1.0e-9_wp*h) cycle
      call pack_state(self%solver, self%y)
      call system%report(self%t, self%y, ok)
      self%started = .false.
    end do
  end subroutine accept

  !> An output state: reached, or lost where it is not on the manifold or not finite.
  subroutine hand_over(self, to, y, ok, outcome)
    class(alpha_steps), intent(inout) :: self
    real(wp), intent(in) :: to                !! [s]
    real(wp), intent(in) :: y(:)
    logical, intent(in) :: ok                 !! whether the joints could be closed
    integer, intent(out) :: outcome
    if (ok .and. is_bounded(y)) then
      self%removed = self%solver%removed
      outcome = reached
    else
      call self%give_back(to, y, merge(trouble_manifold, trouble_size, is_bounded(y)))
      outcome = lost
    end if
  end subroutine hand_over

  !> Newton's method failed for good: the state that it left.
  subroutine give_up(self)
    class(alpha_steps), intent(inout) :: self
    associate (nq => self%solver%nq)
      call pack_state(self%solver, self%trial)
      self%trial(1:nq) = self%solver%x1(1:nq)
      self%trial(nq + 1:2*nq) = self%solver%v1(1:nq)
    end associate
    self%trouble = trouble_iteration
    self%started = .false.
  end subroutine give_up

  !> Newton iterations and factorisations, and steps that had to be divided.
  subroutine account(self, text)
    class(alpha_steps), intent(in) :: self
    type(summary_record), intent(inout) :: text
    call text%figure('  Newton iterations: ', 'newton_iterations', self%solver%iterations)
    call text%figure(', factorisations of elastic blocks: constant ', 'constant_factorisations', self%solver%factors(1))
    call text%figure(', exact ', 'exact_factorisations', self%solver%factors(2))
    call text%member('newton_failures', to_text(self%failures))
    if (self%failures > 0) call text%words%add('; Newton''s method failed '//to_text(self%failures)// &
      ' times, and the step was '//trim(merge('tried smaller', 'halved       ', self%adaptive)))
    call text%line('')
  end subroutine account

  !> Saves or restores the march.
  subroutine exchange(self, a)
    class(alpha_steps), intent(inout) :: self
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
    call exchange_alpha(self%solver, a)
  end subroutine exchange
end module alpha_march
