!> Where a pair's touching place passes a corner of its law, a jump of a derivative that the method feels, a step ends. What watches
!> it is an element without force; what it keeps from its last event is the number of the present piece between two corners.
module profile_corners
  use kinds, only: wp, pi
  use contact_pair, only: pair_measure, pair_touch
  use force_element, only: conditions, element_action, force_model, on_a_piece, root_rounding, watched_roots
  use marker, only: marker_states
  implicit none (type, external)
  private

  !> Such a watcher; its measure is that of the pair.
  type, extends(force_model), public :: corner_watch
    real(wp), allocatable :: corners(:)    !! ascending, of one turn [rad]
  contains
    procedure :: act => no_force
    procedure :: acts_on => on_nothing
    procedure :: roots => piece_ends
    procedure :: switch => next_piece
    procedure, private :: from_middle
  end type corner_watch

contains

  !> None.
  pure subroutine no_force(self, p, with, z, zd, zdd, x)
    class(corner_watch), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp), intent(in) :: z(*), zd(*)    !! not used [-]
    real(wp), intent(inout) :: zdd(*)      !! left as they are [-]
    type(element_action), intent(inout) :: x
    x = element_action()
  end subroutine no_force

  !> It acts on nothing.
  pure function on_nothing(self) result(yes)
    class(corner_watch), intent(in) :: self
    logical :: yes(6)
    yes = .false.
  end function on_nothing

  !> How far the touching place lies from the middle of a piece, its rate, and half the piece.
  pure subroutine from_middle(self, p, piece, x, rate, half)
    class(corner_watch), intent(in) :: self
    type(marker_states), intent(in) :: p
    integer, intent(in) :: piece
    real(wp), intent(out) :: x             !! [rad]
    real(wp), intent(out) :: rate          !! [rad/s]
    real(wp), intent(out) :: half          !! [rad]
    type(pair_touch) :: at
    real(wp) :: ends(2)
    ends = [self%corners(piece), self%corners(1) + 2*pi]
    if (piece < size(self%corners)) ends(2) = self%corners(piece + 1)
    half = 0.5_wp*(ends(2) - ends(1))
    x = 0.0_wp
    rate = 0.0_wp
    select type (gap => self%measure)
    class is (pair_measure)
      at = gap%touching(p)
      x = at%u - 0.5_wp*sum(ends)
      x = x - 2*pi*anint(x/(2*pi))
      rate = at%advance*dot_product(at%w, gap%rates(p))
    end select
  end subroutine from_middle

  !> The distances to both ends of the piece.
  pure subroutine piece_ends(self, p, with, watched)
    class(corner_watch), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    type(watched_roots), intent(out) :: watched
    real(wp) :: x, rate, half
    call self%from_middle(p, nint(with%event_value), x, rate, half)
    watched%g(1:2) = [half + x, half - x]
    watched%rate(1:2) = [rate, -rate]
    watched%zero(1:2) = root_rounding*max(2*pi, abs(p%angle(self%ia)), abs(p%angle(self%ib)))
  end subroutine piece_ends

  !> The neighbour; where no event has led to it, the piece in which the place is, at a corner that into which it moves.
  pure subroutine next_piece(self, p, with, which, state, event_value)
    class(corner_watch), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    integer, intent(in) :: which           !! the root that fell to zero; 0: no event
    integer, intent(out) :: state
    real(wp), intent(out) :: event_value   !! number of the piece [-]
    type(conditions) :: other
    type(watched_roots) :: watched
    integer :: n, k
    state = on_a_piece
    n = size(self%corners)
    if (which > 0) then
      event_value = 1 + modulo(nint(with%event_value) + merge(-2, 0, which == 1), n)
      return
    end if
    event_value = 1.0_wp
    other = with
    do k = 1, n
      other%event_value = k
      call self%roots(p, other, watched)
      if (any(watched%g(1:2) < -watched%zero(1:2))) cycle
      event_value = k
      if (.not. any(watched%g(1:2) <= watched%zero(1:2) .and. watched%rate(1:2) < 0.0_wp)) return
    end do
  end subroutine next_piece
end module profile_corners
