!> The equations of one stage of an implicit Runge-Kutta method: residual of motion and of the joints' rates with the internal
!> variables given, and the corrections by a factored stage matrix (`stage_matrix`).
module stage_equations
  use kinds, only: wp
  use dynamics, only: set_frames, marker_kinematics, constraint_values, row_rates
  use evaluation_settings, only: evaluation_options
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  use newton_start, only: row_gaps
  use newton_system, only: newton_matrix
  use stage_matrix, only: stage_terms, stage_factor, set_up_stage_terms, fill_stage_terms, set_up_factor, factor_stage
  implicit none (type, external)
  private
  public :: set_up_stages, stage_residual, renew_terms, factor_stages, solve_stage, close_rows, stage_kinematics

  !> M, C, K and the two factors that a method with one real and one pair of complex eigenvalues needs.
  type, public :: stage_solver
    type(stage_terms) :: terms
    type(stage_factor) :: factor(2)          !! of the real and of the complex constant
  end type stage_solver

contains

  !> Work space of a mechanism.
  subroutine set_up_stages(self, newton, m, ev)
    type(stage_solver), intent(out) :: self
    type(newton_matrix), intent(inout) :: newton
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    call set_up_stage_terms(self%terms, newton, m, ev)
    call set_up_factor(self%factor(1), self%terms, m)
    self%factor(2) = self%factor(1)
  end subroutine set_up_stages

  !> The last residual in global axes, and rates of the rows there.
  subroutine stage_residual(newton, m, ev, q, r, gap)
    type(newton_matrix), intent(inout) :: newton
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in), contiguous :: q(:)               !! (nq) its positions [m, rad]
    real(wp), intent(out), contiguous :: r(:)              !! (nq) [N, N m]
    real(wp), intent(out), contiguous :: gap(:)            !! (rows) [m/s]
    integer :: b, i
    newton%q = q
    call row_rates(m, ev, gap)
    do b = 1, size(newton%b)
      i = m%s%qo(b)
      associate (eq => newton%b(b)%eq)
        r(i + 1) = ev%frame%cos(b)*eq%frame(1) - ev%frame%sin(b)*eq%frame(2)
        r(i + 2) = ev%frame%sin(b)*eq%frame(1) + ev%frame%cos(b)*eq%frame(2)
        r(i + 3) = eq%frame(3)
        if (eq%n > 0) r(i + 4:i + 3 + eq%n) = eq%elastic(1:eq%n)
      end associate
    end do
  end subroutine stage_residual

  !> M, C and K at the state of the last residual.
  subroutine renew_terms(self, newton, m, ev, t, v, a, lambda)
    type(stage_solver), intent(inout) :: self
    type(newton_matrix), intent(inout) :: newton
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in) :: t                !! [s]
    real(wp), intent(in), contiguous :: v(:), a(:)   !! (nq) [m/s, rad/s] and accelerations
    real(wp), intent(in), contiguous :: lambda(:)    !! (rows) [N]
    call fill_stage_terms(self%terms, newton, m, ev, t, v, a, lambda)
  end subroutine renew_terms

  !> Both factors.
  subroutine factor_stages(self, newton, c2, hold)
    type(stage_solver), intent(inout) :: self
    type(newton_matrix), intent(in) :: newton
    complex(wp), intent(in) :: c2(2)         !! [1/s]
    logical, intent(in) :: hold              !! rows that nearly depend on others are held back
    integer :: k
    do k = 1, 2
      call factor_stage(self%factor(k), self%terms, newton, c2(k), hold)
    end do
  end subroutine factor_stages

  !> dq and dlambda with T dq + Phi_q^T dlambda = -r and Phi_q dq = -gap, frames' origins turned into the axes that the bodies have
  !> in the last residual.
  subroutine solve_stage(f, m, ev, r, gap, dq, dlambda)
    type(stage_factor), intent(inout) :: f
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    complex(wp), intent(in) :: r(:)          !! (nq) [N, N m]
    complex(wp), intent(in) :: gap(:)        !! (rows) [m]
    complex(wp), intent(out) :: dq(:)        !! (nq) [m, rad]
    complex(wp), intent(out) :: dlambda(:)   !! (rows) [N]
    integer :: b, i, n
    n = size(r)
    f%x(1:n) = -r
    f%x(n + 1:) = -gap
    do b = 1, size(ev%frame%cos)
      i = m%s%qo(b)
      f%x(i + 1) = -(ev%frame%cos(b)*r(i + 1) + ev%frame%sin(b)*r(i + 2))
      f%x(i + 2) = -(ev%frame%cos(b)*r(i + 2) - ev%frame%sin(b)*r(i + 1))
    end do
    call f%solver%solve(f%x, .false.)
    dq = f%x(1:n)
    dlambda = f%x(n + 1:)
    do b = 1, size(ev%frame%cos)
      i = m%s%qo(b)
      dq(i + 1) = ev%frame%cos(b)*f%x(i + 1) - ev%frame%sin(b)*f%x(i + 2)
      dq(i + 2) = ev%frame%sin(b)*f%x(i + 1) + ev%frame%cos(b)*f%x(i + 2)
    end do
  end subroutine solve_stage

  !> Puts positions, then rates, then accelerations onto the constraints, by the real factor: what it moves in is in balance with
  !> stiff forces.
  subroutine close_rows(self, m, ev, options, t, q, v, a)
    type(stage_solver), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(evaluation_options), intent(in) :: options
    real(wp), intent(in) :: t                !! [s]
    real(wp), intent(inout), contiguous :: q(:), v(:), a(:)   !! (nq) [m, rad], rates, accelerations
    real(wp) :: rate(self%terms%rows), acceleration(self%terms%rows)
    if (self%terms%rows == 0) return
    call stage_kinematics(m, ev, options, t, q, v)
    call close(ev%rows%phi, q)
    call stage_kinematics(m, ev, options, t, q, v)
    call row_rates(m, ev, rate)
    call close(rate, v)
    call row_gaps(m, ev, t, q, v, a, rate, acceleration)
    call close(acceleration, a)
  contains
    !> Moves x by what closes a gap.
    subroutine close(gap, x)
      real(wp), intent(in) :: gap(:)         !! (rows) [m] or its derivatives
      real(wp), intent(inout) :: x(:)        !! (nq) [m, rad] or theirs
      complex(wp) :: r(size(x)), dx(size(x)), force(size(gap))
      r = 0.0_wp
      call solve_stage(self%factor(1), m, ev, r, cmplx(gap, 0.0_wp, wp), dx, force)
      x = x + real(dx, wp)
    end subroutine close
  end subroutine close_rows

  !> Markers and rows at a stage; their rates in time are not those of the last residual.
  subroutine stage_kinematics(m, ev, options, t, q, v)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(evaluation_options), intent(in) :: options
    real(wp), intent(in) :: t                !! [s]
    real(wp), intent(in), contiguous :: q(:), v(:)        !! (nq) [m, rad] and per second
    ev%options = options
    call set_frames(m, ev, q)
    call marker_kinematics(m, ev, q, v)
    call constraint_values(m, ev, options, t)
  end subroutine stage_kinematics
end module stage_equations
