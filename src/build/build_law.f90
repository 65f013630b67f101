!> The factory of viscoelastic laws: a record's lists into terms.
module build_law
  use deck_records, only: law_record
  use ghm_law, only: ghm_model
  use maxwell_law, only: maxwell_model
  use viscoelastic_law, only: viscoelastic_terms
  implicit none (type, external)
  private
  public :: law_of

contains

  !> The terms of all laws that the record states, which act together.
  pure type(viscoelastic_terms) function law_of(r) result(law)
    type(law_record), intent(in) :: r
    type(ghm_model) :: ghm
    type(maxwell_model) :: maxwell
    ghm = ghm_model(r%ghm_alpha, r%ghm_zeta, r%ghm_omega)
    maxwell = maxwell_model(r%prony_alpha, r%prony_tau)
    law = ghm%terms()
    law = law%beside(maxwell%terms())
  end function law_of
end module build_law
