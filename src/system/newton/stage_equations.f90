!> What a method of several stages needs besides the equations of a single one: the elastic blocks for a real and a complex
!> constant, and the tangent for the complex one.
module stage_equations
  use kinds, only: wp
  use body_tangents, only: find_tangents
  use complex_condensed_system, only: complex_matrix => condensed_matrix
  use complex_elastic_columns, only: factor_complex => factor_blocks
  use complex_newton_condensation, only: add_tangent
  use evaluation_results, only: evaluation
  use elastic_columns, only: factor_blocks
  use mechanism, only: mechanism_model
  use newton_system, only: newton_matrix
  implicit none (type, external)
  private
  public :: factor_stages, complex_tangents

contains

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

  !> The complex T(c2**2, c2) at the state of the last residual.
  subroutine complex_tangents(t, newton, m, ev, q, v, a)
    type(complex_matrix), intent(inout) :: t
    type(newton_matrix), intent(inout) :: newton
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in), contiguous :: q(:), v(:), a(:)   !! (nq) [m, rad], rates, accelerations
    integer :: b
    call find_tangents(m, ev, newton%wrench, ev%action, t%c1%re, t%c2%re, 1.0_wp, q, v, a, newton%eq)
    do b = 1, size(newton%eq)
      call add_tangent(t%b(b), newton%eq(b), (1.0_wp, 0.0_wp), .true.)
    end do
    call find_tangents(m, ev, newton%wrench, ev%action, t%c1%im, t%c2%im, 0.0_wp, q, v, a, newton%eq)
    do b = 1, size(newton%eq)
      call add_tangent(t%b(b), newton%eq(b), (0.0_wp, 1.0_wp), .false.)
    end do
  end subroutine complex_tangents
end module stage_equations
