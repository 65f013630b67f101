!> The bodies' part of the linearisation (see `linearisation` for the equations and unknowns): mass, damping and stiffness are the
!> tangent of `body_tangents` with unit coefficients, in frozen axes. Here a frame's displacement is in its turning axes,
!> dR'' = A (eta'' + 2 theta' H eta' + (theta'' H - theta'^2) eta), which adds columns of eta.
module linear_bodies
  use kinds, only: wp
  use body, only: body_model, elastic_work
  use body_terms, only: body_equations
  use linear_matrices, only: linear_mechanism, count_segments
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  use triplets, only: triplet_matrix
  implicit none (type, external)
  private
  public :: add_tangent, add_turning, elastic_matrices

  real(wp), parameter :: h(2, 2) = reshape([0.0_wp, 1.0_wp, -1.0_wp, 0.0_wp], [2, 2])     !! the unit turn, of a quarter [-]
  real(wp), parameter :: one(2, 2) = reshape([1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp], [2, 2])    !! the unit matrix [-]

contains

  !> Adds one body's tangent to a matrix: the frame, and what couples it and the elastic coordinates.
  subroutine add_tangent(t, body, i, a2, matrix)
    type(body_equations), intent(in) :: t
    type(body_model), intent(in) :: body
    integer, intent(in) :: i                             !! unknowns before
    real(wp), intent(in) :: a2                           !! the tangent's share of the mass: 0 or 1 [-]
    type(triplet_matrix), intent(inout) :: matrix
    integer :: x(3 + body%nf), k                         ! the body's unknowns
    x = [(i + k, k=1, size(x))]
    call matrix%add_block(x(1:3), x(1:3), t%block)
    if (.not. body%flexible) return
    call matrix%add_block(x(1:2), x(4:), matmul(t%origin(1)*one + t%origin(2)*h, transpose(body%shape%sbar)))
    call matrix%add_block(x(4:), x(1:2), a2*body%shape%sbar)
    call matrix%add_block(x(4:), x(3:3), reshape(t%column(1:), [body%nf, 1]))
    call matrix%add_block(x(3:3), x(4:), reshape(t%row(1:), [1, body%nf]))
  end subroutine add_tangent

  !> Adds the terms of frames' displacements in turning axes, and the elastic coordinates' own block.
  subroutine add_turning(m, ev, b, q, v, a, lin)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: b
    real(wp), intent(in), contiguous :: q(:), v(:), a(:) !! (nq) positions, velocities, accelerations [m, rad] and per second
    type(linear_mechanism), intent(inout) :: lin
    real(wp), allocatable :: origin(:, :)                ! columns of the origin in the mass
    integer, allocatable :: x(:)                         ! the body's unknowns
    integer :: k, i, n
    i = m%s%qo(b)
    associate (body => m%s%bodies(b))
      n = 3 + body%nf
      x = [(i + k, k=1, n)]
      allocate (origin(n, 2))
      origin(1:2, :) = body%mass*one
      origin(3, :) = [-ev%frame%first_moment(2, b), ev%frame%first_moment(1, b)]
      if (body%flexible) origin(4:, :) = body%shape%sbar
      call lin%damping%add_block(x, x(1:2), 2*v(i + 3)*matmul(origin, h))
      call lin%stiffness%add_block(x, x(1:2), matmul(origin, a(i + 3)*h - v(i + 3)**2*one))
      if (body%flexible) call elastic_block(body, b, ev%elastic(b), i + 3, v(i + 3), a(i + 3), q(i + 4:i + n), lin)
    end associate
  end subroutine add_turning

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
end module linear_bodies
