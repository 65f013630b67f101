!> Times of steps: how many make an interval, and what of a time is rounding. One rule for the deck, the histories, the integrators
!> and the summary.
module step_counts
  use kinds, only: wp, ip
  implicit none (type, external)
  private
  public :: step_count, actual_step, rounding_of, same_instant

  real(wp), parameter, public :: most_counted = 1.0e18_wp   !! steps that an integer of 64 bits counts [-]

contains

  !> Number of equal steps between two times, none longer than the given step. A ratio that differs from an integer only by
  !> rounding, of the deck's numbers or of the times, counts as that integer.
  pure integer(ip) function step_count(from, to, step) result(n)
    real(wp), intent(in) :: from, to          !! [s]
    real(wp), intent(in) :: step              !! as written in the deck [s]
    real(wp) :: ratio, slack
    ratio = min((to - from)/step, most_counted)
    slack = 1.0e-9_wp + 2*spacing(to)/(to - from)
    n = max(1_ip, ceiling(ratio*(1.0_wp - slack), ip))
  end function step_count

  !> Rounding error of a time that is a sum of steps: times that differ by no more are one [s].
  elemental function rounding_of(t) result(slack)
    real(wp), intent(in) :: t           !! [s]
    real(wp) :: slack
    slack = 16*spacing(abs(t))
  end function rounding_of

  !> Whether steps take two times for one: within half of what histories allow, so that these then see one, too.
  elemental logical function same_instant(a, b) result(yes)
    real(wp), intent(in) :: a, b        !! [s]
    yes = abs(a - b) <= 0.5_wp*rounding_of(max(abs(a), abs(b)))
  end function same_instant

  !> The fixed step in use: an output interval is an integer number of steps.
  pure real(wp) function actual_step(output_step, step) result(h)   ! [s]
    real(wp), intent(in) :: output_step       !! [s]
    real(wp), intent(in) :: step              !! as written in the deck [s]
    h = output_step/real(step_count(0.0_wp, output_step, step), wp)
  end function actual_step
end module step_counts
