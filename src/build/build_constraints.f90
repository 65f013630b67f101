!> Joints and drives of the model from their records: the factories of both.
module build_constraints
  use kinds, only: ip, wp, pi
  use build_history, only: make_history
  use build_profiles, only: make_pair
  use constraint, only: constraint_model
  use contact_pair, only: pair_measure
  use deck_records, only: deck, joint_record, drive_record, stop_record
  use errors, only: fault_list
  use friction_law, only: coulomb_law, on_pin, on_line, on_pads, on_stop
  use friction_row, only: friction_model
  use history, only: breakpoint, history_model, locate
  use measure, only: measure_model
  use measures, only: difference, distance, line, turns
  use pair_slip_measure, only: pair_slip, pin_in_hole
  use scene_model, only: scene
  use sequence_history, only: sequence_model
  use step_counts, only: rounding_of
  use sum_history, only: compound_model, sum_model
  use text, only: either, short_text
  implicit none (type, external)
  private
  public :: make_constraints, place_friction

  integer, parameter :: jumps_shown = 3    !! jumps of a history that are reported one by one

contains

  !> Joints, drives, then rows that switch, each of its kind; they have no markers and no numbered rows yet.
  subroutine make_constraints(d, s, faults)
    type(deck), intent(in) :: d
    type(scene), intent(inout) :: s
    type(fault_list), intent(inout) :: faults
    logical :: rubs(size(d%joints)), scrapes(size(d%stops))
    integer :: k, n
    rubs = max(d%joints%friction, d%joints%friction_static, d%joints%preload, d%joints%preload_static) > 0.0_wp
    scrapes = max(d%stops%friction, d%stops%friction_static) > 0.0_wp
    s%joints = size(d%joints)
    s%permanent = s%joints + size(d%drives)
    n = count(rubs) + count(scrapes)
    allocate (s%friction(n), s%constraints(s%permanent + n))
    do k = 1, s%permanent
      if (k <= s%joints) then
        call make_joint(d%joints(k), s%constraints(k)%item)
      else
        call make_drive(d%drives(k - s%joints), s%constraints(k)%item)
      end if
    end do
    n = s%permanent
    do k = 1, s%joints
      if (.not. rubs(k)) cycle
      n = n + 1
      call make_friction(d%joints(k), k, s%constraints(n)%item)
    end do
    do k = 1, size(d%stops)
      if (.not. scrapes(k)) cycle
      n = n + 1
      call make_stop_friction(d%stops(k), s%permanent + size(d%springs) + size(d%forces) + k, s%constraints(n)%item)
    end do
  contains
    !> The factory of joints: the deck's word into the kind.
    subroutine make_joint(r, item)
      type(joint_record), intent(in) :: r
      class(constraint_model), allocatable, intent(out) :: item
      class(measure_model), allocatable :: gap
      allocate (item)
      select case (r%type)
      case ('revolute', 'weld')
        call item%hold(difference(1), pending=r%as_assembled)
        call item%hold(difference(2), pending=r%as_assembled)
      case ('slider', 'prismatic')
        call item%hold(line(r%direction + pi/2, r%b%body == 0))
      case ('gear')
        call item%hold(turns(r%ratio), deck_angle(r%a%body) - deck_angle(r%c%body) &
                       - r%ratio*(deck_angle(r%b%body) - deck_angle(r%c%body)))
      case ('profile')
        call make_pair(d, r%at, r%profile, r%radius, r%face, gap, faults)
        call item%hold(gap)
      case default
        call item%hold(distance(), r%length, pending=r%length <= 0.0_wp)
      end select
      if (any(r%type == [character(9) :: 'weld', 'prismatic'])) &
        call item%hold(difference(3), deck_angle(r%a%body) - deck_angle(r%b%body))
      item%name = r%name
    end subroutine make_joint

    !> The tangential row of a joint with friction.
    subroutine make_friction(r, joint, item)
      type(joint_record), intent(in) :: r
      integer, intent(in) :: joint
      class(constraint_model), allocatable, intent(out) :: item
      type(coulomb_law) :: law
      type(pair_slip) :: slip
      law = coulomb_law(on_line, r%friction, max(r%friction, r%friction_static), r%preload, max(r%preload, r%preload_static), &
                        r%pin_radius, r%pad_distance)
      if (r%type == 'revolute') law%contact = on_pin
      if (r%pad_distance > 0.0_wp) law%contact = on_pads
      item = friction_model(law=law, parent=joint)
      if (r%type == 'revolute') then
        call item%hold(difference(3))
      else if (r%type == 'profile') then
        slip%acts = .true.
        call item%hold(slip)
      else
        call item%hold(line(r%direction, r%b%body == 0))
      end if
      item%name = r%name
    end subroutine make_friction

    !> The tangential row of a stop that yields: along the profile, of the surface of a pin in its hole, along the line on which a
    !> position stands.
    subroutine make_stop_friction(r, parent, item)
      type(stop_record), intent(in) :: r
      integer, intent(in) :: parent
      class(constraint_model), allocatable, intent(out) :: item
      type(pair_slip) :: slip
      item = friction_model(law=coulomb_law(on_stop, r%friction, max(r%friction, r%friction_static)), parent=parent)
      if (r%type == 'position') then
        call item%hold(line(r%direction + pi/2, r%b%body == 0))
      else
        if (r%type == 'clearance') slip%pair_measure = pin_in_hole(r%pin_radius, r%upper)
        slip%acts = .true.
        call item%hold(slip)
      end if
      item%name = r%name
    end subroutine make_stop_friction

    !> Angle of a body in the deck, 0 for the ground [rad].
    pure function deck_angle(k) result(angle)
      integer, intent(in) :: k
      real(wp) :: angle
      angle = 0.0_wp
      if (k > 0) angle = d%bodies(k)%angle
    end function deck_angle

    !> The factory of drives.
    subroutine make_drive(r, item)
      type(drive_record), intent(in) :: r
      class(constraint_model), allocatable, intent(out) :: item
      class(history_model), allocatable :: h
      call make_history(d, r%history, h)
      call check_smooth(r, h)
      allocate (item)
      item%drive = .true.
      item%rate = r%rate
      call move_alloc(h, item%target)
      if (r%type == 'rotation') then
        call item%hold(difference(3), pending=r%relative)
      else
        call item%hold(line(r%direction, r%b%body == 0), pending=r%relative)
      end if
      item%name = r%name
    end subroutine make_drive

    !> A drive cannot follow a jump, nor a jump of slope where the quantity itself is driven.
    subroutine check_smooth(r, h)
      type(drive_record), intent(in) :: r
      class(history_model), intent(in) :: h
      type(breakpoint), allocatable :: breakpoints(:)
      character(:), allocatable :: remedy
      integer :: k
      if (.not. d%transient%present) return            ! nothing else looks beyond t = 0
      breakpoints = h%breakpoints(d%transient%t_end)
      breakpoints = pack(breakpoints, breakpoints%order <= merge(0, 1, r%rate))
      do k = 1, min(size(breakpoints), jumps_shown)
        remedy = remedy_of(h, breakpoints(k)%time, breakpoints(k)%order)
        if (len(remedy) > 0) remedy = ': '//remedy
        call r%at%blame(faults, 'history "'//trim(h%name)//'" has a jump'// &
                        either(' of slope', '', breakpoints(k)%order == 1)//' at t = '// &
                        short_text(breakpoints(k)%time, 5)//' s, which no mechanism can follow; expected a '// &
                        'history with continuous '//either('values', 'value and slope', r%rate)//remedy)
      end do
    end subroutine check_smooth
  end subroutine make_constraints

  !> What a user can do about a jump of a history: that of the part from which most of it comes.
  recursive function remedy_of(h, t, order) result(remedy)
    class(history_model), intent(in) :: h
    real(wp), intent(in) :: t                     !! [s]
    integer, intent(in) :: order                  !! derivative that jumps
    character(:), allocatable :: remedy
    real(wp) :: before(-1:2), after(-1:2), x, shift   ! [any], [s]
    real(wp), allocatable :: jumps(:)             ! [any]
    integer(ip) :: turn
    integer :: k
    remedy = h%remedy
    select type (h)
    class is (compound_model)
      allocate (jumps(size(h%parts)))
      do k = 1, size(h%parts)
        call h%parts(k)%item%evaluate(t, .true., before)
        call h%parts(k)%item%evaluate(t, .false., after)
        jumps(k) = abs(after(order) - before(order))
      end do
      select type (h)
      class is (sum_model)
        jumps = abs(h%factors)*jumps
      end select
      k = maxloc(jumps, 1)
      remedy = 'in "'//trim(h%parts(k)%item%name)//'" '//remedy_of(h%parts(k)%item, t, order)
    class is (sequence_model)
      call locate(h%begins, h%period, t, .false., shift, turn, k, x)
      if (k < 1 .or. k > size(h%parts)) return
      if (min(x, h%begins(k + 1) - h%begins(k) - x) <= rounding_of(t)) return   ! where parts meet
      remedy = 'in "'//trim(h%parts(k)%item%name)//'" '//remedy_of(h%parts(k)%item, x, order)
    end select
  end function remedy_of

  !> Gives tangential rows the markers and the rows of their joints, or the markers of their stops, and their laws to the scene.
  subroutine place_friction(s)
    type(scene), intent(inout) :: s               !! joints and stops are placed
    integer :: k
    do k = 1, size(s%friction)
      select type (c => s%constraints(s%permanent + k)%item)
      class is (friction_model)
        associate (law => c%law)
          law%size = s%size
          law%row = c%first
          law%number = c%switch_number
          if (c%parent > s%permanent) then
            law%element = c%parent - s%permanent
            associate (stop => s%forces(law%element)%item)
              call follow(c%measures(1)%item, stop%measure)
              call c%attach(stop%ia, stop%ib, 0)
            end associate
          else
            associate (joint => s%constraints(c%parent)%item)
              law%first = joint%first
              law%rows = joint%rows
              call follow(c%measures(1)%item, joint%measures(1)%item)
              call c%attach(joint%ia, joint%ib, 0)
            end associate
          end if
          s%friction(k) = law
        end associate
      end select
    end do
  end subroutine place_friction

  !> Slip along a profile is that of the pair whose gap is given.
  subroutine follow(slip, gap)
    class(measure_model), intent(inout) :: slip
    class(measure_model), intent(in) :: gap
    select type (slip)
    class is (pair_slip)
      select type (gap)
      class is (pair_measure)
        slip%pair_measure = gap
      end select
      call slip%go_round()
    end select
  end subroutine follow
end module build_constraints
