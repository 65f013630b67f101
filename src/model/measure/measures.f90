!> Kinds of measures (`measure`): differences, distances, positions along lines, elastic coordinates, turns that gears join.
module measures
  use kinds, only: wp
  use marker, only: marker_states, turn
  use measure, only: measure_course, measure_model, measured
  use small_matrices, only: outer
  implicit none (type, external)
  private
  public :: difference, distance, line, turns

  !> x, y or section angle of a less that of b.
  type, extends(measure_model) :: difference_measure
    integer :: component = 1               !! 1: x, 2: y, 3: angle
  contains
    procedure :: measure => difference_motion
    procedure :: course => difference_course
  end type difference_measure

  !> (angle_a - angle_c) - ratio (angle_b - angle_c): turns of a and b from a carrier c, as gears join them.
  type, extends(measure_model) :: turns_measure
    real(wp) :: ratio = 1.0_wp             !! turns of a for one of b [-]
  contains
    procedure :: measure => turns_motion
    procedure :: course => turns_course
  end type turns_measure

  !> |r_a - r_b|.
  type, extends(measure_model) :: distance_measure
    real(wp) :: least = sqrt(tiny(1.0_wp)) !! nearer than that its direction turns no faster [m]
    logical :: along_x = .false.           !! where the markers coincide its direction is x; else it has none there
  contains
    procedure :: measure => distance_motion
    procedure :: course => distance_course
    procedure :: curvature => circle_curvature
  end type distance_measure

  !> n.(r_a - r_b), n at an angle from section b: the position of a along a line that turns with b.
  type, extends(measure_model) :: line_measure
    real(wp) :: direction = 0.0_wp         !! of n from section b [rad]
    real(wp) :: normal(2) = [1.0_wp, 0.0_wp]   !! n where b is on the ground [-]
  contains
    procedure :: measure => line_motion
    procedure :: course => line_course
    procedure :: curvature => line_curvature
  end type line_measure

  !> An elastic coordinate, or what a node sees of several: a is a marker at the origin of a body that they displace along x of the
  !> body (`elastic_marker`), b the body's frame.
  type, extends(line_measure), public :: elastic_measure
  contains
    procedure :: measure => elastic_motion
    procedure :: course => elastic_course
  end type elastic_measure

contains

  !> x, y or section angle of a less that of b.
  pure type(difference_measure) function difference(component)
    integer, intent(in) :: component       !! 1: x, 2: y, 3: angle
    difference%component = component
    difference%angular = component == 3
    difference%straight = .true.
    difference%acts([component, 3 + component]) = .true.
  end function difference

  !> What a gear holds, a set of two planetary wheels with a carrier.
  pure type(turns_measure) function turns(ratio)
    real(wp), intent(in) :: ratio          !! turns of a for one of b, both from the carrier [-]
    turns%ratio = ratio
    turns%carrier = ratio - 1.0_wp
    turns%angular = .true.
    turns%straight = .true.
    turns%acts([3, 6]) = .true.
  end function turns

  !> |r_a - r_b|, of a pin in a hole with its radial gap: there it has a direction wherever the pin is.
  pure type(distance_measure) function distance(gap)
    real(wp), intent(in), optional :: gap  !! [m]
    distance%radial = .true.
    distance%acts([1, 2, 4, 5]) = .true.
    distance%along_x = present(gap)
    if (present(gap)) distance%least = 0.5_wp*gap
  end function distance

  !> The position of a along a line.
  pure type(line_measure) function line(direction, fixed)
    real(wp), intent(in) :: direction      !! from section b [rad]
    logical, intent(in) :: fixed           !! b is on the ground, whose sections never turn
    line%direction = direction
    line%normal = [cos(direction), sin(direction)]
    line%straight = fixed
    line%acts = [.true., .true., .false., .true., .true., .true.]
  end function line

  !> One of x, y, angle.
  pure subroutine difference_motion(self, p, now)
    class(difference_measure), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(measured), intent(out) :: now
    now%g = 0.0_wp
    now%g(self%component) = 1.0_wp
    now%g(3 + self%component) = -1.0_wp
    now%bias = 0.0_wp
    associate (c => self%component, a => self%ia, b => self%ib)
      if (c == 3) then
        now%x = p%angle(a) - p%angle(b)
        now%rate = p%rate(a) - p%rate(b)
      else
        now%x = p%r(c, a) - p%r(c, b)
        now%rate = p%v(c, a) - p%v(c, b)
      end if
    end associate
  end subroutine difference_motion

  !> Itself.
  pure type(measure_course) function difference_course(self, p) result(course)
    class(difference_measure), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(measured) :: now
    call self%measure(p, now)
    course%w(1) = now%rate
    if (.not. self%angular) course%turning = self%spin(p)
  end function difference_course

  !> Both turns from the carrier.
  pure subroutine turns_motion(self, p, now)
    class(turns_measure), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(measured), intent(out) :: now
    associate (a => self%ia, b => self%ib, c => self%ic)
      now%x = (p%angle(a) - p%angle(c)) - self%ratio*(p%angle(b) - p%angle(c))
      now%rate = (p%rate(a) - p%rate(c)) - self%ratio*(p%rate(b) - p%rate(c))
    end associate
    now%g = [0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp, 0.0_wp, -self%ratio]
    now%bias = 0.0_wp
  end subroutine turns_motion

  !> Itself.
  pure type(measure_course) function turns_course(self, p) result(course)
    class(turns_measure), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(measured) :: now
    call self%measure(p, now)
    course%w(1) = now%rate
  end function turns_course

  !> |r_a - r_b|, with the direction from b to a.
  pure subroutine distance_motion(self, p, now)
    class(distance_measure), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(measured), intent(out) :: now
    real(wp) :: e(2), u(2)                 ! direction [-], relative velocity [m/s]
    e = p%r(:, self%ia) - p%r(:, self%ib)
    u = p%v(:, self%ia) - p%v(:, self%ib)
    now%x = sqrt(e(1)**2 + e(2)**2)
    if (now%x > 0.0_wp) then
      e = e/now%x
    else
      e = [merge(1.0_wp, 0.0_wp, self%along_x), 0.0_wp]
    end if
    now%rate = e(1)*u(1) + e(2)*u(2)
    now%g = [e, 0.0_wp, -e, 0.0_wp]
    now%bias = (e(1)*u(2) - e(2)*u(1))**2/max(now%x, self%least)
  end subroutine distance_motion

  !> The relative position.
  pure type(measure_course) function distance_course(self, p) result(course)
    class(distance_measure), intent(in) :: self
    type(marker_states), intent(in) :: p
    course%w = p%v(:, self%ia) - p%v(:, self%ib)
    course%turning = self%spin(p)
    course%bend = 1/max(norm2(p%r(:, self%ia) - p%r(:, self%ib)), 2*self%least)   ! of a clearance's root: one over the gap
  end function distance_course

  !> The direction turns, 1/x across it.
  pure subroutine circle_curvature(self, p, h)
    class(distance_measure), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(out) :: h(6, 6)       !! second derivative of x [1/m]
    type(measured) :: now
    real(wp) :: across(6)
    call self%measure(p, now)
    across = [-now%g(2), now%g(1), 0.0_wp, now%g(2), -now%g(1), 0.0_wp]
    h = outer(across, across/max(now%x, self%least))
  end subroutine circle_curvature

  !> n.(r_a - r_b).
  pure subroutine line_motion(self, p, now)
    class(line_measure), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(measured), intent(out) :: now
    real(wp) :: n(2), d(2), u(2)           ! [-], [m], [m/s]
    n = self%normal
    if (.not. self%straight) n = [cos(p%angle(self%ib) + self%direction), sin(p%angle(self%ib) + self%direction)]
    d = p%r(:, self%ia) - p%r(:, self%ib)
    u = p%v(:, self%ia) - p%v(:, self%ib)
    associate (turning => p%rate(self%ib))
      now%x = n(1)*d(1) + n(2)*d(2)
      now%g = [n, 0.0_wp, -n, n(1)*d(2) - n(2)*d(1)]
      now%rate = n(1)*u(1) + n(2)*u(2) + now%g(6)*turning
      now%bias = 2*turning*(n(1)*u(2) - n(2)*u(1)) - turning**2*now%x
    end associate
  end subroutine line_motion

  !> Itself.
  pure type(measure_course) function line_course(self, p) result(course)
    class(line_measure), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(measured) :: now
    call self%measure(p, now)
    course%w(1) = now%rate
    course%turning = self%spin(p)
  end function line_course

  !> The line turns with section b.
  pure subroutine line_curvature(self, p, h)
    class(line_measure), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(out) :: h(6, 6)       !! second derivative of x [-], [m]
    real(wp) :: n(2), angle
    angle = p%angle(self%ib) + self%direction
    n = [cos(angle), sin(angle)]
    h = 0.0_wp
    h(1:2, 6) = turn(n)
    h(4:5, 6) = -turn(n)
    h(6, 1:5) = h(1:5, 6)
    h(6, 6) = -dot_product(n, p%r(:, self%ia) - p%r(:, self%ib))
  end subroutine line_curvature

  !> The coordinate x of marker a in the body's axes: a difference of global positions would have the rounding of these.
  pure subroutine elastic_motion(self, p, now)
    class(elastic_measure), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(measured), intent(out) :: now
    call self%line_measure%measure(p, now)
    now%x = p%rho(1, self%ia)
    now%rate = now%rate - now%g(6)*p%rate(self%ib)   ! g(6) is rounding: a is displaced along n
    now%g(6) = 0.0_wp
  end subroutine elastic_motion

  !> Itself, which no motion of the body turns.
  pure type(measure_course) function elastic_course(self, p) result(course)
    class(elastic_measure), intent(in) :: self
    type(marker_states), intent(in) :: p
    course = self%line_measure%course(p)
    course%turning = 0.0_wp
  end function elastic_course
end module measures
