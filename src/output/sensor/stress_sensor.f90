!> The largest outer-fibre stress of a body, and the element that has it.
module stress_sensor
  use kinds, only: wp
  use section_sensor, only: read_element
  use sensor, only: nonlinear_sensor, observation
  implicit none (type, external)
  private

  !> A body's largest stress.
  type, extends(nonlinear_sensor), public :: stress_sensor_model
  contains
    procedure :: read => read_stress
  end type stress_sensor_model

contains

  !> Over its elements whose sections have a shape.
  subroutine read_stress(self, at, x)
    class(stress_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! [Pa], [-]
    real(wp) :: found(5)
    integer :: e
    x(1:2) = 0.0_wp
    do e = 1, size(at%m%s%bodies(self%marker%body)%elements)
      found(5) = 0.0_wp
      call read_element(at, self%marker%body, e, found)
      if (e == 1 .or. found(5) > x(1)) x(1:2) = [found(5), real(e, wp)]
    end do
  end subroutine read_stress
end module stress_sensor
