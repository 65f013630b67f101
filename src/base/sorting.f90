!> Sorting: by small whole numbers, in linear time; of few reals.
module sorting
  use kinds, only: wp
  implicit none (type, external)
  private
  public :: ascending, sort_by_number

contains

  !> Positions of the entries of each number, number after number; those of one number keep their order.
  pure subroutine sort_by_number(number, most, first, sorted)
    integer, intent(in) :: number(:)                 !! 0 to most
    integer, intent(in) :: most
    integer, allocatable, intent(out) :: first(:)    !! (0:most + 1) first entry of each number in sorted
    integer, allocatable, intent(out) :: sorted(:)
    integer, allocatable :: fill(:)
    integer :: k
    allocate (first(0:most + 1), source=0)
    allocate (sorted(size(number)))
    do k = 1, size(number)
      first(number(k) + 1) = first(number(k) + 1) + 1
    end do
    first(0) = 1
    do k = 1, most + 1
      first(k) = first(k) + first(k - 1)
    end do
    allocate (fill(0:most), source=first(0:most))
    do k = 1, size(number)
      sorted(fill(number(k))) = k
      fill(number(k)) = fill(number(k)) + 1
    end do
  end subroutine sort_by_number

  !> Positions of values from the smallest to the largest by insertion, for a thousand or two; equal ones keep their order.
  pure function ascending(x) result(order)
    real(wp), intent(in) :: x(:)                     !! [any]
    integer :: order(size(x))
    integer :: i, j
    do i = 1, size(x)
      j = i - 1
      do while (j >= 1)
        if (x(order(j)) <= x(i)) exit
        order(j + 1) = order(j)
        j = j - 1
      end do
      order(j + 1) = i
    end do
  end function ascending
end module sorting
