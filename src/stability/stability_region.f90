!> Linear stability of explicit methods: how far along the ray of an eigenvalue a step may reach (theory.md, section 8).
module stability_region
  use kinds, only: wp
  implicit none (type, external)
  private
  public :: largest_step, method_names

  character(6), parameter :: method_names(2) = ['rk4   ', 'dopri5']   !! explicit methods, by number

contains

  !> R(z) of a method: the factor by which a step multiplies y where y' = mu y and z = h mu.
  elemental function growth(method, z) result(r)
    integer, intent(in) :: method          !! number in method_names
    complex(wp), intent(in) :: z           !! step times eigenvalue [-]
    real(wp) :: r                          !! |R(z)| [-]
    complex(wp) :: p
    if (method == 1) then                  ! 1 + z + z2/2 + z3/6 + z4/24
      p = 1 + z*(1 + z/2*(1 + z/3*(1 + z/4)))
    else                                   ! dopri5: ... + z5/120 + z6/600
      p = 1 + z*(1 + z/2*(1 + z/3*(1 + z/4*(1 + z/5*(1 + z/5)))))
    end if
    r = abs(p)
  end function growth

  !> Smallest h > 0 beyond which |R(h mu)| > 1 [s]; huge where no step is too large (mu = 0 or growing by itself).
  function largest_step(method, mu) result(h)
    integer, intent(in) :: method
    complex(wp), intent(in) :: mu          !! eigenvalue [1/s]
    real(wp) :: h, low, high, x
    complex(wp) :: unit
    integer :: k
    h = huge(1.0_wp)
    if (abs(mu) <= tiny(1.0_wp)) return
    if (real(mu, wp) > 1.0e-9_wp*abs(mu)) return
    unit = cmplx(min(real(mu, wp), 0.0_wp), aimag(mu), wp)/abs(mu)
    do k = 1, 1200                         ! steps of 0.01 find the first crossing, bisection sharpens it
      x = 0.01_wp*k
      if (growth(method, x*unit) <= 1.0_wp + 1.0e-10_wp) cycle
      low = x - 0.01_wp
      high = x
      do while (high - low > 1.0e-9_wp)
        x = 0.5_wp*(low + high)
        if (growth(method, x*unit) > 1.0_wp + 1.0e-10_wp) then
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
