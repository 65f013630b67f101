!> The loops of viscoelastic terms over neighbouring elements of one material (theory.md, section 5), on plain arrays. They stand
!> apart from the elements' own loops so that the compiler knows that their arguments do not overlap, and vectorises them.
module ghm_kernel
  use kinds, only: wp
  use body, only: body_model, viscoelastic_segment
  implicit none (type, external)
  private
  public :: advance_segment, relax_segment, segment_dissipation, segment_product, copy_values

contains

  !> Accelerations of one run's internal variables of second order and its differences alpha (d - z), added to ds.
  pure subroutine advance_segment(segment, n, d, z, zd, zdd, ds)
    type(viscoelastic_segment), intent(in) :: segment
    integer, intent(in) :: n                !! coordinates of one term
    real(wp), intent(in) :: d(n)            !! deformations followed [m, rad]
    real(wp), intent(in) :: z(n, *), zd(n, *)   !! [m, rad] and per second
    real(wp), intent(inout) :: zdd(n, *)    !! [m/s2, rad/s2]
    real(wp), intent(inout) :: ds(n)        !! [m, rad]
    real(wp) :: two_zw, w2, alpha
    integer :: k, i
    do k = 1, segment%law%second
      w2 = 1/segment%law%inertia(k)
      two_zw = segment%law%viscosity(k)*w2
      alpha = segment%law%alpha(k)
      do i = 1, n
        zdd(i, k) = w2*(d(i) - z(i, k)) - two_zw*zd(i, k)
        ds(i) = ds(i) + alpha*(d(i) - z(i, k))
      end do
    end do
  end subroutine advance_segment

  !> The same of those of first order, whose rates follow from the state.
  pure subroutine relax_segment(segment, n, d, z, zd, ds)
    type(viscoelastic_segment), intent(in) :: segment
    integer, intent(in) :: n                !! coordinates of one term
    real(wp), intent(in) :: d(n)            !! deformations followed [m, rad]
    real(wp), intent(in) :: z(n, *)         !! [m, rad]
    real(wp), intent(inout) :: zd(n, *)     !! their rates [m/s, rad/s]
    real(wp), intent(inout) :: ds(n)        !! [m, rad]
    real(wp) :: rate, alpha
    integer :: k, i
    do k = 1, segment%law%first
      rate = 1/segment%law%viscosity(segment%law%second + k)
      alpha = segment%law%alpha(segment%law%second + k)
      do i = 1, n
        zd(i, k) = rate*(d(i) - z(i, k))
        ds(i) = ds(i) + alpha*(d(i) - z(i, k))
      end do
    end do
  end subroutine relax_segment

  !> y = x, as one run of memory.
  pure subroutine copy_values(n, x, y)
    integer, intent(in) :: n
    real(wp), intent(in) :: x(n)            !! [any]
    real(wp), intent(out) :: y(n)           !! [any]
    y = x
  end subroutine copy_values

  !> Power dissipated by some of a run's terms, sum of alpha viscosity z'^T D z' [W].
  pure function segment_dissipation(b, segment, from, to, zd) result(power)
    type(body_model), intent(in) :: b
    type(viscoelastic_segment), intent(in) :: segment
    integer, intent(in) :: from, to         !! terms
    real(wp), intent(in) :: zd(*)           !! rates of their internal variables [m/s, rad/s]
    real(wp) :: power                       !! [W]
    integer :: k, o
    power = 0.0_wp
    do k = from, to
      o = 1 + (k - from)*segment%width
      power = power + segment%law%alpha(k)*segment%law%viscosity(k) &
              *segment_product(b%nd, segment%last - segment%first + 1, b%factors(:, segment%first:segment%last), zd(o), zd(o))
    end do
  end function segment_dissipation

  !> x^T D y over neighbouring elements [J].
  pure function segment_product(nd, n, factors, x, y) result(total)
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
  end function segment_product
end module ghm_kernel
