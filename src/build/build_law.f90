!> The factory of viscoelastic laws: a record's lists into terms.
module build_law
  use deck_records, only: law_record
  use viscoelastic_law, only: viscoelastic_terms
  implicit none (type, external)
  private
  public :: law_of

contains

  !> The terms of all laws that the record states, which act together, at its temperature: E(s, T) = b_T E(a_T s), so that a term
  !> keeps its weight and damping ratio, and its times are a_T times as long (theory.md, section 5).
  !> - the law of Golla, Hughes and McTavish: E(s)/E_R = 1 + sum of alpha (s2 + 2 zeta omega s)/(s2 + 2 zeta omega s + omega2)
  !> - the generalised Maxwell law (a Prony series), springs in series with dashpots: 1 + sum of alpha tau s/(1 + tau s).
  pure type(viscoelastic_terms) function law_of(r) result(law)
    type(law_record), intent(in) :: r
    associate (omega => r%ghm_omega/r%slower, tau => r%slower*r%prony_tau)
      law%second = size(omega)
      law%first = size(tau)
      law%alpha = [r%ghm_alpha, r%prony_alpha]
      law%viscosity = [2*r%ghm_zeta/omega, tau]
      law%inertia = [1/omega**2, 0*tau]
    end associate
  end function law_of
end module build_law
