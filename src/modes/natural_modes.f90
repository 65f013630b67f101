!> Undamped modes of the linearised mechanism, K x = omega^2 M x on J x = 0 (K without its skew part, no gyroscopic terms):
!> subspace iteration with the bordered matrix, which keeps every multiple frequency and every rigid motion. Small systems
!> start from the dense solution on the null space of J, large ones from fixed pseudo-random vectors.
module natural_modes
  use kinds, only: wp
  use dynamic_stiffness, only: stiffness_system
  use lapack, only: dgeqp3, dorgqr, dsygvd, dsyev
  use process, only: caught_signal
  implicit none (type, external)
  private
  public :: natural_subspace, rounding_level

  integer, parameter :: small = 300                !! unknowns up to which the dense start is cheap
  integer, parameter :: most_passes = 80, most_rounds = 6, most_gram_schmidt = 6
  integer, parameter :: width = 3                  !! vectors in a block: a chain of beams has no frequency more often
  real(wp), parameter :: small_shift = 1.0e-8_wp   !! first shift over the largest ratio of stiffness and mass [-]
  real(wp), parameter :: settled = 1.0e-13_wp      !! relative change of omega^2 [-]
  real(wp), parameter :: at_floor = 1.0e-10_wp     !! change that no longer shrinks and is rounding [-]

contains

  !> The lowest modes: mass-normalised vectors and squared frequencies, ascending. At least `wanted` of them are converged
  !> (fewer only where the system has fewer degrees of freedom); the subspace is larger.
  subroutine natural_subspace(ds, wanted, omega2, x, ok)
    type(stiffness_system), intent(inout) :: ds
    integer, intent(in) :: wanted
    real(wp), allocatable, intent(out) :: omega2(:)   !! (p) [rad2/s2]
    real(wp), allocatable, intent(out) :: x(:, :)     !! (n, p) [1/sqrt(kg)]
    logical, intent(out) :: ok
    integer :: free, p, pass
    real(wp) :: shift, noise, change, last
    logical :: settled_yet
    real(wp), allocatable :: before(:), moved(:), scale(:)
    free = ds%n - ds%rows
    p = min(free, merge(wanted + 8, max(2*wanted, wanted + 8), ds%symmetric .and. .not. ds%damped))
    ok = .true.
    allocate (omega2(p), x(ds%n, p))
    if (p == 0) return
    shift = first_shift(ds)
    noise = epsilon(1.0_wp)*shift/small_shift          ! rounding of the largest frequencies [rad2/s2]
    if (ds%n <= small .or. 2*p > free) then
      call dense_start(ds, p, omega2, x, ok)
      if (.not. ok) return
      call shift_matrix(ds, shift)
    else
      call krylov_start(ds, shift, omega2, x, ok)
      if (.not. ok) return
    end if
    settled_yet = .false.
    change = huge(1.0_wp)
    do pass = 1, most_passes
      ok = caught_signal() == 0
      if (.not. ok) return
      before = omega2
      call iterate(ds, omega2, x, ok)
      if (.not. ok) return
      if (pass == 2 .or. pass == 5) then
        shift = better_shift(omega2, shift)
        call shift_matrix(ds, shift)
      end if
      associate (w => min(wanted, p))
        moved = abs(omega2(1:w) - before(1:w))
        scale = abs(omega2(1:w)) + shift
        last = change
        change = maxval(moved/scale)
        settled_yet = pass > 1 .and. (change <= settled .or. &           ! or rounding alone changes it
                                      (all(moved <= at_floor*scale + noise) .and. change >= 0.5_wp*last))
        if (settled_yet) exit
      end associate
    end do
    do pass = 1, p                            ! what Rayleigh-Ritz blurs by the largest frequency
      omega2(pass) = dot_product(x(:, pass), ds%stiffness_times(x(:, pass), .false.))
    end do
    ok = settled_yet
  end subroutine natural_subspace

  !> K + shift M, factored.
  subroutine shift_matrix(ds, shift)
    type(stiffness_system), intent(inout) :: ds
    real(wp), intent(in) :: shift             !! [rad2/s2]
    call ds%set_real(shift, .true.)
    call ds%factor()
  end subroutine shift_matrix

  !> A shift that surely makes K + shift M regular where rigid motions are left: small beside the largest frequency.
  pure function first_shift(ds) result(shift)
    type(stiffness_system), intent(in) :: ds
    real(wp) :: shift, ratio
    ratio = fastest(ds)
    shift = merge(small_shift*ratio, 1.0_wp, ratio > 0.0_wp)
  end function first_shift

  !> A shift below the lowest frequency that is not zero.
  pure function better_shift(omega2, shift) result(better)
    real(wp), intent(in) :: omega2(:), shift
    real(wp) :: better
    integer :: k
    better = shift
    do k = 1, size(omega2)
      if (abs(omega2(k)) <= 1.0e-9_wp*abs(omega2(size(omega2)))) cycle
      better = 0.3_wp*abs(omega2(k))
      return
    end do
  end function better_shift

  !> Approximate lowest modes from Krylov spaces of (K + shift M)^-1 M: small ones until the shift is near the lowest frequency,
  !> then a large one. A block of as many vectors as a chain of beams may have equal frequencies.
  subroutine krylov_start(ds, shift, omega2, x, ok)
    type(stiffness_system), intent(inout) :: ds
    real(wp), intent(inout) :: shift                   !! [rad2/s2]
    real(wp), intent(out) :: omega2(:)                 !! (p) [rad2/s2]
    real(wp), intent(out) :: x(:, :)                   !! (n, p) [1/sqrt(kg)]
    logical, intent(out) :: ok
    real(wp) :: near
    integer :: round, q
    q = min(size(x, 2), 5)
    do round = 1, most_rounds
      call shift_matrix(ds, shift)
      call krylov_modes(ds, shift, 3*q, omega2(1:q), x(:, 1:q), ok)
      if (.not. ok) return
      near = better_shift(omega2(1:q), shift)
      if (abs(log(near/shift)) < 2.0_wp) exit
      shift = near
    end do
    call krylov_modes(ds, shift, 2*size(x, 2) + 20, omega2, x, ok)
  end subroutine krylov_start

  !> Modes on a Krylov space, by the block Lanczos method with full orthogonalisation (Golub &
  !> Underwood 1977).
  subroutine krylov_modes(ds, shift, most, omega2, x, ok)
    type(stiffness_system), intent(inout) :: ds
    real(wp), intent(in) :: shift                      !! of the factored matrix [rad2/s2]
    integer, intent(in) :: most                        !! dimension of the space
    real(wp), intent(out) :: omega2(:)                 !! (p) [rad2/s2]
    real(wp), intent(out) :: x(:, :)                   !! (n, p) [1/sqrt(kg)]
    logical, intent(out) :: ok
    real(wp), allocatable :: y(:, :), my(:, :), t(:, :), c(:), theta(:), work(:)
    real(wp) :: before, now
    integer :: i, j, n, p, info, pass
    p = size(x, 2)
    n = min(ds%n - ds%rows, most)
    allocate (y(ds%n, n + width), my(ds%n, n + width), theta(n), work(40*n))
    allocate (t(n + width, -width + 1:n), source=0.0_wp)
    do j = 1, n + width
      ok = caught_signal() == 0
      if (.not. ok) return
      if (j > width) then
        y(:, j) = my(:, j - width)
      else
        y(:, j) = real_product(ds, ds%m, [(sin(real(i, wp)*(j + 0.37_wp)*1.7_wp), i=1, ds%n)])
      end if
      call solve_real(ds, y(:, j))
      before = huge(1.0_wp)
      do pass = 1, most_gram_schmidt
        c = matmul(y(:, j), my(:, 1:j - 1))
        y(:, j) = y(:, j) - matmul(y(:, 1:j - 1), c)
        t(1:j - 1, j - width) = t(1:j - 1, j - width) + c
        my(:, j) = real_product(ds, ds%m, y(:, j))
        now = sqrt(max(dot_product(y(:, j), my(:, j)), tiny(1.0_wp)))
        if (pass > 1 .and. now > 0.5_wp*before) exit
        before = now
      end do
      y(:, j) = y(:, j)/now
      my(:, j) = my(:, j)/now
    end do
    call dsyev('V', 'U', n, t(1:n, 1:n), n, theta, work, size(work), info)
    ok = info == 0
    x = matmul(y(:, 1:n), t(1:n, n:n - p + 1:-1))
    omega2 = 1.0_wp/theta(n:n - p + 1:-1) - shift
  end subroutine krylov_modes

  !> y <- (K + shift M)^-1 y on the constraints.
  subroutine solve_real(ds, y)
    type(stiffness_system), intent(inout) :: ds
    real(wp), intent(inout) :: y(:)                    !! (n) forces, then displacements
    complex(wp) :: z(ds%n + ds%rows)
    z = 0.0_wp
    z(1:ds%n) = y
    call ds%solve(z)
    y = real(z(1:ds%n), wp)
  end subroutine solve_real

  !> One pass: x <- (K + shift M)^-1 M x on the constraints, orthonormal in M, then Rayleigh-Ritz.
  subroutine iterate(ds, omega2, x, ok)
    type(stiffness_system), intent(inout) :: ds
    real(wp), intent(inout) :: omega2(:), x(:, :)
    logical, intent(out) :: ok
    real(wp), allocatable :: kx(:, :), h(:, :), work(:)
    integer :: j, p, info
    p = size(x, 2)
    allocate (kx(ds%n, p), h(p, p), work(40*p))
    do j = 1, p
      x(:, j) = real_product(ds, ds%m, x(:, j))
      call solve_real(ds, x(:, j))
    end do
    call orthonormalise(ds, x, ok)
    if (.not. ok) return
    do j = 1, p
      kx(:, j) = 0.5_wp*(ds%stiffness_times(x(:, j), .false.) + ds%stiffness_times(x(:, j), .true.))
    end do
    h = matmul(transpose(x), kx)
    h = 0.5_wp*(h + transpose(h))
    call dsyev('V', 'U', p, h, p, omega2, work, size(work), info)
    ok = info == 0
    x = matmul(x, h)
  end subroutine iterate

  !> y = A x for real entries on the pattern, mechanical unknowns only.
  pure function real_product(ds, values, x) result(y)
    type(stiffness_system), intent(in) :: ds
    real(wp), intent(in) :: values(:)         !! (entries)
    real(wp), intent(in) :: x(:)              !! (n)
    real(wp) :: y(size(x))
    integer :: j, e
    y = 0.0_wp
    do j = 1, size(x)
      do e = ds%first(j), ds%first(j + 1) - 1
        if (ds%row(e) > size(x)) exit
        y(ds%row(e)) = y(ds%row(e)) + values(e)*x(j)
      end do
    end do
  end function real_product

  !> Gram-Schmidt in the mass, twice.
  subroutine orthonormalise(ds, x, ok)
    type(stiffness_system), intent(in) :: ds
    real(wp), intent(inout) :: x(:, :)
    logical, intent(out) :: ok
    real(wp), allocatable :: mx(:, :), v(:)
    real(wp) :: size2
    integer :: j, pass, i
    allocate (mx(size(x, 1), size(x, 2)))
    ok = .false.
    do j = 1, size(x, 2)
      v = x(:, j)/max(maxval(abs(x(:, j))), tiny(1.0_wp))
      do pass = 1, 2
        do i = 1, j - 1
          v = v - dot_product(mx(:, i), v)*x(:, i)
        end do
      end do
      mx(:, j) = real_product(ds, ds%m, v)
      size2 = dot_product(v, mx(:, j))
      if (.not. size2 > 0.0_wp) return
      x(:, j) = v/sqrt(size2)
      mx(:, j) = mx(:, j)/sqrt(size2)
    end do
    ok = .true.
  end subroutine orthonormalise

  !> Lowest p modes on an orthonormal basis of the null space of J, in unknowns of equal mass: lengths and angles stand side by
  !> side.
  subroutine dense_start(ds, p, omega2, x, ok)
    type(stiffness_system), intent(in) :: ds
    integer, intent(in) :: p
    real(wp), intent(out) :: omega2(:), x(:, :)
    logical, intent(out) :: ok
    real(wp), allocatable :: z(:, :), kz(:, :), mz(:, :), w(:), work(:)
    real(wp) :: unit(ds%n)                          ! of each unknown [1/sqrt(kg)]
    integer, allocatable :: iwork(:)
    integer :: j, n, info
    do j = 1, ds%n
      unit(j) = scale(1.0_wp, -exponent(ds%m(ds%entry(j, j)))/2)
    end do
    call null_space(ds, unit, z)
    n = size(z, 2)
    allocate (kz(ds%n, n), mz(ds%n, n), w(n), work(1 + 6*n + 2*n*n), iwork(3 + 5*n))
    do j = 1, n
      z(:, j) = unit*z(:, j)
      kz(:, j) = 0.5_wp*(real_product(ds, ds%k, z(:, j)) + real_product(ds, ds%k(ds%mirror), z(:, j)))
      mz(:, j) = real_product(ds, ds%m, z(:, j))
    end do
    kz = matmul(transpose(z), kz)
    mz = matmul(transpose(z), mz)
    call dsygvd(1, 'V', 'U', n, kz, n, mz, n, w, work, size(work), iwork, size(iwork), info)
    ok = info == 0
    omega2 = w(1:p)
    x = matmul(z, kz(:, 1:p))
  end subroutine dense_start

  !> Orthonormal basis of the null space of J in unknowns of the given units: the last columns of Q in J^T P = Q R.
  subroutine null_space(ds, unit, z)
    type(stiffness_system), intent(in) :: ds
    real(wp), intent(in) :: unit(:)                 !! (n) [1/sqrt(kg)]
    real(wp), allocatable, intent(out) :: z(:, :)   !! (n, n - rows)
    real(wp), allocatable :: a(:, :), tau(:), work(:)
    integer, allocatable :: pivots(:)
    integer :: e, info
    allocate (a(ds%n, ds%n), tau(ds%n), work(64*ds%n + 64), source=0.0_wp)
    allocate (pivots(ds%rows), source=0)
    do e = 1, size(ds%row)
      if (ds%row(e) <= ds%n .and. ds%col(e) > ds%n) a(ds%row(e), ds%col(e) - ds%n) = unit(ds%row(e))*ds%joint(e)
    end do
    if (ds%rows > 0) call dgeqp3(ds%n, ds%rows, a, ds%n, pivots, tau, work, size(work), info)
    call dorgqr(ds%n, ds%n, ds%rows, a, ds%n, tau, work, size(work), info)
    z = a(:, ds%rows + 1:)
  end subroutine null_space

  !> What rounding alone gives as x^T K x of a mass-normalised vector: a squared frequency below it is that of a rigid motion.
  !> Inertia of turning bodies cancels in entries of K already: it rounds by its own size, the square of the rate of turn.
  pure real(wp) function rounding_level(ds, x) result(level)
    type(stiffness_system), intent(in) :: ds
    real(wp), intent(in) :: x(:)              !! (n) [1/sqrt(kg)]
    real(wp) :: forces(ds%n), turns(ds%n), rate2      ! |K||x|, |G||x|; squared rate of turn [rad2/s2]
    integer :: j, e
    forces = 0.0_wp
    turns = 0.0_wp
    rate2 = 0.0_wp
    do j = 1, ds%n
      do e = ds%first(j), ds%first(j + 1) - 1
        if (ds%row(e) > ds%n) exit
        forces(ds%row(e)) = forces(ds%row(e)) + abs(ds%k(e))*abs(x(j))
        turns(ds%row(e)) = turns(ds%row(e)) + abs(ds%gyro(e))*abs(x(j))
      end do
    end do
    do j = 1, ds%n
      e = ds%entry(j, j)
      if (ds%m(e) > 0.0_wp) rate2 = rate2 + turns(j)**2/ds%m(e)
    end do
    level = 100*epsilon(1.0_wp)*(dot_product(forces, abs(x)) + rate2) + (1.0e3_wp*epsilon(1.0_wp))**2*fastest(ds)
  end function rounding_level

  !> The largest ratio of stiffness and mass on the diagonal: about the largest squared frequency.
  pure real(wp) function fastest(ds) result(ratio)
    type(stiffness_system), intent(in) :: ds
    integer :: j, e
    ratio = 0.0_wp
    do j = 1, ds%n
      e = ds%entry(j, j)
      if (ds%m(e) > 0.0_wp) ratio = max(ratio, abs(ds%k(e))/ds%m(e))
    end do
  end function fastest
end module natural_modes
