!> A step of generalized_alpha for small motions about a steady turn, as the matrix of the map from step to step. In axes
!> that turn with the bodies the linearised equations and the rows are constant,
!>
!>   M x'' + C x' + K x + J^T lambda = 0       J x = 0
!>
!> but the method's sequences follow components in axes at rest: v = x' + W x, v' = x'' + 2 W x' + (W^2 + W') x in them, and a step
!> later each is seen from axes that have turned on. Eigenvalues above 1 are motions that the method makes grow (theory.md,
!> section 7).
module step_map
  use kinds, only: wp
  use generalized_alpha, only: alpha_method, alpha_step, step_coefficients
  use lapack, only: dgeev, dgesv
  use linear_matrices, only: linear_mechanism
  use triplets, only: triplet_matrix
  implicit none (type, external)
  private
  public :: turning_map

  !> The equations in components v and v' of axes at rest: M v' + C v + K x, rows J x, J (v - W x), J (v' - 2 W v + S x).
  type :: turning_map
    integer :: n = 0                       !! unknowns
    integer :: rows = 0                    !! independent constraint rows
    real(wp), allocatable :: m(:, :)       !! (n, n) [kg, kg m, kg m2]
    real(wp), allocatable :: c(:, :)       !! (n, n) [N s/m, N s, N m s]
    real(wp), allocatable :: k(:, :)       !! (n, n) [N/m, N, N m]
    real(wp), allocatable :: j(:, :)       !! (rows, n) [-, m]
    real(wp), allocatable :: turn(:, :)    !! (n, n) W: rates of the axes of origins [rad/s]
    real(wp), allocatable :: second(:, :)  !! (n, n) S = W^2 - W' [rad2/s2]
  contains
    procedure :: build
    procedure :: growth
  end type turning_map

contains

  !> From the linearisation in axes that turn with the bodies.
  subroutine build(self, lin, active, first, rate, acceleration)
    class(turning_map), intent(out) :: self
    type(linear_mechanism), intent(in) :: lin
    integer, intent(in) :: active(:)             !! (rows) the independent rows
    integer, intent(in) :: first(:)              !! (bodies) unknowns before those of each
    real(wp), intent(in) :: rate(:)              !! (bodies) of its axes [rad/s]
    real(wp), intent(in) :: acceleration(:)      !! (bodies) [rad/s2]
    real(wp) :: faster(lin%n, lin%n)             ! W' [rad/s2]
    real(wp) :: j(lin%rows, lin%n)               ! [-, m]
    integer :: b
    self%n = lin%n
    self%rows = size(active)
    allocate (self%m(lin%n, lin%n), self%c(lin%n, lin%n), self%k(lin%n, lin%n), self%turn(lin%n, lin%n), source=0.0_wp)
    faster = 0.0_wp
    j = 0.0_wp
    do b = 1, size(first)
      associate (x => first(b) + 1, y => first(b) + 2)
        self%turn(x, y) = -rate(b)
        self%turn(y, x) = rate(b)
        faster(x, y) = -acceleration(b)
        faster(y, x) = acceleration(b)
      end associate
    end do
    call fill(lin%mass, self%m)
    call fill(lin%damping, self%c)
    call fill(lin%stiffness, self%k)
    call fill(lin%jacobian, j)
    self%j = j(active, :)
    self%second = matmul(self%turn, self%turn) - faster
    self%k = self%k - matmul(self%c, self%turn) + matmul(self%m, self%second)
    self%c = self%c - 2*matmul(self%m, self%turn)
  end subroutine build

  !> A sparse matrix as a dense one.
  pure subroutine fill(entries, a)
    type(triplet_matrix), intent(in) :: entries
    real(wp), intent(inout) :: a(:, :)           !! [any]
    integer :: e
    do e = 1, entries%count
      associate (i => entries%rows(e), j => entries%cols(e))
        a(i, j) = a(i, j) + entries%values(e)
      end associate
    end do
  end subroutine fill

  !> Columns of a unit matrix, from one row on.
  pure function identity(n, columns, before) result(e)
    integer, intent(in) :: n, columns
    integer, intent(in) :: before                !! columns of zeros before the first of them
    real(wp) :: e(n, columns)                    !! [-]
    integer :: i
    e = 0.0_wp
    do i = 1, n
      e(i, before + i) = 1.0_wp
    end do
  end function identity

  !> The largest modulus of an eigenvalue of the map from (x, h v, h2 v', h3 lag, h offset) to the same a step later
  !> (`alpha_newton`, with the step for the unit of time); 0 where it cannot be computed.
  real(wp) function growth(self, method, h)
    class(turning_map), intent(in) :: self
    type(alpha_method), intent(in) :: method
    real(wp), intent(in) :: h                    !! [s]
    real(wp), dimension(self%n, 5*self%n) :: x, v, vd, lag, offset, a, a1
    real(wp), dimension(self%n, self%n) :: m, c, q, w, s
    real(wp), allocatable :: dx(:, :), d(:, :), g1(:, :), g2(:, :), map(:, :), wr(:), wi(:), work(:)
    type(alpha_step) :: step
    real(wp) :: left(1, 1), right(1, 1)
    integer :: i, info
    step = step_coefficients(method, 1.0_wp)
    m = self%m/h**2
    c = self%c/h
    w = self%turn*h
    s = self%second*h**2
    q = 0.0_wp                                   ! turns components back from axes that have turned on
    do i = 1, self%n
      q(i, i) = cos(maxval(abs(w(:, i))))
    end do
    where (abs(w) > 0.0_wp) q = -sin(w)
    associate (n => self%n, rows => self%rows, k => self%k, j => self%j)
      x = identity(n, 5*n, 0)
      v = identity(n, 5*n, n)
      vd = identity(n, 5*n, 2*n)
      lag = identity(n, 5*n, 3*n)
      offset = identity(n, 5*n, 4*n)
      a = vd + lag
      a1 = vd + step%aa*lag
      x = matmul(q, x + v + step%qa*a + step%qa1*a1 - offset)
      v = matmul(q, v + step%va*a + step%va1*a1 - offset)
      vd = matmul(q, vd)
      lag = matmul(q, lag)
      offset = matmul(q, offset)
      call solve(step%c1*m + step%c2*c + k, -(matmul(m, vd) + matmul(c, v) + matmul(k, x)), -matmul(j, x), dx, info)
      growth = 0.0_wp
      if (info /= 0) return
      call solve(m, 0*transpose(j), identity(rows, rows, 0), d, info)   ! motions that close the rows
      if (info /= 0) return
      a = vd
      x = x + dx
      v = v + step%c2*dx
      vd = vd + step%c1*dx
      g1 = matmul(j, v - matmul(w, x))
      g2 = matmul(j, vd - 2*matmul(w, v) + matmul(s, x))
      offset = -matmul(d, g2/step%c1 - matmul(j, offset))
      v = v - matmul(d, g1)
      vd = vd - matmul(d, g2)
      lag = step%aa*lag - (1 - step%ad1)*(vd - a)
      allocate (map(5*n, 5*n), wr(5*n), wi(5*n), work(40*n))
      map(1:n, :) = x
      map(n + 1:2*n, :) = v
      map(2*n + 1:3*n, :) = vd
      map(3*n + 1:4*n, :) = lag
      map(4*n + 1:, :) = offset
      call dgeev('N', 'N', 5*n, map, 5*n, wr, wi, left, 1, right, 1, work, size(work), info)
      if (info == 0) growth = maxval(hypot(wr, wi))
    end associate
  contains
    !> Solves T y + J^T mu = f, J y = g.
    subroutine solve(t, f, g, y, info)
      real(wp), intent(in) :: t(:, :)            !! (n, n) [N/m]
      real(wp), intent(in) :: f(:, :), g(:, :)   !! (n, columns) [N], (rows, columns) [m]
      real(wp), allocatable, intent(out) :: y(:, :)   !! (n, columns) [m]
      integer, intent(out) :: info
      real(wp) :: a(self%n + self%rows, self%n + self%rows), b(self%n + self%rows, size(f, 2)), scale
      integer :: pivots(self%n + self%rows)
      scale = maxval(abs(t))                     ! of the rows, as large as T
      a = 0.0_wp
      a(1:self%n, 1:self%n) = t
      a(self%n + 1:, 1:self%n) = scale*self%j
      a(1:self%n, self%n + 1:) = scale*transpose(self%j)
      b(1:self%n, :) = f
      b(self%n + 1:, :) = scale*g
      call dgesv(size(a, 1), size(b, 2), a, size(a, 1), pivots, b, size(a, 1), info)
      y = b(1:self%n, :)
    end subroutine solve
  end function growth
end module step_map
