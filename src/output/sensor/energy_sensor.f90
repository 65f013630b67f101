!> Kinetic energy of a body, what its deformation stores, viscoelastic terms included, and what its materials have dissipated since
!> the start of the transient.
module energy_sensor
  use kinds, only: wp
  use body_energy, only: kinetic_energy, strain_energy
  use sensor, only: nonlinear_sensor, observation
  use work_sensor, only: integrated
  implicit none (type, external)
  private

  !> A body's energies.
  type, extends(nonlinear_sensor), public :: energy_sensor_model
    integer :: integral = 0                   !! number of the dissipated power among those that the state integrates
  contains
    procedure :: read => read_energy
  end type energy_sensor_model

contains

  !> Of the state.
  subroutine read_energy(self, at, x)
    class(energy_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! [J], [J], [J]
    integer :: i, j
    associate (s => at%m%s, b => self%marker%body, n => at%m%s%bodies(self%marker%body)%nf)
      i = s%qo(b)
      j = s%nq + i
      x(1) = kinetic_energy(s%bodies(b), at%ev%frame%cos(b), at%ev%frame%sin(b), at%y(j + 1:j + 3), at%y(i + 4:i + 3 + n), &
                            at%y(j + 4:j + 3 + n))
      x(2) = strain_energy(s%bodies(b), at%ev%elastic(b), at%y(i + 4:i + 3 + n), at%y(2*s%nq + 1:2*s%nq + s%nz), &
                           at%y(2*s%nq + s%nz + 1:2*s%nq + s%nz + s%nzd))
      x(3) = integrated(at, self%integral)
    end associate
  end subroutine read_energy
end module energy_sensor
