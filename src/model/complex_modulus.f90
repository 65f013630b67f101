!> The complex modulus of GHM: E(s)/E_R - 1 and its slope, and the stiffness entries that one set of terms multiplies
!> (theory.md, section 5).
module complex_modulus
  use kinds, only: wp
  implicit none (type, external)
  private
  public :: ghm_group, modulus_ratio, modulus_slope

  !> Entries that one set of GHM terms multiplies.
  type :: ghm_group
    real(wp), allocatable :: alpha(:)          !! [-]
    real(wp), allocatable :: zeta(:)           !! [-]
    real(wp), allocatable :: omega(:)          !! [rad/s]
    integer, allocatable :: entry(:)           !! entries of the pattern
    real(wp), allocatable :: value(:)          !! K_r there
    real(wp), allocatable :: low(:)            !! what rounding took from it
  end type ghm_group

contains

  !> g(s) = E(s)/E_R - 1 of a set of terms.
  pure function modulus_ratio(alpha, zeta, omega, s) result(g)
    real(wp), intent(in) :: alpha(:), zeta(:), omega(:)
    complex(wp), intent(in) :: s               !! [1/s]
    complex(wp) :: g, a
    integer :: k
    g = 0.0_wp
    do k = 1, size(alpha)
      a = s*(s + 2*zeta(k)*omega(k))
      g = g + alpha(k)*a/(a + omega(k)**2)
    end do
  end function modulus_ratio

  !> Its derivative [s].
  pure function modulus_slope(alpha, zeta, omega, s) result(g)
    real(wp), intent(in) :: alpha(:), zeta(:), omega(:)
    complex(wp), intent(in) :: s               !! [1/s]
    complex(wp) :: g, a
    integer :: k
    g = 0.0_wp
    do k = 1, size(alpha)
      a = s*(s + 2*zeta(k)*omega(k)) + omega(k)**2
      g = g + alpha(k)*2*(s + zeta(k)*omega(k))*omega(k)**2/a**2
    end do
  end function modulus_slope
end module complex_modulus
