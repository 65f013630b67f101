!> Why a mechanism cannot be assembled: a joint or drive too many, or one that the lengths of its loop do not reach. To find it,
!> parts of the scene are assembled. This costs time only after an assembly that failed.
module assembly_conflict
  use kinds, only: wp
  use assembly_reports, only: assembly_report, gap_text
  use deck_origin, only: origin
  use deck_records, only: deck
  use dynamics, only: evaluate_start
  use errors, only: failure
  use joint_geometry, only: condense_geometry
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  use position_closing, only: closed_gap
  use text, only: either, exact_text, to_text
  use trial_scene, only: assemble_deck, rigid_copy
  implicit none (type, external)
  private
  public :: explain_open_joints, deck_line_of

  character(*), parameter :: what_is_expected = '; expected positions and angles near which every joint and drive '// &
                                              'holds at t = 0 (welds and prismatic joints hold the angles that the deck has)'

  real(wp), parameter :: tilt = 1.0e-3_wp           !! of bodies, to leave a singular position [rad]

contains

  !> Replaces the list of open joints, which are all of a loop alike, by what is wrong with which of them.
  subroutine explain_open_joints(d, fail)
    type(deck), intent(in) :: d
    type(failure), intent(inout) :: fail            !! that of the assembly
    type(mechanism_model) :: m
    type(evaluation) :: ev
    type(assembly_report) :: report
    character(:), allocatable :: words
    real(wp), allocatable :: q(:)
    integer :: culprit, low, middle, k
    low = 0                                         ! the first `low` constraints close, the first `culprit` do not
    culprit = size(d%joints) + size(d%drives)
    do while (culprit - low > 1)
      middle = (low + culprit)/2
      call assemble_part(d, [(k, k=1, middle)], m, ev, q, report)
      if (report%open) culprit = middle
      if (.not. report%open) low = middle
    end do
    call open_constraint(d, culprit, words)
    fail%message = 'the mechanism cannot be assembled: '//words
    fail%deck_line = deck_line_of(d, culprit)
  end subroutine explain_open_joints

  !> How far a constraint stays open where those before it in the deck are closed, and why.
  subroutine open_constraint(d, culprit, words)
    type(deck), intent(in) :: d
    integer, intent(in) :: culprit                  !! the first constraint that does not close with those before it
    character(:), allocatable, intent(out) :: words
    type(mechanism_model) :: m, without
    type(evaluation) :: ev, other
    type(assembly_report) :: before
    character(:), allocatable :: unit
    real(wp), allocatable :: q(:)                     ! (nq) [m, rad]
    logical, allocatable :: weak(:)
    character(*), parameter :: where_closed = ' where those before it in the deck are closed'
    integer :: k
    real(wp) :: start(0:2)                            ! of a drive [m, rad], per s, per s2
    logical :: surplus                                ! those before it leave no motion that could close it
    call assemble_part(d, [(k, k=1, culprit)], m, ev, q, before)
    call assemble_part(d, [(k, k=1, culprit - 1)], without, other, q, before)
    call evaluate_start(m, ev, q)
    call condense_geometry(m, ev)
    allocate (weak(m%s%rows))
    call ev%schur%weak_rows(weak)
    associate (c => m%s%constraints(culprit)%item)
      surplus = count(.not. weak) < before%rank + c%rows
      if (maxval(abs(ev%rows%phi(c%first:c%first + c%rows - 1))) <= closed_gap(m, ev)) then
        words = name_of(d, culprit)//' holds'//where_closed//', but no way there was found from the positions in the deck'// &
                what_is_expected
      else if (c%drive) then
        call c%prescribed(0.0_wp, .false., start)
        unit = either(' rad', ' m', c%angular)
        words = name_of(d, culprit)//' starts at '//exact_text(start(0))//unit//', but its bodies stand at '// &
                exact_text(c%position(ev%p))//unit//where_closed//': '
        if (surplus) words = words//'these leave no motion that could follow it'
        if (.not. surplus) words = words//'the lengths of its loop do not reach further'
        words = words//'; expected a history that starts there, bodies near where it holds, or relative=.true., which adds the '// &
                'history to the assembled value'
      else
        words = name_of(d, culprit)//' stays open by '//gap_text(m, ev, culprit)//where_closed//': '
        if (surplus) words = words//either('they leave no motion that could close it, it is one too many', &
          'they leave none at this start, which is singular: bodies that are turned by '//to_text(tilt)//' rad close it, by '// &
          'the signs of these angles in one way or another', .not. closes_when_tilted(d, culprit))
        if (.not. surplus) words = words//'the lengths of its loop do not reach'
        words = words//what_is_expected
      end if
    end associate
  end subroutine open_constraint

  !> Whether the first constraints close from positions that are turned a little, each body by another angle.
  logical function closes_when_tilted(d, culprit) result(closes)
    type(deck), intent(in) :: d
    integer, intent(in) :: culprit                  !! the last of them
    type(mechanism_model) :: m
    type(evaluation) :: ev
    type(assembly_report) :: report
    type(deck) :: tilted
    real(wp), allocatable :: q(:)                     ! (nq) [m, rad]
    integer :: k
    tilted = d
    tilted%bodies%angle = d%bodies%angle + [(tilt*k/size(d%bodies), k=1, size(d%bodies))]
    call assemble_part(tilted, [(k, k=1, culprit)], m, ev, q, report)
    closes = .not. report%open
  end function closes_when_tilted

  !> Assembles some joints and drives of a deck. All bodies are rigid, since assembly bends none; velocities do not count.
  subroutine assemble_part(d, chosen, m, ev, q, report)
    type(deck), intent(in) :: d
    integer, intent(in) :: chosen(:)                !! numbers of constraints: joints, then drives
    type(mechanism_model), intent(out) :: m
    type(evaluation), intent(out) :: ev
    real(wp), allocatable, intent(out) :: q(:)      !! (nq) assembled positions [m, rad]
    type(assembly_report), intent(out) :: report
    type(deck) :: part
    logical :: ok
    part = rigid_copy(d)
    associate (n => size(d%joints))
      part%joints = d%joints(pack(chosen, chosen <= n))
      part%drives = d%drives(pack(chosen, chosen > n) - n)
    end associate
    call assemble_deck(part, m, ev, q, report, ok)
  end subroutine assemble_part

  !> A joint or drive with its line: `weld "w" in line 7`.
  function name_of(d, k) result(text)
    type(deck), intent(in) :: d
    integer, intent(in) :: k                        !! number of the constraint: joints, then drives
    character(:), allocatable :: text
    if (k <= size(d%joints)) then
      associate (j => d%joints(k))
        text = trim(j%type)//' joint "'//trim(j%name)//'"'//line_of(d, j%at)
      end associate
    else
      associate (r => d%drives(k - size(d%joints)))
        text = 'drive "'//trim(r%name)//'"'//line_of(d, r%at)
      end associate
    end if
  end function name_of

  !> Where a joint, drive, spring or load stands: `deck.nml:7`.
  function deck_line_of(d, k) result(text)
    type(deck), intent(in) :: d
    integer, intent(in) :: k                        !! its number: joints, then drives, springs, loads, stops
    character(:), allocatable :: text
    type(origin) :: at
    integer :: sizes(5), group, i                   ! of the groups, the group and the number in it
    sizes = [size(d%joints), size(d%drives), size(d%springs), size(d%forces), size(d%stops)]
    i = k
    do group = 1, 4
      if (i <= sizes(group)) exit
      i = i - sizes(group)
    end do
    select case (group)
    case (1)
      at = d%joints(i)%at
    case (2)
      at = d%drives(i)%at
    case (3)
      at = d%springs(i)%at
    case (4)
      at = d%forces(i)%at
    case default
      at = d%stops(i)%at
    end select
    text = at%file//':'//to_text(at%line)
  end function deck_line_of

  !> Where a group stands.
  function line_of(d, at) result(text)
    type(deck), intent(in) :: d
    type(origin), intent(in) :: at
    character(:), allocatable :: text
    text = ' in line '//to_text(at%line)
    if (at%file /= d%path) text = text//' of '//at%file
  end function line_of
end module assembly_conflict
