!> The bodies' part of the linearisation (see `linearisation` for the equations and unknowns): inertia with what present
!> velocities and accelerations add, elasticity, damping, and the stiffness that GHM terms multiply.
module linear_bodies
  use kinds, only: wp
  use small_matrices, only: outer
  use beam_element, only: element_mass, element_gyroscopic, element_stiffness, deformation_matrix, element_rotation
  use body, only: body_model
  use mechanism, only: mechanism_model
  use place, only: turn
  use triplets, only: triplet_matrix
  implicit none (type, external)
  private
  public :: linear_mechanism, linear_run, count_runs, body_terms, elastic_matrices

  !> Stiffness that one set of GHM terms multiplies.
  type :: linear_run
    integer :: body = 0                      !! body, or
    integer :: spring = 0                    !! spring
    integer :: material = 0                  !! material (bodies)
    real(wp), allocatable :: alpha(:)        !! [-]
    real(wp), allocatable :: zeta(:)         !! [-]
    real(wp), allocatable :: omega(:)        !! [rad/s]
    type(triplet_matrix) :: stiffness        !! K_r at E_R
  end type linear_run

  !> The linear system.
  type :: linear_mechanism
    integer :: n = 0                         !! unknowns (as many as coordinates, same offsets)
    integer :: rows = 0                      !! constraint rows
    type(triplet_matrix) :: mass, damping, stiffness   !! n x n
    type(triplet_matrix) :: jacobian         !! rows x n
    type(linear_run), allocatable :: runs(:)
  end type linear_mechanism

contains

  !> Elastic matrices of the bodies alone, at rest in their present deformation: stiffness, damping, GHM runs (those of
  !> springs stay empty).
  subroutine elastic_matrices(m, q, lin)
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in) :: q(:)             !! (nq) positions
    type(linear_mechanism), intent(out) :: lin
    integer :: b, k
    lin%n = m%s%nq
    lin%rows = m%s%rows
    call count_runs(m, lin)
    do b = 1, size(m%s%bodies)
      associate (bo => m%s%bodies(b), t => m%s%qo(b) + 3)
        if (.not. bo%flexible) cycle
        if (bo%modal) then
          call modal_block(bo, b, [(t + k, k=1, bo%nf)], 0.0_wp, 0.0_wp, lin)
        else
          call nodal_block(bo, b, t, 0.0_wp, 0.0_wp, q(t + 1:t + bo%nf), lin)
        end if
      end associate
    end do
  end subroutine elastic_matrices

  !> Runs of bodies, then of springs.
  subroutine count_runs(m, lin)
    type(mechanism_model), intent(in) :: m
    type(linear_mechanism), intent(inout) :: lin
    integer :: b, r, k, n
    n = 0
    do b = 1, size(m%s%bodies)
      n = n + size(m%s%bodies(b)%runs)
    end do
    do k = 1, size(m%s%springs)
      if (size(m%s%springs(k)%alpha) > 0) n = n + 1
    end do
    allocate (lin%runs(n))
    n = 0
    do b = 1, size(m%s%bodies)
      do r = 1, size(m%s%bodies(b)%runs)
        n = n + 1
        associate (run => m%s%bodies(b)%runs(r))
          lin%runs(n)%body = b
          lin%runs(n)%material = run%material
          lin%runs(n)%alpha = run%alpha
          lin%runs(n)%zeta = run%zeta
          lin%runs(n)%omega = run%omega
        end associate
      end do
    end do
    do k = 1, size(m%s%springs)
      if (size(m%s%springs(k)%alpha) == 0) cycle
      n = n + 1
      lin%runs(n)%spring = k
      lin%runs(n)%alpha = m%s%springs(k)%alpha
      lin%runs(n)%zeta = m%s%springs(k)%zeta
      lin%runs(n)%omega = m%s%springs(k)%omega
    end do
  end subroutine count_runs

  !> Inertia and elasticity of one body.
  subroutine body_terms(m, b, q, v, lin)
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: b
    real(wp), intent(in) :: q(:), v(:)
    type(linear_mechanism), intent(inout) :: lin
    real(wp) :: p(2), thetad, thetadd, acc(2), c(2), sv(2), sa(2), mtt, h(2, 2), one(2, 2)
    real(wp), allocatable :: mq(:), mv(:), ma(:), zq(:), zv(:), za(:), sb(:, :), hs(:, :)
    integer, allocatable :: f(:)
    integer :: i, k, r(2), t
    h = reshape([0.0_wp, 1.0_wp, -1.0_wp, 0.0_wp], [2, 2])
    one = reshape([1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp], [2, 2])
    i = m%s%qo(b)
    r = [i + 1, i + 2]
    t = i + 3
    thetad = v(t)
    thetadd = m%a(t)
    associate (bo => m%s%bodies(b))
      acc = m%a(r) - m%s%gravity
      acc = [m%c(b)*acc(1) + m%sn(b)*acc(2), m%c(b)*acc(2) - m%sn(b)*acc(1)]
      f = [(t + k, k=1, bo%nf)]
      p = bo%i1
      sv = 0.0_wp
      sa = 0.0_wp
      mtt = bo%i11
      if (bo%flexible) then
        sb = transpose(bo%sbar)
        hs = matmul(h, sb)
        p = p + matmul(sb, q(f))
        sv = matmul(sb, v(f))
        sa = matmul(sb, m%a(f))
        call elastic_products(bo, q(f), mq, zq)
        call elastic_products(bo, v(f), mv, zv)
        call elastic_products(bo, m%a(f), ma, za)
        mtt = mtt + 2*dot_product(bo%i1f, q(f)) + dot_product(q(f), mq)
      end if
      c = thetadd*turn(p) - thetad**2*p + 2*thetad*turn(sv) + sa
      call lin%mass%add_block(r, r, bo%mass*one)
      call lin%mass%add_block(r, [t], reshape(turn(p), [2, 1]))
      call lin%mass%add_block([t], r, reshape(turn(p), [1, 2]))
      call lin%mass%add(t, t, mtt)
      call lin%damping%add_block(r, r, 2*thetad*bo%mass*h)
      call lin%damping%add_block(r, [t], reshape(-2*thetad*p + 2*turn(sv), [2, 1]))
      call lin%damping%add_block([t], r, reshape(2*thetad*p, [1, 2]))
      call lin%stiffness%add_block(r, r, bo%mass*(thetadd*h - thetad**2*one))
      call lin%stiffness%add_block(r, [t], reshape(turn(c), [2, 1]))
      call lin%stiffness%add_block([t], r, reshape(thetadd*p - thetad**2*turn(p), [1, 2]))
      call lin%stiffness%add(t, t, -dot_product(p, acc))
      if (.not. bo%flexible) return
      call lin%mass%add_block(r, f, sb)
      call lin%mass%add_block(f, r, transpose(sb))
      call lin%mass%add_block([t], f, reshape(bo%c0 - zq, [1, bo%nf]))
      call lin%mass%add_block(f, [t], reshape(bo%c0 - zq, [bo%nf, 1]))
      call lin%damping%add(t, t, 2*(dot_product(bo%i1f, v(f)) + dot_product(q(f), mv)))
      call lin%damping%add_block(r, f, 2*thetad*hs)
      call lin%damping%add_block(f, r, 2*thetad*matmul(transpose(sb), h))
      call lin%damping%add_block([t], f, reshape(2*thetad*(bo%i1f + mq), [1, bo%nf]))
      call lin%damping%add_block(f, [t], reshape(-2*thetad*(bo%i1f + mq) - 2*zv, [bo%nf, 1]))
      call lin%stiffness%add_block(r, f, thetadd*hs - thetad**2*sb)
      call lin%stiffness%add_block(f, r, matmul(transpose(sb), thetadd*h - thetad**2*one))
      call lin%stiffness%add_block([t], f, reshape(matmul(acc, hs) + 2*thetadd*(bo%i1f + mq) + 2*thetad*mv + za, [1, bo%nf]))
      call lin%stiffness%add_block(f, [t], reshape(matmul(transpose(hs), acc), [bo%nf, 1]))
      if (bo%modal) then
        call modal_block(bo, b, f, thetad, thetadd, lin)
      else
        call nodal_block(bo, b, t, thetad, thetadd, q(f), lin)
      end if
    end associate
  end subroutine body_terms

  !> m x (translational part) and Z x of a body.
  subroutine elastic_products(bo, x, mx, zx)
    type(body_model), intent(in) :: bo
    real(wp), intent(in) :: x(:)
    real(wp), allocatable, intent(out) :: mx(:), zx(:)
    real(wp) :: a(6), xx(0:size(x)), am(0:size(x)), az(0:size(x))
    integer :: e, k, i, j
    allocate (mx(size(x)), zx(size(x)))
    if (bo%modal) then
      mx = x - matmul(bo%jmodal, x)
      zx = matmul(bo%zmodal, x)
      return
    end if
    xx(0) = 0.0_wp
    xx(1:) = x
    am = 0.0_wp
    az = 0.0_wp
    do e = 1, bo%ne
      a = matmul(element_mass(bo%elements(e)), xx(bo%edof(:, e)))
      do k = 1, 6
        am(bo%edof(k, e)) = am(bo%edof(k, e)) + a(k)
      end do
      a = matmul(element_gyroscopic(bo%elements(e)), xx(bo%edof(:, e)))
      do k = 1, 6
        az(bo%edof(k, e)) = az(bo%edof(k, e)) + a(k)
      end do
    end do
    do k = 1, size(bo%lumps)
      i = bo%dof(1, bo%lumps(k)%node)
      j = bo%dof(2, bo%lumps(k)%node)
      am(i) = am(i) + bo%lumps(k)%mass*xx(i)
      am(j) = am(j) + bo%lumps(k)%mass*xx(j)
      az(i) = az(i) + bo%lumps(k)%mass*xx(j)
      az(j) = az(j) - bo%lumps(k)%mass*xx(i)
    end do
    mx = am(1:)
    zx = az(1:)
  end subroutine elastic_products

  !> Elastic block of a modal body.
  subroutine modal_block(bo, b, f, thetad, thetadd, lin)
    type(body_model), intent(in) :: bo
    integer, intent(in) :: b, f(:)
    real(wp), intent(in) :: thetad, thetadd
    type(linear_mechanism), intent(inout) :: lin
    real(wp) :: one(bo%nf, bo%nf), k(bo%nf, bo%nf)
    integer :: i, r
    one = 0.0_wp
    k = 0.0_wp
    do i = 1, bo%nf
      one(i, i) = 1.0_wp
      k(i, i) = bo%omega2(i)
    end do
    call lin%mass%add_block(f, f, one)
    call lin%damping%add_block(f, f, bo%cmodal - 2*thetad*bo%zmodal)
    call lin%stiffness%add_block(f, f, k - thetad**2*(one - bo%jmodal) - thetadd*bo%zmodal)
    r = 0
    do i = 1, size(lin%runs)
      if (lin%runs(i)%body /= b) cycle
      r = r + 1
      call lin%runs(i)%stiffness%add_block(f, f, bo%runs(r)%stiffness)
    end do
  end subroutine modal_block

  !> Elastic block of a nodal body, element by element.
  subroutine nodal_block(bo, b, t, thetad, thetadd, qf, lin)
    type(body_model), intent(in) :: bo
    integer, intent(in) :: b, t
    real(wp), intent(in) :: thetad, thetadd, qf(:)
    type(linear_mechanism), intent(inout) :: lin
    real(wp) :: mass(6, 6), z(6, 6), k(6, 6), g(6, 6)
    integer :: e, d(6), l, i, j, run, r
    do e = 1, bo%ne
      d = merge(t + bo%edof(:, e), 0, bo%edof(:, e) > 0)
      mass = element_mass(bo%elements(e))
      z = element_gyroscopic(bo%elements(e))
      call tangent(bo, e, qf, k, g)
      call lin%mass%add_block(d, d, mass)
      call lin%damping%add_block(d, d, bo%elements(e)%ray_m*mass + bo%elements(e)%ray_k*element_stiffness(bo%elements(e)) &
                                 - 2*thetad*z)
      call lin%stiffness%add_block(d, d, k + g - thetad**2*mass - thetadd*z)
      r = 0
      do run = 1, size(lin%runs)
        if (lin%runs(run)%body /= b) cycle
        r = r + 1
        if (e >= bo%runs(r)%first .and. e <= bo%runs(r)%last) call lin%runs(run)%stiffness%add_block(d, d, k)
      end do
    end do
    do l = 1, size(bo%lumps)
      d(1:3) = merge(t + bo%dof(:, bo%lumps(l)%node), 0, bo%dof(:, bo%lumps(l)%node) > 0)
      i = d(1)
      j = d(2)
      associate (mu => bo%lumps(l)%mass)
        call lin%mass%add(i, i, mu)
        call lin%mass%add(j, j, mu)
        call lin%mass%add(d(3), d(3), bo%lumps(l)%inertia)
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
  subroutine tangent(bo, e, qf, k, g)
    type(body_model), intent(in) :: bo
    integer, intent(in) :: e
    real(wp), intent(in) :: qf(:)
    real(wp), intent(out) :: k(6, 6), g(6, 6)
    real(wp) :: bm(3, 6), psi(6), d(3, 3), a(6), p(3), n, l, x(0:size(qf)), db(3, 6), rot(6, 6)
    if (.not. bo%stiffening) then
      k = element_stiffness(bo%elements(e))
      g = 0.0_wp
      return
    end if
    x(0) = 0.0_wp
    x(1:) = qf
    l = bo%elements(e)%length
    rot = element_rotation(bo%elements(e))
    a = x(bo%edof(:, e))
    bm = deformation_matrix(bo%elements(e))
    psi = (rot(5, :) - rot(2, :))/l
    p = [dot_product(psi, a), dot_product(bm(2, :), a), dot_product(bm(3, :), a)]
    d = 0.0_wp
    d(1, 1) = bo%elements(e)%ea_l
    d(2, 2:3) = [4.0_wp, 2.0_wp]*bo%elements(e)%ei_l
    d(3, 2:3) = [2.0_wp, 4.0_wp]*bo%elements(e)%ei_l
    if (size(bo%runs) > 0) then
      n = bo%elements(e)%ea_l*bo%ds(1, e)
    else
      n = bo%elements(e)%ea_l*bo%d(1, e)
    end if
    g = n*l*(outer(psi, psi) + (4*outer(bm(2, :), bm(2, :)) + 4*outer(bm(3, :), bm(3, :)) &
                                - outer(bm(2, :), bm(3, :)) - outer(bm(3, :), bm(2, :)))/30)
    bm(1, :) = bm(1, :) + l*(p(1)*psi + ((4*p(2) - p(3))*bm(2, :) + (4*p(3) - p(2))*bm(3, :))/30)
    db = matmul(d, bm)
    k = matmul(transpose(bm), db)
  end subroutine tangent
end module linear_bodies
