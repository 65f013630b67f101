!> Quantities of motion: positions, angles, their rates, distances. Where a body turns, the rates of the linear response contain the
!> turn of its axes.
module quantity_sensor
  use kinds, only: wp
  use quantity, only: quantity_box
  use sensor, only: observation, sensor_model, harmonic_motion, marker_motion, vector_to_global
  implicit none (type, external)
  private

  !> One quantity a column.
  type, extends(sensor_model), public :: quantity_sensor_model
    type(quantity_box), allocatable :: columns(:)
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
        call moves(at, motion, c%ia, place(1:3), rate(1:3))
        call moves(at, motion, c%ib, place(4:6), rate(4:6))
        call c%gradient(at%p, by_place, by_rate)
        x(k) = sum(by_place*place) + sum(by_rate*rate)
      end associate
    end do
  end subroutine respond

  !> Displacement w of a marker and its rate w' + theta' H w, global axes.
  subroutine moves(at, motion, k, place, rate)
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    integer, intent(in) :: k                  !! marker
    complex(wp), intent(out) :: place(3)      !! [m, m, rad]
    complex(wp), intent(out) :: rate(3)       !! [m/s, m/s, rad/s]
    real(wp) :: turning                       ! theta' [rad/s]
    turning = 0.0_wp
    associate (marker => at%markers(k), b => at%markers(k)%body)
      if (b > 0) turning = at%y(at%m%s%nq + at%m%s%qo(b) + 3)
      place = marker_motion(at%m, marker, at%p%rho(:, k), motion%x)
      rate = motion%s*place
      rate(1:2) = rate(1:2) + turning*[-place(2), place(1)]
      place(1:2) = vector_to_global(at%ev, b, place(1:2))
      rate(1:2) = vector_to_global(at%ev, b, rate(1:2))
    end associate
  end subroutine moves
end module quantity_sensor
