!> The GHM loops over neighbouring elements of one material (theory.md, section 5), on plain arrays. They stand apart from
!> the elements' own loops so that the compiler knows that their arguments do not overlap, and vectorises them.
module ghm_kernel
  use kinds, only: wp
  use body, only: body_model, ghm_run
  implicit none (type, external)
  private
  public :: advance_run, run_dissipation, run_product, copy_values

contains

  !> Dissipative accelerations of one run and its differences alpha (d - z), added to ds (theory.md, section 5).
  pure subroutine advance_run(run, n, d, z, zd, zdd, ds)
    type(ghm_run), intent(in) :: run
    integer, intent(in) :: n                !! coordinates of one term
    real(wp), intent(in) :: d(n)            !! deformations followed
    real(wp), intent(in) :: z(n, *), zd(n, *)
    real(wp), intent(inout) :: zdd(n, *), ds(n)
    real(wp) :: two_zw, w2, alpha
    integer :: k, i
    do k = 1, size(run%alpha)
      two_zw = 2*run%zeta(k)*run%omega(k)
      w2 = run%omega(k)**2
      alpha = run%alpha(k)
      do i = 1, n
        zdd(i, k) = w2*(d(i) - z(i, k)) - two_zw*zd(i, k)
        ds(i) = ds(i) + alpha*(d(i) - z(i, k))
      end do
    end do
  end subroutine advance_run

  !> y = x, as one run of memory.
  pure subroutine copy_values(n, x, y)
    integer, intent(in) :: n
    real(wp), intent(in) :: x(n)
    real(wp), intent(out) :: y(n)
    y = x
  end subroutine copy_values

  !> Power dissipated by one run, sum of (2 alpha zeta/omega) z'^T D z' [W].
  pure function run_dissipation(b, run, zd) result(power)
    type(body_model), intent(in) :: b
    type(ghm_run), intent(in) :: run
    real(wp), intent(in) :: zd(*)           !! rates of the run's dissipative coordinates
    real(wp) :: power
    integer :: k
    power = 0.0_wp
    do k = 1, size(run%alpha)
      power = power + 2*run%alpha(k)*run%zeta(k)/run%omega(k) &
              *run_product(b%nd, run%last - run%first + 1, b%factors(:, run%first:run%last), zd(1 + (k - 1)*run%width), &
                           zd(1 + (k - 1)*run%width))
    end do
  end function run_dissipation

  !> x^T D y over neighbouring elements [J].
  pure function run_product(nd, n, factors, x, y) result(total)
    integer, intent(in) :: nd, n            !! deformations of an element, elements
    real(wp), intent(in) :: factors(10, n)  !! of the elements (body_model)
    real(wp), intent(in) :: x(nd, n), y(nd, n)   !! deformations, dissipative coordinates or rates [m, rad, ...]
    real(wp) :: total, bend, stretch
    integer :: e
    bend = 0.0_wp
    stretch = 0.0_wp
    if (nd == 3) then
      do e = 1, n
        stretch = stretch + factors(8, e)*x(1, e)*y(1, e)
        bend = bend + factors(9, e)*(x(2, e)*(2*y(2, e) + y(3, e)) + x(3, e)*(y(2, e) + 2*y(3, e)))
      end do
    else
      do e = 1, n
        bend = bend + factors(9, e)*(x(1, e)*(2*y(1, e) + y(2, e)) + x(2, e)*(y(1, e) + 2*y(2, e)))
      end do
    end if
    total = stretch + 2*bend
  end function run_product
end module ghm_kernel
