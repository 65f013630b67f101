!> The bodies' part of the linearisation (see `linearisation` for the equations and unknowns): mass, damping and stiffness are the
!> tangent of `body_tangents` with unit coefficients, in frozen axes. Here a frame's displacement keeps to its turning axes,
!> dR'' = A (eta'' + 2 theta' H eta' + (theta'' H - theta'^2) eta), which adds columns of eta.
module linear_bodies
  use kinds, only: wp
  use body, only: body_model
  use body_terms, only: body_equations
  use elastic_blocks, only: elastic_block
  use linear_matrices, only: linear_mechanism
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  use triplets, only: triplet_matrix
  implicit none (type, external)
  private
  public :: add_tangent, add_turning

  real(wp), parameter :: h(2, 2) = reshape([0.0_wp, 1.0_wp, -1.0_wp, 0.0_wp], [2, 2])     !! a quarter turn [-]
  real(wp), parameter :: one(2, 2) = reshape([1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp], [2, 2])    !! [-]

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

  !> Adds what frames' displacements in turning axes ask for, and the elastic coordinates' own block.
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
end module linear_bodies
