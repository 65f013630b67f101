!> The elastic coordinates' part of the linearisation: inertia with what present velocities and accelerations add, stiffness,
!> Rayleigh damping, and the stiffness that viscoelastic terms multiply.
module elastic_blocks
  use kinds, only: wp
  use body, only: body_model, elastic_work
  use linear_matrices, only: linear_mechanism, count_segments
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: elastic_matrices, elastic_block

contains

  !> Elastic matrices of the bodies alone, at rest in the deformation of the last evaluation: stiffness, damping, segments (those
  !> of springs stay empty).
  subroutine elastic_matrices(m, ev, q, lin)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: q(:)             !! (nq) positions [m, rad]
    type(linear_mechanism), intent(out) :: lin
    integer :: b
    lin%n = m%s%nq
    lin%rows = m%s%rows
    call count_segments(m, lin)
    do b = 1, size(m%s%bodies)
      associate (body => m%s%bodies(b), t => m%s%qo(b) + 3)
        if (body%flexible) call elastic_block(body, b, ev%elastic(b), t, 0.0_wp, 0.0_wp, q(t + 1:t + body%nf), lin)
      end associate
    end do
  end subroutine elastic_matrices

  !> Elastic block of a body.
  subroutine elastic_block(body, b, w, t, thetad, thetadd, qf, lin)
    type(body_model), intent(in) :: body
    integer, intent(in) :: b
    type(elastic_work), intent(in) :: w      !! of the last evaluation
    integer, intent(in) :: t                 !! unknowns before
    real(wp), intent(in) :: thetad, thetadd  !! of the frame angle [rad/s], [rad/s2]
    real(wp), intent(in) :: qf(:)            !! (nf) elastic coordinates [m, rad]
    type(linear_mechanism), intent(inout) :: lin
    integer :: k
    associate (segments => lin%segments(lin%before(b) + 1:lin%before(b) + size(body%segments)), op => body%op)
      call body%basis%add_stiffness(body, t, qf, w, lin%stiffness, segments%stiffness)
      do k = 1, size(op%m)                   ! a pattern's column is the row's number in the operators
        associate (i => t + op%symmetric%col(k), j => t + op%symmetric%row(k))
          call lin%mass%add(i, j, op%m(k) + op%j(k))
          call lin%damping%add(i, j, op%c(k))
          call lin%stiffness%add(i, j, -thetad**2*op%m(k))
        end associate
      end do
      do k = 1, size(op%z)
        associate (i => t + op%skew%col(k), j => t + op%skew%row(k))
          call lin%damping%add(i, j, -2*thetad*op%z(k))
          call lin%stiffness%add(i, j, -thetadd*op%z(k))
        end associate
      end do
    end associate
  end subroutine elastic_block
end module elastic_blocks
