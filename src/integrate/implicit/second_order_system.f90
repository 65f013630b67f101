!> The system of implicit methods: of second order, with constraints. No mechanics:
!>
!>   r(t, q, v, a, z, lambda) = 0      phi(t, q) = 0      inertia z'' + viscosity z' + z = deformation(q)
!>
!> The matrix of Newton's method stands for a step whose rates and accelerations are tied to positions, dv = c2 dq and
!> da = c1 dq. A method of several stages solves with a real and a complex one, T(c2**2, c2), for the eigenvalues of its
!> coefficients. The method itself solves the equations of the internal variables z: the system gets their values at zero
!> deformation. The last of them may be linear states instead, z' = A z + f(t, q, v). The state y is q, v, z, z' and quadratures:
!> dissipated energy, work, and others.
module second_order_system
  use kinds, only: wp
  use ode_system, only: ode
  implicit none (type, external)
  private

  real(wp), parameter, public :: near_length = 0.02_wp   !! matrices of lengths so near serve again while an event is located [-]
  real(wp), parameter, public :: full_block_contraction = 0.1_wp   !! above which elastic blocks that are exact pay [-]
  integer, parameter, public :: full_block_steps = 50   !! with exact blocks before constant ones are tried again

  !> The system. What `start_implicit` sets stays as it is; the last five belong to the last matrices.
  type, abstract, extends(ode), public :: second_order_ode
    integer :: nq = 0                         !! positions
    integer :: nz = 0                         !! internal variables
    integer :: nzd = 0                        !! those of second order, the first ones; only their rates are part of the state
    integer :: linear = 0                     !! linear states, the last of the internal variables
    integer :: rows = 0                       !! constraint rows
    integer :: quadratures = 2                !! integrals of powers at the end of the state: dissipated, put in, and others
    integer :: blocks = 0                     !! blocks that `prepare` factors, and `renew` where it is exact
    real(wp), allocatable :: viscosity(:)     !! (nz) of the internal variables' equations [s]
    real(wp), allocatable :: inertia(:)       !! (nz) 0: of first order [s2]
    real(wp) :: least_pivot = 1.0_wp          !! of the constraint rows: 1 where none depends on others [-]
    logical :: weak_rows = .false.            !! that pivot is so small that rows count as nearly dependent
    real(wp) :: shift = 0.0_wp                !! added to their diagonal to regularise dependent rows [-]
    real(wp) :: enlargement = 1.0_wp          !! of rounding by nearly dependent rows; 0: below what matters [-]
    real(wp) :: rounding_scale = 1.0_wp       !! of positions: distance from the origin in scene sizes, or largest angle [-]
  contains
    procedure(make_ready), deferred :: start_implicit
    procedure(take_constants), deferred :: prepare
    procedure(find_residual), deferred :: residual
    procedure(make_matrix), deferred :: renew
    procedure(solve_correction), deferred :: correction
    procedure(solve_complex), deferred :: complex_correction
    procedure(solve_gaps), deferred :: gap_correction
    procedure(find_gaps), deferred :: gaps
    procedure(find_deformations), deferred :: deformations
    procedure(solve_states), deferred :: solve_linear
    procedure :: linear_part
    procedure(find_powers), deferred :: powers
    procedure(find_product), deferred :: mass_product
    procedure(evaluate_state), deferred :: accelerations
    procedure(smooth_start), deferred :: smooth
  end type second_order_ode

  abstract interface
    !> Makes ready, for a method of several stages or for one of a single stage: sets the components.
    subroutine make_ready(self, stages)
      import :: second_order_ode
      class(second_order_ode), intent(inout) :: self
      logical, intent(in) :: stages
    end subroutine make_ready
    !> Takes the constants of a step, a real one and for several stages a complex one besides, and factors what depends on them
    !> alone; ok is false where that fails. For a single stage factors of constants so near serve again, with slightly slower
    !> iterations; residuals follow the constants in any case.
    subroutine take_constants(self, c1, c2, near, ok)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      complex(wp), intent(in) :: c1(:)        !! da/dq [1/s2]
      complex(wp), intent(in) :: c2(:)        !! dv/dq [1/s]
      real(wp), intent(in) :: near            !! of c1; 0: none serve again [-]
      logical, intent(out) :: ok
    end subroutine take_constants
    !> Residual of motion at a trial state, and values of the rows, for several stages their rates. The internal variables z are
    !> those at zero deformation (of linear states c2 z - z' of the method's prediction), for several stages those of the stage.
    subroutine find_residual(self, t, q, v, a, z, lambda, left_limit, r, gap)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      real(wp), intent(in) :: t               !! [s]
      real(wp), intent(in), contiguous :: q(:), v(:), a(:)   !! (nq) [m, rad], rates, accelerations
      real(wp), intent(in), contiguous :: z(:)               !! (nz) [m, rad]
      real(wp), intent(in), contiguous :: lambda(:)          !! (rows) [N]
      logical, intent(in) :: left_limit       !! jumps of the loads at t do not act yet
      real(wp), intent(out), contiguous :: r(:)              !! (nq) [N, N m]
      real(wp), intent(out), contiguous :: gap(:)            !! (rows) [m] or [m/s]
    end subroutine find_residual
    !> The matrices at the state of the last residual, whose arguments are given again. The residuals r of the next corrections are
    !> solved at the same time.
    subroutine make_matrix(self, q, v, a, lambda, exact, regularise, ok, r, r_complex)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      real(wp), intent(in), contiguous :: q(:), v(:), a(:)   !! (nq) [m, rad], rates, accelerations
      real(wp), intent(in), contiguous :: lambda(:)          !! (rows) [N]
      logical, intent(in) :: exact            !! every term is renewed, else only those that cost little
      logical, intent(in) :: regularise       !! rows that nearly depend on others are regularised
      logical, intent(out) :: ok
      real(wp), intent(in), contiguous :: r(:)               !! (nq) [N, N m]
      complex(wp), intent(in), contiguous, optional :: r_complex(:)   !! (nq) for several stages [N, N m]
    end subroutine make_matrix
    !> dq and dlambda with T dq + Phi_q^T dlambda = -r and Phi_q dq = -gap, by the real matrix, in the frames of the last residual.
    !> What redundant rows leave open of the multipliers is held at a value that the method says, else rounding would add up in it.
    subroutine solve_correction(self, r, gap, dq, dlambda)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      real(wp), intent(in), contiguous :: r(:)          !! (nq) [N, N m]
      real(wp), intent(in), contiguous :: gap(:)        !! (rows) [m]
      real(wp), intent(out), contiguous :: dq(:)        !! (nq) [m, rad]
      real(wp), intent(inout), contiguous :: dlambda(:)   !! (rows) multipliers over that value, then their correction [N]
    end subroutine solve_correction
    !> The same by the complex matrix.
    subroutine solve_complex(self, r, gap, dq, dlambda)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      complex(wp), intent(in), contiguous :: r(:)         !! (nq) [N, N m]
      complex(wp), intent(in), contiguous :: gap(:)       !! (rows) [m]
      complex(wp), intent(out), contiguous :: dq(:)       !! (nq) [m, rad]
      complex(wp), intent(inout), contiguous :: dlambda(:)  !! (rows) [N]
    end subroutine solve_complex
    !> The deformation that each internal variable follows, f of linear states; jumps at t do not act yet.
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
    !> Accelerations that the equations give at a state, multipliers and powers. Loads that jump at t act.
    subroutine evaluate_state(self, t, q, v, z, zd, a, lambda, powers)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      real(wp), intent(in) :: t               !! [s]
      real(wp), intent(in), contiguous :: q(:), v(:), z(:)   !! (nq), (nz) [m, rad] and per second
      real(wp), intent(inout), contiguous :: zd(:)   !! (nz) [m/s, rad/s]; of first order: set
      real(wp), intent(out), contiguous :: a(:)        !! (nq + nz) [m/s2, rad/s2]
      real(wp), intent(out), contiguous :: lambda(:)   !! (rows) [N]
      real(wp), intent(out) :: powers(:)      !! (quadratures) [W]
    end subroutine evaluate_state
    !> Accelerations that a step can follow, in place of those of the equations, within the constraints. Renews the matrix.
    subroutine smooth_start(self, t, q, v, z, lambda, a, ok)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      real(wp), intent(in) :: t               !! [s]
      real(wp), intent(in), contiguous :: q(:), v(:), lambda(:)   !! (nq), (rows) [m, rad], rates, [N]
      real(wp), intent(in), contiguous :: z(:)                    !! (nz) as `residual` takes them [m, rad]
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
    subroutine solve_gaps(self, q, gap, dq, dlambda)
      import :: second_order_ode, wp
      class(second_order_ode), intent(inout) :: self
      real(wp), intent(in), contiguous :: q(:)          !! (nq) positions at which the rows were looked at [m, rad]
      real(wp), intent(in), contiguous :: gap(:, :)        !! (rows, columns) [m] and its derivatives
      real(wp), intent(out), contiguous :: dq(:, :)        !! (nq, columns) [m, rad] and theirs
      real(wp), intent(out), contiguous :: dlambda(:, :)   !! (rows, columns) [N] and theirs
    end subroutine solve_gaps
  end interface

contains

  !> (c2 - A)^-1 x of linear states.
  function linear_part(self, c2, x) result(y)
    class(second_order_ode), intent(in) :: self
    real(wp), intent(in) :: c2               !! [1/s]
    real(wp), intent(in) :: x(:)             !! (linear) [any/s]
    real(wp) :: y(size(x))                   !! [any]
    complex(wp) :: z(size(x))
    z = x
    call self%solve_linear(cmplx(c2, 0.0_wp, wp), z)
    y = real(z, wp)
  end function linear_part
end module second_order_system
