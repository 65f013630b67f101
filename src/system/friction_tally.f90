!> What the summary says of the friction of a joint: how often it sticks and slips, how far it slides, how long it is at rest, how
!> near it comes to its limit there.
module friction_tally
  use kinds, only: wp, ip
  use friction_law, only: row_parted, sliding
  implicit none (type, external)
  private

  !> Of one joint. The checkpoint keeps its words.
  type, public :: joint_tally
    integer(ip) :: sticks = 0                 !! events: it came to rest
    integer(ip) :: slips = 0                  !! it broke away
    integer(ip) :: turns = 0                  !! it went on the other way
    real(wp) :: slid = 0.0_wp                 !! to and fro until the last step [m] or [rad]
    real(wp) :: position = 0.0_wp             !! where it was then [m] or [rad]
    real(wp) :: rest = 0.0_wp                 !! time at rest [s]
    real(wp) :: share = 0.0_wp                !! largest one of the limit at rest [-]
    logical :: undetermined = .false.         !! its present share is not determined by rigid bodies
    real(wp) :: unknown = 0.0_wp              !! how long that was so [s]
  contains
    procedure :: note_event
    procedure :: note_rest
  end type joint_tally

contains

  !> Counts an event.
  pure subroutine note_event(self, before, after)
    class(joint_tally), intent(inout) :: self
    integer, intent(in) :: before, after      !! states of the row
    if (sliding(before) == sliding(after) .or. any([before, after] == row_parted)) return   ! another pad, or none, presses
    if (sliding(after) == 0) then
      self%sticks = self%sticks + 1
    else if (sliding(before) == 0) then
      self%slips = self%slips + 1
    else
      self%turns = self%turns + 1
    end if
  end subroutine note_event

  !> An accepted step at rest.
  pure subroutine note_rest(self, h, share)
    class(joint_tally), intent(inout) :: self
    real(wp), intent(in) :: h                 !! [s]
    real(wp), intent(in) :: share             !! of the limit [-]
    self%rest = self%rest + h
    self%share = max(self%share, share)
    if (self%undetermined) self%unknown = self%unknown + h
  end subroutine note_rest
end module friction_tally
