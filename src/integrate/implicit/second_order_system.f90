!> What implicit methods for second-order systems with constraints see, and no mechanics:
!>
!>   r(t, q, v, a, z, lambda) = 0      phi(t, q) = 0      z'' = f(z, z', deformations of q)
!>
!> The matrix of Newton's method stands for a step whose rates and accelerations are tied to positions, dv = c2 dq and
!> da = c1 dq. Internal variables z enter r by what their past predicts for the end of a step. The state y is q, v, z, z' and two
!> quadratures, dissipated energy and work.
module second_order_system
  use kinds, only: wp
  use ode_system, only: ode
  implicit none (type, external)
  private

  !> Why a state means nothing any more though all its numbers are finite.
  integer, parameter, public :: sensible = 0, out_of_shape = 1, out_of_turns = 2

  !> The system.
  type, abstract, extends(ode), public :: second_order_ode
    integer :: nq = 0                         !! positions
    integer :: nz = 0                         !! internal variables
    integer :: nzd = 0                        !! those of second order, the first ones; only their rates are part of the state
    integer :: rows = 0                       !! constraint rows
  contains
    procedure(make_ready), deferred :: start_implicit
    procedure(take_step), deferred :: prepare
    procedure(take_past), deferred :: predict_internal
    procedure(trial_residual), deferred :: residual
    procedure(trial_tangent), deferred :: renew
    procedure(solve_correction), deferred :: correction
    procedure(end_internal), deferred :: internal_increments
    procedure(find_powers), deferred :: powers
    procedure(find_product), deferred :: mass_product
    procedure(evaluate_state), deferred :: accelerations
    procedure(report_state), deferred :: report
    procedure(smooth_start), deferred :: smooth
    procedure(find_gaps), deferred :: gaps
    procedure(find_slopes), deferred :: slopes
    procedure(close_gaps), deferred :: along_rows
    procedure(filter_pair), deferred :: resolve
    procedure(list_measures), deferred :: measures
    procedure(judge_rows), deferred :: weakest_row
    procedure(measure_reach), deferred :: reach
    procedure(judge_state), deferred :: health
    procedure(count_factors), deferred :: factors
  end type second_order_ode

  abstract interface
    !> Makes ready: sets nq, nz, nzd, rows.
    subroutine make_ready(self)
      import :: second_order_ode
      class(second_order_ode), intent(inout) :: self
    end subroutine make_ready
    !> Takes the constants c1, c2 of a step and factors what depends on them alone; ok is false where that fails.
    subroutine take_step(self, c1, c2, ok)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      real(wp), intent(in) :: c1              !! da/dq [1/s2]
      real(wp), intent(in) :: c2              !! dv/dq [1/s]
      logical, intent(out) :: ok
    end subroutine take_step
    !> Takes the internal variables that their values at the start of the step predict for its end.
    subroutine take_past(self, z, zd, zdd)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      real(wp), intent(in), contiguous :: z(:), zd(:), zdd(:)   !! (nz) [m, rad] and per second
    end subroutine take_past
    !> Residuals at a trial state, kept in the system; jumps at t are not yet felt where left.
    subroutine trial_residual(self, t, q, v, a, lambda, left_limit)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      real(wp), intent(in) :: t               !! [s]
      real(wp), intent(in), contiguous :: q(:), v(:), a(:)   !! (nq) [m, rad], rates, accelerations
      real(wp), intent(in), contiguous :: lambda(:)          !! (rows) [N]
      logical, intent(in) :: left_limit
    end subroutine trial_residual
    !> The matrix at the state of the last residual; exact: every term renewed, else only those that cost little. Rows that are
    !> nearly dependent are held back where hold asks for it.
    subroutine trial_tangent(self, t, q, v, a, lambda, exact, hold, ok)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      real(wp), intent(in) :: t               !! [s]
      real(wp), intent(in), contiguous :: q(:), v(:), a(:)   !! (nq) [m, rad], rates, accelerations
      real(wp), intent(in), contiguous :: lambda(:)          !! (rows) [N]
      logical, intent(in) :: exact, hold
      logical, intent(out) :: ok
    end subroutine trial_tangent
    !> The corrections that the last residual asks for, by the matrix that stands.
    subroutine solve_correction(self, dq, dlambda)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      real(wp), intent(out), contiguous :: dq(:)        !! (nq) [m, rad]
      real(wp), intent(out), contiguous :: dlambda(:)   !! (rows) [N]
    end subroutine solve_correction
    !> What internal variables move by from their predictions to the end of a step, whose positions are final.
    subroutine end_internal(self, q, v, z, zd, zdd, dz)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      real(wp), intent(in), contiguous :: q(:), v(:)            !! (nq) [m, rad], rates
      real(wp), intent(in), contiguous :: z(:), zd(:), zdd(:)   !! (nz) predictions [m, rad] and per second
      real(wp), intent(out), contiguous :: dz(:)                !! (nz) [m, rad]
    end subroutine end_internal
    !> Power dissipated and put in at the end of a step.
    subroutine find_powers(self, t, q, v, lambda, z, zd, power)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      real(wp), intent(in) :: t               !! [s]
      real(wp), intent(in), contiguous :: q(:), v(:)        !! (nq) [m, rad] and per second
      real(wp), intent(in), contiguous :: lambda(:)         !! (rows) [N]
      real(wp), intent(in), contiguous :: z(:), zd(:)       !! (nz) [m, rad] and per second
      real(wp), intent(out) :: power(2)       !! dissipated, put in [W]
    end subroutine find_powers
    !> x1^T M x2 + x3^T M x4 of q and z, and x1^T C x4 of z of first order, with the masses at the positions q, where the last
    !> powers were asked for.
    function find_product(self, q, x) result(product)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      real(wp), intent(in), contiguous :: q(:)      !! (nq) [m, rad]
      real(wp), intent(in), contiguous :: x(:, :)   !! (nq + nz, 4) [any]
      real(wp) :: product                           !! [J] for rates
    end function find_product
    !> Accelerations that the equations give at a state, multipliers and powers. At the end of a step jumps at t are not felt yet,
    !> rates are put onto the constraints first, by the matrix that stands; where rows are nearly dependent, positions too, and
    !> the accelerations are those of the branch of motion.
    subroutine evaluate_state(self, t, q, v, z, zd, end_of_step, a, lambda, powers)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      real(wp), intent(in) :: t               !! [s]
      real(wp), intent(in), contiguous :: q(:), v(:), z(:)   !! (nq), (nz) [m, rad] and per second
      real(wp), intent(inout), contiguous :: zd(:)   !! (nz) [m/s, rad/s]; of first order: set
      logical, intent(in) :: end_of_step
      real(wp), intent(out), contiguous :: a(:)        !! (nq + nz) [m/s2, rad/s2]
      real(wp), intent(out), contiguous :: lambda(:)   !! (rows) [N]
      real(wp), intent(out) :: powers(2)      !! dissipated, put in [W]
    end subroutine evaluate_state
    !> Puts a state onto the constraints and evaluates it there.
    subroutine report_state(self, t, y, ok)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      real(wp), intent(in) :: t               !! [s]
      real(wp), intent(inout), contiguous :: y(:)      !! (n) q, v, z, z' [m, rad], [m/s, rad/s], quadratures [J]
      logical, intent(out) :: ok
    end subroutine report_state
    !> Accelerations that a step resolves: what of a it can follow, within the constraints. Renews the matrix at the state.
    subroutine smooth_start(self, t, q, v, lambda, a, ok)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      real(wp), intent(in) :: t               !! [s]
      real(wp), intent(in), contiguous :: q(:), v(:), lambda(:)   !! (nq), (rows) [m, rad], rates, [N]
      real(wp), intent(inout), contiguous :: a(:)                 !! (nq + nz) [m/s2, rad/s2]
      logical, intent(out) :: ok
    end subroutine smooth_start
    !> First and second derivatives of all rows, at positions q, rates v and accelerations a.
    subroutine find_gaps(self, t, q, v, a, rate, acceleration)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      real(wp), intent(in) :: t               !! [s]
      real(wp), intent(in), contiguous :: q(:), v(:), a(:)      !! (nq) [m, rad], rates, accelerations
      real(wp), intent(out), contiguous :: rate(:)              !! (rows) [m/s]
      real(wp), intent(out), contiguous :: acceleration(:)      !! (rows) [m/s2]
    end subroutine find_gaps
    !> Phi_q x, the derivative of all rows along x, at the positions of the last call of `gaps`.
    subroutine find_slopes(self, q, x, slope)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      real(wp), intent(in), contiguous :: q(:)          !! (nq) these positions [m, rad]
      real(wp), intent(in), contiguous :: x(:)          !! (nq) [any]
      real(wp), intent(out), contiguous :: slope(:)     !! (rows) [any]
    end subroutine find_slopes
    !> dq with Phi_q dq = -gap, moved by reactions of the rows alone, by the matrix in use.
    subroutine close_gaps(self, q, gap, dq)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      real(wp), intent(in), contiguous :: q(:)          !! (nq) positions at which the rows were looked at [m, rad]
      real(wp), intent(in), contiguous :: gap(:)        !! (rows) [m] and its derivatives
      real(wp), intent(out), contiguous :: dq(:)        !! (nq) [m, rad] and theirs
    end subroutine close_gaps
    !> Filters two vectors: parts of motion much faster than the step resolves are taken out.
    subroutine filter_pair(self, x, y)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      real(wp), intent(inout), contiguous :: x(:), y(:)   !! (nq + nz) [any]
    end subroutine filter_pair
    !> Groups in which positions are measured, metres or radians of a unit, the scene's size or one radian, and the smallest size
    !> of a group; whether a group's size grows with its values.
    subroutine list_measures(self, group, weight, whole, scale, grows)
      import :: second_order_ode, wp
      class(second_order_ode), intent(in) :: self
      integer, allocatable, intent(out) :: group(:)     !! (nq)
      real(wp), allocatable, intent(out) :: weight(:)   !! (nq) [m or rad a unit]
      real(wp), allocatable, intent(out) :: whole(:)    !! (nq) weight over the scene's size or one radian [-]
      real(wp), allocatable, intent(out) :: scale(:)    !! (groups) [m, rad]
      logical, allocatable, intent(out) :: grows(:)     !! (groups)
    end subroutine list_measures
    !> The least pivot of the matrix's rows, 1 where none depends on others, and what is added to hold them [-].
    pure function judge_rows(self) result(pivot)
      import :: second_order_ode, wp
      class(second_order_ode), intent(in) :: self
      real(wp) :: pivot(2)                    !! [-]
    end function judge_rows
    !> How far from the origin the state of the last residual is, in scene sizes, or how far it has turned: rounding follows both.
    pure function measure_reach(self, q) result(x)
      import :: second_order_ode, wp
      class(second_order_ode), intent(in) :: self
      real(wp), intent(in), contiguous :: q(:)   !! (nq) [m, rad]
      real(wp) :: x                           !! at least 1 [-]
    end function measure_reach
    !> Whether a state, whose groups have reached these sizes, is still one of a mechanism.
    pure function judge_state(self, q, scale) result(what)
      import :: second_order_ode, wp
      class(second_order_ode), intent(in) :: self
      real(wp), intent(in), contiguous :: q(:)       !! (nq) [m, rad]
      real(wp), intent(in), contiguous :: scale(:)   !! (groups) [m, rad]
      integer :: what                         !! sensible, out_of_shape, out_of_turns
    end function judge_state
    !> Factorisations of constant and of whole elastic blocks so far; sets them after a restart.
    subroutine count_factors(self, constant, whole, put)
      use kinds, only: ip
      import :: second_order_ode
      class(second_order_ode), intent(inout) :: self
      integer(ip), intent(inout) :: constant, whole
      logical, intent(in) :: put
    end subroutine count_factors
  end interface
end module second_order_system
