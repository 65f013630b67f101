!> A basis of motions for undamped modes with gyroscopic terms or an unsymmetric K. Natural modes, those of the symmetric part of
!> K, are brought to the lowest solutions of s2 M + s G + K. Rigid motions, the null space of K, come first: their double zeros
!> would otherwise spread over a circle that hides all frequencies far below the highest.
module gyroscopic_modes
  use kinds, only: wp, half_digits
  use block_lanczos, only: inertia_operator, orthonormalise
  use dynamic_stiffness, only: stiffness_system
  use lapack, only: dgesdd, dgeqp3, dorgqr
  use natural_modes, only: constrained_operator, highest_ratio, rounding_level, stiffness_scales, without_rounding
  implicit none (type, external)
  private
  public :: mass_operator, add_motion, lowest_motions, rigid_motions_first

  integer, parameter :: passes = 4                 !! of inverse iteration
  real(wp), parameter :: new = half_digits   !! size of what a motion adds to a basis, over its own [-]
  real(wp), parameter :: no_stiffness = half_digits   !! singular value of a scaled K below which a motion is rigid [-]

  !> Positions and rates side by side.
  type, extends(constrained_operator) :: mass_operator
  contains
    procedure :: set_rate
    procedure :: solve
  end type mass_operator

contains

  !> The lowest solutions of (s2 M + s G + K) x = 0 from natural modes, by inverse iteration on positions and rates. The shift lies
  !> between what is rounding and the lowest frequency: motions at s = 0 and what they cause at constant rates are then
  !> accurate to the last digits. Natural modes of the symmetric part of K do not span them.
  subroutine lowest_motions(ds, x, ok)
    type(stiffness_system), intent(inout), target :: ds
    real(wp), allocatable, intent(inout) :: x(:, :)    !! (n, p) mass-orthonormal, fewer columns at the end [1/sqrt(kg)]
    logical, intent(out) :: ok
    type(mass_operator) :: op
    real(wp) :: y(2*ds%n, size(x, 2))                  ! positions, and rates over the shift
    real(wp) :: length                                 ! [-]
    real(wp), allocatable :: part(:), my(:)
    integer :: pass, j
    call op%set_rate(ds, x)
    y = 0.0_wp
    y(1:ds%n, :) = x
    allocate (my(2*ds%n))
    do pass = 1, passes
      do j = 1, size(x, 2)
        call op%solve(y(:, j))
        call orthonormalise(op, y(:, 1:j - 1), y(:, j), my, part, length)
        ok = length > 0.0_wp
        if (.not. ok) return
      end do
    end do
    x = x(:, 1:0)
    do j = 1, size(y, 2)
      call add_motion(op, y(1:ds%n, j), x)
    end do
  end subroutine lowest_motions

  !> Appends what a motion has beside those of a mass-orthonormal basis, if that is more than rounding leaves.
  subroutine add_motion(op, v, x)
    class(inertia_operator), intent(in) :: op
    real(wp), intent(in) :: v(:)                       !! (n) [any]
    real(wp), allocatable, intent(inout) :: x(:, :)    !! (n, p) [1/sqrt(kg)]
    real(wp) :: added(size(v)), mv(size(v)), length    ! [1/sqrt(kg)], [sqrt(kg)], [-]
    real(wp), allocatable :: part(:)
    mv = op%mass_times(v)
    if (.not. dot_product(v, mv) > 0.0_wp) return
    added = v/sqrt(dot_product(v, mv))
    call orthonormalise(op, x, added, mv, part, length)
    if (length > new) x = reshape([x, added], [size(v), size(x, 2) + 1])
  end subroutine add_motion

  !> One inverse iteration: with r over the shift s, T(s) u = -(s M + G) x - s M r, and the new rates over s are u + x/s.
  subroutine solve(self, y)
    class(mass_operator), intent(inout) :: self
    real(wp), intent(inout) :: y(:)                    !! (2n) positions and rates over the shift [m, rad]
    complex(wp) :: u(self%ds%n + self%ds%rows)
    associate (ds => self%ds, s => self%shift, x => y(1:size(y)/2), r => y(size(y)/2 + 1:))
      u = ds%padded(cmplx(-ds%real_times(s*ds%m + ds%gyro, x) - s*ds%real_times(ds%m, r), 0.0_wp, wp))
      call ds%solve(u)
      r = real(u(1:ds%n), wp) + x/s
      x = real(u(1:ds%n), wp)
    end associate
  end subroutine solve

  !> The basis turned so that the rigid motions come first.
  subroutine rigid_motions_first(ds, x, rotated, rigid, ok)
    type(stiffness_system), intent(inout), target :: ds
    real(wp), intent(in) :: x(:, :)                    !! (n, p) natural modes, mass-orthonormal [1/sqrt(kg)]
    real(wp), allocatable, intent(out) :: rotated(:, :) !! (n, p) likewise [1/sqrt(kg)]
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
    if (.not. ok) return
    rotated = matmul(x, q)
    if (rigid > 0 .and. rigid < size(x, 2)) call correct_rigid_motions(ds, rotated, rigid)
  end subroutine rigid_motions_first

  !> x - T(s)^-1 K x for the rigid motions: it removes the rest of other motions in them, of which dampers would make poles near
  !> zero.
  subroutine correct_rigid_motions(ds, x, rigid)
    type(stiffness_system), intent(inout), target :: ds
    real(wp), intent(inout) :: x(:, :)                 !! (n, p) mass-orthonormal, the rigid motions first [1/sqrt(kg)]
    integer, intent(in) :: rigid                       !! how many
    type(mass_operator) :: op
    complex(wp) :: u(ds%n + ds%rows)
    real(wp) :: mv(ds%n), length                       ! [sqrt(kg)], [-]
    real(wp), allocatable :: part(:)
    integer :: j
    call op%set_rate(ds, x)
    do j = 1, size(x, 2)
      if (j <= rigid) then
        u = ds%padded(cmplx(ds%stiffness_times(x(:, j)), 0.0_wp, wp))
        call ds%solve(u)
        x(:, j) = x(:, j) - real(u(1:ds%n), wp)
      end if
      mv = op%mass_times(x(:, j))
      x(:, j) = x(:, j)/sqrt(dot_product(x(:, j), mv))
      call orthonormalise(op, x(:, 1:j - 1), x(:, j), mv, part, length)
    end do
  end subroutine correct_rigid_motions

  !> Factors T at a rate above rounding and below the lowest frequency.
  subroutine set_rate(self, ds, x)
    class(mass_operator), intent(inout) :: self
    type(stiffness_system), intent(inout), target :: ds
    real(wp), intent(in) :: x(:, :)                    !! (n, p) mass-orthonormal [1/sqrt(kg)]
    real(wp) :: least, level, square                   ! [rad2/s2]
    integer :: j
    least = highest_ratio(ds)
    level = huge(1.0_wp)
    do j = 1, size(x, 2)
      level = min(level, rounding_level(ds, x(:, j)))
      square = abs(dot_product(x(:, j), ds%stiffness_times(x(:, j))))
      if (square > rounding_level(ds, x(:, j))) least = min(least, square)
    end do
    self%ds => ds
    self%shift = sqrt(sqrt(level*least))
    call ds%set(cmplx(self%shift, 0.0_wp, wp), 0.0_wp)
    call ds%factor()
  end subroutine set_rate

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
    scale = 1.0_wp/sqrt(stiffness_scales(a, max(level, [(abs(k(j, j)), j=1, p)], tiny(1.0_wp))))
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
