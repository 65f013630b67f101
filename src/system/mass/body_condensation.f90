!> Every body's equations condensed onto its frame (theory.md, sections 2, 3, 7): inertia, gravity and elastic forces, the two
!> banded solves of a flexible body, and the 3 x 3 mass and forces that are left of it, in body axes.
module body_condensation
  use kinds, only: wp
  use body, only: body_model
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model, factor_frame
  use elastic_operators, only: add_product, bilinear
  use flexible_forces, only: elastic_forces
  use marker, only: turn
  use marker_forces, only: load_elastic
  implicit none (type, external)
  private
  public :: condense_bodies, condense_masses

contains

  !> Condensed mass, forces and products of every body: rhs, l, dinv, first_moment of the frames.
  subroutine condense_bodies(self, ev, gravity, q, v, z, zd)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in) :: gravity(2)                !! [m/s2]
    real(wp), intent(in), contiguous :: q(:), v(:)    !! (nq) positions and velocities [m, rad] and per second
    real(wp), intent(in), contiguous :: z(:), zd(:)   !! (nz) internal variables [m, rad], (nzd) rates per second
    integer :: b
    do b = 1, size(ev%frame%cos)
      if (self%flexible(b)) then
        call flexible_body(self, ev, b, gravity, q, v, z, zd)
      else
        call rigid_body(self%rigid(:, b), ev%frame%cos(b), ev%frame%sin(b), gravity, v(self%s%qo(b) + 3), &
                        ev%frame%first_moment(:, b), ev%frame%rhs(:, b), ev%frame%l(:, b), ev%frame%dinv(:, b))
      end if
    end do
  end subroutine condense_bodies

  !> The condensed mass alone, at positions q: as `condense_bodies`, but forces are zero.
  subroutine condense_masses(self, ev, q)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in), contiguous :: q(:)          !! (nq) [m, rad]
    real(wp) :: inertia, sx(2), sy(2), tx, ty
    integer :: b, i
    do b = 1, size(ev%frame%cos)
      if (.not. self%flexible(b)) then
        ev%frame%l(:, b) = self%rigid(4:6, b)
        ev%frame%dinv(:, b) = self%rigid(7:9, b)
        cycle
      end if
      i = self%s%qo(b) + 3
      associate (body => self%s%bodies(self%prototype(b)), w => ev%elastic(b))
        associate (shape => body%shape, x => q(i + 1:i + body%nf))
          w%force = 0.0_wp
          w%v(1:) = -x
          w%coupling(1:) = shape%c0
          call add_product(body%op%skew, body%op%z, w%v(1:), w%coupling(1:))
          call solve_elastic(self, ev, b, sx, sy, tx, ty)
          inertia = body%i11 + 2*dot_product(shape%i1f, x) + bilinear(body%op%symmetric, body%op%m, x, x) - ty
          call factor_mass(body, turn(body%i1 + shape%moment(x)) - sy, inertia, ev%frame%l(:, b), ev%frame%dinv(:, b))
        end associate
      end associate
    end do
  end subroutine condense_masses

  !> Factors of a flexible body's condensed mass.
  pure subroutine factor_mass(body, moment, inertia, frame_l, frame_dinv)
    type(body_model), intent(in) :: body
    real(wp), intent(in) :: moment(2)       !! condensed: H p [kg m]
    real(wp), intent(in) :: inertia         !! likewise [kg m2]
    real(wp), intent(out) :: frame_l(3)     !! L [-, m, m]
    real(wp), intent(out) :: frame_dinv(3)  !! 1/D [1/kg, 1/kg, 1/(kg m2)]
    associate (sps => body%shape%sps)
      call factor_frame(body%mass - sps(1, 1), -sps(1, 2), body%mass - sps(2, 2), moment(1), moment(2), inertia, frame_l, &
                        frame_dinv)
    end associate
  end subroutine factor_mass

  !> Condensed mass and inertia forces of a rigid body (constant mass in body axes).
  pure subroutine rigid_body(constants, c, s, gravity, thetad, p, rhs, frame_l, frame_dinv)
    real(wp), intent(in) :: constants(9)    !! mass, I1, L and 1/D (mechanism_model) [kg, m, ...]
    real(wp), intent(in) :: c, s            !! of the frame angle [-]
    real(wp), intent(in) :: gravity(2)      !! [m/s2]
    real(wp), intent(in) :: thetad          !! [rad/s]
    real(wp), intent(out) :: p(2)           !! I1 [kg m]
    real(wp), intent(out) :: rhs(3)         !! [N, N, N m]
    real(wp), intent(out) :: frame_l(3)     !! L [-, m, m]
    real(wp), intent(out) :: frame_dinv(3)  !! 1/D [1/kg, 1/kg, 1/(kg m2)]
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
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    integer, intent(in) :: b
    real(wp), intent(in) :: gravity(2)                !! [m/s2]
    real(wp), intent(in), contiguous :: q(:), v(:)    !! (nq) [m, rad] and per second
    real(wp), intent(in), contiguous :: z(:), zd(:)   !! (nz) [m, rad], (nzd) per second
    real(wp) :: g(2), thetad, qmq, qmv, power, p(2), sq(2), sv(2), i1q, i1v
    real(wp) :: sx(2), sy(2), tx, ty, before
    integer :: i, n
    i = self%s%qo(b) + 3
    thetad = v(i)
    associate (body => self%s%bodies(self%prototype(b)), w => ev%elastic(b))
      n = body%nf
      g(1) = ev%frame%cos(b)*gravity(1) + ev%frame%sin(b)*gravity(2)
      g(2) = -ev%frame%sin(b)*gravity(1) + ev%frame%cos(b)*gravity(2)
      call take_coordinates(n, q(i + 1:i + n), v(i + 1:i + n), w%q(1), w%v(1))
      call start_forces(n, body%shape%sbar, body%shape%i1f, body%shape%c0, g, thetad, w%force(1), w%coupling(1))
      call frame_products(n, q(i + 1:i + n), v(i + 1:i + n), body%shape%sbar, body%shape%i1f, sq, sv, i1q, i1v)
      p = body%i1 + sq
      if (size(self%s%integrated) > 0) before = sum(ev%loss)
      call elastic_forces(body, self%s%bodies(b)%segments, z, zd, thetad, w, ev%zdd, qmq, qmv, ev%loss, power)
      if (size(self%s%integrated) > 0) ev%dissipated_in(b) = power + (sum(ev%loss) - before)
      ev%dissipated_power = ev%dissipated_power + power
      ev%frame%first_moment(:, b) = p
      ev%frame%rhs(1, b) = body%mass*g(1) + thetad**2*p(1) + 2*thetad*sv(2)
      ev%frame%rhs(2, b) = body%mass*g(2) + thetad**2*p(2) - 2*thetad*sv(1)
      ev%frame%rhs(3, b) = p(1)*g(2) - p(2)*g(1) - 2*thetad*(i1v + qmv)
      call load_elastic(self, ev, b)
      call solve_elastic(self, ev, b, sx, sy, tx, ty)
      ev%frame%rhs(1:2, b) = ev%frame%rhs(1:2, b) - sx
      ev%frame%rhs(3, b) = ev%frame%rhs(3, b) - tx
      call factor_mass(body, turn(p) - sy, body%i11 + 2*i1q + qmq - ty, ev%frame%l(:, b), ev%frame%dinv(:, b))
    end associate
    if (.not. all(ev%frame%dinv(:, b) > 0.0_wp)) ev%broken = .true.
  end subroutine flexible_body

  !> Copies the coordinates and their rates.
  pure subroutine take_coordinates(n, q, v, x, xd)
    integer, intent(in) :: n
    real(wp), intent(in) :: q(n), v(n)                !! [m, rad] and per second
    real(wp), intent(out) :: x(n), xd(n)              !! [m, rad] and per second
    x = q
    xd = v
  end subroutine take_coordinates

  !> Q_f without elastic and velocity-product terms, m_theta_f without Z q.
  pure subroutine start_forces(n, sbar, i1f, c0, g, thetad, force, coupling)
    integer, intent(in) :: n
    real(wp), intent(in) :: sbar(n, 2), i1f(n), c0(n)   !! [kg], [kg m], [kg m]
    real(wp), intent(in) :: g(2)                      !! gravity in body axes [m/s2]
    real(wp), intent(in) :: thetad                    !! [rad/s]
    real(wp), intent(out) :: force(n), coupling(n)    !! [N, N m], [kg m, kg m2]
    force = thetad**2*i1f + sbar(:, 1)*g(1) + sbar(:, 2)*g(2)
    coupling = c0
  end subroutine start_forces

  !> Products with q_f and q_f'.
  pure subroutine frame_products(n, q, v, sbar, i1f, sq, sv, i1q, i1v)
    integer, intent(in) :: n
    real(wp), intent(in) :: q(n), v(n)                !! [m, rad] and per second
    real(wp), intent(in) :: sbar(n, 2), i1f(n)   !! [kg], [kg m]
    real(wp), intent(out) :: sq(2), sv(2)             !! S-bar q_f [kg m], S-bar q_f' [kg m/s]
    real(wp), intent(out) :: i1q, i1v           !! I1f q_f [kg m2], I1f q_f' [kg m2/s]
    integer :: k
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
  subroutine solve_elastic(self, ev, b, sx, sy, tx, ty)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    integer, intent(in) :: b
    real(wp), intent(out) :: sx(2), sy(2)             !! S-bar X [N], S-bar Y [kg m]
    real(wp), intent(out) :: tx, ty                   !! m_theta_f X [N m], m_theta_f Y [kg m2]
    integer :: n, k, j, i
    associate (body => self%s%bodies(self%prototype(b)), at => self%attached(b), found => ev%attached(b), w => ev%elastic(b))
      n = body%nf
      ! S-bar m_ff^-1 x = (m_ff^-1 S-bar^T)^T x
      call products(n, body%shape%pmat, w%force(1), w%coupling(1), sx, sy)
      w%v(1:n) = w%coupling(1:n)
      call body%basis%solve_mass(n, ev%work, w%force(1), w%coupling(1))
      ev%solves = ev%solves + 2*body%basis%factors
      tx = 0.0_wp
      ty = 0.0_wp
      do k = 1, n
        tx = tx + w%v(k)*w%force(k)
        ty = ty + w%v(k)*w%coupling(k)
      end do
      do j = 1, size(at%marker)
        if (allocated(self%s%markers(at%marker(j))%psi)) then
          call products3(n, self%s%markers(at%marker(j))%psi, w%force(1:n), w%coupling(1:n), found%ex(:, j), found%ey(:, j))
        else
          do k = 1, 3
            i = self%markers%dof(k, at%marker(j))
            if (i == 0) cycle
            found%ex(k, j) = w%force(i)
            found%ey(k, j) = w%coupling(i)
          end do
        end if
      end do
    end associate
  end subroutine solve_elastic

  !> x^T P and y^T P.
  pure subroutine products(n, p, x, y, px, py)
    integer, intent(in) :: n
    real(wp), intent(in) :: p(n, 2), x(n), y(n)   !! [-], [N, N m], [kg m, kg m2]
    real(wp), intent(out) :: px(2), py(2)         !! [N], [kg m]
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
    real(wp), intent(in) :: psi(3, n), x(n), y(n)   !! [1/kg^.5, ...], amplitudes [any]
    real(wp), intent(out) :: px(3), py(3)           !! [m, m, rad of what they are]
    integer :: k
    px = 0.0_wp
    py = 0.0_wp
    do k = 1, n
      px = px + psi(:, k)*x(k)
      py = py + psi(:, k)*y(k)
    end do
  end subroutine products3
end module body_condensation
