!> Fixed steps of all methods: equal steps in each output interval, whose times are multiples and not sums. A step has pieces where
!> an event or a breakpoint lies in it. It is divided where it fails, or is too long for the motion that an event has started.
module fixed_march
  use kinds, only: wp, ip
  use event_location, only: find_event, keep_roots, restart_roots, pass_event
  use ode_system, only: ode
  use step_control, only: same_length
  use step_counts, only: step_count, rounding_of
  use time_stepper, only: stepper, step_grid, trouble_none
  implicit none (type, external)
  private
  public :: at_stop, fixed_attempt

  real(wp), parameter :: joined = 1.0e-6_wp    !! a rest of a step that is shorter joins the next one, of the step [-]
  integer, parameter :: most_levels = 20       !! of divisions after an event

contains

  !> Tries the next step, or piece of one, and accepts it, or passes an event.
  subroutine fixed_attempt(self, system, from, to)
    class(stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: from, to          !! last and next output time [s]
    real(wp) :: h, ends
    logical :: ok, at_event
    integer(ip) :: n
    if (self%roots%pending) then
      call pass_event(self, system)
      return
    end if
    n = step_count(from, to, self%settings%step)
    call next_piece(self, from, to, n, system%longest_fixed((to - from)/real(n, wp), self%settings%order), h, ends)
    if (self%output_due) return
    call self%try_step(system, h, ok)
    at_event = .false.
    if (ok .and. system%roots > 0) call find_event(self, system, h, at_event, ok)
    if (.not. ok) then
      call self%refuse()
      return
    end if
    if (system%roots > 0) call keep_roots(self, system, h, at_event)
    if (h > 0.0_wp) call self%accept_step(system, h)
    if (.not. at_event .and. at_stop(self, h)) call restart_roots(self, system)
    if (self%trouble == trouble_none .and. abs(self%tried - ends) <= 0.0_wp .and. h > 0.0_wp) call count_part(self%grid, n)
  end subroutine fixed_attempt

  !> Whether the step that was tried, of length h, ends at a stop.
  pure logical function at_stop(self, h) result(yes)
    class(stepper), intent(in) :: self
    real(wp), intent(in) :: h                 !! [s]
    yes = allocated(self%settings%stops)
    if (yes) yes = self%settings%stops(self%next_stop) <= self%tried + same_length*h + rounding_of(self%tried)
  end function at_stop

  !> The next step: its length, its end `tried`, and the end of the part of the grid that it belongs to. A stop within it ends it.
  subroutine next_piece(self, from, to, n, longest, h, ends)
    class(stepper), intent(inout) :: self
    real(wp), intent(in) :: from, to          !! [s]
    integer(ip), intent(in) :: n              !! steps in the interval
    real(wp), intent(in) :: longest           !! that events allow [s]
    real(wp), intent(out) :: h, ends          !! [s]
    real(wp) :: full_step, tolerance              ! [s]
    full_step = (to - from)/real(n, wp)
    associate (g => self%grid)
      do
        do while (full_step/2**g%level > longest .and. g%level < most_levels)   ! again after each part that is passed over
          g%level = g%level + 1
          g%part = 2*g%part
        end do
        h = full_step/2**g%level
        ends = from + (real(g%done, wp) + real(g%part + 1, wp)/2**g%level)*full_step
        if (g%part + 1 == 2**g%level .and. g%done + 1 == n) ends = to
        if (abs(self%t - (from + (real(g%done, wp) + real(g%part, wp)/2**g%level)*full_step)) > 0.0_wp) then
          if (ends - self%t < joined*h) then
            call count_part(g, n)
            self%output_due = g%done == 0 .and. g%part == 0
            if (self%output_due) return
            cycle
          end if
          h = ends - self%t
        end if
        exit
      end do
    end associate
    self%tried = ends
    if (.not. allocated(self%settings%stops)) return
    associate (stops => self%settings%stops, k => self%next_stop)
      tolerance = same_length*h + rounding_of(ends)
      do while (stops(k) <= self%t + tolerance .and. k < size(stops))
        k = k + 1
      end do
      if (stops(k) <= self%t + tolerance .or. stops(k) >= ends - tolerance) return
      h = stops(k) - self%t
      self%tried = stops(k)
    end associate
  end subroutine next_piece

  !> A part of a step is done; parts grow again as far as they fit.
  pure subroutine count_part(g, n)
    type(step_grid), intent(inout) :: g
    integer(ip), intent(in) :: n              !! steps in the interval
    g%part = g%part + 1
    do while (g%level > 0 .and. mod(g%part, 2) == 0)
      g%level = g%level - 1
      g%part = g%part/2
    end do
    if (g%level > 0) return
    g%part = 0
    g%done = merge(0_ip, g%done + 1, g%done + 1 == n)
  end subroutine count_part
end module fixed_march
