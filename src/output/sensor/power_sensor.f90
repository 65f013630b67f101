!> Power that a drive, force, spring or stop puts into the mechanism: of a drive its multiplier times what it prescribes, of all
!> others their forces and moments times the velocities of their markers.
module power_sensor
  use kinds, only: wp
  use sensor, only: nonlinear_sensor, observation
  implicit none (type, external)
  private

  !> A power.
  type, extends(nonlinear_sensor), public :: power_sensor_model
    integer :: constraint = 0                 !! number of the drive among joints and drives, 0: a force element
    integer :: element = 0                    !! its number among the force elements
  contains
    procedure :: read => read_power
  end type power_sensor_model

contains

  !> As evaluated.
  subroutine read_power(self, at, x)
    class(power_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! [W]
    integer :: i
    if (self%constraint > 0) then
      i = at%m%s%constraints(self%constraint)%item%first
      x(1) = at%ev%lambda(i)*at%ev%rows%phi_t(i)
      return
    end if
    associate (f => at%m%s%forces(self%element)%item, does => at%ev%action(self%element), p => at%ev%p)
      x(1) = dot_product(does%a(1:2), p%v(:, f%ia)) + does%a(3)*p%rate(f%ia)
      if (f%ib /= f%ia) x(1) = x(1) + dot_product(does%b(1:2), p%v(:, f%ib)) + does%b(3)*p%rate(f%ib)
    end associate
  end subroutine read_power
end module power_sensor
