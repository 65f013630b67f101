!> Warns of probable mistakes in a deck: units other than SI, degrees, parts that do nothing.
!> The deck runs as it is written.
module typical_mistakes
  use kinds, only: wp, pi
  use acting_markers, only: list_markers
  use build_factors, only: gives_back
  use deck_origin, only: origin
  use deck_records, only: deck, marker_record
  use deck_temperature, only: has_shift
  use posix, only: tell
  use text, only: quoted, to_text
  implicit none (type, external)
  private
  public :: warn_of_mistakes

  real(wp), parameter :: slowest = 10.0_wp, fastest = 2.0e4_wp   !! sound in bars of any solid, rubber to diamond [m/s]
  character(*), parameter :: idle = 'temperature changes nothing: no material of it has wlf, arrhenius or vertical'

contains

  !> One line on standard error for each of them.
  subroutine warn_of_mistakes(d, check)
    type(deck), intent(in) :: d
    logical, intent(in) :: check          !! a deck that is only checked needs no analysis
    integer :: k
    call idle_parts(d)
    do k = 1, merge(size(d%forces), 0, check)
      call warn_if(gives_back(d, d%forces(k)), d%forces(k)%at, 'it follows a place on both ways: what it takes on one it gives '// &
                   'back on the other. To act on one stroke alone it needs a history of kind=''switch''')
    end do
    call odd_materials(d)
    call degrees(d)
    call warn_if(norm2(d%scene%gravity) > 1000.0_wp, d%scene%at, 'gravity of '//to_text(norm2(d%scene%gravity))// &
                 ' m/s2: mm/s2 for m/s2?')
    call loose_bodies(d)
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
    call warn_if(d%scene%temperature < huge(1.0_wp) .and. .not. (any(has_shift(d%materials%law)) .or. any(has_shift( &
                 d%springs%law)) .or. any(d%bodies%thermal_resistance > 0.0_wp)), d%scene%at, idle)
    do k = 1, size(d%bodies)
      call warn_if(d%bodies(k)%temperature < huge(1.0_wp) .and. .not. (any(has_shift(d%materials%law) .and. d%materials%body == &
                   k) .or. d%bodies(k)%thermal_resistance > 0.0_wp), d%bodies(k)%at, idle)
    end do
  end subroutine idle_parts

  !> Materials of flexible bodies whose speed of sound is that of no solid.
  subroutine odd_materials(d)
    type(deck), intent(in) :: d
    logical :: flexes(size(d%materials))
    real(wp) :: speed
    integer :: k, e
    flexes = .false.
    do k = 1, size(d%bodies)
      if (d%bodies(k)%kind == 'rigid' .or. .not. d%bodies(k)%flexible) cycle
      flexes(d%bodies(k)%element_material) = .true.
      do e = 1, d%bodies(k)%elements
        flexes(d%sections(d%bodies(k)%element_section(e))%layers) = .true.
      end do
    end do
    do k = 1, size(d%materials)
      speed = sqrt(d%materials(k)%young/d%materials(k)%density)
      if (.not. flexes(k) .or. (speed >= slowest .and. speed <= fastest)) cycle
      call warn(d%materials(k)%at, 'sqrt(young/density) is '//to_text(speed)// &
                ' m/s, solids have 10 to 20000: young in GPa or MPa for Pa? density in g/cm3 for kg/m3?')
    end do
  end subroutine odd_materials

  !> Angles beyond a turn where nothing turns.
  subroutine degrees(d)
    type(deck), intent(in) :: d
    logical :: turns
    turns = any(d%drives%type == 'rotation') .or. any(d%bodies%angular_velocity_stated)
    call check_angle(d%bodies%at, 'angle', d%bodies%angle, turns)
    call check_angle(d%joints%at, 'direction', d%joints%direction, .false.)
    call check_angle(d%drives%at, 'direction', d%drives%direction, .false.)
    call check_angle(d%springs%at, 'free_angle', merge(d%springs%free, 0.0_wp, d%springs%type == 'torsional'), turns)
    call check_angle(d%stops%at, 'direction', d%stops%direction, .false.)
    call check_angle(d%stops%at, 'lower', merge(d%stops%lower, 0.0_wp, d%stops%type == 'rotation'), turns)
    call check_angle(d%stops%at, 'upper', merge(d%stops%upper, 0.0_wp, d%stops%type == 'rotation'), turns)
    call check_angle(d%histories%at, 'phase', d%histories%phase, .false.)
  contains
    !> One angle; one that the deck leaves open is huge.
    impure elemental subroutine check_angle(at, name, angle, may_turn)
      type(origin), intent(in) :: at
      character(*), intent(in) :: name         !! variable
      real(wp), intent(in) :: angle            !! [rad]
      logical, intent(in) :: may_turn          !! more than a turn may be meant
      if (abs(angle) <= 2*pi + 1.0e-9_wp .or. abs(angle) >= huge(1.0_wp)) return
      if (may_turn) return
      call warn(at, name//'='//to_text(angle)//' is '//to_text(anint(10*abs(angle)/(2*pi))/10)// &
                ' turns: degrees for radians?')
    end subroutine check_angle
  end subroutine degrees

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
