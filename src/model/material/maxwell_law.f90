!> The generalised Maxwell law (a Prony series): springs in series with dashpots, beside the static stiffness.
module maxwell_law
  use kinds, only: wp
  use viscoelastic_law, only: law_model, viscoelastic_terms
  implicit none (type, external)
  private

  !> E(s)/E_R = 1 + sum of alpha tau s/(1 + tau s).
  type, extends(law_model), public :: maxwell_model
    real(wp), allocatable :: alpha(:)          !! weights [-]
    real(wp), allocatable :: tau(:)            !! relaxation times [s]
  contains
    procedure :: terms
  end type maxwell_model

contains

  !> No inertia, viscosity tau.
  pure function terms(self) result(t)
    class(maxwell_model), intent(in) :: self
    type(viscoelastic_terms) :: t
    t = viscoelastic_terms(0, size(self%alpha), self%alpha, self%tau, 0*self%tau)
  end function terms
end module maxwell_law
