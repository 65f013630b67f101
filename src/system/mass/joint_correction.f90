!> Multipliers and accelerations corrected by the residual of the joints' equations. With very uneven masses (a heavy body on a
!> light link) S = Phi_q M^-1 Phi_q^T has entries of the size of the light link's 1/m. The heavy body's 1/m is a small difference of
!> them: rounding changes the multipliers by eps times the ratio of the masses. The residual of the accelerations has no such error,
!> so that each correction with the same factor reduces it (iterative refinement; Higham 2002, chapter 12).
module joint_correction
  use kinds, only: wp
  use joint_response, only: apply_multipliers
  use joint_system, only: row_accelerations, row_rates
  use marker_motion, only: marker_displacement
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: correct_accelerations, balanced

  integer, parameter :: most_passes = 6              !! corrections
  real(wp), parameter :: falling = 0.5_wp            !! a residual above this share of the one before no longer falls [-]
  real(wp), parameter :: largest_residual = 1.0e-9_wp   !! that is accepted, of the accelerations' size [-]

contains

  !> Corrects lambda and a of the last evaluation until the residual of the joints no longer falls. Where it stays large the
  !> masses are too uneven for the factor.
  subroutine correct_accelerations(self, ev)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    real(wp) :: worst, before
    integer :: pass
    before = huge(1.0_wp)
    do pass = 1, most_passes
      call joint_residual(self, ev, ev%lambda_change)
      worst = maxval(abs(ev%lambda_change))
      if (.not. worst < falling*before) exit
      before = worst
      call ev%schur%solve(ev%lambda_change)
      call apply_multipliers(self, ev, ev%lambda_change, ev%change)
      ev%a = ev%a + ev%change
      ev%lambda = ev%lambda + ev%lambda_change
    end do
    if (worst > largest_residual*largest_acceleration(self, ev) .and. .not. ev%schur%singular) call ev%schur%note_ill_conditioned()
  end subroutine correct_accelerations

  !> Whether the accelerations already satisfy the joints' equations to rounding.
  logical function balanced(self, ev) result(yes)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    call joint_residual(self, ev, ev%lambda_change)
    yes = .not. maxval(abs(ev%lambda_change)) > 8*epsilon(1.0_wp)*largest_acceleration(self, ev)
  end function balanced

  !> Size of the accelerations at the joints.
  pure real(wp) function largest_acceleration(self, ev) result(a)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(in) :: ev
    integer :: e
    a = max(maxval(abs(ev%p%bias)), maxval(abs(ev%rows%acceleration_bias)), norm2(ev%options%gravity), maxval(abs(ev%frame%free)))
    do e = 1, self%incidence%sides
      a = max(a, maxval(abs(marker_displacement(self, ev, self%incidence%marker(e), ev%a))))
    end do
  end function largest_acceleration

  !> Second derivatives of all rows at the present accelerations, with Baumgarte's terms where they are asked for.
  subroutine joint_residual(self, ev, r)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    real(wp), intent(out), contiguous :: r(:)        !! (rows) [m/s2]
    call row_accelerations(self, ev, ev%a, r)
    associate (baumgarte => ev%options%baumgarte)
      if (any(baumgarte > 0.0_wp)) then
        call row_rates(self, ev, ev%schur%r)
        r = r + 2*baumgarte(1)*ev%schur%r + baumgarte(2)**2*ev%rows%phi
      end if
    end associate
  end subroutine joint_residual
end module joint_correction
