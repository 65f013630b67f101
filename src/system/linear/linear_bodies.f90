!> The bodies' part of the linearisation (see `linearisation` for the equations and unknowns): mass, damping and stiffness are the
!> tangent of `body_terms` with unit coefficients, in frozen axes. Here a frame's displacement keeps to its turning axes,
!> dR'' = A (eta'' + 2 theta' H eta' + (theta'' H - theta'^2) eta), which adds columns of eta.
module linear_bodies
  use kinds, only: wp
  use body_terms, only: body_equations, body_tangent, set_up_terms
  use elastic_blocks, only: elastic_block
  use linear_matrices, only: linear_mechanism
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  use triplets, only: triplet_matrix
  implicit none (type, external)
  private
  public :: linear_body

  real(wp), parameter :: h(2, 2) = reshape([0.0_wp, 1.0_wp, -1.0_wp, 0.0_wp], [2, 2])     !! a quarter turn [-]
  real(wp), parameter :: one(2, 2) = reshape([1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp], [2, 2])    !! [-]

contains

  !> Inertia and elasticity of one body, about the state of the last evaluation.
  subroutine linear_body(m, ev, b, q, v, a, lin)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: b
    real(wp), intent(in), contiguous :: q(:), v(:), a(:) !! (nq) positions, velocities, accelerations [m, rad] and per second
    type(linear_mechanism), intent(inout) :: lin
    type(body_equations) :: t
    real(wp), allocatable :: origin(:, :)                ! columns of the origin in the mass
    integer, allocatable :: x(:)                         ! the body's unknowns
    real(wp) :: acc(2)
    integer :: k, i, n
    i = m%s%qo(b)
    acc = a(i + 1:i + 2) - ev%options%gravity
    acc = [ev%frame%cos(b)*acc(1) + ev%frame%sin(b)*acc(2), ev%frame%cos(b)*acc(2) - ev%frame%sin(b)*acc(1)]
    associate (body => m%s%bodies(b))
      n = 3 + body%nf
      x = [(i + k, k=1, n)]
      call set_up_terms(t, body)
      call tangent(1.0_wp, 0.0_wp, 0.0_wp, lin%mass)
      call tangent(0.0_wp, 1.0_wp, 0.0_wp, lin%damping)
      call tangent(0.0_wp, 0.0_wp, 1.0_wp, lin%stiffness)
      allocate (origin(n, 2))
      origin(1:2, :) = body%mass*one
      origin(3, :) = [-ev%frame%first_moment(2, b), ev%frame%first_moment(1, b)]
      if (body%flexible) origin(4:, :) = body%shape%sbar
      call lin%damping%add_block(x, x(1:2), 2*v(i + 3)*matmul(origin, h))
      call lin%stiffness%add_block(x, x(1:2), matmul(origin, a(i + 3)*h - v(i + 3)**2*one))
      if (body%flexible) call elastic_block(body, b, ev%elastic(b), i + 3, v(i + 3), a(i + 3), q(i + 4:i + n), lin)
    end associate
  contains
    !> Adds one of the matrices: the frame, and what couples it and the elastic coordinates.
    subroutine tangent(a2, a1, a0, matrix)
      real(wp), intent(in) :: a2, a1, a0                 !! one of them 1 [-]
      type(triplet_matrix), intent(inout) :: matrix
      associate (body => m%s%bodies(b))
        call body_tangent(t, body, a2, a1, a0, q(i + 1:i + n), v(i + 1:i + n), a(i + 1:i + n), acc)
        call matrix%add_block(x(1:3), x(1:3), t%block)
        if (.not. body%flexible) return
        call matrix%add_block(x(1:2), x(4:), matmul(t%origin(1)*one + t%origin(2)*h, transpose(body%shape%sbar)))
        call matrix%add_block(x(4:), x(1:2), a2*body%shape%sbar)
        call matrix%add_block(x(4:), x(3:3), reshape(t%column(1:), [n - 3, 1]))
        call matrix%add_block(x(3:3), x(4:), reshape(t%row(1:), [1, n - 3]))
      end associate
    end subroutine tangent
  end subroutine linear_body
end module linear_bodies
