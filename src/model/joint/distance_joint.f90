!> Distance joint: two markers stay a given length apart, a massless rigid link.
module distance_joint
  use kinds, only: wp
  use constraint, only: constraint_model, constraint_rows, marker_stiffness
  use marker, only: marker_states
  use measures, only: circle_curvature, distance_between
  implicit none (type, external)
  private

  !> |r_a - r_b| = length.
  type, extends(constraint_model), public :: distance_model
    real(wp) :: length = 0.0_wp           !! taken from the assembled positions while that is pending [m]
  contains
    procedure :: evaluate => distance_rows
    procedure :: acts_on => distance_acts_on
    procedure :: geometric => distance_second
    procedure :: init_from_deck => distance_begin
    procedure :: components => distance_components
    procedure :: fault => distance_fault
    procedure :: init_from_assembly => distance_settle
  end type distance_model

contains

  !> The row.
  pure subroutine distance_rows(self, t, p, r)
    class(distance_model), intent(in) :: self
    real(wp), intent(in) :: t   !! [s]
    type(marker_states), intent(in) :: p
    type(constraint_rows), intent(inout) :: r
    real(wp) :: d(2), dd(2), e(2), l
    integer :: i
    i = self%first
    d = p%r(:, self%ia) - p%r(:, self%ib)
    dd = p%v(:, self%ia) - p%v(:, self%ib)
    l = max(sqrt(d(1)**2 + d(2)**2), tiny(1.0_wp))
    e = d/l
    r%na(:, i) = e
    r%nb(:, i) = -e
    r%phi(i) = l - self%length
    r%acceleration_bias(i) = (dot_product(dd, dd) - dot_product(e, dd)**2)/l
  end subroutine distance_rows

  !> It acts on positions alone.
  pure function distance_acts_on(self) result(yes)
    class(distance_model), intent(in) :: self
    logical :: yes(6)
    yes = [.true., .true., .false., .true., .true., .false.]
  end function distance_acts_on

  !> lambda |r_a - r_b|: the link turns.
  pure subroutine distance_second(self, p, lambda, k)
    class(distance_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: lambda(:)   !! multipliers of all rows [N]
    type(marker_stiffness), intent(inout) :: k
    real(wp) :: x, xd, g(6)   ! distance [m], its rate [m/s] and gradient [-]
    call distance_between(p, self%ia, self%ib, x, xd, g)
    call circle_curvature(g, max(x, tiny(1.0_wp)), k%k)
    k%k = lambda(self%first)*k%k
  end subroutine distance_second

  !> A length is not linear in positions.
  pure function distance_components(self, grounded) result(list)
    class(distance_model), intent(in) :: self
    logical, intent(in) :: grounded
    integer, allocatable :: list(:)
    list = [1, 2, 4, 5]
  end function distance_components

  !> A link without a length has no direction.
  pure function distance_fault(self, gap) result(text)
    class(distance_model), intent(in) :: self
    real(wp), intent(in) :: gap           !! [m]
    character(:), allocatable :: text
    text = ''
    if (self%length <= gap) text = 'its markers coincide, so that the link between them has no length; expected two markers '// &
      'apart, or type=''revolute'''
  end function distance_fault

  !> The deck's own distance, for messages while the length is pending.
  subroutine distance_begin(self, p)
    class(distance_model), intent(inout) :: self
    type(marker_states), intent(in) :: p
    if (self%pending) self%length = norm2(p%r(:, self%ia) - p%r(:, self%ib))
  end subroutine distance_begin

  !> Takes the assembled distance as the length.
  subroutine distance_settle(self, p)
    class(distance_model), intent(inout) :: self
    type(marker_states), intent(in) :: p
    call self%init_from_deck(p)
    self%pending = .false.
  end subroutine distance_settle
end module distance_joint
