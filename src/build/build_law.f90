!> The factory of viscoelastic laws: a record's lists into terms.
module build_law
  use deck_records, only: law_record
  use viscoelastic_law, only: viscoelastic_terms, ghm_terms, maxwell_terms
  implicit none (type, external)
  private
  public :: law_of

contains

  !> The terms of all laws that the record states, which act together, at its temperature: E(s, T) = b_T E(a_T s), so that a term
  !> keeps its weight and damping ratio, and its times are a_T times as long (theory.md, section 5).
  pure type(viscoelastic_terms) function law_of(r) result(law)
    type(law_record), intent(in) :: r
    law = ghm_terms(r%ghm_alpha, r%ghm_zeta, r%ghm_omega/r%slower)
    law = law%combined(maxwell_terms(r%prony_alpha, r%slower*r%prony_tau))
  end function law_of
end module build_law
