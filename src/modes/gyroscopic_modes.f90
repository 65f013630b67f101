!> A basis of motions for undamped modes with gyroscopic terms or an unsymmetric K: the natural modes, with the rigid motions,
!> the null space of K, in front. Their double zeros would otherwise spread over a circle that hides all frequencies far below
!> the highest.
module gyroscopic_modes
  use kinds, only: wp
  use dynamic_stiffness, only: stiffness_system
  use lapack, only: dgesdd, dgeqp3, dorgqr
  use natural_modes, only: rounding_level, squared_scales, without_rounding
  implicit none (type, external)
  private
  public :: turning_basis

  real(wp), parameter :: no_stiffness = 1.0e-9_wp  !! singular value of K below which a motion is rigid, K scaled to 1 [-]

contains

  !> The natural modes turned so that the rigid motions come first.
  subroutine turning_basis(ds, x, turned, rigid, ok)
    type(stiffness_system), intent(in) :: ds
    real(wp), intent(in) :: x(:, :)                    !! (n, p) natural modes, mass-orthonormal [1/sqrt(kg)]
    real(wp), allocatable, intent(out) :: turned(:, :) !! (n, p) likewise [1/sqrt(kg)]
    integer, intent(out) :: rigid                      !! how many
    logical, intent(out) :: ok
    real(wp), allocatable :: k(:, :), q(:, :)
    real(wp) :: kx(size(x, 1))
    integer :: j
    allocate (k(size(x, 2), size(x, 2)))
    do j = 1, size(x, 2)
      kx = ds%stiffness_times(x(:, j))
      k(:, j) = matmul(kx, x)
    end do
    call rigid_motions(ds, x, k, q, rigid, ok)
    if (ok) turned = matmul(x, q)
  end subroutine turning_basis

  !> The null space of K: singular values far below one of K with rows and columns scaled to the size one, or where they are
  !> rounding to that. It spans the first columns of an orthogonal basis q.
  subroutine rigid_motions(ds, x, k, q, rigid, ok)
    type(stiffness_system), intent(in) :: ds
    real(wp), intent(in) :: x(:, :)                    !! (n, p) [1/sqrt(kg)]
    real(wp), intent(in) :: k(:, :)                    !! (p, p) [1/s2]
    real(wp), allocatable, intent(out) :: q(:, :)      !! (p, p) [-]
    integer, intent(out) :: rigid                      !! how many
    logical, intent(out) :: ok
    real(wp) :: scale(size(k, 1)), level(size(k, 1)), s(size(k, 1)), tau(size(k, 1))
    real(wp) :: noise(size(k, 1))                      ! roots of what rounding is on the diagonal, scaled [-]
    real(wp), allocatable :: a(:, :), u(:, :), vt(:, :), work(:)
    integer, allocatable :: iwork(:), pivots(:)
    integer :: p, j, info
    p = size(k, 1)
    do j = 1, p
      level(j) = rounding_level(ds, x(:, j))
    end do
    allocate (u(p, p), vt(p, p), q(p, p), work(4*p*p + 72*p), iwork(8*p))
    a = without_rounding(k, level)
    scale = 1.0_wp/sqrt(squared_scales(a, max(level, [(abs(k(j, j)), j=1, p)], tiny(1.0_wp))))
    do j = 1, p
      a(:, j) = scale*a(:, j)*scale(j)
    end do
    call dgesdd('A', p, p, a, p, s, u, p, vt, p, work, size(work), iwork, info)
    noise = scale*sqrt(level)
    rigid = count([(s(j) < max(no_stiffness, dot_product(abs(u(:, j)), noise)*dot_product(abs(vt(j, :)), noise)), j=1, p)])
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
end module gyroscopic_modes
