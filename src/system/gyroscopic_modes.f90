!> Undamped modes with gyroscopic terms or an unsymmetric K: the quadratic eigenproblem (lambda^2 + lambda G + K) y = 0 on the
!> subspace of natural modes, each pole then brought to the full system's. Rigid motions, the null space of K, are taken out
!> first: their double zeros would otherwise spread over a circle that hides all frequencies far below the highest.
module gyroscopic_modes
  use kinds, only: wp
  use dynamic_stiffness, only: stiffness_system
  use lapack, only: dgeev, dgesdd, dgeqp3, dorgqr
  use mode_list, only: mode_set, padded, residual_of, undamped_mode
  use natural_modes, only: rounding_level
  use pole_newton, only: newton_pole
  implicit none (type, external)
  private
  public :: add_gyroscopic

  real(wp), parameter :: no_stiffness = 0.1_wp   !! singular value of K below which a motion is rigid, K scaled to 1 [-]
  real(wp), parameter :: steady = 1.0e-10_wp     !! real part of a pole that is rounding, over its modulus [-]

contains

  !> Adds the lowest modes: rigid motions, then the poles in ascending order of their moduli.
  subroutine add_gyroscopic(ds, basis, wanted, modes, ok)
    type(stiffness_system), intent(inout) :: ds
    real(wp), intent(in) :: basis(:, :)                !! (n, p) natural modes, mass-orthonormal
    integer, intent(in) :: wanted
    type(mode_set), intent(inout) :: modes
    logical, intent(out) :: ok
    real(wp), allocatable :: k(:, :), g(:, :), q(:, :), x(:, :), wr(:), wi(:), vr(:, :)
    integer :: rigid, j
    call reduce(ds, basis, k, g)
    call rigid_motions(ds, basis, k, q, rigid, ok)
    if (.not. ok) return
    x = matmul(basis, q)
    k = matmul(transpose(q), matmul(k, q))
    g = matmul(transpose(q), matmul(g, q))
    k(:, 1:rigid) = 0.0_wp
    do j = 1, min(rigid, wanted)
      call modes%add(undamped_mode, j, (0.0_wp, 0.0_wp), 0.0_wp, cmplx(x(:, j), 0.0_wp, wp))
    end do
    call first_order(k, g, wr, wi, vr, ok)
    if (ok) call add_poles(ds, x, wr, wi, vr, 2*rigid, wanted, modes)
  end subroutine add_gyroscopic

  !> K and G on the subspace, K x summed in twice the working precision.
  subroutine reduce(ds, x, k, g)
    type(stiffness_system), intent(in) :: ds
    real(wp), intent(in) :: x(:, :)
    real(wp), allocatable, intent(out) :: k(:, :), g(:, :)
    complex(wp), allocatable :: v(:), y(:)
    integer :: p, j
    p = size(x, 2)
    allocate (k(p, p), g(p, p))
    do j = 1, p
      v = padded(ds, cmplx(x(:, j), 0.0_wp, wp))
      y = ds%stiffness_product(v, 0)
      k(:, j) = matmul(real(y(1:ds%n), wp), x)
      y = ds%times(cmplx(ds%gyro, 0.0_wp, wp), v)
      g(:, j) = matmul(real(y(1:ds%n), wp), x)
    end do
  end subroutine reduce

  !> The null space of K: singular values far below one of K with rows and columns scaled to the size one, or where they are
  !> rounding to that. It spans the first columns of an orthogonal basis q.
  subroutine rigid_motions(ds, x, k, q, rigid, ok)
    type(stiffness_system), intent(in) :: ds
    real(wp), intent(in) :: x(:, :), k(:, :)
    real(wp), allocatable, intent(out) :: q(:, :)      !! (p, p)
    integer, intent(out) :: rigid                      !! how many
    logical, intent(out) :: ok
    real(wp) :: scale(size(k, 1)), s(size(k, 1)), tau(size(k, 1))
    real(wp), allocatable :: a(:, :), u(:, :), vt(:, :), work(:)
    integer, allocatable :: iwork(:), pivots(:)
    integer :: p, j, info
    p = size(k, 1)
    do j = 1, p
      scale(j) = 1.0_wp/sqrt(max(abs(k(j, j)), rounding_level(ds, x(:, j))))
    end do
    allocate (a(p, p), u(p, p), vt(p, p), q(p, p), work(4*p*p + 72*p), iwork(8*p))
    do j = 1, p
      a(:, j) = scale*k(:, j)*scale(j)
    end do
    call dgesdd('A', p, p, a, p, s, u, p, vt, p, work, size(work), iwork, info)
    rigid = count(s < no_stiffness)
    ok = info == 0
    if (.not. ok) return
    allocate (pivots(rigid), source=0)
    q = 0.0_wp
    do j = 1, rigid
      q(:, j) = scale*vt(p - rigid + j, :)
      q(:, j) = q(:, j)/norm2(q(:, j))
    end do
    if (rigid > 0) call dgeqp3(p, rigid, q, p, pivots, tau, work, size(work), info)
    call dorgqr(p, p, rigid, q, p, tau, work, size(work), info)
  end subroutine rigid_motions

  !> Eigenvalues and vectors of y' = w, w' = -K y - G w.
  subroutine first_order(k, g, wr, wi, vr, ok)
    real(wp), intent(in) :: k(:, :), g(:, :)
    real(wp), allocatable, intent(out) :: wr(:), wi(:), vr(:, :)
    logical, intent(out) :: ok
    real(wp), allocatable :: a(:, :), work(:)
    real(wp) :: left(1, 1)
    integer :: p, j, info
    p = size(k, 1)
    allocate (a(2*p, 2*p), wr(2*p), wi(2*p), vr(2*p, 2*p), work(16*p), source=0.0_wp)
    do j = 1, p
      a(j, p + j) = 1.0_wp
    end do
    a(p + 1:, 1:p) = -k
    a(p + 1:, p + 1:) = -g
    call dgeev('N', 'V', 2*p, a, 2*p, wr, wi, left, 1, vr, 2*p, work, size(work), info)
    ok = info == 0
  end subroutine first_order

  !> The poles beyond the zeros of rigid motions, each brought to the full system's.
  subroutine add_poles(ds, x, wr, wi, vr, zeros, wanted, modes)
    type(stiffness_system), intent(inout) :: ds
    real(wp), intent(in) :: x(:, :), wr(:), wi(:), vr(:, :)
    integer, intent(in) :: zeros, wanted
    type(mode_set), intent(inout) :: modes
    complex(wp), allocatable :: v(:)
    complex(wp) :: lambda
    integer, allocatable :: order(:)
    integer :: i, j, p
    logical :: good
    p = size(x, 2)
    call by_modulus(wr, wi, order)
    do i = zeros + 1, size(order)
      j = order(i)
      if (modes%count == wanted) return
      if (wi(j) < 0.0_wp) cycle
      lambda = cmplx(wr(j), wi(j), wp)
      if (abs(wi(j)) <= 1.0e-9_wp*abs(lambda) .and. wr(j) < 0.0_wp) cycle   ! the stable twin of a diverging motion
      if (wi(j) > 0.0_wp) then
        v = matmul(x, cmplx(vr(1:p, j), vr(1:p, j + 1), wp))
      else
        v = matmul(x, cmplx(vr(1:p, j), 0.0_wp, wp))
      end if
      call newton_pole(ds, lambda, v, modes, 0.0_wp, good)
      if (.not. good .or. lambda%im < 0.0_wp) cycle
      if (abs(lambda%re) <= steady*abs(lambda)) lambda%re = 0.0_wp
      call modes%add(undamped_mode, modes%count + 1, lambda, residual_of(ds, lambda, v, 0.0_wp), v)
    end do
  end subroutine add_poles

  !> Order of ascending modulus.
  pure subroutine by_modulus(wr, wi, order)
    real(wp), intent(in) :: wr(:), wi(:)
    integer, allocatable, intent(out) :: order(:)
    integer :: i, j, k
    allocate (order(size(wr)))
    do i = 1, size(wr)
      order(i) = i
      do j = i, 2, -1
        if (hypot(wr(order(j)), wi(order(j))) >= hypot(wr(order(j - 1)), wi(order(j - 1)))) exit
        k = order(j)
        order(j) = order(j - 1)
        order(j - 1) = k
      end do
    end do
  end subroutine by_modulus
end module gyroscopic_modes
