!> The equations of motion, solved in structure (theory.md, sections 3, 5, 6, 7): elastic coordinates are condensed body by
!> body onto the frame, frames onto the multipliers. One evaluation costs two banded solves per flexible body and a banded
!> system of the size of the joints. Accelerations are computed in body axes: a' = A^T R''.
module dynamics
  use kinds, only: wp
  use banded, only: band_solve_two
  use mechanism, only: mechanism_model, flexible_attachments
  use modal_kernel, only: modal_forces
  use nodal_kernel, only: nodal_forces
  use place, only: place_model, place_states
  implicit none (type, external)
  private
  public :: evaluate, place_kinematics, one_place, constraint_values, row_rates, condense_constraints, &
            apply_multipliers, applied_forces, set_frames

contains

  !> Accelerations, multipliers, dissipative accelerations and powers at a state; the results stay in self.
  subroutine evaluate(self, t, q, v, z, zd)
    type(mechanism_model), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(in) :: q(:), v(:)      !! (nq) positions and velocities
    real(wp), intent(in) :: z(:), zd(:)     !! (nz) dissipative coordinates and rates
    integer :: b
    self%evaluations = self%evaluations + 1
    self%t = t
    call set_frames(self, q)
    call place_kinematics(self, q, v)
    self%dissipated_power = 0.0_wp
    self%input_power = 0.0_wp
    call applied_forces(self, t, q, z, zd)
    do b = 1, size(self%s%bodies)
      if (self%s%bodies(b)%flexible) then
        call flexible_body(self, b, q, v, z, zd)
      else
        call rigid_body(self, b, v(self%s%qo(b) + 3))
      end if
    end do
    call point_forces(self)
    call free_accelerations(self)
    call constraint_values(self, t)
    call condense_constraints(self)
    call self%schur%factor()
    call multiplier_forces(self, v)
    call accelerations(self)
  end subroutine evaluate

  !> Cosines and sines of the frame angles.
  pure subroutine set_frames(self, q)
    type(mechanism_model), intent(inout) :: self
    real(wp), intent(in) :: q(:)            !! (nq)
    integer :: b
    do b = 1, size(self%s%bodies)
      self%c(b) = cos(q(self%s%qo(b) + 3))
      self%sn(b) = sin(q(self%s%qo(b) + 3))
    end do
  end subroutine set_frames

  !> States of all places.
  pure subroutine place_kinematics(self, q, v)
    type(mechanism_model), intent(inout) :: self
    real(wp), intent(in) :: q(:), v(:)      !! (nq)
    integer :: k, b, i, n
    do k = 1, size(self%s%places)
      b = self%s%places(k)%body
      if (b == 0) cycle
      i = self%s%qo(b)
      n = self%s%bodies(b)%nf
      call one_place(self%s%places(k), self%c(b), self%sn(b), q(i + 1:i + 3), v(i + 1:i + 3), q(i + 4:i + 3 + n), &
                     v(i + 4:i + 3 + n), self%p, k)
    end do
  end subroutine place_kinematics

  !> State of one place (theory.md, section 6).
  pure subroutine one_place(place, c, s, q, v, qf, vf, p, k)
    type(place_model), intent(in) :: place
    real(wp), intent(in) :: c, s            !! of the frame angle [-]
    real(wp), intent(in) :: q(3), v(3)      !! frame: x, y, angle and rates
    real(wp), intent(in) :: qf(:), vf(:)    !! elastic coordinates and rates
    type(place_states), intent(inout) :: p
    integer, intent(in) :: k                !! entry of p to fill
    real(wp) :: u(3), ud(3), rho(2), rel(2), bias(2)
    integer :: i
    u = 0.0_wp
    ud = 0.0_wp
    if (allocated(place%psi)) then
      do i = 1, size(qf)
        u = u + place%psi(:, i)*qf(i)
        ud = ud + place%psi(:, i)*vf(i)
      end do
    else
      do i = 1, 3
        if (place%dof(i) == 0) cycle
        u(i) = qf(place%dof(i))
        ud(i) = vf(place%dof(i))
      end do
    end if
    rho = place%x + u(1:2)
    rel = [ud(1) - v(3)*rho(2), ud(2) + v(3)*rho(1)]
    bias = [-v(3)**2*rho(1) - 2*v(3)*ud(2), -v(3)**2*rho(2) + 2*v(3)*ud(1)]
    p%rho(:, k) = rho
    p%r(1, k) = q(1) + c*rho(1) - s*rho(2)
    p%r(2, k) = q(2) + s*rho(1) + c*rho(2)
    p%v(1, k) = v(1) + c*rel(1) - s*rel(2)
    p%v(2, k) = v(2) + s*rel(1) + c*rel(2)
    p%bias(1, k) = c*bias(1) - s*bias(2)
    p%bias(2, k) = s*bias(1) + c*bias(2)
    p%angle(k) = q(3) + u(3)
    p%rate(k) = v(3) + ud(3)
  end subroutine one_place

  !> Springs and loads as wrenches on their places; adds to the powers.
  subroutine applied_forces(self, t, q, z, zd)
    type(mechanism_model), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(in) :: q(:)            !! (nq)
    real(wp), intent(in) :: z(:), zd(:)     !! (nz)
    real(wp) :: d, dd, e(2), f, power, force(2), moment, angle, scale
    integer :: k, b
    self%wrench = 0.0_wp
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
        b = self%s%places(l%place)%body
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
    b = self%s%places(k)%body
    if (b == 0) return
    self%wrench(1, k) = self%wrench(1, k) + self%c(b)*force(1) + self%sn(b)*force(2)
    self%wrench(2, k) = self%wrench(2, k) - self%sn(b)*force(1) + self%c(b)*force(2)
    self%wrench(3, k) = self%wrench(3, k) + moment
  end subroutine add_wrench

  !> Condensed mass and inertia forces of a rigid body (constant mass in body axes).
  pure subroutine rigid_body(self, b, thetad)
    type(mechanism_model), intent(inout) :: self
    integer, intent(in) :: b
    real(wp), intent(in) :: thetad          !! [rad/s]
    real(wp) :: g(2), p(2), m
    associate (bo => self%s%bodies(b))
      p = bo%i1
      m = bo%mass
      g(1) = self%c(b)*self%s%gravity(1) + self%sn(b)*self%s%gravity(2)
      g(2) = -self%sn(b)*self%s%gravity(1) + self%c(b)*self%s%gravity(2)
      self%pin(:, b) = p
      self%rhs(1:2, b) = m*g + thetad**2*p
      self%rhs(3, b) = p(1)*g(2) - p(2)*g(1)
      call factor_frame(m, 0.0_wp, m, -p(2), p(1), bo%i11, self%low(:, b), self%dinv(:, b))
    end associate
  end subroutine rigid_body

  !> L D L^T of the condensed 3 x 3 mass matrix [[a, b, d], [b, c, e], [d, e, f]].
  pure subroutine factor_frame(a, b, c, d, e, f, low, dinv)
    real(wp), intent(in) :: a, b, c, d, e, f
    real(wp), intent(out) :: low(3), dinv(3)   !! l21, l31, l32 and 1/D
    real(wp) :: d2
    dinv(1) = 1.0_wp/a
    low(1) = b*dinv(1)
    low(2) = d*dinv(1)
    d2 = c - low(1)*b
    dinv(2) = 1.0_wp/d2
    low(3) = (e - low(2)*b)*dinv(2)
    dinv(3) = 1.0_wp/(f - low(2)*d - low(3)**2*d2)
  end subroutine factor_frame

  !> Elastic forces, the two banded solves and the condensed mass and forces of a flexible body.
  subroutine flexible_body(self, b, q, v, z, zd)
    type(mechanism_model), intent(inout) :: self
    integer, intent(in) :: b
    real(wp), intent(in) :: q(:), v(:)      !! (nq)
    real(wp), intent(in) :: z(:), zd(:)     !! (nz)
    real(wp) :: g(2), thetad, qmq, qmv, power, p(2), sv(2), i1q, i1v, tt
    real(wp) :: sx(2), sy(2), tx, ty
    integer :: i, o, n, k
    i = self%s%qo(b) + 3
    o = self%s%zo(b)
    thetad = v(i)
    associate (bo => self%s%bodies(b))
      n = bo%nf
      g(1) = self%c(b)*self%s%gravity(1) + self%sn(b)*self%s%gravity(2)
      g(2) = -self%sn(b)*self%s%gravity(1) + self%c(b)*self%s%gravity(2)
      bo%qx(1:n) = q(i + 1:i + n)
      bo%vx(1:n) = v(i + 1:i + n)
      p = bo%i1
      sv = 0.0_wp
      i1q = 0.0_wp
      i1v = 0.0_wp
      do k = 1, n       ! Q_f without elastic and velocity-product terms, and the products with q_f and its rate
        bo%fx(k) = thetad**2*bo%i1f(k) + bo%sbar(k, 1)*g(1) + bo%sbar(k, 2)*g(2)
        bo%tx(k) = bo%c0(k)
        p = p + bo%sbar(k, :)*bo%qx(k)
        sv = sv + bo%sbar(k, :)*bo%vx(k)
        i1q = i1q + bo%i1f(k)*bo%qx(k)
        i1v = i1v + bo%i1f(k)*bo%vx(k)
      end do
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
      sx = 0.0_wp
      sy = 0.0_wp
      do k = 1, n       ! S-bar m_ff^-1 x = (m_ff^-1 S-bar^T)^T x, before the solve
        sx = sx + bo%pmat(k, :)*bo%fx(k)
        sy = sy + bo%pmat(k, :)*bo%tx(k)
      end do
      tx = 0.0_wp
      ty = 0.0_wp
      if (bo%modal) then
        tx = dot_product(bo%tx(1:n), bo%fx(1:n))
        ty = dot_product(bo%tx(1:n), bo%tx(1:n))
      else
        bo%qx(1:n) = bo%tx(1:n)
        call band_solve_two(bo%mff, bo%fx(1:n), bo%tx(1:n))
        self%solves = self%solves + 2
        do k = 1, n
          tx = tx + bo%qx(k)*bo%fx(k)
          ty = ty + bo%qx(k)*bo%tx(k)
        end do
      end if
      do j = 1, size(at%place)
        associate (place => self%s%places(at%place(j)))
          if (allocated(place%psi)) then
            at%ex(:, j) = matmul(place%psi, bo%fx(1:n))
            at%ey(:, j) = matmul(place%psi, bo%tx(1:n))
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

  !> Wrenches on places act on the frames: A^T F, (H rho).A^T F + M.
  pure subroutine point_forces(self)
    type(mechanism_model), intent(inout) :: self
    integer :: j, k, b
    do j = 1, size(self%s%loaded)
      k = self%s%loaded(j)
      b = self%s%places(k)%body
      self%rhs(1:2, b) = self%rhs(1:2, b) + self%wrench(1:2, k)
      self%rhs(3, b) = self%rhs(3, b) + self%wrench(3, k) + self%p%rho(1, k)*self%wrench(2, k) &
                       - self%p%rho(2, k)*self%wrench(1, k)
    end do
  end subroutine point_forces

  !> Accelerations of the condensed frames without multipliers.
  pure subroutine free_accelerations(self)
    type(mechanism_model), intent(inout) :: self
    integer :: b
    do b = 1, size(self%s%bodies)
      self%free(:, b) = self%rhs(:, b)
      call solve_frame(self%low(:, b), self%dinv(:, b), self%free(:, b))
    end do
  end subroutine free_accelerations

  !> Solves the factored 3 x 3 system in place.
  pure subroutine solve_frame(low, dinv, x)
    real(wp), intent(in) :: low(3), dinv(3)
    real(wp), intent(inout) :: x(3)
    x(2) = x(2) - low(1)*x(1)
    x(3) = x(3) - low(2)*x(1) - low(3)*x(2)
    x = x*dinv
    x(2) = x(2) - low(3)*x(3)
    x(1) = x(1) - low(1)*x(2) - low(2)*x(3)
  end subroutine solve_frame

  !> Phi, its gradients and the other parts of every constraint, from the places' states.
  subroutine constraint_values(self, t)
    type(mechanism_model), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    integer :: k
    do k = 1, size(self%s%constraints)
      call self%s%constraints(k)%item%evaluate(t, self%p, self%rows)
    end do
  end subroutine constraint_values

  !> Rates of all rows, Phi_q v + Phi_t [m/s].
  pure subroutine row_rates(self, rate)
    type(mechanism_model), intent(in) :: self
    real(wp), intent(out) :: rate(:)        !! (rows)
    integer :: k, i
    do k = 1, size(self%s%constraints)
      associate (c => self%s%constraints(k)%item, r => self%rows)
        do i = c%first, c%first + c%rows - 1
          rate(i) = dot_product(r%na(:, i), self%p%v(:, c%ia)) + dot_product(r%nb(:, i), self%p%v(:, c%ib)) &
                    + r%sa(i)*self%p%rate(c%ia) + r%sb(i)*self%p%rate(c%ib) + r%phi_t(i)
        end do
      end associate
    end do
  end subroutine row_rates

  !> Unit-multiplier wrenches in body axes, condensed onto the frames, and S = Phi_q M^-1 Phi_q^T.
  subroutine condense_constraints(self)
    type(mechanism_model), intent(inout) :: self
    integer :: b, e
    call self%schur%clear()
    do b = 1, size(self%s%bodies)
      do e = self%end_first(b), self%end_first(b + 1) - 1
        call unit_wrench(self, b, e)
      end do
      call add_compliance(self, b)
    end do
  end subroutine condense_constraints

  !> One end: w in body axes, J^T w and L^-1 J^T w.
  pure subroutine unit_wrench(self, b, e)
    type(mechanism_model), intent(inout) :: self
    integer, intent(in) :: b, e
    real(wp) :: n(2), s, w(3), jw(3)
    integer :: i, k, j
    i = self%end_row(e)
    k = self%end_place(e)
    if (self%end_is_a(e)) then
      n = self%rows%na(:, i)
      s = self%rows%sa(i)
    else
      n = self%rows%nb(:, i)
      s = self%rows%sb(i)
    end if
    w(1) = self%c(b)*n(1) + self%sn(b)*n(2)
    w(2) = -self%sn(b)*n(1) + self%c(b)*n(2)
    w(3) = s
    jw(1) = w(1)
    jw(2) = w(2)
    jw(3) = s + self%p%rho(1, k)*w(2) - self%p%rho(2, k)*w(1)
    if (self%s%bodies(b)%flexible .and. .not. self%frozen) then
      j = self%end_local(e)
      associate (at => self%attached(b))
        jw(1) = jw(1) - (at%ep(1, 1, j)*w(1) + at%ep(2, 1, j)*w(2) + at%ep(3, 1, j)*s)
        jw(2) = jw(2) - (at%ep(1, 2, j)*w(1) + at%ep(2, 2, j)*w(2) + at%ep(3, 2, j)*s)
        jw(3) = jw(3) - (at%ey(1, j)*w(1) + at%ey(2, j)*w(2) + at%ey(3, j)*s)
      end associate
    end if
    self%w(:, e) = w
    self%jw(:, e) = jw
    self%g(1, e) = jw(1)
    self%g(2, e) = jw(2) - self%low(1, b)*jw(1)
    self%g(3, e) = jw(3) - self%low(2, b)*jw(1) - self%low(3, b)*self%g(2, e)
  end subroutine unit_wrench

  !> One body's part of S.
  pure subroutine add_compliance(self, b)
    type(mechanism_model), intent(inout) :: self
    integer, intent(in) :: b
    real(wp) :: h(3), x
    integer :: e, f, i, j
    associate (first => self%end_first(b), last => self%end_first(b + 1) - 1)
      do e = first, last
        h = self%g(:, e)*self%dinv(:, b)
        i = self%schur%position(self%end_row(e))
        do f = first, e
          x = h(1)*self%g(1, f) + h(2)*self%g(2, f) + h(3)*self%g(3, f)
          if (self%s%bodies(b)%flexible .and. .not. self%frozen) then
            x = x + elastic_compliance(self%attached(b), self%end_local(e), self%end_local(f), self%w(:, e), self%w(:, f))
          end if
          j = self%schur%position(self%end_row(f))
          x = x*self%schur%scale(self%end_row(e))*self%schur%scale(self%end_row(f))
          if (i == j .and. f < e) x = 2*x      ! both places of one row on the same body
          self%schur%s(abs(i - j), min(i, j)) = self%schur%s(abs(i - j), min(i, j)) + x
        end do
      end do
    end associate
  end subroutine add_compliance

  !> w_i . (E_i m_ff^-1 E_j^T) w_j.
  pure function elastic_compliance(at, i, j, wi, wj) result(x)
    type(flexible_attachments), intent(in) :: at
    integer, intent(in) :: i, j             !! attachments
    real(wp), intent(in) :: wi(3), wj(3)    !! unit wrenches
    real(wp) :: x
    integer :: c
    x = 0.0_wp
    do c = 1, 3
      x = x + wj(c)*(wi(1)*at%compliance(1, c, i, j) + wi(2)*at%compliance(2, c, i, j) + wi(3)*at%compliance(3, c, i, j))
    end do
  end function elastic_compliance

  !> Multipliers from S lambda = Phi_q a_free + (second derivative at zero acceleration), with Baumgarte terms if asked.
  subroutine multiplier_forces(self, v)
    type(mechanism_model), intent(inout) :: self
    real(wp), intent(in) :: v(:)            !! (nq)
    integer :: k, i
    if (self%s%rows == 0) return
    do k = 1, size(self%s%constraints)
      associate (c => self%s%constraints(k)%item, r => self%rows)
        do i = c%first, c%first + c%rows - 1
          self%lambda(i) = r%extra(i) + dot_product(r%na(:, i), self%p%bias(:, c%ia)) &
                           + dot_product(r%nb(:, i), self%p%bias(:, c%ib))
        end do
      end associate
    end do
    if (any(self%baumgarte > 0.0_wp)) call add_baumgarte(self)
    call add_free_rows(self)
    call self%schur%solve(self%lambda)
    do k = self%s%joints + 1, size(self%s%constraints)
      associate (c => self%s%constraints(k)%item)
        i = c%first
        self%input_power = self%input_power + self%lambda(i)*self%rows%phi_t(i)
      end associate
    end do
    if (.not. v(1) < huge(1.0_wp)) self%broken = .true.
  end subroutine multiplier_forces

  !> 2 alpha Phi' + beta^2 Phi (Baumgarte 1972).
  subroutine add_baumgarte(self)
    type(mechanism_model), intent(inout) :: self
    call row_rates(self, self%schur%r)
    self%lambda = self%lambda + 2*self%baumgarte(1)*self%schur%r + self%baumgarte(2)**2*self%rows%phi
  end subroutine add_baumgarte

  !> Adds Phi_q times the free accelerations of the places.
  pure subroutine add_free_rows(self)
    type(mechanism_model), intent(inout) :: self
    integer :: b, e, i, j
    do b = 1, size(self%s%bodies)
      do e = self%end_first(b), self%end_first(b + 1) - 1
        i = self%end_row(e)
        self%lambda(i) = self%lambda(i) + dot_product(self%jw(:, e), self%free(:, b))
        if (self%s%bodies(b)%flexible) then
          j = self%end_local(e)
          self%lambda(i) = self%lambda(i) + dot_product(self%w(:, e), self%attached(b)%ex(:, j))
        end if
      end do
    end do
  end subroutine add_free_rows

  !> Accelerations of frames (global) and elastic coordinates from the free ones and the multipliers.
  subroutine accelerations(self)
    type(mechanism_model), intent(inout) :: self
    real(wp) :: x(3)
    integer :: b, i, n, k
    do b = 1, size(self%s%bodies)
      call push_frame(self, b, self%lambda, x)
      x = self%free(:, b) - x
      i = self%s%qo(b)
      self%a(i + 1) = self%c(b)*x(1) - self%sn(b)*x(2)
      self%a(i + 2) = self%sn(b)*x(1) + self%c(b)*x(2)
      self%a(i + 3) = x(3)
      if (.not. self%s%bodies(b)%flexible) cycle
      associate (bo => self%s%bodies(b))
        n = bo%nf
        do k = 1, n
          self%a(i + 3 + k) = bo%fx(k) - bo%pmat(k, 1)*x(1) - bo%pmat(k, 2)*x(2) - bo%tx(k)*x(3)
        end do
        call push_elastic(self, b, self%lambda, self%a(i + 4:i + 3 + n))
      end associate
    end do
  end subroutine accelerations

  !> Mc^-1 J^T w lambda of one body's frame, body axes.
  pure subroutine push_frame(self, b, lambda, x)
    type(mechanism_model), intent(in) :: self
    integer, intent(in) :: b
    real(wp), intent(in) :: lambda(:)       !! (rows)
    real(wp), intent(out) :: x(3)
    integer :: e
    x = 0.0_wp
    do e = self%end_first(b), self%end_first(b + 1) - 1
      x = x + self%jw(:, e)*lambda(self%end_row(e))
    end do
    call solve_frame(self%low(:, b), self%dinv(:, b), x)
  end subroutine push_frame

  !> Subtracts m_ff^-1 E^T w lambda from elastic accelerations (or corrections).
  subroutine push_elastic(self, b, lambda, a)
    type(mechanism_model), intent(inout) :: self
    integer, intent(in) :: b
    real(wp), intent(in) :: lambda(:)       !! (rows)
    real(wp), intent(inout) :: a(:)         !! (nf)
    integer :: e, c, j, k
    associate (at => self%attached(b))
      at%load = 0.0_wp
      do e = self%end_first(b), self%end_first(b + 1) - 1
        j = self%end_local(e)
        do c = 1, 3
          k = at%column(c, j)
          if (k > 0) at%load(k) = at%load(k) + self%w(c, e)*lambda(self%end_row(e))
        end do
      end do
      do k = 1, size(at%load)
        a = a - at%load(k)*at%columns(:, k)
      end do
    end associate
  end subroutine push_elastic

  !> dq = -M^-1 Phi_q^T mu with the factors of the last evaluation: the mass-orthogonal correction (theory.md, section 6).
  subroutine apply_multipliers(self, mu, dq)
    type(mechanism_model), intent(inout) :: self
    real(wp), intent(in) :: mu(:)           !! (rows)
    real(wp), intent(out) :: dq(:)          !! (nq), global axes
    real(wp) :: x(3)
    integer :: b, i, n, k
    do b = 1, size(self%s%bodies)
      call push_frame(self, b, mu, x)
      x = -x
      i = self%s%qo(b)
      dq(i + 1) = self%c(b)*x(1) - self%sn(b)*x(2)
      dq(i + 2) = self%sn(b)*x(1) + self%c(b)*x(2)
      dq(i + 3) = x(3)
      if (.not. self%s%bodies(b)%flexible) cycle
      if (self%frozen) then
        dq(i + 4:i + 3 + self%s%bodies(b)%nf) = 0.0_wp
        cycle
      end if
      associate (bo => self%s%bodies(b))
        n = bo%nf
        do k = 1, n
          dq(i + 3 + k) = -bo%pmat(k, 1)*x(1) - bo%pmat(k, 2)*x(2) - bo%tx(k)*x(3)
        end do
        call push_elastic(self, b, mu, dq(i + 4:i + 3 + n))
      end associate
    end do
  end subroutine apply_multipliers
end module dynamics
