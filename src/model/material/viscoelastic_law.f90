!> The law of a viscoelastic material or spring: its terms, each an internal variable z that follows the deformation delta,
!>
!>   inertia z'' + viscosity z' + z = delta        force alpha K_R (delta - z) beside K_R delta        (theory.md, section 5)
!>
!> so that E(s)/E_R - 1 = sum of alpha (1 - 1/(1 + viscosity s + inertia s^2)). Terms without inertia are of first order. What the
!> parameters of a law say of its terms is in `build_law`.
module viscoelastic_law
  use kinds, only: wp
  implicit none (type, external)
  private
  public :: viscoelastic_terms

  !> The terms of one law; those of second order come first.
  type :: viscoelastic_terms
    integer :: second = 0                      !! terms of second order (GHM)
    integer :: first = 0                       !! terms of first order (Maxwell)
    real(wp), allocatable :: alpha(:)          !! weights [-]
    real(wp), allocatable :: viscosity(:)      !! [s]
    real(wp), allocatable :: inertia(:)        !! [s2]
  contains
    procedure :: ratio
    procedure :: is_pole
    procedure :: slope
    procedure :: rates
    procedure :: order
    procedure :: equals
    procedure :: words
  end type viscoelastic_terms

contains

  !> E(s)/E_R - 1 [-].
  pure function ratio(self, s) result(g)
    class(viscoelastic_terms), intent(in) :: self
    complex(wp), intent(in) :: s               !! [1/s]
    complex(wp) :: g
    g = sum(self%alpha*s*(self%viscosity + self%inertia*s)/(1 + s*(self%viscosity + self%inertia*s)))
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
    complex(wp) :: g
    g = sum(self%alpha*(self%viscosity + 2*self%inertia*s)/(1 + s*(self%viscosity + self%inertia*s))**2)
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
