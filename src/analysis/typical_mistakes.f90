!> Warns of probable mistakes in a deck: units other than SI, degrees, parts that do nothing, hold nothing or stand there twice.
!> The deck runs as it is written.
module typical_mistakes
  use kinds, only: wp, pi
  use acting_markers, only: list_markers
  use build_history, only: make_history
  use deck_origin, only: origin
  use deck_records, only: deck, marker_record, history_record
  use history, only: history_model
  use posix, only: tell
  use text, only: quoted, to_text
  implicit none (type, external)
  private
  public :: warn_of_mistakes

  real(wp), parameter :: slowest = 10.0_wp, fastest = 2.0e4_wp   !! sound in bars of any solid, rubber to diamond [m/s]
  real(wp), parameter :: deepest = 2.0_wp      !! a section of more than this beside gravity is in millimetres [m]
  real(wp), parameter :: longest = 1000.0_wp   !! a body of more than this is [m]
  real(wp), parameter :: thin = 0.1_wp         !! a body of more than 10 m with less than this a metre is, too [kg/m]

contains

  !> One line on standard error for each of them.
  subroutine warn_of_mistakes(d, check)
    type(deck), intent(in) :: d
    logical, intent(in) :: check          !! a deck that is only checked needs no analysis
    call idle_parts(d)
    call odd_materials(d)
    call degrees(d)
    call millimetres(d)
    call loose_bodies(d)
    call look_for_twins('joint', d%joints%at, d%joints%name, d%joints%type, d%joints%a, d%joints%b, d%joints%direction)
    call look_for_twins('drive', d%drives%at, d%drives%name, d%drives%type, d%drives%a, d%drives%b, d%drives%direction)
    call lost_dwells(d)
    if (check) call warn_if(.not. d%parameters%used, d%parameters%at, 'no expression uses it')
    if (check .or. d%static%present .or. d%modal%present .or. d%response%present .or. d%transient%present) return
    call tell(d%path//': warning: no analysis (&static, &modal, &frequency_response, &transient): the mechanism is '// &
              'assembled, nothing else')
  end subroutine warn_of_mistakes

  !> Forces and lumps that keep their default of 0, forces and controllers that act nowhere, accuracies that nothing asks for.
  subroutine idle_parts(d)
    type(deck), intent(in) :: d
    integer :: k
    call warn_if(d%forces%type == 'force' .and. max(abs(d%forces%fx), abs(d%forces%fy)) <= 0.0_wp, d%forces%at, &
                 'fx and fy are 0: it pushes nothing')
    call warn_if(d%forces%controller > 0 .and. d%forces%stage == 'static', d%forces%at, 'stage=''static'' beside controller: '// &
                 'controllers act in the transient alone, so that the force never acts')
    do k = 1, size(d%controllers)
      call warn_if(.not. any(d%forces%controller == k), d%controllers(k)%at, 'no force obeys it (controller='//quoted( &
                   trim(d%controllers(k)%name))//' of a &force): it moves nothing')
    end do
    if (.not. d%transient%accuracy > 0.0_wp) call warn_if(max(d%sensors%accuracy, d%sensors%floor) > 0.0_wp, d%sensors%at, &
      'accuracy and floor are those of a &transient with accuracy: nothing uses them here')
    call warn_if(max(d%lumps%mass, d%lumps%inertia) <= 0.0_wp, d%lumps%at, 'mass and inertia are 0: it adds nothing')
  end subroutine idle_parts

  !> Materials of flexible bodies whose speed of sound is that of no solid.
  subroutine odd_materials(d)
    type(deck), intent(in) :: d
    logical :: flexes(size(d%materials))
    real(wp) :: speed
    integer :: k
    flexes = .false.
    do k = 1, size(d%bodies)
      if (d%bodies(k)%kind /= 'rigid' .and. d%bodies(k)%flexible) flexes(d%bodies(k)%element_material) = .true.
    end do
    do k = 1, size(d%materials)
      speed = sqrt(d%materials(k)%young/d%materials(k)%density)
      if (.not. flexes(k) .or. (speed >= slowest .and. speed <= fastest)) cycle
      call warn(d%materials(k)%at, 'sqrt(young/density) is '//to_text(speed)// &
                ' m/s, solids have 10 to 20000: young in GPa or MPa for Pa? density in g/cm3 for kg/m3?')
    end do
  end subroutine odd_materials

  !> Angles beyond a turn where nothing turns, or round ones.
  subroutine degrees(d)
    type(deck), intent(in) :: d
    logical :: turns
    turns = any(d%drives%type == 'rotation') .or. any(d%bodies%angular_velocity_stated)
    call look(d%bodies%at, 'angle', d%bodies%angle, turns)
    call look(d%joints%at, 'direction', d%joints%direction, .false.)
    call look(d%drives%at, 'direction', d%drives%direction, .false.)
    call look(d%springs%at, 'free_angle', merge(d%springs%free, 0.0_wp, d%springs%type == 'torsional'), .true.)
    call look(d%stops%at, 'direction', d%stops%direction, .false.)
    call look(d%stops%at, 'lower', merge(d%stops%lower, 0.0_wp, d%stops%type == 'rotation'), turns)
    call look(d%stops%at, 'upper', merge(d%stops%upper, 0.0_wp, d%stops%type == 'rotation'), turns)
    call look(d%histories%at, 'phase', d%histories%phase, .false.)
  contains
    !> One angle; one that the deck leaves open is huge.
    impure elemental subroutine look(at, name, angle, may_turn)
      type(origin), intent(in) :: at
      character(*), intent(in) :: name         !! variable
      real(wp), intent(in) :: angle            !! [rad]
      logical, intent(in) :: may_turn          !! more than a turn may be meant
      if (abs(angle) <= 2*pi + 1.0e-9_wp .or. abs(angle) >= huge(1.0_wp)) return
      if (may_turn .and. abs(angle/5 - anint(angle/5)) > 1.0e-9_wp) return
      call warn(at, name//'='//to_text(angle)//' is '//to_text(anint(10*abs(angle)/(2*pi))/10)// &
                ' turns: degrees for radians?')
    end subroutine look
  end subroutine degrees

  !> Lengths in millimetres beside gravity in m/s2, or the other way round.
  subroutine millimetres(d)
    type(deck), intent(in) :: d
    real(wp) :: g, size_of, reach(0:size(d%bodies))   ! of the points that are named on each body [m]
    integer :: k
    g = norm2(d%scene%gravity)
    if (g > 1000.0_wp) call warn(d%scene%at, 'gravity of '//to_text(g)//' m/s2: mm/s2 for m/s2?')
    if (g < 1.0_wp .or. g > 30.0_wp) return
    do k = 1, size(d%sections)
      size_of = sqrt(12*d%sections(k)%inertia/d%sections(k)%area)
      call warn_if(size_of > deepest, d%sections(k)%at, &
                   'a depth of about '//to_text(size_of)//' m beside gravity in m/s2: mm for m?')
    end do
    call reach_of(d, reach)
    do k = 1, size(d%bodies)
      size_of = max(reach(k), d%bodies(k)%length)
      call warn_if(size_of > longest .or. (d%bodies(k)%kind == 'rigid' .and. size_of > 10.0_wp .and. &
                                           d%bodies(k)%mass < thin*size_of), d%bodies(k)%at, &
                   'it reaches '//to_text(size_of)//' m beside gravity in m/s2: mm for m?')
    end do
  end subroutine millimetres

  !> How far the points that are named on each body lie from its frame.
  subroutine reach_of(d, reach)
    type(deck), intent(in) :: d
    real(wp), intent(out) :: reach(0:)         !! [m]
    integer :: k
    reach = [0.0_wp, (norm2(d%bodies(k)%com), k=1, size(d%bodies))]
    call add(d%joints%a)
    call add(d%joints%b)
    call add(d%springs%a)
    call add(d%springs%b)
    call add(d%stops%a)
    call add(d%stops%b)
    call add(d%lumps%marker)
  contains
    !> One point.
    impure elemental subroutine add(p)
      type(marker_record), intent(in) :: p
      reach(p%body) = max(reach(p%body), norm2(p%point))
    end subroutine add
  end subroutine reach_of

  !> Bodies beside others that nothing holds, touches or sets in motion.
  subroutine loose_bodies(d)
    type(deck), intent(in) :: d
    type(marker_record), allocatable :: named(:, :)
    logical :: attached(0:size(d%bodies))
    if (size(d%joints) + size(d%springs) + size(d%drives) == 0) return
    attached = .false.
    named = list_markers(d)
    attached([named%body]) = .true.
    call warn_if(.not. (attached(1:) .or. d%bodies%velocity_stated .or. d%bodies%angular_velocity_stated), d%bodies%at, &
                 'no joint, drive, spring or force names it: it is left to itself')
  end subroutine loose_bodies

  !> Joints or drives between the same markers that hold the same. Each gets a number from its bodies and nodes, in any order; only
  !> those with the same number are compared.
  subroutine look_for_twins(kind, at, name, type, a, b, direction)
    character(*), intent(in) :: kind
    type(origin), intent(in) :: at(:)
    character(*), intent(in) :: name(:), type(:)
    type(marker_record), intent(in) :: a(:), b(:)
    real(wp), intent(in) :: direction(:)       !! [rad]
    character(*), parameter :: either_way(3) = [character(10) :: 'revolute', 'weld', 'distance']
    integer :: newest(0:size(a)), earlier(size(a))     ! of the pairs with the same remainder, 0: none
    integer :: k, j, r, first
    newest = 0
    do k = 1, size(a)
      r = modulo(31*(a(k)%body + b(k)%body) + a(k)%node + b(k)%node, size(a) + 1)
      earlier(k) = newest(r)
      newest(r) = k
      first = 0
      j = earlier(k)
      do while (j > 0)
        if (type(j) == type(k) .and. .not. abs(direction(j) - direction(k)) > 0.0_wp) then
          if (same(a(j), a(k)) .and. same(b(j), b(k))) first = j
          if (any(either_way == type(k)) .and. same(a(j), b(k)) .and. same(b(j), a(k))) first = j
        end if
        j = earlier(j)
      end do
      if (first > 0) call warn(at(k), 'it holds the same as '//kind//' "'//trim(name(first))// &
                               '" in line '//to_text(at(first)%line)//': one of them is too many')
    end do
  end subroutine look_for_twins

  !> Whether two markers are one.
  pure logical function same(a, b) result(yes)
    type(marker_record), intent(in) :: a, b
    yes = a%body == b%body .and. a%node == b%node .and. .not. any(abs(a%point - b%point) > 0.0_wp)
  end function same

  !> Splines that do not keep a dwell of their table: two flat pieces one after the other, or one at an end.
  subroutine lost_dwells(d)
    type(deck), intent(in) :: d
    class(history_model), allocatable :: h
    logical, allocatable :: flat(:)            ! pieces of the table, with one before and one after it
    real(wp) :: miss, worst, at                ! [unit], [unit], [s]
    integer :: k, i, n
    do k = 1, size(d%histories)
      if (d%histories(k)%kind /= 'table' .or. d%histories(k)%interpolation /= 'spline') cycle
      call make_history(d, k, h)
      worst = 0.0_wp
      associate (r => d%histories(k))
        n = size(r%time)
        flat = [.true., abs(r%values(2:) - r%values(:n - 1)) <= 1.0e-9_wp*maxval(abs(r%values)), .true.]
        do i = 1, n - 1
          if (.not. (flat(i + 1) .and. (flat(i) .or. flat(i + 2)))) cycle
          miss = largest_miss(h, r, i)
          if (miss > worst) at = r%time(i)
          worst = max(worst, miss)
        end do
        if (worst <= 0.01_wp*(maxval(r%values) - minval(r%values))) cycle
        call warn(r%at, 'the spline leaves the dwell at t = '//to_text(at)//' s by '//to_text(worst)// &
                  ': interpolation=''pchip'' keeps dwells')
      end associate
    end do
  end subroutine lost_dwells

  !> How far the curve leaves the flat piece i.
  pure real(wp) function largest_miss(h, r, i) result(miss)   ! [unit]
    class(history_model), intent(in) :: h
    type(history_record), intent(in) :: r
    integer, intent(in) :: i
    real(wp) :: g(-1:2)
    integer :: k
    miss = 0.0_wp
    do k = 1, 7
      call h%evaluate(r%time(i) + 0.125_wp*k*(r%time(i + 1) - r%time(i)), .false., g)
      miss = max(miss, abs(g(0) - r%values(i)))
    end do
  end function largest_miss

  !> A warning with the line of its group.
  subroutine warn(at, why)
    type(origin), intent(in) :: at
    character(*), intent(in) :: why
    call tell(at%file//':'//to_text(at%line)//': '//at%subject//': warning: '//why)
  end subroutine warn

  !> The same where it is true.
  impure elemental subroutine warn_if(true, at, why)
    logical, intent(in) :: true
    type(origin), intent(in) :: at
    character(*), intent(in) :: why
    if (true) call warn(at, why)
  end subroutine warn_if
end module typical_mistakes
