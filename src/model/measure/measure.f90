!> Measures: scalars x between two markers a and b, each with its rate, gradient and second derivative, stated once. A joint holds
!> x = target, a spring pulls with F(x), a stop allows x <= limit, sensors and controllers show x or its rate. What is measured
!> against nothing has the ground's origin as b.
module measure
  use kinds, only: wp
  use marker, only: marker_states
  implicit none (type, external)
  private
  public :: listed

  !> Second derivative of |r_a - r_b|^2/2: what pulls markers together in every direction joins their positions by it.
  real(wp), parameter, public :: together(6, 6) = &
    reshape(real([1, 0, 0, -1, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 0, 0, &
                  -1, 0, 0, 1, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0], wp), [6, 6])

  !> Where `sunk` holds.
  character(*), parameter, public :: sunken = 'in the profile by more than nine tenths of its radius of curvature, where the '// &
    'normal of the contact has no direction'

  !> A measure and its motion at a state of the markers.
  type, public :: measured
    real(wp) :: x                          !! [m] or [rad]
    real(wp) :: rate                       !! [m/s] or [rad/s]
    real(wp) :: g(6)                       !! gradient by x, y, section angle of a, then of b, global axes [-], [m]
    real(wp) :: bias                       !! rates.H.rates: what x'' has beside g times the markers' accelerations [m/s2]
  end type measured

  !> How a state moves the coordinates that x is a function of, in the axes in which x bends least.
  type, public :: measure_course
    real(wp) :: w(2) = 0.0_wp              !! their rates; x changes at most by the sum of their changes [m/s] or [rad/s]
    real(wp) :: turning = 0.0_wp           !! of what may turn these rates [rad/s]
    real(wp) :: bend = 0.0_wp              !! largest second derivative of x by them; huge: not known [1/m] or [1/rad]
  end type measure_course

  !> A measure.
  type, abstract, public :: measure_model
    integer :: ia = 0, ib = 0              !! markers a and b in the list whose states it is given
    integer :: ic = 0                      !! marker of a carrier; 0: none
    logical :: angular = .false.           !! it is an angle
    logical :: straight = .false.          !! its gradient never changes
    logical :: radial = .false.            !! a distance: its direction is that of the line between its markers
    logical :: rate = .false.              !! its rate is meant
    real(wp) :: span = 0.0_wp              !! of a gap that is at most so large, where its direction turns over; 0: none [m]
    real(wp) :: period = 0.0_wp            !! of a way round a closed curve, by which x is not determined; 0: none [m]
    real(wp) :: datum = 0.0_wp             !! what is taken off x: an angle that a joint keeps, a free length [m] or [rad]
    logical :: pending = .false.           !! the datum is not known yet: it follows from the assembled markers
    real(wp) :: carrier = 0.0_wp           !! gradient by the section angle of the carrier, which only joints have [-]
    logical :: acts(6) = .false.           !! whether x depends on x, y, section angle of a, then of b
  contains
    procedure(measure_motion), deferred :: measure
    procedure(course_of), deferred :: course
    procedure :: curvature => no_curvature
    procedure :: sunk => never_sunk
    procedure :: init_from_assembly
    procedure :: in_all_directions
    procedure :: rates
    procedure :: spin
    procedure :: turning
    procedure :: value
    procedure :: gradient
    procedure :: rounding
  end type measure_model

  abstract interface
    !> x and its motion.
    pure subroutine measure_motion(self, p, now)
      import :: measure_model, marker_states, measured
      class(measure_model), intent(in) :: self
      type(marker_states), intent(in) :: p
      type(measured), intent(out) :: now
    end subroutine measure_motion
    !> By what the motion between two states can change x (theory.md, section 11).
    pure type(measure_course) function course_of(self, p)
      import :: measure_model, marker_states, measure_course
      class(measure_model), intent(in) :: self
      type(marker_states), intent(in) :: p
    end function course_of
  end interface

  !> Makes an array of different kinds possible.
  type, public :: measure_box
    class(measure_model), allocatable :: item
  end type measure_box

contains

  !> Numbers of components, 1 to 3 of marker a, 4 to 6 of b.
  pure function listed(yes) result(list)
    logical, intent(in) :: yes(6)
    integer, allocatable :: list(:)
    list = pack([1, 2, 3, 4, 5, 6], yes)
  end function listed

  !> Takes a datum that the deck leaves open from the assembled markers: 0 where they coincide, as a bush does.
  subroutine init_from_assembly(self, p, gap)
    class(measure_model), intent(inout) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: gap            !! distance up to which markers coincide [m]
    type(measured) :: now
    if (.not. self%pending) return
    call self%measure(p, now)
    self%datum = merge(now%x, 0.0_wp, self%angular .or. abs(now%x) > gap)
    self%pending = .false.
  end subroutine init_from_assembly

  !> A distance from 0 on: markers that coincide are apart in whatever direction they move. So is a follower that a bowl surrounds.
  pure logical function in_all_directions(self)
    class(measure_model), intent(in) :: self
    in_all_directions = (self%radial .or. self%span > 0.0_wp) .and. .not. self%datum > 0.0_wp
  end function in_all_directions

  !> Rates of what the gradient is by.
  pure function rates(self, p) result(v)
    class(measure_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp) :: v(6)                       ! [m/s], [rad/s]
    v = [p%v(:, self%ia), p%rate(self%ia), p%v(:, self%ib), p%rate(self%ib)]
  end function rates

  !> The faster of the two sections' rates.
  pure real(wp) function spin(self, p)     ! [rad/s]
    class(measure_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    spin = max(abs(p%rate(self%ia)), abs(p%rate(self%ib)))
  end function spin

  !> H q', how fast the gradient changes.
  pure function turning(self, p) result(g)
    class(measure_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp) :: g(6), h(6, 6)              ! [1/s], [m/s]
    call self%curvature(p, h)
    g = matmul(h, self%rates(p))
  end function turning

  !> x less its datum, or the rate of x.
  pure real(wp) function value(self, p)    ! [m, rad] or [m/s, rad/s]
    class(measure_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(measured) :: now
    call self%measure(p, now)
    value = merge(now%rate, now%x - self%datum, self%rate)
  end function value

  !> Derivatives of the value by the places (x, y, section angle of a, then of b, global axes) and by their rates. A rate g.v
  !> changes with the places where g does.
  pure subroutine gradient(self, p, by_place, by_rate)
    class(measure_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(out) :: by_place(6)   !! [-], [m], or [1/s], [m/s]
    real(wp), intent(out) :: by_rate(6)    !! [-], [m]
    type(measured) :: now
    call self%measure(p, now)
    by_place = now%g
    by_rate = 0.0_wp
    if (.not. self%rate) return
    by_rate = now%g
    by_place = self%turning(p)
  end subroutine gradient

  !> How large the numbers are of which the value is made: its rounding error is epsilon times that.
  pure real(wp) function rounding(self, p) result(size)   ! [m, rad] or [m/s, rad/s]
    class(measure_model), intent(in) :: self
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

  !> Of what is linear in positions and angles.
  pure subroutine no_curvature(self, p, h)
    class(measure_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(out) :: h(6, 6)       !! second derivative of x [1/m], [-], [m]
    h = 0.0_wp
  end subroutine no_curvature

  !> Whether markers are so near a centre of curvature of what they touch that the gradient has no direction.
  pure logical function never_sunk(self, p) result(sunk)
    class(measure_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    sunk = .false.
  end function never_sunk
end module measure
