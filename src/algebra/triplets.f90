!> Sparse matrices as growing lists of entries; entries of the same row and column add up.
module triplets
  use kinds, only: wp
  implicit none (type, external)
  private

  !> A sparse matrix.
  type, public :: triplet_matrix
    integer :: count = 0                    !! entries
    integer, allocatable :: rows(:), cols(:)
    real(wp), allocatable :: values(:)      !! (count or more) [any]
  contains
    procedure :: add => add_entry
    procedure :: add_block
    procedure :: times => matrix_times
    procedure :: quadratic_form
  end type triplet_matrix

contains

  !> Adds one entry. Left out: zeros, and entries of removed coordinates (index 0).
  pure subroutine add_entry(self, i, j, x)
    class(triplet_matrix), intent(inout) :: self
    integer, intent(in) :: i, j
    real(wp), intent(in) :: x   !! value of the entry [any]
    if (i <= 0 .or. j <= 0 .or. abs(x) <= 0.0_wp) return
    if (.not. allocated(self%rows)) allocate (self%rows(64), self%cols(64), self%values(64))
    if (self%count == size(self%rows)) then
      self%rows = [self%rows, self%rows]
      self%cols = [self%cols, self%cols]
      self%values = [self%values, self%values]
    end if
    self%count = self%count + 1
    self%rows(self%count) = i
    self%cols(self%count) = j
    self%values(self%count) = x
  end subroutine add_entry

  !> Adds a dense block at the given rows and columns.
  pure subroutine add_block(self, rows, cols, block)
    class(triplet_matrix), intent(inout) :: self
    integer, intent(in) :: rows(:), cols(:)   !! where, 0: skipped
    real(wp), intent(in) :: block(:, :)       !! [as the matrix]
    integer :: i, j
    do j = 1, size(cols)
      do i = 1, size(rows)
        call self%add(rows(i), cols(j), block(i, j))
      end do
    end do
  end subroutine add_block

  !> y = y + s A x.
  pure subroutine matrix_times(self, s, x, y)
    class(triplet_matrix), intent(in) :: self
    real(wp), intent(in) :: s, x(:)   !! factor and vector [any]
    real(wp), intent(inout) :: y(:)   !! [unit of s A x]
    integer :: k
    do k = 1, self%count
      y(self%rows(k)) = y(self%rows(k)) + s*self%values(k)*x(self%cols(k))
    end do
  end subroutine matrix_times

  !> x^T A x.
  pure real(wp) function quadratic_form(self, x) result(total)
    class(triplet_matrix), intent(in) :: self
    real(wp), intent(in) :: x(:)              !! [any]
    integer :: k
    total = 0.0_wp
    do k = 1, self%count
      total = total + self%values(k)*x(self%rows(k))*x(self%cols(k))
    end do
  end function quadratic_form
end module triplets
