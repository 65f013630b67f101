!> An elastic coordinate of a body with its rate and acceleration.
module coordinate_sensor
  use kinds, only: wp
  use mechanism, only: mechanism_model
  use sensor, only: observation, sensor_model, harmonic_motion, suffix_length
  implicit none (type, external)
  private

  !> One coordinate.
  type, extends(sensor_model), public :: coordinate_sensor_model
    integer :: index = 0                      !! number of the coordinate of the body
  contains
    procedure :: columns
    procedure :: read => read_coordinate
    procedure :: respond
  end type coordinate_sensor_model

contains

  !> Metres, radians, or modal.
  subroutine columns(self, m, list)
    class(coordinate_sensor_model), intent(in) :: self
    type(mechanism_model), intent(in) :: m
    character(suffix_length), allocatable, intent(out) :: list(:)
    character(:), allocatable :: unit
    associate (b => m%s%bodies(self%marker%body))
      unit = 'm'
      if (b%basis%rotation(self%index)) unit = 'rad'
      if (b%basis%reduced_from > 0) unit = 'kg^.5*m'
    end associate
    list = [character(suffix_length) :: '.q['//unit//']', '.qd['//unit//'/s]', '.qdd['//unit//'/s2]']
  end subroutine columns

  !> From the state.
  subroutine read_coordinate(self, at, x)
    class(coordinate_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! [m, rad] and per second
    associate (i => at%m%s%qo(self%marker%body) + 3 + self%index)
      x(1:3) = [at%y(i), at%y(at%m%s%nq + i), at%ev%a(i)]
    end associate
  end subroutine read_coordinate

  !> From the unknowns.
  subroutine respond(self, at, motion, x)
    class(coordinate_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    complex(wp), intent(inout) :: x(:)        !! [m, rad] and per second
    x(1:3) = motion%x(at%m%s%qo(self%marker%body) + 3 + self%index)*motion%s**[0, 1, 2]
  end subroutine respond
end module coordinate_sensor
