!> Torques about a centre that is fixed in space: a force across the line from it to the marker, moment over distance.
module central_torque
  use kinds, only: wp
  use force_element, only: conditions
  use marker, only: marker_states, turn
  use torque, only: torque_model
  implicit none (type, external)
  private

  !> A torque about a centre.
  type, extends(torque_model), public :: central_torque_model
    real(wp) :: centre(2) = 0.0_wp         !! global [m]
  contains
    procedure :: unit_wrench
    procedure :: acts_on
    procedure :: unit_tangent
    procedure :: components
    procedure :: fault
  end type central_torque_model

contains

  !> It acts by a force; the arm makes the torque.
  pure function acts_on(self) result(yes)
    class(central_torque_model), intent(in) :: self
    logical :: yes(6)
    yes = [.true., .true., .false., .false., .false., .false.]
  end function acts_on

  !> The wrench: a force across the line to the centre.
  pure function unit_wrench(self, p, with) result(w)
    class(central_torque_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp) :: w(3), arm(2)               !! [N, N m]
    arm = p%r(:, self%ia) - self%centre
    w = [self%moment*turn(arm)/max(dot_product(arm, arm), tiny(1.0_wp)), 0.0_wp]
  end function unit_wrench

  !> The force turns and changes with the arm.
  pure function unit_tangent(self, p, with) result(k)
    class(central_torque_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp) :: k(3, 3), d(2), n2          !! [N/m, N]
    d = p%r(:, self%ia) - self%centre
    n2 = max(dot_product(d, d), sqrt(tiny(1.0_wp)))         ! its inverse times a moment stays a number
    k = 0.0_wp
    k(1:2, 1) = -self%moment*([0.0_wp, 1.0_wp]/n2 - 2*turn(d)*(d(1)/n2)/n2)
    k(1:2, 2) = -self%moment*([-1.0_wp, 0.0_wp]/n2 - 2*turn(d)*(d(2)/n2)/n2)
  end function unit_tangent

  !> Its tangent depends on the position.
  pure function components(self) result(list)
    class(central_torque_model), intent(in) :: self
    integer, allocatable :: list(:)
    list = [1, 2]
  end function components

  !> A fault: the marker stands at the centre, so that there is no arm.
  pure function fault(self, p, gap) result(text)
    class(central_torque_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: gap            !! distance up to which markers coincide [m]
    character(:), allocatable :: text
    text = ''
    if (norm2(p%r(:, self%ia) - self%centre) <= gap) text = 'its marker is at the centre, where the torque has no arm; '// &
      'expected them apart, or type=''torque'''
  end function fault
end module central_torque
