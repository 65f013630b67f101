!> Profiles by a curve c(u) that runs about its inside counter-clockwise. The profile lies `inset` within it: the curve of a law is
!> that of its roller's centre (pitch curve), with the same normals. A nearest place is found from the point alone, without memory,
!> so that trials of steps and restarts meet the same one: the curve is cut into arcs, each within a circle; only arcs whose circles
!> come nearer than the best place are searched, by Newton's method within brackets (theory.md, section 17).
module curve_profile
  use kinds, only: wp
  use marker, only: turn
  use profile, only: profile_foot, profile_model, profile_reach
  implicit none (type, external)
  private

  integer, parameter :: samples = 8          !! of an arc, for its circle and for checks
  integer, parameter :: most_trials = 100    !! each second one at least halves the bracket

  !> A place of the curve.
  type, public :: curve_place
    real(wp) :: u = 0.0_wp                   !! [any]
    real(wp) :: c(2) = 0.0_wp                !! [m]
    real(wp) :: n(2) = 0.0_wp                !! outward normal [-]
    real(wp) :: speed = 0.0_wp               !! |dc/du| [m/any]
    real(wp) :: curvature = 0.0_wp           !! of the curve, positive where it is convex [1/m]
  end type curve_place

  integer, parameter, public :: flaw_undercut = 1, flaw_concave = 2, flaw_hollow = 3, flaw_double = 4
  real(wp), parameter :: same = 1.0e-9_wp    !! distances so near are one, of the profile's size [-]

  !> What is told of a pair before it runs.
  type, public :: pair_limits
    integer :: flaw = 0                      !! the first that is found; 0: none
    real(wp) :: range(2) = 0.0_wp            !! of u, the first one where there are flaws [any]
    real(wp) :: reach = 0.0_wp               !! of a flat face, from where it stands on a circle [m]
    real(wp) :: radius = huge(1.0_wp)        !! least radius of curvature, of the profile; of the curve in flaws [m]
  end type pair_limits

  !> Such a profile.
  type, abstract, extends(profile_model), public :: curve_model
    real(wp) :: inset = 0.0_wp               !! [m]
    logical :: closed = .true.
    type(curve_place), allocatable :: ends(:)      !! (0:arcs) of the arcs
    real(wp), allocatable :: middle(:, :)    !! (2, arcs) of circles about them [m]
    real(wp), allocatable :: radius(:)       !! (arcs) of these [m]
  contains
    procedure(place_at), deferred :: at
    procedure :: nearest => nearest_of_arcs
    procedure :: support => convex_support
    procedure :: outline => curve_outline
    procedure :: cut
    procedure :: examine
    procedure :: leaves => never_leaves
  end type curve_model

  abstract interface
    !> The place at u.
    pure type(curve_place) function place_at(self, u, piece) result(q)
      import :: curve_model, curve_place, wp
      class(curve_model), intent(in) :: self
      real(wp), intent(in) :: u              !! [any]
      integer, intent(in) :: piece           !! that goes on beyond its ends; 0: none
    end function place_at
  end interface

contains

  !> Cuts the curve at some u. Samples are so near that what lies between is within the distance of two.
  subroutine cut(self, u)
    class(curve_model), intent(inout) :: self
    real(wp), intent(in) :: u(0:)            !! ascending, from the beginning to the end [any]
    type(curve_place) :: q
    real(wp) :: c(2, 0:samples)              ! [m]
    integer :: i, k
    allocate (self%ends(0:size(u) - 1), self%middle(2, size(u) - 1), self%radius(size(u) - 1))
    self%ends(0) = self%at(u(0), 0)
    do i = 1, size(u) - 1
      do k = 0, samples
        q = self%at(u(i - 1) + (u(i) - u(i - 1))*k/samples, 0)
        c(:, k) = q%c
      end do
      self%ends(i) = q
      self%middle(:, i) = 0.5_wp*(maxval(c, 2) + minval(c, 2))
      self%radius(i) = maxval(norm2(c - spread(self%middle(:, i), 2, samples + 1), 1)) &
                       + maxval(norm2(c(:, 1:) - c(:, :samples - 1), 1))
    end do
  end subroutine cut

  !> The nearest place. The distance to a place within an arc is least where (d - c).t falls through zero.
  pure type(profile_foot) function nearest_of_arcs(self, d, piece) result(foot)
    class(curve_model), intent(in) :: self
    real(wp), intent(in) :: d(2)             !! [m]
    integer, intent(in) :: piece             !! on whose continuation the place is, where it lies beyond
    type(curve_place) :: best
    real(wp) :: f(0:size(self%radius))       ! (d - c).t at the ends of arcs [m]
    real(wp) :: bound(size(self%radius))     ! no place of the arc is nearer [m]
    real(wp) :: least
    integer :: i, n
    n = size(self%radius)
    do i = 0, n
      f(i) = along(self%ends(i), d)
    end do
    bound = sqrt((d(1) - self%middle(1, :))**2 + (d(2) - self%middle(2, :))**2) - self%radius
    least = huge(1.0_wp)
    if (.not. self%closed) then
      if (f(0) < 0.0_wp) call compare(d, straight(self%ends(0), f(0)), best, least)
      if (f(n) > 0.0_wp) call compare(d, straight(self%ends(n), f(n)), best, least)
    end if
    do
      i = minloc(bound, 1)
      if (bound(i) >= least) exit
      bound(i) = huge(1.0_wp)
      if (f(i - 1) < 0.0_wp .or. f(i) > 0.0_wp) cycle
      call compare(d, root(self, d, self%ends(i - 1:i)%u, f(i - 1:i)), best, least)
    end do
    if (least >= huge(1.0_wp)) call compare(d, self%ends(nearest_end()), best, least)   ! far away an arc may hide two places
    if (self%leaves(piece, best%u)) call follow(self, piece, d, best)
    foot%n = best%n
    foot%distance = dot_product(d - best%c, best%n) + self%inset
    foot%curvature = inset_curvature(self, best%curvature)
    foot%u = best%u
    foot%advance = 1/(best%speed*max(1 + best%curvature*dot_product(d - best%c, best%n), sqrt(tiny(1.0_wp))))
  contains
    !> The end of an arc that is nearest.
    pure integer function nearest_end() result(k)
      integer :: j
      k = 0
      do j = 1, n
        if (norm2(d - self%ends(j)%c) < norm2(d - self%ends(k)%c)) k = j
      end do
    end function nearest_end
  end function nearest_of_arcs

  !> Keeps a place that is nearer.
  pure subroutine compare(d, other, best, least)
    real(wp), intent(in) :: d(2)             !! [m]
    type(curve_place), intent(in) :: other
    type(curve_place), intent(inout) :: best
    real(wp), intent(inout) :: least         !! distance of the best one so far [m]
    real(wp) :: away                         ! [m]
    away = norm2(d - other%c)
    if (away >= least) return
    least = away
    best = other
  end subroutine compare

  !> Whether a place is at or beyond an end of a piece; most curves have none.
  pure logical function never_leaves(self, piece, u) result(yes)
    class(curve_model), intent(in) :: self
    integer, intent(in) :: piece             !! 0: none
    real(wp), intent(in) :: u                !! [any]
    yes = .false.
  end function never_leaves

  !> The nearest place on the continuation of a piece, from that on the curve.
  pure subroutine follow(self, piece, d, q)
    class(curve_model), intent(in) :: self
    integer, intent(in) :: piece
    real(wp), intent(in) :: d(2)             !! [m]
    type(curve_place), intent(inout) :: q
    real(wp) :: u, step
    integer :: k
    u = q%u
    do k = 1, most_trials
      q = self%at(u, piece)
      step = along(q, d)/(q%speed*(1 + q%curvature*dot_product(d - q%c, q%n)))
      if (abs(step) <= 2*spacing(u)) return
      u = u + step
    end do
  end subroutine follow

  !> The place at some length beyond an end: the curve goes on straight.
  pure type(curve_place) function straight(last, length) result(q)
    type(curve_place), intent(in) :: last
    real(wp), intent(in) :: length           !! [m]
    q = last
    q%c = q%c + length*turn(q%n)
    q%curvature = 0.0_wp
  end function straight

  !> How far a point lies ahead of a place, along its tangent.
  pure real(wp) function along(q, d)         ! [m]
    type(curve_place), intent(in) :: q
    real(wp), intent(in) :: d(2)             !! [m]
    along = (d(2) - q%c(2))*q%n(1) - (d(1) - q%c(1))*q%n(2)
  end function along

  !> Largest n(alpha).c: N.t falls through zero where the normal is N; its slope is -speed curvature N.n.
  pure type(profile_reach) function convex_support(self, alpha, piece) result(reach)
    class(curve_model), intent(in) :: self
    real(wp), intent(in) :: alpha            !! [rad]
    integer, intent(in) :: piece             !! 0: none
    real(wp) :: n(2), low, high, u
    type(curve_place) :: q
    integer :: k
    logical :: stays
    n = [cos(alpha), sin(alpha)]
    do k = 1, size(self%radius)
      if (dot_product(n, turn(self%ends(k - 1)%n)) >= 0.0_wp .and. dot_product(n, turn(self%ends(k)%n)) < 0.0_wp) exit
    end do
    k = min(k, size(self%radius))
    low = self%ends(k - 1)%u
    high = self%ends(k)%u
    u = 0.5_wp*(low + high)
    do k = 1, most_trials
      q = self%at(u, 0)
      call newton(low, high, u, dot_product(n, turn(q%n)), q%speed*q%curvature*dot_product(n, q%n), stays)
      if (stays) exit
    end do
    if (self%leaves(piece, q%u)) then
      do k = 1, most_trials
        q = self%at(u, piece)
        low = dot_product(n, turn(q%n))/(q%speed*q%curvature*dot_product(n, q%n))
        if (abs(low) <= 2*spacing(u)) exit
        u = u + low
      end do
    end if
    reach%p(0:1) = [dot_product(n, q%c) - self%inset, dot_product(turn(n), q%c)]
    reach%p(2) = 1/q%curvature - self%inset - reach%p(0)
    reach%u = q%u
    reach%advance = 1/(q%speed*q%curvature)
  end function convex_support

  !> The place in a bracket from which a point lies along the normal; f falls there. Its slope is -speed (1 + curvature D).
  pure type(curve_place) function root(self, d, ends, f) result(q)
    class(curve_model), intent(in) :: self
    real(wp), intent(in) :: d(2)             !! [m]
    real(wp), intent(in) :: ends(2), f(2)    !! [any], [m]
    real(wp) :: low, high, u
    integer :: k
    logical :: stays
    low = ends(1)
    high = ends(2)
    u = 0.5_wp*(low + high)
    if (f(1) > f(2)) u = low + (high - low)*(f(1)/(f(1) - f(2)))
    do k = 1, most_trials
      q = self%at(u, 0)
      call newton(low, high, u, along(q, d), q%speed*(1 + q%curvature*dot_product(d - q%c, q%n)), stays)
      if (stays) exit
    end do
  end function root

  !> One step of Newton's method for a function that falls within a bracket.
  pure subroutine newton(low, high, u, value, slope, stays)
    real(wp), intent(inout) :: low, high, u  !! [any]
    real(wp), intent(in) :: value            !! at u [any]
    real(wp), intent(in) :: slope            !! minus its derivative [any]
    logical, intent(out) :: stays            !! u is the root
    real(wp) :: next
    if (value > 0.0_wp) low = u
    if (value < 0.0_wp) high = u
    next = 0.5_wp*(low + high)
    if (slope > 0.0_wp) then
      if (u + value/slope >= low .and. u + value/slope <= high) next = u + value/slope
    end if
    stays = abs(next - u) <= 2*spacing(max(abs(low), abs(high))) .or. abs(value) <= 0.0_wp
    u = next
  end subroutine newton

  !> Curvature of the profile from that of the curve.
  pure real(wp) function inset_curvature(self, curvature) result(profile)   ! [1/m]
    class(curve_model), intent(in) :: self
    real(wp), intent(in) :: curvature        !! [1/m]
    profile = curvature/(1 - curvature*self%inset)
  end function inset_curvature

  !> Some points of each arc.
  pure function curve_outline(self) result(c)
    class(curve_model), intent(in) :: self
    real(wp), allocatable :: c(:, :)         ! (2, points) [m]
    type(curve_place) :: q
    integer :: i, k, each
    each = max(1, samples*32/size(self%radius))
    allocate (c(2, 0:each*size(self%radius)))
    do i = 1, size(self%radius)
      do k = 0, each
        q = self%at(self%ends(i - 1)%u + (self%ends(i)%u - self%ends(i - 1)%u)*k/each, 0)
        c(:, (i - 1)*each + k) = q%c - self%inset*q%n
      end do
    end do
  end function curve_outline

  !> What is wrong where a follower touches, at samples all along the curve: a roller fits where 1 + kappa radius > 0 and the place
  !> that it touches is the nearest; the inset is a roller of the law's own, a face needs places that are convex.
  subroutine examine(self, radius, flat, found)
    class(curve_model), intent(in) :: self
    real(wp), intent(in) :: radius           !! of the roller [m]
    logical, intent(in) :: flat
    type(pair_limits), intent(out) :: found
    type(curve_place) :: q
    type(profile_foot) :: foot
    real(wp) :: u(0:samples*size(self%radius)), bend
    integer :: flaw(0:samples*size(self%radius)), i, k, n, first
    n = size(self%radius)*samples
    flaw = 0
    do i = 0, n
      k = min(i/samples, size(self%radius) - 1)
      u(i) = self%ends(k)%u + (self%ends(k + 1)%u - self%ends(k)%u)*(i - k*samples)/samples
      q = self%at(u(i), 0)
      bend = 0.0_wp
      if (1 - q%curvature*self%inset > 0.0_wp) bend = inset_curvature(self, q%curvature)
      if (1 - q%curvature*self%inset <= 0.0_wp .or. q%speed <= 0.0_wp) then
        flaw(i) = flaw_undercut
      else if (flat .and. .not. q%curvature > 0.0_wp) then
        flaw(i) = flaw_concave
      else if (1 + bend*radius <= 0.0_wp) then
        flaw(i) = flaw_hollow
      else
        foot = self%nearest(q%c + (radius - self%inset)*q%n, 0)
        if (abs(foot%distance - radius) > same*(norm2(q%c) + radius)) flaw(i) = flaw_double
      end if
      if (flaw(i) > 0 .and. found%flaw == 0) found = pair_limits(flaw=flaw(i))
      found%reach = max(found%reach, abs(dot_product(q%c, turn(q%n))))
      if (flaw(i) /= found%flaw .or. .not. abs(q%curvature) > 0.0_wp) cycle
      if (flaw(i) == flaw_undercut) then
        found%radius = min(found%radius, 1/q%curvature)
      else if (flaw(i) > 0) then
        found%radius = min(found%radius, 1/abs(q%curvature))
      else if (q%curvature > 0.0_wp) then
        found%radius = min(found%radius, 1/q%curvature - self%inset)
      end if
    end do
    if (found%flaw == 0) return
    first = 0
    if (self%closed .and. any(flaw == 0)) first = findloc(flaw, 0, 1) - 1      ! the range may go over the beginning
    flaw = cshift(flaw, first)
    u = cshift(u, first)
    first = findloc(flaw > 0, .true., 1)
    k = findloc(flaw(first:) == 0, .true., 1)
    if (k == 0) k = n - first + 3
    found%range = [u(first - 1), u(first + k - 3)]
  end subroutine examine
end module curve_profile
