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
  real(wp), parameter :: turn = 0.8_wp                 !! error of a foreseen phase and logarithm that is believed [rad]
  real(wp), parameter :: small = 1.0e-5_wp             !! step of log s for a slope [-]

  !> All s with inner < |s| < outer and |arg s| < angle.
  type :: pole_region
    real(wp) :: inner = 0.0_wp                         !! [1/s]
    real(wp) :: outer = 0.0_wp                         !! [1/s]
    real(wp) :: angle = 0.0_wp                         !! [rad]
  end type pole_region

  !> A point of the boundary.
  type :: sample
    real(wp) :: t = 0.0_wp                             !! where on it [-]
    complex(wp) :: z = (0.0_wp, 0.0_wp)                !! log s [-]
    complex(wp) :: f = (0.0_wp, 0.0_wp)                !! logarithm of what is left of the determinant [-]
    complex(wp) :: slope = (0.0_wp, 0.0_wp)            !! df/dz [-]
  end type sample

contains

  !> Poles in the region that are not among the named ones. The path is bisected until the logarithm of what is left of the
  !> determinant follows from its slope: many far poles, which turn it fast but evenly, cost nothing more.
  subroutine unnamed_poles(ds, damping, region, zeros, laws, orders, missing, ok)
    type(stiffness_system), intent(inout) :: ds
    real(wp), intent(in) :: damping                    !! 1: the damped system, 0: the undamped one [-]
    type(pole_region), intent(in) :: region
    complex(wp), intent(in) :: zeros(:)                !! named poles, one of each conjugate pair [1/s]
    complex(wp), intent(in) :: laws(:)                 !! poles of the GHM terms themselves, both of each pair [1/s]
    integer, intent(in) :: orders(:)                   !! their orders in the determinant
    integer, intent(out) :: missing                    !! of a conjugate pair, both
    logical, intent(out) :: ok                         !! false: rounding or poles at the boundary keep the count from settling
    integer, parameter :: coarse = 3, deepest = 13
    type(sample) :: at(0:deepest + 1), left, middle
    real(wp) :: total
    integer :: i, depth, samples
    complex(wp) :: whole
    samples = 0
    total = 0.0_wp
    left = taken(0.0_wp)
    do i = 1, coarse                                   ! bisection with a stack of right ends
      depth = 1
      at(1) = taken(3.0_wp*i/coarse)
      do while (depth > 0)
        middle = taken(0.5_wp*(left%t + at(depth)%t))
        whole = rise(left, at(depth))
        if (abs(rise(left, middle) + rise(middle, at(depth)) - whole) < turn .and. believed(left, middle) .and. &
            believed(middle, at(depth))) then
          total = total + followed(left, middle) + followed(middle, at(depth))
          left = at(depth)
          depth = depth - 1
        else
          ok = depth < deepest .and. samples < most_samples
          if (.not. ok) return
          at(depth + 1) = middle
          depth = depth + 1
        end if
      end do
    end do
    missing = nint(total/pi)
    ok = abs(total/pi - missing) < 0.1_wp
  contains
    !> What is left of the determinant at a point of the boundary.
    type(sample) function taken(t)
      real(wp), intent(in) :: t                        !! 0 to 1 outer arc, to 2 ray inward, to 3 inner arc [-]
      taken%t = t
      taken%z = log(region%outer) + min(max(t - 1.0_wp, 0.0_wp), 1.0_wp)*log(region%inner/region%outer) &
                + (0.0_wp, 1.0_wp)*region%angle*min(t, 1.0_wp, 3.0_wp - t)
      taken%f = logarithm(exp(taken%z))
      taken%slope = (logarithm(exp(taken%z + small)) - taken%f)
      taken%slope%im = phase(taken%slope)
      taken%slope = taken%slope/small
      samples = samples + 2
    end function taken

    !> The logarithm of what is left of the determinant.
    complex(wp) function logarithm(s) result(value)
      complex(wp), intent(in) :: s                     !! [1/s]
      integer :: j
      call ds%set(s, damping)
      call ds%factor()
      value = ds%solver%log_determinant()
      do j = 1, size(zeros)
        value = value - log(s - zeros(j))
        if (abs(zeros(j)%im) > 0.0_wp) value = value - log(s - conjg(zeros(j)))
      end do
      do j = 1, size(laws)
        value = value + orders(j)*log(s - laws(j))
      end do
    end function logarithm
  end subroutine unnamed_poles

  !> By how much the logarithm rises from one sample to the next, by its slopes.
  pure complex(wp) function rise(a, b)
    type(sample), intent(in) :: a, b
    rise = 0.5_wp*(a%slope + b%slope)*(b%z - a%z)
  end function rise

  !> Whether two samples are near enough for the logarithm to be followed.
  pure logical function believed(a, b) result(yes)
    type(sample), intent(in) :: a, b
    complex(wp) :: error
    error = b%f - a%f - rise(a, b)
    yes = abs(phase(error)) < turn .and. abs(error%re) < turn
  end function believed

  !> By how much the phase turns from one sample to the next.
  pure real(wp) function followed(a, b) result(angle)
    type(sample), intent(in) :: a, b
    complex(wp) :: expected
    expected = rise(a, b)
    angle = expected%im + phase(b%f - a%f - expected)
  end function followed

  !> Phase of a quotient, from -pi to pi.
  pure real(wp) function phase(difference) result(angle)
    complex(wp), intent(in) :: difference              !! of logarithms [-]
    angle = difference%im - 2*pi*anint(difference%im/(2*pi))
  end function phase
end module pole_count
