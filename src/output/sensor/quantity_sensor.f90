!> Quantities of motion: positions, angles, their rates, distances. Where a body turns, the rates of the linear response contain the
!> turn of its axes.
module quantity_sensor
  use kinds, only: wp
  use measure, only: measure_box
  use sensor, only: observation, sensor_model, harmonic_motion, quantity_amplitude
  implicit none (type, external)
  private

  !> One quantity a column.
  type, extends(sensor_model), public :: quantity_sensor_model
    type(measure_box), allocatable :: columns(:)
  contains
    procedure :: read => read_quantities
    procedure :: respond
  end type quantity_sensor_model

contains

  !> Their values.
  subroutine read_quantities(self, at, x)
    class(quantity_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! [m, rad] or [m/s, rad/s]
    integer :: k
    do k = 1, size(self%columns)
      x(k) = self%columns(k)%item%value(at%p)
    end do
  end subroutine read_quantities

  !> Their gradients along the motions of the markers.
  subroutine respond(self, at, motion, x)
    class(quantity_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    complex(wp), intent(inout) :: x(:)        !! [m, rad] or [m/s, rad/s]
    integer :: k
    do k = 1, size(self%columns)
      x(k) = quantity_amplitude(at, motion, self%columns(k)%item, at%markers, at%p)
    end do
  end subroutine respond
end module quantity_sensor
