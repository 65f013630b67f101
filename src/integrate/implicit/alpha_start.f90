!> Start of the generalized-alpha method at a consistent state and change of its step.
module alpha_start
  use kinds, only: wp
  use alpha_newton, only: prepare_step, find_offsets, find_offset
  use alpha_state, only: alpha_solver
  use generalized_alpha, only: step_coefficients
  use second_order_system, only: second_order_ode
  implicit none (type, external)
  private
  public :: start_method, change_step

contains

  !> Starts (or starts again, after a jump of loads) at a consistent state y at time t: with accelerations and multipliers of the
  !> equations, and the difference of an index-3 solution from them (Arnold, Bruels & Cardona 2015).
  subroutine start_method(self, system, t, h, y)
    type(alpha_solver), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in) :: h                 !! [s]
    real(wp), intent(in), contiguous :: y(:)  !! (n) the state [unit of each unknown]
    logical :: ok
    associate (nq => self%nq, nz => self%nz, nzd => self%nzd)
      self%x = [y(1:nq), y(2*nq + 1:2*nq + nz)]
      self%v(1:nq) = y(nq + 1:2*nq)
      self%v(nq + 1:nq + nzd) = y(2*nq + nz + 1:2*nq + nz + nzd)
      self%energy%sums = y(2*nq + nz + nzd + 1:)
      call system%accelerations(t, y(1:nq), y(nq + 1:2*nq), y(2*nq + 1:2*nq + nz), self%v(nq + 1:), self%vd, &
                                self%lambda, self%energy%powers)
    end associate
    self%newton%h = 0.0_wp
    self%newton%exact_left = 0
    self%newton%contraction = 1.0_wp
    call set_step(self, system, h, 0.0_wp)
    associate (nq => self%nq)                 ! differences of forces are taken: nothing may depend on the step before
      call find_offsets(self, system, self%x(nq + 1:), self%v(nq + 1:), self%vd(nq + 1:))
      call system%smooth(t, self%x(1:nq), self%v(1:nq), self%dx(nq + 1:), self%lambda, self%vd(1:nq), ok)
      if (ok) self%vd(nq + 1:) = self%resolved*self%vd(nq + 1:)
    end associate
    self%lag = 0.0_wp
    self%offset = 0.0_wp
    if (ok) call find_offset(self, system, t)
    self%lag(1:self%nq) = self%method%lag/(self%method%offset*h**2)*self%offset
  end subroutine start_method

  !> Coefficients and constant factors of a step size.
  subroutine set_step(self, system, h, near)
    type(alpha_solver), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: h                 !! [s]
    real(wp), intent(in) :: near              !! as prepare_step has it [-]
    logical :: ok
    if (abs(h - self%now%h) <= 0.0_wp .and. .not. self%needs_factors) return
    if (abs(h - self%now%h) > 0.0_wp) then
      self%newton%contraction = 1.0_wp
      self%newton%factors(1) = self%newton%factors(1) + system%blocks
      self%now = step_coefficients(self%method, h)
    end if
    call prepare_step(self, system, near, ok)
    if (.not. ok) self%newton%exact_left = huge(0)   ! only rounding leaves no factor; the exact matrix decides then
  end subroutine set_step

  !> Goes on with another step size. Steps that fail change nothing: the state does not depend on the step. The difference of a
  !> and v' is scaled with the step (Bruels & Arnold 2008), the offset of rates with its square.
  subroutine change_step(self, system, h, near)
    type(alpha_solver), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: h                 !! [s]
    real(wp), intent(in) :: near              !! as prepare_step has it [-]
    self%offset = (h/self%now%h)**2*self%offset
    call set_step(self, system, h, near)
  end subroutine change_step
end module alpha_start
