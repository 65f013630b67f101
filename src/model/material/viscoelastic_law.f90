!> The law of a viscoelastic material or spring: its terms, each an internal variable z that follows the deformation delta,
!>
!>   inertia z'' + viscosity z' + z = delta        force alpha K_R (delta - z) beside K_R delta        (theory.md, section 5)
!>
!> so that E(s)/E_R - 1 = sum of alpha (1 - 1/(1 + viscosity s + inertia s^2)). A kind of law is a function that makes terms of its
!> parameters. Terms without inertia are of first order.
module viscoelastic_law
  use kinds, only: wp
  implicit none (type, external)
  private
  public :: viscoelastic_terms, ghm_terms, maxwell_terms

  !> The terms of one law; those of second order come first.
  type :: viscoelastic_terms
    integer :: second = 0                      !! terms of second order (GHM)
    integer :: first = 0                       !! terms of first order (Maxwell)
    real(wp), allocatable :: alpha(:)          !! weights [-]
    real(wp), allocatable :: viscosity(:)      !! [s]
    real(wp), allocatable :: inertia(:)        !! [s2]
  contains
    procedure :: combined
    procedure :: ratio
    procedure :: is_pole
    procedure :: slope
    procedure :: rates
    procedure :: order
    procedure :: equals
    procedure :: words
  end type viscoelastic_terms

contains

  !> The law of Golla, Hughes and McTavish: E(s)/E_R = 1 + sum of alpha (s2 + 2 zeta omega s)/(s2 + 2 zeta omega s + omega2).
  pure type(viscoelastic_terms) function ghm_terms(alpha, zeta, omega) result(t)
    real(wp), intent(in) :: alpha(:)           !! weights [-]
    real(wp), intent(in) :: zeta(:)            !! damping ratios [-]
    real(wp), intent(in) :: omega(:)           !! frequencies [rad/s]
    t = viscoelastic_terms(size(alpha), 0, alpha, 2*zeta/omega, 1/omega**2)
  end function ghm_terms

  !> The generalised Maxwell law (a Prony series), springs in series with dashpots: E(s)/E_R = 1 + sum of alpha tau s/(1 + tau s).
  pure type(viscoelastic_terms) function maxwell_terms(alpha, tau) result(t)
    real(wp), intent(in) :: alpha(:)           !! weights [-]
    real(wp), intent(in) :: tau(:)             !! relaxation times [s]
    t = viscoelastic_terms(0, size(alpha), alpha, tau, 0*tau)
  end function maxwell_terms

  !> The terms of two laws that act together.
  pure function combined(self, other) result(both)
    class(viscoelastic_terms), intent(in) :: self
    type(viscoelastic_terms), intent(in) :: other
    type(viscoelastic_terms) :: both
    associate (m => self%second, n => other%second)
      both%second = m + n
      both%first = self%first + other%first
      both%alpha = [self%alpha(:m), other%alpha(:n), self%alpha(m + 1:), other%alpha(n + 1:)]
      both%viscosity = [self%viscosity(:m), other%viscosity(:n), self%viscosity(m + 1:), other%viscosity(n + 1:)]
      both%inertia = [self%inertia(:m), other%inertia(:n), self%inertia(m + 1:), other%inertia(n + 1:)]
    end associate
  end function combined

  !> E(s)/E_R - 1 [-].
  pure function ratio(self, s) result(g)
    class(viscoelastic_terms), intent(in) :: self
    complex(wp), intent(in) :: s               !! [1/s]
    complex(wp) :: g, a
    integer :: k
    g = 0.0_wp
    do k = 1, size(self%alpha)
      a = s*(self%viscosity(k) + self%inertia(k)*s)
      g = g + self%alpha(k)*a/(1 + a)
    end do
  end function ratio

  !> Whether a term has a pole at s: the law has no value there.
  pure logical function is_pole(self, s)
    class(viscoelastic_terms), intent(in) :: self
    complex(wp), intent(in) :: s               !! [1/s]
    is_pole = any(abs(1 + s*(self%viscosity + self%inertia*s)) <= 0.0_wp)
  end function is_pole

  !> Derivative of the ratio [s].
  pure function slope(self, s) result(g)
    class(viscoelastic_terms), intent(in) :: self
    complex(wp), intent(in) :: s               !! [1/s]
    complex(wp) :: g, a
    integer :: k
    g = 0.0_wp
    do k = 1, size(self%alpha)
      a = s*(self%viscosity(k) + self%inertia(k)*s)
      g = g + self%alpha(k)*(self%viscosity(k) + 2*self%inertia(k)*s)/(1 + a)**2
    end do
  end function slope

  !> Poles of the terms themselves, those of z where the deformation is fixed: of each term the fast one, then of terms of
  !> second order the other one [1/s].
  pure function rates(self) result(poles)
    class(viscoelastic_terms), intent(in) :: self
    complex(wp) :: poles(2*self%second + self%first)
    complex(wp) :: root
    integer :: k
    do k = 1, size(self%alpha)
      if (k > self%second) then
        poles(k) = -1/self%viscosity(k)
      else
        root = sqrt(cmplx(self%viscosity(k)**2 - 4*self%inertia(k), 0.0_wp, wp))
        poles(k) = -(self%viscosity(k) + root)/(2*self%inertia(k))
        poles(size(self%alpha) + k) = -2/(self%viscosity(k) + root)
      end if
    end do
  end function rates

  !> Unknowns of first order that one deformation asks for.
  pure integer function order(self)
    class(viscoelastic_terms), intent(in) :: self
    order = 2*self%second + self%first
  end function order

  !> Whether two laws have the same terms.
  pure logical function equals(self, other)
    class(viscoelastic_terms), intent(in) :: self
    type(viscoelastic_terms), intent(in) :: other
    equals = self%second == other%second .and. self%first == other%first
    if (equals) equals = all(abs(self%alpha - other%alpha) <= 0.0_wp) .and. &
                         all(abs(self%viscosity - other%viscosity) <= 0.0_wp) .and. &
                         all(abs(self%inertia - other%inertia) <= 0.0_wp)
  end function equals

  !> The kind of a term, in words.
  pure function words(self, k) result(text)
    class(viscoelastic_terms), intent(in) :: self
    integer, intent(in) :: k                   !! term
    character(7) :: text
    text = merge('GHM    ', 'Maxwell', k <= self%second)
  end function words
end module viscoelastic_law
