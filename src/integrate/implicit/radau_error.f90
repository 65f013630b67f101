!> The estimated error of a step of the Radau IIA method (Hairer & Wanner, IV.8): the difference from an embedded formula of order
!> 3, filtered by the real matrix. With the embedded rates and accelerations
!>
!>   v^ = -sum_i e_i (Q_i - q)/h      a^ = -sum_i e_i (V_i - v)/h      c2 = gamma/h
!>
!> the error of positions is the correction that the residual at (q, v^, a^ - c2 (v - v^)) asks for, and that of rates follows.
module radau_error
  use kinds, only: wp
  use radau_stages, only: radau_stage_values
  use second_order_system, only: second_order_ode
  use step_control, only: error_norm
  implicit none (type, external)
  private
  public :: measure_error, removed_energy

contains

  !> The error over the tolerance, 1: just allowed.
  subroutine measure_error(self, system, norm, y, tolerance, filter_twice, error)
    type(radau_stage_values), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    type(error_norm), intent(inout) :: norm
    real(wp), intent(in) :: y(:)             !! (n) end of the step [unit of each unknown]
    real(wp), intent(in) :: tolerance        !! [-]
    logical, intent(in) :: filter_twice     !! an error that is too large is filtered once more
    real(wp), intent(out) :: error           !! [-]
    real(wp) :: c2, lag(3)
    integer :: pass
    c2 = real(self%method%mu(1), wp)/self%h
    associate (m => self%method, w => self%work, n => self%inner, nq => self%nq)
      lag = matmul(m%e, m%a)
      w%rate_gap = lag(1)*self%u(:, 1) + lag(2)*self%u(:, 2) + lag(3)*self%u(:, 3)
      n%rate_gap = lag(1)*n%u(:, 1) + lag(2)*n%u(:, 2) + lag(3)*n%u(:, 3)
      n%driving = -n%inertia*((m%e(1)*n%u(:, 1) + m%e(2)*n%u(:, 2) + m%e(3)*n%u(:, 3))/self%h + c2*n%rate_gap) &
               + n%viscosity*(n%zd0 - n%rate_gap)
      w%v = self%v0 - w%rate_gap
      w%q = self%q0
      do pass = 1, 2
        w%a = -(m%e(1)*self%u(:, 1) + m%e(2)*self%u(:, 2) + m%e(3)*self%u(:, 3))/self%h - c2*w%rate_gap
        w%y(1:self%nz) = n%z0 - n%real_gain*(n%driving - (n%delta0 - n%z0))
        associate (first => self%nz - system%linear + 1)
          if (system%linear > 0) w%y(first:self%nz) = n%z0(first:) + system%linear_part(c2, n%rate_gap(first:))
        end associate
        call system%residual(self%t, w%q, w%v, w%a, w%y(1:self%nz), self%lambda(:, 1), .false., w%r(:, 1), w%gap(:, 1))
        self%residuals = self%residuals + 1
        w%gap(:, 1) = w%gap(:, 1)/c2
        w%dlambda = 0.0_wp
        call system%correction(w%r(:, 1), w%gap(:, 1), w%dq(:, 1), w%dlambda)
        w%e = 0.0_wp
        w%e(1:nq) = w%dq(:, 1)
        w%e(nq + 1:2*nq) = c2*w%dq(:, 1) - w%rate_gap
        call internal_part(self, system, c2)
        error = norm%measure(w%e, y, self%h, tolerance, w%rounding)
        if (.not. error < huge(1.0_wp)) error = huge(1.0_wp)
        if (pass == 2 .or. .not. filter_twice .or. error < 1.0_wp .or. .not. error < huge(1.0_wp)) exit
        w%q = self%q0 + w%e(1:nq)
        w%rate_gap = w%rate_gap + w%e(nq + 1:2*nq)
      end do
    end associate
  end subroutine measure_error

  !> Errors of internal variables, from those of the positions.
  subroutine internal_part(self, system, c2)
    type(radau_stage_values), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: c2               !! [1/s]
    integer :: k
    if (self%nz == 0) return
    associate (e => self%work%e, o => 2*self%nq, nz => self%nz, nzd => self%nzd, n => self%inner)
      self%work%q = self%q0 + self%work%dq(:, 1)
      call system%deformations(self%t, self%work%q, self%v0, n%delta(:, 2))
      do k = 1, nz
        e(o + k) = n%real_gain(k)*((n%delta(k, 2) - n%z0(k)) - n%driving(k))
      end do
      associate (first => nz - system%linear + 1)
        if (system%linear > 0) e(o + first:o + nz) = system%linear_part(c2, n%rate_gap(first:) &
                                                                 + (n%delta(first:, 2) - n%delta0(first:)))
      end associate
      do k = 1, nzd
        e(o + nz + k) = c2*e(o + k) - n%rate_gap(k)
      end do
    end associate
  end subroutine internal_part

  !> The energy that the method itself takes out in a step [J]: what its quadrature, exact up to s^4, misses of the product of
  !> rates (s^3) and accelerations (s^2), and of forces (s^3) and rates of the positions (s^2).
  real(wp) function removed_energy(self, system) result(energy)
    type(radau_stage_values), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp) :: d(3)
    integer :: i, k, nq
    nq = self%nq
    d = self%method%lead(1:)
    associate (m => self%method, n => self%inner, x => self%work%pairs)
      do i = 1, nq
        x(i, 1) = d(1)*self%u(i, 1) + d(2)*self%u(i, 2) + d(3)*self%u(i, 3)
        x(i, 3) = -(d(1)*(self%q(i, 1) - self%q0(i)) + d(2)*(self%q(i, 2) - self%q0(i)) + d(3)*(self%q(i, 3) - self%q0(i)))
        x(i, 4) = m%lead(0)*self%a0(i) + d(1)*self%a(i, 1) + d(2)*self%a(i, 2) + d(3)*self%a(i, 3)
      end do
      do k = 1, self%nz
        i = nq + k
        x(i, 1) = m%lead(0)*n%zd0(k) + d(1)*n%zd(k, 1) + d(2)*n%zd(k, 2) + d(3)*n%zd(k, 3)
        x(i, 3) = -(d(1)*(n%z(k, 1) - n%z0(k)) + d(2)*(n%z(k, 2) - n%z0(k)) + d(3)*(n%z(k, 3) - n%z0(k)))
        x(i, 4) = x(i, 3)
      end do
      d = matmul(d, m%w)/self%h
      do k = 1, self%nz
        if (n%inertia(k) > 0.0_wp) x(nq + k, 4) = m%lead(0)*(n%delta0(k) - n%z0(k) - n%viscosity(k)*n%zd0(k))/n%inertia(k) &
          + d(1)*(n%zd(k, 1) - n%zd0(k)) + d(2)*(n%zd(k, 2) - n%zd0(k)) + d(3)*(n%zd(k, 3) - n%zd0(k))
      end do
      x(:, 2) = x(:, 1)
      energy = 3*m%fifth*system%mass_product(self%q(:, 3), x)
    end associate
  end function removed_energy
end module radau_error
