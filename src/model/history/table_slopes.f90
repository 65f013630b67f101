!> Slopes at the points of a table, and so the curve between them: cubic splines, and the monotone cubic of Fritsch and Butland
!> (pchip).
module table_slopes
  use kinds, only: wp
  use lapack, only: dgtsv
  implicit none (type, external)
  private
  public :: spline_slopes, monotone_slopes

  !> What holds at both ends: nothing (spline: the third derivative is continuous at the second point), slope 0, curvature 0,
  !> the last point is the first of the next turn.
  integer, parameter, public :: ends_free = 0, ends_rest = 1, ends_natural = 2, ends_periodic = 3

contains

  !> The cubic with continuous curvature: a tridiagonal system for the slopes.
  subroutine spline_slopes(w, chord, ends, d)
    real(wp), intent(in) :: w(:)             !! (n - 1) lengths of the pieces [s]
    real(wp), intent(in) :: chord(:)         !! (n - 1) slopes of their chords [unit/s]
    integer, intent(in) :: ends              !! what holds at both ends
    real(wp), intent(out) :: d(:)            !! (n) slopes at the points [unit/s]
    real(wp) :: low(size(d)), diag(size(d)), up(size(d)), rhs(size(d), 1)
    integer :: n, i, info
    n = size(d)
    if (ends == ends_periodic) then
      call periodic_spline(w, chord, d)
    else if (ends == ends_free .and. n == 2) then
      d = chord(1)
    else if (ends == ends_free .and. n == 3) then      ! the parabola
      d(2) = (w(2)*chord(1) + w(1)*chord(2))/(w(1) + w(2))
      d(1) = 2*chord(1) - d(2)
      d(3) = 2*chord(2) - d(2)
    else
      do i = 2, n - 1
        low(i - 1) = w(i)
        diag(i) = 2*(w(i - 1) + w(i))
        up(i) = w(i - 1)
        rhs(i, 1) = 3*(w(i)*chord(i - 1) + w(i - 1)*chord(i))
      end do
      call end_row(ends, w, chord, diag(1), up(1), rhs(1, 1))
      call end_row(ends, w(n - 1:1:-1), chord(n - 1:1:-1), diag(n), low(n - 1), rhs(n, 1))
      call dgtsv(n, 1, low, diag, up, rhs, n, info)
      d = rhs(:, 1)
    end if
  end subroutine spline_slopes

  !> The equation of the slope at an end, seen from that end.
  pure subroutine end_row(ends, w, chord, own, next, rhs)
    integer, intent(in) :: ends              !! what holds there
    real(wp), intent(in) :: w(:)             !! lengths of the pieces from this end on [s]
    real(wp), intent(in) :: chord(:)         !! slopes of their chords [unit/s]
    real(wp), intent(out) :: own, next       !! coefficients of the slope here and at the next point [-] or [s]
    real(wp), intent(out) :: rhs             !! right-hand side [unit/s] or [unit]
    select case (ends)
    case (ends_rest)
      own = 1.0_wp
      next = 0.0_wp
      rhs = 0.0_wp
    case (ends_natural)
      own = 2.0_wp
      next = 1.0_wp
      rhs = 3*chord(1)
    case default
      own = w(2)
      next = w(1) + w(2)
      rhs = ((w(1) + 2*next)*w(2)*chord(1) + w(1)**2*chord(2))/next
    end select
  end subroutine end_row

  !> Slopes of the periodic spline: the tridiagonal system with an entry in two corners, by the formula of Sherman and Morrison.
  subroutine periodic_spline(w, chord, d)
    real(wp), intent(in) :: w(:)             !! (n - 1) lengths of the pieces [s]
    real(wp), intent(in) :: chord(:)         !! (n - 1) slopes of their chords [unit/s]
    real(wp), intent(out) :: d(:)            !! (n) [unit/s]
    real(wp) :: low(size(w)), diag(size(w)), up(size(w)), b(size(w), 2), before(size(w)), last
    integer :: m, info
    m = size(w)
    if (m == 1) then
      d = 0.0_wp
      return
    end if
    before = cshift(w, -1)
    diag = 2*(before + w)
    up = before
    low(:m - 1) = w(2:)
    b(:, 1) = 3*(w*cshift(chord, -1) + before*chord)
    if (m == 2) then
      d(1:2) = b(:, 1)/(3*(w(1) + w(2)))     ! both slopes are equal
    else
      last = -w(1)/diag(1)                   ! the last weight of the row that stands for the corner entries, the first is 1
      b(:, 2) = 0.0_wp
      b(1, 2) = -diag(1)
      b(m, 2) = w(m - 1)
      diag(m) = diag(m) - w(m - 1)*last
      diag(1) = 2*diag(1)
      call dgtsv(m, 2, low, diag, up, b, m, info)
      d(:m) = b(:, 1) - b(:, 2)*(b(1, 1) + last*b(m, 1))/(1 + b(1, 2) + last*b(m, 2))
    end if
    d(m + 1) = d(1)
  end subroutine periodic_spline

  !> Slopes that keep the curve between neighbouring values: flat pieces stay flat, a rise never turns back.
  pure subroutine monotone_slopes(w, chord, ends, d)
    real(wp), intent(in) :: w(:)             !! (n - 1) lengths of the pieces [s]
    real(wp), intent(in) :: chord(:)         !! (n - 1) slopes of their chords [unit/s]
    integer, intent(in) :: ends              !! what holds at both ends
    real(wp), intent(out) :: d(:)            !! (n) slopes at the points [unit/s]
    integer :: n, i
    n = size(d)
    do i = 2, n - 1
      d(i) = between(w(i - 1), w(i), chord(i - 1), chord(i))
    end do
    if (ends == ends_periodic) then
      d([1, n]) = between(w(n - 1), w(1), chord(n - 1), chord(1))
    else if (ends == ends_rest) then
      d([1, n]) = 0.0_wp
    else if (n == 2) then
      d = chord(1)
    else
      d(1) = at_end(w(1), w(2), chord(1), chord(2))
      d(n) = at_end(w(n - 1), w(n - 2), chord(n - 1), chord(n - 2))
    end if
  end subroutine monotone_slopes

  !> Slope at a point between two pieces: a weighted harmonic mean of the chords, 0 at a turning point.
  pure real(wp) function between(w1, w2, c1, c2) result(d)   ! [unit/s]
    real(wp), intent(in) :: w1, w2           !! lengths of the pieces [s]
    real(wp), intent(in) :: c1, c2           !! slopes of their chords [unit/s]
    d = 0.0_wp
    if (min(c1, c2) > 0.0_wp .or. max(c1, c2) < 0.0_wp) d = 3*(w1 + w2)/((2*w2 + w1)/c1 + (w2 + 2*w1)/c2)
  end function between

  !> Slope at an end: that of the parabola through three points, as far as the curve stays monotone.
  pure real(wp) function at_end(w1, w2, c1, c2) result(d)   ! [unit/s]
    real(wp), intent(in) :: w1, w2           !! lengths of the first pieces from the end [s]
    real(wp), intent(in) :: c1, c2           !! slopes of their chords [unit/s]
    d = ((2*w1 + w2)*c1 - w1*c2)/(w1 + w2)
    if (d*sign(1.0_wp, c1) <= 0.0_wp .or. .not. abs(c1) > 0.0_wp) then
      d = 0.0_wp
    else if (c1*sign(1.0_wp, c2) < 0.0_wp .and. abs(d) > 3*abs(c1)) then
      d = 3*c1
    end if
  end function at_end
end module table_slopes
