!> Corrections of positions by the frames alone, elastic coordinates held: Phi_r Mc^-1 Phi_r^T mu = Phi with the condensed
!> masses Mc of the last evaluation. A mass-orthogonal correction also moves elastic coordinates, and stiff ones turn what
!> they move by into omega^2 times as much acceleration: the rounding of positions, 1e-16 m, becomes 1e-6 m/s2 at
!> 1e5 rad/s, at every step anew. Frames have no stiffness. Where they cannot close the joints well (a beam held at both
!> ends, positions near a singular one), the mass-orthogonal correction serves.
module frame_closing
  use kinds, only: wp
  use joint_system, only: add_frame_compliance, solve_frame
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
    integer :: b, first, last, n
    usable = any(self%flexible) .and. .not. self%frozen
    if (.not. usable) return
    call self%closing%clear()
    do b = 1, size(self%c)
      first = self%end_first(b)
      last = self%end_first(b + 1) - 1
      n = last - first + 1
      if (n == 0) cycle
      call levers(n, self%end_place(first:last), self%w(:, first:last), size(self%place_body), self%p%rho, &
                  self%lever(:, first:last))
      call add_frame_compliance(n, self%end_row(first:last), self%low(:, b), self%dinv(:, b), self%lever(:, first:last), &
                                self%g(:, first:last), self%s%rows, self%closing%position, self%closing%scale, &
                                self%closing%kd, self%closing%s)
    end do
    self%closing%weakest = well_held
    call self%closing%factor_strong(usable)
  end subroutine prepare_frames

  !> Wrenches on places, moved to the frame's origin.
  pure subroutine levers(n, place, w, np, rho, lever)
    integer, intent(in) :: n, np
    integer, intent(in) :: place(n)
    real(wp), intent(in) :: w(3, n)            !! body axes
    real(wp), intent(in) :: rho(2, np)         !! [m]
    real(wp), intent(out) :: lever(3, n)
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
    real(wp), intent(inout), contiguous :: q(:)        !! (nq)
    real(wp) :: x(3), l
    integer :: b, e, i
    call self%closing%solve(phi)
    do b = 1, size(self%c)
      x = 0.0_wp
      do e = self%end_first(b), self%end_first(b + 1) - 1
        l = phi(self%end_row(e))
        x(1) = x(1) + self%lever(1, e)*l
        x(2) = x(2) + self%lever(2, e)*l
        x(3) = x(3) + self%lever(3, e)*l
      end do
      call solve_frame(self%low(:, b), self%dinv(:, b), x)
      i = self%s%qo(b)
      q(i + 1) = q(i + 1) - (self%c(b)*x(1) - self%sn(b)*x(2))
      q(i + 2) = q(i + 2) - (self%sn(b)*x(1) + self%c(b)*x(2))
      q(i + 3) = q(i + 3) - x(3)
    end do
  end subroutine close_frames
end module frame_closing
