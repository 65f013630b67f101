!> Symmetric positive definite band matrices, in the complex twin dynamic stiffnesses (`band_pivots`), factored once as
!> P^T L D L^T P and solved many times, two right-hand sides at a time. A reordering splits the matrix into its uncoupled blocks
!> (a straight beam's axial and bending coordinates) and keeps each band narrow. Solves are plain recurrences: no allocation, no
!> branch inside a row.
module banded
  use band_pivots, only: factor_band
  use kinds, only: wp, number
  use ordering, only: reverse_cuthill_mckee
  implicit none (type, external)
  private
  public :: band_factor, factor_symmetric, same_factor, order_band, factor_again, band_solve, band_solve_two

  !> One uncoupled block of the factored matrix, rows first..last of the reordered matrix.
  type :: band_block
    integer :: first = 1, last = 0           !! rows
    integer :: kd = 0                        !! half band width
    real(number), allocatable :: l(:, :)     !! l(i, j) = L(j+i, j), zero outside the block, columns first-kd..last [-]
  end type band_block

  !> Factor of a symmetric positive definite matrix.
  type :: band_factor
    integer :: n = 0
    integer, allocatable :: order(:)         !! order(k): original index of reordered row k
    real(number), allocatable :: dinv(:)     !! (n) 1 over the diagonal matrix D [1/any]
    type(band_block), allocatable :: blocks(:)
    integer, allocatable :: position(:)      !! (n) reordered row of each original index; kept where it may be factored again
    real(number), allocatable :: band(:)     !! work of the factorisation, of the largest block's size [any]
  end type band_factor

contains

  !> Factors the symmetric matrix whose lower entries are given as triplets (duplicates are summed).
  subroutine factor_symmetric(n, rows, cols, values, factor, bad)
    integer, intent(in) :: n                   !! order
    integer, intent(in) :: rows(:), cols(:)    !! entries of the full or of one triangle; (i,j) and (j,i) are one entry
    real(number), intent(in) :: values(:)      !! value of each entry; off-diagonal ones given once [any]
    type(band_factor), intent(out) :: factor
    logical, intent(out) :: bad                !! the matrix is not positive definite
    call order_band(n, rows, cols, factor)
    call factor_again(factor, rows, cols, values, bad)
    deallocate (factor%band, factor%position)
  end subroutine factor_symmetric

  !> Orders a matrix that is to be factored, perhaps often (`factor_again`), and makes room for its factor.
  subroutine order_band(n, rows, cols, factor)
    integer, intent(in) :: n                   !! order
    integer, intent(in) :: rows(:), cols(:)    !! as in factor_symmetric
    type(band_factor), intent(out) :: factor
    integer, allocatable :: block_start(:)
    integer :: b, k, i, most
    factor%n = n
    allocate (factor%dinv(n), factor%position(n))
    call reverse_cuthill_mckee(n, rows, cols, factor%order, block_start)
    factor%position(factor%order) = [(k, k=1, n)]
    allocate (factor%blocks(size(block_start) - 1))
    most = 0
    do b = 1, size(factor%blocks)
      associate (blk => factor%blocks(b))
        blk%first = block_start(b)
        blk%last = block_start(b + 1) - 1
        do k = 1, size(rows)
          i = factor%position(rows(k))
          if (i >= blk%first .and. i <= blk%last) blk%kd = max(blk%kd, abs(i - factor%position(cols(k))))
        end do
        if (blk%kd == 2) blk%kd = 3            ! then the loop written for half band width 3 serves
        i = max(blk%kd, 1)
        allocate (blk%l(i, blk%first - i:blk%last))
        blk%l = 0.0_wp
        most = max(most, (blk%kd + 1)*(blk%last - blk%first + 1))
      end associate
    end do
    allocate (factor%band(most))
  end subroutine order_band

  !> Factors a matrix that has the entries for which it was ordered; allocates nothing.
  subroutine factor_again(factor, rows, cols, values, bad)
    type(band_factor), intent(inout) :: factor
    integer, intent(in) :: rows(:), cols(:)    !! as in factor_symmetric
    real(number), intent(in) :: values(:)      !! as in factor_symmetric [any]
    logical, intent(out) :: bad                !! as in factor_symmetric
    integer :: b
    bad = .false.
    do b = 1, size(factor%blocks)
      associate (blk => factor%blocks(b))
        call fill_block(blk, blk%last - blk%first + 1, blk%kd, factor%band, factor%position, rows, cols, values, factor%dinv, bad)
      end associate
      if (bad) return
    end do
  end subroutine factor_again

  !> Sums a block's entries and factors it.
  subroutine fill_block(blk, n, kd, ab, position, rows, cols, values, dinv, bad)
    type(band_block), intent(inout) :: blk
    integer, intent(in) :: n, kd               !! rows, half band width
    real(number), intent(out) :: ab(0:kd, n)   !! work: the block as a band [any]
    integer, intent(in) :: position(:), rows(:), cols(:)
    real(number), intent(in) :: values(:)   !! as in factor_symmetric [any]
    real(number), intent(inout) :: dinv(:)  !! (n) 1 over the diagonal matrix D [1/any]
    logical, intent(out) :: bad                !! as in factor_symmetric
    integer :: k, i, j, info
    ab = 0.0_wp
    do k = 1, size(values)
      i = position(rows(k))
      if (i < blk%first .or. i > blk%last) cycle
      j = position(cols(k))
      ab(abs(i - j), min(i, j) - blk%first + 1) = ab(abs(i - j), min(i, j) - blk%first + 1) + values(k)
    end do
    call factor_band(n, kd, ab, info)
    bad = info /= 0
    if (bad) return
    do j = 1, n
      do i = 1, min(kd, n - j)
        blk%l(i, blk%first + j - 1) = ab(i, j)
      end do
      dinv(blk%first + j - 1) = 1.0_wp/ab(0, j)
    end do
  end subroutine fill_block

  !> Solves A x = b in place for one right-hand side.
  pure subroutine band_solve(factor, n, x, w)
    type(band_factor), intent(in) :: factor
    integer, intent(in) :: n
    real(number), intent(inout) :: x(n)        !! right-hand side, then solution [any]
    real(number), intent(inout) :: w(2, n)     !! work [any]
    integer :: k
    do k = 1, n
      w(1, k) = x(factor%order(k))
      w(2, k) = 0.0_wp
    end do
    call solve_blocks(factor, n, w)
    do k = 1, n
      x(factor%order(k)) = w(1, k)
    end do
  end subroutine band_solve

  !> Solves A [x y] = [bx by] in place: one pass over the factor for both.
  pure subroutine band_solve_two(factor, n, x, y, w)
    type(band_factor), intent(in) :: factor
    integer, intent(in) :: n
    real(number), intent(inout) :: x(n), y(n)  !! right-hand sides, then solutions [any]
    real(number), intent(inout) :: w(2, n)     !! work [any]
    integer :: k, j
    do k = 1, n
      j = factor%order(k)
      w(1, k) = x(j)
      w(2, k) = y(j)
    end do
    call solve_blocks(factor, n, w)
    do k = 1, n
      j = factor%order(k)
      x(j) = w(1, k)
      y(j) = w(2, k)
    end do
  end subroutine band_solve_two

  !> Forward, diagonal and backward substitution of w.
  pure subroutine solve_blocks(factor, n, w)
    type(band_factor), intent(in) :: factor
    integer, intent(in) :: n
    real(number), intent(inout) :: w(2, n)     !! [any]
    integer :: b
    do b = 1, size(factor%blocks)
      associate (blk => factor%blocks(b))
        select case (blk%kd)
        case (1)
          call solve_band1(blk%first, blk%last, blk%l, factor%dinv, w)
        case (3)
          call solve_band3(blk%first, blk%last, blk%l, factor%dinv, w)
        case default
          call solve_band(blk%first, blk%last, blk%kd, blk%l, factor%dinv, w)
        end select
      end associate
    end do
  end subroutine solve_blocks

  !> Tridiagonal block (axial coordinates of a straight beam).
  pure subroutine solve_band1(first, last, l, dinv, w)
    integer, intent(in) :: first, last
    real(number), intent(in) :: l(1, first - 1:last), dinv(last)   !! L [-] and 1/D [1/any]
    real(number), intent(inout) :: w(2, last)                  !! right-hand sides, then solutions [any]
    real(number) :: x1, x2
    integer :: j
    x1 = 0.0_wp
    x2 = 0.0_wp
    do j = first, last
      x1 = w(1, j) - l(1, j - 1)*x1
      x2 = w(2, j) - l(1, j - 1)*x2
      w(1, j) = x1
      w(2, j) = x2
    end do
    x1 = 0.0_wp
    x2 = 0.0_wp
    do j = last, first, -1
      x1 = w(1, j)*dinv(j) - l(1, j)*x1
      x2 = w(2, j)*dinv(j) - l(1, j)*x2
      w(1, j) = x1
      w(2, j) = x2
    end do
  end subroutine solve_band1

  !> Block of half band width 3 (bending coordinates of a straight beam). The newest unknown enters last, so that
  !> one multiplication and one subtraction are all that each row waits for.
  pure subroutine solve_band3(first, last, l, dinv, w)
    integer, intent(in) :: first, last
    real(number), intent(in) :: l(3, first - 3:last), dinv(last)   !! L [-] and 1/D [1/any]
    real(number), intent(inout) :: w(2, last)                  !! right-hand sides, then solutions [any]
    real(number) :: x1, x2, y1, y2, z1, z2, s1, s2
    integer :: j
    x1 = 0.0_wp; x2 = 0.0_wp; y1 = 0.0_wp; y2 = 0.0_wp; z1 = 0.0_wp; z2 = 0.0_wp
    do j = first, last
      s1 = ((w(1, j) - l(3, j - 3)*z1) - l(2, j - 2)*y1) - l(1, j - 1)*x1
      s2 = ((w(2, j) - l(3, j - 3)*z2) - l(2, j - 2)*y2) - l(1, j - 1)*x2
      w(1, j) = s1
      w(2, j) = s2
      z1 = y1; z2 = y2; y1 = x1; y2 = x2; x1 = s1; x2 = s2
    end do
    x1 = 0.0_wp; x2 = 0.0_wp; y1 = 0.0_wp; y2 = 0.0_wp; z1 = 0.0_wp; z2 = 0.0_wp
    do j = last, first, -1
      s1 = ((w(1, j)*dinv(j) - l(3, j)*z1) - l(2, j)*y1) - l(1, j)*x1
      s2 = ((w(2, j)*dinv(j) - l(3, j)*z2) - l(2, j)*y2) - l(1, j)*x2
      w(1, j) = s1
      w(2, j) = s2
      z1 = y1; z2 = y2; y1 = x1; y2 = x2; x1 = s1; x2 = s2
    end do
  end subroutine solve_band3

  !> Block of any half band width.
  pure subroutine solve_band(first, last, kd, l, dinv, w)
    integer, intent(in) :: first, last, kd
    real(number), intent(in) :: l(kd, first - kd:last), dinv(last)   !! L [-] and 1/D [1/any]
    real(number), intent(inout) :: w(2, last)                    !! right-hand sides, then solutions [any]
    integer :: i, j
    do j = first, last
      do i = 1, min(kd, last - j)
        w(1, j + i) = w(1, j + i) - l(i, j)*w(1, j)
        w(2, j + i) = w(2, j + i) - l(i, j)*w(2, j)
      end do
    end do
    do j = last, first, -1
      w(1, j) = w(1, j)*dinv(j)
      w(2, j) = w(2, j)*dinv(j)
      do i = 1, min(kd, last - j)
        w(1, j) = w(1, j) - l(i, j)*w(1, j + i)
        w(2, j) = w(2, j) - l(i, j)*w(2, j + i)
      end do
    end do
  end subroutine solve_band

  !> Whether two factors are the same numbers.
  pure logical function same_factor(a, b) result(same)
    type(band_factor), intent(in) :: a, b
    integer :: k
    same = a%n == b%n .and. size(a%blocks) == size(b%blocks)
    if (same) same = all(a%order == b%order) .and. all(abs(a%dinv - b%dinv) <= 0.0_wp)
    if (.not. same) return
    do k = 1, size(a%blocks)
      same = same .and. a%blocks(k)%first == b%blocks(k)%first .and. size(a%blocks(k)%l) == size(b%blocks(k)%l)
      if (same) same = all(abs(a%blocks(k)%l - b%blocks(k)%l) <= 0.0_wp)
    end do
  end function same_factor
end module banded
