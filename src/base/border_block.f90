!> One block of a bordered system: a band matrix with its coupling to the border, factored and condensed (see `bordered`, which
!> explains the replaced pivots).
module border_block
  use kinds, only: wp
  use lapack, only: zgbtrf, zgbtrs
  implicit none (type, external)
  private
  public :: block_part, condense

  integer, parameter, public :: slots = 3             !! replaced pivots that a block can hand to the border
  real(wp), parameter :: weak_pivot = 1.0e-9_wp       !! of the largest entry of the column [-]

  !> One block.
  type :: block_part
    integer :: n = 0                                  !! unknowns
    integer :: kd = 0                                 !! half band width
    integer, allocatable :: unknown(:)                !! (n) original indices in band order
    integer, allocatable :: border(:)                 !! (nb) border unknowns that it couples to, the slots last
    complex(wp), allocatable :: ab(:, :)              !! (3 kd + 1, n) band matrix, then its factor [any]
    complex(wp), allocatable :: right(:, :)           !! (n, nb) coupling to the border, then A^-1 times it [any]
    complex(wp), allocatable :: left(:, :)            !! (nb, n) coupling of the border's rows to the block [any]
    integer, allocatable :: pivots(:)                 !! (n)
    real(wp), allocatable :: size(:)                  !! (n) largest entry of each column [any]
    integer :: weak(slots) = 0                        !! replaced pivots
  end type block_part

contains

  !> Factors one block and subtracts its Schur complement from the border.
  subroutine condense(p, kd, ab)
    type(block_part), intent(inout) :: p
    integer, intent(in) :: kd                         !! half band width of the border
    complex(wp), intent(inout) :: ab(:, :)            !! (3 kd + 1, nb) the border [any]
    complex(wp) :: s
    real(wp) :: largest   ! [any]
    integer :: info, k, w, m, i, j
    m = size(p%border)
    p%weak = 0
    do k = 1, slots
      ab(2*kd + 1, p%border(m - slots + k)) = 1.0_wp
    end do
    if (p%n == 0) return
    p%size = [(maxval(abs(p%ab(:, k))), k=1, p%n)]
    largest = maxval(p%size)
    where (p%size < tiny(1.0_wp)) p%size = merge(largest, 1.0_wp, largest >= tiny(1.0_wp))   ! a mode at its own frequency
    call zgbtrf(p%n, p%n, p%kd, p%kd, p%ab, 3*p%kd + 1, p%pivots, info)
    w = 0
    do k = 1, p%n
      if (abs(p%ab(2*p%kd + 1, k)) > weak_pivot*p%size(k)) cycle
      if (w == slots) then
        if (abs(p%ab(2*p%kd + 1, k)) <= 0.0_wp) p%ab(2*p%kd + 1, k) = epsilon(1.0_wp)*p%size(k)
        cycle
      end if
      w = w + 1
      p%weak(w) = k
      p%ab(2*p%kd + 1, k) = p%ab(2*p%kd + 1, k) + p%size(k)
      p%left(m - slots + w, k) = -1.0_wp
    end do
    call zgbtrs('N', p%n, p%kd, p%kd, m - slots, p%ab, 3*p%kd + 1, p%pivots, p%right, p%n, info)
    do k = 1, w
      call back_substitute(p, p%weak(k), -p%size(p%weak(k)), p%right(:, m - slots + k))
    end do
    do j = 1, m - slots + w
      do i = 1, m - slots + w
        s = sum(p%left(i, :)*p%right(:, j))
        associate (r => p%border(i), c => p%border(j))
          ab(2*kd + 1 + r - c, c) = ab(2*kd + 1 + r - c, c) - s
        end associate
      end do
    end do
  end subroutine condense

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
