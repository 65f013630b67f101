!> The mechanism as the system of first-order equations that integrators see. State: q, v, z, z', dissipated energy, work
!> (layout in `scene_model`).
module mechanism_ode
  use kinds, only: wp
  use mechanism, only: mechanism_model
  use ode_system, only: ode, largest_value, sane
  use projection, only: project
  use singular, only: evaluate_branch
  implicit none (type, external)
  private

  integer, parameter, public :: stabilise_none = 0, stabilise_projection = 1, stabilise_baumgarte = 2

  !> The system.
  type, extends(ode), public :: mechanism_system
    type(mechanism_model) :: m
    integer :: stabilisation = stabilise_projection
  contains
    procedure :: derivative => mechanism_derivative
    procedure :: accept => mechanism_accept
  end type mechanism_system

contains

  !> Rates of the whole state (theory.md, sections 3 to 6).
  subroutine mechanism_derivative(self, t, y, left, dy)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(in), contiguous :: y(:)
    logical, intent(in) :: left
    real(wp), intent(out), contiguous :: dy(:)
    self%m%left = left
    self%m%broken = .false.
    call state_rates(self%m, self%m%s%nq, self%m%s%nz, t, y, dy)
  end subroutine mechanism_derivative

  !> The same, with the parts of the state apart.
  subroutine state_rates(m, nq, nz, t, y, dy)
    type(mechanism_model), intent(inout) :: m
    integer, intent(in) :: nq, nz
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(in) :: y(2*nq + 2*nz + 2)
    real(wp), intent(out) :: dy(2*nq + 2*nz + 2)
    call evaluate_branch(m, t, y(1:nq), y(nq + 1:2*nq), y(2*nq + 1:2*nq + nz), y(2*nq + nz + 1:2*nq + 2*nz))
    dy(1:nq) = y(nq + 1:2*nq)
    dy(nq + 1:2*nq) = m%a
    if (m%broken) dy(nq + 1:2*nq) = 10*largest_value         ! no acceleration: whoever uses it sees that it is lost
    dy(2*nq + 1:2*nq + nz) = y(2*nq + nz + 1:2*nq + 2*nz)
    dy(2*nq + nz + 1:2*nq + 2*nz) = m%zdd
    dy(2*nq + 2*nz + 1) = m%dissipated_power
    dy(2*nq + 2*nz + 2) = m%input_power
  end subroutine state_rates

  !> Projects an accepted state; refuses states that are not finite.
  subroutine mechanism_accept(self, t, y, ok)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(inout), contiguous :: y(:)
    logical, intent(out) :: ok
    ok = sane(y) .and. .not. self%m%broken
    if (.not. ok .or. self%stabilisation /= stabilise_projection) return
    call project_state(self%m, self%m%s%nq, self%m%s%nz, t, y, ok)
  end subroutine mechanism_accept

  !> The same, with the parts of the state apart.
  subroutine project_state(m, nq, nz, t, y, ok)
    type(mechanism_model), intent(inout) :: m
    integer, intent(in) :: nq, nz
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(inout) :: y(2*nq + 2*nz + 2)
    logical, intent(out) :: ok
    call project(m, t, y(1:nq), y(nq + 1:2*nq), y(2*nq + 1:2*nq + nz), y(2*nq + nz + 1:2*nq + 2*nz), ok)
    if (ok) ok = sane(y(1:2*nq))
  end subroutine project_state
end module mechanism_ode
