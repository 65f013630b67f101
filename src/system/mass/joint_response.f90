!> Accelerations by forces and multipliers: M^-1 (Q - Phi_q^T lambda) of frames and elastic coordinates with the factors
!> of the last evaluation (theory.md, section 7). Loops run over plain arrays; rigid bodies never touch their models.
module joint_response
  use kinds, only: wp
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: accelerations, apply_multipliers, free_accelerations, solve_frames, solve_frame, turn_frames

contains

  !> a = M^-1 (Q - Phi_q^T lambda), or without the forces Q: accelerations, or what multipliers change in them.
  subroutine accelerations(self, ev, lambda, with_forces, a)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in), contiguous :: lambda(:)     !! (rows) multipliers [N], or times s2 for positions
    logical, intent(in) :: with_forces
    real(wp), intent(out), contiguous :: a(:)         !! (nq), global axes [m/s2, rad/s2], or [m, rad]
    real(wp) :: share                                 ! of the forces: all or nothing [-]
    integer :: b, i, n
    share = merge(1.0_wp, 0.0_wp, with_forces)
    call solve_frames(size(ev%frame%cos), self%incidence%first, size(self%incidence%row), self%incidence%row, &
                      ev%side%frame_wrench, ev%frame%l, ev%frame%dinv, self%s%rows, lambda, share, ev%frame%rhs, ev%frame%response)
    call turn_frames(size(ev%frame%cos), self%s%qo, ev%frame%cos, ev%frame%sin, ev%frame%response, size(a), a)
    do b = 1, size(ev%frame%cos)
      if (.not. self%flexible(b)) cycle
      i = self%s%qo(b)
      n = self%s%bodies(self%prototype(b))%nf
      if (ev%elastic_fixed) then
        a(i + 4:i + 3 + n) = 0.0_wp
        cycle
      end if
      associate (body => self%s%bodies(self%prototype(b)), w => ev%elastic(b))
        call follow_frame(n, share, w%force(1:n), body%shape%pmat, w%coupling(1:n), ev%frame%response(:, b), a(i + 4:i + 3 + n))
      end associate
      call add_elastic_response(self, ev, b, lambda, a(i + 4:i + 3 + n))
    end do
  end subroutine accelerations

  !> dq = -M^-1 Phi_q^T mu: the mass-orthogonal correction (theory.md, section 6).
  subroutine apply_multipliers(self, ev, mu, dq)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in), contiguous :: mu(:)         !! (rows) multipliers [N], or times s2 for positions
    real(wp), intent(out), contiguous :: dq(:)        !! (nq), global axes [m/s2, rad/s2], or [m, rad]
    call accelerations(self, ev, mu, .false., dq)
  end subroutine apply_multipliers

  !> x = Mc^-1 (share rhs - J^T w lambda) of every body's frame, the wrenches J^T w in frame_wrench.
  pure subroutine solve_frames(nb, first, n, row, frame_wrench, frame_l, frame_dinv, rows, lambda, share, rhs, x)
    integer, intent(in) :: nb, n, rows
    integer, intent(in) :: first(nb + 1), row(n)
    real(wp), intent(in) :: frame_wrench(3, n), lambda(rows)      !! wrenches [-, m], multipliers [N]
    real(wp), intent(in) :: frame_l(3, nb), frame_dinv(3, nb)   !! factors of the frames [1/kg ...]
    real(wp), intent(in) :: share, rhs(3, nb)         !! 1 or 0 [-], condensed forces, body axes [N, N, N m]
    real(wp), intent(out) :: x(3, nb)                 !! body axes [m/s2, rad/s2]
    real(wp) :: x1, x2, x3, l
    integer :: b, e
    do b = 1, nb
      x1 = share*rhs(1, b)
      x2 = share*rhs(2, b)
      x3 = share*rhs(3, b)
      do e = first(b), first(b + 1) - 1
        l = lambda(row(e))
        x1 = x1 - frame_wrench(1, e)*l
        x2 = x2 - frame_wrench(2, e)*l
        x3 = x3 - frame_wrench(3, e)*l
      end do
      call solve_frame(frame_l(:, b), frame_dinv(:, b), x1, x2, x3)
      x(1, b) = x1
      x(2, b) = x2
      x(3, b) = x3
    end do
  end subroutine solve_frames

  !> x <- (L D L^T)^-1 x of one frame.
  pure subroutine solve_frame(l, dinv, x1, x2, x3)
    real(wp), intent(in) :: l(3), dinv(3)             !! of `factor_frame` [-, m, m], [1/kg, 1/kg, 1/(kg m2)]
    real(wp), intent(inout) :: x1, x2, x3             !! [N, N, N m], then [m/s2, m/s2, rad/s2]
    x2 = x2 - l(1)*x1
    x3 = (x3 - l(2)*x1 - l(3)*x2)*dinv(3)
    x2 = x2*dinv(2) - l(3)*x3
    x1 = x1*dinv(1) - l(1)*x2 - l(2)*x3
  end subroutine solve_frame

  !> Accelerations of the condensed frames without multipliers.
  pure subroutine free_accelerations(nb, rhs, frame_l, frame_dinv, free)
    integer, intent(in) :: nb
    real(wp), intent(in) :: rhs(3, nb), frame_l(3, nb), frame_dinv(3, nb)   !! as frame_results [N, N, N m], [-, m], [1/kg, ...]
    real(wp), intent(out) :: free(3, nb)              !! body axes [m/s2, rad/s2]
    real(wp) :: x1, x2, x3
    integer :: b
    do b = 1, nb
      x1 = rhs(1, b)
      x2 = rhs(2, b)
      x3 = rhs(3, b)
      call solve_frame(frame_l(:, b), frame_dinv(:, b), x1, x2, x3)
      free(1, b) = x1
      free(2, b) = x2
      free(3, b) = x3
    end do
  end subroutine free_accelerations

  !> Subtracts m_ff^-1 E^T w lambda from elastic accelerations (or corrections).
  subroutine add_elastic_response(self, ev, b, lambda, a)
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
  end subroutine add_elastic_response

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

  !> Accelerations or corrections of the frames in global axes.
  pure subroutine turn_frames(nb, offset, c, s, x, nq, a)
    integer, intent(in) :: nb, nq
    integer, intent(in) :: offset(nb)                 !! of each body's coordinates
    real(wp), intent(in) :: c(nb), s(nb), x(3, nb)    !! of the frame angles [-]; body axes [m/s2, rad/s2]
    real(wp), intent(inout) :: a(nq)                  !! [m/s2, rad/s2]
    integer :: b, i
    do b = 1, nb
      i = offset(b)
      a(i + 1) = c(b)*x(1, b) - s(b)*x(2, b)
      a(i + 2) = s(b)*x(1, b) + c(b)*x(2, b)
      a(i + 3) = x(3, b)
    end do
  end subroutine turn_frames

  !> Elastic accelerations beside those of the frame: m_ff^-1 (share Q_f - (S-bar^T, m_theta_f^T) x).
  pure subroutine follow_frame(n, share, elastic_force, pmat, angle_coupling, x, a)
    integer, intent(in) :: n
    real(wp), intent(in) :: share           !! 1 or 0 [-]
    real(wp), intent(in) :: elastic_force(n), pmat(n, 2), angle_coupling(n)   !! solved [m/s2, rad/s2], [-], [m, -]
    real(wp), intent(in) :: x(3)            !! of the frame, body axes [m/s2, rad/s2]
    real(wp), intent(out) :: a(n)           !! [m/s2, rad/s2]
    integer :: k
    do k = 1, n
      a(k) = share*elastic_force(k) - pmat(k, 1)*x(1) - pmat(k, 2)*x(2) - angle_coupling(k)*x(3)
    end do
  end subroutine follow_frame
end module joint_response
