!> Corrections of positions by the frames alone, elastic coordinates held: Phi_r Mc^-1 Phi_r^T mu = Phi with the condensed
!> masses Mc of the last evaluation. A mass-orthogonal correction also moves elastic coordinates, and stiff ones turn what
!> they move by into omega^2 times as much acceleration: the rounding of positions, 1e-16 m, becomes 1e-6 m/s2 at
!> 1e5 rad/s, at every step anew. Frames have no stiffness. Where they cannot close the joints well (a beam held at both
!> ends, positions near a singular one), the mass-orthogonal correction serves.
module frame_closing
  use kinds, only: wp
  use joint_response, only: solve_frames, turn_back
  use joint_system, only: add_frame_compliance
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: prepare_frames, close_frames

  real(wp), parameter :: well_held = 1.0e-3_wp   !! relative pivot from which frames close joints well: they move by at most
                                                 !! some thirty times what is open [-]

contains

  !> Factors the frames' system at the present places; usable is false where frames cannot close the joints well, or where
  !> there is nothing elastic to spare.
  subroutine prepare_frames(self, usable)
    type(mechanism_model), intent(inout) :: self
    logical, intent(out) :: usable
    usable = any(self%flexible) .and. .not. self%frozen
    if (.not. usable) return
    call self%closing%clear()
    call levers(size(self%end_row), self%end_place, self%w, size(self%place_body), self%p%rho, self%lever)
    call add_frame_compliance(size(self%c), self%end_first, size(self%end_row), self%end_row, self%low, self%dinv, self%lever, &
                              self%g, self%s%rows, self%closing%scale, size(self%slot), self%slot, size(self%closing%s), &
                              self%closing%s)
    self%closing%weakest = well_held
    call self%closing%factor_strong(usable)
  end subroutine prepare_frames

  !> Wrenches on places, moved to the frame's origin.
  pure subroutine levers(n, place, w, np, rho, lever)
    integer, intent(in) :: n, np
    integer, intent(in) :: place(n)
    real(wp), intent(in) :: w(3, n)            !! unit wrenches, body axes [-, m]
    real(wp), intent(in) :: rho(2, np)         !! [m]
    real(wp), intent(out) :: lever(3, n)       !! the same on the frames [-, m]
    integer :: e
    do e = 1, n
      lever(1, e) = w(1, e)
      lever(2, e) = w(2, e)
      lever(3, e) = w(3, e) + rho(1, place(e))*w(2, e) - rho(2, place(e))*w(1, e)
    end do
  end subroutine levers

  !> Moves the frames so that the joints, open by phi, close to first order.
  subroutine close_frames(self, phi, q)
    type(mechanism_model), intent(inout) :: self
    real(wp), intent(inout), contiguous :: phi(:)      !! (rows) [m], then the multipliers of the correction
    real(wp), intent(inout), contiguous :: q(:)        !! (nq) [m, rad]
    call self%closing%solve(phi)
    call solve_frames(size(self%c), self%end_first, size(self%end_row), self%end_row, self%lever, self%low, self%dinv, &
                      self%s%rows, phi, self%push)
    call turn_back(size(self%c), self%s%qo, self%c, self%sn, self%push, size(self%a), self%a)
    call add_frames(size(self%c), self%s%qo, size(q), self%a, q)
  end subroutine close_frames

  !> Adds the corrections of the frames, and of nothing else.
  pure subroutine add_frames(nb, offset, nq, dq, q)
    integer, intent(in) :: nb, nq
    integer, intent(in) :: offset(nb)          !! of each body's coordinates
    real(wp), intent(in) :: dq(nq)             !! elastic entries are not used [m, rad]
    real(wp), intent(inout) :: q(nq)           !! [m, rad]
    integer :: b, i
    do b = 1, nb
      i = offset(b)
      q(i + 1) = q(i + 1) + dq(i + 1)
      q(i + 2) = q(i + 2) + dq(i + 2)
      q(i + 3) = q(i + 3) + dq(i + 3)
    end do
  end subroutine add_frames
end module frame_closing
