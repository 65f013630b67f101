!> Quantities of motion: scalars between two markers a and b, each with its rate and its derivatives by the motion of the markers.
!> Sensors show them, forces and controllers follow them. A quantity that is measured against nothing has the ground's origin as b.
module quantity
  use kinds, only: wp
  use marker, only: marker_states
  use measures, only: angle_between, circle_curvature, distance_between, line_curvature
  implicit none (type, external)
  private

  !> A quantity x, or its rate.
  type, abstract, public :: quantity_model
    integer :: ia = 0, ib = 0              !! markers a and b in the list whose states it is given
    logical :: rate = .false.              !! its rate is meant
    logical :: angular = .false.           !! it is an angle
    real(wp) :: datum = 0.0_wp             !! what is taken off x: the free length of a spring [m] or [rad]
    logical :: pending = .false.           !! the datum is not known yet: it follows from the assembled markers
  contains
    procedure :: init_from_assembly
    procedure(measure_motion), deferred :: measure
    procedure :: curvature => no_curvature
    procedure :: value
    procedure :: gradient
    procedure :: rounding
    procedure :: components => both_places
  end type quantity_model

  abstract interface
    !> x, its rate and its gradient by x, y, section angle of marker a, then of b.
    pure subroutine measure_motion(self, p, x, xd, g)
      import :: quantity_model, marker_states, wp
      class(quantity_model), intent(in) :: self
      type(marker_states), intent(in) :: p
      real(wp), intent(out) :: x           !! [m] or [rad]
      real(wp), intent(out) :: xd          !! [m/s] or [rad/s]
      real(wp), intent(out) :: g(6)        !! global axes [-], [m]
    end subroutine measure_motion
  end interface

  !> Makes an array of different kinds possible.
  type, public :: quantity_box
    class(quantity_model), allocatable :: item
  end type quantity_box

  !> x, y or section angle of a less that of b, global axes.
  type, extends(quantity_model), public :: difference_quantity
    integer :: component = 1               !! 1: x, 2: y, 3: angle
  contains
    procedure :: measure => difference
    procedure :: components => one_of_each
  end type difference_quantity

  !> Distance between a and b.
  type, extends(quantity_model), public :: distance_quantity
  contains
    procedure :: measure => distance
    procedure :: curvature => distance_curvature
  end type distance_quantity

  !> An elastic coordinate, or what a node sees of several: a is a marker at the origin of a body that they displace along x of the
  !> body (`make_elastic_marker`), b the body's frame.
  type, extends(quantity_model), public :: elastic_quantity
  contains
    procedure :: measure => displacement
    procedure :: curvature => axis_curvature
  end type elastic_quantity

contains

  !> Takes a free length or angle that the deck leaves open from the assembled markers: 0 where they coincide, as a spring does.
  subroutine init_from_assembly(self, p, gap)
    class(quantity_model), intent(inout) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: gap            !! distance up to which markers coincide [m]
    real(wp) :: x, xd, g(6)
    if (.not. self%pending) return
    call self%measure(p, x, xd, g)
    if (self%angular .or. abs(x) > gap) self%datum = x
    self%pending = .false.
  end subroutine init_from_assembly

  !> x less its datum, or the rate of x.
  pure real(wp) function value(self, p)    ! [m, rad] or [m/s, rad/s]
    class(quantity_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp) :: x, xd, g(6)
    call self%measure(p, x, xd, g)
    value = merge(xd, x - self%datum, self%rate)
  end function value

  !> Derivatives of the value by the places (x, y, section angle of a, then of b, global axes) and by their rates. A rate g.v
  !> changes with the places where g does.
  pure subroutine gradient(self, p, by_place, by_rate)
    class(quantity_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(out) :: by_place(6)   !! [-], [m], or [1/s], [m/s]
    real(wp), intent(out) :: by_rate(6)    !! [-], [m]
    real(wp) :: x, xd, h(6, 6)
    call self%measure(p, x, xd, by_place)
    by_rate = 0.0_wp
    if (.not. self%rate) return
    by_rate = by_place
    call self%curvature(p, h)
    by_place = matmul(h, [p%v(:, self%ia), p%rate(self%ia), p%v(:, self%ib), p%rate(self%ib)])
  end subroutine gradient

  !> How large the numbers are of which the value is made: its rounding error is epsilon times that.
  pure real(wp) function rounding(self, p) result(size)   ! [m, rad] or [m/s, rad/s]
    class(quantity_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    if (self%rate .and. self%angular) then
      size = max(abs(p%rate(self%ia)), abs(p%rate(self%ib)))
    else if (self%rate) then
      size = max(maxval(abs(p%v(:, self%ia))), maxval(abs(p%v(:, self%ib))))
    else if (self%angular) then
      size = max(1.0_wp, abs(p%angle(self%ia)), abs(p%angle(self%ib)))
    else
      size = max(maxval(abs(p%r(:, self%ia))), maxval(abs(p%r(:, self%ib))))
    end if
  end function rounding

  !> Components on which x and its rate depend: 1 to 3 of marker a, 4 to 6 of b. Most depend on the positions of both.
  pure function both_places(self) result(list)
    class(quantity_model), intent(in) :: self
    integer, allocatable :: list(:)
    list = [1, 2, 4, 5]
  end function both_places

  !> Most quantities are linear in positions and angles.
  pure subroutine no_curvature(self, p, h)
    class(quantity_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(out) :: h(6, 6)       !! second derivative of x [1/m], [-], [m]
    h = 0.0_wp
  end subroutine no_curvature

  !> One of x, y, angle.
  pure subroutine difference(self, p, x, xd, g)
    class(difference_quantity), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(out) :: x             !! [m] or [rad]
    real(wp), intent(out) :: xd            !! [m/s] or [rad/s]
    real(wp), intent(out) :: g(6)          !! [-]
    associate (c => self%component, a => self%ia, b => self%ib)
      if (c == 3) then
        call angle_between(p, a, b, x, xd, g)
        return
      end if
      x = p%r(c, a) - p%r(c, b)
      xd = p%v(c, a) - p%v(c, b)
      g = 0.0_wp
      g(c) = 1.0_wp
      g(3 + c) = -1.0_wp
    end associate
  end subroutine difference

  !> One component of both markers.
  pure function one_of_each(self) result(list)
    class(difference_quantity), intent(in) :: self
    integer, allocatable :: list(:)
    list = [self%component, 3 + self%component]
  end function one_of_each

  !> |r_a - r_b|, with the direction from b to a.
  pure subroutine distance(self, p, x, xd, g)
    class(distance_quantity), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(out) :: x             !! [m]
    real(wp), intent(out) :: xd            !! [m/s]
    real(wp), intent(out) :: g(6)          !! [-]
    call distance_between(p, self%ia, self%ib, x, xd, g)
  end subroutine distance

  !> Straight where the markers coincide and have no direction.
  pure subroutine distance_curvature(self, p, h)
    class(distance_quantity), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(out) :: h(6, 6)       !! second derivative of x [1/m]
    real(wp) :: x, xd, g(6)
    call self%measure(p, x, xd, g)
    call circle_curvature(g, max(x, sqrt(tiny(1.0_wp))), h)
  end subroutine distance_curvature

  !> The coordinate x of marker a in the body's axes: a difference of global positions would have the rounding of these.
  pure subroutine displacement(self, p, x, xd, g)
    class(elastic_quantity), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(out) :: x             !! [m] or [rad]
    real(wp), intent(out) :: xd            !! [m/s] or [rad/s]
    real(wp), intent(out) :: g(6)          !! [-]
    real(wp) :: n(2)
    n = [cos(p%angle(self%ib)), sin(p%angle(self%ib))]
    x = p%rho(1, self%ia)
    xd = dot_product(n, p%v(:, self%ia) - p%v(:, self%ib))
    g = [n, 0.0_wp, -n, 0.0_wp]
  end subroutine displacement

  !> The axis turns with the body.
  pure subroutine axis_curvature(self, p, h)
    class(elastic_quantity), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(out) :: h(6, 6)       !! [-], [m]
    call line_curvature(p, self%ia, self%ib, 0.0_wp, h)
  end subroutine axis_curvature
end module quantity
