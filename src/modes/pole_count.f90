!> How many poles lie in a part of the upper half plane that no list names: the argument principle on the determinant of T(s),
!> divided by the factors of the poles that are named and multiplied by those of the GHM terms' own. What is left has no
!> zeros where none is missing and turns so slowly along the boundary that few factorisations tell.
module pole_count
  use kinds, only: wp, pi
  use dynamic_stiffness, only: stiffness_system
  implicit none (type, external)
  private
  public :: pole_region, unnamed_poles

  integer, parameter :: most_samples = 500            !! factorisations beyond which the count is given up
  real(wp), parameter :: turn = 0.8_wp                 !! change of phase and logarithm between samples that is believed [rad]

  !> All s with inner < |s| < outer and |arg s| < angle.
  type :: pole_region
    real(wp) :: inner = 0.0_wp                         !! [1/s]
    real(wp) :: outer = 0.0_wp                         !! [1/s]
    real(wp) :: angle = 0.0_wp                         !! [rad]
  end type pole_region

contains

  !> Poles in the region that are not among the named ones.
  subroutine unnamed_poles(ds, damping, region, zeros, laws, orders, missing, ok)
    type(stiffness_system), intent(inout) :: ds
    real(wp), intent(in) :: damping                    !! 1: the damped system, 0: the undamped one [-]
    type(pole_region), intent(in) :: region
    complex(wp), intent(in) :: zeros(:)                !! named poles, one of each conjugate pair [1/s]
    complex(wp), intent(in) :: laws(:)                 !! poles of the GHM terms themselves, both of each pair [1/s]
    integer, intent(in) :: orders(:)                   !! their orders in the determinant
    integer, intent(out) :: missing                    !! of a conjugate pair, both
    logical, intent(out) :: ok                         !! false: rounding or poles at the boundary keep the count from settling
    integer, parameter :: coarse = 9, deepest = 10
    complex(wp) :: f(0:deepest + 1), left, middle
    real(wp) :: t(0:deepest + 1), from, total
    integer :: i, depth, samples
    samples = 1
    total = 0.0_wp
    left = sample(0.0_wp)
    from = 0.0_wp
    do i = 1, coarse                                   ! bisection with a stack of right ends
      depth = 1
      t(1) = 3.0_wp*i/coarse
      f(1) = sample(t(1))
      do while (depth > 0)
        middle = sample(0.5_wp*(from + t(depth)))
        if (near(left, middle) .and. near(middle, f(depth))) then
          total = total + phase(middle - left) + phase(f(depth) - middle)
          from = t(depth)
          left = f(depth)
          depth = depth - 1
        else
          ok = depth < deepest .and. samples < most_samples
          if (.not. ok) return
          t(depth + 1) = 0.5_wp*(from + t(depth))
          f(depth + 1) = middle
          depth = depth + 1
        end if
      end do
    end do
    missing = nint(total/pi)
    ok = abs(total/pi - missing) < 0.1_wp
  contains
    !> The logarithm of what is left of the determinant at a point of the boundary.
    complex(wp) function sample(at) result(value)
      real(wp), intent(in) :: at                       !! 0 to 1 outer arc, to 2 ray inward, to 3 inner arc [-]
      complex(wp) :: s
      integer :: j
      select case (int(at))
      case (0)
        s = region%outer*exp(cmplx(0.0_wp, at*region%angle, wp))
      case (1)
        s = region%outer*(region%inner/region%outer)**(at - 1.0_wp)*exp(cmplx(0.0_wp, region%angle, wp))
      case default
        s = region%inner*exp(cmplx(0.0_wp, (3.0_wp - at)*region%angle, wp))
      end select
      call ds%set(s, damping)
      call ds%factor()
      samples = samples + 1
      value = ds%solver%log_determinant()
      do j = 1, size(zeros)
        value = value - log(s - zeros(j))
        if (abs(zeros(j)%im) > 0.0_wp) value = value - log(s - conjg(zeros(j)))
      end do
      do j = 1, size(laws)
        value = value + orders(j)*log(s - laws(j))
      end do
    end function sample
  end subroutine unnamed_poles

  !> Phase of a quotient, from -pi to pi.
  pure real(wp) function phase(difference) result(angle)
    complex(wp), intent(in) :: difference              !! of logarithms [-]
    angle = difference%im - 2*pi*anint(difference%im/(2*pi))
  end function phase

  !> Whether two samples are near enough for their phase to be followed.
  pure logical function near(a, b) result(yes)
    complex(wp), intent(in) :: a, b                    !! logarithms [-]
    yes = abs(phase(b - a)) < turn .and. abs(b%re - a%re) < 4*turn
  end function near
end module pole_count
