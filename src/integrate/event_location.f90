!> Events: a step ends where a root of the system first falls to zero. The lengths of real steps from the present state are tried
!> until one ends there to rounding, so that an event has the method's own order (theory.md, section 11). Which length comes next
!> follows from the cubic Hermite interpolants of the roots between lengths that have been tried; a root that is positive at
!> both ends of such an interval but dips to zero between them is found by the minimum of its interpolant.
module event_location
  use kinds, only: wp
  use ode_system, only: ode
  use root_cubic, only: cubic_fall, possible_dip
  use root_path, only: first_suspect, root_suspect
  use step_counts, only: rounding_of
  use time_stepper, only: stepper, root_values, trouble_events
  implicit none (type, external)
  private
  public :: begin_roots, find_event, keep_roots, restart_roots, next_fall, pass_event

  real(wp), parameter :: same_event = 1.0e-12_wp   !! events so near are one, of the step [-]
  integer, parameter :: most_trials = 80           !! each second one halves the interval: more than the digits of a number
  integer, parameter :: quick_trials = 6           !! after which each second one halves the interval
  real(wp), parameter :: shortest_share = 1.0e-6_wp   !! of the run: time in which events may follow one another fast [-]
  integer, parameter :: most_recent = 1000         !! events in that time

contains

  !> Roots at the state from which a march begins.
  subroutine begin_roots(march, system)
    class(stepper), intent(inout) :: march
    class(ode), intent(inout) :: system
    associate (r => march%roots, n => system%roots)
      allocate (r%now%g(n), r%now%rate(n), r%end%g(n), r%end%rate(n), r%zero(n), source=0.0_wp)
      allocate (r%now%course(n), r%end%course(n))
      allocate (r%fallen(n), r%rounding(n), source=.false.)
      if (n == 0) return
      allocate (march%path(size(march%y), 0:5), march%inner(size(march%y)))
    end associate
    call present_roots(march, system)
  end subroutine begin_roots

  !> Roots at the present state.
  subroutine present_roots(march, system)
    class(stepper), intent(inout) :: march
    class(ode), intent(inout) :: system
    associate (r => march%roots)
      call system%find_roots(march%t, march%y, .false., r%now%g, r%now%rate, r%zero)
      call system%find_courses(r%now%course)
    end associate
  end subroutine present_roots

  !> Roots at the present state after loads may have jumped there: one that has become negative falls at once.
  subroutine restart_roots(march, system)
    class(stepper), intent(inout) :: march
    class(ode), intent(inout) :: system
    associate (r => march%roots)
      if (system%roots == 0) return
      call present_roots(march, system)
      r%pending = system%events_may_follow
      r%fallen = .false.
    end associate
  end subroutine restart_roots

  !> Whether a root falls within the step of length h that was tried. If so, h becomes the length of the step that ends there, which
  !> is then the one tried last; 0: the event is at the present state. ok is false where a shorter step of length h cannot be made.
  !> Roots that the path within the step gives are followed along it; others are known at the ends of steps alone.
  subroutine find_event(march, system, h, found, ok)
    class(stepper), intent(inout) :: march
    class(ode), intent(inout) :: system
    real(wp), intent(inout) :: h              !! [s]
    logical, intent(out) :: found, ok
    type(root_values) :: last                 ! of the step
    real(wp) :: full_step, target, s
    logical :: falls, followed(system%roots), others(system%roots)
    integer :: k
    full_step = h
    target = march%tried
    call roots_at_trial(march, system, h, march%roots%end)
    last = march%roots%end
    associate (r => march%roots)
      call follow_path(march, system, last, full_step, followed, h, found, ok)
      if (.not. ok) return
      others = .not. followed .or. r%now%g < -r%zero .or. (last%g < -r%zero .and. .not. found)
      call first_fall(r%now, last, r%zero, others, s, k, falls)
      if (falls .and. s <= same_event*full_step) then
        call end_at_start(march, last, k, h, found)
      else if (found) then
        call precede(march, system, others, full_step, h, ok)
      else if (k > 0) then
        call try_lengths(march, system, r%now, last, others, full_step, h, found, ok)
      end if
    end associate
    if (.not. ok) return
    if (found) then
      if (target - march%tried <= rounding_of(target)) march%tried = target
    else if (abs(h - full_step) > 0.0_wp) then    ! no root falls: the full step again
      h = full_step
      march%tried = target
      call march%try_step(system, h, ok)
    end if
  end subroutine find_event

  !> The event is at the present state.
  subroutine end_at_start(march, beyond, k, h, found)
    class(stepper), intent(inout) :: march
    type(root_values), intent(in) :: beyond
    integer, intent(in) :: k                  !! the root that falls
    real(wp), intent(inout) :: h              !! length of the step that was tried, then 0 [s]
    logical, intent(out) :: found
    found = .true.
    call mark_fallen(march, march%roots%now, beyond, k, beyond%h)
    h = 0.0_wp
  end subroutine end_at_start

  !> The first fall of roots along the path within the step that was tried, by real steps about each suspect.
  subroutine follow_path(march, system, last, full_step, followed, h, found, ok)
    class(stepper), intent(inout) :: march
    class(ode), intent(inout) :: system
    type(root_values), intent(in) :: last     !! at the end of the step
    real(wp), intent(in) :: full_step         !! its length [s]
    logical, intent(out) :: followed(:)       !! (roots) the path gives them, to the end of the step
    real(wp), intent(inout) :: h              !! [s]
    logical, intent(out) :: found, ok
    type(root_values) :: a
    type(root_suspect) :: suspect
    found = .false.
    ok = .true.
    call march%keep_path(full_step)
    a = march%roots%now
    a%h = 0.0_wp
    followed = .true.
    do while (a%h < full_step)
      call first_suspect(march, system, full_step, a, last, 0, followed, suspect, found)
      if (.not. found) return
      call try_suspect(march, system, suspect, followed, full_step, h, found, ok)
      if (found .or. .not. ok) return
      followed(suspect%root) = .false.        ! here the path is not good enough for it
      a = suspect%right
    end do
  end subroutine follow_path

  !> A real step of the length at which the path lets a root fall, and others about it. Where the two differ by half of the path's
  !> root at an end of the piece, that end is made real, too.
  subroutine try_suspect(march, system, suspect, watched, full_step, h, found, ok)
    class(stepper), intent(inout) :: march
    class(ode), intent(inout) :: system
    type(root_suspect), intent(inout) :: suspect
    logical, intent(in) :: watched(:)         !! (roots)
    real(wp), intent(in) :: full_step         !! [s]
    real(wp), intent(inout) :: h              !! [s]
    logical, intent(out) :: found, ok
    type(root_values) :: at
    real(wp) :: apart                         ! [any]
    associate (k => suspect%root, left => suspect%left, right => suspect%right)
      if (left%h <= 0.0_wp .and. suspect%h <= same_event*full_step) then
        ok = .true.
        call end_at_start(march, right, k, h, found)
        return
      end if
      found = .false.
      h = min(suspect%h, right%h)
      call try_length(march, system, h, at, ok)
      if (.not. ok) return
      apart = 2*abs(at%g(k))
      if (apart > left%g(k) .and. left%h > 0.0_wp) call retry(left)
      if (ok .and. apart > abs(right%g(k)) .and. right%h > at%h) call retry(right)
      if (ok) call try_lengths(march, system, left, right, watched, full_step, h, found, ok, at, k)
    end associate
  contains
    !> A real end of the piece.
    subroutine retry(end)
      type(root_values), intent(inout) :: end
      h = end%h
      call try_length(march, system, h, end, ok)
    end subroutine retry
  end subroutine try_suspect

  !> The step that `find_event` left is going to be accepted: its roots become those of the present state.
  subroutine keep_roots(march, system, h, found)
    class(stepper), intent(inout) :: march
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: h                 !! [s]
    logical, intent(in) :: found              !! it ends at an event
    associate (r => march%roots)
      if (h > 0.0_wp) call system%note_step(h, r%now%g, r%now%rate, r%end%g, r%end%rate)
      r%now%g = r%end%g
      r%now%rate = r%end%rate
      r%now%course = r%end%course
      r%pending = found
      if (h > 0.0_wp) r%rounding = .false.
    end associate
  end subroutine keep_roots

  !> Tries lengths of a step between two of them, between which roots may fall; or the one that was tried first.
  subroutine try_lengths(march, system, from, to, watched, full_step, h, found, ok, first, root)
    class(stepper), intent(inout) :: march
    class(ode), intent(inout) :: system
    type(root_values), intent(in) :: from, to
    logical, intent(in) :: watched(:)         !! (roots)
    real(wp), intent(in) :: full_step         !! [s]
    real(wp), intent(inout) :: h              !! length of the step that was tried last [s]
    logical, intent(out) :: found, ok
    type(root_values), intent(in), optional :: first
    integer, intent(in), optional :: root     !! that was to fall there
    type(root_values) :: left, right(most_trials + 2)   ! ends of intervals yet to be searched, the nearest one last
    real(wp) :: s
    integer :: n, k, trials
    logical :: falls
    ok = .true.
    found = .false.
    left = from
    right(1) = to
    n = 1
    trials = 0
    if (present(first)) then
      k = root
      if (first%h < to%h) n = 2
      right(n) = first
      if (n == 2) call guess_rates(left, right(2), right(1), march%roots%zero)
      if (.not. abs(first%h - h) > 0.0_wp) found = ends_event(march, left, right(n), watched, k)
    end if
    do while (.not. found)
      call first_fall(left, right(n), march%roots%zero, watched, s, k, falls)
      if (k == 0) then
        found = .false.
        if (n == 1) exit
        left = right(n)
        n = n - 1
        cycle
      end if
      found = falls .and. (right(n)%h - left%h <= same_event*full_step .or. trials == most_trials)
      if (falls .and. left%h <= 0.0_wp .and. s <= same_event*full_step) found = .true.
      if (found .and. left%h <= 0.0_wp) h = 0.0_wp
      if (found .or. trials == most_trials) exit
      if ((trials >= quick_trials .and. mod(trials, 2) == 0) .or. .not. left%h + s > left%h) s = 0.5_wp*(right(n)%h - left%h)
      trials = trials + 1
      h = left%h + s
      found = .not. h < right(n)%h
      call try_length(march, system, h, right(n + 1), ok)
      if (.not. ok) return
      if (found) exit
      n = n + 1
      call guess_rates(left, right(n), right(n - 1), march%roots%zero)
      found = ends_event(march, left, right(n), watched, k)
    end do
    if (.not. found) return
    if (abs(h - left%h) > 0.0_wp) left = right(n)
    call mark_fallen(march, left, right(n), k, full_step)
  end subroutine try_lengths

  !> A step of some length, and the roots at its end.
  subroutine try_length(march, system, h, at, ok)
    class(stepper), intent(inout) :: march
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: h                 !! [s]
    type(root_values), intent(inout) :: at
    logical, intent(out) :: ok
    march%tried = march%t + h
    march%roots%locating = .true.
    call march%try_step(system, h, ok)
    march%roots%locating = .false.
    if (ok) call roots_at_trial(march, system, h, at)
  end subroutine try_length

  !> Roots that are not followed may fall before the event that the path has shown.
  subroutine precede(march, system, watched, full_step, h, ok)
    class(stepper), intent(inout) :: march
    class(ode), intent(inout) :: system
    logical, intent(in) :: watched(:)         !! (roots)
    real(wp), intent(in) :: full_step         !! [s]
    real(wp), intent(inout) :: h              !! [s]
    logical, intent(out) :: ok
    type(root_values) :: event
    real(wp) :: s, event_length
    integer :: k
    logical :: falls, found
    ok = .true.
    event = march%roots%end
    event_length = h
    if (.not. h > 0.0_wp) return
    call first_fall(march%roots%now, event, march%roots%zero, watched, s, k, falls)
    if (k > 0) call try_lengths(march, system, march%roots%now, event, watched, full_step, h, found, ok)
    if (k == 0 .or. found .or. .not. ok .or. .not. abs(h - event_length) > 0.0_wp) return
    h = event_length
    call try_length(march, system, h, event, ok)
  end subroutine precede

  !> Whether the step that was tried last ends at the fall of root k, and nothing falls before.
  logical function ends_event(march, left, right, watched, k) result(yes)
    class(stepper), intent(in) :: march
    type(root_values), intent(in) :: left, right
    logical, intent(in) :: watched(:)         !! (roots)
    integer, intent(in) :: k
    real(wp) :: s
    integer :: other
    logical :: falls
    yes = .false.
    if (abs(right%g(k)) > march%roots%zero(k)) return
    if (right%rate(k) > 0.0_wp .and. right%rate(k) < huge(1.0_wp)) return
    call first_fall(left, right, march%roots%zero, watched, s, other, falls)
    yes = other == 0
  end function ends_event

  !> Roots that have fallen where a step ends: root k, and those that fall with it but for rounding.
  subroutine mark_fallen(march, at, beyond, k, full_step)
    class(stepper), intent(inout) :: march
    type(root_values), intent(in) :: at           !! where it falls
    type(root_values), intent(in) :: beyond       !! end of that interval: what is positive there only touched zero
    integer, intent(in) :: k
    real(wp), intent(in) :: full_step             !! length of the step within which they fall [s]
    associate (r => march%roots)
      r%fallen = at%rate < 0.0_wp .and. at%g <= max(r%zero, -same_event*full_step*at%rate) .and. &
                 .not. (r%rounding .or. (beyond%h > at%h .and. beyond%g > r%zero))
      r%fallen(k) = .true.
      r%end = at
    end associate
  end subroutine mark_fallen

  !> Roots at the end of the step that was tried.
  subroutine roots_at_trial(march, system, h, at)
    class(stepper), intent(inout) :: march
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: h                 !! [s]
    type(root_values), intent(inout) :: at
    at%h = h
    if (.not. allocated(at%g)) allocate (at%g(system%roots), at%rate(system%roots), at%course(system%roots))
    call march%pack_trial()
    associate (r => march%roots)
      call system%find_roots(march%tried, march%trial, .true., at%g, at%rate, r%zero)
      call system%find_courses(at%course)
      where (r%rounding) r%zero = huge(1.0_wp)
    end associate
  end subroutine roots_at_trial

  !> Rates of the parabola through three lengths: those that the system does not give, and those of roots that fall. The end of a
  !> longer step is not that of a longer time, since errors grow with the length, so that such a root has another slope there. Where
  !> a root only may fall, the parabola is too coarse.
  pure subroutine guess_rates(left, at, right, zero)
    type(root_values), intent(inout) :: left, at, right
    real(wp), intent(in) :: zero(:)           !! (roots) values so small are zero [any]
    real(wp) :: a, b
    integer :: k
    do k = 1, size(at%g)
      if ((at%rate(k) < huge(1.0_wp) .and. right%g(k) >= -zero(k)) .or. max(left%g(k), at%g(k), right%g(k)) >= huge(1.0_wp)) cycle
      a = (at%g(k) - left%g(k))/(at%h - left%h)
      b = (right%g(k) - at%g(k))/(right%h - at%h)
      at%rate(k) = (a*(right%h - at%h) + b*(at%h - left%h))/(right%h - left%h)
      left%rate(k) = 2*a - at%rate(k)
      right%rate(k) = 2*b - at%rate(k)
    end do
  end subroutine guess_rates

  !> Length after the left one at which a root first falls to zero by its interpolant; k = 0: none does. Where a root is positive at
  !> both ends and only its interpolant dips to zero, falls is false and the length is that of the minimum, to be tried. An
  !> interpolant may err by the depth of the dip.
  pure subroutine first_fall(left, right, zero, watched, s, k, falls)
    type(root_values), intent(in) :: left, right
    real(wp), intent(in) :: zero(:)           !! (roots) values so small are zero [any]
    logical, intent(in) :: watched(:)         !! (roots)
    real(wp), intent(out) :: s                !! [s]
    integer, intent(out) :: k
    logical, intent(out) :: falls             !! it has fallen at the right end
    real(wp) :: h, g(0:1), d(0:1), x
    logical :: known                          ! rates at both ends
    integer :: i
    h = right%h - left%h
    s = huge(1.0_wp)
    d = 0.0_wp
    k = 0
    falls = .false.
    do i = 1, size(zero)
      g = [left%g(i), right%g(i)]
      if (.not. watched(i) .or. max(g(0), g(1)) >= huge(1.0_wp)) cycle
      known = max(left%rate(i), right%rate(i)) < huge(1.0_wp)
      if (known) d = h*[left%rate(i), right%rate(i)]
      ! a cubic dips below its ends by 4/27 of both slopes at most: a root far from zero
      if (known .and. min(g(0), g(1)) > 8/27.0_wp*(abs(d(0)) + abs(d(1)))) cycle
      if (g(0) <= zero(i)) g(0) = 0.0_wp
      if (.not. known) d = g(1) - g(0)
      if (g(1) < -zero(i)) then
        x = cubic_fall(g, d)
      else
        x = possible_dip(g, d, zero(i))
      end if
      if (x > 1.0_wp .or. h*x >= s) cycle
      s = h*x
      k = i
      falls = g(1) < -zero(i)
    end do
  end subroutine first_fall

  !> Time to the first fall of a root within a step of length h that was tried and is refused; huge: none falls [s].
  real(wp) function next_fall(march, system, h) result(s)
    class(stepper), intent(inout) :: march
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: h                 !! [s]
    integer :: k
    logical :: falls
    call roots_at_trial(march, system, h, march%roots%end)
    call first_fall(march%roots%now, march%roots%end, march%roots%zero, spread(.true., 1, system%roots), s, k, falls)
    if (.not. s > same_event*h) s = huge(1.0_wp)
  end function next_fall

  !> Lets the system resolve the event at the present state; the march starts anew. Where nothing changes, the fall was rounding:
  !> very short steps know rates badly. The solution is lost where events follow one another without end.
  subroutine pass_event(march, system)
    class(stepper), intent(inout) :: march
    class(ode), intent(inout) :: system
    logical :: ok
    associate (r => march%roots, stops => march%settings%stops)
      r%pending = .false.
      if (march%t - r%since > shortest_share*stops(size(stops))) then
        r%since = march%t
        r%recent = 0
      end if
      r%recent = r%recent + 1
      call march%restart(system, ok)
      r%rounding = system%unchanged .and. (r%rounding .or. r%fallen)
      if (.not. ok .or. r%recent > most_recent) march%trouble = trouble_events
      call present_roots(march, system)
    end associate
  end subroutine pass_event
end module event_location
