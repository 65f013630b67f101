!> Turns that have been made, in their order. A turn depends on its start alone: so a restart makes all decisions again, takes the
!> turns of the checkpoint as they are, and what follows is the same to the last bit.
module turn_log
  use kinds, only: wp
  use archive, only: value_archive
  use switching, only: event_list
  implicit none (type, external)
  private

  !> A turn: a run of one period from a start.
  type, public :: turn_result
    logical :: lost = .false.                 !! it did not come to its end
    integer :: remembers = 0                  !! an element at its end with a memory that the state does not hold; 0: none
    integer, allocatable :: states(:)         !! (elements that switch) at the start
    integer :: steps = 0                      !! in which the next turns are divided
    real(wp) :: at = 0.0_wp                   !! time of a loss [s]
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
    real(wp), allocatable :: states(:)        ! [-]
    integer :: k, n
    n = self%count
    call a%exchange(n)
    do k = 1, n
      if (a%damaged) return
      if (a%saving) turn = self%items(k)
      call a%exchange(turn%lost)
      call a%exchange(turn%remembers)
      call a%exchange(turn%steps)
      call a%exchange(turn%at)
      call exchange_state(turn%start)
      call exchange_state(turn%end)
      call exchange_state(turn%slope)
      call exchange_state(turn%range)
      call turn%events%exchange(a)
      if (a%saving) states = turn%states
      call exchange_state(states)
      if (a%damaged) return
      turn%states = nint(states)
      if (.not. a%saving) call self%add(turn)
    end do
  contains
    !> One array with its size.
    subroutine exchange_state(x)
      real(wp), allocatable, intent(inout) :: x(:)   !! (ny), or none [any]
      integer :: length
      length = 0
      if (a%saving) length = size(x)
      call a%exchange(length)
      if (a%damaged) return
      if (.not. a%saving) x = spread(0.0_wp, 1, length)
      call a%exchange(x)
    end subroutine exchange_state
  end subroutine exchange
end module turn_log
