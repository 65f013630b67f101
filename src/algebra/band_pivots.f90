!> L D L^T of a symmetric band matrix in place, kept by columns, a(i, j) = A(j+i, j): L below the diagonal, D on it.
module band_pivots
  use kinds, only: wp
  use lapack, only: dpbtrf
  implicit none (type, external)
  private
  public :: factor_band

  !> Of a positive definite matrix, or of a complex one.
  interface factor_band
    procedure factor_real, factor_complex
  end interface factor_band

contains

  !> Real: LAPACK's Cholesky factor, its columns over their diagonal.
  subroutine factor_real(n, kd, a, info)
    integer, intent(in) :: n, kd               !! rows, half band width
    real(wp), intent(inout) :: a(0:kd, n)      !! matrix, then L [-] and D [any]
    integer, intent(out) :: info               !! row at which the matrix is not positive definite, 0: none
    integer :: j
    call dpbtrf('L', n, kd, a, kd + 1, info)
    if (info /= 0) return
    do j = 1, n
      a(1:, j) = a(1:, j)/a(0, j)
      a(0, j) = a(0, j)**2
    end do
  end subroutine factor_real

  !> Complex symmetric. For a dynamic stiffness x^H A x lies between 0 and less than 135 degrees from the positive axis, for every
  !> x; so does each pivot then, and none is small beside its column: they need not be chosen.
  subroutine factor_complex(n, kd, a, info)
    integer, intent(in) :: n, kd               !! rows, half band width
    complex(wp), intent(inout) :: a(0:kd, n)   !! matrix, then L [-] and D [any]
    integer, intent(out) :: info               !! row at which the pivot leaves the sector, 0: none
    complex(wp) :: d, l
    integer :: i, j, k, m
    do info = 1, n
      j = info
      if (.not. (real(a(0, j), wp) + aimag(a(0, j)) > 0.0_wp .and. abs(a(0, j)) < huge(1.0_wp))) return
      m = min(kd, n - j)
      d = 1/a(0, j)
      do i = 1, m
        l = a(i, j)*d
        do k = i, m
          a(k - i, j + i) = a(k - i, j + i) - l*a(k, j)
        end do
      end do
      a(1:m, j) = a(1:m, j)*d
    end do
    info = 0
  end subroutine factor_complex
end module band_pivots
