!> Pairs of the model from their records: what a joint or stop of type 'profile' measures. A follower that does not fit everywhere
!> on its profile is a fault of the deck.
module build_profiles
  use kinds, only: half_digits, pi, wp
  use build_history, only: make_history
  use contact_pair, only: pair_measure
  use curve_profile, only: curve_model, flaw_concave, flaw_double, flaw_hollow, flaw_undercut, pair_limits
  use deck_origin, only: origin
  use deck_records, only: deck, profile_record
  use errors, only: fault_list
  use history, only: breakpoint, history_model, merged
  use law_profile, only: flat_model, law_model, spline_model
  use measure, only: measure_model
  use profile, only: circle_model, profile_model
  use sequence_history, only: sequence_model
  use sorting, only: ascending
  use table_history, only: table_model
  use table_slopes, only: ends_free, ends_periodic, spline_slopes
  use text, only: either, quoted, to_text
  implicit none (type, external)
  private
  public :: by_angle, make_pair, watch_pair

  integer, parameter :: arcs = 64            !! into which the curve of a law is cut, where it has no corners

contains

  !> The gap of a pair.
  subroutine make_pair(d, at, number, radius, face, item, faults)
    type(deck), intent(in) :: d
    type(origin), intent(in) :: at                    !! the joint or stop
    integer, intent(in) :: number                     !! of the profile
    real(wp), intent(in) :: radius                    !! of the roller [m]
    real(wp), intent(in) :: face                      !! of a flat face's normal, huge: there is none [rad]
    class(measure_model), allocatable, intent(out) :: item
    type(fault_list), intent(inout) :: faults
    type(pair_measure), allocatable :: pair
    type(pair_limits) :: found
    integer :: before
    before = faults%count
    allocate (pair)
    pair%radius = radius
    pair%flat = face < huge(1.0_wp)
    if (pair%flat) pair%face = face
    associate (r => d%profiles(number))
      call make_profile(d, r, pair%profile, faults)
      pair%acts = [.true., .true., pair%flat, .true., .true., .not. pair%profile%round]
      if (r%hollow) pair%span = r%radius - radius
      select type (curve => pair%profile)
      class is (curve_model)
        if (faults%count == before) then
          call curve%examine(radius, pair%flat, found)
          if (found%flaw > 0) call blame_fit(r, curve, at, radius, found, faults)
        end if
      end select
    end associate
    call move_alloc(pair, item)
  end subroutine make_pair

  !> Gives a pair the number of what watches the corners of its law, and that law to it; not allocated: there are none.
  subroutine watch_pair(gap, number, law)
    class(measure_model), intent(inout) :: gap
    integer, intent(in) :: number                     !! of the watcher
    class(history_model), allocatable, intent(out) :: law
    select type (gap)
    class is (pair_measure)
      select type (curve => gap%profile)
      class is (law_model)
        if (size(curve%law%corners) == 0) return
        allocate (law, source=curve%law)
        gap%watcher = number
      end select
    end select
  end subroutine watch_pair

  !> Makes a pair measure how far its law has come in place of its gap.
  subroutine by_angle(gap)
    class(measure_model), intent(inout) :: gap
    gap%angular = .true.
    select type (gap)
    class is (pair_measure)
      gap%by_angle = .true.
    end select
  end subroutine by_angle

  !> The factory of profiles.
  subroutine make_profile(d, r, item, faults)
    type(deck), intent(in) :: d
    type(profile_record), intent(in) :: r
    class(profile_model), allocatable, intent(out) :: item
    type(fault_list), intent(inout) :: faults
    class(law_model), allocatable :: law
    class(history_model), allocatable :: once         ! over one turn
    type(circle_model), allocatable :: circle
    real(wp), allocatable :: marks(:)                 ! ends of arcs and corners of the law [rad]
    integer :: k, before
    before = faults%count
    select case (r%kind)
    case ('circle')
      allocate (circle)
      circle%radius = merge(-r%radius, r%radius, r%hollow)
      circle%round = .true.
      call move_alloc(circle, item)
    case ('points')
      call make_spline(r, item)
    case default
      if (r%follower == 'flat') then
        allocate (flat_model :: law)
        law%base = [0.0_wp, r%base_radius]
      else
        allocate (law)
        law%inset = r%radius
        law%arm = r%arm
        law%base = r%pivot
        if (.not. r%arm > 0.0_wp) law%base = [r%offset, sqrt(max((r%base_radius + r%radius)**2 - r%offset**2, 0.0_wp))]
      end if
      law%sense = merge(1.0_wp, -1.0_wp, r%clockwise)
      call make_history(d, r%history, once)
      call check_law(r, once, faults)
      call by_turns(once, merge(2, 3, d%transient%adaptive .or. d%transient%method == 'generalized_alpha'), law%law)
      if (faults%count == before) then
        marks = [[(2*pi*k/arcs, k=0, arcs)], modulo(law%sense*law%law%breaks%time, 2*pi)]
        marks = marks(ascending(marks))
        call law%cut(pack(marks, [.true., marks(2:) > marks(:size(marks) - 1)]))
      end if
      call move_alloc(law, item)
    end select
    item%name = r%name
  end subroutine make_profile

  !> A law that goes on for ever, with its corners. With fixed steps of a higher order those of the third derivative count as well;
  !> else they are left to an error that is controlled, as those between the points of a table, which are too many for events.
  !> Where there are corners, two stand half a turn apart, so that no piece is longer.
  subroutine by_turns(once, order, law)
    class(history_model), allocatable, intent(inout) :: once
    integer, intent(in) :: order                      !! highest derivative whose jumps are corners
    class(history_model), allocatable, intent(out) :: law
    type(sequence_model), allocatable :: turns
    integer :: most
    most = order
    select type (once)
    class is (table_model)
      most = 2
    end select
    allocate (turns)
    allocate (turns%parts(1))
    call move_alloc(once, turns%parts(1)%item)
    call turns%set(0.0_wp, [2*pi], .true.)
    if (size(turns%breaks) == 1 .and. turns%breaks(1)%order > 2) turns%breaks = turns%breaks(:0)   ! smooth
    if (any(turns%breaks%order <= most)) turns%breaks = merged(turns%breaks, [breakpoint(0.0_wp, most), breakpoint(pi, most)])
    call turns%keep_corners(most)
    call move_alloc(turns, law)
  end subroutine by_turns

  !> A law is smooth and ends as it begins.
  subroutine check_law(r, law, faults)
    type(profile_record), intent(in) :: r
    class(history_model), intent(in) :: law
    type(fault_list), intent(inout) :: faults
    integer, parameter :: samples = 64                ! of a turn, which show how large the law is
    real(wp) :: first(-1:2), last(-1:2), inner(-1:2), size_of
    real(wp) :: turns                                 ! of the cam in a period of the law [-]
    integer :: k
    call law%evaluate(0.0_wp, .false., first)
    call law%evaluate(2*pi, .true., last)
    size_of = maxval(abs([first(0:1), last(0:1)]))
    do k = 1, samples - 1
      call law%evaluate(k*(2*pi/samples), .false., inner)
      size_of = max(size_of, maxval(abs(inner(0:1))))
    end do
    if (law%lowest_order() < 2) call r%at%blame(faults, 'history='//quoted(trim(law%name))//' jumps or has a corner, which no '// &
      'profile has, expected a law with continuous value and slope (kind=''ramp'', ''cycloid'' or a spline)')
    turns = 2*pi/max(law%period, tiny(1.0_wp)**0.5_wp)
    if (law%period > 0.0_wp .and. abs(turns - anint(turns)) > half_digits*turns) then
      call r%at%blame(faults, 'history='//quoted(trim(law%name))//' repeats after '//short(law%period)// &
                      ', expected 2*pi, a turn of the cam in rad')
    else if (any(abs(last(0:1) - first(0:1)) > half_digits*size_of)) then
      call r%at%blame(faults, 'history='//quoted(trim(law%name))//' begins at 0 with '//short(first(0))//' and slope '// &
        short(first(1))//' and ends at 2*pi with '//short(last(0))//' and slope '//short(last(1))// &
        ', expected the same after a turn of the cam (2*pi rad)')
    end if
  end subroutine check_law

  !> A spline through points, counter-clockwise about its inside, or with its free side on the right.
  subroutine make_spline(r, item)
    type(profile_record), intent(in) :: r
    class(profile_model), allocatable, intent(out) :: item
    type(spline_model), allocatable :: curve
    real(wp), allocatable :: x(:), y(:), u(:)
    integer :: k, n
    x = r%scale*r%x
    y = r%scale*r%y
    n = size(x)
    if (r%closed) then                                ! the last point may be the first one, as files have it
      if (hypot(x(n) - x(1), y(n) - y(1)) <= half_digits*maxval(hypot(x, y))) n = n - 1
      x = [x(:n), x(1)]
      y = [y(:n), y(1)]
      n = n + 1
    end if
    if (.not. r%closed .or. sum(x(:n - 1)*y(2:) - x(2:)*y(:n - 1)) < 0.0_wp) then
      x = x(n:1:-1)
      y = y(n:1:-1)
    end if
    allocate (u(n), source=0.0_wp)
    do k = 2, n
      u(k) = u(k - 1) + hypot(x(k) - x(k - 1), y(k) - y(k - 1))
    end do
    allocate (curve)
    curve%closed = r%closed
    curve%half = 0.5_wp*u(n)
    call coordinate(x, curve%x)
    call coordinate(y, curve%y)
    call curve%cut(u)
    call move_alloc(curve, item)
  contains
    !> One coordinate over the length of the chords.
    subroutine coordinate(values, h)
      real(wp), intent(in) :: values(:)               !! [m]
      class(history_model), allocatable, intent(out) :: h
      type(table_model), allocatable :: table
      real(wp) :: w(n - 1), chord(n - 1), slopes(n)
      w = u(2:) - u(:n - 1)
      chord = (values(2:) - values(:n - 1))/w
      call spline_slopes(w, chord, merge(ends_periodic, ends_free, r%closed), slopes)
      allocate (table)
      call table%set(u, values, reshape([(slopes(k:k + 1), k=1, n - 1)], [2, n - 1]), .false.)
      call move_alloc(table, h)
    end subroutine coordinate
  end subroutine make_spline

  !> Where a follower does not fit, and what helps.
  subroutine blame_fit(r, curve, at, radius, found, faults)
    type(profile_record), intent(in) :: r
    class(curve_model), intent(in) :: curve
    type(origin), intent(in) :: at                    !! the joint or stop
    real(wp), intent(in) :: radius                    !! of its roller [m]
    type(pair_limits), intent(in) :: found
    type(fault_list), intent(inout) :: faults
    character(:), allocatable :: where, text, bend
    real(wp) :: range(2)                              ! [rad] or [m]
    where = ' from '//short(found%range(1))//' to '//short(found%range(2))//' m along its points'
    select type (curve)
    class is (law_model)
      range = modulo(curve%sense*found%range, 2*pi)
      if (curve%sense < 0.0_wp) range = range(2:1:-1)
      where = ' from '//short(range(1)*180/pi)//' to '//short(range(2)*180/pi)//' degrees of the cam'
    end select
    bend = 'its radius of curvature falls to '//short(found%radius)//' m'
    select case (found%flaw)
    case (flaw_undercut)
      text = 'is undercut'//where//': '//either(bend//', below 0, expected a larger base_radius', 'that of the roller''s path '// &
        'falls to '//short(found%radius)//' m, expected more than radius='//short(curve%inset)//' m, by a '// &
        'larger base_radius or a smaller radius', r%follower == 'flat')
    case (flaw_concave)
      text = 'is hollow'//where//', where a flat face cannot touch it, expected a profile that is convex all round, or a roller'
    case (flaw_hollow)
      text = 'is hollow'//where//', where '//bend//', expected a roller of less than that, not of radius='// &
             short(radius)//' m'
    case default
      text = 'is touched at two places at once by the follower'//where//', expected a smaller roller or a plainer profile'
    end select
    call at%blame(faults, 'profile '''//trim(r%name)//''' '//text)
  end subroutine blame_fit

  !> A number in four digits.
  function short(x) result(t)
    real(wp), intent(in) :: x                         !! [any]
    character(:), allocatable :: t
    real(wp) :: unit
    unit = 10.0_wp**(floor(log10(max(abs(x), 1.0e-99_wp))) - 3)
    t = to_text(anint(x/unit)*unit)
  end function short
end module build_profiles
