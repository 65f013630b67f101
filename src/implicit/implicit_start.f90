!> Start of the implicit method at a consistent state, change of its step, and the state that it reports. Index 3: positions
!> satisfy Phi = 0; the velocities that the method carries are off Phi' = 0 by its own O(h2), what is reported is projected.
module implicit_start
  use kinds, only: wp, ip
  use dynamics, only: evaluate, set_frames, place_kinematics, constraint_values, row_rates
  use generalized_alpha, only: step_coefficients
  use implicit_condensation, only: trial_correction
  use implicit_ghm, only: set_terms, begin_terms
  use implicit_model, only: implicit_solver
  use implicit_newton, only: trial_residual, trial_tangent, constant_blocks
  use implicit_rows, only: hold_weak_rows
  use mechanism, only: mechanism_model
  use projection, only: project
  use singular, only: evaluate_branch
  implicit none (type, external)
  private
  public :: start_method, change_step, restore_factors, widen_scales, reported_state, same_step, full_state, pack_state, along_rows

contains

  !> Starts (or starts again, after a jump of loads) at a consistent state y at time t: accelerations and multipliers from
  !> the equations, and what index-3 solutions differ from them by (Arnold, Bruels & Cardona 2015).
  subroutine start_method(self, m, t, h, y)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: t, h              !! [s]
    real(wp), intent(in) :: y(:)              !! the state (layout in `scene_model`)
    integer :: nq, nz
    logical :: bad
    nq = m%s%nq
    nz = m%s%nz
    self%q = y(1:nq)
    self%v = y(nq + 1:2*nq)
    self%z = y(2*nq + 1:2*nq + nz)
    self%zd = y(2*nq + nz + 1:2*nq + 2*nz)
    self%dissipated = y(2*nq + 2*nz + 1)
    self%work = y(2*nq + 2*nz + 2)
    m%left = .false.
    call evaluate(m, t, self%q, self%v, self%z, self%zd)
    self%vd = m%a
    self%a = m%a
    self%acceleration(1:nq) = m%a
    self%acceleration(nq + 1:) = m%zdd
    self%zdd = m%zdd
    self%az = m%zdd
    self%lambda = m%lambda
    self%power = m%dissipated_power
    self%input = m%input_power
    self%h_before = 0.0_wp
    self%exact_left = 0
    self%contraction = 1.0_wp
    self%tight = .true.
    self%agreed = 0
    call set_step(self, m, h)
    call smooth_start(self, m, t, bad)
    if (m%s%rows > 0 .and. .not. bad) call add_offsets(self, m, t, h)
    call widen_scales(self)
  end subroutine start_method

  !> Accelerations that the step resolves: (c1 M + tangent) x = c1 M v' within the constraints. Motion much faster than the
  !> step, which a sudden load or an undeformed start would set ringing, starts in its equilibrium; slower motion keeps v' to
  !> second order.
  subroutine smooth_start(self, m, t, bad)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: t                 !! [s]
    logical, intent(out) :: bad               !! no tangent
    integer :: b, i, n, k
    m%left = .false.
    call begin_terms(self, m)
    self%q1 = self%q
    self%v1 = self%v
    self%lambda1 = self%lambda
    self%vd1 = self%vd
    call trial_residual(self, m, t)
    do b = 1, size(self%b)
      i = m%s%qo(b)
      n = self%b(b)%nf
      self%change(i + 1:i + 3) = self%b(b)%rr
      if (n > 0) self%change(i + 4:i + 3 + n) = self%b(b)%ff(1:n)
    end do
    self%vd1 = 0.0_wp
    call trial_residual(self, m, t)
    do b = 1, size(self%b)                    ! -c1 M v'
      i = m%s%qo(b)
      n = self%b(b)%nf
      self%b(b)%rr = self%now%c1*(self%b(b)%rr - self%change(i + 1:i + 3))
      if (n > 0) self%b(b)%ff(1:n) = self%now%c1*(self%b(b)%ff(1:n) - self%change(i + 4:i + 3 + n))
    end do
    self%exact = .false.
    call trial_tangent(self, m, t, bad)
    if (bad) return
    call hold_weak_rows(self%rows)
    call place_kinematics(m, self%q, self%vd)
    call row_rates(m, m%rows%phi)             ! Phi x = Phi v'
    m%rows%phi = m%rows%phi_t - m%rows%phi
    call trial_correction(self, m)
    bad = .not. all(abs(self%dq) < huge(1.0_wp))
    if (bad) return
    self%vd = self%dq
    self%a = self%dq
    do k = 1, size(self%terms)
      associate (g => self%terms(k), d => self%now%d1*self%terms(k)%dinv)
        self%zdd(g%o + 1:g%o + g%n) = d*self%zdd(g%o + 1:g%o + g%n)
        self%az(g%o + 1:g%o + g%n) = self%zdd(g%o + 1:g%o + g%n)
      end associate
    end do
  end subroutine smooth_start

  !> In the directions that constraints hold, a = v'(t + lag h) and v = v(t) - offset h2 v'': adds these parts. Directions are
  !> those of the tangent that stands, so that stiff motion moves in equilibrium with them.
  subroutine add_offsets(self, m, t, h)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: t, h
    self%q1 = self%q + h*self%v + 0.5_wp*h**2*self%vd       ! constraint kinematics a step later: d/dt of Phi_q v' - gamma
    self%v1 = self%v + h*self%vd
    call acceleration_rows(self, m, t + h, self%q1, self%v1)
    self%lambda1 = -self%lambda1/h            ! Phi_q v''
    call set_frames(m, self%q)
    m%rows%phi = -self%lambda1
    call along_rows(self, m)
    self%a = self%a + self%method%lag*h*self%dq
    self%v = self%v - self%method%offset*h**2*self%dq
    self%lambda1 = self%lambda
  end subroutine add_offsets

  !> lambda1 <- second derivatives of all rows at positions q, rates v and the accelerations self%vd.
  subroutine acceleration_rows(self, m, t, q, v)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in), contiguous :: q(:), v(:)   !! (nq)
    integer :: k, i
    call set_frames(m, q)
    call place_kinematics(m, q, v)
    call constraint_values(m, t)
    do k = 1, size(m%s%constraints)
      associate (c => m%s%constraints(k)%item, r => m%rows)
        do i = c%first, c%first + c%rows - 1
          self%lambda1(i) = r%extra(i) + dot_product(r%na(:, i), m%p%bias(:, c%ia)) &
                            + dot_product(r%nb(:, i), m%p%bias(:, c%ib))
        end do
      end associate
    end do
    call place_kinematics(m, q, self%vd)
    call row_rates(m, m%schur%r)
    self%lambda1 = self%lambda1 + m%schur%r - m%rows%phi_t
  end subroutine acceleration_rows

  !> dq with Phi_q dq + m%rows%phi = 0 and T dq + Phi_q^T mu = 0, T the tangent that stands.
  subroutine along_rows(self, m)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    integer :: b
    do b = 1, size(self%b)
      self%b(b)%rr = 0.0_wp
      if (self%b(b)%nf > 0) self%b(b)%ff = 0.0_wp
    end do
    call trial_correction(self, m)
  end subroutine along_rows

  !> Coefficients and constant factors of a step size.
  subroutine set_step(self, m, h)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in) :: h                 !! [s]
    logical :: bad
    if (abs(h - self%now%h) <= 0.0_wp .and. .not. self%stale) return
    self%stale = .false.
    if (abs(h - self%now%h) > 0.0_wp) self%contraction = 1.0_wp
    self%now = step_coefficients(self%method, h)
    call set_terms(self, m)
    call constant_blocks(self, m, bad)
    if (bad) self%exact_left = huge(0)        ! cannot happen with positive definite mass; the exact block decides then
  end subroutine set_step

  !> After a restart: the factors of the step, which count as made before it.
  subroutine restore_factors(self, m)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    integer(ip) :: count
    count = self%constant_factors
    call set_step(self, m, self%now%h)
    self%constant_factors = count
  end subroutine restore_factors

  !> Goes on with another step size: what a lags behind v' by is scaled with the step (Bruels & Arnold 2008). Where
  !> constraints hold, v, v' and a carry the rounding of Phi = 0 over h and h2 and the offsets of the old step: these are taken
  !> off in the old step's directions, and those of the new step are added in its own.
  subroutine change_step(self, m, t, h)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: t, h              !! [s]
    real(wp) :: ratio
    logical :: bad
    ratio = h/self%now%h
    self%a = ratio*(self%a - self%vd)
    self%az = self%zdd + ratio*(self%az - self%zdd)
    if (m%s%rows > 0) then
      call tangent_here(self, m, t, bad)
      if (.not. bad) call take_off(self, m, t)
    end if
    self%a = self%vd + self%a
    call set_step(self, m, h)
    if (m%s%rows > 0) then
      call tangent_here(self, m, t, bad)
      if (.not. bad) call add_offsets(self, m, t, h)
    end if
  end subroutine change_step

  !> The tangent of the present step at the state from which it starts.
  subroutine tangent_here(self, m, t, bad)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: t                 !! [s]
    logical, intent(out) :: bad
    if (self%stale) call restore_factors(self, m)
    m%left = .false.
    call begin_terms(self, m)
    self%q1 = self%q
    self%v1 = self%v
    self%vd1 = self%vd
    self%lambda1 = self%lambda
    self%exact = .false.
    call trial_residual(self, m, t)
    call trial_tangent(self, m, t, bad)
    call hold_weak_rows(self%rows)
  end subroutine tangent_here

  !> v, v' and a - v' (in self%a) onto the derivatives of Phi = 0.
  subroutine take_off(self, m, t)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: t                 !! [s]
    call row_rates(m, m%rows%phi)
    call along_rows(self, m)
    self%v = self%v + self%dq
    call acceleration_rows(self, m, t, self%q, self%v)
    m%rows%phi = self%lambda1
    call along_rows(self, m)
    self%vd = self%vd + self%dq
    call place_kinematics(m, self%q, self%a)
    call row_rates(m, m%rows%phi)
    m%rows%phi = m%rows%phi - m%rows%phi_t
    call along_rows(self, m)
    self%a = self%a + self%dq
  end subroutine take_off

  !> Running maxima of the groups of every body.
  subroutine widen_scales(self)
    type(implicit_solver), intent(inout) :: self
    integer :: i, g
    logical :: wider
    wider = self%unit(1) <= 0.0_wp
    do i = 1, size(self%q)
      g = self%group(i)
      if (mod(g, 4) == 1 .or. mod(g, 4) == 2) cycle         ! frames: the scene's size and one radian
      if (self%weight(i)*abs(self%q(i)) > self%scale(g)) then
        self%scale(g) = self%weight(i)*abs(self%q(i))
        wider = .true.
      end if
    end do
    if (.not. wider) return
    do i = 1, size(self%q)
      self%unit(i) = self%weight(i)/self%scale(self%group(i))
    end do
  end subroutine widen_scales

  !> The projected state with its evaluation (accelerations, multipliers in m); the method's own variables stay.
  subroutine reported_state(self, m, t, y, ok)
    type(implicit_solver), intent(in) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(inout) :: y(:)           !! (layout in `scene_model`)
    logical, intent(out), optional :: ok
    integer :: nq
    logical :: done
    nq = m%s%nq
    call full_state(self, y)
    m%left = .false.
    m%broken = .false.
    done = .true.
    call evaluate(m, t, self%q, self%v, self%z, self%zd)
    if (m%s%rows > 0) then
      call project(m, t, y(1:nq), y(nq + 1:2*nq), self%z, self%zd, done)
      call evaluate_branch(m, t, y(1:nq), y(nq + 1:2*nq), self%z, self%zd)
    end if
    if (present(ok)) ok = done .and. .not. m%broken
  end subroutine reported_state

  !> Whether a step is the present one, but for the rounding of times.
  pure function same_step(self, h) result(yes)
    type(implicit_solver), intent(in) :: self
    real(wp), intent(in) :: h                 !! [s]
    logical :: yes
    yes = abs(h - self%now%h) <= 1.0e-9_wp*h
  end function same_step

  !> The method's own state (velocities not projected) in the layout of `scene_model`.
  pure subroutine full_state(self, y)
    type(implicit_solver), intent(in) :: self
    real(wp), intent(inout) :: y(:)
    call pack_state(self%q, self%v, self%z, self%zd, self%dissipated, self%work, y)
  end subroutine full_state

  !> Parts of a state, or of its rates, in the layout of `scene_model`.
  pure subroutine pack_state(q, v, z, zd, dissipated, work, y)
    real(wp), intent(in) :: q(:), v(:)              !! (nq) positions and rates, or rates and accelerations
    real(wp), intent(in) :: z(:), zd(:)             !! (nz) the same of dissipative coordinates
    real(wp), intent(in) :: dissipated, work        !! [J], or powers [W]
    real(wp), intent(inout) :: y(:)                 !! (2 nq + 2 nz + 2)
    integer :: nq, nz
    nq = size(q)
    nz = size(z)
    y(1:nq) = q
    y(nq + 1:2*nq) = v
    y(2*nq + 1:2*nq + nz) = z
    y(2*nq + nz + 1:2*nq + 2*nz) = zd
    y(2*nq + 2*nz + 1) = dissipated
    y(2*nq + 2*nz + 2) = work
  end subroutine pack_state
end module implicit_start
