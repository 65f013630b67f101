!> The pattern of a sparse matrix, symmetric and with the whole diagonal: each entry once, sorted by column, then by row.
module sparse_pattern
  use ordering, only: adjacency
  implicit none (type, external)
  private

  !> The pattern.
  type, public :: symmetric_pattern
    integer, allocatable :: first(:)           !! (n+1) first entry of each column
    integer, allocatable :: row(:), col(:)     !! (entries)
    integer, allocatable :: mirror(:)          !! (entries) the transposed entry
  contains
    procedure :: make
    procedure :: entry
  end type symmetric_pattern

contains

  !> The pattern of the given entries and of their mirror images.
  subroutine make(self, n, r, c)
    class(symmetric_pattern), intent(inout) :: self
    integer, intent(in) :: n                   !! order
    integer, intent(in) :: r(:), c(:)          !! rows and columns, repeated at will
    integer, allocatable :: start(:), neighbour(:), fill(:)
    integer :: k, j, i
    call adjacency(n, r, c, start, neighbour)
    allocate (self%first(n + 1), self%row(size(neighbour) + n), self%col(size(neighbour) + n), &
              self%mirror(size(neighbour) + n), fill(n))
    do j = 1, n + 1
      self%first(j) = start(j) + j - 1
    end do
    fill = self%first(1:n)
    do k = 1, n                                ! rows in ascending order into every column
      do j = start(k), start(k + 1)
        i = k
        if (j < start(k + 1)) i = neighbour(j)
        self%row(fill(i)) = k
        self%col(fill(i)) = i
        fill(i) = fill(i) + 1
      end do
    end do
    do k = 1, size(self%row)
      self%mirror(k) = self%entry(self%col(k), self%row(k))
    end do
  end subroutine make

  !> Number of an entry, by bisection in its column.
  pure integer function entry(self, i, j) result(e)
    class(symmetric_pattern), intent(in) :: self
    integer, intent(in) :: i, j
    integer :: low, high
    low = self%first(j)
    high = self%first(j + 1) - 1
    do while (low < high)
      e = (low + high)/2
      if (self%row(e) < i) then
        low = e + 1
      else
        high = e
      end if
    end do
    e = low
  end function entry
end module sparse_pattern
