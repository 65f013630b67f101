!> Linear stability of explicit methods: the largest step for an eigenvalue (theory.md, section 8).
module stability_region
  use kinds, only: wp
  use tableaux, only: growth
  implicit none (type, external)
  private
  public :: largest_step

contains

  !> |R(x u)|2 - 1 on the ray of a unit number u, as coefficients of x to x12.
  pure function growth_on_ray(method, u) result(c)
    integer, intent(in) :: method          !! number in method_names
    complex(wp), intent(in) :: u           !! |u| = 1 [-]
    real(wp) :: c(12)                      !! [-]
    real(wp) :: powers(0:6)                ! real parts of its powers [-]
    integer :: j, k
    powers = real(u**[(k, k=0, 6)], wp)
    c = 0.0_wp
    do k = 0, 6
      do j = max(0, 1 - k), 6
        c(k + j) = c(k + j) + growth(k, method)*growth(j, method)*powers(abs(k - j))
      end do
    end do
  end function growth_on_ray

  !> Whether a step makes y grow.
  pure logical function grows(c, x)
    real(wp), intent(in) :: c(12)          !! of growth_on_ray [-]
    real(wp), intent(in) :: x              !! step times |mu| [-]
    real(wp) :: total                      ! [-]
    integer :: k
    total = 0.0_wp
    do k = 12, 1, -1
      total = x*(c(k) + total)
    end do
    grows = total > 2.0e-10_wp
  end function grows

  !> Smallest h > 0 beyond which |R(h mu)| > 1 [s]; huge where no step is too large (mu = 0 or growing by itself), or none
  !> below `limit`; also for the lower one of two conjugate eigenvalues: the upper one has the same bound.
  pure real(wp) function largest_step(method, mu, limit) result(h)   ! [s]
    integer, intent(in) :: method          !! number in method_names
    complex(wp), intent(in) :: mu          !! eigenvalue [1/s]
    real(wp), intent(in) :: limit          !! larger steps are of no interest [s]
    real(wp) :: c(12), low, high, x, farthest     ! along the ray [-]
    integer :: k
    h = huge(1.0_wp)
    if (abs(mu) <= tiny(1.0_wp)) return
    if (real(mu, wp) > 1.0e-9_wp*abs(mu) .or. aimag(mu) < 0.0_wp) return
    c = growth_on_ray(method, cmplx(min(real(mu, wp), 0.0_wp), aimag(mu), wp)/abs(mu))
    farthest = 12.0_wp                     ! no region is larger
    if (limit < 1.0e100_wp) farthest = min(farthest, limit*abs(mu))
    do k = 1, ceiling(100*farthest)        ! steps of 0.01 find the first crossing, bisection sharpens it
      x = 0.01_wp*k
      if (.not. grows(c, x)) cycle
      low = x - 0.01_wp
      high = x
      do while (high - low > 1.0e-9_wp)
        x = 0.5_wp*(low + high)
        if (grows(c, x)) then
          high = x
        else
          low = x
        end if
      end do
      h = low/abs(mu)
      return
    end do
  end function largest_step
end module stability_region
