!> The current stability bound along a run, estimated at intervals by a few Lanczos steps for three motions: the stiffest, the most
!> damped, and that which the viscoelastic terms that limit the step at the start resist most. They begin with those of the start.
!> Their Rayleigh quotients give eigenvalues. At the start the true bound is known; its ratio to the estimate is used later, too.
module step_monitor
  use kinds, only: wp, ip
  use dynamics, only: evaluate_start
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  use spectrum, only: fast_spectrum, fast_mode, only_damping, only_stiffness
  use tableaux, only: method_names
  use modal_eigenvalues, only: added_stiffness, pair_of, refine_root
  use stability_region, only: largest_step
  use step_bounds, only: bound_cause, mode_cause, step_bound, find_bound, add_mode_bound, step_of
  implicit none (type, external)
  private
  public :: stability_monitor, method_number

  integer, parameter :: most_steps = 12        !! Lanczos steps of a motion
  real(wp), parameter :: part_of_run = 0.02_wp !! of the work, for all estimates [-]
  integer, parameter :: most_often = 8         !! times as many where the bound falls towards the step
  integer(ip), parameter :: first = 4          !! accepted steps before the first

  !> A motion that is followed: the largest of p C + q K, or of the stiffness of one segment's material or spring.
  type :: followed_motion
    real(wp) :: mix(2) = 0.0_wp                !! p and q [-]
    integer :: segment = 0                     !! 0: none
    complex(wp) :: pole = 0.0_wp               !! of that segment, which limits the step at the start [1/s]
    real(wp), allocatable :: start(:)          !! (n) inertia forces of the fastest modes at the start [N]
  end type followed_motion

  !> The current bound along a run.
  type :: stability_monitor
    logical :: active = .false.
    integer :: every = 0                       !! accepted steps between estimates
    integer(ip) :: next = first                !! accepted steps at the next estimate
    real(wp) :: step = 0.0_wp                  !! of the run where it is fixed, 0: where not [s]
    real(wp) :: latest = huge(1.0_wp)          !! bound of the last estimate [s]
    integer :: steps = 0                       !! Lanczos steps of a motion
    integer :: method = 0                      !! number in method_names
    integer :: estimates = 0
    real(wp) :: pole_step = huge(1.0_wp)       !! of terms where nothing moves, whatever the configuration [s]
    real(wp) :: ratio = 1.0_wp                 !! bound at the start over that of the followed motions [-]
    real(wp) :: fastest = 0.0_wp               !! largest frequency, joints released, 0: nothing vibrates [rad/s]
    real(wp) :: smallest = huge(1.0_wp)        !! smallest current bound so far [s]
    real(wp) :: at = 0.0_wp                    !! when [s]
    character(160) :: cause = ''               !! what limited it then
    type(followed_motion), allocatable :: motions(:)
    type(fast_spectrum) :: fast
    type(fast_mode) :: mode                    !! the motion that was iterated last
  contains
    procedure :: begin => monitor_begin
    procedure :: estimate => monitor_estimate
  end type stability_monitor

contains

  !> Number of an explicit method, 0: not one.
  pure integer function method_number(method) result(k)
    character(*), intent(in) :: method
    do k = size(method_names), 1, -1
      if (method_names(k) == method) return
    end do
  end function method_number

  !> Prepares the estimates along a run.
  subroutine monitor_begin(self, m, ev, q, method)
    class(stability_monitor), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: q(:)               !! (nq) positions at the start [m, rad]
    character(*), intent(in) :: method
    type(evaluation) :: work
    type(step_bound) :: bound
    real(wp) :: lambda                         ! [rad2/s2]
    real(wp) :: followed                       ! bound of the followed motions [s]
    integer :: k
    self%method = method_number(method)
    if (self%method == 0) return
    work = ev
    call evaluate_start(m, work, q)
    call self%fast%set_up(m, ev, q)
    call self%fast%largest(m, work, .false., only_stiffness, 100, lambda)
    self%fastest = sqrt(max(lambda, 0.0_wp))
    do k = 1, size(self%fast%lin%segments)
      self%pole_step = min(self%pole_step, step_of(self%method, self%fast%lin%segments(k)%law%rates()))
    end do
    call find_bound(m, work, .true., self%fast, bound)
    allocate (self%motions(0))
    if (lambda > 0.0_wp) call follow(only_stiffness, 0)
    if (self%fast%damped) call follow(only_damping, 0)
    if (bound%cause(self%method)%segment > 0) call follow(only_stiffness, bound%cause(self%method)%segment)
    self%steps = min(most_steps, size(q))
    self%every = ceiling(size(self%motions)*(self%steps + 0.004_wp*self%steps**3)/(4*part_of_run))
    self%active = size(self%motions) > 0
    self%smallest = bound%step(self%method)
    if (self%smallest < huge(1.0_wp)) self%cause = bound%cause(self%method)%what
    if (.not. self%active) return
    followed = bound_of_motions(self, m, work)
    if (bound%cause(self%method)%controller > 0) self%pole_step = min(self%pole_step, self%smallest)   ! as at the start
    if (self%smallest < (1 - 1.0e-6_wp)*self%pole_step) self%ratio = self%smallest/followed
  contains
    !> Adds a motion without joints: at a singular start they may prevent a motion that they allow later.
    subroutine follow(mix, segment)
      real(wp), intent(in) :: mix(2)           !! [-]
      integer, intent(in) :: segment
      type(followed_motion) :: motion
      integer :: i
      call self%fast%largest(m, work, .false., mix, 100, lambda, segment)
      if (.not. lambda > 0.0_wp) return
      motion%mix = mix
      motion%segment = segment
      motion%pole = bound%mu(self%method)
      allocate (motion%start(size(q)), source=0.0_wp)
      associate (fast => self%fast)
        do i = 1, min(4, fast%steps)
          motion%start = motion%start + matmul(fast%w(:, 1:fast%steps), fast%t(1:fast%steps, fast%steps + 1 - i))
        end do
        motion%start = motion%start + 1.0e-3_wp*norm2(motion%start)/norm2(fast%start)*fast%start
      end associate
      self%motions = [self%motions, motion]
    end subroutine follow
  end subroutine monitor_begin

  !> Estimates the current bound at the state of an evaluation, and says when to do so again. Allocates nothing where the bound
  !> lies above the step.
  subroutine monitor_estimate(self, m, ev, t, steps)
    class(stability_monitor), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in) :: t                  !! [s]
    integer(ip), intent(in) :: steps           !! accepted so far
    real(wp) :: before                         ! the bound at the last estimate [s]
    self%estimates = self%estimates + 1
    before = self%latest
    associate (most => huge(1.0_wp)/max(1.0_wp, self%ratio))   ! of what nothing limits, as where all joints stick
      self%latest = min(self%ratio*min(bound_of_motions(self, m, ev), most), self%pole_step)
    end associate
    self%next = steps + interval(self, steps, before)
    if (self%latest >= self%smallest*(1 - 1.0e-9_wp)) return
    self%smallest = self%latest
    self%at = t
    if (self%latest < self%step) call name_cause(self, m, ev)
  end subroutine monitor_estimate

  !> Smallest step that the eigenvalues of the followed motions allow at the state of an evaluation [s].
  real(wp) function bound_of_motions(self, m, ev) result(h)
    class(stability_monitor), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    complex(wp) :: roots(2), guess             ! [1/s]
    integer :: k, i
    logical :: ok
    h = huge(1.0_wp)
    do k = 1, size(self%motions)
      call iterate(self, m, ev, k, ok)
      if (.not. ok) cycle
      associate (f => self%mode, segments => self%fast%lin%segments)
        roots = pair_of(f%stiffness + added_stiffness(segments, f%segments), f%damping)
        if (self%motions(k)%segment > 0) roots = self%motions(k)%pole
        do i = 1, 2
          guess = roots(i)
          call refine_root(segments, f%stiffness, f%damping, f%segments, roots(i), ok)
          if (.not. ok) roots(i) = guess
          h = min(h, largest_step(self%method, roots(i), h))
        end do
      end associate
    end do
  end function bound_of_motions

  !> A followed motion at the state of an evaluation.
  subroutine iterate(self, m, ev, k, exists)
    class(stability_monitor), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    integer, intent(in) :: k
    logical, intent(out) :: exists
    real(wp) :: lambda                         ! [rad2/s2] or [1/s]
    self%fast%start(:) = self%motions(k)%start
    call self%fast%largest(m, ev, .true., self%motions(k)%mix, self%steps, lambda, self%motions(k)%segment)
    exists = lambda > 0.0_wp
    if (exists) call self%fast%mode(m, ev, 1, self%mode)
  end subroutine iterate

  !> Says what limits the step at the state of an evaluation.
  subroutine name_cause(self, m, ev)
    class(stability_monitor), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(step_bound) :: bound
    type(bound_cause) :: cause
    integer :: k
    logical :: exists
    do k = 1, size(self%motions)
      call iterate(self, m, ev, k, exists)
      if (.not. exists) cycle
      call mode_cause(m, self%mode, cause)
      call add_mode_bound(m, self%fast, self%mode, cause, bound)
    end do
    if (bound%step(self%method) < huge(1.0_wp)) self%cause = bound%cause(self%method)%what
  end subroutine name_cause

  !> Accepted steps until the next estimate: few at first, since what bends or turns fast does so early, and where the bound
  !> would soon fall below the step.
  pure integer function interval(self, steps, before) result(n)
    class(stability_monitor), intent(in) :: self
    integer(ip), intent(in) :: steps           !! accepted so far
    real(wp), intent(in) :: before             !! the bound at the last estimate, `interval` steps ago [s]
    real(wp) :: left                           ! to the step, over the fall since then [-]
    n = int(min(int(self%every, ip), max(first, steps)))
    if (self%latest >= before .or. self%latest <= self%step) return
    left = (self%latest - self%step)/(before - self%latest)
    n = max(n/most_often, int(min(real(n, wp), 0.5_wp*n*left)), 1)
  end function interval
end module step_monitor
