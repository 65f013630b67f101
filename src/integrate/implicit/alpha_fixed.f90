!> Fixed steps of the generalized-alpha method: one that fails is divided and tried again.
module alpha_fixed
  use kinds, only: wp, ip
  use alpha_march, only: alpha_steps, patience, count_hopeless, ready, accept, hand_over, give_up
  use alpha_newton, only: try_step
  use alpha_state, only: pack_state
  use second_order_system, only: second_order_ode
  use step_counts, only: step_count
  use time_stepper, only: paused, lost, trouble_none
  implicit none (type, external)
  private
  public :: advance_fixed

  integer, parameter :: most_halvings = 30      !! of a step that fails
  integer, parameter :: hopeless_halvings = 16  !! of every step: the run would never end

contains

  !> Equal steps; one that fails is halved until it works, and the parts grow again as far as they fit.
  subroutine advance_fixed(self, system, from, to, most, y, outcome)
    class(alpha_steps), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: from, to          !! [s]
    integer, intent(in) :: most
    real(wp), intent(inout) :: y(:)
    integer, intent(out) :: outcome
    integer(ip) :: n
    integer :: attempt
    real(wp) :: h
    logical :: ok
    n = step_count(from, to, self%step)
    h = (to - from)/real(n, wp)
    outcome = paused
    do attempt = 1, most
      self%tried = from + (real(self%done, wp) + real(self%part + 1, wp)/2**self%level)*h
      if (self%part + 1 == 2**self%level .and. self%done + 1 == n) self%tried = to
      call one_step(self, system, h/2**self%level, ok)
      if (.not. ok) then
        self%rejected = self%rejected + 1
        self%failures = self%failures + 1
        self%level = self%level + 1
        self%part = 2*self%part
        call count_hopeless(self, self%level >= hopeless_halvings)
        if (self%level <= most_halvings .and. self%hopeless < patience) cycle
        call give_up(self)
        outcome = lost
        return
      end if
      if (self%trouble /= trouble_none) then
        outcome = lost
        return
      end if
      call count_hopeless(self, self%level >= hopeless_halvings)
      self%part = self%part + 1
      do while (self%level > 0 .and. mod(self%part, 2) == 0)
        self%level = self%level - 1
        self%part = self%part/2
      end do
      if (self%level > 0) cycle
      self%part = 0
      self%done = self%done + 1
      if (self%done < n) cycle
      self%done = 0
      call finish_output(self, system, to, y, outcome)
      return
    end do
  end subroutine advance_fixed

  !> One step of size h from self%t to self%tried, accepted where Newton's method converges.
  subroutine one_step(self, system, h, ok)
    class(alpha_steps), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: h                 !! [s]
    logical, intent(out) :: ok
    call ready(self, system, h)
    call try_step(self%solver, system, self%tried, ok)
    if (.not. ok) return
    call accept(self, system, h)
  end subroutine one_step

  !> The row's state: projected, with its evaluation.
  subroutine finish_output(self, system, to, y, outcome)
    class(alpha_steps), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: to                !! [s]
    real(wp), intent(inout) :: y(:)
    integer, intent(out) :: outcome
    logical :: ok
    call pack_state(self%solver, self%y)
    call system%report(to, self%y, ok)
    y = self%y
    call hand_over(self, to, y, ok, outcome)
  end subroutine finish_output
end module alpha_fixed
