!> The lowest modes of a flexible body under its reference conditions (free-free modes for reference 'free'), mass-normalised
!> with lumps included: densely for small bodies, by subspace iteration beyond. Set-up work only.
module body_modes
  use kinds, only: wp
  use banded, only: band_factor, factor_symmetric, band_solve
  use body, only: body_model
  use body_matrices, only: mass_matrix, mass_triplets, stiffness_triplets
  use lapack, only: dsyev, dsygvd
  implicit none (type, external)
  private
  public :: lowest_modes, add_static_shapes

  integer, parameter :: dense_size = 90   !! coordinates up to which all modes are computed densely: beyond, the lowest lose digits
  integer, parameter :: width = 3         !! vectors in a block of the Krylov space: a chain of beams has no frequency more often
  integer, parameter :: polish_passes = 2, most_gram_schmidt = 6
  integer, parameter :: static_passes = 3 !! solutions with a shifted stiffness until a static one is exact
  real(wp), parameter :: dependent = 1.0e-7_wp   !! what is left of a shape that the others already contain [-]
  real(wp), parameter :: far_below = 1.0e-3_wp   !! of the largest squared frequency: dense modes below it are polished [-]

contains

  !> Lowest elastic modes in nodal coordinates: x (nf, modes) mass-normalised, w squared frequencies [rad2/s2].
  subroutine lowest_modes(b, modes, x, w, bad)
    type(body_model), intent(in) :: b
    integer, intent(in) :: modes
    real(wp), allocatable, intent(out) :: x(:, :), w(:)
    logical, intent(out) :: bad
    real(wp), allocatable :: rigid(:, :)
    type(mass_matrix) :: mass
    call mass%assemble(b)
    call rigid_modes(b, mass, rigid)
    if (b%nf <= dense_size .or. 2*(modes + size(rigid, 2)) >= b%nf) then
      call dense_modes(b, mass, modes, rigid, x, w, bad)
    else
      call subspace_modes(b, mass, modes, rigid, x, w, bad)
    end if
  end subroutine lowest_modes

  !> Appends to the modes the static shapes of given loads (Craig & Bampton 1968; with free rigid motions their inertia balances
  !> the load: Craig & Chang 1977). The shapes are made mass-orthogonal to the modes and
  !> then diagonalise the stiffness among themselves, so that K stays diag(w). Those that others contain are left out.
  subroutine add_static_shapes(b, loads, x, w, bad)
    type(body_model), intent(in) :: b
    real(wp), intent(in) :: loads(:, :)                  !! (nf, loads) [N, N m]
    real(wp), allocatable, intent(inout) :: x(:, :)      !! (nf, modes), then (nf, modes + shapes) [m, rad, over kg^.5 m]
    real(wp), allocatable, intent(inout) :: w(:)         !! their squared frequencies, Rayleigh quotients of shapes [rad2/s2]
    logical, intent(out) :: bad
    type(mass_matrix) :: mass
    type(band_factor) :: factor
    real(wp), allocatable :: rigid(:, :), y(:, :), f(:, :), kk(:, :), lambda(:), work(:)
    real(wp) :: shift, left
    integer :: j, n, m, info
    call mass%assemble(b)
    call rigid_modes(b, mass, rigid)
    call factor_shifted(b, size(rigid, 2) > 0, factor, shift, bad)
    if (bad) return
    m = size(x, 2)
    allocate (y(b%nf, m + size(loads, 2)), f(b%nf, m + size(loads, 2)))
    y(:, 1:m) = x
    do j = 1, m
      f(:, j) = (w(j) + shift)*mass%times(x(:, j))
    end do
    n = m
    do j = 1, size(loads, 2)
      call static_shape(mass, factor, shift, rigid, loads(:, j), y(:, n + 1), f(:, n + 1))
      if (norm2(f(:, n + 1)) <= dependent*norm2(loads(:, j))) cycle      ! a load that rigid motions alone balance, or none
      call orthogonalise_last(mass, y(:, 1:n + 1), f(:, 1:n + 1), left)
      if (left > dependent) n = n + 1
    end do
    allocate (lambda(n - m), work(40*(n - m) + 1))
    kk = matmul(transpose(y(:, m + 1:n)), f(:, m + 1:n))
    call dsyev('V', 'U', n - m, kk, max(1, n - m), lambda, work, size(work), info)
    bad = info /= 0
    if (bad) return
    x = reshape([x, matmul(y(:, m + 1:n), kk)], [b%nf, n])
    w = [w, lambda - shift]
  end subroutine add_static_shapes

  !> Displacements y under a load, balanced by the inertia of free rigid motions, and the force f with (K + shift M) y = f.
  subroutine static_shape(mass, factor, shift, rigid, load, y, f)
    type(mass_matrix), intent(in) :: mass
    type(band_factor), intent(inout) :: factor           !! of K + shift M
    real(wp), intent(in) :: shift                        !! [rad2/s2]
    real(wp), intent(in) :: rigid(:, :)                  !! (nf, n) rigid motions, mass-orthonormal [kg^-.5, ...]
    real(wp), intent(in) :: load(:)                      !! (nf) [N, N m]
    real(wp), intent(out) :: y(:)                        !! (nf) [m, rad]
    real(wp), intent(out) :: f(:)                        !! (nf) [N, N m]
    real(wp) :: balanced(size(f))                        ! [N, N m]
    integer :: i, pass
    balanced = load
    do i = 1, size(rigid, 2)
      balanced = balanced - dot_product(rigid(:, i), load)*mass%times(rigid(:, i))
    end do
    y = 0.0_wp
    do pass = 1, static_passes
      f = balanced + shift*mass%times(y)
      y = f
      call solve_elastic(mass, factor, rigid, y)
      if (size(rigid, 2) == 0) exit                      ! no shift
    end do
  end subroutine static_shape

  !> Mass-orthonormal rigid motions that the reference conditions leave free (reference 'free' only).
  subroutine rigid_modes(b, mass, rigid)
    type(body_model), intent(in) :: b
    type(mass_matrix), intent(in) :: mass
    real(wp), allocatable, intent(out) :: rigid(:, :)   !! (nf, n)
    real(wp) :: u(3)
    integer :: k, c, m, n, first
    if (any(b%dof(2:3, :) == 0)) then
      allocate (rigid(b%nf, 0))
      return
    end if
    first = merge(1, 2, b%axial)
    n = 0
    allocate (rigid(b%nf, 4 - first))
    do m = first, 3
      n = n + 1
      do k = 1, b%nn
        u = 0.0_wp
        u(m) = 1.0_wp
        if (m == 3) u(1:2) = [-b%x(2, k), b%x(1, k)]
        do c = 1, 3
          if (b%dof(c, k) > 0) rigid(b%dof(c, k), n) = u(c)
        end do
      end do
      call orthogonalise(mass, rigid(:, 1:n - 1), rigid(:, n))
    end do
  end subroutine rigid_modes

  !> Makes x mass-orthogonal to mass-orthonormal columns (twice, to rounding) and normalises it.
  subroutine orthogonalise(mass, basis, x)
    type(mass_matrix), intent(in) :: mass
    real(wp), intent(in) :: basis(:, :)
    real(wp), intent(inout) :: x(:)
    real(wp), allocatable :: mx(:)
    integer :: pass, k
    do pass = 1, 2
      do k = 1, size(basis, 2)
        mx = mass%times(x)
        x = x - dot_product(basis(:, k), mx)*basis(:, k)
      end do
    end do
    mx = mass%times(x)
    x = x/sqrt(dot_product(x, mx))
  end subroutine orthogonalise

  !> All modes of a small body.
  subroutine dense_modes(b, mass, modes, rigid, x, w, bad)
    type(body_model), intent(in) :: b
    type(mass_matrix), intent(in) :: mass
    integer, intent(in) :: modes
    real(wp), intent(in) :: rigid(:, :)
    real(wp), allocatable, intent(out) :: x(:, :), w(:)
    logical, intent(out) :: bad
    real(wp), allocatable :: k(:, :), m(:, :), lambda(:)
    integer :: nr, j
    call dense_pair(b, k, m)
    allocate (lambda(b%nf))
    call symmetric_pair(k, m, lambda, bad)
    if (bad) return
    nr = size(rigid, 2)
    allocate (x(b%nf, modes), w(modes))
    x = k(:, nr + 1:nr + modes)
    w = lambda(nr + 1:nr + modes)
    if (nr > 0) then
      do j = 1, modes
        call orthogonalise(mass, rigid, x(:, j))
      end do
    end if
    call polish(b, mass, count(w <= far_below*lambda(b%nf)), rigid, x, w, bad)
  end subroutine dense_modes

  !> Repeats inverse iteration on the lowest modes of a dense solution, whose errors are those of its highest frequency:
  !> with a heavy lump on a light beam they are a large part of the lowest. Frequencies are Rayleigh quotients.
  subroutine polish(b, mass, low, rigid, x, w, bad)
    type(body_model), intent(in) :: b
    type(mass_matrix), intent(in) :: mass
    integer, intent(in) :: low                           !! how many modes
    real(wp), intent(in) :: rigid(:, :)
    real(wp), intent(inout) :: x(:, :), w(:)
    logical, intent(out) :: bad
    type(band_factor) :: factor
    real(wp), allocatable :: f(:, :)
    real(wp) :: shift
    integer :: j, pass
    bad = .false.
    if (low == 0) return
    call factor_shifted(b, size(rigid, 2) > 0, factor, shift, bad)
    if (bad) return
    allocate (f(size(x, 1), low))
    do pass = 1, polish_passes
      do j = 1, low
        f(:, j) = mass%times(x(:, j))
        x(:, j) = f(:, j)
        call solve_elastic(mass, factor, rigid, x(:, j))
      end do
      call orthogonalise_pair(mass, x(:, 1:low), f)
    end do
    do j = 1, low
      w(j) = dot_product(x(:, j), f(:, j)) - shift
    end do
  end subroutine polish

  !> K and m_ff as dense matrices.
  subroutine dense_pair(b, k, m)
    type(body_model), intent(in) :: b
    real(wp), allocatable, intent(out) :: k(:, :), m(:, :)
    integer, allocatable :: rows(:), cols(:)
    real(wp), allocatable :: values(:)
    integer :: i
    allocate (k(b%nf, b%nf), m(b%nf, b%nf), source=0.0_wp)
    call stiffness_triplets(b, rows, cols, values)
    do i = 1, size(rows)
      k(rows(i), cols(i)) = k(rows(i), cols(i)) + values(i)
      if (rows(i) /= cols(i)) k(cols(i), rows(i)) = k(cols(i), rows(i)) + values(i)
    end do
    call mass_triplets(b, rows, cols, values)
    do i = 1, size(rows)
      m(rows(i), cols(i)) = m(rows(i), cols(i)) + values(i)
      if (rows(i) /= cols(i)) m(cols(i), rows(i)) = m(cols(i), rows(i)) + values(i)
    end do
  end subroutine dense_pair

  !> K x = w M x, dense; eigenvectors replace K.
  subroutine symmetric_pair(k, m, w, bad)
    real(wp), intent(inout) :: k(:, :), m(:, :)
    real(wp), intent(out) :: w(:)
    logical, intent(out) :: bad
    real(wp), allocatable :: work(:)
    integer, allocatable :: iwork(:)
    integer :: n, info
    n = size(k, 1)
    allocate (work(1 + 6*n + 2*n*n), iwork(3 + 5*n))
    call dsygvd(1, 'V', 'L', n, k, n, m, n, w, work, size(work), iwork, size(iwork), info)
    bad = info /= 0
  end subroutine symmetric_pair

  !> Lowest modes by subspace iteration with the banded factor of K + shift M (Bathe, Finite Element Procedures), from the
  !> modes of a Krylov space, which are exact but for rounding.
  subroutine subspace_modes(b, mass, modes, rigid, x, w, bad)
    type(body_model), intent(in) :: b
    type(mass_matrix), intent(in) :: mass
    integer, intent(in) :: modes                         !! modes wanted
    real(wp), intent(in) :: rigid(:, :)
    real(wp), allocatable, intent(out) :: x(:, :), w(:)
    logical, intent(out) :: bad
    type(band_factor) :: factor
    real(wp), allocatable :: y(:, :), f(:, :), kk(:, :), mm(:, :)
    real(wp), allocatable :: lambda(:), old(:)           ! squared frequencies + shift, of the last pass [rad2/s2]
    real(wp) :: shift, change, before                    ! changes of the frequencies, relative to themselves
    integer :: j, p, pass
    call factor_shifted(b, size(rigid, 2) > 0, factor, shift, bad)
    if (bad) return
    p = min(b%nf - size(rigid, 2), modes + 8)
    call krylov_modes(mass, factor, rigid, p, y, old, bad)
    if (bad) return
    allocate (f(b%nf, p), lambda(p))
    before = huge(1.0_wp)
    do pass = 1, 200
      do j = 1, p
        f(:, j) = mass%times(y(:, j))
        y(:, j) = f(:, j)
        call solve_elastic(mass, factor, rigid, y(:, j))
        y(:, j) = old(j)*y(:, j)                         ! nearly orthonormal: the modes are
        f(:, j) = old(j)*f(:, j)
      end do
      kk = matmul(transpose(y), f)
      do j = 1, p
        f(:, j) = mass%times(y(:, j))
      end do
      mm = matmul(transpose(y), f)
      call symmetric_pair(kk, mm, lambda, bad)
      if (bad) return
      y = matmul(y, kk)
      change = maxval(abs(lambda(1:modes) - old(1:modes))/lambda(1:modes))
      if (change <= 1.0e-14_wp .or. (change < 1.0e-9_wp .and. change > 0.5_wp*before)) exit      ! rounding alone is left
      old = lambda
      before = change
    end do
    x = y(:, 1:modes)
    w = lambda(1:modes) - shift
    do j = 1, modes
      call orthogonalise(mass, rigid, x(:, j))
    end do
    call polish(b, mass, count(w <= far_below*w(modes)), rigid, x, w, bad)
  end subroutine subspace_modes

  !> Approximate lowest modes from the Krylov space of (K + shift M)^-1 M, mass-orthonormal, by the block Lanczos method with full
  !> orthogonalisation (Golub & Underwood 1977).
  subroutine krylov_modes(mass, factor, rigid, p, x, lambda, bad)
    type(mass_matrix), intent(in) :: mass
    type(band_factor), intent(inout) :: factor
    real(wp), intent(in) :: rigid(:, :)
    integer, intent(in) :: p                             !! modes
    real(wp), allocatable, intent(out) :: x(:, :)        !! (nf, p)
    real(wp), allocatable, intent(out) :: lambda(:)      !! (p) squared frequencies + shift [rad2/s2]
    logical, intent(out) :: bad
    real(wp), allocatable :: y(:, :), my(:, :), t(:, :), c(:), theta(:), work(:)
    real(wp) :: before, now
    integer :: i, j, n, info, pass
    n = min(size(rigid, 1) - size(rigid, 2), 2*p + 20)
    allocate (y(size(rigid, 1), n + width), my(size(rigid, 1), n + width), theta(n), work(40*n))
    allocate (t(n + width, -width + 1:n), source=0.0_wp)
    do j = 1, n + width
      if (j > width) then
        y(:, j) = my(:, j - width)
      else
        y(:, j) = [(sin(real(i, wp)*(j + 0.37_wp)*1.7_wp), i=1, size(y, 1))]
      end if
      call solve_elastic(mass, factor, rigid, y(:, j))
      before = huge(1.0_wp)
      do pass = 1, most_gram_schmidt
        c = matmul(y(:, j), my(:, 1:j - 1))
        y(:, j) = y(:, j) - matmul(y(:, 1:j - 1), c)
        t(1:j - 1, j - width) = t(1:j - 1, j - width) + c
        my(:, j) = mass%times(y(:, j))
        now = sqrt(max(dot_product(y(:, j), my(:, j)), tiny(1.0_wp)))
        if (pass > 1 .and. now > 0.5_wp*before) exit
        before = now
      end do
      y(:, j) = y(:, j)/now
      my(:, j) = my(:, j)/now
    end do
    call dsyev('V', 'U', n, t(1:n, 1:n), n, theta, work, size(work), info)
    bad = info /= 0
    x = matmul(y(:, 1:n), t(1:n, n:n - p + 1:-1))
    lambda = 1.0_wp/max(theta(n:n - p + 1:-1), epsilon(1.0_wp)*theta(n))
  end subroutine krylov_modes

  !> y <- (K + shift M)^-1 y without rigid motions.
  subroutine solve_elastic(mass, factor, rigid, y)
    type(mass_matrix), intent(in) :: mass
    type(band_factor), intent(inout) :: factor
    real(wp), intent(in) :: rigid(:, :)
    real(wp), intent(inout) :: y(:)                      !! forces, then displacements
    integer :: i
    call band_solve(factor, y)
    do i = 1, size(rigid, 2)
      y = y - dot_product(rigid(:, i), mass%times(y))*rigid(:, i)
    end do
  end subroutine solve_elastic

  !> Makes the columns of y = K^-1 f mass-orthonormal, f with them: inverse iteration leaves them nearly parallel on fine
  !> meshes, and their products then lose the small differences.
  subroutine orthogonalise_pair(mass, y, f)
    type(mass_matrix), intent(in) :: mass
    real(wp), intent(inout) :: y(:, :)                   !! displacements
    real(wp), intent(inout) :: f(:, :)                   !! the forces that cause them
    real(wp) :: left
    integer :: j
    do j = 1, size(y, 2)
      call orthogonalise_last(mass, y(:, 1:j), f(:, 1:j), left)
    end do
  end subroutine orthogonalise_pair

  !> Makes the last column of y = K^-1 f mass-orthogonal to the others, which are mass-orthonormal, and normalises it; f with it.
  subroutine orthogonalise_last(mass, y, f, left)
    type(mass_matrix), intent(in) :: mass
    real(wp), intent(inout) :: y(:, :)                   !! displacements [m, rad]
    real(wp), intent(inout) :: f(:, :)                   !! the forces that cause them [N, N m]
    real(wp), intent(out) :: left                        !! share of the column that the others do not contain [-]
    real(wp), allocatable :: my(:), c(:)
    real(wp) :: norm
    integer :: j, pass
    j = size(y, 2)
    left = 1.0_wp
    do pass = 1, most_gram_schmidt
      my = mass%times(y(:, j))
      norm = 1.0_wp/sqrt(max(dot_product(y(:, j), my), tiny(norm)))
      if (pass > 1) left = left/norm
      y(:, j) = norm*y(:, j)
      f(:, j) = norm*f(:, j)
      if (pass > 1 .and. norm < 2.0_wp) exit             ! the last pass took away rounding only
      c = matmul(norm*my, y(:, 1:j - 1))
      y(:, j) = y(:, j) - matmul(y(:, 1:j - 1), c)
      f(:, j) = f(:, j) - matmul(f(:, 1:j - 1), c)
    end do
  end subroutine orthogonalise_last

  !> Factor of K, or of K + shift M where rigid motions are free.
  subroutine factor_shifted(b, shifted, factor, shift, bad)
    type(body_model), intent(in) :: b
    logical, intent(in) :: shifted
    type(band_factor), intent(out) :: factor
    real(wp), intent(out) :: shift                       !! [rad2/s2]
    logical, intent(out) :: bad
    integer, allocatable :: rows(:), cols(:), mr(:), mc(:)
    real(wp), allocatable :: values(:), mv(:)
    integer :: where_bad
    real(wp) :: l
    call stiffness_triplets(b, rows, cols, values)
    shift = 0.0_wp
    if (shifted) then       ! of the order of the lowest bending frequency of the body as one beam
      l = max(b%length, tiny(1.0_wp))
      shift = minval(b%elements%ei_l*b%elements%length)/(b%mass*l**3)
      call mass_triplets(b, mr, mc, mv)
      rows = [rows, mr]
      cols = [cols, mc]
      values = [values, shift*mv]
    end if
    call factor_symmetric(b%nf, rows, cols, values, factor, where_bad)
    bad = where_bad > 0
  end subroutine factor_shifted
end module body_modes
