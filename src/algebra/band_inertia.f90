!> Inertia of a symmetric band matrix: its negative eigenvalues are as many as the sign changes in the sequence of its leading
!> minors (Sylvester, Jacobi).
module band_inertia
  use kinds, only: wp
  implicit none (type, external)
  private
  public :: negative_eigenvalues

contains

  !> How many eigenvalues are negative. Each row is reduced by those above it, which are exchanged with it where its entry is the
  !> larger one: so every leading minor is known by a stable elimination (Martin & Wilkinson 1967). Rows and columns may have been
  !> scaled by different positive numbers: minors keep their signs.
  pure integer function negative_eigenvalues(n, kd, ab) result(negative)
    integer, intent(in) :: n, kd                      !! order, half band width
    complex(wp), intent(in) :: ab(3*kd + 1, n)        !! the matrix, real, as LAPACK stores it for an LU factor [any]
    real(wp) :: u(0:2*kd, n)                          ! rows of the triangle, from the diagonal on [any]
    real(wp) :: row(-kd:kd), other(0:2*kd)            ! [any]
    logical :: changes                                ! sign from one minor to the next
    integer :: i, j, last
    negative = 0
    do i = 1, n
      row = 0.0_wp
      do j = max(1, i - kd), min(n, i + kd)
        row(j - i) = real(ab(2*kd + 1 + i - j, j), wp)
      end do
      changes = .false.
      do j = max(1, i - kd), i - 1
        last = i + kd - j
        if (abs(row(j - i)) > abs(u(0, j))) then
          other(0:last) = u(0:last, j)
          u(0:last, j) = row(j - i:kd)
          row(j - i:kd) = other(0:last)
          changes = changes .neqv. ((u(0, j) < 0.0_wp) .eqv. (other(0) < 0.0_wp))
        end if
        if (abs(row(j - i)) > 0.0_wp) row(j - i:kd) = row(j - i:kd) - (row(j - i)/u(0, j))*u(0:last, j)
      end do
      u(0:kd, i) = row(0:kd)
      u(kd + 1:, i) = 0.0_wp
      if ((row(0) < 0.0_wp) .neqv. changes) negative = negative + 1
    end do
  end function negative_eigenvalues
end module band_inertia
