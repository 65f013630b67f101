!> Turns that have been made, in their order. A turn depends on its start alone: so a restart makes all decisions again, takes the
!> turns of the checkpoint as they are, and what follows is the same to the last bit.
module turn_log
  use kinds, only: wp, ip
  use archive, only: value_archive
  use switching, only: event_list
  implicit none (type, external)
  private

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
    real(wp), allocatable :: range(:)         !! (ny) of the first turn, else empty [m, rad], [m/s, rad/s], [J]
    type(event_list) :: events
  end type turn_result

  !> All turns of a run.
  type, public :: turn_list
    integer :: count = 0                      !! in the list
    integer :: played = 0                     !! of them, by this run
    type(turn_result), allocatable :: items(:)
  contains
    procedure :: add
    procedure :: exchange
  end type turn_list

contains

  !> Appends a turn.
  subroutine add(self, turn)
    class(turn_list), intent(inout) :: self
    type(turn_result), intent(in) :: turn
    type(turn_result), allocatable :: longer(:)
    if (.not. allocated(self%items)) allocate (self%items(16))
    if (self%count == size(self%items)) then
      allocate (longer(2*self%count))
      longer(:self%count) = self%items
      call move_alloc(longer, self%items)
    end if
    self%count = self%count + 1
    self%items(self%count) = turn
  end subroutine add

  !> Saves or restores all turns; restored ones are played again from the first on.
  subroutine exchange(self, a)
    class(turn_list), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    type(turn_result) :: turn
    integer(ip), allocatable :: words(:)
    integer :: k, n
    n = self%count
    words = [integer(ip) ::]
    call a%exchange(n)
    do k = 1, n
      if (a%damaged) return
      if (a%saving) turn = self%items(k)
      if (a%saving) words = int(turn%states, ip)
      call a%exchange(turn%period, turn%lost, turn%at, turn%steps, turn%remembers)
      call a%exchange(words)
      turn%states = int(words)
      call exchange_state(turn%start)
      call exchange_state(turn%end)
      call exchange_state(turn%slope)
      call exchange_state(turn%range)
      call turn%events%exchange(a)
      if (.not. (a%saving .or. a%damaged)) call self%add(turn)
    end do
  contains
    !> One array with its size.
    subroutine exchange_state(x)
      real(wp), allocatable, intent(inout) :: x(:)   !! (ny), or none [any]
      if (a%saving) words = transfer(x, words)
      call a%exchange(words)
      x = transfer(words, [0.0_wp])
    end subroutine exchange_state
  end subroutine exchange
end module turn_log
