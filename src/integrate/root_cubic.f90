!> Cubics by their values and slopes at 0 and 1: where they fall or dip.
module root_cubic
  use kinds, only: wp
  implicit none (type, external)
  private
  public :: cubic_fall, possible_dip

contains

  !> Where a cubic first falls below zero, whose values at 0 and 1 are g >= 0 and g < 0, its slopes there d.
  pure real(wp) function cubic_fall(g, d) result(x)   ! [-]
    real(wp), intent(in) :: g(0:1), d(0:1)    !! [any]
    real(wp) :: c(0:3), low, high, turns(2)
    integer :: i
    c = coefficients(g, d)
    call extremes(c, turns)
    low = 0.0_wp
    high = 1.0_wp
    do i = 1, 2                               ! the first falling part between extremes
      if (turns(i) <= low .or. turns(i) >= 1.0_wp) cycle
      high = turns(i)
      if (value(c, high) < 0.0_wp) exit
      low = high
      high = 1.0_wp
    end do
    do i = 1, 60
      x = 0.5_wp*(low + high)
      if (value(c, x) >= 0.0_wp) then
        low = x
      else
        high = x
      end if
    end do
    if (.not. low > 0.0_wp) x = 0.0_wp
  end function cubic_fall

  !> Where a cubic that is not negative at 0 and 1 has a minimum so low that it may be negative; 2: nowhere.
  pure real(wp) function possible_dip(g, d, tolerance) result(x)   ! [-]
    real(wp), intent(in) :: g(0:1), d(0:1)    !! [any]
    real(wp), intent(in) :: tolerance         !! [any]
    real(wp) :: c(0:3), turns(2), least, depth
    integer :: i
    x = 2.0_wp
    c = coefficients(g, d)
    call extremes(c, turns)
    do i = 1, 2
      if (turns(i) <= 0.0_wp .or. turns(i) >= 1.0_wp) cycle
      if (2*c(2) + 6*c(3)*turns(i) < 0.0_wp) cycle   ! a maximum
      least = value(c, turns(i))
      depth = min(g(0), g(1)) - least
      if (depth > tolerance .and. least < depth) x = turns(i)
    end do
  end function possible_dip

  !> Coefficients of a cubic by its values and slopes at 0 and 1 [any].
  pure function coefficients(g, d) result(c)
    real(wp), intent(in) :: g(0:1), d(0:1)    !! [any]
    real(wp) :: c(0:3)
    c = [g(0), d(0), 3*(g(1) - g(0)) - 2*d(0) - d(1), 2*(g(0) - g(1)) + d(0) + d(1)]
  end function coefficients

  !> A cubic's value [any].
  pure real(wp) function value(c, x)
    real(wp), intent(in) :: c(0:3), x         !! [any], [-]
    value = c(0) + x*(c(1) + x*(c(2) + x*c(3)))
  end function value

  !> Where a cubic's slope is zero, ascending; -1: nowhere [-].
  pure subroutine extremes(c, x)
    real(wp), intent(in) :: c(0:3)            !! [any]
    real(wp), intent(out) :: x(2)             !! [-]
    real(wp) :: root, q
    x = -1.0_wp
    root = c(2)**2 - 3*c(1)*c(3)
    if (root < 0.0_wp) return
    q = -(c(2) + sign(sqrt(root), c(2)))
    if (abs(q) > 0.0_wp) x(1) = c(1)/q
    if (abs(c(3)) > 0.0_wp) x(2) = q/(3*c(3))
    if (x(1) > x(2)) x = x([2, 1])
  end subroutine extremes
end module root_cubic
