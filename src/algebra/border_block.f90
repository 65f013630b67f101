!> One block of a bordered system: a band matrix with its coupling to the border, factored and condensed (see `bordered`, which
!> explains the replaced pivots).
module border_block
  use band_inertia, only: negative_eigenvalues
  use kinds, only: wp
  use lapack, only: zgbtrf, zgbtrs
  implicit none (type, external)
  private
  public :: block_part, condense, equilibrate

  integer, parameter, public :: slots = 3             !! most replaced pivots of a block: border unknowns kept for them
  real(wp), parameter, public :: no_pivot = 1.0e-75_wp   !! pivot of a singular matrix: above it solutions stay finite [-]
  real(wp), parameter :: weak_pivot = 1.0e-9_wp       !! of the largest entry of the equilibrated column [-]

  !> One block.
  type :: block_part
    integer :: n = 0                                  !! unknowns
    integer :: kd = 0                                 !! half band width
    integer, allocatable :: unknown(:)                !! (n) original indices in band order
    integer, allocatable :: border(:)                 !! (nb) border unknowns that it couples to, the slots last
    complex(wp), allocatable :: ab(:, :)              !! (3 kd + 1, n) band matrix, then its factor [any]
    complex(wp), allocatable :: right(:, :)           !! (n, nb) coupling to the border, then A^-1 times it [any]
    complex(wp), allocatable :: left(:, :)            !! (n, nb) transposed coupling of the border's rows to the block [any]
    integer, allocatable :: pivots(:)                 !! (n)
    real(wp), allocatable :: row_scale(:), col_scale(:)   !! (n) of A; right and left are scaled with it [1/any]
    integer :: weak(slots) = 0                        !! replaced pivots
    complex(wp), allocatable :: y(:, :)               !! (n, 1) work of a solve [any]
  end type block_part

contains

  !> Factors one block and subtracts its Schur complement from the border. Where negative eigenvalues are counted weak pivots stay:
  !> replaced ones make the border unsymmetric.
  subroutine condense(p, kd, ab, negative)
    type(block_part), intent(inout) :: p
    integer, intent(in) :: kd                         !! half band width of the border
    complex(wp), intent(inout) :: ab(:, :)            !! (3 kd + 1, nb) the border [any]
    integer, intent(inout), optional :: negative      !! negative eigenvalues, to which those of the block are added
    complex(wp) :: s
    integer :: info, k, w, m, i, j, first, last
    m = size(p%border)
    p%weak = 0
    do k = 1, slots
      ab(2*kd + 1, p%border(m - slots + k)) = 1.0_wp
    end do
    if (p%n == 0) return
    call equilibrate(p%n, p%kd, p%ab, p%row_scale, p%col_scale)
    do j = 1, m
      p%right(:, j) = p%right(:, j)*p%row_scale
      p%left(:, j) = p%left(:, j)*p%col_scale
    end do
    if (present(negative)) negative = negative + negative_eigenvalues(p%n, p%kd, p%ab)
    call zgbtrf(p%n, p%n, p%kd, p%kd, p%ab, 3*p%kd + 1, p%pivots, info)
    w = 0
    do k = 1, p%n
      if (abs(p%ab(2*p%kd + 1, k)) > weak_pivot) cycle
      if (w == slots .or. present(negative)) then
        if (abs(p%ab(2*p%kd + 1, k)) <= no_pivot) p%ab(2*p%kd + 1, k) = epsilon(1.0_wp)
        cycle
      end if
      w = w + 1
      p%weak(w) = k
      p%ab(2*p%kd + 1, k) = p%ab(2*p%kd + 1, k) + 1.0_wp
      p%left(k, m - slots + w) = -1.0_wp
    end do
    call zgbtrs('N', p%n, p%kd, p%kd, m - slots, p%ab, 3*p%kd + 1, p%pivots, p%right, p%n, info)
    do k = 1, w
      call back_substitute(p, p%weak(k), -1.0_wp, p%right(:, m - slots + k))
    end do
    do i = 1, m - slots + w                           ! a row of a joint has few entries
      first = findloc(abs(p%left(:, i)%re) + abs(p%left(:, i)%im) > 0.0_wp, .true., 1)
      last = findloc(abs(p%left(:, i)%re) + abs(p%left(:, i)%im) > 0.0_wp, .true., 1, back=.true.)
      do j = 1, merge(m - slots + w, 0, first > 0)
        s = sum(p%left(first:last, i)*p%right(first:last, j))
        associate (r => p%border(i), c => p%border(j))
          ab(2*kd + 1 + r - c, c) = ab(2*kd + 1 + r - c, c) - s
        end associate
      end do
    end do
  end subroutine condense

  !> Scales rows, then columns of a band matrix to size one, by powers of two: forces, moments and lengths stand side by side in it.
  subroutine equilibrate(n, kd, ab, row_scale, col_scale)
    integer, intent(in) :: n, kd                      !! order, half band width
    complex(wp), intent(inout) :: ab(3*kd + 1, n)     !! band matrix [any]
    real(wp), intent(out) :: row_scale(n), col_scale(n)   !! [1/any]
    integer :: d, j                                   ! by diagonals i - j = d, since a column is short
    row_scale = 0.0_wp
    do d = -kd, kd
      do j = max(1, 1 - d), min(n, n - d)
        row_scale(j + d) = max(row_scale(j + d), magnitude(ab(2*kd + 1 + d, j)))
      end do
    end do
    row_scale = scale_of(row_scale)
    col_scale = 0.0_wp
    do d = -kd, kd
      do j = max(1, 1 - d), min(n, n - d)
        col_scale(j) = max(col_scale(j), magnitude(ab(2*kd + 1 + d, j))*row_scale(j + d))
      end do
    end do
    col_scale = scale_of(col_scale)
    do d = -kd, kd
      do j = max(1, 1 - d), min(n, n - d)
        ab(2*kd + 1 + d, j) = ab(2*kd + 1 + d, j)*(row_scale(j + d)*col_scale(j))
      end do
    end do
  end subroutine equilibrate

  !> Size of a complex number without a square root.
  elemental real(wp) function magnitude(z)
    complex(wp), intent(in) :: z   !! [any]
    magnitude = abs(real(z)) + abs(aimag(z))
  end function magnitude

  !> The power of two that brings a size to one; 1 for a row or column of zeros.
  elemental real(wp) function scale_of(largest)
    real(wp), intent(in) :: largest   !! [any]
    scale_of = 1.0_wp
    if (largest >= tiny(1.0_wp)) scale_of = scale(1.0_wp, -exponent(largest))
  end function scale_of

  !> x = value U^-1 e_k.
  pure subroutine back_substitute(p, k, value, x)
    type(block_part), intent(in) :: p
    integer, intent(in) :: k
    real(wp), intent(in) :: value   !! [any]
    complex(wp), intent(inout) :: x(:)   !! (n) [any]
    integer :: i, j
    x = 0.0_wp
    x(k) = value
    do j = k, 1, -1
      x(j) = x(j)/p%ab(2*p%kd + 1, j)
      do i = max(1, j - 2*p%kd), j - 1
        x(i) = x(i) - p%ab(2*p%kd + 1 + i - j, j)*x(j)
      end do
    end do
  end subroutine back_substitute
end module border_block
