!> Powers, their integrals since the start of the transient, and the energies of a body. The method that integrates the motion
!> integrates the powers, too: the integrals stand at the end of the state.
module energy_sensors
  use body_energy, only: kinetic_energy, layer_energy, strain_energy
  use evaluation_results, only: power_of
  use kinds, only: wp
  use scene_model, only: power_source
  use sensor, only: observation, sensor_model
  implicit none (type, external)
  private

  !> Power that a drive, force or spring puts into the mechanism, or that a joint passes to its body a.
  type, extends(sensor_model), public :: power_sensor_model
    type(power_source) :: source
  contains
    procedure :: read => read_power
  end type power_sensor_model

  !> Its integral, the work.
  type, extends(sensor_model), public :: work_sensor_model
    integer :: integral = 0                   !! its number among those of sensors
  contains
    procedure :: read => read_work
  end type work_sensor_model

  !> A body's kinetic energy, what its deformation stores, viscoelastic terms included, and what its materials have dissipated; of a
  !> layer of it the latter two.
  type, extends(sensor_model), public :: energy_sensor_model
    integer :: integral = 0                   !! of the dissipated power: its number among those of sensors
    integer :: layer = 0                      !! 0: the body
  contains
    procedure :: read => read_energy
  end type energy_sensor_model

contains

  !> As evaluated.
  subroutine read_power(self, at, x)
    class(power_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! [W]
    x(1) = power_of(at%m, at%ev, self%source)
  end subroutine read_power

  !> Of the state.
  subroutine read_work(self, at, x)
    class(work_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! [J]
    x(1) = integral(at, self%integral)
  end subroutine read_work

  !> Of the state; the losses of a layer are those of the summary.
  subroutine read_energy(self, at, x)
    class(energy_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! [J], [J], [J]
    integer :: i, j
    associate (s => at%m%s, b => self%marker%body, n => at%m%s%bodies(self%marker%body)%nf)
      if (self%layer > 0) then
        i = s%ny - size(s%integrated) - size(s%losses)
        x(1) = layer_energy(s%bodies(b), self%layer, at%ev%elastic(b), at%y(2*s%nq + 1:2*s%nq + s%nz), &
                            at%y(2*s%nq + s%nz + 1:2*s%nq + s%nz + s%nzd))
        x(2) = sum(at%y(i + 1:i + size(s%losses)), s%losses%body == b .and. s%losses%layer == self%layer)
        return
      end if
      i = s%qo(b)
      j = s%nq + i
      x(1) = kinetic_energy(s%bodies(b), at%ev%frame%cos(b), at%ev%frame%sin(b), at%y(j + 1:j + 3), at%y(i + 4:i + 3 + n), &
                            at%y(j + 4:j + 3 + n))
      x(2) = strain_energy(s%bodies(b), at%ev%elastic(b), at%y(i + 4:i + 3 + n), at%y(2*s%nq + 1:2*s%nq + s%nz), &
                           at%y(2*s%nq + s%nz + 1:2*s%nq + s%nz + s%nzd))
      x(3) = integral(at, self%integral)
    end associate
  end subroutine read_energy

  !> One of the integrals of sensors.
  pure real(wp) function integral(at, k) result(energy)   ! [J]
    type(observation), intent(in) :: at
    integer, intent(in) :: k                  !! its number
    energy = at%y(at%m%s%ny - size(at%m%s%integrated) + k)
  end function integral
end module energy_sensors
