!> What implicit Runge-Kutta methods see beside `second_order_system`: the equations of a stage, whose internal variables the method
!> itself solves for,
!>
!>   r(t, q, v, a, z, lambda) = 0      phi'(t, q, v) = 0      inertia z'' + viscosity z' + z = deformation(q)
!>
!> and two systems of linear equations, whose constants are those of a real and of a complex eigenvalue of the method.
module stage_system
  use kinds, only: wp
  use second_order_system, only: second_order_ode
  implicit none (type, external)
  private

  !> The system.
  type, abstract, extends(second_order_ode), public :: stage_ode
  contains
    procedure(make_stages_ready), deferred :: start_stages
    procedure(stage_residuals), deferred :: stage_residual
    procedure(stage_point), deferred :: renew_stages
    procedure(residual_parts), deferred :: take_parts
    procedure(stage_solution), deferred :: stage_correction
    procedure(complex_solution), deferred :: complex_correction
    procedure(find_deformations), deferred :: deformations
    procedure(list_laws), deferred :: internal_laws
    procedure(close_state), deferred :: close
    procedure(stage_power), deferred :: stage_powers
  end type stage_ode

  abstract interface
    !> Makes ready, after `start_implicit`.
    subroutine make_stages_ready(self)
      import :: stage_ode
      class(stage_ode), intent(inout) :: self
    end subroutine make_stages_ready
    !> Residual of motion and rates of the rows; jumps at t are not yet felt where left.
    subroutine stage_residuals(self, t, q, v, a, z, lambda, left, r, gap)
      import :: stage_ode, wp
      class(stage_ode), intent(inout) :: self
      real(wp), intent(in) :: t               !! [s]
      real(wp), intent(in), contiguous :: q(:), v(:), a(:)   !! (nq) [m, rad], rates, accelerations
      real(wp), intent(in), contiguous :: z(:)               !! (nz) [m, rad]
      real(wp), intent(in), contiguous :: lambda(:)          !! (rows) [N]
      logical, intent(in) :: left
      real(wp), intent(out), contiguous :: r(:)              !! (nq) [N, N m]
      real(wp), intent(out), contiguous :: gap(:)            !! (rows) [m/s]
    end subroutine stage_residuals
    !> Both matrices, T(c2**2, c2), at the state of the last residual, whose arguments are given again; the parts have been taken.
    subroutine stage_point(self, c2, q, v, a, lambda, whole, hold, ok)
      import :: stage_ode, wp
      class(stage_ode), intent(inout) :: self
      complex(wp), intent(in) :: c2(2)        !! a real and a complex constant [1/s]
      real(wp), intent(in), contiguous :: q(:), v(:), a(:)   !! (nq) [m, rad], rates, accelerations
      real(wp), intent(in), contiguous :: lambda(:)    !! (rows) [N]
      logical, intent(in) :: whole            !! blocks are factored with what the state adds, else as the constants leave them
      logical, intent(in) :: hold             !! rows that nearly depend on others are held back
      logical, intent(out) :: ok
    end subroutine stage_point
    !> Takes the residuals of a real and of a complex system, in the frames of the last stage's.
    subroutine residual_parts(self, r, r_complex)
      import :: stage_ode, wp
      class(stage_ode), intent(inout) :: self
      real(wp), intent(in), contiguous :: r(:)         !! (nq) [N, N m]
      complex(wp), intent(in), contiguous :: r_complex(:)   !! (nq) [N, N m]
    end subroutine residual_parts
    !> dq and dlambda with T dq + Phi_q^T dlambda = -r and Phi_q dq = -gap, by the real matrix.
    subroutine stage_solution(self, gap, dq, dlambda)
      import :: stage_ode, wp
      class(stage_ode), intent(inout) :: self
      real(wp), intent(in), contiguous :: gap(:)       !! (rows) [m]
      real(wp), intent(out), contiguous :: dq(:)       !! (nq) [m, rad]
      real(wp), intent(out), contiguous :: dlambda(:)  !! (rows) [N]
    end subroutine stage_solution
    !> The same by the complex one.
    subroutine complex_solution(self, gap, dq, dlambda)
      import :: stage_ode, wp
      class(stage_ode), intent(inout) :: self
      complex(wp), intent(in), contiguous :: gap(:)       !! (rows) [m]
      complex(wp), intent(out), contiguous :: dq(:)       !! (nq) [m, rad]
      complex(wp), intent(out), contiguous :: dlambda(:)  !! (rows) [N]
    end subroutine complex_solution
    !> The deformation that each internal variable follows.
    subroutine find_deformations(self, q, v, delta)
      import :: stage_ode, wp
      class(stage_ode), intent(inout) :: self
      real(wp), intent(in), contiguous :: q(:), v(:)   !! (nq) [m, rad] and per second
      real(wp), intent(out), contiguous :: delta(:)    !! (nz) [m, rad]
    end subroutine find_deformations
    !> Constants of the internal variables' equations.
    subroutine list_laws(self, viscosity, inertia)
      import :: stage_ode, wp
      class(stage_ode), intent(in) :: self
      real(wp), intent(out) :: viscosity(:)   !! (nz) [s]
      real(wp), intent(out) :: inertia(:)     !! (nz) 0: of first order [s2]
    end subroutine list_laws
    !> Puts positions, rates and accelerations onto the constraints, moved by reactions alone, with the real factor.
    subroutine close_state(self, t, q, v, a)
      import :: stage_ode, wp
      class(stage_ode), intent(inout) :: self
      real(wp), intent(in) :: t               !! [s]
      real(wp), intent(inout), contiguous :: q(:), v(:), a(:)   !! (nq) [m, rad], rates, accelerations
    end subroutine close_state
    !> Power dissipated and put in at a stage.
    subroutine stage_power(self, t, q, v, lambda, z, zd, power)
      import :: stage_ode, wp
      class(stage_ode), intent(inout) :: self
      real(wp), intent(in) :: t               !! [s]
      real(wp), intent(in), contiguous :: q(:), v(:)        !! (nq) [m, rad] and per second
      real(wp), intent(in), contiguous :: lambda(:)         !! (rows) [N]
      real(wp), intent(in), contiguous :: z(:), zd(:)       !! (nz) [m, rad] and per second
      real(wp), intent(out) :: power(2)       !! dissipated, put in [W]
    end subroutine stage_power
  end interface
end module stage_system
