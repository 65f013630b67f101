!> Undamped modes of the linearised mechanism, K x = omega^2 M x on J x = 0 (K without its skew part, no gyroscopic terms):
!> subspace iteration with the bordered matrix, which keeps every multiple frequency and every rigid motion. Small systems
!> start from the dense solution on the null space of J, large ones from fixed pseudo-random vectors.
module natural_modes
  use kinds, only: wp, half_digits
  use block_lanczos, only: inertia_operator, krylov_modes, iterate_subspace, inverse_iteration
  use dynamic_stiffness, only: stiffness_system
  use lapack, only: dgeqp3, dorgqr, dsygvd
  use posix, only: caught_signal
  implicit none (type, external)
  private
  public :: small_shift, constrained_operator, lowest_natural_modes, rounding_level, without_rounding, stiffness_scales
  public :: highest_ratio

  integer, parameter :: small = 300                !! unknowns up to which the dense start is cheap
  integer, parameter :: most_passes = 80, most_rounds = 6
  real(wp), parameter :: small_shift = half_digits   !! first shift over the largest ratio of stiffness and mass [-]
  real(wp), parameter :: mixing = 1.0e3_wp*epsilon(1.0_wp)  !! of a motion that rounding mixes into another; change of omega^2 [-]
  real(wp), parameter :: rounding_change = 1.0e-10_wp !! change that is rounding where it shrinks no more [-]

  !> K + shift M on the constraints, and M.
  type, extends(inertia_operator) :: constrained_operator
    type(stiffness_system), pointer :: ds => null()
  contains
    procedure :: set_shift
    procedure :: solve
    procedure :: mass_times
  end type constrained_operator

contains

  !> The lowest modes: mass-normalised vectors and squared frequencies, ascending. At least `wanted` of them are converged
  !> (fewer only where the system has fewer degrees of freedom); the subspace is larger; the others follow where all
  !> motions are to be spanned.
  subroutine lowest_natural_modes(ds, wanted, all_motions, omega2, x, ok)
    type(stiffness_system), intent(inout), target :: ds
    integer, intent(in) :: wanted
    logical, intent(in) :: all_motions                !! all motions
    real(wp), allocatable, intent(out) :: omega2(:)   !! (p) [rad2/s2]
    real(wp), allocatable, intent(out) :: x(:, :)     !! (n, p) [1/sqrt(kg)]
    logical, intent(out) :: ok
    type(constrained_operator) :: op
    integer :: freedoms, p, spanned, pass
    real(wp) :: noise, change, last
    logical :: converged
    real(wp), allocatable :: before(:), moved(:), scale(:), forces(:, :)
    freedoms = ds%n - ds%rows
    p = min(freedoms, merge(wanted + 8, max(2*wanted, wanted + 8), ds%symmetric .and. .not. ds%damped))
    ok = .true.
    spanned = merge(freedoms, p, all_motions)
    allocate (omega2(spanned), x(ds%n, spanned), forces(ds%n, spanned))
    if (p == 0) return
    op%ds => ds
    noise = highest_ratio(ds)                          ! a shift much smaller than it makes K regular where motions are rigid
    call op%set_shift(merge(small_shift*noise, 1.0_wp, noise > 0.0_wp))
    noise = epsilon(1.0_wp)*op%shift/small_shift       ! rounding of the largest frequencies [rad2/s2]
    if (ds%n <= small .or. 2*spanned > freedoms) then
      call dense_start(ds, spanned, omega2, x, ok)
    else
      call krylov_start(op, omega2, x, ok)
    end if
    if (.not. ok) return
    converged = .false.
    change = huge(1.0_wp)
    do pass = 1, most_passes
      ok = caught_signal() == 0
      if (.not. ok) return
      before = omega2(1:p)
      call iterate_subspace(op, x(:, 1:p), omega2(1:p), ok)
      if (.not. ok) return
      omega2(1:p) = omega2(1:p) - op%shift
      if (pass == 2 .or. pass == 5) call op%set_shift(shift_below_lowest(op, x(:, 1:p)))
      associate (w => min(wanted, p))
        moved = abs(omega2(1:w) - before(1:w))
        scale = abs(omega2(1:w)) + op%shift
        last = change
        change = maxval(moved/scale)
        converged = pass > 1 .and. (change <= mixing .or. &              ! or rounding alone changes it
                                      (all(moved <= max(rounding_change, mass_rounding(ds, x(:, 1:w)))*scale + noise) .and. &
                                       change >= 0.5_wp*last))
        if (converged) exit
      end associate
    end do
    call inverse_iteration(op, x, forces, ok) ! Rayleigh-Ritz mixes what rounding of the largest frequency is into the lowest modes
    do pass = 1, spanned
      omega2(pass) = dot_product(x(:, pass), ds%stiffness_times(x(:, pass)))
    end do
    where (abs(omega2) <= mixing**2*maxval(abs(omega2))) omega2 = 0.0_wp
    ok = ok .and. converged
  end subroutine lowest_natural_modes

  !> The share of rounding errors in the mass of each motion. It is large where the kept modes have nearly all mass of a body
  !> and its frame moves against them.
  pure function mass_rounding(ds, x) result(share)
    type(stiffness_system), intent(in) :: ds
    real(wp), intent(in) :: x(:, :)           !! (n, p) mass-normalised [1/sqrt(kg)]
    real(wp) :: share(size(x, 2))             !! [-]
    integer :: k
    do k = 1, size(x, 2)
      share(k) = 10*epsilon(1.0_wp)*dot_product(abs(x(:, k)), ds%real_times(abs(ds%m), abs(x(:, k))))
    end do
  end function mass_rounding

  !> Factors K + shift M.
  subroutine set_shift(self, shift)
    class(constrained_operator), intent(inout) :: self
    real(wp), intent(in) :: shift             !! [rad2/s2]
    self%shift = shift
    call self%ds%set_real(shift)
    call self%ds%factor()
  end subroutine set_shift

  !> y <- (K + shift M)^-1 y on the constraints.
  subroutine solve(self, y)
    class(constrained_operator), intent(inout) :: self
    real(wp), intent(inout) :: y(:)           !! (n) forces [N, N m], then displacements [m, rad]
    complex(wp) :: z(self%ds%n + self%ds%rows)
    z = self%ds%padded(cmplx(y, 0.0_wp, wp))
    call self%ds%solve(z)
    y = real(z(1:size(y)), wp)
  end subroutine solve

  !> M x, of positions and rates in turn.
  pure function mass_times(self, x) result(y)
    class(constrained_operator), intent(in) :: self
    real(wp), intent(in) :: x(:)              !! (n) or (2n) [m, rad]
    real(wp) :: y(size(x))                    !! [kg m, kg m2]
    integer :: i
    do i = 0, size(x) - self%ds%n, self%ds%n
      y(i + 1:i + self%ds%n) = self%ds%real_times(self%ds%m, x(i + 1:i + self%ds%n))
    end do
  end function mass_times

  !> A shift below the lowest squared frequency that is more than rounding.
  pure real(wp) function shift_below_lowest(op, x) result(shift)
    type(constrained_operator), intent(in) :: op
    real(wp), intent(in) :: x(:, :)           !! (n, p) approximate modes [1/sqrt(kg)]
    real(wp) :: omega2                        ! [rad2/s2]
    integer :: k
    shift = op%shift
    do k = 1, size(x, 2)
      omega2 = abs(dot_product(x(:, k), op%ds%stiffness_times(x(:, k))))
      if (omega2 <= rounding_level(op%ds, x(:, k))) cycle
      shift = 0.3_wp*omega2
      return
    end do
  end function shift_below_lowest

  !> Approximate lowest modes from Krylov spaces of (K + shift M)^-1 M: small ones until the shift is near the lowest frequency,
  !> then a large one. A block of as many vectors as a chain of beams may have equal frequencies.
  subroutine krylov_start(op, omega2, x, ok)
    type(constrained_operator), intent(inout) :: op    !! with a first shift
    real(wp), intent(out) :: omega2(:)                 !! (p) [rad2/s2]
    real(wp), intent(out) :: x(:, :)                   !! (n, p) [1/sqrt(kg)]
    logical, intent(out) :: ok
    real(wp) :: near                                   ! [rad2/s2]
    integer :: round, q, freedoms
    q = min(size(x, 2), 5)
    freedoms = op%ds%n - op%ds%rows
    do round = 1, most_rounds
      call krylov_modes(op, min(freedoms, 3*q), x(:, 1:q), omega2(1:q), ok)
      if (.not. ok) return
      near = shift_below_lowest(op, x(:, 1:q))
      if (abs(log(near/op%shift)) < 2.0_wp) exit
      call op%set_shift(near)
    end do
    call krylov_modes(op, min(freedoms, 2*size(x, 2) + 20), x, omega2, ok)
    omega2 = omega2 - op%shift
  end subroutine krylov_start

  !> Lowest p modes on an orthonormal basis of the null space of J, in unknowns of equal mass: lengths and angles stand side by
  !> side.
  subroutine dense_start(ds, p, omega2, x, ok)
    type(stiffness_system), intent(in) :: ds
    integer, intent(in) :: p
    real(wp), intent(out) :: omega2(:)        !! (p) [rad2/s2]
    real(wp), intent(out) :: x(:, :)          !! (n, p) [1/sqrt(kg)]
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
      kz(:, j) = 0.5_wp*(ds%real_times(ds%k, z(:, j)) + ds%real_times(ds%k(ds%mirror), z(:, j)))
      mz(:, j) = ds%real_times(ds%m, z(:, j))
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
    real(wp), allocatable, intent(out) :: z(:, :)   !! (n, n - rows) [1/sqrt(kg)]
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

  !> The rounding of x^T K x of a mass-normalised vector: a smaller squared frequency is that of a rigid motion. Three parts:
  !>   frames: entries of K times x (in a rigid motion elastic coordinates rest);
  !>   forces, which cancel in entries of K already: their own size;
  !>   elastic coordinates: the rounding of x times the largest entries of K.
  pure real(wp) function rounding_level(ds, x) result(level)
    type(stiffness_system), intent(in) :: ds
    real(wp), intent(in) :: x(:)              !! (n) [1/sqrt(kg)]
    real(wp) :: frames(ds%n)                  ! |x|, of scenes at rest without elastic coordinates [1/sqrt(kg)]
    frames = abs(x)
    if (ds%symmetric) frames = merge(frames, 0.0_wp, ds%solver%block_of(1:ds%n) == 0)
    level = 100*epsilon(1.0_wp)*(dot_product(frames, ds%real_times(abs(ds%k), frames)) + dot_product(ds%forces, abs(x))**2) &
            + mixing**2*highest_ratio(ds)
  end function rounding_level

  !> A stiffness on mass-normalised motions without entries that are rounding, of K or of the motions themselves.
  pure function without_rounding(k, level) result(clean)
    real(wp), intent(in) :: k(:, :)           !! (p, p) [1/s2]
    real(wp), intent(in) :: level(:)          !! (p) of each motion, `rounding_level` [1/s2]
    real(wp) :: clean(size(k, 1), size(k, 2)) !! [1/s2]
    integer :: i, j
    do j = 1, size(k, 2)
      do i = 1, size(k, 1)
        clean(i, j) = k(i, j)
        if (abs(k(i, j)) <= max(sqrt(level(i)*level(j)), mixing*max(abs(k(i, i)), abs(k(j, j))))) clean(i, j) = 0.0_wp
      end do
    end do
  end function without_rounding

  !> Squared scales that bring all entries of a stiffness on mass-normalised motions to at most one: its diagonal, or where that is
  !> small the stiffness by coupling to stiffer motions.
  pure function stiffness_scales(k, least) result(scale)
    real(wp), intent(in) :: k(:, :)           !! (p, p) [1/s2]
    real(wp), intent(in) :: least(:)          !! (p) smallest sizes, about those of the diagonal [1/s2]
    real(wp) :: scale(size(least)), coupling  !! [1/s2]
    integer :: i, j
    scale = least
    do j = 1, size(k, 2)
      do i = 1, size(k, 1)
        coupling = max(abs(k(i, j)), abs(k(j, i)))
        if (least(i) > coupling) coupling = coupling**2/least(i)
        scale(j) = max(scale(j), coupling)
      end do
    end do
  end function stiffness_scales

  !> The largest ratio of stiffness and mass on the diagonal: about the largest squared frequency.
  pure real(wp) function highest_ratio(ds) result(ratio)
    type(stiffness_system), intent(in) :: ds
    integer :: j, e
    ratio = 0.0_wp
    do j = 1, ds%n
      e = ds%entry(j, j)
      if (ds%m(e) > 0.0_wp) ratio = max(ratio, abs(ds%k(e))/ds%m(e))
    end do
  end function highest_ratio
end module natural_modes
