!> The estimated error of a step of the Radau IIA method (Hairer & Wanner, IV.8): the difference from an embedded formula of order
!> 3, filtered by the real matrix. With the embedded rates and accelerations
!>
!>   v^ = -sum_i e_i (Q_i - q)/h      a^ = -sum_i e_i (V_i - v)/h      c2 = gamma/h
!>
!> the error of positions is the correction that the residual at (q, v^, a^ - c2 (v - v^)) asks for, and that of rates follows.
module radau_error
  use kinds, only: wp
  use radau_stages, only: radau_stage_values
  use stage_system, only: stage_ode
  use step_control, only: error_norm
  implicit none (type, external)
  private
  public :: measure_error, removed_energy

contains

  !> The error over the tolerance, 1: just allowed.
  subroutine measure_error(self, system, norm, y, tolerance, careful, error)
    type(radau_stage_values), intent(inout) :: self
    class(stage_ode), intent(inout) :: system
    type(error_norm), intent(inout) :: norm
    real(wp), intent(in) :: y(:)             !! (n) end of the step [unit of each unknown]
    real(wp), intent(in) :: tolerance        !! [-]
    logical, intent(in) :: careful           !! an error that is too large is filtered once more
    real(wp), intent(out) :: error           !! [-]
    real(wp), allocatable :: q(:), v(:), a(:), none(:)
    real(wp) :: c2
    integer :: pass
    c2 = real(self%method%mu(1), wp)/self%h
    associate (m => self%method, w => self%work, nq => self%nq)
      v = -(m%e(1)*(self%q(:, 1) - self%q0) + m%e(2)*(self%q(:, 2) - self%q0) + m%e(3)*(self%q(:, 3) - self%q0))/self%h
      none = self%v0                          ! rates that the error of positions starts from
      q = self%q0
      do pass = 1, 2
        a = -matmul(self%u, m%e)/self%h - c2*(none - v)
        call internal_error(self, c2)
        call system%stage_residual(self%t, q, v, a, w%y(1:self%nz), self%lambda(:, 1), .false., w%r(:, 1), w%gap(:, 1))
        self%residuals = self%residuals + 1
        w%gap(:, 1) = w%gap(:, 1)/c2
        call system%stage_correction(w%r(:, 1), w%gap(:, 1), w%dq(:, 1), w%dlambda)
        w%e = 0.0_wp
        w%e(1:nq) = w%dq(:, 1)
        w%e(nq + 1:2*nq) = c2*w%dq(:, 1) - (none - v)
        call internal_part(self, system, c2)
        error = norm%measure(w%e, y, self%h, tolerance)
        if (.not. error < huge(1.0_wp)) error = huge(1.0_wp)
        if (pass == 2 .or. .not. careful .or. error < 1.0_wp .or. .not. error < huge(1.0_wp)) exit
        q = self%q0 + w%e(1:nq)
        none = self%v0 + w%e(nq + 1:2*nq)
      end do
    end associate
  end subroutine measure_error

  !> Internal variables at which the residual is asked for, in work y: z - g (inertia a^ + viscosity v^ + z - delta).
  subroutine internal_error(self, c2)
    type(radau_stage_values), intent(inout) :: self
    real(wp), intent(in) :: c2               !! [1/s]
    real(wp) :: zd, zdd, g
    integer :: i
    associate (n => self%inner)
      do i = 1, self%nz
        call embedded(self, i, c2, zd, zdd)
        g = 1/(1 + n%viscosity(i)*c2 + n%inertia(i)*c2**2)
        self%work%y(i) = n%z0(i) - g*(n%inertia(i)*zdd + n%viscosity(i)*zd + n%z0(i) - n%delta0(i))
      end do
    end associate
  end subroutine internal_error

  !> Embedded rate and acceleration of an internal variable, the latter as that of coordinates is used.
  pure subroutine embedded(self, i, c2, zd, zdd)
    type(radau_stage_values), intent(in) :: self
    integer, intent(in) :: i
    real(wp), intent(in) :: c2               !! [1/s]
    real(wp), intent(out) :: zd, zdd         !! [m/s, rad/s], [m/s2, rad/s2]
    zd = -dot_product(self%method%e, self%inner%z(i, :) - self%inner%z0(i))/self%h
    zdd = -dot_product(self%method%e, self%inner%zd(i, :) - self%inner%zd0(i))/self%h - c2*(self%inner%zd0(i) - zd)
  end subroutine embedded

  !> Errors of internal variables, from those of the positions.
  subroutine internal_part(self, system, c2)
    type(radau_stage_values), intent(inout) :: self
    class(stage_ode), intent(inout) :: system
    real(wp), intent(in) :: c2               !! [1/s]
    real(wp) :: zd, zdd, g
    real(wp), allocatable :: q(:)
    integer :: i
    if (self%nz == 0) return
    q = self%q0 + self%work%dq(:, 1)
    call system%deformations(q, self%v0, self%inner%delta(:, 2))
    associate (e => self%work%e, nq => self%nq, nz => self%nz, n => self%inner)
      do i = 1, nz
        call embedded(self, i, c2, zd, zdd)
        g = 1/(1 + n%viscosity(i)*c2 + n%inertia(i)*c2**2)
        e(2*nq + i) = g*(n%delta(i, 2) - n%inertia(i)*zdd - n%viscosity(i)*zd - n%z0(i))
        if (i <= self%nzd) e(2*nq + nz + i) = c2*e(2*nq + i) - (n%zd0(i) - zd)
      end do
    end associate
  end subroutine internal_part

  !> The energy that the method itself takes out in a step [J]: what its quadrature, exact up to s^4, misses of the product of
  !> rates (s^3) and accelerations (s^2), and of forces (s^3) and rates of the positions (s^2).
  real(wp) function removed_energy(self, system) result(energy)
    type(radau_stage_values), intent(inout) :: self
    class(stage_ode), intent(inout) :: system
    real(wp) :: x(self%nq + self%nz, 4)
    integer :: i, k
    associate (m => self%method, n => self%inner)
      do i = 1, self%nq
        x(i, 1) = dot_product(m%lead(1:), self%u(i, :))
        x(i, 3) = -dot_product(m%lead(1:), self%q(i, :) - self%q0(i))
        x(i, 4) = dot_product(m%lead, [self%a0(i), self%a(i, :)])
      end do
      do k = 1, self%nz
        i = self%nq + k
        x(i, 1) = dot_product(m%lead, [n%zd0(k), n%zd(k, :)])
        x(i, 3) = -dot_product(m%lead(1:), n%z(k, :) - n%z0(k))
        x(i, 4) = x(i, 3)
        if (n%inertia(k) > 0.0_wp) x(i, 4) = dot_product(m%lead, [(n%delta0(k) - n%z0(k) - n%viscosity(k)*n%zd0(k))/n%inertia(k), &
                                                                  matmul(m%w, n%zd(k, :) - n%zd0(k))/self%h])
      end do
      x(:, 2) = x(:, 1)
      energy = 3*m%fifth*system%mass_product(self%q(:, 3), x)
    end associate
  end function removed_energy
end module radau_error
