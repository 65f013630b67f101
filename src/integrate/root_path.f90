!> Roots within a step, along the method's own continuous solution (theory.md, section 11). A piece of the step is divided until
!> each root either cannot fall in it, by a bound of how far it dips below its values, or falls for sure and only once. The bound
!> follows from the motion: with the path l of the coordinates that a root is a function of, its largest second derivative b by
!> them, and the change D of their rates, a half of a piece of length tau dips by at most
!>
!>   b l^2/8/(1 - b l/2), or l/2, + tau D/16
!>
!> which holds where the rates are those of the piece's three samples and turn by less than a radian. Where b is not known, the
!> second difference of the root stands for it.
module root_path
  use kinds, only: wp
  use ode_system, only: ode
  use root_cubic, only: cubic_fall
  use time_stepper, only: root_values, stepper
  implicit none (type, external)
  private
  public :: first_suspect

  real(wp), parameter :: most_turn = 1.0_wp    !! of rates in a piece [rad]
  integer, parameter :: least_level = 1        !! of pieces in which second differences are believed: halves of the step
  integer, parameter :: most_levels = 40       !! pieces so short are not divided

  !> A piece in which a root falls.
  type, public :: root_suspect
    integer :: root = 0
    real(wp) :: h = 0.0_wp                     !! where, by the continuous solution [s]
    type(root_values) :: left, right           !! ends of the piece
  end type root_suspect

contains

  !> Roots at a length within the step that was tried.
  subroutine sample_at(march, system, step, h, x)
    class(stepper), intent(inout) :: march
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: step, h            !! of the step, of the sample [s]
    type(root_values), intent(out) :: x
    integer :: k
    associate (y => march%inner, path => march%path, n => march%degree)
      y = path(:, n)
      do k = n - 1, 0, -1
        y = path(:, k) + (h/step)*y
      end do
      x%h = h
      allocate (x%g(system%roots), x%rate(system%roots), x%course(system%roots))
      call system%follow_roots(march%t + h, y, x%g, x%rate, x%course)
    end associate
  end subroutine sample_at

  !> The first suspect in a piece between two samples; roots that are below zero at its start have been looked at.
  recursive subroutine first_suspect(march, system, step, a, b, level, followed, suspect, found)
    class(stepper), intent(inout) :: march
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: step               !! [s]
    type(root_values), intent(in) :: a, b
    integer, intent(in) :: level               !! of division
    logical, intent(inout) :: followed(:)      !! (roots) those that are asked for, then those of them that the path gives
    type(root_suspect), intent(inout) :: suspect
    logical, intent(out) :: found
    type(root_values) :: m
    logical :: open
    call sample_at(march, system, step, 0.5_wp*(a%h + b%h), m)
    if (level == 0) followed = followed .and. m%g < huge(1.0_wp)
    call look_through(a, m, b, march%roots%zero, followed, level, open, suspect)
    found = .not. open .and. suspect%root > 0
    if (found .or. .not. open) return
    if (level == most_levels) then
      call take_deepest(a, m, b, march%roots%zero, followed, suspect, found)
      return
    end if
    call first_suspect(march, system, step, a, m, level + 1, followed, suspect, found)
    if (.not. found) call first_suspect(march, system, step, m, b, level + 1, followed, suspect, found)
  end subroutine first_suspect

  !> Of a piece that is too short to be divided: a root that is below zero there; where none is, what is open is rounding.
  pure subroutine take_deepest(a, m, b, zero, followed, suspect, found)
    type(root_values), intent(in) :: a, m, b
    real(wp), intent(in) :: zero(:)            !! (roots) [any]
    logical, intent(in) :: followed(:)         !! (roots)
    type(root_suspect), intent(inout) :: suspect
    logical, intent(out) :: found
    suspect%root = minloc(min(m%g, b%g) + zero, 1, followed .and. a%g >= -zero)
    found = suspect%root > 0
    if (found) found = min(m%g(suspect%root), b%g(suspect%root)) < -zero(suspect%root)
    suspect%h = m%h
    suspect%left = a
    suspect%right = b
  end subroutine take_deepest

  !> Judges the roots of a piece by three samples: it is open where one may fall unseen. Else the suspect is the first of those that
  !> fall; 0: none does.
  pure subroutine look_through(a, m, b, zero, followed, level, open, suspect)
    type(root_values), intent(in) :: a, m, b
    real(wp), intent(in) :: zero(:)            !! (roots) [any]
    logical, intent(in) :: followed(:)         !! (roots)
    integer, intent(in) :: level
    logical, intent(out) :: open
    type(root_suspect), intent(inout) :: suspect
    real(wp) :: rate(3), half, dip, h          ! rates at the samples [any/s]; [s]; [any]; [s]
    integer :: k
    half = 0.5_wp*(b%h - a%h)
    open = .false.
    suspect%root = 0
    suspect%h = huge(1.0_wp)
    do k = 1, size(zero)
      if (.not. followed(k) .or. a%g(k) < -zero(k)) cycle
      rate = [a%rate(k), m%rate(k), b%rate(k)]
      if (maxval(rate) >= huge(1.0_wp)) rate = parabola_rates(a%g(k), m%g(k), b%g(k))/half
      dip = deepest(k, a, m, b, level)
      if (clear(a%g(k), rate(1), m%g(k), rate(2)) .and. clear(m%g(k), rate(2), b%g(k), rate(3))) cycle
      open = .not. (b%g(k) < -zero(k) .and. maxval(rate)*half < -4*dip)
      if (open) return
      if (m%g(k) < 0.0_wp) then
        h = a%h + half*cubic_fall([max(a%g(k), 0.0_wp), m%g(k)], half*rate(1:2))
      else
        h = m%h + half*cubic_fall([m%g(k), b%g(k)], half*rate(2:3))
      end if
      if (h >= suspect%h) cycle
      suspect%root = k
      suspect%h = h
    end do
    if (suspect%root == 0) return
    suspect%left = a
    suspect%right = b
  contains
    !> Whether a root cannot fall in a half: it is above the dip at both ends, or by its value and slope at one of them.
    pure logical function clear(g1, rate1, g2, rate2) result(yes)
      real(wp), intent(in) :: g1, g2           !! [any]
      real(wp), intent(in) :: rate1, rate2     !! [any/s]
      real(wp) :: least                        ! [any]
      least = -zero(k)
      yes = min(g1, g2) >= least .and. &
            max(min(g1, g2) - dip, g1 + half*rate1 - 4*dip, g2 - half*rate2 - 4*dip) >= least
    end function clear
  end subroutine look_through

  !> Slopes of the parabola through three values at -1, 0 and 1, there.
  pure function parabola_rates(a, m, b) result(rate)
    real(wp), intent(in) :: a, m, b            !! [any]
    real(wp) :: rate(3)                        ! [any]
    rate = 0.5_wp*[4*m - 3*a - b, b - a, 3*b + a - 4*m]
  end function parabola_rates

  !> How far root k may dip below its values at the ends of each half of a piece; huge: that is not to be told.
  pure real(wp) function deepest(k, a, m, b, level) result(dip)   ! [any]
    integer, intent(in) :: k, level
    type(root_values), intent(in) :: a, m, b
    real(wp) :: tau, path, bent, change        ! [s], [any], [-], [any/s]
    tau = b%h - a%h
    associate (ca => a%course(k), cm => m%course(k), cb => b%course(k))
      dip = huge(1.0_wp)/8
      if (tau*max(ca%turning, cm%turning, cb%turning) > most_turn) return
      bent = max(ca%bend, cm%bend, cb%bend, a%rate(k), m%rate(k), b%rate(k))
      if (bent >= huge(1.0_wp)) then           ! of a root whose rate is not known the coordinates are not, either
        if (level >= least_level) dip = 0.25_wp*abs(a%g(k) - 2*m%g(k) + b%g(k))
        return
      end if
      change = sum(abs(cm%w - ca%w)) + sum(abs(cb%w - cm%w))
      path = 0.5_wp*tau*max(sum(abs(ca%w)), sum(abs(cm%w)), sum(abs(cb%w)))
      bent = max(ca%bend, cm%bend, cb%bend)*path
      dip = 0.5_wp*path
      if (3*bent < 4.0_wp) dip = bent*path/(8 - 4*bent)
      dip = dip + tau*change/16
    end associate
  end function deepest
end module root_path
