!> The start behind clearances. A pin with play holds nothing where the assembly closes joints: bodies behind it would start at rest
!> while its crank turns, and be struck at once. So a copy of the deck, of rigid bodies, is assembled with the pins held where they
!> are; what the deck does not state of the velocities starts as there. A pin that is outside of its hole by more than its play, on
!> a body whose position the deck does not give, is put into the middle.
module clearance_start
  use kinds, only: wp
  use assembly_reports, only: assembly_report
  use deck_records, only: deck, joint_record
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  use position_closing, only: digits_of_decks => small
  use scene_model, only: scene
  use text, only: either, to_text
  use trial_scene, only: assemble_deck, rigid_copy
  implicit none (type, external)
  private
  public :: start_through_clearances

contains

  !> Positions and velocities from which the assembly of a scene begins. Where the pins cannot be held, as velocities that the deck
  !> states contradict that, they stay as they are, and a sentence says so.
  subroutine start_through_clearances(d, s, contradiction)
    type(deck), intent(in) :: d
    type(scene), intent(inout) :: s                 !! of this deck
    character(:), allocatable, intent(out) :: contradiction   !! empty: there is none
    type(mechanism_model) :: m
    real(wp), allocatable :: q(:), v(:)             ! (3 times bodies) [m, rad], [m/s, rad/s]
    integer, allocatable :: a(:), b(:)              ! (stops) bodies
    integer, allocatable :: pins(:)                 ! clearances beside which the deck leaves something open
    logical, allocatable :: outside(:), still(:)    ! (pins) of their holes
    real(wp), allocatable :: off(:)                 ! (3 times bodies) by how much stated velocities differ [m/s, rad/s]
    logical, dimension(0:size(d%bodies)) :: stated, placed   ! by the deck: velocities, position; the ground is so
    integer, allocatable :: frames(:)               ! (3 times bodies) their coordinates in those of the scene
    logical :: ok
    integer :: k, i
    contradiction = ''
    stated(0) = .true.
    stated(1:) = d%bodies%velocity_stated .and. d%bodies%angular_velocity_stated
    placed(0) = .true.
    placed(1:) = d%bodies%position_given
    a = d%stops%a%body
    b = d%stops%b%body
    pins = pack([(k, k=1, size(a))], d%stops%type == 'clearance' .and. .not. (stated(a) .and. stated(b) .and. placed(a) .and. &
                                                                              placed(b)))
    if (size(pins) == 0) return
    call assemble_with_pins(d, pins, spread(.false., 1, size(pins)), m, q, v, outside, ok)
    if (.not. ok) return
    outside = outside .and. .not. (placed(a(pins)) .and. placed(b(pins)))
    frames = [((s%qo(k) + i, i=1, 3), k=1, size(d%bodies))]
    if (any(outside)) then
      call assemble_with_pins(d, pins, (outside), m, q, v, still, ok)
      if (.not. ok) return
      s%start(frames) = q
    end if
    off = merge(abs(v - m%s%v0), 0.0_wp, m%s%stated)
    k = maxloc(off, 1)
    if (off(k) > digits_of_decks*maxval(abs(v))) then
      contradiction = 'velocities that the deck states contradict pins that stand still in their clearances: '// &
        either('angular_velocity', 'velocity', modulo(k, 3) == 0)//' of body "'//trim(d%bodies((k + 2)/3)%name)//'" would be '// &
        to_text(v(k))//either(' rad/s', ' m/s', modulo(k, 3) == 0)//', not '//to_text(m%s%v0(k))// &
        ': so the pins of all clearances move from the start, and strike; expected the velocities of all bodies beside '// &
        'clearances, or of none'
    else
      s%v0(frames) = merge(s%v0(frames), v, m%s%stated)
    end if
  end subroutine start_through_clearances

  !> Assembles the deck's rigid bodies, joints and drives with a joint behind them for each pin: held where its markers are, or one
  !> on the other.
  subroutine assemble_with_pins(d, pins, centred, m, q, v, outside, ok)
    type(deck), intent(in) :: d
    integer, intent(in) :: pins(:)                  !! among the stops
    logical, intent(in) :: centred(:)               !! (pins)
    type(mechanism_model), intent(out) :: m
    real(wp), allocatable, intent(out) :: q(:), v(:)   !! (3 times bodies) [m, rad], [m/s, rad/s]
    logical, allocatable, intent(out) :: outside(:) !! (pins) of their holes by more than their play
    logical, intent(out) :: ok
    type(deck) :: rigid
    type(evaluation) :: ev
    type(joint_record), allocatable :: joints(:)
    type(joint_record) :: pin
    type(assembly_report) :: report
    integer :: k, n
    n = size(d%joints)
    rigid = rigid_copy(d)
    allocate (joints(n + size(pins)))
    joints(:n) = rigid%joints
    do k = 1, size(pins)
      pin%name = d%stops(pins(k))%name
      pin%type = 'revolute'
      pin%a = d%stops(pins(k))%a
      pin%b = d%stops(pins(k))%b
      pin%as_assembled = .not. centred(k)
      joints(n + k) = pin
    end do
    call move_alloc(joints, rigid%joints)
    allocate (outside(size(pins)), source=.false.)
    call assemble_deck(rigid, m, ev, q, report, ok, v)
    if (.not. ok) return
    do k = 1, size(pins)
      associate (c => m%s%constraints(n + k)%item)
        outside(k) = norm2(ev%p%r(:, c%ia) - ev%p%r(:, c%ib)) > 2*d%stops(pins(k))%upper
      end associate
    end do
  end subroutine assemble_with_pins
end module clearance_start
