!> The law of Golla, Hughes and McTavish: terms with inertia, each a damped oscillator of frequency omega and damping ratio zeta.
module ghm_law
  use kinds, only: wp
  use viscoelastic_law, only: law_model, viscoelastic_terms
  implicit none (type, external)
  private

  !> E(s)/E_R = 1 + sum of alpha (s2 + 2 zeta omega s)/(s2 + 2 zeta omega s + omega2).
  type, extends(law_model), public :: ghm_model
    real(wp), allocatable :: alpha(:)          !! weights [-]
    real(wp), allocatable :: zeta(:)           !! damping ratios [-]
    real(wp), allocatable :: omega(:)          !! frequencies [rad/s]
  contains
    procedure :: terms
  end type ghm_model

contains

  !> Inertia 1/omega2, viscosity 2 zeta/omega.
  pure function terms(self) result(t)
    class(ghm_model), intent(in) :: self
    type(viscoelastic_terms) :: t
    t = viscoelastic_terms(size(self%alpha), 0, self%alpha, 2*self%zeta/self%omega, 1/self%omega**2)
  end function terms
end module ghm_law
