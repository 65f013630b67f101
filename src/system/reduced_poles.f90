!> Poles of the linearised mechanism reduced on a subspace of undamped modes, GHM terms as coordinates of their own:
!>   x'' = -K x - C x' - sum_r K_r sum_k alpha_k (x - z_rk),   z_rk'' = -2 zeta_k omega_k z_rk' - omega_k^2 (z_rk - x)
!> (theory.md, section 5). They start the search for poles that single modes do not lead to.
module reduced_poles
  use kinds, only: wp
  use dynamic_stiffness, only: stiffness_system
  use lapack, only: dgeev
  use mode_list, only: padded
  implicit none (type, external)
  private
  public :: reduced_system_poles

  integer, parameter :: largest = 800                  !! unknowns of first order beyond which nothing is tried
  real(wp), parameter :: at_rest = 1.0e-12_wp          !! of the largest pole: the double zero of a rigid motion [-]

contains

  !> The poles with Im >= 0 in which the mechanism itself moves, with their shapes; none where the system is too large.
  subroutine reduced_system_poles(ds, basis, lambdas, shapes)
    type(stiffness_system), intent(in) :: ds
    real(wp), intent(in) :: basis(:, :)                !! (n, p) shapes of unit modal mass
    complex(wp), allocatable, intent(out) :: lambdas(:)    !! [1/s]
    complex(wp), allocatable, intent(out) :: shapes(:, :)  !! (n, poles)
    real(wp), allocatable :: a(:, :), wr(:), wi(:), vr(:, :), work(:), left(:, :)
    complex(wp) :: lambda
    integer :: r, n, p, j, info
    p = size(basis, 2)
    n = 2*p
    do r = 1, size(ds%groups)
      n = n + 2*p*size(ds%groups(r)%alpha)
    end do
    allocate (lambdas(0), shapes(size(basis, 1), 0))
    if (n > largest) return
    allocate (a(n, n), wr(n), wi(n), vr(n, n), work(34*n), left(1, 1), source=0.0_wp)
    call first_order(ds, basis, a)
    call dgeev('N', 'V', n, a, n, wr, wi, left, 1, vr, n, work, size(work), info)
    if (info /= 0) return
    do j = 1, n
      lambda = cmplx(wr(j), wi(j), wp)
      if (wi(j) < 0.0_wp .or. abs(lambda) <= at_rest*maxval(hypot(wr, wi)) .or. unseen(ds, lambda)) cycle
      lambdas = [lambdas, lambda]
      if (wi(j) > 0.0_wp) then
        shapes = reshape([shapes, matmul(basis, cmplx(vr(1:p, j), vr(1:p, j + 1), wp))], [size(basis, 1), size(lambdas)])
      else
        shapes = reshape([shapes, cmplx(matmul(basis, vr(1:p, j)), 0.0_wp, wp)], [size(basis, 1), size(lambdas)])
      end if
    end do
  end subroutine reduced_system_poles

  !> The matrix of first order for (x, x', then z and z' of each term of each group).
  subroutine first_order(ds, basis, a)
    type(stiffness_system), intent(in) :: ds
    real(wp), intent(in) :: basis(:, :)                !! (n, p)
    real(wp), intent(inout) :: a(:, :)                 !! zero on entry
    complex(wp) :: v(ds%n + ds%rows)
    real(wp) :: part(size(basis, 2))
    integer :: p, j, r, k, i
    p = size(basis, 2)
    do j = 1, p
      a(j, p + j) = 1.0_wp
      v = padded(ds, cmplx(basis(:, j), 0.0_wp, wp))
      a(p + 1:2*p, j) = -projected(ds%stiffness_product(v, 0))
      a(p + 1:2*p, p + j) = -projected(ds%times(cmplx(ds%c, 0.0_wp, wp), v))
      i = 2*p
      do r = 1, size(ds%groups)
        part = projected(ds%stiffness_product(v, r))
        do k = 1, size(ds%groups(r)%alpha)
          associate (g => ds%groups(r))
            a(p + 1:2*p, j) = a(p + 1:2*p, j) - g%alpha(k)*part
            a(p + 1:2*p, i + j) = g%alpha(k)*part
            a(i + j, i + p + j) = 1.0_wp
            a(i + p + j, j) = g%omega(k)**2
            a(i + p + j, i + j) = -g%omega(k)**2
            a(i + p + j, i + p + j) = -2*g%zeta(k)*g%omega(k)
          end associate
          i = i + 2*p
        end do
      end do
    end do
  contains
    !> Components of a force on the basis.
    function projected(force) result(y)
      complex(wp), intent(in) :: force(:)
      real(wp) :: y(size(basis, 2))
      y = matmul(real(force(1:ds%n), wp), basis)
    end function projected
  end subroutine first_order

  !> Whether a pole is one of a GHM term alone, in which the mechanism stands still.
  pure logical function unseen(ds, lambda) result(yes)
    type(stiffness_system), intent(in) :: ds
    complex(wp), intent(in) :: lambda
    integer :: r
    yes = .false.
    do r = 1, size(ds%groups)
      associate (g => ds%groups(r))
        yes = yes .or. any(abs(lambda**2 + 2*g%zeta*g%omega*lambda + g%omega**2) <= 1.0e-9_wp*g%omega**2)
      end associate
    end do
  end function unseen
end module reduced_poles
