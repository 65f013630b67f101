!> Whether the list of modes and poles is complete, and the words that say so: where to count (`pole_count`), what is named.
module pole_check
  use kinds, only: wp, pi
  use dynamic_stiffness, only: stiffness_system
  use lapack, only: dgeev
  use mode_list, only: mode_set, by_modulus, undamped_mode
  use pole_count, only: pole_region, unnamed_poles
  use text, only: to_text
  use viscoelastic_law, only: viscoelastic_terms
  implicit none (type, external)
  private
  public :: check_undamped, check_damped, check_whole, judge_completeness

  real(wp), parameter :: steepest = 1.7_wp, flattest = 2.9_wp   !! bounds of the region's angle [rad]
  real(wp), parameter :: narrow = 1.001_wp             !! ratio of moduli between which no boundary fits [-]
  real(wp), parameter :: far_below = 1.0e-2_wp         !! of the lowest known pole: a lower one may be missing [-]
  integer, parameter :: further_gaps = 6               !! gaps beyond the list in which the boundary may lie

contains

  !> Counts the undamped modes up to the highest one that is asked for.
  subroutine check_undamped(ds, whole, starts, modes)
    type(stiffness_system), intent(inout) :: ds
    logical, intent(in) :: whole                       !! all eigenvalues of the system were computed
    complex(wp), intent(in) :: starts(:)               !! all that are known, Im < 0 where a search failed [1/s]
    type(mode_set), intent(inout) :: modes
    complex(wp), allocatable :: named(:), none(:)
    type(pole_region) :: region
    integer :: missing
    logical :: ok
    modes%note_undamped = 'undamped modes: '//to_text(modes%count)
    if (whole) then
      modes%note_undamped = modes%note_undamped//', complete, of all '//to_text(size(starts))
      return
    end if
    named = pack(starts, starts%im >= 0.0_wp)
    if (.not. any(abs(modes%lambda) > 0.0_wp)) then
      if (size(modes%unfound) > 0) modes%note_undamped = modes%note_undamped//', '//to_text(size(modes%unfound))//' not found'
      return
    end if
    allocate (none(0))                                 ! a rigid motion has two poles at zero
    call region_of(named, maxval([abs(modes%lambda), abs(modes%unfound)]), pi/2 + 0.3_wp, region, none, none)
    call unnamed_poles(ds, 0.0_wp, region, [named, pack(named, abs(named) <= 0.0_wp)], none, [integer ::], missing, ok)
    modes%verified = ok
    if (ok) modes%missing_undamped = (missing + 1)/2
    modes%note_undamped = modes%note_undamped//', '//verdict(region, .false., modes%missing_undamped, ok)
  end subroutine check_undamped

  !> Where all eigenvalues of the system were computed they are the poles, each listed or of a mode that was not asked for.
  subroutine check_whole(modes, expected, all_asked)
    type(mode_set), intent(inout) :: modes
    integer, intent(in) :: expected                    !! eigenvalues, one of each conjugate pair
    logical, intent(in) :: all_asked                   !! for all modes
    complex(wp) :: listed(count(modes%kind /= undamped_mode))   ! [1/s]
    character(:), allocatable :: number
    integer :: others
    listed = pack(modes%lambda, modes%kind /= undamped_mode)
    others = expected - size(listed)
    if (all_asked .or. others < 0) modes%missing = others
    number = to_text(size(listed) + count(listed%im > 0.0_wp))//' with conjugates'
    if (modes%missing /= 0) then
      modes%note_damped = 'poles: '//number//', '//to_text(others)//' missing'
    else if (others == 0) then
      modes%note_damped = 'poles: complete, all '//number
    else
      modes%note_damped = 'poles: '//number//', complete, '//to_text(others)//' of modes not asked for left out'
    end if
  end subroutine check_whole

  !> Counts the poles of the damped system.
  subroutine check_damped(ds, zeros, others, ranks, modes, unlisted)
    type(stiffness_system), intent(inout) :: ds
    integer, intent(in) :: zeros                       !! poles at zero
    complex(wp), intent(in) :: others(:)               !! poles of modes that are not asked for, nearly [1/s]
    integer, intent(in) :: ranks(:)                    !! (groups) orders of the viscoelastic terms' own poles
    type(mode_set), intent(inout) :: modes, unlisted
    complex(wp), allocatable :: listed(:), named(:), laws(:), ends(:)
    integer, allocatable :: orders(:), crowds(:)
    type(pole_region) :: region
    integer :: missing, number, lost, unasked, j
    logical, allocatable :: vibrates(:)
    logical :: ok
    listed = pack(modes%lambda, modes%kind /= undamped_mode)
    number = size(listed) + count(listed%im > 0.0_wp)
    lost = size(modes%lost) + count(modes%lost%im > 0.0_wp)
    modes%note_damped = 'poles: '//to_text(number)//' with conjugates'
    if (.not. any(abs(listed) > 0.0_wp)) return
    named = [listed, unlisted%lambda, others]
    call law_poles(ds, ranks, laws, orders, ends, crowds)
    vibrates = -listed%re < 0.5_wp*abs(listed)
    call region_of(named, maxval(abs(listed), vibrates .or. .not. any(vibrates)), steepest, region, laws, ends)
    unasked = count(inside(named(size(listed) + 1:)))
    named = [named, [((0.0_wp, 0.0_wp), j=1, zeros)]]
    ! poles of modes that are not known crowd at the ends: with as many poles there what is left of the determinant hardly turns
    call unnamed_poles(ds, 1.0_wp, region, named, [laws, ends], [orders + crowds, -crowds], missing, ok)
    missing = missing + sum(crowds, inside(ends)) - sum(crowds, inside(laws))
    ok = ok .and. missing >= 0                         ! else estimates stand for poles that are not there
    if (ok) modes%missing = missing
    modes%verified = modes%verified .and. ok
    modes%note_damped = modes%note_damped//', '//verdict(region, .true., modes%missing, ok)
    if (ok .and. unasked > 0) modes%note_damped = modes%note_damped//', '//to_text(unasked)//' of modes not asked for left out'
    if (lost > 0) modes%note_damped = modes%note_damped//'; '//to_text(lost)//' searches found no further one'
  contains
    !> Whether a pole is in the region, or its conjugate.
    pure elemental logical function inside(s)
      complex(wp), intent(in) :: s                     !! [1/s]
      inside = abs(s) > region%inner .and. abs(s) < region%outer .and. atan2(abs(s%im), s%re) < region%angle
    end function inside
  end subroutine check_damped

  !> A region that holds the listed poles and whose boundary is far from all: it ends in the widest gap beyond the list, where
  !> each set of viscoelastic terms has as many poles of its own inside as ends of the chains of poles that start there.
  subroutine region_of(named, top, angle, region, laws, ends)
    complex(wp), intent(in) :: named(:)                !! known poles [1/s]
    real(wp), intent(in) :: top                        !! modulus of the highest listed one [1/s]
    real(wp), intent(in) :: angle                      !! smallest angle [rad]
    type(pole_region), intent(out) :: region
    complex(wp), intent(in) :: laws(:), ends(:)        !! of the viscoelastic terms, in the same order [1/s]
    real(wp) :: from, to, best, lowest
    integer :: k
    logical :: near(size(named))
    near = abs(named) > 0.0_wp .and. abs(named%im) > 0.3_wp*abs(named)
    if (.not. any(near)) near = abs(named) > 0.0_wp
    lowest = minval(abs(named), near)
    best = 0.0_wp
    from = top
    region%outer = 1.1_wp*top
    do k = 1, further_gaps
      to = 1.5_wp*from
      if (any(near .and. abs(named) > from)) to = min(to, minval(abs(named), near .and. abs(named) > from))
      if (to/from > max(best, narrow) .and. balanced(sqrt(from*to))) then
        best = to/from
        region%outer = sqrt(from*to)
      end if
      if (.not. any(near .and. abs(named) > from)) exit
      from = to
    end do
    region%inner = far_below*min(lowest, top)
    region%angle = widest([named, laws, ends], region%inner, region%outer, angle)
  contains
    !> Whether no chain of poles crosses a circle.
    pure logical function balanced(radius) result(yes)
      real(wp), intent(in) :: radius                   !! [1/s]
      yes = all((abs(laws) < radius) .eqv. (abs(ends) < radius))
    end function balanced
  end subroutine region_of

  !> The middle of the widest angle without known poles.
  pure real(wp) function widest(named, inner, outer, least) result(angle)
    complex(wp), intent(in) :: named(:)                !! [1/s]
    real(wp), intent(in) :: inner, outer               !! moduli between which poles count [1/s]
    real(wp), intent(in) :: least                      !! smallest angle [rad]
    real(wp) :: at(size(named)), from, to, best
    integer :: k
    at = atan2(abs(named%im), named%re)
    angle = 0.5_wp*(least + flattest)
    from = least
    best = 0.0_wp
    do k = 1, size(named) + 1
      to = minval([flattest, pack(at, at > from .and. abs(named) > inner .and. abs(named) < outer)])
      if (to - from > best) then
        best = to - from
        angle = 0.5_wp*(from + to)
      end if
      if (to >= flattest) return
      from = to
    end do
  end function widest

  !> Poles of the viscoelastic terms themselves with their orders in the determinant, and where the chains of poles end that start
  !> there: with growing stiffness they tend to the zeros of the modulus, 1 + g(s) = 0.
  subroutine law_poles(ds, ranks, laws, orders, ends, crowds)
    type(stiffness_system), intent(in) :: ds
    integer, intent(in) :: ranks(:)                    !! (groups)
    complex(wp), allocatable, intent(out) :: laws(:), ends(:)   !! [1/s]
    integer, allocatable, intent(out) :: orders(:), crowds(:)   !! how often each is known; about how often beside that
    complex(wp), allocatable :: own(:)
    integer :: r, j, deformed
    allocate (laws(0), ends(0), orders(0), crowds(0))
    do r = 1, size(ds%groups)
      associate (law => ds%groups(r)%law)
        own = law%rates()
        laws = [laws, own(by_modulus(own))]
        ends = [ends, chain_ends(law)]
        orders = [orders, [(ranks(r), j=1, size(own))]]
        deformed = count(ds%row(ds%groups(r)%entry) == ds%col(ds%groups(r)%entry))
        crowds = [crowds, [(max(0, deformed - ranks(r)), j=1, size(own))]]
      end associate
    end do
  end subroutine law_poles

  !> Zeros of the modulus by ascending modulus: eigenvalues of the terms, each of which follows delta = sum_j share_j z_j, as
  !> equations of first order for z and, of second order, z'/omega.
  function chain_ends(law) result(values)
    type(viscoelastic_terms), intent(in) :: law
    complex(wp) :: values(law%order())
    real(wp), dimension(law%order(), law%order()) :: a                 ! [1/s]
    real(wp) :: wr(size(values)), wi(size(values)), work(8*size(values)), v(1, 2), omega   ! [1/s], [1/s], [any], [-], [rad/s]
    integer :: k, n, i, info
    n = size(law%alpha)
    a = 0.0_wp
    do k = 1, n
      i = k                                            ! row in which z_k is drawn to delta
      omega = 1/law%viscosity(k)
      if (k <= law%second) then
        i = n + k
        omega = 1/sqrt(law%inertia(k))
        a(k, i) = omega
        a(i, i) = -law%viscosity(k)*omega**2
      end if
      a(i, 1:n) = a(i, 1:n) + omega*law%alpha/(1 + sum(law%alpha))
      a(i, k) = a(i, k) - omega
    end do
    n = size(values)
    call dgeev('N', 'N', n, a, n, wr, wi, v(:, 1:1), 1, v(:, 2:2), 1, work, size(work), info)
    values = cmplx(wr, wi, wp)
    values = values(by_modulus(values))
  end function chain_ends

  !> What is to be said of the list, nothing where it is complete.
  subroutine judge_completeness(modes, failed, words)
    type(mode_set), intent(in) :: modes
    logical, intent(out) :: failed                     !! modes that were asked for are missing
    character(:), allocatable, intent(out) :: words
    integer :: k
    failed = size(modes%unfound) > 0 .or. modes%missing_undamped > 0
    words = ''
    if (failed) then
      words = 'the modal analysis has not found all modes that were asked for: '//modes%note_undamped
      do k = 1, size(modes%unfound)
        words = words//', one near '//hertz(abs(modes%unfound(k)))
      end do
    else if (modes%missing /= 0) then
      words = 'poles are missing in modes.txt: '//modes%note_damped
    else if (.not. modes%verified) then
      words = 'modes.txt may not be complete: '//modes%note_undamped//'; '//modes%note_damped
    end if
  end subroutine judge_completeness

  !> The count in words.
  function verdict(region, damped, missing, ok) result(text)
    type(pole_region), intent(in) :: region
    logical, intent(in) :: damped
    integer, intent(in) :: missing
    logical, intent(in) :: ok
    character(:), allocatable :: text
    character(60) :: range
    range = hertz(region%inner)//' and '//hertz(region%outer)
    if (.not. ok) then
      text = 'not counted: between '//trim(range)//' the determinant is lost in rounding or poles crowd at the boundary'
    else if (missing > 0) then
      text = to_text(missing)//' missing between '//trim(range)
    else
      text = 'complete between '//trim(range)
    end if
    if (ok .and. damped) text = text//' up to a damping ratio of '//to_text(anint(-100*cos(region%angle))/100)
  end function verdict

  !> A modulus as a frequency.
  pure function hertz(modulus) result(text)
    real(wp), intent(in) :: modulus                    !! [rad/s]
    character(:), allocatable :: text
    text = to_text(modulus/(2*pi))//' Hz'
  end function hertz
end module pole_check
