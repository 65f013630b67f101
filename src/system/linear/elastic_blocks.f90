!> The elastic coordinates' part of the linearisation, nodal or modal: inertia with what present velocities and accelerations
!> add, stiffness, Rayleigh damping, and the stiffness that GHM terms multiply.
module elastic_blocks
  use kinds, only: wp
  use beam_element, only: element_mass, element_gyroscopic, element_stiffness, stiffening_tangent
  use body, only: body_model
  use linear_matrices, only: linear_mechanism, count_segments
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: elastic_matrices, modal_block, nodal_block

contains

  !> Elastic matrices of the bodies alone, at rest in their present deformation: stiffness, damping, GHM segments (those of
  !> springs stay empty).
  subroutine elastic_matrices(m, q, lin)
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in) :: q(:)             !! (nq) positions [m, rad]
    type(linear_mechanism), intent(out) :: lin
    integer :: b, k
    lin%n = m%s%nq
    lin%rows = m%s%rows
    call count_segments(m, lin)
    do b = 1, size(m%s%bodies)
      associate (body => m%s%bodies(b), t => m%s%qo(b) + 3)
        if (.not. body%flexible) cycle
        if (body%modal) then
          call modal_block(body, b, [(t + k, k=1, body%nf)], 0.0_wp, 0.0_wp, lin)
        else
          call nodal_block(body, b, t, 0.0_wp, 0.0_wp, q(t + 1:t + body%nf), lin)
        end if
      end associate
    end do
  end subroutine elastic_matrices

  !> Elastic block of a modal body.
  subroutine modal_block(body, b, f, thetad, thetadd, lin)
    type(body_model), intent(in) :: body
    integer, intent(in) :: b, f(:)
    real(wp), intent(in) :: thetad, thetadd   !! rate and acceleration of the frame angle [rad/s], [rad/s2]
    type(linear_mechanism), intent(inout) :: lin
    real(wp) :: one(body%nf, body%nf), k(body%nf, body%nf)
    integer :: i, r
    one = 0.0_wp
    k = 0.0_wp
    do i = 1, body%nf
      one(i, i) = 1.0_wp
      k(i, i) = body%omega2(i)
    end do
    call lin%mass%add_block(f, f, one)
    call lin%damping%add_block(f, f, body%cmodal - 2*thetad*body%zmodal)
    call lin%stiffness%add_block(f, f, k - thetad**2*(one - body%jmodal) - thetadd*body%zmodal)
    do r = 1, size(body%segments)
      call lin%segments(lin%before(b) + r)%stiffness%add_block(f, f, body%segments(r)%stiffness)
    end do
  end subroutine modal_block

  !> Elastic block of a nodal body, element by element.
  subroutine nodal_block(body, b, t, thetad, thetadd, qf, lin)
    type(body_model), intent(in) :: body
    integer, intent(in) :: b, t
    real(wp), intent(in) :: thetad, thetadd, qf(:)   !! of the frame angle [rad/s], [rad/s2]; elastic coordinates [m, rad]
    type(linear_mechanism), intent(inout) :: lin
    real(wp) :: mass(6, 6), z(6, 6), k(6, 6), g(6, 6)
    integer :: e, d(6), l, i, j, r
    r = 1
    do e = 1, body%ne
      d = merge(t + body%edof(:, e), 0, body%edof(:, e) > 0)
      mass = element_mass(body%elements(e))
      z = element_gyroscopic(body%elements(e))
      call tangent(body, e, qf, k, g)
      call lin%mass%add_block(d, d, mass)
      call lin%damping%add_block(d, d, body%elements(e)%ray_m*mass + body%elements(e)%ray_k*element_stiffness(body%elements(e)) &
                                 - 2*thetad*z)
      call lin%stiffness%add_block(d, d, k + g - thetad**2*mass - thetadd*z)
      if (r > size(body%segments)) cycle
      if (e >= body%segments(r)%first) call lin%segments(lin%before(b) + r)%stiffness%add_block(d, d, k)
      if (e == body%segments(r)%last) r = r + 1
    end do
    do l = 1, size(body%lumps)
      d(1:3) = merge(t + body%dof(:, body%lumps(l)%node), 0, body%dof(:, body%lumps(l)%node) > 0)
      i = d(1)
      j = d(2)
      associate (mu => body%lumps(l)%mass)
        call lin%mass%add(i, i, mu)
        call lin%mass%add(j, j, mu)
        call lin%mass%add(d(3), d(3), body%lumps(l)%inertia)
        call lin%damping%add(i, j, -2*thetad*mu)
        call lin%damping%add(j, i, 2*thetad*mu)
        call lin%stiffness%add(i, i, -thetad**2*mu)
        call lin%stiffness%add(j, j, -thetad**2*mu)
        call lin%stiffness%add(i, j, -thetadd*mu)
        call lin%stiffness%add(j, i, thetadd*mu)
      end associate
    end do
  end subroutine nodal_block

  !> Tangent stiffness of an element: B^T D B at the present deformation (k) and the geometric part of stiffening (g).
  subroutine tangent(body, e, qf, k, g)
    type(body_model), intent(in) :: body
    integer, intent(in) :: e
    real(wp), intent(in) :: qf(:)            !! (nf) [m, rad]
    real(wp), intent(out) :: k(6, 6), g(6, 6)   !! [N/m, N, N m]
    real(wp) :: n, x(0:size(qf))
    if (.not. body%stiffening) then
      k = element_stiffness(body%elements(e))
      g = 0.0_wp
      return
    end if
    x(0) = 0.0_wp
    x(1:) = qf
    n = body%elements(e)%ea_l*merge(body%ds(1, e), body%d(1, e), size(body%segments) > 0)
    call stiffening_tangent(body%elements(e), x(body%edof(:, e)), n, k, g)
  end subroutine tangent
end module elastic_blocks
