!> The bodies' part of the linearisation (see `linearisation` for the equations and unknowns): the frames' inertia with what
!> present velocities and accelerations add, and what couples frames and elastic coordinates.
module linear_bodies
  use kinds, only: wp
  use body, only: body_model
  use elastic_blocks, only: elastic_products, modal_block, nodal_block
  use linear_matrices, only: linear_mechanism
  use mechanism, only: mechanism_model
  use place, only: turn
  implicit none (type, external)
  private
  public :: body_terms

  real(wp), parameter :: h(2, 2) = reshape([0.0_wp, 1.0_wp, -1.0_wp, 0.0_wp], [2, 2])     !! a quarter turn [-]
  real(wp), parameter :: one(2, 2) = reshape([1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp], [2, 2])    !! [-]

  !> The state of one body as the blocks need it, body axes (theory.md, sections 2 and 3).
  type :: body_motion
    real(wp) :: thetad = 0.0_wp              !! [rad/s]
    real(wp) :: thetadd = 0.0_wp             !! [rad/s2]
    real(wp) :: acc(2) = 0.0_wp              !! acceleration of the frame's origin less gravity [m/s2]
    real(wp) :: p(2) = 0.0_wp                !! I1 + S-bar q [kg m]
    real(wp) :: sv(2) = 0.0_wp               !! S-bar q' [kg m/s]
    real(wp) :: sa(2) = 0.0_wp               !! S-bar q'' [kg m/s2]
    real(wp) :: mtt = 0.0_wp                 !! m_theta_theta [kg m2]
    real(wp) :: mttd = 0.0_wp                !! its rate [kg m2/s]
    real(wp), allocatable :: sb(:, :)        !! (2, nf) S-bar [kg]
    real(wp), allocatable :: mq(:), mv(:), ma(:)   !! (nf) m q, m q', m q'', translational part
    real(wp), allocatable :: zq(:), zv(:), za(:)   !! (nf) Z q, Z q', Z q''
  end type body_motion

contains

  !> Inertia and elasticity of one body.
  subroutine body_terms(m, b, q, v, lin)
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: b
    real(wp), intent(in) :: q(:), v(:)       !! (nq) positions and velocities
    type(linear_mechanism), intent(inout) :: lin
    type(body_motion) :: x
    integer, allocatable :: f(:)             !! unknowns of the elastic coordinates
    integer :: k, t
    t = m%s%qo(b) + 3
    associate (bo => m%s%bodies(b))
      f = [(t + k, k=1, bo%nf)]
      call take_motion(m, b, q, v, f, x)
      call frame_block(bo%mass, x, [t - 2, t - 1], t, lin)
      if (.not. bo%flexible) return
      call coupling_block(bo, x, [t - 2, t - 1], t, f, lin)
      if (bo%modal) then
        call modal_block(bo, b, f, x%thetad, x%thetadd, lin)
      else
        call nodal_block(bo, b, t, x%thetad, x%thetadd, q(f), lin)
      end if
    end associate
  end subroutine body_terms

  !> Rates, accelerations and the integrals that depend on the elastic coordinates, from the last evaluation.
  subroutine take_motion(m, b, q, v, f, x)
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: b
    real(wp), intent(in) :: q(:), v(:)       !! (nq)
    integer, intent(in) :: f(:)              !! (nf) unknowns of the elastic coordinates
    type(body_motion), intent(out) :: x
    real(wp) :: acc(2)
    integer :: i
    i = m%s%qo(b)
    x%thetad = v(i + 3)
    x%thetadd = m%a(i + 3)
    acc = m%a(i + 1:i + 2) - m%s%gravity
    x%acc = [m%c(b)*acc(1) + m%sn(b)*acc(2), m%c(b)*acc(2) - m%sn(b)*acc(1)]
    associate (bo => m%s%bodies(b))
      x%p = bo%i1
      x%mtt = bo%i11
      if (.not. bo%flexible) return
      x%sb = transpose(bo%sbar)
      x%p = x%p + matmul(x%sb, q(f))
      x%sv = matmul(x%sb, v(f))
      x%sa = matmul(x%sb, m%a(f))
      call elastic_products(bo, q(f), x%mq, x%zq)
      call elastic_products(bo, v(f), x%mv, x%zv)
      call elastic_products(bo, m%a(f), x%ma, x%za)
      x%mtt = x%mtt + 2*dot_product(bo%i1f, q(f)) + dot_product(q(f), x%mq)
      x%mttd = 2*(dot_product(bo%i1f, v(f)) + dot_product(q(f), x%mv))
    end associate
  end subroutine take_motion

  !> The frame's own 3 x 3 block.
  subroutine frame_block(mass, x, r, t, lin)
    real(wp), intent(in) :: mass             !! [kg]
    type(body_motion), intent(in) :: x
    integer, intent(in) :: r(2), t           !! unknowns of the frame's position and angle
    type(linear_mechanism), intent(inout) :: lin
    real(wp) :: c(2)                         ! p'' seen from the frame: Euler, centrifugal, Coriolis and elastic parts
    c = x%thetadd*turn(x%p) - x%thetad**2*x%p + 2*x%thetad*turn(x%sv) + x%sa
    call lin%mass%add_block(r, r, mass*one)
    call lin%mass%add_block(r, [t], reshape(turn(x%p), [2, 1]))
    call lin%mass%add_block([t], r, reshape(turn(x%p), [1, 2]))
    call lin%mass%add(t, t, x%mtt)
    call lin%damping%add_block(r, r, 2*x%thetad*mass*h)
    call lin%damping%add_block(r, [t], reshape(-2*x%thetad*x%p + 2*turn(x%sv), [2, 1]))
    call lin%damping%add_block([t], r, reshape(2*x%thetad*x%p, [1, 2]))
    call lin%damping%add(t, t, x%mttd)
    call lin%stiffness%add_block(r, r, mass*(x%thetadd*h - x%thetad**2*one))
    call lin%stiffness%add_block(r, [t], reshape(turn(c), [2, 1]))
    call lin%stiffness%add_block([t], r, reshape(x%thetadd*x%p - x%thetad**2*turn(x%p), [1, 2]))
    call lin%stiffness%add(t, t, -dot_product(x%p, x%acc))
  end subroutine frame_block

  !> What couples the frame and the elastic coordinates.
  subroutine coupling_block(bo, x, r, t, f, lin)
    type(body_model), intent(in) :: bo
    type(body_motion), intent(in) :: x
    integer, intent(in) :: r(2), t           !! unknowns of the frame's position and angle
    integer, intent(in) :: f(:)              !! (nf) of the elastic coordinates
    type(linear_mechanism), intent(inout) :: lin
    real(wp) :: hs(2, size(f)), bs(size(f), 2), row(1, size(f)), col(size(f), 1)
    hs = matmul(h, x%sb)
    bs = transpose(x%sb)
    call lin%mass%add_block(r, f, x%sb)
    call lin%mass%add_block(f, r, bs)
    row(1, :) = bo%c0 - x%zq
    call lin%mass%add_block([t], f, row)
    call lin%mass%add_block(f, [t], transpose(row))
    call lin%damping%add_block(r, f, 2*x%thetad*hs)
    call lin%damping%add_block(f, r, 2*x%thetad*matmul(bs, h))
    row(1, :) = 2*x%thetad*(bo%i1f + x%mq)
    call lin%damping%add_block([t], f, row)
    col(:, 1) = -2*x%thetad*(bo%i1f + x%mq) - 2*x%zv
    call lin%damping%add_block(f, [t], col)
    call lin%stiffness%add_block(r, f, x%thetadd*hs - x%thetad**2*x%sb)
    call lin%stiffness%add_block(f, r, matmul(bs, x%thetadd*h - x%thetad**2*one))
    row(1, :) = matmul(x%acc, hs) + 2*x%thetadd*(bo%i1f + x%mq) + 2*x%thetad*x%mv + x%za
    call lin%stiffness%add_block([t], f, row)
    col(:, 1) = matmul(transpose(hs), x%acc)
    call lin%stiffness%add_block(f, [t], col)
  end subroutine coupling_block
end module linear_bodies
