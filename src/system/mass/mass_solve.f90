!> Solves with the mass matrix by the factors of the last evaluation (`dynamics`), with or without joints. Unknowns as the
!> coordinates, the frames' in body axes.
module mass_solve
  use kinds, only: wp
  use joint_response, only: apply_multipliers, solve_frame
  use evaluation_results, only: evaluation
  use frame_axes, only: turn_to_body
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: solve_mass, solve_body, remove_joint_forces

contains

  !> u = M^-1 (r - Phi^T lambda) with the factors of the last evaluation; lambda = 0 without joints.
  subroutine solve_mass(m, ev, with_joints, r, u)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    logical, intent(in) :: with_joints         !! joints and drives act
    real(wp), intent(in), contiguous :: r(:)   !! (n) forces [N], moments [N m]
    real(wp), intent(out), contiguous :: u(:)  !! (n) accelerations [m/s2], [rad/s2]
    integer :: b, e
    do b = 1, size(m%s%bodies)
      associate (i => m%s%qo(b), n => 3 + m%s%bodies(b)%nf)
        call solve_body(m, ev, b, r(i + 1:i + n), u(i + 1:i + n))
      end associate
    end do
    if (.not. with_joints .or. m%s%rows == 0) return
    associate (mu => ev%lambda_change, x => ev%change)
      mu = 0.0_wp
      do b = 1, size(m%s%bodies)
        do e = m%incidence%first(b), m%incidence%first(b + 1) - 1
          associate (row => m%incidence%row(e), k => m%incidence%marker(e), i => m%s%qo(b))
            mu(row) = mu(row) + dot_product(ev%side%w(:, e), m%s%markers(k)%displacement(ev%p%rho(:, k), u(i + 1:i + 3), &
                                                                                         u(i + 4:i + 3 + m%s%bodies(b)%nf)))
          end associate
        end do
      end do
      if (allocated(ev%rows%off)) then
        where (ev%rows%off) mu = 0.0_wp
      end if
      call ev%schur%solve(mu)
      call apply_multipliers(m, ev, mu, x)
      call turn_to_body(m, ev, x)
      u = u + x
    end associate
  end subroutine solve_mass

  !> r - Phi^T lambda = M u of the last solve with joints: what of a force moves the mechanism. Iterations that keep the rest let it
  !> grow until its rounding moves the joints.
  subroutine remove_joint_forces(m, ev, r)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(inout) :: r(:)            !! (n) forces [N], moments [N m]
    integer :: b, e
    if (m%s%rows == 0) return
    do b = 1, size(m%s%bodies)
      do e = m%incidence%first(b), m%incidence%first(b + 1) - 1
        associate (k => m%incidence%marker(e), i => m%s%qo(b), n => 3 + m%s%bodies(b)%nf)
          call m%s%markers(k)%add_wrench(ev%p%rho(:, k), -ev%lambda_change(m%incidence%row(e))*ev%side%w(:, e), r(i + 1:i + 3), &
                                         r(i + 4:i + n))
        end associate
      end do
    end do
  end subroutine remove_joint_forces

  !> u = M^-1 r of one body without joints: elastic coordinates are condensed onto the frame, then the frame is solved, then the
  !> elastic coordinates.
  subroutine solve_body(m, ev, b, r, u)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    integer, intent(in) :: b                   !! body
    real(wp), intent(in) :: r(:)               !! (3+nf) forces [N], moments [N m]
    real(wp), intent(out) :: u(:)              !! (3+nf) accelerations [m/s2], [rad/s2]
    real(wp) :: x(3)
    integer :: n, k
    associate (body => m%s%bodies(b), coupling => ev%elastic(b)%coupling, shape => m%s%bodies(b)%shape)
      n = body%nf
      x = r(1:3)
      if (body%flexible) then
        u(4:) = r(4:)
        do k = 1, n
          x(1:2) = x(1:2) - shape%pmat(k, :)*u(3 + k)
          x(3) = x(3) - coupling(k)*u(3 + k)
        end do
        call body%basis%solve_mass(n, ev%work, u(4:))
      end if
      call solve_frame(ev%frame%l(:, b), ev%frame%dinv(:, b), x(1), x(2), x(3))
      u(1:3) = x
      do k = 1, n
        u(3 + k) = u(3 + k) - shape%pmat(k, 1)*x(1) - shape%pmat(k, 2)*x(2) - coupling(k)*x(3)
      end do
    end associate
  end subroutine solve_body
end module mass_solve
