!> Springs in linear algebra, about the present places: how small motions stretch a spring, and the generalised forces of a
!> spring that pulls. Unknowns as the coordinates, the frames' in body axes.
module spring_products
  use kinds, only: wp
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: spring_stretch, spring_push

contains

  !> Change of a spring's deformation, as a vector along it; of a bush in whatever direction; of a torsional one (turn, 0).
  pure function spring_stretch(m, k, x) result(s)
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: k
    real(wp), intent(in) :: x(:)
    real(wp) :: s(2), d(3), e(2), now, rate
    associate (sp => m%s%springs(k))
      d = place_shift(m, sp%ia, x) - place_shift(m, sp%ib, x)
      if (sp%torsional) then
        s = [d(3), 0.0_wp]
      else if (sp%every_way()) then
        s = d(1:2)
      else
        call sp%deformation(m%p, now, rate, e)
        s = dot_product(e, d(1:2))*e
      end if
    end associate
  end function spring_stretch

  !> Adds the forces of a spring pulling with s, a vector as `spring_stretch` gives it.
  pure subroutine spring_push(m, k, s, y)
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: k
    real(wp), intent(in) :: s(2)
    real(wp), intent(inout) :: y(:)
    associate (sp => m%s%springs(k))
      if (sp%torsional) then
        call place_push(m, sp%ia, [0.0_wp, 0.0_wp, s(1)], y)
        call place_push(m, sp%ib, [0.0_wp, 0.0_wp, -s(1)], y)
      else
        call place_push(m, sp%ia, [s(1), s(2), 0.0_wp], y)
        call place_push(m, sp%ib, [-s(1), -s(2), 0.0_wp], y)
      end if
    end associate
  end subroutine spring_push

  !> Displacement of a place, global, and turn of its section, from the unknowns.
  pure function place_shift(m, k, x) result(d)
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: k                   !! place
    real(wp), intent(in) :: x(:)               !! (n)
    real(wp) :: d(3), u(3)
    integer :: b, i
    d = 0.0_wp
    b = m%s%places(k)%body
    if (b == 0) return
    i = m%s%qo(b)
    u = m%s%places(k)%shift(m%p%rho(:, k), x(i + 1:i + 3), x(i + 4:i + 3 + m%s%bodies(b)%nf))
    d = [m%c(b)*u(1) - m%sn(b)*u(2), m%sn(b)*u(1) + m%c(b)*u(2), u(3)]
  end function place_shift

  !> Adds a wrench (global force, moment) on a place as generalised forces.
  pure subroutine place_push(m, k, f, y)
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: k                   !! place
    real(wp), intent(in) :: f(3)               !! [N], [N m]
    real(wp), intent(inout) :: y(:)            !! (n)
    real(wp) :: w(3)
    integer :: b, i
    b = m%s%places(k)%body
    if (b == 0) return
    i = m%s%qo(b)
    w = [m%c(b)*f(1) + m%sn(b)*f(2), m%c(b)*f(2) - m%sn(b)*f(1), f(3)]
    call m%s%places(k)%push(m%p%rho(:, k), w, y(i + 1:i + 3), y(i + 4:i + 3 + m%s%bodies(b)%nf))
  end subroutine place_push
end module spring_products
