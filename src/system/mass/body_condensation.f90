!> Every body's equations condensed onto its frame (theory.md, sections 2, 3, 7): inertia, gravity and elastic forces, the two
!> banded solves of a flexible body, and the 3 x 3 mass and forces that are left of it, in body axes.
module body_condensation
  use kinds, only: wp
  use banded, only: band_solve_two
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model, factor_frame
  use flexible_forces, only: elastic_forces
  use marker_forces, only: load_elastic
  implicit none (type, external)
  private
  public :: condense_bodies

contains

  !> Condensed mass, forces and products of every body: rhs, l, dinv, pin of the frames.
  subroutine condense_bodies(self, ev, gravity, q, v, z, zd)
    type(mechanism_model), intent(inout) :: self
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in) :: gravity(2)                !! [m/s2]
    real(wp), intent(in), contiguous :: q(:), v(:)    !! (nq) positions and velocities
    real(wp), intent(in), contiguous :: z(:), zd(:)   !! (nz) dissipative coordinates and rates
    integer :: b
    do b = 1, size(ev%frame%cos)
      if (self%flexible(b)) then
        call flexible_body(self, ev, b, gravity, q, v, z, zd)
      else
        call rigid_body(self%rigid(:, b), ev%frame%cos(b), ev%frame%sin(b), gravity, v(self%s%qo(b) + 3), ev%frame%pin(:, b), &
                        ev%frame%rhs(:, b), ev%frame%l(:, b), ev%frame%dinv(:, b))
      end if
    end do
  end subroutine condense_bodies

  !> Condensed mass and inertia forces of a rigid body (constant mass in body axes).
  pure subroutine rigid_body(constants, c, s, gravity, thetad, p, rhs, frame_l, frame_dinv)
    real(wp), intent(in) :: constants(9)    !! mass, I1, L and 1/D (mechanism_model)
    real(wp), intent(in) :: c, s            !! of the frame angle [-]
    real(wp), intent(in) :: gravity(2)      !! [m/s2]
    real(wp), intent(in) :: thetad          !! [rad/s]
    real(wp), intent(out) :: p(2), rhs(3), frame_l(3), frame_dinv(3)
    real(wp) :: g(2)
    p = constants(2:3)
    g(1) = c*gravity(1) + s*gravity(2)
    g(2) = c*gravity(2) - s*gravity(1)
    rhs(1:2) = constants(1)*g + thetad**2*p
    rhs(3) = p(1)*g(2) - p(2)*g(1)
    frame_l = constants(4:6)
    frame_dinv = constants(7:9)
  end subroutine rigid_body

  !> Elastic forces, the two banded solves and the condensed mass and forces of a flexible body.
  subroutine flexible_body(self, ev, b, gravity, q, v, z, zd)
    type(mechanism_model), intent(inout) :: self
    type(evaluation), intent(inout) :: ev
    integer, intent(in) :: b
    real(wp), intent(in) :: gravity(2)                !! [m/s2]
    real(wp), intent(in), contiguous :: q(:), v(:)    !! (nq)
    real(wp), intent(in), contiguous :: z(:), zd(:)   !! (nz)
    real(wp) :: g(2), thetad, qmq, qmv, power, p(2), sv(2), i1q, i1v, tt
    real(wp) :: sx(2), sy(2), angle_coupling, ty
    integer :: i, n
    i = self%s%qo(b) + 3
    thetad = v(i)
    associate (body => self%s%bodies(b), prototype => self%s%bodies(self%prototype(b)))
      n = prototype%nf
      g(1) = ev%frame%cos(b)*gravity(1) + ev%frame%sin(b)*gravity(2)
      g(2) = -ev%frame%sin(b)*gravity(1) + ev%frame%cos(b)*gravity(2)
      call frame_products(n, q(i + 1:i + n), v(i + 1:i + n), prototype%sbar, prototype%i1f, prototype%c0, g, thetad, body%qx, &
                          body%vx, body%elastic_force, &
                          body%angle_coupling, p, sv, i1q, i1v)
      p = p + body%i1
      call elastic_forces(body, prototype%edof, prototype%factors, z, zd, thetad, ev%zdd, qmq, qmv, power)
      ev%dissipated_power = ev%dissipated_power + power
      ev%frame%pin(:, b) = p
      ev%frame%rhs(1, b) = body%mass*g(1) + thetad**2*p(1) + 2*thetad*sv(2)
      ev%frame%rhs(2, b) = body%mass*g(2) + thetad**2*p(2) - 2*thetad*sv(1)
      ev%frame%rhs(3, b) = p(1)*g(2) - p(2)*g(1) - 2*thetad*(i1v + qmv)
      tt = body%i11 + 2*i1q + qmq
    end associate
    call load_elastic(self, ev, b)
    call solve_elastic(self, ev, b, sx, sy, angle_coupling, ty)
    associate (body => self%s%bodies(b))
      ev%frame%rhs(1:2, b) = ev%frame%rhs(1:2, b) - sx
      ev%frame%rhs(3, b) = ev%frame%rhs(3, b) - angle_coupling
      call factor_frame(body%mass - body%sps(1, 1), -body%sps(1, 2), body%mass - body%sps(2, 2), -p(2) - sy(1), p(1) - sy(2), &
                        tt - ty, ev%frame%l(:, b), ev%frame%dinv(:, b))
    end associate
    if (.not. all(ev%frame%dinv(:, b) > 0.0_wp)) ev%broken = .true.
  end subroutine flexible_body

  !> Copies the coordinates and their rates; Q_f without elastic and velocity-product terms; products with q_f and q_f'.
  pure subroutine frame_products(n, q, v, sbar, i1f, c0, g, thetad, qx, vx, elastic_force, angle_coupling, sq, sv, i1q, i1v)
    integer, intent(in) :: n
    real(wp), intent(in) :: q(n), v(n)
    real(wp), intent(in) :: sbar(n, 2), i1f(n), c0(n)
    real(wp), intent(in) :: g(2)            !! gravity in body axes [m/s2]
    real(wp), intent(in) :: thetad          !! [rad/s]
    real(wp), intent(inout) :: qx(0:n), vx(0:n), elastic_force(0:n), angle_coupling(0:n)
    real(wp), intent(out) :: sq(2), sv(2)   !! S-bar q_f [kg m], S-bar q_f'
    real(wp), intent(out) :: i1q, i1v       !! I1f q_f [kg m2], I1f q_f'
    integer :: k
    do k = 1, n
      qx(k) = q(k)
      vx(k) = v(k)
      elastic_force(k) = thetad**2*i1f(k) + sbar(k, 1)*g(1) + sbar(k, 2)*g(2)
      angle_coupling(k) = c0(k)
    end do
    sq = 0.0_wp
    sv = 0.0_wp
    i1q = 0.0_wp
    i1v = 0.0_wp
    do k = 1, n
      sq(1) = sq(1) + sbar(k, 1)*q(k)
      sq(2) = sq(2) + sbar(k, 2)*q(k)
      sv(1) = sv(1) + sbar(k, 1)*v(k)
      sv(2) = sv(2) + sbar(k, 2)*v(k)
      i1q = i1q + i1f(k)*q(k)
      i1v = i1v + i1f(k)*v(k)
    end do
  end subroutine frame_products

  !> X = m_ff^-1 Q_f and Y = m_ff^-1 m_theta_f^T, and their products.
  subroutine solve_elastic(self, ev, b, sx, sy, angle_coupling, ty)
    type(mechanism_model), intent(inout) :: self
    type(evaluation), intent(inout) :: ev
    integer, intent(in) :: b
    real(wp), intent(out) :: sx(2), sy(2)   !! S-bar X, S-bar Y
    real(wp), intent(out) :: angle_coupling, ty !! m_theta_f X, m_theta_f Y
    integer :: n, k, j, i
    associate (body => self%s%bodies(b), prototype => self%s%bodies(self%prototype(b)), &
               at => self%attached(b), found => ev%attached(b))
      n = prototype%nf
      ! S-bar m_ff^-1 x = (m_ff^-1 S-bar^T)^T x
      call products(n, prototype%pmat, body%elastic_force(1:n), body%angle_coupling(1:n), sx, sy)
      if (body%modal) then
        angle_coupling = dot_product(body%angle_coupling(1:n), body%elastic_force(1:n))
        ty = dot_product(body%angle_coupling(1:n), body%angle_coupling(1:n))
      else
        body%qx(1:n) = body%angle_coupling(1:n)
        call band_solve_two(prototype%mff, body%elastic_force(1:n), body%angle_coupling(1:n))
        ev%solves = ev%solves + 2
        angle_coupling = 0.0_wp
        ty = 0.0_wp
        do k = 1, n
          angle_coupling = angle_coupling + body%qx(k)*body%elastic_force(k)
          ty = ty + body%qx(k)*body%angle_coupling(k)
        end do
      end if
      do j = 1, size(at%marker)
        if (body%modal) then
          if (allocated(self%s%markers(at%marker(j))%psi)) call products3(n, self%s%markers(at%marker(j))%psi, &
              body%elastic_force(1:n), &
                                                                       body%angle_coupling(1:n), found%ex(:, j), found%ey(:, j))
        else
          do k = 1, 3
            i = self%markers%dof(k, at%marker(j))
            if (i == 0) cycle
            found%ex(k, j) = body%elastic_force(i)
            found%ey(k, j) = body%angle_coupling(i)
          end do
        end if
      end do
    end associate
  end subroutine solve_elastic

  !> x^T P and y^T P.
  pure subroutine products(n, p, x, y, px, py)
    integer, intent(in) :: n
    real(wp), intent(in) :: p(n, 2), x(n), y(n)
    real(wp), intent(out) :: px(2), py(2)
    integer :: k
    px = 0.0_wp
    py = 0.0_wp
    do k = 1, n
      px(1) = px(1) + p(k, 1)*x(k)
      px(2) = px(2) + p(k, 2)*x(k)
      py(1) = py(1) + p(k, 1)*y(k)
      py(2) = py(2) + p(k, 2)*y(k)
    end do
  end subroutine products

  !> Psi x and Psi y.
  pure subroutine products3(n, psi, x, y, px, py)
    integer, intent(in) :: n
    real(wp), intent(in) :: psi(3, n), x(n), y(n)
    real(wp), intent(out) :: px(3), py(3)
    integer :: k
    px = 0.0_wp
    py = 0.0_wp
    do k = 1, n
      px = px + psi(:, k)*x(k)
      py = py + psi(:, k)*y(k)
    end do
  end subroutine products3
end module body_condensation
