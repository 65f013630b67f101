!> Fixed steps of all methods: equal steps in each output interval, whose times are multiples and not sums. A step has pieces where
!> an event or a breakpoint lies in it. It is divided where it fails, or is too long for the motion that an event has started.
module fixed_march
  use kinds, only: wp, ip
  use event_location, only: find_event, keep_roots, restart_roots, pass_event
  use ode_system, only: ode
  use step_control, only: same_length
  use step_counts, only: same_instant, step_count
  use time_stepper, only: stepper, pass_stops, trouble_none
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
    real(wp) :: h, ends, longest              ! [s]
    logical :: ok, at_event, whole
    integer(ip) :: n
    if (self%roots%pending) then
      call pass_event(self, system)
      return
    end if
    associate (parts => self%settings%parts)
      n = step_count(from, to, parts*self%settings%step)
      longest = min(system%longest_fixed((to - from)/(real(n, wp)*parts), self%settings%order), huge(1.0_wp)/parts)
      call next_piece(self, from, to, n, parts*longest, h, whole)
    end associate
    if (self%output_due) return
    if (self%settings%parts > 1) call divide_piece(self, h, whole)
    ends = self%tried
    call self%try_step(system, h, ok)
    at_event = .false.
    if (ok .and. system%roots > 0) call find_event(self, system, h, at_event, ok)
    if (.not. ok) then
      call self%refuse()
      return
    end if
    if (system%roots > 0) call keep_roots(self, system, h, at_event)
    if (h > 0.0_wp) call self%accept_step(system, h)
    if (.not. at_event .and. at_stop(self)) call restart_roots(self, system)
    if (self%trouble /= trouble_none .or. abs(self%tried - ends) > 0.0_wp .or. .not. h > 0.0_wp) return
    if (self%settings%parts > 1) self%grid%left = self%grid%left - 1
    if (whole) call count_part(self, n)
  end subroutine fixed_attempt

  !> A finer pass divides every piece of a first one, also where a stop ends it: passes of like pieces would agree, however wrong.
  pure subroutine divide_piece(self, h, whole)
    class(stepper), intent(inout) :: self
    real(wp), intent(inout) :: h              !! [s]
    logical, intent(inout) :: whole           !! a part of the grid ends with it
    associate (g => self%grid)
      if (abs(self%tried - g%ends) > 0.0_wp .or. g%left < 1) then
        g%ends = self%tried
        g%left = self%settings%parts
      end if
      if (g%left == 1) return
      whole = .false.
      h = h/g%left
      self%tried = self%t + h
    end associate
  end subroutine divide_piece

  !> Whether the step that was tried ends at a stop.
  pure logical function at_stop(self) result(yes)
    class(stepper), intent(in) :: self
    yes = allocated(self%settings%stops)
    if (yes) yes = same_instant(self%settings%stops(self%next_stop), self%tried)
  end function at_stop

  !> The next step: its length, its end `tried`, and whether a part of the grid ends there. A stop within it ends it. The end of a
  !> part beside a stop is that stop, and a rest of a step joins the next one: pieces are not so short that rounding sets their
  !> accelerations. But a row stays where it is, unless the stop is at its time.
  subroutine next_piece(self, from, to, n, longest, h, whole)
    class(stepper), intent(inout) :: self
    real(wp), intent(in) :: from, to          !! [s]
    integer(ip), intent(in) :: n              !! steps in the interval
    real(wp), intent(in) :: longest           !! that events allow [s]
    real(wp), intent(out) :: h                !! [s]
    logical, intent(out) :: whole
    real(wp) :: full_step, ends, beside           ! [s]
    logical :: at_row
    full_step = (to - from)/real(n, wp)
    associate (g => self%grid)
      do
        do while (full_step/2**g%level > longest .and. g%level < most_levels)   ! again after each part that is passed over
          g%level = g%level + 1
          g%part = 2*g%part
        end do
        h = full_step/2**g%level
        ends = from + (real(g%done, wp) + real(g%part + 1, wp)/2**g%level)*full_step
        at_row = g%part + 1 == 2**g%level .and. g%done + 1 == n
        if (at_row) ends = to
        beside = merge(same_length, joined, at_row)*h
        if (abs(self%t - (from + (real(g%done, wp) + real(g%part, wp)/2**g%level)*full_step)) > 0.0_wp) then
          if (ends - self%t < joined*h) then
            call count_part(self, n)
            if (self%output_due) return
            cycle
          end if
          h = ends - self%t
        end if
        exit
      end do
    end associate
    self%tried = ends
    whole = .true.
    if (.not. allocated(self%settings%stops)) return
    call pass_stops(self%t, self%settings%stops, self%next_stop)
    associate (stop => self%settings%stops(self%next_stop))
      if (stop <= self%t .or. stop > ends + beside .or. same_instant(stop, ends)) return
      whole = stop >= ends - same_length*h
      self%tried = stop
      h = stop - self%t
    end associate
  end subroutine next_piece

  !> A part of a step is done; parts grow again as far as they fit. The last one of an output interval makes its row due.
  pure subroutine count_part(self, n)
    class(stepper), intent(inout) :: self
    integer(ip), intent(in) :: n              !! steps in the interval
    associate (g => self%grid)
      g%part = g%part + 1
      do while (g%level > 0 .and. mod(g%part, 2) == 0)
        g%level = g%level - 1
        g%part = g%part/2
      end do
      if (g%level > 0) return
      self%output_due = g%done + 1 == n
      g%part = 0
      g%done = merge(0_ip, g%done + 1, self%output_due)
    end associate
  end subroutine count_part
end module fixed_march
