!> The current stability bound along a run: estimated again now and then by a few Lanczos steps that start from the fastest
!> modes of the start; whatever does not depend on the configuration (GHM poles) is kept.
module step_monitor
  use kinds, only: wp, ip
  use archive, only: value_archive
  use deck_records, only: deck
  use dynamics, only: evaluate
  use evaluation_settings, only: usual_options
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  use spectrum, only: fast_spectrum, only_stiffness
  use spring_directions, only: bound_directions
  use tableaux, only: method_names
  use step_bounds, only: step_bound, find_bound, material_poles
  implicit none (type, external)
  private
  public :: stability_monitor, method_number

  !> The current bound along a run, estimated again now and then (less than 2 % of the run's work).
  type :: stability_monitor
    logical :: active = .false.
    integer :: every = 0                       !! accepted steps between estimates
    integer :: steps = 0                       !! Lanczos steps of an estimate
    integer :: method = 0                      !! number in method_names
    integer :: estimates = 0
    real(wp) :: pole_step = huge(1.0_wp)       !! what does not depend on the configuration [s]
    real(wp) :: mode_step = huge(1.0_wp)       !! of the fastest mode at the start [s]
    real(wp) :: start_lambda = 0.0_wp          !! its squared frequency [rad2/s2]
    real(wp) :: fastest = 0.0_wp               !! largest frequency, joints released, 0: nothing vibrates [rad/s]
    real(wp) :: smallest = huge(1.0_wp)        !! smallest current bound so far [s]
    real(wp) :: at = 0.0_wp                    !! when [s]
    real(wp) :: covered = 0.0_wp               !! largest squared frequency that the safe bound assumes [rad2/s2]
    real(wp) :: least = huge(1.0_wp)           !! step at that frequency [s]
    type(fast_spectrum) :: fast
  contains
    procedure :: begin => monitor_begin
    procedure :: look => monitor_look
    procedure :: until_next
    procedure :: exchange => monitor_exchange
  end type stability_monitor

contains

  !> Number of an explicit method, 0: not one.
  pure function method_number(method) result(k)
    character(*), intent(in) :: method
    integer :: k
    do k = size(method_names), 1, -1
      if (method_names(k) == method) return
    end do
  end function method_number

  !> Prepares the estimates along a run: the start vector joins the fastest modes of the start.
  subroutine monitor_begin(self, d, m, ev, q, method)
    class(stability_monitor), intent(inout) :: self
    type(deck), intent(in) :: d
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: q(:)               !! (nq) positions at the start [m, rad]
    character(*), intent(in) :: method
    type(evaluation) :: work
    type(step_bound) :: bound, poles
    real(wp), allocatable :: rest(:), none(:), force(:)
    complex(wp) :: mu
    self%method = method_number(method)
    if (self%method == 0) return
    work = ev
    allocate (rest(size(q)), none(m%s%nz), force(size(q)), source=0.0_wp)
    call evaluate(m, work, usual_options(m%s), 0.0_wp, q, rest, none, none)
    call self%fast%set_up(m, ev, q)
    call find_bound(d, m, work, .false., self%fast, bound, self%start_lambda, force)
    self%fastest = sqrt(max(self%start_lambda, 0.0_wp))
    if (.not. self%start_lambda > 0.0_wp) return
    call bound_directions(m, work, self%fast%ends)
    call self%fast%largest(m, work, .false., only_stiffness, 100, self%covered)
    self%fast%ends = -1.0_wp
    mu = bound%mu(self%method)
    self%mode_step = bound%step(self%method)
    call material_poles(d, m, work, .false., self%fast, self%start_lambda, poles)
    self%pole_step = poles%step(self%method)
    if (bound%cause(self%method)%segment > 0) then
      self%mode_step = huge(1.0_wp)
      self%pole_step = bound%step(self%method)
    end if
    self%fast%start = force + 1.0e-3_wp*norm2(force)/norm2(self%fast%start)*self%fast%start
    self%steps = min(12, size(q))
    self%every = ceiling((self%steps + 0.004_wp*self%steps**3)/0.08_wp)
    self%active = self%mode_step < huge(1.0_wp) .and. abs(mu) > 0.0_wp
    if (self%active) self%least = self%mode_step*sqrt(self%start_lambda/self%covered)
    if (.not. self%active) self%smallest = self%pole_step
  end subroutine monitor_begin

  !> Accepted steps until the next estimate: at first at powers of two, since what bends or turns fast does so early.
  pure integer function until_next(self, steps) result(n)
    class(stability_monitor), intent(in) :: self
    integer(ip), intent(in) :: steps           !! accepted so far
    integer :: next
    next = 4
    do while (next <= steps .and. next < self%every)
      next = 2*next
    end do
    next = min(next, self%every)
    n = int(next - steps)
    if (steps >= self%every) n = self%every - int(mod(steps, int(self%every, ip)))
  end function until_next

  !> Estimates the current bound at the state of an evaluation.
  subroutine monitor_look(self, m, ev, t)
    class(stability_monitor), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in) :: t                  !! [s]
    real(wp) :: lambda, h
    if (.not. self%active) return
    call self%fast%largest(m, ev, .true., only_stiffness, self%steps, lambda)
    self%estimates = self%estimates + 1
    h = self%mode_step
    if (lambda > 0.0_wp) h = self%mode_step*sqrt(self%start_lambda/lambda)
    h = min(h, self%pole_step)
    if (h >= self%smallest) return
    self%smallest = h
    self%at = t
  end subroutine monitor_look

  !> Saves or restores what the estimates have found.
  subroutine monitor_exchange(self, a)
    class(stability_monitor), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    call a%exchange(self%estimates)
    call a%exchange(self%smallest)
    call a%exchange(self%at)
  end subroutine monitor_exchange

end module step_monitor
