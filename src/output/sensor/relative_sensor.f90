!> What a marker does as seen from another one: differences of positions, angles and their derivatives, global axes, or the
!> distance between two points.
module relative_sensor
  use kinds, only: wp
  use sensor, only: observation, sensor_model, harmonic_motion
  implicit none (type, external)
  private

  !> The difference of two sensors of one kind, or its length.
  type, extends(sensor_model), public :: relative_sensor_model
    class(sensor_model), allocatable :: a, b  !! of the two markers
    integer :: columns = 2                    !! of each of them
    logical :: distance = .false.             !! the length of the difference
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
      if (self%distance) then
        x(1) = norm2(a - b)
      else
        x(1:n) = a(1:n) - b(1:n)
      end if
    end associate
  end subroutine read_difference

  !> The same of amplitudes; of a distance their part along the present line between the points.
  subroutine respond(self, at, motion, x)
    class(relative_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    complex(wp), intent(inout) :: x(:)        !! [as the two]
    complex(wp) :: a(2), b(2)
    real(wp) :: line(2)                       ! between the points [m]
    associate (n => self%columns)
      call self%a%respond(at, motion, a)
      call self%b%respond(at, motion, b)
      if (self%distance) then
        line = at%p%r(:, self%a%number) - at%p%r(:, self%b%number)
        x(1) = 0.0_wp
        if (norm2(line) > 0.0_wp) x(1) = sum(line/norm2(line)*(a - b))
      else
        x(1:n) = a(1:n) - b(1:n)
      end if
    end associate
  end subroutine respond
end module relative_sensor
