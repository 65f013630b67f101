!> The equations of motion, solved in structure (theory.md, sections 3, 5, 6, 7): elastic coordinates are condensed body by
!> body onto the frame, frames onto the multipliers. One evaluation costs two banded solves per flexible body and a banded
!> system of the size of the joints. Accelerations are computed in body axes: a' = A^T R''.
module dynamics
  use kinds, only: wp
  use banded, only: band_solve_two
  use joint_correction, only: correct_accelerations
  use joint_geometry, only: factor_joints
  use joint_system, only: constraint_values, row_rates, condense_constraints, joint_accelerations, push_frames, &
                          push_elastic, apply_multipliers
  use mechanism, only: mechanism_model, factor_frame
  use modal_kernel, only: modal_forces
  use nodal_kernel, only: nodal_forces
  use place_motion, only: set_frames, place_kinematics, one_place
  implicit none (type, external)
  private
  public :: evaluate, place_kinematics, one_place, constraint_values, row_rates, condense_constraints, &
            apply_multipliers, applied_forces, set_frames

contains

  !> Accelerations, multipliers, dissipative accelerations and powers at a state; the results stay in self.
  subroutine evaluate(self, t, q, v, z, zd)
    type(mechanism_model), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(in), contiguous :: q(:), v(:)    !! (nq) positions and velocities
    real(wp), intent(in), contiguous :: z(:), zd(:)   !! (nz) dissipative coordinates and rates
    integer :: b
    self%evaluations = self%evaluations + 1
    self%t = t
    call set_frames(self, q)
    call place_kinematics(self, q, v)
    self%dissipated_power = 0.0_wp
    self%input_power = 0.0_wp
    call applied_forces(self, t, q, z, zd)
    do b = 1, size(self%c)
      if (self%flexible(b)) then
        call flexible_body(self, b, q, v, z, zd)
      else
        call rigid_body(self%rigid(:, b), self%c(b), self%sn(b), self%s%gravity, v(self%s%qo(b) + 3), self%pin(:, b), &
                        self%rhs(:, b), self%low(:, b), self%dinv(:, b))
      end if
    end do
    call point_forces(self)
    call free_accelerations(size(self%c), self%rhs, self%low, self%dinv, self%free)
    call constraint_values(self, t)
    call condense_constraints(self)
    call factor_joints(self)
    call multiplier_forces(self)
    call accelerations(self)
    if (self%schur%uneven) call correct_accelerations(self)
    call drive_powers(self)
    if (.not. v(1) < huge(1.0_wp)) self%broken = .true.
  end subroutine evaluate

  !> Springs and loads as wrenches on their places; adds to the powers.
  subroutine applied_forces(self, t, q, z, zd)
    type(mechanism_model), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(in), contiguous :: q(:)          !! (nq)
    real(wp), intent(in), contiguous :: z(:), zd(:)   !! (nz)
    real(wp) :: d, dd, e(2), f, power, force(2), moment, angle, scale
    integer :: k, b
    do k = 1, size(self%s%loaded)
      self%wrench(:, self%s%loaded(k)) = 0.0_wp
    end do
    do k = 1, size(self%s%springs)
      associate (sp => self%s%springs(k))
        call sp%deformation(self%p, d, dd, e)
        call sp%force(d, dd, z, zd, self%zdd, f, power)
        self%spring_force(k) = f
        self%dissipated_power = self%dissipated_power + power
        if (sp%torsional) then
          call add_wrench(self, sp%ia, [0.0_wp, 0.0_wp], -f)
          call add_wrench(self, sp%ib, [0.0_wp, 0.0_wp], f)
        else
          call add_wrench(self, sp%ia, -f*e, 0.0_wp)
          call add_wrench(self, sp%ib, f*e, 0.0_wp)
        end if
      end associate
    end do
    do k = 1, size(self%s%loads)
      associate (l => self%s%loads(k))
        if (.not. l%acts(self%stage)) cycle
        b = self%place_body(l%place)
        angle = 0.0_wp
        if (b > 0) angle = q(self%s%qo(b) + 3)
        scale = l%scale(t, self%left)*self%load_factor
        call l%wrench(self%p, angle, scale, force, moment)
        call add_wrench(self, l%place, force, moment)
        self%input_power = self%input_power + dot_product(force, self%p%v(:, l%place)) + moment*self%p%rate(l%place)
      end associate
    end do
  end subroutine applied_forces

  !> Adds a force (global axes) and a moment to a place.
  pure subroutine add_wrench(self, k, force, moment)
    type(mechanism_model), intent(inout) :: self
    integer, intent(in) :: k                !! place
    real(wp), intent(in) :: force(2)        !! [N]
    real(wp), intent(in) :: moment          !! [N m]
    integer :: b
    b = self%place_body(k)
    if (b == 0) return
    self%wrench(1, k) = self%wrench(1, k) + self%c(b)*force(1) + self%sn(b)*force(2)
    self%wrench(2, k) = self%wrench(2, k) - self%sn(b)*force(1) + self%c(b)*force(2)
    self%wrench(3, k) = self%wrench(3, k) + moment
  end subroutine add_wrench

  !> Condensed mass and inertia forces of a rigid body (constant mass in body axes).
  pure subroutine rigid_body(constants, c, s, gravity, thetad, p, rhs, low, dinv)
    real(wp), intent(in) :: constants(9)    !! mass, I1, L and 1/D (mechanism_model)
    real(wp), intent(in) :: c, s            !! of the frame angle [-]
    real(wp), intent(in) :: gravity(2)      !! [m/s2]
    real(wp), intent(in) :: thetad          !! [rad/s]
    real(wp), intent(out) :: p(2), rhs(3), low(3), dinv(3)
    real(wp) :: g(2)
    p = constants(2:3)
    g(1) = c*gravity(1) + s*gravity(2)
    g(2) = c*gravity(2) - s*gravity(1)
    rhs(1:2) = constants(1)*g + thetad**2*p
    rhs(3) = p(1)*g(2) - p(2)*g(1)
    low = constants(4:6)
    dinv = constants(7:9)
  end subroutine rigid_body

  !> Elastic forces, the two banded solves and the condensed mass and forces of a flexible body.
  subroutine flexible_body(self, b, q, v, z, zd)
    type(mechanism_model), intent(inout) :: self
    integer, intent(in) :: b
    real(wp), intent(in), contiguous :: q(:), v(:)    !! (nq)
    real(wp), intent(in), contiguous :: z(:), zd(:)   !! (nz)
    real(wp) :: g(2), thetad, qmq, qmv, power, p(2), sv(2), i1q, i1v, tt
    real(wp) :: sx(2), sy(2), tx, ty
    integer :: i, o, n
    i = self%s%qo(b) + 3
    o = self%s%zo(b)
    thetad = v(i)
    associate (bo => self%s%bodies(b))
      n = bo%nf
      g(1) = self%c(b)*self%s%gravity(1) + self%sn(b)*self%s%gravity(2)
      g(2) = -self%sn(b)*self%s%gravity(1) + self%c(b)*self%s%gravity(2)
      call frame_products(n, q(i + 1:i + n), v(i + 1:i + n), bo%sbar, bo%i1f, bo%c0, g, thetad, bo%qx, bo%vx, bo%fx, &
                          bo%tx, p, sv, i1q, i1v)
      p = p + bo%i1
      if (bo%modal) then
        call modal_forces(bo, z(o + 1:o + bo%nz), zd(o + 1:o + bo%nz), thetad, self%zdd(o + 1:o + bo%nz), qmq, qmv, power)
      else
        call nodal_forces(bo, z(o + 1:o + bo%nz), zd(o + 1:o + bo%nz), thetad, self%zdd(o + 1:o + bo%nz), qmq, qmv, power)
      end if
      self%dissipated_power = self%dissipated_power + power
      self%pin(:, b) = p
      self%rhs(1, b) = bo%mass*g(1) + thetad**2*p(1) + 2*thetad*sv(2)
      self%rhs(2, b) = bo%mass*g(2) + thetad**2*p(2) - 2*thetad*sv(1)
      self%rhs(3, b) = p(1)*g(2) - p(2)*g(1) - 2*thetad*(i1v + qmv)
      tt = bo%i11 + 2*i1q + qmq
    end associate
    call elastic_point_forces(self, b)
    call solve_elastic(self, b, sx, sy, tx, ty)
    associate (bo => self%s%bodies(b))
      self%rhs(1:2, b) = self%rhs(1:2, b) - sx
      self%rhs(3, b) = self%rhs(3, b) - tx
      call factor_frame(bo%mass - bo%sps(1, 1), -bo%sps(1, 2), bo%mass - bo%sps(2, 2), -p(2) - sy(1), p(1) - sy(2), &
                        tt - ty, self%low(:, b), self%dinv(:, b))
    end associate
    if (.not. all(self%dinv(:, b) > 0.0_wp)) self%broken = .true.
  end subroutine flexible_body

  !> Copies the coordinates and their rates; Q_f without elastic and velocity-product terms; products with q_f and q_f'.
  pure subroutine frame_products(n, q, v, sbar, i1f, c0, g, thetad, qx, vx, fx, tx, sq, sv, i1q, i1v)
    integer, intent(in) :: n
    real(wp), intent(in) :: q(n), v(n)
    real(wp), intent(in) :: sbar(n, 2), i1f(n), c0(n)
    real(wp), intent(in) :: g(2)            !! gravity in body axes [m/s2]
    real(wp), intent(in) :: thetad          !! [rad/s]
    real(wp), intent(inout) :: qx(0:n), vx(0:n), fx(0:n), tx(0:n)
    real(wp), intent(out) :: sq(2), sv(2)   !! S-bar q_f [kg m], S-bar q_f'
    real(wp), intent(out) :: i1q, i1v       !! I1f q_f [kg m2], I1f q_f'
    integer :: k
    do k = 1, n
      qx(k) = q(k)
      vx(k) = v(k)
      fx(k) = thetad**2*i1f(k) + sbar(k, 1)*g(1) + sbar(k, 2)*g(2)
      tx(k) = c0(k)
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

  !> Wrenches on places act on the elastic coordinates there.
  pure subroutine elastic_point_forces(self, b)
    type(mechanism_model), intent(inout) :: self
    integer, intent(in) :: b
    integer :: j, k, c, i
    do j = self%s%loaded_first(b), self%s%loaded_first(b + 1) - 1
      k = self%s%loaded(j)
      associate (place => self%s%places(k), bo => self%s%bodies(b))
        if (allocated(place%psi)) then
          do i = 1, bo%nf
            bo%fx(i) = bo%fx(i) + dot_product(place%psi(:, i), self%wrench(:, k))
          end do
        else
          do c = 1, 3
            i = place%dof(c)
            if (i > 0) bo%fx(i) = bo%fx(i) + self%wrench(c, k)
          end do
        end if
      end associate
    end do
  end subroutine elastic_point_forces

  !> X = m_ff^-1 Q_f and Y = m_ff^-1 m_theta_f^T, and their products.
  subroutine solve_elastic(self, b, sx, sy, tx, ty)
    type(mechanism_model), intent(inout) :: self
    integer, intent(in) :: b
    real(wp), intent(out) :: sx(2), sy(2)   !! S-bar X, S-bar Y
    real(wp), intent(out) :: tx, ty         !! m_theta_f X, m_theta_f Y
    integer :: n, k, j
    associate (bo => self%s%bodies(b), at => self%attached(b))
      n = bo%nf
      call products(n, bo%pmat, bo%fx(1:n), bo%tx(1:n), sx, sy)   ! S-bar m_ff^-1 x = (m_ff^-1 S-bar^T)^T x
      if (bo%modal) then
        tx = dot_product(bo%tx(1:n), bo%fx(1:n))
        ty = dot_product(bo%tx(1:n), bo%tx(1:n))
      else
        bo%qx(1:n) = bo%tx(1:n)
        call band_solve_two(bo%mff, bo%fx(1:n), bo%tx(1:n))
        self%solves = self%solves + 2
        tx = 0.0_wp
        ty = 0.0_wp
        do k = 1, n
          tx = tx + bo%qx(k)*bo%fx(k)
          ty = ty + bo%qx(k)*bo%tx(k)
        end do
      end if
      do j = 1, size(at%place)
        associate (place => self%s%places(at%place(j)))
          if (allocated(place%psi)) then
            call products3(n, place%psi, bo%fx(1:n), bo%tx(1:n), at%ex(:, j), at%ey(:, j))
          else
            do k = 1, 3
              if (place%dof(k) == 0) cycle
              at%ex(k, j) = bo%fx(place%dof(k))
              at%ey(k, j) = bo%tx(place%dof(k))
            end do
          end if
        end associate
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

  !> Wrenches on places act on the frames: A^T F, (H rho).A^T F + M.
  pure subroutine point_forces(self)
    type(mechanism_model), intent(inout) :: self
    integer :: j, k, b
    do j = 1, size(self%s%loaded)
      k = self%s%loaded(j)
      b = self%place_body(k)
      self%rhs(1:2, b) = self%rhs(1:2, b) + self%wrench(1:2, k)
      self%rhs(3, b) = self%rhs(3, b) + self%wrench(3, k) + self%p%rho(1, k)*self%wrench(2, k) &
                       - self%p%rho(2, k)*self%wrench(1, k)
    end do
  end subroutine point_forces

  !> Accelerations of the condensed frames without multipliers.
  pure subroutine free_accelerations(nb, rhs, low, dinv, free)
    integer, intent(in) :: nb
    real(wp), intent(in) :: rhs(3, nb), low(3, nb), dinv(3, nb)
    real(wp), intent(out) :: free(3, nb)    !! body axes
    real(wp) :: x2, x3
    integer :: b
    do b = 1, nb
      x2 = rhs(2, b) - low(1, b)*rhs(1, b)
      x3 = (rhs(3, b) - low(2, b)*rhs(1, b) - low(3, b)*x2)*dinv(3, b)
      x2 = x2*dinv(2, b) - low(3, b)*x3
      free(1, b) = rhs(1, b)*dinv(1, b) - low(1, b)*x2 - low(2, b)*x3
      free(2, b) = x2
      free(3, b) = x3
    end do
  end subroutine free_accelerations

  !> Multipliers from S lambda = Phi_q a_free + (second derivative at zero acceleration), with Baumgarte terms if asked.
  subroutine multiplier_forces(self)
    type(mechanism_model), intent(inout) :: self
    if (self%s%rows == 0) return
    call joint_accelerations(self)
    if (any(self%baumgarte > 0.0_wp)) call add_baumgarte(self)
    call self%schur%solve(self%lambda)
  end subroutine multiplier_forces

  !> Adds what the drives do to the power.
  pure subroutine drive_powers(self)
    type(mechanism_model), intent(inout) :: self
    integer :: k, i
    do k = self%s%joints + 1, size(self%s%constraints)
      associate (c => self%s%constraints(k)%item)
        i = c%first
        self%input_power = self%input_power + self%lambda(i)*self%rows%phi_t(i)
      end associate
    end do
  end subroutine drive_powers

  !> 2 alpha Phi' + beta^2 Phi (Baumgarte 1972).
  subroutine add_baumgarte(self)
    type(mechanism_model), intent(inout) :: self
    call row_rates(self, self%schur%r)
    self%lambda = self%lambda + 2*self%baumgarte(1)*self%schur%r + self%baumgarte(2)**2*self%rows%phi
  end subroutine add_baumgarte

  !> Accelerations of frames (global) and elastic coordinates from the free ones and the multipliers.
  subroutine accelerations(self)
    type(mechanism_model), intent(inout) :: self
    integer :: b, i, n
    call push_frames(self, self%lambda)
    call frame_accelerations(size(self%c), self%s%qo, self%c, self%sn, self%free, self%push, size(self%a), self%a)
    do b = 1, size(self%c)
      if (.not. self%flexible(b)) cycle
      i = self%s%qo(b)
      associate (bo => self%s%bodies(b))
        n = bo%nf
        call elastic_accelerations(n, bo%fx(1:n), bo%pmat, bo%tx(1:n), self%push(:, b), self%a(i + 4:i + 3 + n))
      end associate
      call push_elastic(self, b, self%lambda, self%a(i + 4:i + 3 + n))
    end do
  end subroutine accelerations

  !> Accelerations of the frames, global axes; push becomes their accelerations in body axes.
  pure subroutine frame_accelerations(nb, offset, c, s, free, push, nq, a)
    integer, intent(in) :: nb, nq
    integer, intent(in) :: offset(nb)                 !! of each body's coordinates
    real(wp), intent(in) :: c(nb), s(nb)              !! of the frame angles [-]
    real(wp), intent(in) :: free(3, nb)               !! accelerations without multipliers
    real(wp), intent(inout) :: push(3, nb)            !! what the multipliers take from them
    real(wp), intent(inout) :: a(nq)
    real(wp) :: x1, x2, x3
    integer :: b, i
    do b = 1, nb
      i = offset(b)
      x1 = free(1, b) - push(1, b)
      x2 = free(2, b) - push(2, b)
      x3 = free(3, b) - push(3, b)
      a(i + 1) = c(b)*x1 - s(b)*x2
      a(i + 2) = s(b)*x1 + c(b)*x2
      a(i + 3) = x3
      push(1, b) = x1
      push(2, b) = x2
      push(3, b) = x3
    end do
  end subroutine frame_accelerations

  !> m_ff^-1 (Q_f - m_fR a' - m_f_theta theta'').
  pure subroutine elastic_accelerations(n, fx, pmat, tx, x, a)
    integer, intent(in) :: n
    real(wp), intent(in) :: fx(n), pmat(n, 2), tx(n)
    real(wp), intent(in) :: x(3)            !! accelerations of the frame, body axes
    real(wp), intent(out) :: a(n)
    integer :: k
    do k = 1, n
      a(k) = fx(k) - pmat(k, 1)*x(1) - pmat(k, 2)*x(2) - tx(k)*x(3)
    end do
  end subroutine elastic_accelerations
end module dynamics
