!> Work of a drive, force, spring or joint since the start of the transient: the integral of what a power sensor shows, by the
!> method that integrates the motion.
module work_sensor
  use kinds, only: wp
  use sensor, only: nonlinear_sensor, observation
  implicit none (type, external)
  private
  public :: integrated

  !> A work.
  type, extends(nonlinear_sensor), public :: work_sensor_model
    integer :: integral = 0                   !! its number among the powers that the state integrates for sensors
  contains
    procedure :: read => read_work
  end type work_sensor_model

contains

  !> Of the state.
  subroutine read_work(self, at, x)
    class(work_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! [J]
    x(1) = integrated(at, self%integral)
  end subroutine read_work

  !> One of the integrals at the end of the state.
  pure real(wp) function integrated(at, k) result(energy)   ! [J]
    type(observation), intent(in) :: at
    integer, intent(in) :: k                  !! its number
    energy = at%y(at%m%s%ny - size(at%m%s%integrated) + k)
  end function integrated
end module work_sensor
