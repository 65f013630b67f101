!> A step of the Radau IIA method: the rates of the three stages are the unknowns, positions and accelerations follow from them,
!>
!>   Q_i = q + h sum_j a_ij V_j      A_i = sum_j w_ij (V_j - v)/h      r(Q, V, A, Z, Lambda) = 0      phi'(Q, V) = 0
!>
!> with W = A^-1: constraints hold at the level of rates (index 2), and internal variables are those that the same relations give
!> exactly for the stages' deformations. Simplified Newton iterations in the eigenvectors of W (Hairer & Wanner, IV.8).
module radau_stages
  use kinds, only: wp, ip
  use archive, only: value_archive
  use radau_method, only: radau_tableau, lagrange_weights
  use second_order_system, only: full_block_contraction, full_block_steps, near_length, second_order_ode
  use step_control, only: error_norm, value_rounding
  implicit none (type, external)
  private
  public :: set_up_stages, start_stages, solve_stages, exchange_stages

  integer, parameter :: most_iterations = 10       !! Newton iterations of a step
  real(wp), parameter :: slow = 0.3_wp             !! contraction above which matrices are renewed [-]
  real(wp), parameter :: noise = 1.0e-11_wp        !! corrections below that do not shrink are rounding, of the scales [-]
  real(wp), parameter :: fixed_goal = 1.0e-9_wp      !! fixed steps: last correction of Newton's method, of the scales [-]
  real(wp), parameter :: fixed_reduction = 1.0e-7_wp   !! fixed steps: the same, of the first correction [-]
  real(wp), parameter, public :: most_growth = 5.0_wp  !! of a step: up to it the last step's polynomial is extrapolated [-]

  !> Internal variables.
  type, public :: inner_values
    real(wp), allocatable :: viscosity(:)    !! (nz) [s]
    real(wp), allocatable :: inertia(:)      !! (nz) 0: of first order [s2]
    real(wp), allocatable :: z0(:), zd0(:)   !! (nz) at the start of the step [m, rad] and per second
    real(wp), allocatable :: z(:, :), zd(:, :)           !! (nz, 3) of the stages [m, rad] and per second
    real(wp), allocatable :: dz(:, :), u(:, :)           !! (nz, 3) z - z0 and zd - zd0, without the rounding of z [m, rad], ...
    real(wp), allocatable :: delta0(:), delta(:, :)      !! (nz), (nz, 3) deformations that they follow [m, rad]
    real(wp) :: h = 0.0_wp                   !! step of the following [s]
    real(wp), allocatable :: gain(:, :, :)   !! (nz, 3, 3) of each stage, third, by the deformation of each, second [-]
    real(wp), allocatable :: start(:, :)     !! (nz, 3) of each stage by the rate at the start [s]
    real(wp), allocatable :: real_gain(:)    !! (nz) 1/(1 + viscosity c2 + inertia c2**2) of the real constant [-]
    real(wp), allocatable :: rate_gap(:)     !! (nz) rates at the start less those of the embedded formula [m/s, rad/s]
    real(wp), allocatable :: driving(:)      !! (nz) deformation less z0 that its rates and accelerations need [m, rad]
  end type inner_values

  !> The stages.
  type, public :: radau_stage_values
    type(radau_tableau) :: method
    integer :: nq = 0, nz = 0, nzd = 0, rows = 0
    type(inner_values) :: inner
    real(wp) :: t = 0.0_wp, h = 0.0_wp       !! start and size of the step [s]
    real(wp), allocatable :: q0(:), v0(:), a0(:)         !! (nq) state at its start [m, rad], rates, accelerations
    real(wp), allocatable :: powers0(:)      !! (quadratures) there [W]
    real(wp), allocatable :: q(:, :), v(:, :), a(:, :)   !! (nq, 3) [m, rad], rates, accelerations
    real(wp), allocatable :: u(:, :)         !! (nq, 3) V - v [m/s, rad/s]
    real(wp), allocatable :: lambda(:, :)    !! (rows, 3) [N]
    real(wp), allocatable :: last_v(:, :)    !! (nq, 0:3) rates of the last step: start and stages [m/s, rad/s]
    real(wp), allocatable :: last_lambda(:, :)    !! (rows, 3) [N]
    real(wp) :: last_h = 0.0_wp              !! its size, 0: none [s]
    real(wp) :: eta = 1.0_wp                 !! Theta/(1 - Theta) of the last step, Theta Newton's contraction [-]
    type(stage_work), allocatable :: work
    integer :: full_block_left = 0           !! steps that still factor full elastic blocks
    integer(ip) :: iterations = 0, residuals = 0, renewals = 0
  end type radau_stage_values

  !> Work space.
  type, public :: stage_work
    real(wp), allocatable :: r(:, :), gap(:, :)          !! (nq, 3), (rows, 3) residuals [N, N m], [m/s]
    real(wp), allocatable :: dq(:, :), dv(:, :)          !! (nq, 3) corrections [m, rad], [m/s, rad/s]
    complex(wp), allocatable :: r_part(:), gap_part(:), dq_part(:), dlambda_part(:)   !! complex part [N, m/s, m, N, ...]
    real(wp), allocatable :: r_real(:), gap_real(:), dlambda(:)   !! real part [N, N m], [m/s], [N]
    real(wp), allocatable :: held(:, :)       !! (rows, 3) at which the iteration holds what rows leave open of the multipliers [N]
    real(wp), allocatable :: mu(:, :)         !! (rows, 1) of what puts the end onto the constraints [N] and its derivatives
    real(wp), allocatable :: rounding(:)     !! (n) what rounding of positions makes of them [unit of each unknown]
    real(wp), allocatable :: e(:), y(:)      !! (n) [unit of each unknown]
    real(wp), allocatable :: q(:), v(:), a(:), rate_gap(:)   !! (nq) of the error estimate [m, rad], rates, accelerations, rates
    real(wp), allocatable :: pairs(:, :)     !! (nq + nz, 4) of the energy removed [any]
  end type stage_work

contains

  !> Work space for a system.
  subroutine set_up_stages(self, system, method)
    type(radau_stage_values), intent(out) :: self
    class(second_order_ode), intent(in) :: system
    type(radau_tableau), intent(in) :: method
    self%method = method
    self%nq = system%nq
    self%nz = system%nz
    self%nzd = system%nzd
    self%rows = system%rows
    associate (nq => self%nq, nz => self%nz, rows => self%rows)
      allocate (self%q0(nq), self%v0(nq), self%a0(nq), self%q(nq, 3), self%v(nq, 3), self%a(nq, 3), self%u(nq, 3), &
                self%lambda(rows, 3), self%last_v(nq, 0:3), self%last_lambda(rows, 3), self%powers0(system%quadratures), &
                source=0.0_wp)
      associate (n => self%inner)
        allocate (n%z0(nz), n%zd0(nz), n%delta0(nz), n%z(nz, 3), n%zd(nz, 3), n%dz(nz, 3), n%u(nz, 3), n%delta(nz, 3), &
                  n%gain(nz, 3, 3), n%start(nz, 3), n%real_gain(nz), n%rate_gap(nz), n%driving(nz), source=0.0_wp)
      end associate
      allocate (self%work)
      associate (w => self%work)
        allocate (w%r(nq, 3), w%gap(rows, 3), w%dq(nq, 3), w%dv(nq, 3), w%e(system%n), source=0.0_wp)
        allocate (w%r_part(nq), w%gap_part(rows), w%dq_part(nq), w%dlambda_part(rows), w%r_real(nq), w%gap_real(rows), &
                  w%dlambda(rows), w%mu(rows, 1), w%held(rows, 3))
        w%y = w%e
        w%rounding = w%e
        allocate (w%q(nq), w%v(nq), w%a(nq), w%rate_gap(nq), w%pairs(nq + nz, 4), source=0.0_wp)
      end associate
    end associate
    self%inner%viscosity = system%viscosity
    self%inner%inertia = system%inertia
  end subroutine set_up_stages

  !> Starts at a state, where there is no last step: accelerations and multipliers of the equations.
  subroutine start_stages(self, system, t)
    type(radau_stage_values), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: t                !! [s]
    real(wp) :: a(self%nq + self%nz)         ! [m/s2, rad/s2]
    call system%accelerations(t, self%q0, self%v0, self%inner%z0, self%inner%zd0, a, self%last_lambda(:, 3), self%powers0)
    self%residuals = self%residuals + 1
    self%a0 = a(1:self%nq)
    self%last_h = 0.0_wp
    self%eta = 1.0_wp
  end subroutine start_stages

  !> First guess of the stages: the polynomial of the last trial, where that was a step of another length from the same state. Else
  !> the polynomial of the last step is extrapolated, unless that step was a small piece.
  subroutine predict_stages(self, system, t, h, same_start)
    type(radau_stage_values), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: t, h             !! [s]
    logical, intent(in) :: same_start   !! the last trial was such a step
    real(wp) :: w(4), w3(3), share(3, 3), lambda(3, 3)
    integer :: i
    if (same_start) then
      do i = 1, 3
        w = lagrange_weights([0.0_wp, self%method%c], self%method%c(i)*h/self%h)
        share(:, i) = w(2:)
        lambda(:, i) = lagrange_weights(self%method%c, self%method%c(i)*h/self%h)
      end do
      do i = 1, self%nq
        self%u(i, :) = matmul(self%u(i, :), share)
      end do
      do i = 1, self%rows
        self%lambda(i, :) = matmul(self%lambda(i, :), lambda)
      end do
    end if
    self%t = t
    self%h = h
    if (self%nz > 0) call system%deformations(t, self%q0, self%v0, self%inner%delta0)
    do i = self%nzd + 1, self%nz - system%linear
      self%inner%zd0(i) = (self%inner%delta0(i) - self%inner%z0(i))/self%inner%viscosity(i)
    end do
    if (same_start) return
    do i = 1, 3
      if (h <= (1 + near_length)*most_growth*self%last_h) then
        w = lagrange_weights([0.0_wp, self%method%c], 1 + self%method%c(i)*h/self%last_h)
        self%u(:, i) = matmul(self%last_v, w) - self%v0
        w3 = lagrange_weights(self%method%c, 1 + self%method%c(i)*h/self%last_h)
        self%lambda(:, i) = matmul(self%last_lambda, w3)
      else
        self%u(:, i) = self%method%c(i)*h*self%a0
        self%lambda(:, i) = self%last_lambda(:, 3)
      end if
    end do
  end subroutine predict_stages

  !> Positions, rates, accelerations and internal variables of the stages from u.
  subroutine stage_states(self, system)
    type(radau_stage_values), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    integer :: i, k
    associate (h => self%h, a => self%method%a, w => self%method%w, u => self%u)
      do i = 1, 3
        do k = 1, self%nq
          self%v(k, i) = self%v0(k) + u(k, i)
          self%q(k, i) = self%q0(k) + h*(self%method%c(i)*self%v0(k) + (a(i, 1)*u(k, 1) + a(i, 2)*u(k, 2) + a(i, 3)*u(k, 3)))
          self%a(k, i) = (w(i, 1)*u(k, 1) + w(i, 2)*u(k, 2) + w(i, 3)*u(k, 3))/h
        end do
      end do
      if (self%nz == 0) return
      do i = 1, 3
        call system%deformations(self%t + self%method%c(i)*h, self%q(:, i), self%v(:, i), self%inner%delta(:, i))
      end do
    end associate
    call internal_stages(self, system)
  end subroutine stage_states

  !> Gains of the internal variables: their equations are linear and decouple in the eigenvectors.
  subroutine solve_internal(self)
    type(radau_stage_values), intent(inout) :: self
    complex(wp) :: g(2), c2(2), x
    integer :: i, j, k, p
    associate (m => self%method, n => self%inner)
      n%h = self%h
      c2 = m%mu/self%h
      do i = 1, self%nz
        g = 1/(1 + n%viscosity(i)*c2 + n%inertia(i)*c2**2)
        n%real_gain(i) = real(g(1), wp)
        do j = 1, 3
          n%start(i, j) = 0.0_wp
          n%gain(i, :, j) = 0.0_wp
          do p = 1, 2
            do k = 1, 3
              x = m%to(j, p)*g(p)*m%from(p, k)
              n%gain(i, k, j) = n%gain(i, k, j) + real(x, wp)
              n%start(i, j) = n%start(i, j) + n%inertia(i)*real(x*c2(p), wp)
            end do
          end do
        end do
      end do
    end associate
  end subroutine solve_internal

  !> Internal variables of the stages, their rates as those of all coordinates.
  subroutine internal_stages(self, system)
    type(radau_stage_values), intent(inout) :: self
    class(second_order_ode), intent(in) :: system
    integer :: i, j
    associate (w => self%method%w, n => self%inner)
      if (abs(n%h - self%h) > 0.0_wp) call solve_internal(self)
      do j = 1, 3
        do i = 1, self%nz
          n%dz(i, j) = n%start(i, j)*n%zd0(i) + n%gain(i, 1, j)*(n%delta(i, 1) - n%z0(i)) &
                       + n%gain(i, 2, j)*(n%delta(i, 2) - n%z0(i)) + n%gain(i, 3, j)*(n%delta(i, 3) - n%z0(i))
          n%z(i, j) = n%z0(i) + n%dz(i, j)
        end do
      end do
      if (system%linear > 0) call linear_stages(self, system, self%nz - system%linear + 1)
      do j = 1, 3
        do i = 1, self%nz
          n%zd(i, j) = (w(j, 1)*n%dz(i, 1) + w(j, 2)*n%dz(i, 2) + w(j, 3)*n%dz(i, 3))/self%h
          n%u(i, j) = n%zd(i, j) - n%zd0(i)
        end do
      end do
    end associate
  end subroutine internal_stages

  !> Linear states of the stages: with X their parts by the eigenvectors, (mu/h - A) X = parts of f + mu/h z0.
  subroutine linear_stages(self, system, first)
    type(radau_stage_values), intent(inout) :: self
    class(second_order_ode), intent(in) :: system
    integer, intent(in) :: first             !! of them
    complex(wp) :: x(system%linear)          ! [any]
    integer :: j, p
    associate (m => self%method, n => self%inner)
      do j = 1, 3
        n%z(first:, j) = 0.0_wp
      end do
      do p = 1, 2
        associate (c => m%mu(p)/self%h)
          x = sum(m%from(p, :))*c*n%z0(first:)
          do j = 1, 3
            x = x + m%from(p, j)*n%delta(first:, j)
          end do
          call system%solve_linear(c, x)
        end associate
        do j = 1, 3
          n%z(first:, j) = n%z(first:, j) + real(m%to(j, p)*x, wp)
        end do
      end do
      do j = 1, 3
        n%dz(first:, j) = n%z(first:, j) - n%z0(first:)
      end do
    end associate
  end subroutine linear_stages

  !> The stages of a step from t; ok is false where Newton's method fails, also in a second trial, with dependent
  !> rows of the constraints regularised as near a singular position.
  subroutine solve_stages(self, system, norm, t, h, tolerance, same_start, ok)
    type(radau_stage_values), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    type(error_norm), intent(inout) :: norm
    real(wp), intent(in) :: t, h             !! [s]
    real(wp), intent(in) :: tolerance        !! 0: fixed steps [-]
    logical, intent(in) :: same_start   !! the last trial was a step of another length from the same state
    logical, intent(out) :: ok
    logical :: renew_first
    renew_first = .not. (same_start .and. abs(h - self%h) <= near_length*h)
    call predict_stages(self, system, t, h, same_start)
    call newton(self, system, norm, tolerance, .false., renew_first, ok)
    if (ok .or. self%rows == 0) return
    call predict_stages(self, system, t, h, .false.)
    call newton(self, system, norm, tolerance, .true., .true., ok)
  end subroutine solve_stages

  !> Newton iterations from the prediction. Over a singular position a row's direction changes sign between the stages: with one
  !> matrix for all, corrections along it grow. Regularised rows leave its multiplier at the prediction there.
  subroutine newton(self, system, norm, tolerance, regularise, renew_first, ok)
    type(radau_stage_values), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    type(error_norm), intent(inout) :: norm
    real(wp), intent(in) :: tolerance        !! 0: fixed steps [-]
    logical, intent(in) :: regularise
    logical, intent(in) :: renew_first   !! the first iteration renews the matrices
    logical, intent(out) :: ok
    real(wp) :: d, before, theta, eta, goal
    integer :: k
    logical :: renewed, slowly
    ok = .false.
    renewed = .false.
    slowly = .false.
    before = huge(1.0_wp)
    theta = 0.0_wp
    eta = max(self%eta, epsilon(1.0_wp))**0.8_wp
    goal = fixed_goal
    self%work%held = merge(self%lambda, 0.0_wp, regularise)
    if (tolerance > 0.0_wp) goal = tolerance*max(10*epsilon(1.0_wp)/tolerance, min(0.03_wp, sqrt(tolerance)))
    do k = 1, most_iterations
      call stage_residuals(self, system)
      if ((k == 1 .and. renew_first) .or. (theta > slow .and. .not. renewed)) then
        renewed = k > 1
        if (renewed) self%full_block_left = full_block_steps
        call renew(self, system, regularise, ok)
        if (.not. ok) return
        ok = .false.
        before = huge(1.0_wp)
      end if
      call correct(self, system)
      d = size_of_correction(self, system, norm, goal)
      if (.not. d < 1.0e3_wp) exit
      if (k == 1 .and. .not. tolerance > 0.0_wp) goal = min(goal, fixed_reduction*d)
      if (before < huge(1.0_wp)) then
        theta = d/max(before, tiny(1.0_wp))
        eta = 1/epsilon(1.0_wp)
        if (theta < 1.0_wp) eta = theta/(1 - theta)
        slowly = slowly .or. (theta > full_block_contraction .and. d > noise)
        ok = theta > slow .and. d <= noise .and. (theta < 1.0_wp .or. regularise)
        if (theta >= 1.0_wp .and. renewed .and. .not. ok) exit
      end if
      ok = ok .or. eta*d <= goal .or. d <= epsilon(1.0_wp)
      if (ok) exit
      before = d
    end do
    self%eta = merge(eta, 1.0_wp, ok)
    self%full_block_left = max(self%full_block_left - 1, merge(full_block_steps, 0, slowly .or. .not. ok))
    if (ok) call stage_states(self, system)
  end subroutine newton

  !> Residuals of the three stages, the middle one last, where matrices are made; their parts by the eigenvectors.
  subroutine stage_residuals(self, system)
    type(radau_stage_values), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp) :: f(3)
    integer :: i, k
    call stage_states(self, system)
    do k = 1, 3
      i = merge(2, merge(1, 3, k == 1), k == 3)
      call system%residual(self%t + self%method%c(i)*self%h, self%q(:, i), self%v(:, i), self%a(:, i), self%inner%z(:, i), &
                           self%lambda(:, i), .true., self%work%r(:, i), self%work%gap(:, i))
    end do
    self%residuals = self%residuals + 3
    associate (m => self%method, w => self%work)
      f = real(m%from(1, :), wp)
      w%r_real = f(1)*w%r(:, 1) + f(2)*w%r(:, 2) + f(3)*w%r(:, 3)
      w%r_part = m%from(2, 1)*w%r(:, 1) + m%from(2, 2)*w%r(:, 2) + m%from(2, 3)*w%r(:, 3)
    end associate
  end subroutine stage_residuals

  !> Matrices at the second stage.
  subroutine renew(self, system, regularise, ok)
    type(radau_stage_values), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    logical, intent(in) :: regularise
    logical, intent(out) :: ok
    self%renewals = self%renewals + 1
    call system%prepare((self%method%mu/self%h)**2, self%method%mu/self%h, 0.0_wp, ok)
    if (ok) call system%renew(self%q(:, 2), self%v(:, 2), self%a(:, 2), self%lambda(:, 2), self%full_block_left > 0, regularise, &
                              ok, self%work%r_real, self%work%r_part)
  end subroutine renew

  !> One correction of the stages by the present factors.
  subroutine correct(self, system)
    type(radau_stage_values), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    complex(wp) :: x
    real(wp) :: f(3)
    integer :: i
    associate (m => self%method, w => self%work, c2 => self%method%mu/self%h)
      f = real(m%from(1, :)/c2(1), wp)
      w%gap_real = f(1)*w%gap(:, 1) + f(2)*w%gap(:, 2) + f(3)*w%gap(:, 3)
      f = real(m%from(1, :), wp)
      w%dlambda = 0.0_wp
      w%dlambda_part = 0.0_wp
      do i = 1, 3
        w%dlambda = w%dlambda + f(i)*(self%lambda(:, i) - w%held(:, i))
        w%dlambda_part = w%dlambda_part + m%from(2, i)*(self%lambda(:, i) - w%held(:, i))
      end do
      w%gap_part = (m%from(2, 1)*w%gap(:, 1) + m%from(2, 2)*w%gap(:, 2) + m%from(2, 3)*w%gap(:, 3))/c2(2)
      call system%correction(w%r_real, w%gap_real, w%dq(:, 1), w%dlambda)
      call system%complex_correction(w%r_part, w%gap_part, w%dq_part, w%dlambda_part)
      do i = 3, 1, -1
        x = m%to(i, 2)*c2(2)
        w%dv(:, i) = real(m%to(i, 1)*c2(1), wp)*w%dq(:, 1) + real(x*w%dq_part, wp)
        w%dq(:, i) = real(m%to(i, 1), wp)*w%dq(:, 1) + real(m%to(i, 2)*w%dq_part, wp)
        self%lambda(:, i) = self%lambda(:, i) + real(m%to(i, 1), wp)*w%dlambda + real(m%to(i, 2)*w%dlambda_part, wp)
      end do
      self%u = self%u + w%dv
    end associate
    self%iterations = self%iterations + 1
  end subroutine correct

  !> The largest correction of a position or rate over its scale [-].
  real(wp) function size_of_correction(self, system, norm, goal) result(d)
    type(radau_stage_values), intent(inout) :: self
    class(second_order_ode), intent(in) :: system
    type(error_norm), intent(inout) :: norm
    real(wp), intent(in) :: goal             !! [-]
    integer :: i
    associate (w => self%work, nq => self%nq)
      w%rounding(1:nq) = value_rounding*system%enlargement*abs(self%q(:, 3))    ! near a singular position rows enlarge it
      w%rounding(nq + 1:2*nq) = w%rounding(1:nq)/self%h
      do i = 1, nq
        w%e(i) = max(abs(w%dq(i, 1)), abs(w%dq(i, 2)), abs(w%dq(i, 3)))
        w%e(nq + i) = max(abs(w%dv(i, 1)), abs(w%dv(i, 2)), abs(w%dv(i, 3)))
      end do
      w%y(1:nq) = self%q(:, 3)
      w%y(nq + 1:2*nq) = self%v(:, 3)
      d = goal*norm%measure(w%e(1:2*nq), w%y(1:2*nq), self%h, goal, w%rounding(1:2*nq))
      if (.not. all(abs(w%dq) < huge(1.0_wp))) d = huge(1.0_wp)
    end associate
  end function size_of_correction

  !> Saves or restores what the next step needs.
  subroutine exchange_stages(self, a)
    type(radau_stage_values), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    call a%exchange(self%last_h, self%iterations, self%residuals, self%renewals, self%eta, self%full_block_left)
    call a%exchange(self%q0, self%v0, self%a0, self%inner%z0)
    call a%exchange(self%powers0)
    call a%exchange(self%inner%zd0)
    call a%exchange(self%last_v)
    call a%exchange(self%last_lambda)
  end subroutine exchange_stages
end module radau_stages
