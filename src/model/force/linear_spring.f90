!> Linear springs: the distance between two markers minus the free length. Without a free length they are bushes, which pull their
!> markers together in whatever direction these move apart.
module linear_spring
  use kinds, only: wp
  use constraint, only: marker_stiffness
  use force_element, only: conditions
  use marker, only: marker_states
  use small_matrices, only: outer
  use spring, only: spring_model
  implicit none (type, external)
  private

  !> One linear spring.
  type, extends(spring_model), public :: linear_model
  contains
    procedure :: deformation => stretch
    procedure :: acts_on => line_acts_on
    procedure :: tangent => line_tangent
    procedure :: components => positions
    procedure :: rate_components => damped_positions
    procedure :: in_all_directions => is_bush
    procedure :: along_line => always
    procedure :: fault => no_direction
  end type linear_model

contains

  !> It acts by forces.
  pure function line_acts_on(self) result(yes)
    class(linear_model), intent(in) :: self
    logical :: yes(6)
    yes = [.true., .true., .false., .true., .true., .false.]
  end function line_acts_on

  !> Stretch, its rate, and the direction from b to a.
  pure subroutine stretch(self, p, d, dd, e)
    class(linear_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(out) :: d             !! [m]
    real(wp), intent(out) :: dd            !! [m/s]
    real(wp), intent(out) :: e(3)          !! [-]
    real(wp) :: length
    e(1:2) = p%r(:, self%ia) - p%r(:, self%ib)
    e(3) = 0.0_wp
    length = sqrt(e(1)**2 + e(2)**2)
    e(1:2) = e(1:2)/max(length, tiny(1.0_wp))
    d = length - self%free
    dd = dot_product(e(1:2), p%v(:, self%ia) - p%v(:, self%ib))
  end subroutine stretch

  !> Stiffness and damping along the spring, force over length across it; in every direction where the markers of a bush coincide.
  pure subroutine line_tangent(self, p, with, part, force, k)
    class(linear_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp), intent(in) :: part(2)        !! factors of stiffness and damping [-]
    real(wp), intent(in) :: force          !! present force [N]
    type(marker_stiffness), intent(inout) :: k
    real(wp) :: g(6), across(6), e(3), d, dd, length, c
    call self%deformation(p, d, dd, e)
    g = [e, -e]
    across = [-e(2), e(1), 0.0_wp, e(2), -e(1), 0.0_wp]
    c = part(2)*self%damping
    if (self%in_all_directions() .and. d <= 64*epsilon(1.0_wp)*maxval(abs(p%r(:, self%ia)))) then
      g = [1.0_wp, 0.0_wp, 0.0_wp, -1.0_wp, 0.0_wp, 0.0_wp]
      across = cshift(g, -1)
      k%k = part(1)*self%stiffness*(outer(g, g) + outer(across, across))
      k%c = c*(outer(g, g) + outer(across, across))
      return
    end if
    length = max(d + self%free, tiny(1.0_wp))
    dd = dot_product(across(1:2), p%v(:, self%ia) - p%v(:, self%ib))
    k%k = part(1)*self%stiffness*outer(g, g) + force/length*outer(across, across) + c*dd/length*outer(g, across)
    k%c = c*outer(g, g)                    ! e turns: the rate along it changes, the last term of k%k
  end subroutine line_tangent

  !> It acts between the positions of both markers.
  pure function positions(self) result(list)
    class(linear_model), intent(in) :: self
    integer, allocatable :: list(:)
    list = [1, 2, 4, 5]
  end function positions

  !> A damper acts on the rates of both positions.
  pure function damped_positions(self) result(list)
    class(linear_model), intent(in) :: self
    integer, allocatable :: list(:)
    list = pack([1, 2, 4, 5], self%damping > 0.0_wp)
  end function damped_positions

  !> A spring without a free length is a bush.
  pure logical function is_bush(self)
    class(linear_model), intent(in) :: self
    is_bush = .not. self%free > 0.0_wp
  end function is_bush

  !> Its line turns with its markers.
  pure logical function always(self)
    class(linear_model), intent(in) :: self
    always = .true.
  end function always

  !> A spring with a free length needs a direction.
  pure function no_direction(self, p, gap) result(text)
    class(linear_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: gap            !! [m]
    character(:), allocatable :: text
    text = ''
    if (abs(self%free) > gap .and. norm2(p%r(:, self%ia) - p%r(:, self%ib)) <= gap) text = 'its markers coincide, so that '// &
      'its force has no direction; expected markers apart, or free_length=0'
  end function no_direction
end module linear_spring
