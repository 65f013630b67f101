!> Histories as functions of motion. A history goes by pieces between its corners, where its slope jumps. A step stays on one piece,
!> which is continued beyond its ends, so that the method sees a smooth function; that the motion leaves the piece is an event
!> (theory.md, section 3). A piece is named by a point within it.
module history_pieces
  use kinds, only: wp
  use history, only: history_model
  implicit none (type, external)
  private
  public :: piece_value, piece_ends, first_piece, piece_beyond

contains

  !> Value and two derivatives on a piece, beyond its ends by the parabola that continues it.
  pure subroutine piece_value(history, x, piece, h)
    class(history_model), intent(in) :: history
    real(wp), intent(in) :: x              !! [any]
    real(wp), intent(in) :: piece          !! a point within it [any]
    real(wp), intent(out) :: h(0:2)        !! [unit, unit/any, unit/any2]
    real(wp) :: ends(2), f(-1:2), d
    ends = piece_ends(history, piece)
    d = x - min(max(x, ends(1)), ends(2))
    call history%evaluate(x - d, x > piece, f)   ! the limit from within, also where x is an end but for rounding
    h = [f(0) + d*(f(1) + 0.5_wp*d*f(2)), f(1) + d*f(2), f(2)]
  end subroutine piece_value

  !> Where a piece begins and ends; huge: it goes on for ever.
  pure function piece_ends(history, piece) result(ends)
    class(history_model), intent(in) :: history
    real(wp), intent(in) :: piece          !! a point within it [any]
    real(wp) :: ends(2)                    !! [any]
    ends = [history%next_corner(piece, .false.), history%next_corner(piece, .true.)]
  end function piece_ends

  !> The piece of a motion that begins at x; at a corner that into which it moves.
  pure real(wp) function first_piece(history, x, rate, rounding) result(piece)   ! [any]
    class(history_model), intent(in) :: history
    real(wp), intent(in) :: x              !! [any]
    real(wp), intent(in) :: rate           !! of x [any/s]
    real(wp), intent(in) :: rounding       !! of x [any]
    real(wp) :: low, high
    low = history%next_corner(x, .false.)
    high = history%next_corner(low, .true.)                       ! it may be so near to x that neither side of x has it
    if (x - low <= rounding) high = low
    if (high - x <= rounding) then
      piece = beyond(history, high, .not. rate < 0.0_wp)
    else
      piece = middle([low, high])
    end if
  end function first_piece

  !> The neighbour of a piece.
  pure real(wp) function piece_beyond(history, piece, above) result(next)        ! [any]
    class(history_model), intent(in) :: history
    real(wp), intent(in) :: piece          !! a point within it [any]
    logical, intent(in) :: above
    next = beyond(history, history%next_corner(piece, above), above)
  end function piece_beyond

  !> The piece above or below a corner.
  pure real(wp) function beyond(history, corner, above) result(piece)            ! [any]
    class(history_model), intent(in) :: history
    real(wp), intent(in) :: corner         !! [any]
    logical, intent(in) :: above
    real(wp) :: other
    other = history%next_corner(corner, above)
    piece = middle([min(corner, other), max(corner, other)])
  end function beyond

  !> A point between two corners, one of which may not exist.
  pure real(wp) function middle(ends)      ! [any]
    real(wp), intent(in) :: ends(2)        !! [any]
    if (maxval(abs(ends)) < huge(1.0_wp)) then
      middle = 0.5_wp*sum(ends)
    else if (ends(1) > -huge(1.0_wp)) then
      middle = ends(1) + max(1.0_wp, abs(ends(1)))
    else
      middle = ends(2) - max(1.0_wp, abs(ends(2)))     ! 0 where neither exists
    end if
  end function middle
end module history_pieces
