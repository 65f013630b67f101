!> Complex sparse systems with a structure known beforehand: unknowns of separate blocks (the elastic coordinates of one
!> body) couple among themselves in a narrow band, all else is the border (frames, multipliers, coupled coordinates). Each
!> block is factored as a band matrix and condensed onto the border, itself banded in a good ordering. Cost and memory are
!> linear in the size of the blocks and, for chains of blocks, in their number.
!>
!> A block may be singular where the whole matrix is not (a clamped body at one of its own frequencies). A pivot that
!> almost vanishes is replaced by a small one: whoever solves corrects the solution by its residual.
module bordered
  use kinds, only: wp
  use band_inertia, only: negative_eigenvalues
  use lapack, only: zgbtrf, zgbtrs
  use ordering, only: reverse_cuthill_mckee
  implicit none (type, external)
  private
  public :: bordered_system

  real(wp), parameter :: weak_pivot = epsilon(1.0_wp)**0.75_wp   !! least pivot of a block: a quarter of the digits stays [-]
  real(wp), parameter :: no_pivot = sqrt(sqrt(tiny(1.0_wp)))   !! likewise of the border: solutions stay finite [-]

  !> One block.
  type :: block_part
    integer :: n = 0                                  !! unknowns
    integer :: kd = 0                                 !! half band width
    integer, allocatable :: unknown(:)                !! (n) original indices in band order
    integer, allocatable :: border(:)                 !! (nb) border unknowns that it couples to
    complex(wp), allocatable :: ab(:, :)              !! (3 kd + 1, n) band matrix, then its factor [any]
    complex(wp), allocatable :: right(:, :)           !! (n, nb) coupling to the border, then A^-1 times it [any]
    complex(wp), allocatable :: left(:, :)            !! (n, nb) transposed coupling of the border's rows to the block [any]
    integer, allocatable :: pivots(:)                 !! (n)
    real(wp), allocatable :: row_scale(:), col_scale(:)   !! (n) of A; right and left are scaled with it [1/any]
    complex(wp), allocatable :: y(:, :)               !! (n, 1) work of a solve [any]
  end type block_part

  !> The system.
  type :: bordered_system
    integer :: n = 0                                  !! unknowns
    integer :: nb = 0                                 !! border unknowns
    integer :: kd = 0                                 !! half band width of the border
    type(block_part), allocatable :: blocks(:)
    integer, allocatable :: block_of(:)               !! (n) block of each unknown, 0: border
    integer, allocatable :: place(:)                  !! (n) its number in the block or in the border
    integer, allocatable :: kind(:)                   !! (entries) 1 block, 2 right, 3 left, 4 border
    integer, allocatable :: home(:)                   !! (entries) block
    integer, allocatable :: i(:), j(:)                !! (entries) where in that array
    complex(wp), allocatable :: ab(:, :)              !! (3 kd + 1, nb) border, then its factor [any]
    integer, allocatable :: pivots(:)                 !! (nb)
    real(wp), allocatable :: row_scale(:), col_scale(:)   !! (nb) scales of the border's rows and columns [1/any]
    complex(wp), allocatable :: x(:, :)               !! (nb, 1) work [any]
  contains
    procedure :: set_up
    procedure :: factor
    procedure :: solve
    procedure :: memory
  end type bordered_system

contains

  !> Prepares a pattern. Unknowns of a block that couple to another block directly become border unknowns.
  subroutine set_up(self, n, rows, cols, block_of)
    class(bordered_system), intent(inout) :: self
    integer, intent(in) :: n                          !! unknowns
    integer, intent(in) :: rows(:), cols(:)           !! pattern, both triangles, each entry once
    integer, intent(in) :: block_of(:)                !! (n) block of each unknown, 0: border
    integer :: e, a, b
    self%n = n
    self%block_of = block_of
    do e = 1, size(rows)
      a = block_of(rows(e))
      b = block_of(cols(e))
      if (a == b .or. a == 0 .or. b == 0) cycle
      self%block_of(rows(e)) = 0
      self%block_of(cols(e)) = 0
    end do
    allocate (self%blocks(maxval([0, block_of])), self%place(n), self%kind(size(rows)), self%home(size(rows)), &
              self%i(size(rows)), self%j(size(rows)))
    do b = 1, size(self%blocks)
      call order_block(self, b, rows, cols)
    end do
    call order_border(self, rows, cols)
    do e = 1, size(rows)
      call place_entry(self, e, rows(e), cols(e))
    end do
  end subroutine set_up

  !> Narrow-band order of one block.
  subroutine order_block(self, b, rows, cols)
    class(bordered_system), intent(inout) :: self
    integer, intent(in) :: b
    integer, intent(in) :: rows(:), cols(:)
    integer, allocatable :: members(:), local(:), order(:), starts(:), kept(:)
    integer :: k, e
    members = pack([(k, k=1, self%n)], self%block_of == b)
    allocate (local(self%n), source=0)
    local(members) = [(k, k=1, size(members))]
    kept = pack([(e, e=1, size(rows))], self%block_of(rows) == b .and. self%block_of(cols) == b)
    associate (p => self%blocks(b))
      p%n = size(members)
      call reverse_cuthill_mckee(p%n, local(rows(kept)), local(cols(kept)), order, starts)
      p%unknown = members(order)
      self%place(p%unknown) = [(k, k=1, p%n)]
      p%kd = 0
      do k = 1, size(kept)
        p%kd = max(p%kd, abs(self%place(rows(kept(k))) - self%place(cols(kept(k)))))
      end do
      allocate (p%y(p%n, 1), p%ab(3*p%kd + 1, p%n), p%pivots(p%n), p%row_scale(p%n), p%col_scale(p%n))
    end associate
  end subroutine order_block

  !> Border unknowns of every block, and a narrow-band order of the border.
  subroutine order_border(self, rows, cols)
    class(bordered_system), intent(inout) :: self
    integer, intent(in) :: rows(:), cols(:)
    integer, allocatable :: members(:), local(:), order(:), starts(:), position(:), r(:), c(:), mark(:)
    integer :: k, e, b, i, j, n
    members = pack([(k, k=1, self%n)], self%block_of == 0)
    allocate (local(self%n), source=0)
    local(members) = [(k, k=1, size(members))]
    self%nb = size(members)
    allocate (mark(self%nb))
    do b = 1, size(self%blocks)
      mark = 0
      do e = 1, size(rows)
        if (self%block_of(rows(e)) == b .and. local(cols(e)) > 0) mark(local(cols(e))) = 1
      end do
      self%blocks(b)%border = pack([(k, k=1, self%nb)], mark == 1)
    end do
    n = count(local(rows) > 0 .and. local(cols) > 0)
    do b = 1, size(self%blocks)
      n = n + size(self%blocks(b)%border)**2
    end do
    allocate (r(n), c(n))
    n = 0
    do e = 1, size(rows)
      if (local(rows(e)) == 0 .or. local(cols(e)) == 0) cycle
      n = n + 1
      r(n) = local(rows(e))
      c(n) = local(cols(e))
    end do
    do b = 1, size(self%blocks)
      do i = 1, size(self%blocks(b)%border)
        do j = 1, size(self%blocks(b)%border)
          n = n + 1
          r(n) = self%blocks(b)%border(i)
          c(n) = self%blocks(b)%border(j)
        end do
      end do
    end do
    call reverse_cuthill_mckee(self%nb, r, c, order, starts)
    allocate (position(self%nb))
    position(order) = [(k, k=1, self%nb)]
    self%kd = 0
    do k = 1, n
      self%kd = max(self%kd, abs(position(r(k)) - position(c(k))))
    end do
    self%place(members) = position(local(members))
    do b = 1, size(self%blocks)
      associate (p => self%blocks(b))
        p%border = position(p%border)
        allocate (p%right(p%n, size(p%border)), p%left(p%n, size(p%border)))
      end associate
    end do
    allocate (self%ab(3*self%kd + 1, self%nb), self%pivots(self%nb), self%row_scale(self%nb), self%col_scale(self%nb), &
              self%x(self%nb, 1))
  end subroutine order_border

  !> Finds the array and the position in it where an entry of the pattern is stored.
  subroutine place_entry(self, e, row, col)
    class(bordered_system), intent(inout) :: self
    integer, intent(in) :: e, row, col
    integer :: a, b, i, j
    a = self%block_of(row)
    b = self%block_of(col)
    i = self%place(row)
    j = self%place(col)
    self%home(e) = max(a, b)
    if (a > 0 .and. b > 0) then
      self%kind(e) = 1
      self%i(e) = 2*self%blocks(a)%kd + 1 + i - j
      self%j(e) = j
    else if (a > 0) then
      self%kind(e) = 2
      self%i(e) = i
      self%j(e) = findloc(self%blocks(a)%border, j, 1)
    else if (b > 0) then
      self%kind(e) = 3
      self%i(e) = j
      self%j(e) = findloc(self%blocks(b)%border, i, 1)
    else
      self%kind(e) = 4
      self%i(e) = 2*self%kd + 1 + i - j
      self%j(e) = j
    end if
  end subroutine place_entry

  !> Factors the matrix whose entries are given in the order of the pattern. Of a real symmetric one the negative eigenvalues are
  !> counted too: those of the blocks and those of what condensing them leaves in the border (Haynsworth 1968).
  subroutine factor(self, values, negative)
    class(bordered_system), intent(inout) :: self
    complex(wp), intent(in) :: values(:)              !! (entries) [any]
    integer, intent(out), optional :: negative        !! number of negative eigenvalues
    integer :: b, e
    do b = 1, size(self%blocks)
      self%blocks(b)%ab = 0.0_wp
      self%blocks(b)%right = 0.0_wp
      self%blocks(b)%left = 0.0_wp
    end do
    self%ab = 0.0_wp
    do e = 1, size(values)
      select case (self%kind(e))
      case (1)
        self%blocks(self%home(e))%ab(self%i(e), self%j(e)) = values(e)
      case (2)
        self%blocks(self%home(e))%right(self%i(e), self%j(e)) = values(e)
      case (3)
        self%blocks(self%home(e))%left(self%i(e), self%j(e)) = values(e)
      case default
        self%ab(self%i(e), self%j(e)) = values(e)
      end select
    end do
    if (present(negative)) negative = 0
    do b = 1, size(self%blocks)
      call condense(self%blocks(b), self%kd, self%ab, negative)
    end do
    call equilibrate(self%nb, self%kd, self%ab, self%row_scale, self%col_scale)
    if (present(negative)) negative = negative + negative_eigenvalues(self%nb, self%kd, self%ab)
    call factor_band(self%nb, self%kd, no_pivot, self%ab, self%pivots)
  end subroutine factor

  !> Solves in place with the last factor, or with its transpose.
  subroutine solve(self, x, transposed)
    class(bordered_system), intent(inout) :: self
    complex(wp), intent(inout) :: x(:)                !! (n) right-hand side, then solution [any]
    logical, intent(in) :: transposed
    integer :: b, k, info
    self%x = 0.0_wp
    do k = 1, self%n
      if (self%block_of(k) == 0) self%x(self%place(k), 1) = x(k)
    end do
    do b = 1, size(self%blocks)
      associate (p => self%blocks(b))
        if (p%n == 0) cycle
        do k = 1, p%n
          p%y(k, 1) = x(p%unknown(k))*merge(p%col_scale(k), p%row_scale(k), transposed)
        end do
        if (any(abs(real(p%y)) + abs(aimag(p%y)) > 0.0_wp)) then
          if (transposed) then
            self%x(p%border, 1) = self%x(p%border, 1) - matmul(p%y(:, 1), p%right)
          else
            call zgbtrs('N', p%n, p%kd, p%kd, 1, p%ab, 3*p%kd + 1, p%pivots, p%y, p%n, info)
            self%x(p%border, 1) = self%x(p%border, 1) - matmul(p%y(:, 1), p%left)
          end if
        end if
      end associate
    end do
    self%x(:, 1) = self%x(:, 1)*merge(self%col_scale, self%row_scale, transposed)
    call zgbtrs(merge('T', 'N', transposed), self%nb, self%kd, self%kd, 1, self%ab, 3*self%kd + 1, self%pivots, self%x, &
                self%nb, info)
    self%x(:, 1) = self%x(:, 1)*merge(self%row_scale, self%col_scale, transposed)
    do k = 1, self%n
      if (self%block_of(k) == 0) x(k) = self%x(self%place(k), 1)
    end do
    do b = 1, size(self%blocks)
      associate (p => self%blocks(b))
        if (p%n == 0) cycle
        if (transposed) then
          p%y(:, 1) = p%y(:, 1) - matmul(p%left, self%x(p%border, 1))
          call zgbtrs('T', p%n, p%kd, p%kd, 1, p%ab, 3*p%kd + 1, p%pivots, p%y, p%n, info)
          x(p%unknown) = p%y(:, 1)*p%row_scale
        else
          do k = 1, size(p%border)
            p%y(:, 1) = p%y(:, 1) - p%right(:, k)*self%x(p%border(k), 1)
          end do
          x(p%unknown) = p%y(:, 1)*p%col_scale
        end if
      end associate
    end do
  end subroutine solve

  !> Factors one block and subtracts its Schur complement from the border.
  subroutine condense(p, kd, ab, negative)
    type(block_part), intent(inout) :: p
    integer, intent(in) :: kd                         !! half band width of the border
    complex(wp), intent(inout) :: ab(:, :)            !! (3 kd + 1, nb) the border [any]
    integer, intent(inout), optional :: negative      !! negative eigenvalues, to which those of the block are added
    complex(wp) :: s
    integer :: info, m, i, j, first, last
    m = size(p%border)
    if (p%n == 0) return
    call equilibrate(p%n, p%kd, p%ab, p%row_scale, p%col_scale)
    do j = 1, m
      p%right(:, j) = p%right(:, j)*p%row_scale
      p%left(:, j) = p%left(:, j)*p%col_scale
    end do
    if (present(negative)) negative = negative + negative_eigenvalues(p%n, p%kd, p%ab)
    call factor_band(p%n, p%kd, weak_pivot, p%ab, p%pivots)
    call zgbtrs('N', p%n, p%kd, p%kd, m, p%ab, 3*p%kd + 1, p%pivots, p%right, p%n, info)
    do i = 1, m                                       ! a row of a joint has few entries
      first = findloc(abs(p%left(:, i)%re) + abs(p%left(:, i)%im) > 0.0_wp, .true., 1)
      last = findloc(abs(p%left(:, i)%re) + abs(p%left(:, i)%im) > 0.0_wp, .true., 1, back=.true.)
      do j = 1, merge(m, 0, first > 0)
        s = sum(p%left(first:last, i)*p%right(first:last, j))
        associate (r => p%border(i), c => p%border(j))
          ab(2*kd + 1 + r - c, c) = ab(2*kd + 1 + r - c, c) - s
        end associate
      end do
    end do
  end subroutine condense

  !> LU factor of an equilibrated band matrix. Pivots that vanish become rounding, or the least one where that is larger.
  subroutine factor_band(n, kd, least, ab, pivots)
    integer, intent(in) :: n, kd                      !! order, half band width
    real(wp), intent(in) :: least                     !! [-]
    complex(wp), intent(inout) :: ab(3*kd + 1, n)     !! matrix, then its factor [-]
    integer, intent(out) :: pivots(n)
    integer :: k, info
    call zgbtrf(n, n, kd, kd, ab, 3*kd + 1, pivots, info)
    do k = 1, n
      if (abs(ab(2*kd + 1, k)) <= least) ab(2*kd + 1, k) = max(least, epsilon(1.0_wp))
    end do
  end subroutine factor_band

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

  !> Bytes that the matrices keep.
  pure function memory(self) result(bytes)
    class(bordered_system), intent(in) :: self
    integer :: bytes, b
    bytes = 16*size(self%ab) + 32*size(self%kind)
    do b = 1, size(self%blocks)
      associate (p => self%blocks(b))
        bytes = bytes + 16*(size(p%ab) + size(p%right) + size(p%left))
      end associate
    end do
  end function memory
end module bordered
