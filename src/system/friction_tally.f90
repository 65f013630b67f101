!> What the summary says of the friction of a joint: how often it sticks and slips, how far it slides, how long it is at rest, how
!> near it comes to its limit there.
module friction_tally
  use kinds, only: wp, ip
  use friction_law, only: row_slips
  implicit none (type, external)
  private

  !> Of one joint. The checkpoint keeps its words.
  type, public :: joint_tally
    integer(ip) :: sticks = 0                 !! events: it came to rest
    integer(ip) :: slips = 0                  !! it broke away
    integer(ip) :: turns = 0                  !! it went on the other way
    real(wp) :: first = 0.0_wp, last = 0.0_wp !! times of the first and the last one [s]
    real(wp) :: slid = 0.0_wp                 !! to and fro until the last event of any element [m] or [rad]
    real(wp) :: position = 0.0_wp             !! where it was then [m] or [rad]
    real(wp) :: rest = 0.0_wp                 !! time at rest [s]
    real(wp) :: share = 0.0_wp                !! largest one of the limit at rest [-]
    logical :: undetermined = .false.         !! its present share is not determined by rigid bodies
    real(wp) :: unknown = 0.0_wp              !! how long that was so [s]
  contains
    procedure :: note_event
    procedure :: note_rest
    procedure :: note_position
  end type joint_tally

contains

  !> Counts an event.
  pure subroutine note_event(self, t, before, after)
    class(joint_tally), intent(inout) :: self
    real(wp), intent(in) :: t                 !! [s]
    integer, intent(in) :: before, after      !! states of the row
    integer :: from, to
    from = direction(before)
    to = direction(after)
    if (from == to) return                    ! another pad presses
    if (self%sticks + self%slips + self%turns == 0) self%first = t
    self%last = t
    if (to == 0) then
      self%sticks = self%sticks + 1
    else if (from == 0) then
      self%slips = self%slips + 1
    else
      self%turns = self%turns + 1
    end if
  end subroutine note_event

  !> In which a joint slides in a state: 0 at rest.
  elemental integer function direction(state)
    integer, intent(in) :: state
    direction = merge(sign(1, state), 0, abs(state) == row_slips)
  end function direction

  !> An accepted step at rest.
  pure subroutine note_rest(self, h, share)
    class(joint_tally), intent(inout) :: self
    real(wp), intent(in) :: h                 !! [s]
    real(wp), intent(in) :: share             !! of the limit [-]
    self%rest = self%rest + h
    self%share = max(self%share, share)
    if (self%undetermined) self%unknown = self%unknown + h
  end subroutine note_rest

  !> Where it is at an event: between two of them it slides one way, or not at all.
  pure subroutine note_position(self, position)
    class(joint_tally), intent(inout) :: self
    real(wp), intent(in) :: position          !! [m] or [rad]
    self%slid = self%slid + abs(position - self%position)
    self%position = position
  end subroutine note_position
end module friction_tally
