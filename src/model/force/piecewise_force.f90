!> Elements with a history of a motion, their measure: springs by their deformation, and what watches a motion for the factors of
!> loads. The history goes by pieces (`history_pieces`), and that the motion leaves a piece is an event. What the element keeps from
!> its last event is a point of the present piece.
module piecewise_force
  use kinds, only: wp, pi
  use force_element, only: on_a_piece, by_position, bilateral, conditions, force_model, root_rounding, stage_static, watched_roots
  use history, only: history_model
  use history_pieces, only: first_piece, piece_beyond, piece_ends, piece_value
  use marker, only: marker_states
  use measure, only: measured
  use root_watch, only: resting
  implicit none (type, external)
  private

  !> Such an element.
  type, abstract, extends(force_model), public :: piecewise_model
    class(history_model), allocatable :: history   !! not allocated: none
    logical :: whole_turns = .false.               !! the motion is known but for whole turns, as a piece is
  contains
    procedure :: followed
    procedure :: history_value
    procedure :: watch_corners
    procedure :: roots => piece_roots
    procedure :: switch => next_piece
  end type piecewise_model

contains

  !> The motion that the history is a function of, its rate, and the size of its rounding errors; of a rate also what solves leave
  !> of one at rest. In a static analysis rates are 0.
  pure subroutine followed(self, p, stage, x, rate, rounding)
    class(piecewise_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    integer, intent(in) :: stage           !! the analysis
    real(wp), intent(out) :: x             !! [any]
    real(wp), intent(out) :: rate          !! huge: not known [any/s]
    real(wp), intent(out) :: rounding      !! [any]
    type(measured) :: now
    associate (m => self%measure)
      call m%measure(p, now)
      x = now%x - m%datum
      rate = now%rate
      rounding = root_rounding*m%rounding(p)
      if (m%rate) then
        x = merge(0.0_wp, rate, stage == stage_static)
        rate = huge(1.0_wp)
        rounding = max(rounding, resting*merge(1.0_wp, self%size, m%angular))
      else if (.not. m%angular) then
        rounding = max(rounding, root_rounding*self%size)
      end if
    end associate
  end subroutine followed

  !> Value and two derivatives of the history there; where a piece is kept, on this one.
  pure function history_value(self, with, x) result(h)
    class(piecewise_model), intent(in) :: self
    type(conditions), intent(in) :: with
    real(wp), intent(in) :: x              !! [any]
    real(wp) :: h(0:2)                     !! [unit, unit/any, unit/any2]
    real(wp) :: f(-1:2)
    if (any(with%state == [by_position, bilateral])) then
      call self%history%evaluate(x, .false., f)
      h = f(0:)
    else
      call piece_value(self%history, x, with%event_value, h)
    end if
  end function history_value

  !> Corners up to an order are events.
  subroutine watch_corners(self, most_order)
    class(piecewise_model), intent(inout) :: self
    integer, intent(in) :: most_order
    call self%history%keep_corners(most_order)
    self%switches = self%history%next_corner(-1.0_wp, .true.) < huge(1.0_wp) .or. &
                    self%history%next_corner(1.0_wp, .false.) > -huge(1.0_wp)
  end subroutine watch_corners

  !> The distances to both ends of the piece.
  pure subroutine piece_roots(self, p, with, watched)
    class(piecewise_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    type(watched_roots), intent(out) :: watched
    real(wp) :: ends(2), x, rate, rounding
    integer :: k
    call self%followed(p, with%stage, x, rate, rounding)
    if (self%whole_turns) x = x + 2*pi*anint((with%event_value - x)/(2*pi))
    ends = piece_ends(self%history, with%event_value)
    do k = 1, 2
      if (abs(ends(k)) >= huge(1.0_wp)) cycle
      watched%g(k) = merge(x - ends(1), ends(2) - x, k == 1)
      watched%rate(k) = merge(rate, -rate, k == 1)
      watched%zero(k) = max(rounding, root_rounding*abs(ends(k)))
      if (rate >= huge(1.0_wp)) watched%rate(k) = rate
    end do
  end subroutine piece_roots

  !> The motion goes on in the neighbour of its piece; where no event has led to it, its piece follows from where it is.
  pure subroutine next_piece(self, p, with, which, state, event_value)
    class(piecewise_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    integer, intent(in) :: which           !! the root that fell to zero; 0: no event
    integer, intent(out) :: state
    real(wp), intent(out) :: event_value   !! [any]
    real(wp) :: x, rate, rounding
    state = on_a_piece
    if (which > 0) then
      event_value = piece_beyond(self%history, with%event_value, which == 2)
    else
      call self%followed(p, with%stage, x, rate, rounding)
      event_value = first_piece(self%history, x, rate, max(rounding, root_rounding*abs(x)))
    end if
  end subroutine next_piece
end module piecewise_force
