!> The acceleration of a marker against another one: the difference of both, global axes.
module relative_sensor
  use kinds, only: wp
  use sensor, only: observation, sensor_model, harmonic_motion
  implicit none (type, external)
  private

  !> The difference of two sensors of one kind.
  type, extends(sensor_model), public :: relative_sensor_model
    class(sensor_model), allocatable :: a, b  !! of the two markers
    integer :: columns = 2                    !! of each of them
  contains
    procedure :: read => read_difference
    procedure :: respond
  end type relative_sensor_model

contains

  !> The one less the other.
  subroutine read_difference(self, at, x)
    class(relative_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! [as the two]
    real(wp) :: a(2), b(2)
    associate (n => self%columns)
      call self%a%read(at, a)
      call self%b%read(at, b)
      x(1:n) = a(1:n) - b(1:n)
    end associate
  end subroutine read_difference

  !> The same of amplitudes.
  subroutine respond(self, at, motion, x)
    class(relative_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    complex(wp), intent(inout) :: x(:)        !! [as the two]
    complex(wp) :: a(2), b(2)
    associate (n => self%columns)
      call self%a%respond(at, motion, a)
      call self%b%respond(at, motion, b)
      x(1:n) = a(1:n) - b(1:n)
    end associate
  end subroutine respond
end module relative_sensor
