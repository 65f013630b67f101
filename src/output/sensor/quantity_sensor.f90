!> Quantities of motion: positions, angles, their rates, distances. Where a body turns, the rates of the linear response contain the
!> turn of its axes.
module quantity_sensor
  use kinds, only: wp
  use measure, only: measure_box
  use sensor, only: observation, sensor_model, harmonic_motion, marker_moves
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
    complex(wp) :: place(6), rate(6)          ! of both markers [m, rad], [m/s, rad/s]
    real(wp) :: by_place(6), by_rate(6)
    integer :: k
    do k = 1, size(self%columns)
      associate (c => self%columns(k)%item)
        call marker_moves(at, motion, at%markers(c%ia), at%p, c%ia, place(1:3), rate(1:3))
        call marker_moves(at, motion, at%markers(c%ib), at%p, c%ib, place(4:6), rate(4:6))
        call c%gradient(at%p, by_place, by_rate)
        x(k) = sum(by_place*place) + sum(by_rate*rate)
      end associate
    end do
  end subroutine respond
end module quantity_sensor
