!> How far a follower has slid along a profile, a measure tau whose gradient gives the slip: friction of pairs holds it or acts
!> along it. There is such a function, as rolling in the plane has one. For a roller of radius r, with the profile's length s up to
!> the foot and the angle alpha of its normal there (T, w, D and kappa as in `contact_pair`, z = [0, 0, 1, 0, 0, -1]),
!>
!>   tau = s + r alpha - r (psi_a - psi_b)       g = phi w - r z          phi = (1 + kappa r)/(1 + kappa D)
!>
!> where it touches, phi = 1 and the rate of tau is that of one surface on the other. For a flat face with the support p
!>
!>   tau = T.e + s - p'                          g = [T, p - N.e, -T, -p]
!>
!> (theory.md, section 17).
module pair_slip_measure
  use kinds, only: wp, pi
  use contact_pair, only: pair_measure, pair_touch
  use marker, only: marker_states, turn
  use measure, only: measure_course, measured
  use profile, only: circle_model, no_piece, profile_way
  use small_matrices, only: outer
  implicit none (type, external)
  private
  public :: pin_in_hole

  !> The slip of a pair.
  type, extends(pair_measure), public :: pair_slip
  contains
    procedure :: measure => slip_motion
    procedure :: course => slip_course
    procedure :: curvature => slip_curvature
    procedure :: go_round
    procedure, private :: slipping
  end type pair_slip

  !> Where it slips.
  type :: slip_place
    type(pair_touch) :: at
    type(profile_way) :: way
    real(wp) :: e(2)                       !! r_a - r_b [m]
    real(wp) :: w(6)                       !! [-], [m]
    real(wp) :: phi                        !! [-]
  end type slip_place

  real(wp), parameter :: z(6) = [0, 0, 1, 0, 0, -1]   !! [-]

contains

  !> The pair of a pin in its hole.
  type(pair_measure) function pin_in_hole(pin, gap) result(pair)
    real(wp), intent(in) :: pin            !! its radius [m]
    real(wp), intent(in) :: gap            !! radius of the hole less that of the pin [m]
    type(circle_model) :: hole
    hole%radius = -(pin + gap)
    hole%round = .true.
    allocate (pair%profile, source=hole)
    pair%radius = pin
    pair%span = gap
  end function pin_in_hole

  !> What it depends on, and how far it goes once round the profile.
  subroutine go_round(self)
    class(pair_slip), intent(inout) :: self
    type(profile_way) :: way
    way = self%profile%way(0.0_wp, [1.0_wp, 0.0_wp], no_piece)
    self%period = abs(way%round)
    self%acts = .true.                     ! both sections carry surfaces
    self%acts(3) = self%flat .or. self%radius > 0.0_wp
    if (self%period > 0.0_wp .and. .not. self%flat) self%period = abs(way%round + 2*pi*self%radius)
  end subroutine go_round

  !> The foot, the way up to it, the factor of a roller.
  pure type(slip_place) function slipping(self, p) result(x)
    class(pair_slip), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp) :: c, s, piece
    piece = no_piece
    if (self%watcher > 0 .and. allocated(p%piece)) piece = p%piece(self%watcher)
    x%at = self%touching(p)
    x%e = p%r(:, self%ia) - p%r(:, self%ib)
    c = cos(p%angle(self%ib))
    s = sin(p%angle(self%ib))
    associate (at => x%at, n => x%at%n)
      x%way = self%profile%way(at%angle, [c*n(1) + s*n(2), c*n(2) - s*n(1)], piece)
      x%w = [turn(n), 0.0_wp, -turn(n), -dot_product(n, x%e)]
      x%phi = 1.0_wp
      if (abs(at%convexity) > 0.0_wp) x%phi = (1 + at%convexity*self%radius)*at%bend/at%convexity
    end associate
  end function slipping

  !> tau and its motion.
  pure subroutine slip_motion(self, p, now)
    class(pair_slip), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(measured), intent(out) :: now
    type(slip_place) :: x
    real(wp) :: v(6)
    x = self%slipping(p)
    if (self%flat) then
      now%x = x%way%length + x%at%g(3)
      now%g = x%w
      now%g(3) = -x%at%x
      now%g(6) = x%w(6) + x%at%x
    else
      now%x = x%way%length + self%radius*(x%way%angle - p%angle(self%ia) + p%angle(self%ib))
      now%g = x%phi*x%w - self%radius*z
    end if
    v = self%rates(p)
    now%rate = dot_product(now%g, v)
    now%bias = dot_product(v, matmul(bent(self, x), v))
  end subroutine slip_motion

  !> Nothing bounds how it bends.
  pure type(measure_course) function slip_course(self, p) result(course)
    class(pair_slip), intent(in) :: self
    type(marker_states), intent(in) :: p
    course%turning = self%spin(p)
    course%bend = huge(1.0_wp)
  end function slip_course

  !> As the gradient turns.
  pure subroutine slip_curvature(self, p, h)
    class(pair_slip), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(out) :: h(6, 6)       !! second derivative of tau [1/m], [-], [m]
    h = bent(self, self%slipping(p))
  end subroutine slip_curvature

  !> With m = [N, 0, -N, 0], the unit vector i of the section with which N turns, o = m i' + i m' + (T.e) i i' and g = m + (T.e) i
  !>
  !>   p' z z' - o,  of a roller  -phi (kappa/(1 + kappa D) (g w' + w g') + o) - x phi^3 kappa'/(1 + kappa r)^3 w w'
  pure function bent(self, x) result(h)
    class(pair_slip), intent(in) :: self
    type(slip_place), intent(in) :: x
    real(wp) :: h(6, 6)                    ! [1/m], [-], [m]
    real(wp) :: m(6), g(6), across         ! [-], [-] and [m], [m]
    integer :: i
    i = merge(3, 6, self%flat)
    associate (at => x%at)
      m = [at%n, 0.0_wp, -at%n, 0.0_wp]
      across = dot_product(turn(at%n), x%e)
      h = 0.0_wp
      h(:, i) = -m
      h(i, :) = -m
      h(i, i) = -across
      if (self%flat) then
        h = h + (across - at%g(3))*outer(z, z)
      else
        g = m
        g(6) = across
        h = x%phi*(h - at%bend*(outer(g, x%w) + outer(x%w, g))) &
            - at%x*(x%phi/(1 + at%convexity*self%radius))**3*x%way%bending*outer(x%w, x%w)
      end if
    end associate
  end function bent
end module pair_slip_measure
