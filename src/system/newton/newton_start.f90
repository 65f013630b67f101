!> Accelerations with which an implicit method starts, by its dynamic stiffness. The rows with their derivatives, by which it
!> corrects rates, and that correction by the mass alone.
module newton_start
  use kinds, only: wp
  use body_condensation, only: condense_masses
  use border_rows, only: regularise_weak_rows, light_shift, least_shift
  use dynamics, only: apply_multipliers, marker_kinematics, condense_constraints, constraint_values, row_rates
  use evaluation_settings, only: evaluation_options
  use evaluation_results, only: evaluation
  use joint_system, only: add_row_motion, velocity_terms
  use mechanism, only: mechanism_model
  use newton_correction, only: correction
  use newton_equations, only: residual, renew
  use newton_system, only: newton_matrix
  use switched_rows, only: leave_open
  implicit none (type, external)
  private
  public :: smooth_accelerations, row_gaps, row_correction_by_mass

contains

  !> Accelerations that the step resolves: (c1 M + tangent) x = c1 M a within the constraints. A vibration much faster than the
  !> step, which a sudden load or an undeformed start would excite, starts in its equilibrium; slower motion keeps a to second
  !> order.
  subroutine smooth_accelerations(self, m, ev, options, t, q, v, lambda, a, bad)
    type(newton_matrix), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(evaluation_options), intent(in) :: options
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in), contiguous :: q(:), v(:), lambda(:)   !! (nq), (rows) [m, rad], rates, [N]
    real(wp), intent(inout), contiguous :: a(:)                 !! (nq) [m/s2, rad/s2]
    logical, intent(out) :: bad               !! no tangent
    real(wp) :: x(size(a)), none(size(a))
    integer :: b
    none = 0.0_wp
    call residual(self, m, ev, options, t, q, v, a, lambda)
    do b = 1, size(self%eq)
      associate (t => self%t%b(b), eq => self%eq(b))
        t%force = eq%frame
        if (t%n > 0) t%elastic = eq%elastic(1:t%n)
      end associate
    end do
    call residual(self, m, ev, options, t, q, v, none, lambda)
    do b = 1, size(self%eq)                    ! the difference of both is M a
      associate (t => self%t%b(b), eq => self%eq(b))
        t%force = self%t%c1*(eq%frame - t%force)
        if (t%n > 0) t%elastic = self%t%c1*(eq%elastic(1:t%n) - t%elastic)
      end associate
    end do
    call renew(self, m, ev, q, v, none, lambda, .false., merge(light_shift, least_shift, m%redundant), bad)
    if (bad) return
    call regularise_weak_rows(self%t%rows)
    ev%schur%r = 0.0_wp
    call add_row_motion(m, ev, a, ev%schur%r)      ! rows of x as those of a
    call leave_open(ev, ev%schur%r)
    ev%schur%r = -ev%schur%r
    call correction(self%t, m, ev, ev%schur%r, x)
    bad = .not. all(abs(x) < huge(1.0_wp))
    if (.not. bad) a = x
  end subroutine smooth_accelerations

  !> All rows, their first and second derivatives and, where there is room, their rates by u alone.
  subroutine row_gaps(m, ev, t, q, v, a, u, gap)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in), contiguous :: q(:), v(:), a(:), u(:)   !! (nq) [m, rad], rates, accelerations, [any]
    real(wp), intent(out), contiguous :: gap(:, 0:)          !! (rows, 0:2 or 0:3) [m], [m/s], [m/s2], [any]
    integer :: k
    call marker_kinematics(m, ev, q, v)
    call constraint_values(m, ev, ev%options, t)
    gap(:, 0) = ev%rows%phi
    call row_rates(m, ev, gap(:, 1))
    call velocity_terms(m, ev, ev%schur%r)
    call marker_kinematics(m, ev, q, a)            ! in the loops of all markers: one by one they cost a tenth of a step
    call row_rates(m, ev, gap(:, 2))
    gap(:, 2) = gap(:, 2) + ev%schur%r - ev%rows%phi_t
    if (ubound(gap, 2) == 3) then
      call marker_kinematics(m, ev, q, u)
      call row_rates(m, ev, gap(:, 3))
      gap(:, 3) = gap(:, 3) - ev%rows%phi_t
    end if
    do k = 2, ubound(gap, 2)
      call leave_open(ev, gap(:, k))
    end do
  end subroutine row_gaps

  !> Closes gaps by the mass alone, M dq + Phi_q^T dlambda/c1 = 0, with the rows' gradients of the last evaluation; not where rows
  !> are off or depend on others.
  subroutine row_correction_by_mass(m, ev, c1, q, gap, dq, dlambda, ok)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev        !! with the frames of q
    real(wp), intent(in) :: c1                   !! [1/s2]
    real(wp), intent(in), contiguous :: q(:)     !! (nq) [m, rad]
    real(wp), intent(in), contiguous :: gap(:, :)        !! (rows, columns) [m] and its derivatives
    real(wp), intent(out), contiguous :: dq(:, :)        !! (nq, columns) [m, rad] and theirs
    real(wp), intent(out), contiguous :: dlambda(:, :)   !! (rows, columns) [N] and theirs
    logical, intent(out) :: ok
    integer :: k
    ok = .true.
    if (allocated(ev%rows%off)) ok = .not. any(ev%rows%off)
    if (.not. ok) return
    call condense_masses(m, ev, q)
    call condense_constraints(m, ev, .false.)
    call ev%schur%factor_strong(ok)
    if (.not. ok) return
    dlambda = gap
    do k = 1, size(gap, 2)
      call ev%schur%solve(dlambda(:, k))
      call apply_multipliers(m, ev, dlambda(:, k), dq(:, k))
    end do
    dlambda = c1*dlambda
  end subroutine row_correction_by_mass
end module newton_start
