!> The largest outer-fibre stress of a body, and its place: the element and its node. Within an element the axial force is constant
!> and the moment linear, so that the stress is largest at one of its ends.
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
    real(wp), intent(inout) :: x(:)           !! [Pa], [-], [-]
    real(wp) :: found(5)
    integer :: e
    x(1:3) = 0.0_wp
    associate (body => at%m%s%bodies(self%marker%body))
      do e = 1, size(body%elements)
        found(5) = 0.0_wp
        call read_element(at, self%marker%body, e, found)
        if (e > 1 .and. .not. found(5) > x(1)) cycle
        x(1:3) = [found(5), real([e, body%en(merge(1, 2, abs(found(3)) >= abs(found(4))), e)], wp)]
      end do
    end associate
  end subroutine read_stress
end module stress_sensor
