!> Products of short vectors.
module small_matrices
  use kinds, only: wp
  implicit none (type, external)
  private
  public :: outer

contains

  !> Outer product a b^T of two vectors of six.
  pure function outer(a, b) result(m)
    real(wp), intent(in) :: a(6), b(6)
    real(wp) :: m(6, 6)                    !! [unit of a times unit of b]
    integer :: j
    do j = 1, 6
      m(:, j) = a*b(j)
    end do
  end function outer
end module small_matrices
