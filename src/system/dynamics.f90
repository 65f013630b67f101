!> The equations of motion, solved in structure (theory.md, sections 3, 5, 6, 7): elastic coordinates are condensed body by
!> body onto the frame, frames onto the multipliers. One evaluation costs two banded solves per flexible body and a banded
!> system of the size of the joints. Accelerations are computed in body axes: a' = A^T R''.
module dynamics
  use kinds, only: wp
  use body_condensation, only: condense_bodies
  use evaluation_settings, only: evaluation_options, usual_options
  use joint_correction, only: correct_accelerations
  use joint_geometry, only: factor_joints
  use joint_response, only: accelerations, apply_multipliers, free_accelerations
  use joint_system, only: constraint_values, row_rates, condense_constraints, joint_accelerations
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  use marker_forces, only: applied_forces, load_frames
  use slipping, only: slip_multipliers
  use marker_motion, only: set_frames, marker_kinematics, one_marker
  implicit none (type, external)
  private
  public :: evaluate, evaluate_motion, evaluate_start, drive_powers, marker_kinematics, one_marker, constraint_values, row_rates, &
            condense_constraints, apply_multipliers, applied_forces, set_frames

  !> A state of motion.
  type, public :: motion_state
    type(evaluation_options) :: options
    real(wp) :: t = 0.0_wp                       !! [s]
    real(wp), allocatable :: q(:), v(:)          !! (nq) [m, rad] and per second
    real(wp), allocatable :: z(:), zd(:)         !! (nz), (nzd) [m, rad] and per second
  end type motion_state

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
    call marker_kinematics(self, ev, q, v)
    ev%dissipated_power = 0.0_wp
    ev%loss = 0.0_wp
    ev%input_power = 0.0_wp
    call applied_forces(self, ev, options, t, z, zd)
    call condense_bodies(self, ev, options%gravity, q, v, z, zd)
    call load_frames(self, ev)
    call free_accelerations(size(ev%frame%cos), ev%frame%rhs, ev%frame%l, ev%frame%dinv, ev%frame%free)
    call constraint_values(self, ev, options, t)
    call condense_constraints(self, ev, .false.)
    if (ev%softening > 0.0_wp) call ev%schur%soften(ev%softening, self%s%permanent_rows + 1)
    call factor_joints(self, ev, options%accept_weak_pivots)
    call multiplier_forces(self, ev, options%baumgarte)
    call accelerations(self, ev, ev%lambda, .true., ev%a)
    if (ev%schur%uneven_masses) call correct_accelerations(self, ev)
    call drive_powers(self, ev, ev%lambda)
    if (.not. v(1) < huge(1.0_wp)) ev%broken = .true.
  end subroutine evaluate

  !> The same at a state of motion.
  subroutine evaluate_motion(self, ev, at)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    type(motion_state), intent(in) :: at
    call evaluate(self, ev, at%options, at%t, at%q, at%v, at%z, at%zd)
  end subroutine evaluate_motion

  !> The same at t = 0 as the deck has it, internal variables at zero; at rest, if no velocities are given.
  subroutine evaluate_start(self, ev, q, v)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in), contiguous :: q(:)            !! (nq) [m, rad]
    real(wp), intent(in), contiguous, optional :: v(:)  !! (nq) [m/s, rad/s]
    real(wp) :: rest(size(q)), z(self%s%nz)             ! [m/s, rad/s], [m, rad]
    rest = 0.0_wp
    if (present(v)) rest = v
    z = 0.0_wp
    call evaluate(self, ev, usual_options(self%s), 0.0_wp, q, rest, z, z)
  end subroutine evaluate_start

  !> Multipliers from S lambda = Phi_q a_free + (second derivative at zero acceleration), with Baumgarte terms (1972) if asked:
  !> 2 alpha Phi' + beta^2 Phi.
  subroutine multiplier_forces(self, ev, baumgarte)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in) :: baumgarte(2)    !! alpha, beta [1/s]
    if (self%s%rows == 0) return
    call joint_accelerations(self, ev)
    if (any(baumgarte > 0.0_wp)) then
      call row_rates(self, ev, ev%schur%r)
      ev%lambda = ev%lambda + 2*baumgarte(1)*ev%schur%r + baumgarte(2)**2*ev%rows%phi
    end if
    if (allocated(ev%rows%off)) then
      call slip_multipliers(self, ev)
    else
      call ev%schur%solve(ev%lambda)
    end if
  end subroutine multiplier_forces

  !> Adds what the drives do to the power.
  pure subroutine drive_powers(self, ev, lambda)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in) :: lambda(:)       !! (rows) [N]
    integer :: k, i
    do k = self%s%joints + 1, self%s%permanent
      associate (c => self%s%constraints(k)%item)
        i = c%first
        ev%input_power = ev%input_power + lambda(i)*ev%rows%phi_t(i)
      end associate
    end do
  end subroutine drive_powers
end module dynamics
