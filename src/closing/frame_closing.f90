!> Corrections of positions by the frames alone, elastic coordinates fixed: Phi_r Mc^-1 Phi_r^T mu = Phi with the condensed masses
!> Mc of the last evaluation. A mass-orthogonal correction would also move elastic coordinates. A stiff one then accelerates by
!> omega^2 times its correction: rounding of positions, 1e-16 m, becomes 1e-6 m/s2 at 1e5 rad/s in every step.
!> Frames have no stiffness. Where they cannot close the joints well (a beam between two fixed joints, positions near a singular
!> one), the mass-orthogonal correction is used.
module frame_closing
  use kinds, only: wp
  use joint_response, only: solve_frames, turn_frames
  use joint_system, only: add_frame_compliance, rigid_wrenches
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: prepare_frames, close_frames

  real(wp), parameter :: well_closed = 1.0e-3_wp   !! relative pivot from which frames close joints well: by motions of at most
                                                 !! some thirty times the gap [-]

contains

  !> Factors the frames' system at the present markers; usable is false where frames cannot close the joints well, or where
  !> no body is flexible.
  subroutine prepare_frames(self, ev, usable)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    logical, intent(out) :: usable
    usable = any(self%flexible) .and. .not. ev%elastic_fixed
    if (.not. usable) return
    if (allocated(ev%rows%off)) call ev%closing%hold(ev%rows%off)
    call ev%closing%clear()
    call rigid_wrenches(size(self%incidence%row), self%incidence%marker, ev%side%w, size(self%markers%body), ev%p%rho, &
                        ev%side%rigid_wrench)
    call add_frame_compliance(size(ev%frame%cos), self%incidence%first, size(self%incidence%row), self%incidence%row, ev%frame%l, &
                              ev%frame%dinv, ev%side%rigid_wrench, &
                              ev%side%g, self%s%rows, ev%closing%scale, size(ev%closing%entry), ev%closing%entry, &
                              size(ev%closing%s), ev%closing%s)
    ev%closing%weakest = well_closed
    call ev%closing%factor_strong(usable)
  end subroutine prepare_frames

  !> Moves the frames so that the gaps phi of the joints close to first order.
  subroutine close_frames(self, ev, phi, q)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    real(wp), intent(inout), contiguous :: phi(:)      !! (rows) [m], then the multipliers of the correction
    real(wp), intent(inout), contiguous :: q(:)        !! (nq) [m, rad]
    integer :: b
    call ev%closing%solve(phi)
    call solve_frames(size(ev%frame%cos), self%incidence%first, size(self%incidence%row), self%incidence%row, &
                      ev%side%rigid_wrench, ev%frame%l, ev%frame%dinv, self%s%rows, phi, 0.0_wp, ev%frame%rhs, &
                      ev%frame%response)
    call turn_frames(size(ev%frame%cos), self%s%qo, ev%frame%cos, ev%frame%sin, ev%frame%response, size(ev%a), ev%a)
    do b = 1, size(ev%frame%cos)
      associate (i => self%s%qo(b))
        q(i + 1:i + 3) = q(i + 1:i + 3) + ev%a(i + 1:i + 3)
      end associate
    end do
  end subroutine close_frames
end module frame_closing
