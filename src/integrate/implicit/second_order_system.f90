!> What implicit methods for second-order systems with constraints see, and no mechanics:
!>
!>   r(t, q, v, a, z, lambda) = 0      phi(t, q) = 0      inertia z'' + viscosity z' + z = deformation(q)
!>
!> The matrix of Newton's method stands for a step whose rates and accelerations are tied to positions, dv = c2 dq and
!> da = c1 dq; a method of several stages solves with a real and a complex one, T(c2**2, c2), for the eigenvalues of its
!> coefficients. The method itself solves the equations of the internal variables z: it tells the system what they are at zero
!> deformation. The last of them may be linear states instead, z' = A z + f(t, q, v). The state y is q, v, z, z' and two
!> quadratures, dissipated energy and work.
module second_order_system
  use kinds, only: wp
  use ode_system, only: ode
  use position_measures, only: position_measure
  implicit none (type, external)
  private

  !> The system. What `start_implicit` sets stays as it is; the last three belong to the last matrix of a single stage.
  type, abstract, extends(ode), public :: second_order_ode
    integer :: nq = 0                         !! positions
    integer :: nz = 0                         !! internal variables
    integer :: nzd = 0                        !! those of second order, the first ones; only their rates are part of the state
    integer :: linear = 0                     !! linear states, the last of the internal variables
    integer :: rows = 0                       !! constraint rows
    integer :: quadratures = 2                !! integrals of powers at the end of the state: dissipated, put in, and others
    logical :: fine = .false.                 !! small errors of positions are large in the forces: no Newton error is too small
    integer :: blocks = 0                     !! blocks that `prepare` factors, and `renew` where it is exact
    real(wp), allocatable :: viscosity(:)     !! (nz) of the internal variables' equations [s]
    real(wp), allocatable :: inertia(:)       !! (nz) 0: of first order [s2]
    type(position_measure) :: measure         !! how positions are measured, before the first step
    real(wp) :: weakest = 1.0_wp              !! least pivot of the matrix's rows, 1 where none depends on others [-]
    real(wp) :: shift = 0.0_wp                !! what is added to hold them [-]
    real(wp) :: reach = 1.0_wp                !! distance from the origin in scene sizes, or angle: rounding follows both [-]
  contains
    procedure(make_ready), deferred :: start_implicit
    procedure(take_step), deferred :: prepare
    procedure(take_offsets), deferred :: give_internal
    procedure(trial_residual), deferred :: residual
    procedure(trial_tangent), deferred :: renew
    procedure(solve_correction), deferred :: correction
    procedure(stage_residuals), deferred :: stage_residual
    procedure(residual_parts), deferred :: take_parts
    procedure(stage_point), deferred :: renew_stages
    procedure(complex_solution), deferred :: complex_correction
    procedure(find_deformations), deferred :: deformations
    procedure(solve_states), deferred :: solve_linear
    procedure(find_powers), deferred :: powers
    procedure(find_product), deferred :: mass_product
    procedure(evaluate_state), deferred :: accelerations
    procedure(report_state), deferred :: report
    procedure(smooth_start), deferred :: smooth
    procedure(find_gaps), deferred :: gaps
    procedure(close_gaps), deferred :: along_rows
  end type second_order_ode

  abstract interface
    !> Makes ready, for a method of several stages or for one of a single stage: sets the components.
    subroutine make_ready(self, stages)
      import :: second_order_ode
      class(second_order_ode), intent(inout) :: self
      logical, intent(in) :: stages
    end subroutine make_ready
    !> Takes the constants c1, c2 of a step and factors what depends on them alone; ok is false where that fails. Factors that stand
    !> for constants so near serve again, with slightly slower iterations; residuals follow the constants in any case.
    subroutine take_step(self, c1, c2, near, ok)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      real(wp), intent(in) :: c1              !! da/dq [1/s2]
      real(wp), intent(in) :: c2              !! dv/dq [1/s]
      real(wp), intent(in) :: near            !! of c1; 0: none serve again [-]
      logical, intent(out) :: ok
    end subroutine take_step
    !> Takes the internal variables of residuals to come: what their past makes of them at zero deformation; of linear states
    !> c2 z - z' of the method's prediction, or where stages are given them, the states.
    subroutine take_offsets(self, z)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      real(wp), intent(in), contiguous :: z(:)   !! (nz) [m, rad]
    end subroutine take_offsets
    !> Residuals of motion at a trial state, kept in the system, and the rows' values; jumps at t are not yet felt where left.
    subroutine trial_residual(self, t, q, v, a, lambda, left_limit, gap)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      real(wp), intent(in) :: t               !! [s]
      real(wp), intent(in), contiguous :: q(:), v(:), a(:)   !! (nq) [m, rad], rates, accelerations
      real(wp), intent(in), contiguous :: lambda(:)          !! (rows) [N]
      logical, intent(in) :: left_limit
      real(wp), intent(out), contiguous :: gap(:)            !! (rows) [m]
    end subroutine trial_residual
    !> The matrix at the state of the last residual; exact: every term renewed, else only those that cost little. Rows that are
    !> nearly dependent are held back where hold asks for it.
    subroutine trial_tangent(self, q, v, a, lambda, exact, hold, ok)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      real(wp), intent(in), contiguous :: q(:), v(:), a(:)   !! (nq) [m, rad], rates, accelerations
      real(wp), intent(in), contiguous :: lambda(:)          !! (rows) [N]
      logical, intent(in) :: exact, hold
      logical, intent(out) :: ok
    end subroutine trial_tangent
    !> dq and dlambda with T dq + Phi_q^T dlambda = -r and Phi_q dq = -gap, r the last residual, by the matrix that stands.
    subroutine solve_correction(self, gap, dq, dlambda)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      real(wp), intent(in), contiguous :: gap(:)        !! (rows) [m]
      real(wp), intent(out), contiguous :: dq(:)        !! (nq) [m, rad]
      real(wp), intent(out), contiguous :: dlambda(:)   !! (rows) [N]
    end subroutine solve_correction
    !> Residual of motion and rates of the rows; jumps at t are not yet felt where left.
    subroutine stage_residuals(self, t, q, v, a, z, lambda, left, r, gap)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      real(wp), intent(in) :: t               !! [s]
      real(wp), intent(in), contiguous :: q(:), v(:), a(:)   !! (nq) [m, rad], rates, accelerations
      real(wp), intent(in), contiguous :: z(:)               !! (nz) [m, rad]
      real(wp), intent(in), contiguous :: lambda(:)          !! (rows) [N]
      logical, intent(in) :: left
      real(wp), intent(out), contiguous :: r(:)              !! (nq) [N, N m]
      real(wp), intent(out), contiguous :: gap(:)            !! (rows) [m/s]
    end subroutine stage_residuals
    !> Takes the residuals of a real and of a complex system, in the frames of the last stage's.
    subroutine residual_parts(self, r, r_complex)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      real(wp), intent(in), contiguous :: r(:)         !! (nq) [N, N m]
      complex(wp), intent(in), contiguous :: r_complex(:)   !! (nq) [N, N m]
    end subroutine residual_parts
    !> Both matrices at the state of the last residual, whose arguments are given again; the parts have been taken.
    subroutine stage_point(self, c2, q, v, a, lambda, whole, hold, ok)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      complex(wp), intent(in) :: c2(2)        !! a real and a complex constant [1/s]
      real(wp), intent(in), contiguous :: q(:), v(:), a(:)   !! (nq) [m, rad], rates, accelerations
      real(wp), intent(in), contiguous :: lambda(:)    !! (rows) [N]
      logical, intent(in) :: whole            !! blocks are factored with what the state adds, else as the constants leave them
      logical, intent(in) :: hold             !! rows that nearly depend on others are held back
      logical, intent(out) :: ok
    end subroutine stage_point
    !> As `correction`, by the complex matrix.
    subroutine complex_solution(self, gap, dq, dlambda)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      complex(wp), intent(in), contiguous :: gap(:)       !! (rows) [m]
      complex(wp), intent(out), contiguous :: dq(:)       !! (nq) [m, rad]
      complex(wp), intent(out), contiguous :: dlambda(:)  !! (rows) [N]
    end subroutine complex_solution
    !> The deformation that each internal variable follows, f of linear states; jumps at t are not yet felt.
    subroutine find_deformations(self, t, q, v, delta)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      real(wp), intent(in) :: t               !! [s]
      real(wp), intent(in), contiguous :: q(:), v(:)   !! (nq) [m, rad] and per second
      real(wp), intent(out), contiguous :: delta(:)    !! (nz) [m, rad]
    end subroutine find_deformations
    !> Solves (c - A) y = x of the linear states.
    subroutine solve_states(self, c, x)
      import :: second_order_ode, wp
      class(second_order_ode), intent(in) :: self
      complex(wp), intent(in) :: c            !! [1/s]
      complex(wp), intent(inout) :: x(:)      !! (linear) [any], then [any s]
    end subroutine solve_states
    !> Power dissipated and put in at the end of a step or stage.
    subroutine find_powers(self, t, q, v, lambda, z, zd, power)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      real(wp), intent(in) :: t               !! [s]
      real(wp), intent(in), contiguous :: q(:), v(:)        !! (nq) [m, rad] and per second
      real(wp), intent(in), contiguous :: lambda(:)         !! (rows) [N]
      real(wp), intent(in), contiguous :: z(:), zd(:)       !! (nz) [m, rad] and per second
      real(wp), intent(out) :: power(:)       !! (quadratures) [W]
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
    !> Accelerations that the equations give at a state, multipliers and powers. At the end of a step jumps at t are not felt yet;
    !> where rows are nearly dependent, the state is put onto the constraints first, and the accelerations are those of the branch
    !> of motion.
    subroutine evaluate_state(self, t, q, v, z, zd, end_of_step, a, lambda, powers)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      real(wp), intent(in) :: t               !! [s]
      real(wp), intent(in), contiguous :: q(:), v(:), z(:)   !! (nq), (nz) [m, rad] and per second
      real(wp), intent(inout), contiguous :: zd(:)   !! (nz) [m/s, rad/s]; of first order: set
      logical, intent(in) :: end_of_step
      real(wp), intent(out), contiguous :: a(:)        !! (nq + nz) [m/s2, rad/s2]
      real(wp), intent(out), contiguous :: lambda(:)   !! (rows) [N]
      real(wp), intent(out) :: powers(:)      !! (quadratures) [W]
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
      real(wp), intent(inout), contiguous :: a(:)                 !! (nq) [m/s2, rad/s2]
      logical, intent(out) :: ok
    end subroutine smooth_start
    !> All rows, their first and second derivatives and, where there is room, their rates by u alone, at positions q, rates v and
    !> accelerations a.
    subroutine find_gaps(self, t, q, v, a, u, gap)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      real(wp), intent(in) :: t               !! [s]
      real(wp), intent(in), contiguous :: q(:), v(:), a(:), u(:)   !! (nq) [m, rad], rates, accelerations, [any]
      real(wp), intent(out), contiguous :: gap(:, 0:)        !! (rows, 0:2 or 0:3) [m], [m/s], [m/s2], [any]
    end subroutine find_gaps
    !> dq and dlambda with T dq + Phi_q^T dlambda = 0 and Phi_q dq = -gap, by the matrix in use, for each column of gaps.
    subroutine close_gaps(self, q, gap, dq, dlambda)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      real(wp), intent(in), contiguous :: q(:)          !! (nq) positions at which the rows were looked at [m, rad]
      real(wp), intent(in), contiguous :: gap(:, :)        !! (rows, columns) [m] and its derivatives
      real(wp), intent(out), contiguous :: dq(:, :)        !! (nq, columns) [m, rad] and theirs
      real(wp), intent(out), contiguous :: dlambda(:, :)   !! (rows, columns) [N] and theirs
    end subroutine close_gaps
  end interface
end module second_order_system
