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

  !> Factors the frames' system at the present markers; usable is false where frames cannot close the joints well, or where
  !> there is nothing elastic to spare.
  subroutine prepare_frames(self, usable)
    type(mechanism_model), intent(inout) :: self
    logical, intent(out) :: usable
    usable = any(self%flexible) .and. .not. self%elastic_held
    if (.not. usable) return
    call self%closing%clear()
    call rigid_wrenches(size(self%side_row), self%end_marker, self%w, size(self%marker_body), self%p%rho, self%rigid_wrench)
    call add_frame_compliance(size(self%cos_theta), self%side_first, size(self%side_row), self%side_row, self%frame_l, &
                              self%frame_dinv, self%rigid_wrench, &
                              self%g, self%s%rows, self%closing%scale, size(self%slot), self%slot, size(self%closing%s), &
                              self%closing%s)
    self%closing%weakest = well_held
    call self%closing%factor_strong(usable)
  end subroutine prepare_frames

  !> Wrenches on markers, moved to the frame's origin.
  pure subroutine rigid_wrenches(n, marker, w, np, rho, rigid_wrench)
    integer, intent(in) :: n, np
    integer, intent(in) :: marker(n)
    real(wp), intent(in) :: w(3, n)            !! unit wrenches, body axes [-, m]
    real(wp), intent(in) :: rho(2, np)         !! [m]
    real(wp), intent(out) :: rigid_wrench(3, n) !! the same on the frames [-, m]
    integer :: e
    do e = 1, n
      rigid_wrench(1, e) = w(1, e)
      rigid_wrench(2, e) = w(2, e)
      rigid_wrench(3, e) = w(3, e) + rho(1, marker(e))*w(2, e) - rho(2, marker(e))*w(1, e)
    end do
  end subroutine rigid_wrenches

  !> Moves the frames so that the joints, open by phi, close to first order.
  subroutine close_frames(self, phi, q)
    type(mechanism_model), intent(inout) :: self
    real(wp), intent(inout), contiguous :: phi(:)      !! (rows) [m], then the multipliers of the correction
    real(wp), intent(inout), contiguous :: q(:)        !! (nq) [m, rad]
    call self%closing%solve(phi)
    call solve_frames(size(self%cos_theta), self%side_first, size(self%side_row), self%side_row, self%rigid_wrench, &
                      self%frame_l, self%frame_dinv, &
                      self%s%rows, phi, self%push)
    call turn_back(size(self%cos_theta), self%s%qo, self%cos_theta, self%sin_theta, self%push, size(self%a), self%a)
    call add_frames(size(self%cos_theta), self%s%qo, size(q), self%a, q)
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
