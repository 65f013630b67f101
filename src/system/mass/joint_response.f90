!> What multipliers do to the coordinates: M^-1 Phi_q^T lambda of frames and elastic coordinates with the factors of the last
!> evaluation (theory.md, section 7). Loops run over plain arrays; rigid bodies never touch their models.
module joint_response
  use kinds, only: wp
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: push_frames, push_elastic, apply_multipliers, solve_frames, turn_back

contains

  !> push = Mc^-1 J^T w lambda of every body's frame, body axes.
  pure subroutine push_frames(self, ev, lambda)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in), contiguous :: lambda(:)     !! (rows) [N]
    call solve_frames(size(ev%frame%cos), self%incidence%first, size(self%incidence%row), self%incidence%row, &
                      ev%side%frame_wrench, ev%frame%l, ev%frame%dinv, self%s%rows, lambda, ev%frame%push)
  end subroutine push_frames

  !> x = Mc^-1 J^T w lambda of every body's frame, the wrenches J^T w in jw.
  pure subroutine solve_frames(nb, first, n, row, frame_wrench, frame_l, frame_dinv, rows, lambda, x)
    integer, intent(in) :: nb, n, rows
    integer, intent(in) :: first(nb + 1), row(n)
    real(wp), intent(in) :: frame_wrench(3, n), lambda(rows)      !! wrenches [-, m], multipliers [N]
    real(wp), intent(in) :: frame_l(3, nb), frame_dinv(3, nb)   !! factors of the frames [1/kg ...]
    real(wp), intent(out) :: x(3, nb)                                         !! [m/s2, rad/s2]
    real(wp) :: x1, x2, x3, l
    integer :: b, e
    do b = 1, nb
      x1 = 0.0_wp
      x2 = 0.0_wp
      x3 = 0.0_wp
      do e = first(b), first(b + 1) - 1
        l = lambda(row(e))
        x1 = x1 + frame_wrench(1, e)*l
        x2 = x2 + frame_wrench(2, e)*l
        x3 = x3 + frame_wrench(3, e)*l
      end do
      x2 = x2 - frame_l(1, b)*x1
      x3 = (x3 - frame_l(2, b)*x1 - frame_l(3, b)*x2)*frame_dinv(3, b)
      x2 = x2*frame_dinv(2, b) - frame_l(3, b)*x3
      x(1, b) = x1*frame_dinv(1, b) - frame_l(1, b)*x2 - frame_l(2, b)*x3
      x(2, b) = x2
      x(3, b) = x3
    end do
  end subroutine solve_frames

  !> Subtracts m_ff^-1 E^T w lambda from elastic accelerations (or corrections).
  subroutine push_elastic(self, ev, b, lambda, a)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    integer, intent(in) :: b
    real(wp), intent(in), contiguous :: lambda(:)     !! (rows) [N]
    real(wp), intent(inout), contiguous :: a(:)       !! (nf) [m/s2, rad/s2], or corrections [m, rad]
    integer :: first, last
    first = self%incidence%first(b)
    last = self%incidence%first(b + 1) - 1
    associate (at => self%attached(self%attached_prototype(b)), load => ev%attached(self%attached_prototype(b))%load)
      call column_loads(last - first + 1, self%incidence%row(first:last), self%incidence%attachment(first:last), &
                        ev%side%w(:, first:last), self%s%rows, lambda, size(at%marker), at%column, size(load), load)
      call subtract_columns(size(a), size(load), load, at%columns, a)
    end associate
  end subroutine push_elastic

  !> Multiplier forces on the columns of one body's attachments.
  pure subroutine column_loads(n, row, local, w, rows, lambda, na, column, nc, load)
    integer, intent(in) :: n, rows, na, nc
    integer, intent(in) :: row(n), local(n), column(3, na)
    real(wp), intent(in) :: w(3, n), lambda(rows)   !! wrenches of unit multipliers [-, m], multipliers [N]
    real(wp), intent(out) :: load(nc)               !! [N, N m]
    integer :: e, c, k
    load = 0.0_wp
    do e = 1, n
      do c = 1, 3
        k = column(c, local(e))
        if (k > 0) load(k) = load(k) + w(c, e)*lambda(row(e))
      end do
    end do
  end subroutine column_loads

  !> a = a - columns load.
  pure subroutine subtract_columns(n, nc, load, columns, a)
    integer, intent(in) :: n, nc
    real(wp), intent(in) :: load(nc), columns(n, nc)   !! forces on the columns [N, N m], columns m_ff^-1 E^T [1/kg ...]
    real(wp), intent(inout) :: a(n)                    !! [m/s2, rad/s2]
    integer :: j, k
    do k = 1, nc
      do j = 1, n
        a(j) = a(j) - load(k)*columns(j, k)
      end do
    end do
  end subroutine subtract_columns

  !> dq = -M^-1 Phi_q^T mu with the factors of the last evaluation: the mass-orthogonal correction (theory.md, section 6).
  subroutine apply_multipliers(self, ev, mu, dq)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in), contiguous :: mu(:)         !! (rows) multipliers [N], or times s2 for positions
    real(wp), intent(out), contiguous :: dq(:)        !! (nq), global axes [m/s2, rad/s2], or [m, rad]
    integer :: b, i, n
    call push_frames(self, ev, mu)
    call turn_back(size(ev%frame%cos), self%s%qo, ev%frame%cos, ev%frame%sin, ev%frame%push, size(dq), dq)
    do b = 1, size(ev%frame%cos)
      if (.not. self%flexible(b)) cycle
      i = self%s%qo(b)
      n = self%s%bodies(self%prototype(b))%nf
      if (ev%elastic_held) then
        dq(i + 4:i + 3 + n) = 0.0_wp
        cycle
      end if
      call follow_frame(n, self%s%bodies(self%prototype(b))%shape%pmat, ev%elastic(b)%coupling(1:n), ev%frame%push(:, b), &
                        dq(i + 4:i + 3 + n))
      call push_elastic(self, ev, b, mu, dq(i + 4:i + 3 + n))
    end do
  end subroutine apply_multipliers

  !> Corrections of the frames, -push in global axes.
  pure subroutine turn_back(nb, offset, c, s, push, nq, dq)
    integer, intent(in) :: nb, nq
    integer, intent(in) :: offset(nb)
    real(wp), intent(in) :: c(nb), s(nb), push(3, nb)   !! of the frame angles [-]; accelerations, body axes [m/s2, rad/s2]
    real(wp), intent(inout) :: dq(nq)                   !! [m/s2, rad/s2]
    integer :: b, i
    do b = 1, nb
      i = offset(b)
      dq(i + 1) = s(b)*push(2, b) - c(b)*push(1, b)
      dq(i + 2) = -s(b)*push(1, b) - c(b)*push(2, b)
      dq(i + 3) = -push(3, b)
    end do
  end subroutine turn_back

  !> Elastic coordinates that follow a correction -x of the frame: m_ff^-1 (S-bar^T, m_theta_f^T) x.
  pure subroutine follow_frame(n, pmat, angle_coupling, x, dq)
    integer, intent(in) :: n
    real(wp), intent(in) :: pmat(n, 2), angle_coupling(n), x(3) !! m_ff^-1 (S-bar^T [-], m_theta_f [m]), of the frame [m/s2, rad/s2]
    real(wp), intent(out) :: dq(n)                    !! [m/s2, rad/s2]
    integer :: k
    do k = 1, n
      dq(k) = pmat(k, 1)*x(1) + pmat(k, 2)*x(2) + angle_coupling(k)*x(3)
    end do
  end subroutine follow_frame
end module joint_response
