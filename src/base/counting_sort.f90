!> Sorting by small whole numbers, in linear time.
module counting_sort
  implicit none (type, external)
  private
  public :: sort_by_number

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
end module counting_sort
