!> Linear stability of explicit methods: how far along the ray of an eigenvalue a step may reach (theory.md, section 8).
module stability_region
  use kinds, only: wp
  implicit none (type, external)
  private
  public :: largest_step, method_names

  character(6), parameter :: method_names(2) = ['rk4   ', 'dopri5']   !! explicit methods, by number

contains

  !> Whether a step makes y grow where y' = mu y and z = h mu: |R(z)| > 1, R the factor by which the step multiplies y.
  elemental logical function grows(method, z)
    integer, intent(in) :: method          !! number in method_names
    complex(wp), intent(in) :: z           !! step times eigenvalue [-]
    complex(wp) :: p                       ! R(z) [-]
    if (method == 1) then                  ! 1 + z + z2/2 + z3/6 + z4/24
      p = 1 + z*(1 + z/2*(1 + z/3*(1 + z/4)))
    else                                   ! dopri5: ... + z5/120 + z6/600
      p = 1 + z*(1 + z/2*(1 + z/3*(1 + z/4*(1 + z/5*(1 + z/5)))))
    end if
    grows = real(p, wp)**2 + aimag(p)**2 > 1.0_wp + 2.0e-10_wp
  end function grows

  !> Smallest h > 0 beyond which |R(h mu)| > 1 [s]; huge where no step is too large (mu = 0 or growing by itself), or none
  !> below `limit`.
  pure function largest_step(method, mu, limit) result(h)
    integer, intent(in) :: method          !! number in method_names
    complex(wp), intent(in) :: mu          !! eigenvalue [1/s]
    real(wp), intent(in) :: limit          !! larger steps are of no interest [s]
    real(wp) :: h                          !! [s]
    real(wp) :: low, high, x, farthest     ! along the ray [-]
    complex(wp) :: unit
    integer :: k
    h = huge(1.0_wp)
    if (abs(mu) <= tiny(1.0_wp)) return
    if (real(mu, wp) > 1.0e-9_wp*abs(mu)) return
    unit = cmplx(min(real(mu, wp), 0.0_wp), aimag(mu), wp)/abs(mu)
    farthest = 12.0_wp                     ! the regions end before
    if (limit < 1.0e100_wp) farthest = min(farthest, limit*abs(mu))
    do k = 1, ceiling(100*farthest)        ! steps of 0.01 find the first crossing, bisection sharpens it
      x = 0.01_wp*k
      if (.not. grows(method, x*unit)) cycle
      low = x - 0.01_wp
      high = x
      do while (high - low > 1.0e-9_wp)
        x = 0.5_wp*(low + high)
        if (grows(method, x*unit)) then
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
