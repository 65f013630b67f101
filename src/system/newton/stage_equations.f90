!> The equations of one stage of an implicit Runge-Kutta method: residual of motion and of the joints' rates with the internal
!> variables given, and the dynamic stiffness for a real and for a complex constant.
module stage_equations
  use kinds, only: wp
  use body_tangents, only: find_tangents
  use complex_condensed_system, only: complex_matrix => condensed_matrix
  use complex_elastic_columns, only: factor_complex => factor_blocks
  use complex_newton_condensation, only: add_complex => add_tangent
  use dynamics, only: row_rates
  use evaluation_results, only: evaluation
  use elastic_columns, only: factor_blocks
  use mechanism, only: mechanism_model
  use newton_condensation, only: add_tangent
  use newton_system, only: newton_matrix
  implicit none (type, external)
  private
  public :: stage_residual, factor_stages, stage_tangents

contains

  !> The last residual in global axes, and rates of the rows there.
  subroutine stage_residual(newton, m, ev, r, gap)
    type(newton_matrix), intent(in) :: newton
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    real(wp), intent(out), contiguous :: r(:)              !! (nq) [N, N m]
    real(wp), intent(out), contiguous :: gap(:)            !! (rows) [m/s]
    integer :: b, i
    call row_rates(m, ev, gap)
    do b = 1, size(newton%eq)
      i = m%s%qo(b)
      associate (eq => newton%eq(b))
        r(i + 1) = ev%frame%cos(b)*eq%frame(1) - ev%frame%sin(b)*eq%frame(2)
        r(i + 2) = ev%frame%sin(b)*eq%frame(1) + ev%frame%cos(b)*eq%frame(2)
        r(i + 3) = eq%frame(3)
        if (eq%n > 0) r(i + 4:i + 3 + eq%n) = eq%elastic(1:eq%n)
      end associate
    end do
  end subroutine stage_residual

  !> Takes a real and a complex constant: elastic blocks of both matrices anew where the constants are.
  subroutine factor_stages(t, newton, m, c2, bad)
    type(complex_matrix), intent(inout) :: t
    type(newton_matrix), intent(inout) :: newton
    type(mechanism_model), intent(in) :: m
    complex(wp), intent(in) :: c2(2)         !! [1/s]
    logical, intent(out) :: bad
    bad = .false.
    if (.not. abs(t%c2 - c2(2)) > 0.0_wp) return
    call factor_blocks(newton%t, m, newton%terms, real(c2(1)**2, wp), real(c2(1), wp), bad)
    if (.not. bad) call factor_complex(t, m, newton%terms, c2(2)**2, c2(2), bad)
    if (bad) t%c2 = 0.0_wp
  end subroutine factor_stages

  !> T(c2**2, c2) of both constants at the state of the last residual.
  subroutine stage_tangents(t, newton, m, ev, q, v, a)
    type(complex_matrix), intent(inout) :: t
    type(newton_matrix), intent(inout) :: newton
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in), contiguous :: q(:), v(:), a(:)   !! (nq) [m, rad], rates, accelerations
    integer :: b
    call find_tangents(m, ev, newton%wrench, ev%action, newton%t%c1, newton%t%c2, 1.0_wp, q, v, a, newton%eq)
    do b = 1, size(newton%eq)
      call add_tangent(newton%t%b(b), newton%eq(b), 1.0_wp, .true.)
    end do
    call find_tangents(m, ev, newton%wrench, ev%action, t%c1%re, t%c2%re, 1.0_wp, q, v, a, newton%eq)
    do b = 1, size(newton%eq)
      call add_complex(t%b(b), newton%eq(b), (1.0_wp, 0.0_wp), .true.)
    end do
    call find_tangents(m, ev, newton%wrench, ev%action, t%c1%im, t%c2%im, 0.0_wp, q, v, a, newton%eq)
    do b = 1, size(newton%eq)
      call add_complex(t%b(b), newton%eq(b), (0.0_wp, 1.0_wp), .false.)
    end do
  end subroutine stage_tangents
end module stage_equations
