!> Start of the generalized-alpha method at a consistent state and change of its step. Index 3: positions satisfy phi = 0; the
!> rates that the method carries are off phi' = 0 by its own O(h2).
module alpha_start
  use kinds, only: wp
  use alpha_newton, only: prepare_step, give_offsets
  use alpha_state, only: alpha_solver
  use generalized_alpha, only: step_coefficients
  use second_order_system, only: second_order_ode
  implicit none (type, external)
  private
  public :: start_method, change_step

contains

  !> Starts (or starts again, after a jump of loads) at a consistent state y at time t: accelerations and multipliers from
  !> the equations, and what index-3 solutions differ from them by (Arnold, Bruels & Cardona 2015).
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
      call system%accelerations(t, y(1:nq), y(nq + 1:2*nq), y(2*nq + 1:2*nq + nz), self%v(nq + 1:), .false., self%vd, &
                                self%lambda, self%energy%powers)
    end associate
    self%error%now = self%vd
    self%error%h = 0.0_wp
    self%newton%exact_left = 0
    self%newton%contraction = 1.0_wp
    self%plain%kept = .false.
    call set_step(self, system, h)
    self%a = self%vd
    associate (nq => self%nq)
      call system%smooth(t, self%x(1:nq), self%v(1:nq), self%lambda, self%vd(1:nq), ok)
      if (ok) self%vd(nq + 1:) = self%resolved*self%vd(nq + 1:)
    end associate
    if (ok) self%a = self%vd
    if (system%rows > 0 .and. ok) call add_offsets(self, system, t, h)
    call self%measure%widen(self%x)
  end subroutine start_method

  !> In the directions that constraints hold, a = v'(t + lag h) and v = v(t) - offset h2 v'': adds these parts. Directions are
  !> those of the matrix that stands, so that stiff motion moves in equilibrium with them.
  subroutine add_offsets(self, system, t, h)
    type(alpha_solver), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in) :: h                 !! [s]
    associate (nq => self%nq)
      self%x1(1:nq) = self%x(1:nq) + h*self%v(1:nq) + 0.5_wp*h**2*self%vd(1:nq)   ! the rows' kinematics a step later: phi''/h
      self%v1(1:nq) = self%v(1:nq) + h*self%vd(1:nq)
      call system%gaps(t + h, self%x1(1:nq), self%v1(1:nq), self%vd(1:nq), self%gaps)
      self%gaps = self%gaps/h
      call system%along_rows(self%x(1:nq), self%gaps(:, 2), self%dx(1:nq))
      self%a(1:nq) = self%a(1:nq) + self%method%lag*h*self%dx(1:nq)
      self%v(1:nq) = self%v(1:nq) - self%method%offset*h**2*self%dx(1:nq)
    end associate
  end subroutine add_offsets

  !> Coefficients and constant factors of a step size.
  subroutine set_step(self, system, h)
    type(alpha_solver), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: h                 !! [s]
    logical :: ok
    if (abs(h - self%now%h) <= 0.0_wp .and. .not. self%stale) return
    if (abs(h - self%now%h) > 0.0_wp) then
      self%newton%contraction = 1.0_wp
      self%newton%factors(1) = self%newton%factors(1) + system%blocks
      self%now = step_coefficients(self%method, h)
    end if
    call prepare_step(self, system, ok)
    if (.not. ok) self%newton%exact_left = huge(0)   ! only rounding leaves no factor; the exact matrix decides then
  end subroutine set_step

  !> Goes on with another step size: what a lags behind v' by is scaled with the step (Bruels & Arnold 2008). Where
  !> constraints hold, v, v' and a carry the rounding of phi = 0 over h and h2 and the offsets of the old step: these are taken
  !> off in the old step's directions, and those of the new step are added in its own.
  subroutine change_step(self, system, t, h)
    type(alpha_solver), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in) :: h                 !! [s]
    logical :: ok
    if (self%stale) call prepare_step(self, system, ok)
    associate (plain => self%plain)
      if (.not. plain%kept) then
        if (system%rows > 0) then
          call matrix_here(self, system, t, ok)
          if (ok) call remove_offsets(self, system, t)
        end if
        plain%v = self%v
        plain%vd = self%vd
        plain%lag = (self%a - self%vd)/self%now%h
        plain%kept = .true.
      end if
      self%v = plain%v
      self%vd = plain%vd
      self%a = plain%vd + h*plain%lag
    end associate
    call set_step(self, system, h)
    if (system%rows > 0) then
      call matrix_here(self, system, t, ok)
      if (ok) call add_offsets(self, system, t, h)
    end if
  end subroutine change_step

  !> The matrix of the present step at the state from which it starts.
  subroutine matrix_here(self, system, t, ok)
    type(alpha_solver), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: t                 !! [s]
    logical, intent(out) :: ok
    associate (nq => self%nq)
      call give_offsets(self, system, self%x(nq + 1:), self%v(nq + 1:), self%vd(nq + 1:))
      call system%residual(t, self%x(1:nq), self%v(1:nq), self%vd(1:nq), self%lambda, .false., self%gaps(:, 0))
      call system%renew(self%x(1:nq), self%v(1:nq), self%vd(1:nq), self%lambda, .false., .true., ok)
    end associate
  end subroutine matrix_here

  !> v, v' and a onto the derivatives of phi = 0.
  subroutine remove_offsets(self, system, t)
    type(alpha_solver), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: t                 !! [s]
    associate (nq => self%nq)
      call system%gaps(t, self%x(1:nq), self%v(1:nq), self%vd(1:nq), self%gaps)
      call system%along_rows(self%x(1:nq), self%gaps(:, 1), self%dx(1:nq))
      self%v(1:nq) = self%v(1:nq) + self%dx(1:nq)
      call system%gaps(t, self%x(1:nq), self%v(1:nq), self%vd(1:nq), self%gaps)
      call system%along_rows(self%x(1:nq), self%gaps(:, 2), self%dx(1:nq))
      self%vd(1:nq) = self%vd(1:nq) + self%dx(1:nq)
      call system%gaps(t, self%x(1:nq), self%v(1:nq), self%a(1:nq), self%gaps)
      call system%along_rows(self%x(1:nq), self%gaps(:, 2), self%dx(1:nq))
      self%a(1:nq) = self%a(1:nq) + self%dx(1:nq)
    end associate
  end subroutine remove_offsets
end module alpha_start
