!> Slider and prismatic joints and the position drive: rows that measure marker a along a direction fixed in the section
!> of marker b.
module line_joint
  use kinds, only: wp
  use constraint, only: constraint_model, constraint_rows, marker_stiffness
  use history, only: drive_values
  use marker, only: marker_states
  use measures, only: line_curvature, place_along
  implicit none (type, external)
  private

  !> n.(r_a - r_b) = target, n at `direction` from the section of marker b; prismatic: and the relative angle is kept.
  type, extends(constraint_model), public :: line_model
    real(wp) :: direction = 0.0_wp        !! angle of n from section b [rad]
    logical :: fixed = .false.            !! section b is the ground: n never turns
    real(wp) :: normal(2) = 0.0_wp        !! n where it never turns [-]
    logical :: prismatic = .false.
    real(wp) :: angle = 0.0_wp            !! prismatic: angle of section a minus that of section b [rad]
  contains
    procedure :: evaluate => line_rows
    procedure :: geometric => line_second
    procedure :: init_from_deck => line_begin
    procedure :: measure => distance_along
    procedure :: components => line_components
    procedure :: line_turns
    procedure :: release_angle => prismatic_release
    procedure :: acts_on => line_acts_on
  end type line_model

contains

  !> Rows of the joint or drive.
  pure subroutine line_rows(self, t, p, r)
    class(line_model), intent(in) :: self
    real(wp), intent(in) :: t   !! [s]
    type(marker_states), intent(in) :: p
    type(constraint_rows), intent(inout) :: r
    real(wp) :: n(2), d(2), dd(2), h(0:2), om, along
    integer :: i
    i = self%first
    n = self%normal
    if (.not. self%fixed) n = [cos(p%angle(self%ib) + self%direction), sin(p%angle(self%ib) + self%direction)]
    d = p%r(:, self%ia) - p%r(:, self%ib)
    dd = p%v(:, self%ia) - p%v(:, self%ib)
    om = p%rate(self%ib)
    h = 0.0_wp
    if (self%drive) call drive_values(self%target, self%rate, self%origin, t, r%left_limit, h)
    r%na(:, i) = n
    r%nb(:, i) = -n
    r%sa(i) = 0.0_wp
    along = n(1)*d(1) + n(2)*d(2)
    r%sb(i) = n(1)*d(2) - n(2)*d(1)
    r%phi(i) = along - h(0)
    r%phi_t(i) = -h(1)
    r%acceleration_bias(i) = 2*om*(n(1)*dd(2) - n(2)*dd(1)) - om**2*along - h(2)
    if (self%prismatic) call self%hold_angle(i + 1, self%angle, p, r)
  end subroutine line_rows

  !> A prismatic joint becomes a slider.
  subroutine prismatic_release(self, released)
    class(line_model), intent(inout) :: self
    logical, intent(out) :: released
    released = self%prismatic
    self%prismatic = .false.
    self%rows = 1
  end subroutine prismatic_release

  !> lambda n(psi_b).(r_a - r_b): the direction turns with section b.
  pure subroutine line_second(self, p, lambda, k)
    class(line_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: lambda(:)   !! multipliers of all rows [N]
    type(marker_stiffness), intent(inout) :: k
    call line_curvature(p, self%ia, self%ib, self%direction, k%k)
    k%k = lambda(self%first)*k%k
  end subroutine line_second

  !> The direction turns with section b; a line fixed to the ground is straight.
  pure function line_components(self, grounded) result(list)
    class(line_model), intent(in) :: self
    logical, intent(in) :: grounded
    integer, allocatable :: list(:)
    list = [1, 2, 4, 5, 6]
    if (grounded) list = list(:0)
  end function line_components

  !> The line turns with section b, if that is no part of the ground.
  pure logical function line_turns(self) result(yes)
    class(line_model), intent(in) :: self
    yes = .not. self%fixed
  end function line_turns

  !> The line turns with section b; a prismatic joint keeps section a's angle.
  pure function line_acts_on(self) result(yes)
    class(line_model), intent(in) :: self
    logical :: yes(6)
    yes = [.true., .true., self%prismatic, .true., .true., .true.]
  end function line_acts_on

  !> The direction where it never turns.
  subroutine line_begin(self, p)
    class(line_model), intent(inout) :: self
    type(marker_states), intent(in) :: p
    real(wp) :: angle   ! [rad]
    angle = p%angle(self%ib) + self%direction
    self%normal = [cos(angle), sin(angle)]
  end subroutine line_begin

  !> How far marker a lies from b along the direction.
  pure real(wp) function distance_along(self, p) result(x)   ! [m]
    class(line_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp) :: xd, g(6)   ! not asked for [m/s], [-]
    call place_along(p, self%ia, self%ib, self%direction, x, xd, g)
  end function distance_along
end module line_joint
