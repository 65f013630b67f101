!> Profiles by a curve c(u) that runs about its inside counter-clockwise. The profile lies `inset` within it: the curve of a law is
!> that of its roller's centre (pitch curve), with the same normals. A nearest place is found from the point alone, without memory,
!> so that trials of steps and restarts meet the same one: the curve is cut into arcs, each within a circle; only arcs whose circles
!> come nearer than the best place are searched, by Newton's method within brackets that hold but one (theory.md, section 17).
module curve_profile
  use kinds, only: half_digits, pi, wp
  use marker, only: turn
  use profile, only: no_piece, profile_bends, profile_foot, profile_model, profile_reach, profile_way
  implicit none (type, external)
  private

  integer, parameter :: samples = 8          !! of an arc, for its circle and for checks
  real(wp), parameter :: nodes(5) = 0.5_wp + [-0.4530899229693320_wp, -0.2692346550528415_wp, 0.0_wp, 0.2692346550528415_wp, &
                                              0.4530899229693320_wp]   !! of Gauss, between 0 and 1 [-]
  real(wp), parameter :: weights(5) = [0.1184634425280945_wp, 0.2393143352496832_wp, 0.2844444444444444_wp, &
                                       0.2393143352496832_wp, 0.1184634425280945_wp]   !! [-]
  real(wp), parameter :: apart = epsilon(1.0_wp)**(1.0_wp/3)   !! places for a difference quotient, of the curve [-]
  integer, parameter :: most_halvings = 12   !! of an arc in which several places may be nearest
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

  !> What is told of a pair before it runs.
  type, public :: pair_limits
    integer :: flaw = 0                      !! the first that is found; 0: none
    real(wp) :: range(2) = 0.0_wp            !! of u, where it is [any]
    real(wp) :: reach = 0.0_wp               !! of a flat face, from where it stands on a circle [m]
    real(wp) :: radius = huge(1.0_wp)        !! least radius of curvature, of the profile; of the curve where the flaw is [m]
  end type pair_limits

  !> Such a profile.
  type, abstract, extends(profile_model), public :: curve_model
    real(wp) :: inset = 0.0_wp               !! [m]
    real(wp) :: sense = 1.0_wp               !! of the argument of a law along u: 1 or -1 [-]
    logical :: closed = .true.
    type(curve_place), allocatable :: ends(:)      !! (0:arcs) of the arcs
    real(wp), allocatable :: middle(:, :)    !! (2, arcs) of circles about them [m]
    real(wp), allocatable :: radius(:)       !! (arcs) of these [m]
    real(wp), allocatable :: bend_rate(:)    !! (arcs) largest change of the curvature along u [1/m per unit of u]
    real(wp), allocatable :: pace(:)         !! (arcs) largest |dc/du| [m/any]
    real(wp), allocatable :: length(:)       !! (0:arcs) of the curve up to these [m]
    real(wp), allocatable :: angle(:)        !! (0:arcs) of the normal there, without jumps [rad]
    real(wp) :: curvatures(2) = 0.0_wp       !! least and largest one of the profile [1/m]
    real(wp) :: slopes(2) = 0.0_wp           !! of the support p: largest |p'| and |p''| [m]
  contains
    procedure(place_at), deferred :: at
    procedure :: nearest => nearest_of_arcs
    procedure :: support => convex_support
    procedure :: way => way_along
    procedure :: bends => curve_bends
    procedure :: outline => curve_outline
    procedure :: cut
    procedure :: examine
  end type curve_model

  abstract interface
    !> The place at u.
    pure type(curve_place) function place_at(self, u, piece) result(q)
      import :: curve_model, curve_place, wp
      class(curve_model), intent(in) :: self
      real(wp), intent(in) :: u              !! [any]
      real(wp), intent(in) :: piece          !! as of the nearest place [rad]
    end function place_at
  end interface

contains

  !> Cuts the curve at some u, between which it is smooth. Samples are so near that what lies between is within the distance of two.
  subroutine cut(self, u)
    class(curve_model), intent(inout) :: self
    real(wp), intent(in) :: u(0:)            !! ascending, from the beginning to the end [any]
    type(curve_place) :: q
    real(wp) :: c(2, 0:samples), bend(0:samples), speed(0:samples)   ! [m], [1/m], [m/any]
    integer :: i, k
    allocate (self%ends(0:size(u) - 1), self%middle(2, size(u) - 1), self%radius(size(u) - 1))
    allocate (self%bend_rate(size(u) - 1), self%pace(size(u) - 1))
    allocate (self%length(0:size(u) - 1), self%angle(0:size(u) - 1), source=0.0_wp)
    q = self%at(u(0), no_piece)
    self%ends(0) = q
    self%angle(0) = atan2(q%n(2), q%n(1))
    self%curvatures = q%curvature/(1 - q%curvature*self%inset)
    do i = 1, size(u) - 1
      do k = 0, samples
        q = self%at(u(i - 1) + (u(i) - u(i - 1))*k/samples, no_piece)
        c(:, k) = q%c
        bend(k) = q%curvature
        speed(k) = q%speed
        call widen(self, q)
      end do
      self%bend_rate(i) = 2*maxval(abs(bend(1:) - bend(:samples - 1)))*samples/(u(i) - u(i - 1))
      self%pace(i) = 2*maxval(speed)
      self%ends(i) = q
      self%middle(:, i) = 0.5_wp*(maxval(c, 2) + minval(c, 2))
      self%radius(i) = maxval(norm2(c - spread(self%middle(:, i), 2, samples + 1), 1)) &
                       + maxval(norm2(c(:, 1:) - c(:, :samples - 1), 1))
      self%length(i) = self%length(i - 1) + length_between(self, u(i - 1), u(i), no_piece)
      self%angle(i) = self%angle(i - 1) + turned(self%ends(i - 1)%n, q%n)
    end do
  end subroutine cut

  !> Takes a place into the bounds of curvature and support.
  pure subroutine widen(self, q)
    class(curve_model), intent(inout) :: self
    type(curve_place), intent(in) :: q
    associate (bend => q%curvature/(1 - q%curvature*self%inset), p => dot_product(q%c, q%n) - self%inset)
      self%curvatures = [min(self%curvatures(1), bend), max(self%curvatures(2), bend)]
      self%slopes(1) = max(self%slopes(1), abs(dot_product(q%c, turn(q%n))))
      if (bend > 0.0_wp) self%slopes(2) = max(self%slopes(2), abs(1/bend - p))
    end associate
  end subroutine widen

  !> Of its extreme curvatures where a roller touches it; of the support by the turn of a face.
  pure type(profile_bends) function curve_bends(self, radius, flat) result(b)
    class(curve_model), intent(in) :: self
    real(wp), intent(in) :: radius           !! [m]
    logical, intent(in) :: flat
    if (flat) then
      b%lever = maxval(self%slopes)
      if (b%lever > 0.0_wp) b%bend = self%slopes(2)/b%lever**2
    else
      b%bend = maxval(abs(self%curvatures)/max(1 + self%curvatures*radius, half_digits))
    end if
  end function curve_bends

  !> Length of the curve between two places of an arc, by Gauss' rule.
  pure real(wp) function length_between(self, from, to, piece) result(length)   ! [m]
    class(curve_model), intent(in) :: self
    real(wp), intent(in) :: from, to         !! [any]
    real(wp), intent(in) :: piece            !! as of the nearest place [rad]
    type(curve_place) :: q
    integer :: k
    length = 0.0_wp
    do k = 1, size(nodes)
      q = self%at(from + nodes(k)*(to - from), piece)
      length = length + weights(k)*(to - from)*q%speed
    end do
  end function length_between

  !> From one normal to another.
  pure real(wp) function turned(n1, n2)      ! [rad]
    real(wp), intent(in) :: n1(2), n2(2)     !! [-]
    turned = atan2(n1(1)*n2(2) - n1(2)*n2(1), dot_product(n1, n2))
  end function turned

  !> The way up to a place, that beyond an end of an open curve straight on. The curvature's change is a difference of two places.
  pure type(profile_way) function way_along(self, angle, n, piece) result(way)
    class(curve_model), intent(in) :: self
    real(wp), intent(in) :: angle            !! the argument of a law there [rad]
    real(wp), intent(in) :: n(2)             !! outward normal [-]
    real(wp), intent(in) :: piece            !! as of the nearest place [rad]
    type(curve_place) :: q(2)
    real(wp) :: u, v, near(2), bends(2), speed   ! [any], [any], [any], [1/m], of the profile [m/any]
    integer :: k, last
    last = size(self%radius)
    u = self%sense*angle
    associate (whole => self%ends(last)%u)
      v = min(max(u, 0.0_wp), whole)
      if (self%closed) v = modulo(u, whole)
      k = max(1, min(last, count(self%ends%u <= v)))
      way%angle = self%angle(k - 1) + turned(self%ends(k - 1)%n, n)
      way%length = self%length(k - 1) + length_between(self, self%ends(k - 1)%u, v, piece) - self%inset*way%angle
      if (self%closed) way%round = self%length(last) - 2*pi*self%inset
      if (.not. self%closed) way%length = way%length + (u - v)
      if (.not. self%closed .and. abs(u - v) > 0.0_wp) return
      near = v + [-apart, apart]*whole
      if (.not. self%closed) near = min(max(near, 0.0_wp), whole)
      v = near(2) - near(1)
      if (self%closed) near = modulo(near, whole)
      q = [self%at(near(1), piece), self%at(near(2), piece)]
      bends = q%curvature/(1 - q%curvature*self%inset)
      speed = 0.5_wp*sum(q%speed*(1 - q%curvature*self%inset))
      way%bending = (bends(2) - bends(1))/(speed*v)
    end associate
  end function way_along

  !> The nearest place. The distance to a place within an arc is least where (d - c).t falls through zero. Beyond its ends an open
  !> curve is straight.
  pure type(profile_foot) function nearest_of_arcs(self, d, piece) result(foot)
    class(curve_model), intent(in) :: self
    real(wp), intent(in) :: d(2)             !! [m]
    real(wp), intent(in) :: piece            !! on whose continuation the place is [rad]
    type(curve_place) :: best
    real(wp) :: f(0:size(self%radius))       ! (d - c).t at the ends of arcs [m]
    real(wp) :: bound(size(self%radius))     ! no place of the arc is nearer [m]
    real(wp) :: least                        ! distance of the best place so far [m]
    integer :: i, n
    n = size(self%radius)
    f = (d(2) - self%ends%c(2))*self%ends%n(1) - (d(1) - self%ends%c(1))*self%ends%n(2)
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
      call search(self, d, i, self%ends(i - 1), self%ends(i), most_halvings, best, least)
    end do
    if (least >= huge(1.0_wp)) best = self%ends(minloc([(norm2(d - self%ends(i)%c), i=0, n)], 1) - 1)   ! only rounding leaves none
    if (piece < no_piece) best = continued(self, d, 1.0_wp, best%u, piece)
    foot%n = best%n
    foot%distance = dot_product(d - best%c, best%n)
    foot%angle = self%sense*best%u
    foot%advance = self%sense/(best%speed*max(1 + best%curvature*foot%distance, sqrt(tiny(1.0_wp))))
    foot%distance = foot%distance + self%inset
    foot%curvature = best%curvature/(1 - best%curvature*self%inset)
  end function nearest_of_arcs

  !> The nearest place of a part of an arc, if it is nearer than the best so far. Where 1 + kappa D stays positive (d - c).t falls
  !> all along, so that there is at most one. Else the part is halved: inside of a bend several may be nearest.
  pure recursive subroutine search(self, d, i, from, to, halvings, best, least)
    class(curve_model), intent(in) :: self
    real(wp), intent(in) :: d(2)             !! [m]
    integer, intent(in) :: i                 !! number of the arc
    type(curve_place), intent(in) :: from, to
    integer, intent(in) :: halvings          !! that are left
    type(curve_place), intent(inout) :: best
    real(wp), intent(inout) :: least         !! distance of the best one so far [m]
    type(curve_place) :: middle
    real(wp) :: width, far, bend(2), deep(2), change   ! [any], largest distance [m], ranges of kappa [1/m] and of D [m], of D [m]
    width = to%u - from%u
    associate (e0 => d - from%c, e1 => d - to%c, change_of_bend => 0.5_wp*self%bend_rate(i)*width)
      far = min(norm2(e0), norm2(e1)) + self%pace(i)*width
      if (far - 2*self%pace(i)*width >= least) return
      bend = [min(from%curvature, to%curvature) - change_of_bend, max(from%curvature, to%curvature) + change_of_bend]
      change = maxval(abs(bend))*far*self%pace(i)*width          ! dD/ds = kappa (d - c).t
      deep = [dot_product(e0, from%n), dot_product(e1, to%n)]
      deep = [minval(deep) - change, maxval(deep) + change]
      if (halvings == 0 .or. 1 + min(bend(1)*deep(1), bend(1)*deep(2), bend(2)*deep(1), bend(2)*deep(2)) > 0.0_wp) then
        if (dot_product(e0, turn(from%n)) < 0.0_wp .or. dot_product(e1, turn(to%n)) > 0.0_wp) return
        call compare(d, root(self, d, 1.0_wp, from%u, to%u, no_piece), best, least)
        return
      end if
    end associate
    middle = self%at(0.5_wp*(from%u + to%u), no_piece)
    call search(self, d, i, from, middle, halvings - 1, best, least)
    call search(self, d, i, middle, to, halvings - 1, best, least)
  end subroutine search

  !> Keeps a place that is nearer.
  pure subroutine compare(d, other, best, least)
    real(wp), intent(in) :: d(2)             !! [m]
    type(curve_place), intent(in) :: other
    type(curve_place), intent(inout) :: best
    real(wp), intent(inout) :: least         !! distance of the best one so far [m]
    if (norm2(d - other%c) >= least) return
    least = norm2(d - other%c)
    best = other
  end subroutine compare

  !> The place at some length beyond an end.
  pure type(curve_place) function straight(last, length) result(q)
    type(curve_place), intent(in) :: last
    real(wp), intent(in) :: length           !! [m]
    q = last
    q%u = q%u + length
    q%c = q%c + length*turn(q%n)
    q%speed = 1.0_wp
    q%curvature = 0.0_wp
  end function straight

  !> Largest n(alpha).c: n.t falls through zero there.
  pure type(profile_reach) function convex_support(self, alpha, piece) result(reach)
    class(curve_model), intent(in) :: self
    real(wp), intent(in) :: alpha            !! [rad]
    real(wp), intent(in) :: piece            !! [rad]
    real(wp) :: n(2), f(0:size(self%radius)) ! n.t at the ends of arcs [-]
    type(curve_place) :: q
    integer :: k
    n = [cos(alpha), sin(alpha)]
    f = [(dot_product(n, turn(self%ends(k)%n)), k=0, size(self%radius))]
    k = max(1, findloc(f(:size(f) - 2) >= 0.0_wp .and. f(1:) < 0.0_wp, .true., 1))
    q = root(self, n, 0.0_wp, self%ends(k - 1)%u, self%ends(k)%u, no_piece)
    if (piece < no_piece) q = continued(self, n, 0.0_wp, q%u, piece)
    reach%p(0:1) = [dot_product(n, q%c) - self%inset, dot_product(turn(n), q%c)]
    reach%p(2) = 1/q%curvature - self%inset - reach%p(0)
    reach%angle = self%sense*q%u
    reach%advance = self%sense/(q%speed*q%curvature)
  end function convex_support

  !> The place on the continuation of a piece, from that on the curve.
  pure type(curve_place) function continued(self, d, weight, u, piece) result(q)
    class(curve_model), intent(in) :: self
    real(wp), intent(in) :: d(2), weight     !! as of `root` [m] or [-], [-]
    real(wp), intent(in) :: u                !! [any]
    real(wp), intent(in) :: piece            !! [rad]
    real(wp) :: width                        ! of an arc [any]
    width = self%ends(size(self%radius))%u/size(self%radius)
    q = root(self, d, weight, u - width, u + width, piece)
  end function continued

  !> The place in a bracket where e.t falls through zero, e = d - weight c: from which the point d lies along the normal (weight 1),
  !> or whose normal is d (weight 0). Its slope is -speed (weight + curvature e.n).
  pure type(curve_place) function root(self, d, weight, from, to, piece) result(q)
    class(curve_model), intent(in) :: self
    real(wp), intent(in) :: d(2), weight     !! [m] or [-], [-]
    real(wp), intent(in) :: from, to         !! [any]
    real(wp), intent(in) :: piece            !! [rad]
    real(wp) :: low, high, u, next           ! [any]
    real(wp) :: e(2), f, slope               ! [m] or [-], of f [per unit of u]
    integer :: k
    low = from
    high = to
    next = 0.5_wp*(low + high)
    do k = 1, most_trials
      u = next
      q = self%at(u, piece)
      e = d - weight*q%c
      f = dot_product(e, turn(q%n))
      slope = q%speed*(weight + q%curvature*dot_product(e, q%n))
      if (f > 0.0_wp) low = u
      if (f < 0.0_wp) high = u
      next = 0.5_wp*(low + high)
      if (slope > 0.0_wp) then
        if (u + f/slope >= low .and. u + f/slope <= high) next = u + f/slope
      end if
      if (abs(next - u) <= 2*spacing(max(abs(low), abs(high))) .or. abs(f) <= 0.0_wp) return
    end do
  end function root

  !> Some points of each arc.
  pure function curve_outline(self) result(c)
    class(curve_model), intent(in) :: self
    real(wp), allocatable :: c(:, :)         ! (2, points) [m]
    type(curve_place) :: q
    integer :: i, k, each
    each = 1 + (32*samples - 1)/size(self%radius)
    allocate (c(2, 0:each*size(self%radius)))
    do i = 1, size(self%radius)
      do k = 0, each
        q = self%at(self%ends(i - 1)%u + (self%ends(i)%u - self%ends(i - 1)%u)*k/each, no_piece)
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
    real(wp), dimension(0:samples*size(self%radius)) :: u, rho   ! [any], radius of curvature of the curve [m]
    integer :: flaw(0:samples*size(self%radius)), i, k, first, last
    type(curve_place) :: q
    type(profile_foot) :: foot
    do i = 0, size(u) - 1
      k = min(i/samples, size(self%radius) - 1)
      u(i) = self%ends(k)%u + (self%ends(k + 1)%u - self%ends(k)%u)*(i - k*samples)/samples
      q = self%at(u(i), no_piece)
      rho(i) = huge(1.0_wp)
      if (abs(q%curvature) > sqrt(tiny(1.0_wp))) rho(i) = 1/q%curvature
      found%reach = max(found%reach, abs(dot_product(q%c, turn(q%n))))
      flaw(i) = 0
      if (1 - q%curvature*self%inset <= 0.0_wp .or. q%speed <= 0.0_wp) then
        flaw(i) = flaw_undercut
      else if (flat .and. .not. q%curvature > 0.0_wp) then
        flaw(i) = flaw_concave
      else if (1 + q%curvature*(radius - self%inset) <= 0.0_wp) then
        flaw(i) = flaw_hollow
      else
        foot = self%nearest(q%c + (radius - self%inset)*q%n, no_piece)
        if (abs(foot%distance - radius) > half_digits*(norm2(q%c) + radius)) flaw(i) = flaw_double
      end if
    end do
    first = findloc(flaw > 0, .true., 1) - 1
    if (first < 0) then
      found%radius = minval(rho, rho > 0.0_wp) - self%inset
      return
    end if
    found%flaw = flaw(first)
    if (self%closed .and. first == 0 .and. any(flaw == 0)) then                ! the range may go over the beginning
      first = findloc(flaw == 0, .true., 1, back=.true.)
      flaw = cshift(flaw, first)
      u = cshift(u, first)
      rho = cshift(rho, first)
      first = 0
    end if
    last = first
    do while (last < size(u) - 1)
      if (flaw(last + 1) == 0) exit
      last = last + 1
    end do
    found%range = [u(first), u(last)]
    rho = merge(rho, abs(rho), found%flaw == flaw_undercut)
    found%radius = minval(rho, flaw == found%flaw)
  end subroutine examine
end module curve_profile
