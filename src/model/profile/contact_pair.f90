!> The gap between a follower on marker a and a profile on marker b as a measure x: joints hold it at 0, stops keep it above 0. With
!> e = r_a - r_b, N the outward normal at the foot of a roller's centre, T = H N, and w = [T, 0, -T, -N.e]:
!>
!>   x = D(A_b^T e) - radius      g = [N, 0, -N, HN.e]      H = (N frozen in section b) + kappa/(1 + kappa D) w w^T
!>
!> and of a flat face with the normal N at an angle from section a, alpha = psi_a + face - psi_b, z = [0, 0, 1, 0, 0, -1]:
!>
!>   x = N.e - p(alpha)           g = [N, HN.e - p', -N, p']      H = (N frozen in section a) - p'' z z^T
!>
!> (theory.md, section 17).
module contact_pair
  use kinds, only: wp
  use marker, only: marker_states, turn
  use measure, only: measure_course, measure_model, measured
  use profile, only: no_piece, profile_bends, profile_foot, profile_model, profile_reach
  use small_matrices, only: outer
  implicit none (type, external)
  private

  !> A follower and a profile.
  type, extends(measure_model), public :: pair_measure
    class(profile_model), allocatable :: profile
    real(wp) :: radius = 0.0_wp            !! of the roller; 0: an edge, or a flat face [m]
    logical :: flat = .false.              !! the follower is a face
    real(wp) :: face = 0.0_wp              !! its normal, from section a [rad]
    integer :: watcher = 0                 !! number of what watches the corners of its law; 0: there is none
    logical :: by_angle = .false.          !! what it measures is the argument of the law where it touches
  contains
    procedure :: measure => pair_motion
    procedure :: course => pair_course
    procedure :: curvature => pair_curvature
    procedure :: touching
    procedure :: sunk
  end type pair_measure

  !> Where a pair touches, or would.
  type, extends(measured), public :: pair_touch
    real(wp) :: n(2)                       !! outward normal of the profile, global [-]
    integer :: carrier                     !! component of the section that n turns with: 3, 6; 0: none
    real(wp) :: bend                       !! factor of w w^T [1/m] or [m]
    real(wp) :: w(6)                       !! [-], [m]
    real(wp) :: place(2)                   !! of the profile, global [m]
    real(wp) :: convexity                  !! curvature of the profile there [1/m]
    real(wp) :: angle                      !! the argument of a law there [rad]
    real(wp) :: advance                    !! of it by w, the motion along the tangent or the turn of the face [rad/m] or [-]
  end type pair_touch

  real(wp), parameter :: least_turn = 0.1_wp   !! 1 + kappa D of a penetration below which its normal is not to be believed [-]

contains

  !> Whether a roller is so deep in what it touches that it comes near a centre of curvature, where the normal has no direction.
  pure logical function sunk(self, p)
    class(pair_measure), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(pair_touch) :: at
    at = self%touching(p)
    sunk = .not. self%flat .and. at%convexity > 0.0_wp .and. 1 + at%convexity*(at%x + self%radius) <= least_turn
  end function sunk

  !> The gap, its gradient, what its second derivative consists of.
  pure type(pair_touch) function touching(self, p) result(at)
    class(pair_measure), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(profile_foot) :: foot
    type(profile_reach) :: reach
    real(wp) :: e(2), u(2), v(6), c, s, piece
    piece = no_piece
    if (self%watcher > 0 .and. allocated(p%piece)) piece = p%piece(self%watcher)
    e = p%r(:, self%ia) - p%r(:, self%ib)
    if (self%flat) then
      at%n = [cos(p%angle(self%ia) + self%face), sin(p%angle(self%ia) + self%face)]
      reach = self%profile%support(p%angle(self%ia) + self%face - p%angle(self%ib), piece)
      at%x = dot_product(at%n, e) - reach%p(0)
      at%g = [at%n, dot_product(turn(at%n), e) - reach%p(1), -at%n, reach%p(1)]
      at%carrier = 3
      at%bend = -reach%p(2)
      at%w = [0, 0, 1, 0, 0, -1]
      at%place = p%r(:, self%ib) + reach%p(0)*at%n + reach%p(1)*turn(at%n)
      at%convexity = 1/(reach%p(0) + reach%p(2))
      at%angle = reach%angle
      at%advance = reach%advance
    else
      c = cos(p%angle(self%ib))
      s = sin(p%angle(self%ib))
      foot = self%profile%nearest([c*e(1) + s*e(2), c*e(2) - s*e(1)], piece)
      at%n = [c*foot%n(1) - s*foot%n(2), s*foot%n(1) + c*foot%n(2)]
      at%x = foot%distance - self%radius
      at%bend = foot%curvature/max(1 + foot%curvature*foot%distance, least(self, foot))
      at%carrier = 0
      at%g = [at%n, 0.0_wp, -at%n, 0.0_wp]
      at%w = [turn(at%n), 0.0_wp, -turn(at%n), 0.0_wp]
      if (.not. self%profile%round) then
        at%carrier = 6
        at%g(6) = dot_product(turn(at%n), e)
        at%w(6) = -dot_product(at%n, e)
      end if
      at%place = p%r(:, self%ia) - foot%distance*at%n
      at%convexity = foot%curvature
      at%angle = foot%angle
      at%advance = foot%advance
    end if
    v = self%rates(p)
    at%rate = dot_product(at%g, v)
    at%bias = at%bend*dot_product(at%w, v)**2
    if (at%carrier == 0) return
    u = v(1:2) - v(4:5)
    at%bias = at%bias + v(at%carrier)*(2*dot_product(turn(at%n), u) - v(at%carrier)*dot_product(at%n, e))
  end function touching

  !> The least 1 + kappa D with which the normal turns: beyond a centre of curvature it has no meaning, in the middle of a bowl it
  !> turns as half the gap away.
  pure real(wp) function least(self, foot)
    class(pair_measure), intent(in) :: self
    type(profile_foot), intent(in) :: foot
    least = sqrt(tiny(1.0_wp))
    if (self%span > 0.0_wp) least = -0.5_wp*self%span*foot%curvature
  end function least

  !> The gap and its motion, or how far the law has come.
  pure subroutine pair_motion(self, p, now)
    class(pair_measure), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(measured), intent(out) :: now
    type(pair_touch) :: at
    at = self%touching(p)
    now = at%measured
    if (.not. self%by_angle) return
    now%x = at%angle
    now%rate = at%advance*dot_product(at%w, self%rates(p))
  end subroutine pair_motion

  !> Of a roller its place as the profile's section sees it, a circle as the ground does; of a face how far it stands off, and its
  !> turn.
  pure type(measure_course) function pair_course(self, p) result(course)
    class(pair_measure), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(profile_bends) :: bends
    real(wp) :: e(2), u(2), n(2), c, s
    course%turning = self%spin(p)
    course%bend = huge(1.0_wp)
    if (self%by_angle) return
    bends = self%profile%bends(self%radius, self%flat)
    course%bend = bends%bend
    e = p%r(:, self%ia) - p%r(:, self%ib)
    u = p%v(:, self%ia) - p%v(:, self%ib)
    if (self%flat) then
      n = [cos(p%angle(self%ia) + self%face), sin(p%angle(self%ia) + self%face)]
      course%w = [dot_product(n, u) + p%rate(self%ia)*dot_product(turn(n), e), bends%lever*(p%rate(self%ia) - p%rate(self%ib))]
    else if (self%profile%round) then
      course%w = u
    else
      u = u - p%rate(self%ib)*turn(e)
      c = cos(p%angle(self%ib))
      s = sin(p%angle(self%ib))
      course%w = [c*u(1) + s*u(2), c*u(2) - s*u(1)]
    end if
  end function pair_course

  !> The normal turns with a section and about the profile.
  pure subroutine pair_curvature(self, p, h)
    class(pair_measure), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(out) :: h(6, 6)       !! second derivative of x [1/m], [-], [m]
    type(pair_touch) :: at
    real(wp) :: across(6)
    at = self%touching(p)
    h = at%bend*outer(at%w, at%w)
    if (at%carrier == 0) return
    across = [turn(at%n), 0.0_wp, -turn(at%n), 0.0_wp]
    h(:, at%carrier) = h(:, at%carrier) + across
    h(at%carrier, :) = h(at%carrier, :) + across
    h(at%carrier, at%carrier) = h(at%carrier, at%carrier) - dot_product(at%n, p%r(:, self%ia) - p%r(:, self%ib))
  end subroutine pair_curvature
end module contact_pair
