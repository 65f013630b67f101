!> Steps of the generalized-alpha method for a mechanism: consistent start, Newton's method with constant elastic factors
!> while they contract well and exact ones otherwise, change of the step, error estimate. Index 3: positions satisfy
!> Phi = 0; the velocities that the method carries are off Phi' = 0 by its own O(h2), what is reported is projected.
module implicit_step
  use kinds, only: wp, ip
  use archive, only: value_archive
  use dynamics, only: evaluate, set_frames, place_kinematics, constraint_values, row_rates, apply_multipliers, applied_forces
  use generalized_alpha, only: step_coefficients
  use implicit_bodies, only: elastic_filter
  use implicit_energy, only: removed_energy
  use implicit_ghm, only: set_terms, begin_terms, end_terms, dissipated_in_bodies
  use implicit_model, only: implicit_solver
  use implicit_newton, only: trial_residual, trial_tangent, trial_elastic, trial_correction, constant_blocks
  use mechanism, only: mechanism_model
  use projection, only: project
  implicit none (type, external)
  private
  public :: start_method, change_step, try_step, accept_step, reported_state, estimated_error
  public :: remember_error, same_step, full_state, full_rates, exchange_solver

  integer, parameter :: most_iterations = 12       !! Newton iterations of a step
  real(wp), parameter :: slow = 0.1_wp             !! contraction from which exact elastic blocks pay [-]
  integer, parameter :: exact_steps = 50           !! steps before the constant ones are tried again
  real(wp), parameter :: relative_goal = 1.0e-5_wp !! Newton's error, of the first correction [-]
  real(wp), parameter :: loose = 1.0e-9_wp         !! and at most this, of the groups' sizes [-]
  real(wp), parameter :: rounding = 1.0e-16_wp     !! below this corrections are noise, of the groups' sizes [-]
  real(wp), parameter :: noise = 1.0e-13_wp        !! corrections below that do not shrink are rounding, of the scene's size [-]

contains

  !> Starts (or starts again, after a jump of loads) at a consistent state y at time t: accelerations and multipliers from
  !> the equations, and what index-3 solutions differ from them by (Arnold, Bruels & Cardona 2015).
  subroutine start_method(self, m, t, h, y)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: t, h              !! [s]
    real(wp), intent(in) :: y(:)              !! the state (layout in `scene_model`)
    integer :: nq, nz
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
    self%acceleration = m%a
    self%zdd = m%zdd
    self%az = m%zdd
    self%lambda = m%lambda
    self%power = m%dissipated_power
    self%input = m%input_power
    self%h_before = 0.0_wp
    self%exact_left = 0
    call set_step(self, m, h)
    call smooth_start(self, m, t)
    call evaluate(m, t, self%q, self%v, self%z, self%zd)
    if (m%s%rows > 0) call start_offsets(self, m, t, h)
    call widen_scales(self)
  end subroutine start_method

  !> Accelerations that the step resolves: (c1 M + tangent) x = c1 M v' within the constraints. Motion much faster than the
  !> step, which a sudden load or an undeformed start would set ringing, starts in its equilibrium; slower motion keeps v' to
  !> second order.
  subroutine smooth_start(self, m, t)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: t                 !! [s]
    integer :: b, i, n, k
    logical :: bad
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
    call place_kinematics(m, self%q, self%vd)
    call row_rates(m, m%rows%phi)             ! Phi x = Phi v'
    m%rows%phi = m%rows%phi_t - m%rows%phi
    call trial_correction(self, m)
    if (.not. all(abs(self%dq) < huge(1.0_wp))) return
    self%vd = self%dq
    self%a = self%dq
    do k = 1, size(self%terms)
      associate (g => self%terms(k), d => self%now%d1*self%terms(k)%dinv)
        self%zdd(g%o + 1:g%o + g%n) = d*self%zdd(g%o + 1:g%o + g%n)
        self%az(g%o + 1:g%o + g%n) = self%zdd(g%o + 1:g%o + g%n)
      end associate
    end do
  end subroutine smooth_start

  !> In the directions that constraints hold, a = v'(t + lag h) and v = v(t) - offset h2 v'': adds these parts.
  subroutine start_offsets(self, m, t, h)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: t, h
    integer :: k, i
    self%q1 = self%q + h*self%v + 0.5_wp*h**2*self%vd       ! constraint kinematics a step later: d/dt of Phi_q v' - gamma
    self%v1 = self%v + h*self%vd
    call set_frames(m, self%q1)
    call place_kinematics(m, self%q1, self%v1)
    call constraint_values(m, t + h)
    do k = 1, size(m%s%constraints)
      associate (c => m%s%constraints(k)%item, r => m%rows)
        do i = c%first, c%first + c%rows - 1
          self%lambda1(i) = r%extra(i) + dot_product(r%na(:, i), m%p%bias(:, c%ia)) &
                            + dot_product(r%nb(:, i), m%p%bias(:, c%ib))
        end do
      end associate
    end do
    call place_kinematics(m, self%q1, self%vd)
    call row_rates(m, m%schur%r)
    self%lambda1 = (self%lambda1 + m%schur%r - m%rows%phi_t)/h
    call set_frames(m, self%q)                ! back to the factors' own configuration
    call m%schur%solve(self%lambda1)
    call apply_multipliers(m, self%lambda1, self%dq)        ! the constrained part of v''
    self%a = self%a + self%method%lag*h*self%dq
    self%v = self%v - self%method%offset*h**2*self%dq
    self%lambda1 = self%lambda
  end subroutine start_offsets

  !> Coefficients and constant factors of a step size.
  subroutine set_step(self, m, h)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in) :: h                 !! [s]
    logical :: bad
    if (abs(h - self%now%h) <= 0.0_wp .and. .not. self%stale) return
    self%stale = .false.
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

  !> Goes on with another step size: what a lags behind v' by is scaled with the step (Bruels & Arnold 2008); where
  !> constraints hold, v, v' and a are made anew, because there they carry the rounding of Phi = 0 over h and h2.
  subroutine change_step(self, m, t, h, y)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: t, h              !! [s]
    real(wp), intent(inout) :: y(:)           !! work: the projected state
    real(wp) :: ratio
    integer :: nq
    ratio = h/self%now%h
    self%a = ratio*(self%a - self%vd)
    self%az = self%zdd + ratio*(self%az - self%zdd)
    call set_step(self, m, h)
    if (m%s%rows > 0) then
      nq = m%s%nq
      call reported_state(self, m, t, y)
      self%q = y(1:nq)
      self%v = y(nq + 1:2*nq)
      self%vd = m%a
      self%lambda = m%lambda
      call place_kinematics(m, self%q, self%a)
      call row_rates(m, self%lambda1)
      self%lambda1 = self%lambda1 - m%rows%phi_t
      call m%schur%solve(self%lambda1)
      call apply_multipliers(m, self%lambda1, self%dq)
      self%a = self%vd + self%a + self%dq
      call start_offsets(self, m, t, h)
    else
      self%a = self%vd + self%a
    end if
  end subroutine change_step

  !> Tries a step to time t1; ok is false where Newton's method fails.
  subroutine try_step(self, m, t1, ok)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: t1                !! [s]
    logical, intent(out) :: ok
    logical :: slowly
    if (self%stale) call restore_factors(self, m)
    m%left = .true.
    call begin_terms(self, m)
    self%exact = self%exact_left > 0
    call predict(self)
    call newton(self, m, t1, ok, slowly)
    if (slowly .or. .not. ok) then
      if (.not. self%exact) self%exact_left = exact_steps
      if (.not. ok .and. .not. self%exact) then
        self%exact = .true.
        call predict(self)
        call newton(self, m, t1, ok, slowly)
      end if
    end if
  end subroutine try_step

  !> First guess: the accelerations of the step's start.
  subroutine predict(self)
    type(implicit_solver), intent(inout) :: self
    real(wp) :: a1
    integer :: i
    associate (s => self%now)
      do i = 1, size(self%q)
        self%vd1(i) = self%vd(i)
        a1 = (s%ad1 + s%ad)*self%vd(i) + s%aa*self%a(i)
        self%q1(i) = self%q(i) + s%h*self%v(i) + s%qa*self%a(i) + s%qa1*a1
        self%v1(i) = self%v(i) + s%va*self%a(i) + s%va1*a1
      end do
    end associate
    self%lambda1 = self%lambda
  end subroutine predict

  !> Newton iterations from the prediction. The tangent is that of the prediction; a new one where it contracts slowly.
  subroutine newton(self, m, t1, ok, slowly)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: t1                !! [s]
    logical, intent(out) :: ok                !! converged
    logical, intent(out) :: slowly            !! the contraction was poor
    real(wp) :: size_now, before, rate, goal, whole, blur
    integer :: k
    logical :: bad, fresh
    ok = .false.
    slowly = .false.
    fresh = .false.
    before = huge(1.0_wp)
    goal = 0.0_wp
    rate = 0.0_wp
    blur = noise*(1 + maxval(abs(m%p%r))/m%s%size)
    do k = 1, most_iterations
      call trial_residual(self, m, t1)
      if (k == 1 .or. slowly) then
        call trial_tangent(self, m, t1, bad)
        if (bad) return
        fresh = .true.
      else
        call trial_elastic(self, m)
      end if
      call trial_correction(self, m)
      self%iterations = self%iterations + 1
      call correct(self, size_now, whole)
      if (.not. whole <= 1.0e3_wp) return                       ! also where it is not a number
      if (k == 1) then
        self%start_error = size_now
        goal = max(rounding, min(loose, relative_goal*size_now))
      else
        rate = size_now/before
        slowly = slowly .or. (rate > slow .and. whole > blur)
      end if
      ok = size_now <= rounding
      if (k > 1) ok = ok .or. (rate < 1.0_wp .and. size_now*rate/(1 - rate) <= goal)
      if (k > 1) ok = ok .or. (rate > 0.2_wp .and. whole <= blur)     ! rounding of the residual
      if (ok) exit
      if (k > 2 .and. rate > 2.0_wp .and. size_now > loose) return
      before = size_now
    end do
    if (.not. ok) slowly = .true.
    if (ok .and. k <= 4) slowly = .false.
  end subroutine newton

  !> Adds the correction; its largest component relative to its group, and relative to the scene's size or one radian.
  subroutine correct(self, norm, whole)
    type(implicit_solver), intent(inout) :: self
    real(wp), intent(out) :: norm, whole      !! [-]
    real(wp) :: d, c1, c2
    integer :: i
    logical :: finite
    c1 = self%now%c1
    c2 = self%now%c2
    norm = 0.0_wp
    whole = 0.0_wp
    finite = .true.
    do i = 1, size(self%q)
      d = self%dq(i)
      self%q1(i) = self%q1(i) + d
      self%v1(i) = self%v1(i) + c2*d
      self%vd1(i) = self%vd1(i) + c1*d
      norm = max(norm, abs(d)*self%unit(i))
      whole = max(whole, abs(d)*self%whole(i))
      finite = finite .and. abs(d) < huge(1.0_wp)
    end do
    if (.not. finite) norm = huge(1.0_wp)
    do i = 1, size(self%lambda1)
      self%lambda1(i) = self%lambda1(i) + self%rows%y(i)
    end do
  end subroutine correct

  !> The trial step becomes the state; dissipated energy and work by the trapezoidal rule.
  subroutine accept_step(self, m, t1)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: t1                !! [s]
    real(wp) :: power, input
    integer :: k, i
    call set_frames(m, self%q1)
    call place_kinematics(m, self%q1, self%v1)
    self%removed = self%removed + removed_energy(self, m)
    call end_terms(self, m)
    power = dissipated_in_bodies(self, m)
    m%dissipated_power = 0.0_wp
    m%input_power = 0.0_wp
    call applied_forces(m, t1, self%q1, self%z, self%zd)
    power = power + m%dissipated_power
    input = m%input_power
    do k = m%s%joints + 1, size(m%s%constraints)
      i = m%s%constraints(k)%item%first
      input = input + self%lambda1(i)*m%rows%phi_t(i)
    end do
    self%dissipated = self%dissipated + 0.5_wp*self%now%h*(self%power + power)
    self%work = self%work + 0.5_wp*self%now%h*(self%input + input)
    self%power = power
    self%input = input
    do i = 1, size(self%q)
      self%a(i) = self%now%ad1*self%vd1(i) + self%now%ad*self%vd(i) + self%now%aa*self%a(i)
      self%q(i) = self%q1(i)
      self%v(i) = self%v1(i)
      self%vd(i) = self%vd1(i)
    end do
    self%lambda = self%lambda1
    self%steps = self%steps + 1
    if (self%exact_left > 0) self%exact_left = self%exact_left - 1
    call widen_scales(self)
  end subroutine accept_step

  !> Running maxima of the groups of every body.
  subroutine widen_scales(self)
    type(implicit_solver), intent(inout) :: self
    integer :: i, g
    logical :: wider
    wider = self%unit(1) <= 0.0_wp
    do i = 1, size(self%q)
      g = self%group(i)
      if (self%weight(i)*abs(self%v(i)) > self%rate_scale(g)) self%rate_scale(g) = self%weight(i)*abs(self%v(i))
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
      call evaluate(m, t, y(1:nq), y(nq + 1:2*nq), self%z, self%zd)
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
    integer :: nq, nz
    nq = size(self%q)
    nz = size(self%z)
    y(1:nq) = self%q
    y(nq + 1:2*nq) = self%v
    y(2*nq + 1:2*nq + nz) = self%z
    y(2*nq + nz + 1:2*nq + 2*nz) = self%zd
    y(2*nq + 2*nz + 1) = self%dissipated
    y(2*nq + 2*nz + 2) = self%work
  end subroutine full_state

  !> Its rates.
  pure subroutine full_rates(self, y)
    type(implicit_solver), intent(in) :: self
    real(wp), intent(inout) :: y(:)
    integer :: nq, nz
    nq = size(self%q)
    nz = size(self%z)
    y(1:nq) = self%v
    y(nq + 1:2*nq) = self%vd
    y(2*nq + 1:2*nq + nz) = self%zd
    y(2*nq + nz + 1:2*nq + 2*nz) = self%zdd
    y(2*nq + 2*nz + 1) = self%power
    y(2*nq + 2*nz + 2) = self%input
  end subroutine full_rates

  !> Estimated local error of the trial step relative to the running maxima: positions from the change of the accelerations
  !> over the step, rates from the change of that change (Geradin & Cardona, Flexible Multibody Dynamics). The accelerations
  !> are those of the equations at the ends of the step: the method's own ones carry, where constraints hold, the rounding of
  !> Phi = 0 over h2. What the elastic coordinates do faster than the step resolves is filtered out (Hairer & Wanner, Solving
  !> Ordinary Differential Equations II, IV.8).
  function estimated_error(self, m, t1) result(error)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: t1                !! end of the step [s]
    real(wp) :: error                         !! [-]
    real(wp) :: fq, fv, ratio, h
    integer :: i, g, b
    self%old(:, 1) = self%z
    self%old(:, 2) = self%zd
    self%old(:, 3) = self%zdd
    self%old(:, 4) = self%az
    call set_frames(m, self%q1)
    call place_kinematics(m, self%q1, self%v1)
    call end_terms(self, m)
    call evaluate(m, t1, self%q1, self%v1, self%z, self%zd)
    self%acceleration1 = m%a
    self%z = self%old(:, 1)
    self%zd = self%old(:, 2)
    self%zdd = self%old(:, 3)
    self%az = self%old(:, 4)
    h = self%now%h
    ratio = 0.0_wp
    if (self%h_before > 0.0_wp) ratio = h/self%h_before
    fq = self%method%local*h**2
    fv = self%method%local_rate*h*2*ratio/(1 + ratio)       ! of divided differences over unequal steps
    do i = 1, size(self%q)
      self%dq(i) = self%acceleration1(i) - self%acceleration(i)
      self%change(i) = self%dq(i) - ratio*self%before(i)
    end do
    do b = 1, size(self%b)
      i = m%s%qo(b) + 3
      g = i + self%b(b)%nf
      if (g > i) call elastic_filter(self%b(b), m%s%bodies(b), self%now%c1, self%dq(i + 1:g), self%change(i + 1:g))
    end do
    error = 0.0_wp
    do i = 1, size(self%q)
      g = self%group(i)
      error = max(error, fq*abs(self%dq(i))*self%unit(i), &
                  fv*abs(self%change(i))*self%weight(i)/max(self%rate_scale(g), self%floor(g)/h))
    end do
    if (.not. error < huge(1.0_wp)) error = huge(1.0_wp)
  end function estimated_error

  !> The estimate's memory of an accepted step.
  subroutine remember_error(self)
    type(implicit_solver), intent(inout) :: self
    self%before = self%acceleration1 - self%acceleration
    self%acceleration = self%acceleration1
    self%h_before = self%now%h
  end subroutine remember_error

  !> Saves or restores the method's state; the factors of the step are made again.
  subroutine exchange_solver(self, a)
    type(implicit_solver), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    call a%exchange(self%now%h)
    call a%exchange(self%q)
    call a%exchange(self%v)
    call a%exchange(self%vd)
    call a%exchange(self%a)
    call a%exchange(self%z)
    call a%exchange(self%zd)
    call a%exchange(self%zdd)
    call a%exchange(self%az)
    call a%exchange(self%lambda)
    call a%exchange(self%dissipated)
    call a%exchange(self%work)
    call a%exchange(self%power)
    call a%exchange(self%input)
    call a%exchange(self%removed)
    call a%exchange(self%before)
    call a%exchange(self%acceleration)
    call a%exchange(self%h_before)
    call a%exchange(self%exact_left)
    call a%exchange(self%scale)
    call a%exchange(self%rate_scale)
    call a%exchange(self%unit)
    call a%exchange(self%iterations)
    call a%exchange(self%constant_factors)
    call a%exchange(self%exact_factors)
    if (.not. a%saving) self%stale = .true.
  end subroutine exchange_solver
end module implicit_step
