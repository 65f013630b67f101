!> Local error of a step of the generalized-alpha method, for the step control.
module alpha_error
  use kinds, only: wp
  use alpha_state, only: alpha_solver
  use second_order_system, only: second_order_ode
  implicit none (type, external)
  private
  public :: error_vector, remember_error

contains

  !> Estimated local error e of the trial step: positions from the change of the accelerations over the step, rates from the
  !> change of that change (Geradin & Cardona, Flexible Multibody Dynamics). What elastic and internal variables do faster than
  !> the step resolves is filtered out (Hairer & Wanner, Solving Ordinary Differential Equations II, IV.8). Energies are not
  !> measured. The accelerations are those of the equations at the ends of the step: the method's own ones carry, where
  !> constraints hold, the rounding of phi = 0 over h2 and what a change of the step leaves. Next to singular positions these are a
  !> second opinion: there those of the equations amplify the rounding of positions without bound.
  subroutine error_vector(self, system, t1, own, e)
    type(alpha_solver), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: t1                !! end of the step [s]
    logical, intent(in) :: own                !! by the method's own accelerations
    real(wp), intent(inout), contiguous :: e(:)   !! (n) error [unit of each unknown]
    associate (m => self%error, nq => self%nq)
      if (own) then
        call differences(self, self%vd1, self%vd, m%before_own, e)
      else
        call system%accelerations(t1, self%x1(1:nq), self%v1(1:nq), self%x1(nq + 1:), self%v1(nq + 1:), .true., m%next, &
                                  self%dlambda, self%energy%next)
        call differences(self, m%next, m%now, m%before, e)
      end if
    end associate
    associate (nq => self%nq, nz => self%nz, nzd => self%nzd, z => 2*self%nq)
      call system%resolve(e(1:nq), e(nq + 1:2*nq))
      e(z + 1:z + nz) = self%resolved*e(z + 1:z + nz)
      e(z + nz + 1:z + nz + nzd) = self%resolved(1:nzd)*e(z + nz + 1:z + nz + nzd)
    end associate
  end subroutine error_vector

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

  !> The estimate's memory of an accepted step.
  subroutine remember_error(self)
    type(alpha_solver), intent(inout) :: self
    self%error%before = self%error%next - self%error%now
    self%error%now = self%error%next
  end subroutine remember_error
end module alpha_error
