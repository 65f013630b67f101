!> The row of a rigid stop: while that is closed, what it measures keeps its limit.
module stop_row
  use kinds, only: wp
  use constraint, only: constraint_model, constraint_rows, marker_stiffness
  use marker, only: marker_states
  use friction_law, only: row_stuck, row_slips, row_idle
  use stops, only: stop_idle, stop_model, stop_open, stop_touching
  implicit none (type, external)
  private

  !> weight x, x of the stop; the weight of an angle is the scene's size.
  type, extends(constraint_model), public :: stop_row_model
    class(stop_model), allocatable :: stop     !! with its markers
  contains
    procedure :: evaluate => stop_values
    procedure :: acts_on => stop_acts_on
    procedure :: geometric => stop_second
    procedure :: components => stop_components
    procedure :: holds => closed
    procedure :: relation => relation_of
    procedure :: state_of => state_by
    procedure :: bounds => pushes
    procedure :: place => limit
    procedure :: weight
  end type stop_row_model

contains

  !> The row, whatever the state.
  pure subroutine stop_values(self, t, p, r)
    class(stop_row_model), intent(in) :: self
    real(wp), intent(in) :: t   !! [s]
    type(marker_states), intent(in) :: p
    type(constraint_rows), intent(inout) :: r
    real(wp) :: x, xd, g(6), h(6, 6), rates(6), w
    integer :: i
    i = self%first
    associate (a => self%stop%ia, b => self%stop%ib)
      call self%stop%measure(p, x, xd, g)
      call self%stop%curvature(p, h)
      rates = [p%v(:, a), p%rate(a), p%v(:, b), p%rate(b)]
    end associate
    w = self%weight()
    r%na(:, i) = w*g(1:2)
    r%sa(i) = w*g(3)
    r%nb(:, i) = w*g(4:5)
    r%sb(i) = w*g(6)
    r%phi(i) = w*x
    r%phi_t(i) = 0.0_wp
    r%acceleration_bias(i) = w*dot_product(rates, matmul(h, rates))
  end subroutine stop_values

  !> Factor from the unit of the stop's quantity to metres.
  pure real(wp) function weight(self)          ! [-] or [m]
    class(stop_row_model), intent(in) :: self
    weight = merge(self%size, 1.0_wp, self%stop%angular)
  end function weight

  !> As the stop.
  pure function stop_acts_on(self) result(yes)
    class(stop_row_model), intent(in) :: self
    logical :: yes(6)
    yes = self%stop%acts_on()
  end function stop_acts_on

  !> Curvature of what it measures.
  pure subroutine stop_second(self, p, lambda, k)
    class(stop_row_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: lambda(:)          !! multipliers of all rows [N]
    type(marker_stiffness), intent(inout) :: k
    call self%stop%curvature(p, k%k)
    k%k = lambda(self%first)*self%weight()*k%k
  end subroutine stop_second

  !> An angle is linear, and so is a position along a line that does not turn.
  pure function stop_components(self, grounded) result(list)
    class(stop_row_model), intent(in) :: self
    logical, intent(in) :: grounded
    integer, allocatable :: list(:)
    list = pack([1, 2, 3, 4, 5, 6], self%acts_on())
    if (self%stop%angular .or. (grounded .and. .not. self%stop%in_all_directions())) list = list(:0)
  end function stop_components

  !> While the stop is closed.
  pure logical function closed(self, state) result(yes)
    class(stop_row_model), intent(in) :: self
    integer, intent(in) :: state
    yes = abs(state) == stop_touching
  end function closed

  !> Closed it holds; open it lets its bodies move away from the limit; else it needs no force.
  pure integer function relation_of(self, state, side) result(relation)
    class(stop_row_model), intent(in) :: self
    integer, intent(in) :: state
    integer, intent(in) :: side                !! the limit: 1 upper, -1 lower
    relation = row_idle
    if (abs(state) == stop_touching) relation = row_stuck
    if (state == stop_open) relation = -side*row_slips
  end function relation_of

  !> The state by that.
  pure integer function state_by(self, state, side) result(other)
    class(stop_row_model), intent(in) :: self
    integer, intent(in) :: state               !! how it holds
    integer, intent(in) :: side                !! the limit: 1 upper, -1 lower
    other = side*stop_idle
    if (state == row_stuck) other = side*stop_touching
    if (abs(state) == row_slips) other = stop_open
  end function state_by

  !> It never pulls.
  pure function pushes(self, side, lambda) result(bounds)
    class(stop_row_model), intent(in) :: self
    integer, intent(in) :: side                !! the limit: 1 upper, -1 lower
    real(wp), intent(in) :: lambda(:)          !! not used [N]
    real(wp) :: bounds(2)                      ! [N]
    bounds = merge([0, 1], [-1, 0], side > 0)*huge(1.0_wp)
  end function pushes

  !> The limit.
  pure real(wp) function limit(self, p, side) result(x)   ! [m]
    class(stop_row_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    integer, intent(in) :: side                !! 1 upper, -1 lower
    x = self%weight()*merge(self%stop%upper, self%stop%lower, side > 0)
  end function limit
end module stop_row
