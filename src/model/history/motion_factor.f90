!> Factors of loads that are made of histories of several motions, or of motions and time: sums, products and switches. What
!> follows a motion is watched by elements of their own (`motion_watch`), which give value and slope.
module motion_factor
  use kinds, only: wp
  use history, only: breakpoint, history_model, merged
  implicit none (type, external)
  private

  integer, parameter, public :: of_time = 1, of_motion = 2, is_sum = 3, is_product = 4, is_switch = 5

  !> A history, or what is made of others, which stand behind it.
  type, public :: factor_node
    integer :: kind = of_time
    class(history_model), allocatable :: history   !! of time
    integer :: watch = 0                           !! number of the watch, of a motion or a switch
    integer, allocatable :: parts(:)
    real(wp), allocatable :: factors(:)            !! of a sum's parts [-]
  end type factor_node

  !> The first node is the factor.
  type, public :: motion_factor_model
    type(factor_node), allocatable :: nodes(:)
    integer, allocatable :: arguments(:)           !! watches of the histories of motion, in the order of their nodes
  contains
    procedure :: evaluate
    procedure :: breakpoints
  end type motion_factor_model

contains

  !> Its value, and its derivatives by what the watches of its arguments see: from the whole to the parts.
  pure subroutine evaluate(self, t, left_limit, signals, any_value, value, slopes)
    class(motion_factor_model), intent(in) :: self
    real(wp), intent(in) :: t                      !! [s]
    logical, intent(in) :: left_limit              !! a jump at t does not act yet
    real(wp), intent(in) :: signals(0:, :)         !! (0:1, watches) values and slopes [any]
    logical, intent(in) :: any_value               !! the question is what holds at all: a factor that is 0 now counts as 1
    real(wp), intent(out) :: value                 !! [-]
    real(wp), intent(out) :: slopes(:)             !! (arguments) [1/any]
    real(wp) :: x(size(self%nodes)), by(size(self%nodes)), h(-1:2), others   ! values, derivatives of the factor by them [any]
    integer :: k, i, j
    do k = size(self%nodes), 1, -1
      associate (n => self%nodes(k))
        select case (n%kind)
        case (of_time)
          call n%history%evaluate(t, left_limit, h)
          x(k) = h(0)
        case (of_motion)
          x(k) = signals(0, n%watch)
        case (is_sum)
          x(k) = sum(n%factors*x(n%parts))
        case (is_product)
          x(k) = product(x(n%parts))
        case default
          x(k) = x(n%parts(chosen(n)))
        end select
      end associate
    end do
    value = x(1)
    if (any_value) x = merge(x, 1.0_wp, abs(x) > 0.0_wp)
    by = 0.0_wp
    by(1) = 1.0_wp
    i = 0
    do k = 1, size(x)
      associate (n => self%nodes(k))
        select case (n%kind)
        case (of_motion)
          i = i + 1
          slopes(i) = by(k)*signals(1, n%watch)
        case (is_sum)
          by(n%parts) = by(n%parts) + by(k)*n%factors
        case (is_product)
          do j = 1, size(n%parts)
            others = product(x(n%parts(:j - 1)))*product(x(n%parts(j + 1:)))
            by(n%parts(j)) = by(n%parts(j)) + by(k)*others
          end do
        case (is_switch)
          j = n%parts(chosen(n))
          by(j) = by(j) + by(k)
        case default                               ! of time: nothing depends on it
          cycle
        end select
      end associate
    end do
  contains
    !> Which part a switch chooses.
    pure integer function chosen(n)
      type(factor_node), intent(in) :: n
      chosen = merge(1, 2, signals(0, n%watch) > 0.0_wp)
    end function chosen
  end subroutine evaluate

  !> Those of its histories of time.
  pure function breakpoints(self, until) result(list)
    class(motion_factor_model), intent(in) :: self
    real(wp), intent(in) :: until                  !! end of the run [s]
    type(breakpoint), allocatable :: list(:)
    integer :: k
    allocate (list(0))
    do k = 1, size(self%nodes)
      if (self%nodes(k)%kind == of_time) list = merged(list, self%nodes(k)%history%breakpoints(until))
    end do
  end function breakpoints
end module motion_factor
