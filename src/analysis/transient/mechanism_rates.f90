!> The mechanism as first-order equations. State: q, v, z, z' (of second order), dissipated energy, work, energies lost in elements
!> that switch (layout in `scene_model`).
module mechanism_rates
  use kinds, only: wp, ip
  use dynamics, only: motion_state
  use evaluation_results, only: evaluation, powers_of
  use evaluation_settings, only: at_side, evaluation_options
  use mechanism, only: mechanism_model
  use ode_system, only: is_bounded, largest_value
  use projection, only: project
  use second_order_system, only: second_order_ode
  use singular, only: evaluate_branch
  implicit none (type, external)
  private

  !> A state whose evaluation may still stand.
  type :: seen_state
    real(wp) :: t = 0.0_wp                    !! [s]
    logical :: left_limit = .false.
    real(wp), allocatable :: y(:)             !! (ny) [m, rad], [m/s, rad/s], [J]
    integer(ip) :: evaluation = -1            !! its number
  end type seen_state

  !> The system, without its events and what implicit methods need.
  type, abstract, extends(second_order_ode), public :: moving_mechanism
    type(mechanism_model) :: m                !! constant once assembled
    type(evaluation) :: ev                    !! its last evaluation
    type(evaluation_options) :: options       !! what acts in the present analysis
    type(seen_state), private :: seen         !! of an evaluation that looked for events
  contains
    procedure :: evaluate_state
    procedure :: forget
    procedure :: rates                        !! of the state with other options
    procedure :: derivative
    procedure :: project => mechanism_project
    procedure :: motion_at
  end type moving_mechanism

contains

  !> Rates of the whole state (theory.md, sections 3 to 6).
  subroutine derivative(self, t, y, left_limit, dy)
    class(moving_mechanism), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(in), contiguous :: y(:)   !! (ny) [m, rad], [m/s, rad/s], [J]
    logical, intent(in) :: left_limit
    real(wp), intent(out), contiguous :: dy(:)   !! (ny) [the same per second]
    call self%rates(at_side(self%options, left_limit), t, y, dy)
  end subroutine derivative

  !> The same with other options.
  subroutine rates(self, options, t, y, dy)
    class(moving_mechanism), intent(inout) :: self
    type(evaluation_options), intent(in) :: options
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(in), contiguous :: y(:)   !! (ny) [m, rad], [m/s, rad/s], [J]
    real(wp), intent(out), contiguous :: dy(:)   !! (ny) [the same per second]
    associate (m => self%m, ev => self%ev, nq => self%m%s%nq, nz => self%m%s%nz, nzd => self%m%s%nzd)
      if (.not. stands(self, options, t, y)) then
        ev%broken = .false.
        call evaluate_branch(m, ev, options, t, y(1:nq), y(nq + 1:2*nq), y(2*nq + 1:2*nq + nz), y(2*nq + nz + 1:2*nq + nz + nzd))
      end if
      dy(1:nq) = y(nq + 1:2*nq)
      dy(nq + 1:2*nq) = ev%a
      if (ev%broken) dy(nq + 1:2*nq) = 10*largest_value       ! no acceleration: whoever uses it sees that it is lost
      dy(2*nq + 1:2*nq + nzd) = y(2*nq + nz + 1:2*nq + nz + nzd)
      dy(2*nq + nzd + 1:2*nq + nz) = ev%zdd(nzd + 1:)
      dy(2*nq + nz + 1:2*nq + nz + nzd) = ev%zdd(1:nzd)
      call powers_of(m, ev, dy(2*nq + nz + nzd + 1:))
    end associate
  end subroutine rates

  !> Evaluates a state that rates may be asked for next, unless they have just been.
  subroutine evaluate_state(self, t, y, left_limit)
    class(moving_mechanism), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(in), contiguous :: y(:)   !! (ny) [m, rad], [m/s, rad/s], [J]
    logical, intent(in) :: left_limit
    associate (nq => self%m%s%nq, nz => self%m%s%nz, nzd => self%m%s%nzd, seen => self%seen)
      call evaluate_branch(self%m, self%ev, at_side(self%options, left_limit), t, y(1:nq), y(nq + 1:2*nq), &
                           y(2*nq + 1:2*nq + nz), y(2*nq + nz + 1:2*nq + nz + nzd))
      if (.not. allocated(seen%y)) allocate (seen%y(size(y)))
      seen%y(:) = y
      seen%t = t
      seen%left_limit = left_limit
      seen%evaluation = self%ev%evaluations
    end associate
  end subroutine evaluate_state

  !> The last evaluation stands no longer: something other than the state has changed, or its results have been overwritten.
  subroutine forget(self)
    class(moving_mechanism), intent(inout) :: self
    self%seen%evaluation = -1
  end subroutine forget

  !> Whether the last evaluation was of this state.
  pure logical function stands(self, options, t, y) result(yes)
    class(moving_mechanism), intent(in) :: self
    type(evaluation_options), intent(in) :: options
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(in), contiguous :: y(:)   !! (ny) [m, rad], [m/s, rad/s], [J]
    associate (seen => self%seen)
      yes = seen%evaluation == self%ev%evaluations .and. (seen%left_limit .eqv. options%left_limit)
      if (yes) yes = .not. (self%ev%broken .or. abs(seen%t - t) > 0.0_wp)
      if (yes) yes = .not. any(abs(seen%y - y) > 0.0_wp)
    end associate
  end function stands

  !> Projects an accepted state, from the side of the last evaluation; refuses states that are not finite.
  subroutine mechanism_project(self, t, y, ok)
    class(moving_mechanism), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(inout), contiguous :: y(:)   !! (ny) [m, rad], [m/s, rad/s], [J]
    logical, intent(out) :: ok
    ok = is_bounded(y) .and. .not. self%ev%broken
    if (.not. ok .or. .not. self%has_manifold) return
    call self%forget()
    associate (ev => self%ev, nq => self%m%s%nq, nz => self%m%s%nz, nzd => self%m%s%nzd)
      call project(self%m, ev, ev%options, t, y(1:nq), y(nq + 1:2*nq), y(2*nq + 1:2*nq + nz), &
                   y(2*nq + nz + 1:2*nq + nz + nzd), ok)
      if (ok) ok = is_bounded(y(1:2*nq))
    end associate
  end subroutine mechanism_project

  !> The parts of a state.
  pure type(motion_state) function motion_at(self, t, y) result(at)
    class(moving_mechanism), intent(in) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(in) :: y(:)            !! (ny) [m, rad], [m/s, rad/s], [J]
    associate (nq => self%m%s%nq, nz => self%m%s%nz, nzd => self%m%s%nzd)
      at = motion_state(self%options, t, y(1:nq), y(nq + 1:2*nq), y(2*nq + 1:2*nq + nz), y(2*nq + nz + 1:2*nq + nz + nzd))
    end associate
  end function motion_at
end module mechanism_rates
