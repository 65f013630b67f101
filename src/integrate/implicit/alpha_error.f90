!> Local error of a step of the generalized-alpha method, for the step control.
module alpha_error
  use kinds, only: wp
  use alpha_state, only: alpha_solver, pack
  use second_order_system, only: second_order_ode
  implicit none (type, external)
  private
  public :: error_vector, own_error, compare_estimates, doubtful, back_to_equations, remember_error

  real(wp), parameter :: alike = 0.05_wp      !! difference of estimates that agree [-]
  integer, parameter :: agreements = 4        !! steps after which they count as the same

contains

  !> Estimated local error e of the trial step, and the state y that it leads to: positions from the change of the
  !> accelerations over the step, rates from the change of that change (Geradin & Cardona, Flexible Multibody Dynamics). What
  !> elastic and internal variables do faster than the step resolves is filtered out (Hairer & Wanner, Solving Ordinary
  !> Differential Equations II, IV.8). Energies are not measured. The accelerations are those of the equations at the
  !> ends of the step: the method's own ones carry, where constraints hold, the rounding of phi = 0 over h2 and what a change of
  !> the step leaves. Where both were seen to give the same estimate (`compare_estimates`), the own ones, which cost nothing.
  subroutine error_vector(self, system, t1, e, y)
    type(alpha_solver), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: t1                !! end of the step [s]
    real(wp), intent(inout) :: e(:), y(:)     !! (n) error and state
    associate (m => self%error)
      call pack(self, self%x1, self%v1, 0.0_wp, 0.0_wp, y)
      if (m%tight) then
        call equations(self, system, t1)
        call differences(self, m%next, m%now, m%before, e)
      else
        call differences(self, self%vd1, self%vd, m%before_own, e)
      end if
    end associate
    call filter(self, system, e)
  end subroutine error_vector

  !> Accelerations of the equations at the end of the trial step.
  subroutine equations(self, system, t1)
    type(alpha_solver), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: t1                !! [s]
    real(wp) :: powers(2)
    associate (nq => self%nq)
      call system%accelerations(t1, self%x1(1:nq), self%v1(1:nq), self%x1(nq + 1:), self%v1(nq + 1:), .true., self%error%next, &
                                self%dlambda, powers)
    end associate
  end subroutine equations

  !> The same estimate with the method's own accelerations, a second opinion next to singular positions: there those of the
  !> equations amplify the rounding of positions without bound.
  subroutine own_error(self, system, e)
    type(alpha_solver), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(inout) :: e(:)           !! (n)
    call differences(self, self%vd1, self%vd, self%error%before_own, e)
    call filter(self, system, e)
  end subroutine own_error

  !> Compares the estimate with that of the method's own accelerations: where they agree over several steps, the latter do.
  subroutine compare_estimates(self, error, own, pivot)
    type(alpha_solver), intent(inout) :: self
    real(wp), intent(in) :: error, own        !! measured over the tolerance [-]
    real(wp), intent(in) :: pivot             !! the weakest row's [-]
    self%error%agreed = merge(self%error%agreed + 1, 0, abs(own - error) <= alike*error)
    if (self%error%agreed < agreements) return
    self%error%tight = .false.
    self%error%firm = pivot
  end subroutine compare_estimates

  !> Whether the rows have become so much weaker that the method's own accelerations no longer serve.
  logical function doubtful(self, system) result(yes)
    type(alpha_solver), intent(in) :: self
    class(second_order_ode), intent(in) :: system
    real(wp) :: pivot(2)
    pivot = system%weakest_row()
    yes = .not. self%error%tight .and. pivot(1) < 0.1_wp*self%error%firm
  end function doubtful

  !> Goes back to the accelerations of the equations, at the state from which the next step starts.
  subroutine back_to_equations(self, system, t)
    type(alpha_solver), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: t                 !! [s]
    if (self%error%tight) return
    self%error%tight = .true.
    self%error%agreed = 0
    self%x1 = self%x
    self%v1 = self%v
    call equations(self, system, t)
    self%error%now = self%error%next
    self%error%before = self%error%before_own
  end subroutine back_to_equations

  !> The estimate before it is filtered, from accelerations at both ends and their last change.
  pure subroutine differences(self, a1, a, before, e)
    type(alpha_solver), intent(in) :: self
    real(wp), intent(in) :: a1(:), a(:)       !! (nq + nz) [m/s2, rad/s2]
    real(wp), intent(in) :: before(:)         !! (nq + nz) [m/s2, rad/s2]
    real(wp), intent(inout) :: e(:)           !! (n) [m, rad] and per second
    real(wp) :: fq, fv, ratio, h, d
    integer :: i
    h = self%now%h
    ratio = 0.0_wp
    if (self%error%h > 0.0_wp) ratio = h/self%error%h
    fq = self%method%local*h**2
    fv = self%method%local_rate*h*2*ratio/(1 + ratio)       ! of divided differences over unequal steps
    associate (nq => self%nq, nz => self%nz)
      do i = 1, nq
        d = a1(i) - a(i)
        e(i) = fq*d
        e(nq + i) = fv*(d - ratio*before(i))
      end do
      do i = nq + 1, nq + nz
        d = a1(i) - a(i)
        e(nq + i) = fq*d
        if (i <= nq + self%nzd) e(nq + nz + i) = fv*(d - ratio*before(i))
      end do
      e(2*nq + nz + self%nzd + 1:) = 0.0_wp
    end associate
  end subroutine differences

  !> Takes out what the step does not resolve.
  subroutine filter(self, system, e)
    type(alpha_solver), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(inout) :: e(:)           !! (n) [m, rad] and per second
    associate (nq => self%nq, nz => self%nz, nzd => self%nzd, x => self%pairs(:, 1), y => self%pairs(:, 2))
      x(1:nq) = e(1:nq)
      x(nq + 1:) = e(2*nq + 1:2*nq + nz)
      y(1:nq) = e(nq + 1:2*nq)
      y(nq + 1:nq + nzd) = e(2*nq + nz + 1:2*nq + nz + nzd)
      y(nq + nzd + 1:) = 0.0_wp
      call system%resolve(x, y)
      e(1:nq) = x(1:nq)
      e(2*nq + 1:2*nq + nz) = x(nq + 1:)
      e(nq + 1:2*nq) = y(1:nq)
      e(2*nq + nz + 1:2*nq + nz + nzd) = y(nq + 1:nq + nzd)
    end associate
  end subroutine filter

  !> The estimate's memory of an accepted step.
  subroutine remember_error(self)
    type(alpha_solver), intent(inout) :: self
    self%error%before = self%error%next - self%error%now
    self%error%now = self%error%next
  end subroutine remember_error
end module alpha_error
