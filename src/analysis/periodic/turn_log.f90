!> Turns that have been made, in their order. A turn depends on its start alone: so a restart makes all decisions again, takes the
!> turns of the checkpoint as they are, and what follows is the same to the last bit.
module turn_log
  use kinds, only: wp, ip
  use archive, only: value_archive
  use switching, only: event_list
  implicit none (type, external)
  private
  public :: exchange_turns

  !> A turn: a run of one period from a start.
  type, public :: turn_result
    real(wp) :: period = 0.0_wp               !! [s]
    logical :: lost = .false.                 !! it did not come to its end
    real(wp) :: at = 0.0_wp                   !! time of a loss [s]
    integer :: steps = 0                      !! in which the next turns are divided
    integer :: remembers = 0                  !! an element at its end with a memory that the state does not hold; 0: none
    integer, allocatable :: states(:)         !! (elements that switch) at the start
    real(wp), allocatable :: start(:)         !! (ny) put onto the manifold [m, rad], [m/s, rad/s], [J]
    real(wp), allocatable :: end(:)           !! (ny) after the period [m, rad], [m/s, rad/s], [J]
    real(wp), allocatable :: slope(:)         !! (ny) its derivative there [the same per second]
    real(wp), allocatable :: range(:)         !! (ny) [m, rad], [m/s, rad/s], [J]
    real(wp) :: kinetic = 0.0_wp              !! energy at its end [J]
    type(event_list) :: events
  contains
    procedure :: exchange => exchange_turn
  end type turn_result

contains

  !> Saves or restores all turns of a run; restored ones are played again from the first on.
  subroutine exchange_turns(log, a)
    type(value_archive), intent(inout) :: log, a
    integer(ip), allocatable :: words(:)
    words = [integer(ip) ::]
    if (a%saving) words = log%words(:log%count)
    call a%exchange(words)
    if (size(words) > 0 .and. .not. a%saving) call log%begin_restoring(words)
  end subroutine exchange_turns

  !> Saves or restores a turn.
  subroutine exchange_turn(self, a)
    class(turn_result), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    integer(ip), allocatable :: words(:)
    words = [integer(ip) ::]
    if (a%saving) words = int(self%states, ip)
    call a%exchange(self%period, self%lost, self%at, self%steps, self%remembers, self%kinetic)
    call a%exchange(words)
    self%states = int(words)
    call exchange_state(self%start)
    call exchange_state(self%end)
    call exchange_state(self%slope)
    call exchange_state(self%range)
    call self%events%exchange(a)
  contains
    !> One array with its size.
    subroutine exchange_state(x)
      real(wp), allocatable, intent(inout) :: x(:)   !! (ny), or none [any]
      if (a%saving) words = transfer(x, words)
      call a%exchange(words)
      x = transfer(words, [0.0_wp])
    end subroutine exchange_state
  end subroutine exchange_turn
end module turn_log
