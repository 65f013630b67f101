!> Torques on a frame or a section.
module torque
  use kinds, only: wp
  use force_element, only: conditions
  use load, only: load_model
  use marker, only: marker_states
  implicit none (type, external)
  private

  !> A torque.
  type, extends(load_model), public :: torque_model
    real(wp) :: moment = 0.0_wp            !! [N m]
  contains
    procedure :: unit_wrench
    procedure :: acts_on
  end type torque_model

contains

  !> It acts by a moment on its marker.
  pure function acts_on(self) result(yes)
    class(torque_model), intent(in) :: self
    logical :: yes(6)
    yes = [.false., .false., .true., .false., .false., .false.]
  end function acts_on

  !> The wrench: the moment alone.
  pure function unit_wrench(self, p, with) result(w)
    class(torque_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp) :: w(3)                       !! [N, N m]
    w = [0.0_wp, 0.0_wp, self%moment]
  end function unit_wrench
end module torque
