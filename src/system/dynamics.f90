!> The equations of motion, solved in structure (theory.md, sections 3, 5, 6, 7): elastic coordinates are condensed body by
!> body onto the frame, frames onto the multipliers. One evaluation costs two banded solves per flexible body and a banded
!> system of the size of the joints. Accelerations are computed in body axes: a' = A^T R''.
module dynamics
  use kinds, only: wp
  use body_condensation, only: condense_bodies
  use evaluation_settings, only: evaluation_options
  use joint_correction, only: correct_accelerations
  use joint_geometry, only: factor_joints
  use joint_response, only: push_frames, push_elastic, apply_multipliers
  use joint_system, only: constraint_values, row_rates, condense_constraints, joint_accelerations
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  use marker_forces, only: applied_forces, load_frames
  use marker_motion, only: set_frames, marker_kinematics, one_marker
  implicit none (type, external)
  private
  public :: evaluate, evaluate_regular, marker_kinematics, one_marker, constraint_values, row_rates, condense_constraints, &
            apply_multipliers, applied_forces, set_frames

contains

  !> Accelerations, multipliers, dissipative accelerations and powers at a state; the results stay in self.
  subroutine evaluate(self, ev, options, t, q, v, z, zd)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    type(evaluation_options), intent(in) :: options
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(in), contiguous :: q(:), v(:)    !! (nq) positions and velocities [m, rad] and per second
    real(wp), intent(in), contiguous :: z(:), zd(:)   !! (nz) internal variables [m, rad], (nzd) rates per second
    ev%evaluations = ev%evaluations + 1
    ev%t = t
    ev%options = options
    call set_frames(self, ev, q)
    call marker_kinematics(self, ev, q, v)
    ev%dissipated_power = 0.0_wp
    ev%input_power = 0.0_wp
    call applied_forces(self, ev, options, t, z, zd)
    call condense_bodies(self, ev, options%gravity, q, v, z, zd)
    call load_frames(self, ev)
    call free_accelerations(size(ev%frame%cos), ev%frame%rhs, ev%frame%l, ev%frame%dinv, ev%frame%free)
    call constraint_values(self, ev, options, t)
    call condense_constraints(self, ev, .false.)
    call factor_joints(self, ev, options%accept_weak_pivots)
    call multiplier_forces(self, ev, options%baumgarte)
    call accelerations(self, ev)
    if (ev%schur%uneven_masses) call correct_accelerations(self, ev)
    call drive_powers(self, ev)
    if (.not. v(1) < huge(1.0_wp)) ev%broken = .true.
  end subroutine evaluate

  !> The same where a position is nearly singular but no motion passes through it: the joints' equations as they are.
  subroutine evaluate_regular(self, ev, options, t, q, v, z, zd)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    type(evaluation_options), intent(in) :: options
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(in), contiguous :: q(:), v(:)    !! (nq) positions and velocities [m, rad] and per second
    real(wp), intent(in), contiguous :: z(:), zd(:)   !! (nz) internal variables [m, rad], (nzd) rates per second
    type(evaluation_options) :: as_they_are
    as_they_are = options
    as_they_are%accept_weak_pivots = .true.
    call evaluate(self, ev, as_they_are, t, q, v, z, zd)
  end subroutine evaluate_regular

  !> Accelerations of the condensed frames without multipliers.
  pure subroutine free_accelerations(nb, rhs, frame_l, frame_dinv, free)
    integer, intent(in) :: nb
    real(wp), intent(in) :: rhs(3, nb), frame_l(3, nb), frame_dinv(3, nb)   !! as frame_results [N, N, N m], [-, m], [1/kg, ...]
    real(wp), intent(out) :: free(3, nb)    !! body axes [m/s2, rad/s2]
    real(wp) :: x2, x3
    integer :: b
    do b = 1, nb
      x2 = rhs(2, b) - frame_l(1, b)*rhs(1, b)
      x3 = (rhs(3, b) - frame_l(2, b)*rhs(1, b) - frame_l(3, b)*x2)*frame_dinv(3, b)
      x2 = x2*frame_dinv(2, b) - frame_l(3, b)*x3
      free(1, b) = rhs(1, b)*frame_dinv(1, b) - frame_l(1, b)*x2 - frame_l(2, b)*x3
      free(2, b) = x2
      free(3, b) = x3
    end do
  end subroutine free_accelerations

  !> Multipliers from S lambda = Phi_q a_free + (second derivative at zero acceleration), with Baumgarte terms if asked.
  subroutine multiplier_forces(self, ev, baumgarte)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in) :: baumgarte(2)    !! alpha, beta [1/s]
    if (self%s%rows == 0) return
    call joint_accelerations(self, ev)
    if (any(baumgarte > 0.0_wp)) call add_baumgarte(self, ev, baumgarte)
    call ev%schur%solve(ev%lambda)
  end subroutine multiplier_forces

  !> Adds what the drives do to the power.
  pure subroutine drive_powers(self, ev)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    integer :: k, i
    do k = self%s%joints + 1, size(self%s%constraints)
      associate (c => self%s%constraints(k)%item)
        i = c%first
        ev%input_power = ev%input_power + ev%lambda(i)*ev%rows%phi_t(i)
      end associate
    end do
  end subroutine drive_powers

  !> 2 alpha Phi' + beta^2 Phi (Baumgarte 1972).
  subroutine add_baumgarte(self, ev, baumgarte)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in) :: baumgarte(2)    !! alpha, beta [1/s]
    call row_rates(self, ev, ev%schur%r)
    ev%lambda = ev%lambda + 2*baumgarte(1)*ev%schur%r + baumgarte(2)**2*ev%rows%phi
  end subroutine add_baumgarte

  !> Accelerations of frames (global) and elastic coordinates from the free ones and the multipliers.
  subroutine accelerations(self, ev)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    integer :: b, i, n
    call push_frames(self, ev, ev%lambda)
    call frame_accelerations(size(ev%frame%cos), self%s%qo, ev%frame%cos, ev%frame%sin, ev%frame%free, ev%frame%push, &
                             size(ev%a), ev%a)
    do b = 1, size(ev%frame%cos)
      if (.not. self%flexible(b)) cycle
      i = self%s%qo(b)
      associate (body => self%s%bodies(self%prototype(b)), w => ev%elastic(b))
        n = body%nf
        call elastic_accelerations(n, w%force(1:n), body%shape%pmat, w%coupling(1:n), ev%frame%push(:, b), ev%a(i + 4:i + 3 + n))
      end associate
      call push_elastic(self, ev, b, ev%lambda, ev%a(i + 4:i + 3 + n))
    end do
  end subroutine accelerations

  !> Accelerations of the frames, global axes; push becomes their accelerations in body axes.
  pure subroutine frame_accelerations(nb, offset, c, s, free, push, nq, a)
    integer, intent(in) :: nb, nq
    integer, intent(in) :: offset(nb)                 !! of each body's coordinates
    real(wp), intent(in) :: c(nb), s(nb)              !! of the frame angles [-]
    real(wp), intent(in) :: free(3, nb)               !! accelerations without multipliers [m/s2, rad/s2]
    real(wp), intent(inout) :: push(3, nb)            !! what the multipliers take from them [m/s2, rad/s2]
    real(wp), intent(inout) :: a(nq)                  !! [m/s2, rad/s2]
    real(wp) :: x1, x2, x3
    integer :: b, i
    do b = 1, nb
      i = offset(b)
      x1 = free(1, b) - push(1, b)
      x2 = free(2, b) - push(2, b)
      x3 = free(3, b) - push(3, b)
      a(i + 1) = c(b)*x1 - s(b)*x2
      a(i + 2) = s(b)*x1 + c(b)*x2
      a(i + 3) = x3
      push(1, b) = x1
      push(2, b) = x2
      push(3, b) = x3
    end do
  end subroutine frame_accelerations

  !> m_ff^-1 (Q_f - m_fR a' - m_f_theta theta'').
  pure subroutine elastic_accelerations(n, elastic_force, pmat, angle_coupling, x, a)
    integer, intent(in) :: n
    real(wp), intent(in) :: elastic_force(n), pmat(n, 2), angle_coupling(n)   !! solved [m/s2, rad/s2], [-], [m, -]
    real(wp), intent(in) :: x(3)            !! accelerations of the frame, body axes [m/s2, rad/s2]
    real(wp), intent(out) :: a(n)           !! [m/s2, rad/s2]
    integer :: k
    do k = 1, n
      a(k) = elastic_force(k) - pmat(k, 1)*x(1) - pmat(k, 2)*x(2) - angle_coupling(k)*x(3)
    end do
  end subroutine elastic_accelerations
end module dynamics
