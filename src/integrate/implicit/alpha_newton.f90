!> A step of the generalized-alpha method: Newton's method with the constant matrix while it contracts well and the exact one
!> otherwise, and what an accepted step leaves behind.
module alpha_newton
  use kinds, only: wp
  use alpha_state, only: alpha_solver
  use second_order_system, only: full_block_contraction, full_block_steps, near_length, second_order_ode
  use step_control, only: error_norm
  implicit none (type, external)
  private
  public :: solve_trial, take_trial, prepare_step, find_offsets, find_offset

  integer, parameter :: most_iterations = 12       !! Newton iterations of a step
  real(wp), parameter :: relative_goal = 1.0e-5_wp !! Newton's error, of the first correction [-]
  real(wp), parameter :: largest_goal = 1.0e-9_wp  !! the same, of the groups' sizes [-]
  real(wp), parameter :: least_goal = 1.0e-16_wp   !! smaller corrections are rounding, of the groups' sizes [-]
  real(wp), parameter :: noise = 1.0e-13_wp        !! smaller corrections that do not shrink are rounding, of the scene's size [-]
  real(wp), parameter :: error_share = 1.0e-3_wp   !! Newton's error, of the step's own error of positions [-]
  real(wp), parameter :: last_digits = 4*epsilon(1.0_wp)   !! smaller corrections do not change positions, of the scene's size [-]
  integer, parameter :: most_age = 10              !! steps for which a measured contraction is used

contains

  !> Tries a step to time t1; ok is false where Newton's method fails.
  subroutine solve_trial(self, system, norm, t1, same_start, ok)
    type(alpha_solver), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    type(error_norm), intent(in) :: norm
    real(wp), intent(in) :: t1                !! [s]
    logical, intent(in) :: same_start   !! the trial before was a step of another length from the same state
    logical, intent(out) :: ok
    real(wp) :: share                         ! of the change in that trial, of which the first guess is made [-]
    logical :: slowly, exact
    integer :: k
    do k = 1, self%nq
      associate (g => norm%group(k))
        if (.not. norm%steady(g)) self%by_group(k) = 1/max(norm%largest(g), norm%floor(g))
      end associate
    end do
    share = 0.0_wp
    if (same_start) share = self%now%h/self%h_tried
    self%h_tried = self%now%h
    if (self%needs_factors) call prepare_step(self, system, 0.0_wp, ok)
    exact = self%newton%exact_left > 0
    call newton(self, system, t1, share, exact, .false., ok, slowly)
    if ((slowly .or. .not. ok) .and. .not. exact) then
      self%newton%exact_left = full_block_steps
      if (.not. ok) then
        exact = .true.
        call newton(self, system, t1, 0.0_wp, exact, .false., ok, slowly)
      end if
    end if
    if (.not. ok .and. system%rows > 0) call newton(self, system, t1, 0.0_wp, exact, .true., ok, slowly)   ! a singular position
    if (.not. ok) return
    associate (nq => self%nq, z => self%nq + 1)
      call system%deformations(t1, self%x1(1:nq), self%v1(1:nq), self%dx(z:))
      associate (first => size(self%x) - system%linear + 1, c2 => self%now%c2)   ! linear states, whose gain is 1
        if (system%linear > 0) self%dx(first:) = system%linear_part(c2, self%dx(first:) + c2*self%x1(first:) - self%v1(first:))
      end associate
      self%dx(z:) = self%gain*(self%dx(z:) - self%x1(z:) - system%viscosity*self%v1(z:) - system%inertia*self%vd1(z:))
      call add_correction(self, z, size(self%x))
    end associate
    call close_rates(self, system, t1, ok)
  end subroutine solve_trial

  !> Puts rates and accelerations of the trial step onto phi' = 0 and phi'' = 0, so that nothing is left of what the method's
  !> sequences carry in the constrained directions (theory.md, section 7). Accelerations are off by c1 h times the error of the
  !> offset from which the step began; the next step's offset is without that error, in the directions that are constrained now.
  !> Rows that nearly depend on others are regularised and stay open: then the offset is found anew (take_trial).
  subroutine close_rates(self, system, t1, ok)
    type(alpha_solver), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: t1                !! [s]
    logical, intent(out) :: ok
    logical :: moves_little(3)
    ok = .true.
    if (system%rows == 0) return
    associate (nq => self%nq, v1 => self%v1, vd1 => self%vd1, h => self%now%h, gap => self%gaps)
      call system%gaps(t1, self%x1(1:nq), v1(1:nq), vd1(1:nq), self%offset, gap)
      gap(:, 3) = gap(:, 2)/(self%now%c1*h) - gap(:, 3)
      call close_rows(self, system, self%x1, gap(:, 1:), [h, h**2, h], moves_little)
      ok = all(moves_little(1:2))
      if (.not. ok) return
      v1(1:nq) = v1(1:nq) + self%closing(:, 1)
      vd1(1:nq) = vd1(1:nq) + self%closing(:, 2)
      self%lambda1 = self%lambda1 + self%closing_lambda(:, 2)/self%now%c1
      self%offset1 = merge(self%closing(:, 3), 0.0_wp, moves_little(3))
    end associate
  end subroutine close_rates

  !> By how much the rates of index-3 solutions are off where a step begins: method%offset h2 v'' along the constraints. The rows'
  !> kinematics a step later give v'', without what phi'' = 0 is open by. Gaps are asked for at the state itself last.
  subroutine find_offset(self, system, t)
    type(alpha_solver), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: t                 !! [s]
    logical :: moves_little(1)
    if (system%rows == 0) return
    associate (nq => self%nq, gap => self%gaps, h => self%now%h, a => self%vd(1:self%nq))
      self%x1(1:nq) = self%x(1:nq) + h*self%v(1:nq) + 0.5_wp*h**2*a
      self%v1(1:nq) = self%v(1:nq) + h*a
      call system%gaps(t + h, self%x1(1:nq), self%v1(1:nq), a, a, gap(:, 0:2))
      gap(:, 3) = gap(:, 2)
      call system%gaps(t, self%x(1:nq), self%v(1:nq), a, a, gap(:, 0:2))
      gap(:, 3) = self%method%offset*h*(gap(:, 3) - gap(:, 2))
      call close_rows(self, system, self%x, gap(:, 3:3), [h], moves_little)
      self%offset = merge(self%closing(:, 1), 0.0_wp, moves_little(1))
    end associate
  end subroutine find_offset

  !> The motions that close the rows' gaps, and their multipliers: one for each column of gaps. They come of the present matrix, so
  !> that stiff coordinates follow in balance. One that moves more than the scene's size closes rows that fix nothing there.
  subroutine close_rows(self, system, x, gap, to_positions, moves_little)
    type(alpha_solver), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in), contiguous :: x(:)       !! (nq + nz) [m, rad]
    real(wp), intent(in), contiguous :: gap(:, :)  !! (rows, columns) [m] or a derivative
    real(wp), intent(in) :: to_positions(:)   !! (columns) makes positions of them [1, s, s2]
    logical, intent(out) :: moves_little(:)   !! (columns)
    integer :: k
    associate (n => size(gap, 2))
      call system%gap_correction(x(1:self%nq), gap, self%closing(:, 1:n), self%closing_lambda(:, 1:n))
      do k = 1, n
        moves_little(k) = count(.not. to_positions(k)*abs(self%closing(:, k))*self%by_scene <= system%rounding_scale) == 0
      end do
    end associate
  end subroutine close_rows

  !> Makes what depends on the present step's size alone; so it is made again after a restart.
  subroutine prepare_step(self, system, near, ok)
    type(alpha_solver), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: near              !! factors of constants so near serve again, of c1 [-]
    logical, intent(out) :: ok
    self%needs_factors = .false.
    call system%prepare([cmplx(self%now%c1, 0.0_wp, wp)], [cmplx(self%now%c2, 0.0_wp, wp)], near, ok)
    associate (inertia => system%inertia*self%now%c1)
      self%gain = 1/(1 + system%viscosity*self%now%c2 + inertia)
      self%resolved = merge(inertia*self%gain, 1 - self%gain, inertia > 0.0_wp)
    end associate
    self%resolved(self%nz - system%linear + 1:) = 1.0_wp
  end subroutine prepare_step

  !> Internal variables at the end of a step at zero deformation, from their predictions: last part of self%dx.
  subroutine find_offsets(self, system, z, zd, zdd)
    type(alpha_solver), intent(inout) :: self
    class(second_order_ode), intent(in) :: system
    real(wp), intent(in) :: z(:), zd(:), zdd(:)   !! (nz) predictions [m, rad] and per second
    associate (offset => self%dx(self%nq + 1:))
      offset = z - self%gain*(z + system%viscosity*zd + system%inertia*zdd)
      associate (first => self%nz - system%linear + 1)
        offset(first:) = self%now%c2*z(first:) - zd(first:)
      end associate
    end associate
  end subroutine find_offsets

  !> First guess: the accelerations of the step's start, and a share of their change in the trial before.
  pure subroutine predict(self, share)
    type(alpha_solver), intent(inout) :: self
    real(wp), intent(in) :: share             !! [-]
    real(wp) :: a, a1, change                 ! [m/s2, rad/s2]
    integer :: i
    associate (s => self%now, x1 => self%x1, v1 => self%v1)
      do i = 1, size(self%x)
        change = share*(self%vd1(i) - self%vd(i))
        self%vd1(i) = self%vd(i)
        a = self%vd(i) + s%h*self%lag(i)
        a1 = self%vd(i) + s%aa*s%h*self%lag(i)
        x1(i) = self%x(i) + s%h*self%v(i) + s%qa*a + s%qa1*a1
        v1(i) = self%v(i) + s%va*a + s%va1*a1
        if (share <= 0.0_wp .or. i > self%nq) cycle
        self%vd1(i) = self%vd1(i) + change
        v1(i) = v1(i) + s%c2/s%c1*change
        x1(i) = x1(i) + change/s%c1
      end do
      do i = 1, self%nq
        x1(i) = x1(i) - s%h*self%offset(i)
        v1(i) = v1(i) - self%offset(i)
      end do
    end associate
    if (share > 0.0_wp) self%lambda1 = self%lambda + share*(self%lambda1 - self%lambda)
    if (share <= 0.0_wp) self%lambda1 = self%lambda
  end subroutine predict

  !> Newton iterations from the prediction. The matrix is that of the prediction; a new one where it contracts slowly.
  subroutine newton(self, system, t1, share, exact, regularise, ok, slowly)
    type(alpha_solver), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: t1                !! [s]
    real(wp), intent(in) :: share             !! as `predict` has it [-]
    logical, intent(in) :: exact              !! whether the exact matrix is used
    logical, intent(in) :: regularise         !! whether rows that nearly depend on others are regularised
    logical, intent(out) :: ok                !! converged
    logical, intent(out) :: slowly            !! the contraction was poor
    real(wp) :: norm, before, rate, goal, scene_norm, before_scene, scale, rounding
    integer :: k
    logical :: good
    ok = .false.
    slowly = .false.
    before = huge(1.0_wp)
    before_scene = huge(1.0_wp)
    goal = 0.0_wp
    rate = 0.0_wp
    scale = 1.0_wp
    call predict(self, share)
    associate (nq => self%nq, x1 => self%x1, v1 => self%v1, vd1 => self%vd1)
      call find_offsets(self, system, x1(nq + 1:), v1(nq + 1:), vd1(nq + 1:))
      do k = 1, most_iterations
        call system%residual(t1, x1(1:nq), v1(1:nq), vd1(1:nq), self%dx(nq + 1:), self%lambda1, .true., self%r, self%gaps(:, 0))
        if ((k == 1 .and. abs(share - 1) > near_length) .or. slowly) then
          call system%renew(x1(1:nq), v1(1:nq), vd1(1:nq), self%lambda1, exact, regularise, good, self%r)
          if (exact) self%newton%factors(2) = self%newton%factors(2) + system%blocks
          if (.not. good) return
        end if
        if (k == 1) scale = system%rounding_scale
        rounding = noise*scale
        self%dlambda = self%lambda1
        call system%correction(self%r, self%gaps(:, 0), self%dx(1:nq), self%dlambda)
        self%newton%iterations = self%newton%iterations + 1
        call measure_correction(self, norm, scene_norm)
        call add_correction(self, 1, nq)
        self%lambda1 = self%lambda1 + self%dlambda
        if (.not. scene_norm <= 1.0e3_wp*scale) return                 ! also where it is not a number
        if (k == 1) then
          goal = max(least_goal, min(largest_goal, relative_goal*norm))
          ok = one_is_enough(self, norm, scene_norm, exact, system)
        else
          rate = norm/before
          slowly = slowly .or. (rate > full_block_contraction .and. scene_norm > rounding)
          if (k == 2) then                      ! the contraction from the first to the second correction
            self%newton%contraction = max(rate, scene_norm/before_scene)
            self%newton%first = before
            self%newton%exact = exact
            self%newton%steps = 0
          end if
        end if
        ok = ok .or. norm <= least_goal
        if (k > 1 .and. .not. ok) ok = converged(k, rate, norm, goal, scene_norm, rounding, max(system%least_pivot, system%shift))
        if (ok) exit
        if (k > 2 .and. rate > 2.0_wp .and. norm > largest_goal) return
        before = norm
        before_scene = scene_norm
      end do
    end associate
    if (.not. ok) slowly = .true.
    if (ok .and. k <= 4) slowly = .false.
  end subroutine newton

  !> Whether a second or later correction leaves an error below the goal, or is rounding of the residual.
  pure logical function converged(k, rate, norm, goal, scene_norm, rounding, pivot) result(yes)
    integer, intent(in) :: k                  !! number of the correction
    real(wp), intent(in) :: rate              !! its size over that of the one before [-]
    real(wp), intent(in) :: norm, goal        !! its size, of the groups' sizes, and that of an error that does no harm [-]
    real(wp), intent(in) :: scene_norm, rounding   !! its size, of the scene's size, and that of rounding [-]
    real(wp), intent(in) :: pivot             !! least one of the rows, or the shift that regularises them [-]
    yes = rate < 1.0_wp .and. norm*rate <= goal*(1 - rate)
    yes = yes .or. (rate > 0.2_wp .and. scene_norm <= rounding)
    if (k > 3) yes = yes .or. (abs(rate - 1) < 0.5_wp .and. scene_norm <= rounding/sqrt(pivot))
  end function converged

  !> Whether the first correction leaves an error that needs no second one: the contraction measured within the last steps says
  !> that what is left is a small part of the step's own error, or below the rounding of positions (Brown, Hindmarsh & Petzold
  !> 1994, on the convergence test of DASPK). The step's own error is what the second difference of the accelerations moves
  !> (Geradin & Cardona, Flexible Multibody Dynamics).
  logical function one_is_enough(self, norm, scene_norm, exact, system) result(yes)
    type(alpha_solver), intent(inout) :: self
    real(wp), intent(in) :: norm              !! first correction, of the groups' sizes [-]
    real(wp), intent(in) :: scene_norm   !! the same, of the scene's size [-]
    logical, intent(in) :: exact
    class(second_order_ode), intent(in) :: system
    real(wp) :: rate, d, ratio, change, scene_change
    integer :: i
    yes = .false.
    associate (n => self%newton)
      n%steps = n%steps + 1
      if (n%steps > most_age .or. n%exact .neqv. exact) return
      if (system%weak_rows .or. .not. (n%h > 0.0_wp .and. n%first > 0.0_wp)) return
      rate = n%contraction*max(1.0_wp, norm/n%first)
      yes = rate*scene_norm <= last_digits*system%rounding_scale
      if (yes .or. rate > 0.1_wp*error_share) return
      ratio = self%now%h/n%h
      change = 0.0_wp
      scene_change = 0.0_wp
      do i = 1, self%nq
        d = abs(self%vd1(i) - self%vd(i) - ratio*n%change(i))/self%now%c1
        change = max(change, d*self%by_group(i))
        scene_change = max(scene_change, d*self%by_scene(i))
      end do
    end associate
    yes = rate*norm <= error_share*change .and. rate*scene_norm <= error_share*scene_change
  end function one_is_enough

  !> The largest component of the correction relative to its group, and relative to the scene's size or one radian.
  pure subroutine measure_correction(self, norm, scene_norm)
    type(alpha_solver), intent(in) :: self
    real(wp), intent(out) :: norm, scene_norm      !! [-]
    real(wp) :: d
    integer :: i
    logical :: finite
    norm = 0.0_wp
    scene_norm = 0.0_wp
    finite = .true.
    do i = 1, self%nq
      d = abs(self%dx(i))
      norm = max(norm, d*self%by_group(i))
      scene_norm = max(scene_norm, d*self%by_scene(i))
      finite = finite .and. d < huge(1.0_wp)
    end do
    if (.not. finite) norm = huge(1.0_wp)
  end subroutine measure_correction

  !> Moves the trial step along the method's relations.
  pure subroutine add_correction(self, first, last)
    type(alpha_solver), intent(inout) :: self
    integer, intent(in) :: first, last
    integer :: i
    do i = first, last
      self%x1(i) = self%x1(i) + self%dx(i)
      self%v1(i) = self%v1(i) + self%now%c2*self%dx(i)
      self%vd1(i) = self%vd1(i) + self%now%c1*self%dx(i)
    end do
  end subroutine add_correction

  !> The trial step becomes the state; dissipated energy and work by the trapezoidal rule.
  subroutine take_trial(self, system, t1)
    type(alpha_solver), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: t1                !! [s]
    integer :: i
    associate (nq => self%nq, s => self%now)
      call system%powers(t1, self%x1(1:nq), self%v1(1:nq), self%lambda1, self%x1(nq + 1:), self%v1(nq + 1:), self%energy%next)
      self%energy%removed = self%energy%removed + removed_energy(self, system)
      self%energy%sums = self%energy%sums + 0.5_wp*s%h*(self%energy%powers + self%energy%next)
      self%energy%powers = self%energy%next
      self%newton%h = s%h
      self%newton%change = self%vd1(1:nq) - self%vd(1:nq)
      do i = 1, size(self%x)
        self%lag(i) = s%aa*self%lag(i) - (1 - s%ad1)/s%h*(self%vd1(i) - self%vd(i))
        self%x(i) = self%x1(i)
        self%v(i) = self%v1(i)
        self%vd(i) = self%vd1(i)
      end do
      self%lambda = self%lambda1
      self%offset = self%offset1
    end associate
    if (self%newton%exact_left > 0) self%newton%exact_left = self%newton%exact_left - 1
    if (system%weak_rows) call find_offset(self, system, t1)
  end subroutine take_trial

  !> The energy that the method itself takes out in a step [J]. With M the mass matrix and bars for means of both ends,
  !>
  !>   kinetic + potential change = vbar^T M (dv - h abar) + abar^T M (h vbar - dq) + what forces and damping do (trapezoidal)
  !>
  !> where a = v' are the accelerations of the equations: the first two terms vanish for the trapezoidal rule (spectral radius
  !> 1) and are the method's numerical damping otherwise.
  real(wp) function removed_energy(self, system) result(energy)
    type(alpha_solver), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp) :: h
    integer :: i
    h = self%now%h
    do i = 1, size(self%x)
      self%energy%pairs(i, 1) = 0.5_wp*(self%v(i) + self%v1(i))
      self%energy%pairs(i, 3) = 0.5_wp*(self%vd(i) + self%vd1(i))
      self%energy%pairs(i, 2) = self%v1(i) - self%v(i) - h*self%energy%pairs(i, 3)
      self%energy%pairs(i, 4) = h*self%energy%pairs(i, 1) - (self%x1(i) - self%x(i))
    end do
    energy = -system%mass_product(self%x1(1:self%nq), self%energy%pairs)
  end function removed_energy
end module alpha_newton
