!> The lowest solutions of K x = omega2 M x from a Krylov space, for any K and M whose products with a vector are given.
module block_lanczos
  use kinds, only: wp
  use lapack, only: dsyev
  use posix, only: caught_signal
  implicit none (type, external)
  private
  public :: krylov_modes, iterate_subspace, inverse_iteration, orthonormalise

  integer, parameter :: width = 3              !! vectors in a block: a chain of beams has no frequency more often
  integer, parameter :: most_gram_schmidt = 6  !! passes that make a vector orthogonal to those before

  !> The products, within the space of motions whose modes are sought.
  type, abstract, public :: inertia_operator
    real(wp) :: shift = 0.0_wp                 !! [rad2/s2]
  contains
    procedure(apply), deferred :: solve
    procedure(multiply), deferred :: mass_times
  end type inertia_operator

  abstract interface
    !> y <- (K + shift M)^-1 y.
    subroutine apply(self, y)
      import :: inertia_operator, wp
      class(inertia_operator), intent(inout) :: self
      real(wp), intent(inout) :: y(:)          !! forces [N, N m], then displacements [m, rad]
    end subroutine apply
    !> M x.
    pure function multiply(self, x) result(y)
      import :: inertia_operator, wp
      class(inertia_operator), intent(in) :: self
      real(wp), intent(in) :: x(:)             !! [m, rad]
      real(wp) :: y(size(x))                   !! [kg m, kg m2]
    end function multiply
  end interface

contains

  !> Approximate lowest modes, by the block Lanczos method with full orthogonalisation (Golub & Underwood 1977).
  subroutine krylov_modes(op, dimension, x, lambda, ok)
    class(inertia_operator), intent(inout) :: op
    integer, intent(in) :: dimension           !! of the Krylov space
    real(wp), intent(out) :: x(:, :)           !! (n, p) mass-orthonormal [m, rad, over kg^.5 m]
    real(wp), intent(out) :: lambda(:)         !! (p) squared frequencies + shift [rad2/s2]
    logical, intent(out) :: ok                 !! false: not solvable, or stopped by a signal
    real(wp), allocatable :: y(:, :), my(:, :), t(:, :), theta(:), part(:), work(:)
    real(wp) :: length
    integer :: i, j, n, p, info
    integer :: growing                         ! motions with a negative squared frequency + shift
    integer, allocatable :: nearest(:)         ! solutions next to the shift
    n = dimension
    p = size(x, 2)
    allocate (y(size(x, 1), n + width), my(size(x, 1), n + width), theta(n), work(40*n))
    allocate (t(n + width, -width + 1:n), source=0.0_wp)
    do j = 1, n + width
      ok = caught_signal() == 0
      if (.not. ok) return
      if (j > width) then
        y(:, j) = my(:, j - width)
      else
        y(:, j) = op%mass_times([(sin(real(i, wp)*(j + 0.37_wp)*1.7_wp), i=1, size(x, 1))])
      end if
      call op%solve(y(:, j))
      call orthonormalise(op, y(:, 1:j - 1), y(:, j), my(:, j), part, length)
      t(1:j - 1, j - width) = part
    end do
    call dsyev('V', 'U', n, t(1:n, 1:n), n, theta, work, size(work), info)
    ok = info == 0
    growing = 0
    do j = 1, p
      if (-theta(growing + 1) > theta(n - (j - 1 - growing))) growing = growing + 1
    end do
    nearest = [(i, i=growing, 1, -1), (i, i=n, n - p + growing + 1, -1)]
    x = matmul(y(:, 1:n), t(1:n, nearest))
    lambda = 1.0_wp/sign(max(abs(theta(nearest)), epsilon(1.0_wp)*maxval(abs(theta))), theta(nearest))
  end subroutine krylov_modes

  !> One pass of subspace iteration (Bathe, Finite Element Procedures): x <- (K + shift M)^-1 M x, made mass-orthonormal with the
  !> forces that cause it, since inverse iteration leaves its columns nearly parallel on fine meshes; then Rayleigh-Ritz.
  subroutine iterate_subspace(op, x, lambda, ok)
    class(inertia_operator), intent(inout) :: op
    real(wp), intent(inout) :: x(:, :)         !! (n, p) [m, rad, over kg^.5 m]
    real(wp), intent(out) :: lambda(:)         !! (p) squared frequencies + shift [rad2/s2]
    logical, intent(out) :: ok                 !! false: a column has no mass of its own
    real(wp) :: f(size(x, 1), size(x, 2))      ! (K + shift M) x [N, N m, over kg^.5 m]
    real(wp) :: h(size(x, 2), size(x, 2)), work(40*size(x, 2))
    integer :: info
    call inverse_iteration(op, x, f, ok)
    if (.not. ok) return
    h = matmul(transpose(x), f)
    h = 0.5_wp*(h + transpose(h))
    call dsyev('V', 'U', size(x, 2), h, size(x, 2), lambda, work, size(work), info)
    ok = info == 0
    x = matmul(x, h)
  end subroutine iterate_subspace

  !> x <- (K + shift M)^-1 M x with the forces f that cause it, mass-orthonormal in turn.
  subroutine inverse_iteration(op, x, f, ok)
    class(inertia_operator), intent(inout) :: op
    real(wp), intent(inout) :: x(:, :)         !! (n, p) [m, rad, over kg^.5 m]
    real(wp), intent(out) :: f(:, :)           !! (n, p) [N, N m, over kg^.5 m]
    logical, intent(out) :: ok                 !! false: a column has no mass of its own
    real(wp) :: mx(size(x, 1)), length
    real(wp), allocatable :: part(:)
    integer :: j
    ok = .true.
    do j = 1, size(x, 2)
      f(:, j) = op%mass_times(x(:, j))
      x(:, j) = f(:, j)
      call op%solve(x(:, j))
      call orthonormalise(op, x(:, 1:j - 1), x(:, j), mx, part, length)
      ok = length > 0.0_wp
      if (.not. ok) return
      f(:, j) = (f(:, j) - matmul(f(:, 1:j - 1), part))/length
    end do
  end subroutine inverse_iteration

  !> Makes x mass-orthogonal to mass-orthonormal columns, until a pass takes away rounding only, and normalises it.
  subroutine orthonormalise(op, basis, x, mx, part, length)
    class(inertia_operator), intent(in) :: op
    real(wp), intent(in) :: basis(:, :)        !! (n, m) [m, rad, over kg^.5 m]
    real(wp), intent(inout) :: x(:)            !! (n) [m, rad], then [m, rad, over kg^.5 m]
    real(wp), intent(out) :: mx(:)             !! (n) M x [kg m, kg m2, over kg^.5 m]
    real(wp), allocatable, intent(out) :: part(:)   !! (m) how much of each column was in x [kg^.5 m]
    real(wp), intent(out) :: length            !! of what is left of it; 0: nothing [kg^.5 m]
    real(wp) :: before, c(size(basis, 2))      ! [kg^.5 m]
    integer :: pass
    allocate (part(size(basis, 2)), source=0.0_wp)
    mx = op%mass_times(x)
    length = sqrt(max(dot_product(x, mx), 0.0_wp))
    do pass = 1, merge(most_gram_schmidt, 0, size(basis, 2) > 0)
      before = length
      c = matmul(mx, basis)
      x = x - matmul(basis, c)
      part = part + c
      mx = op%mass_times(x)
      length = sqrt(max(dot_product(x, mx), 0.0_wp))
      if (length > 0.5_wp*before) exit
    end do
    x = x/max(length, sqrt(tiny(length)))
    mx = mx/max(length, sqrt(tiny(length)))
  end subroutine orthonormalise
end module block_lanczos
