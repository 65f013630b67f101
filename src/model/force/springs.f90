!> Springs and dampers between two markers, with viscoelastic terms on their one deformation (a viscoelastic joint): their measure
!> less a free length or angle. Linear springs without a free length are bushes, which pull their markers together in whatever
!> direction these move apart. theory.md, section 5. A characteristic, a history of the deformation, may stand for the stiffness
!> (section 3).
module springs
  use kinds, only: wp
  use constraint, only: marker_stiffness
  use force_element, only: conditions, element_action
  use marker, only: marker_states
  use measure, only: measured, together
  use piecewise_force, only: piecewise_model
  implicit none (type, external)
  private

  !> A spring.
  type, extends(piecewise_model), public :: spring_model
    real(wp) :: assembled = 0.0_wp         !! deformation in the assembled scene [m] or [rad]
  contains
    procedure :: act => spring_act
    procedure :: tangent => spring_tangent
    procedure :: energy => spring_energy
    procedure :: relax => spring_relax
    procedure :: init_from_assembly => spring_from_assembly
    procedure :: check => needs_direction
    procedure :: unprestressed
    procedure :: present_stiffness
  end type spring_model

contains

  !> Force (tension > 0) or moment that opposes the deformation, highest derivatives of the internal variables, power.
  pure subroutine spring_act(self, p, with, z, zd, zdd, x)
    class(spring_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp), intent(in) :: z(*)           !! (nz) all internal variables [m, rad]
    real(wp), intent(in) :: zd(*)          !! (nzd) rates of those of second order [m/s, rad/s]
    real(wp), intent(inout) :: zdd(*)      !! (nz) their highest derivatives [m/s2, rad/s2], [m/s, rad/s]
    type(element_action), intent(inout) :: x
    type(measured) :: now
    real(wp) :: d(1), ds(1), f, h(0:2), lost(1)
    now = self%deformation(p)
    d = now%x - self%unprestressed(with%prestress)
    ds = d
    lost = self%damping*now%rate**2
    if (size(self%law%alpha) > 0) call self%follow(1, d, z, zd, zdd, ds, 0, lost)
    x%dissipated = lost(1)
    if (allocated(self%history)) then
      h = self%history_value(with, d(1))
      f = h(0) + self%damping*now%rate
    else
      f = self%stiffness*ds(1) + self%damping*now%rate
    end if
    x%force = f
    x%a = -f*now%g(1:3)
    x%b = -f*now%g(4:6)
  end subroutine spring_act

  !> Stiffness and damping along the deformation, force over length across it; in every direction where the markers of a bush
  !> coincide.
  pure subroutine spring_tangent(self, p, with, part, force, k)
    class(spring_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp), intent(in) :: part(2)        !! factors of stiffness and damping [-]
    real(wp), intent(in) :: force          !! present force [N] or [N m]
    type(marker_stiffness), intent(inout) :: k
    type(measured) :: now
    real(wp) :: stiffness
    now = self%deformation(p)
    stiffness = part(1)*self%present_stiffness(with, now%x)
    if (self%in_all_directions() .and. now%x <= 64*epsilon(1.0_wp)*maxval(abs(p%r(:, self%ia)))) then
      k%k = stiffness*together
      k%c = part(2)*self%damping*together
    else
      call self%tangent_along(p, stiffness, part(2)*self%damping, force, k)
    end if
  end subroutine spring_tangent

  !> Energy stored in the spring and its viscoelastic terms [J].
  pure real(wp) function spring_energy(self, p, z, zd) result(energy)
    class(spring_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: z(*), zd(*)    !! all internal variables [m, rad] and rates
    type(measured) :: now
    real(wp) :: d(1), h(-1:2), at_rest(-1:2)
    now = self%deformation(p)
    d = now%x
    if (allocated(self%history)) then
      call self%history%evaluate(d(1), .false., h)
      call self%history%evaluate(0.0_wp, .false., at_rest)
      energy = h(-1) - at_rest(-1)
      return
    end if
    energy = 0.5_wp*self%stiffness*d(1)**2 + self%stored(1, d, z, zd)
  end function spring_energy

  !> Viscoelastic terms at rest follow the deformation.
  pure subroutine spring_relax(self, p, prestress, z)
    class(spring_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: prestress      !! fraction that acts [-]
    real(wp), intent(inout) :: z(*)        !! (nz) all internal variables [m, rad]
    type(measured) :: now
    real(wp) :: d
    now = self%deformation(p)
    d = now%x - self%unprestressed(prestress)
    z(self%offset + 1:self%offset + self%law%second) = d
    z(self%first_order + 1:self%first_order + self%law%first) = d
  end subroutine spring_relax

  !> Takes a free length or angle that the deck leaves open from the assembled positions.
  subroutine spring_from_assembly(self, p, gap)
    class(spring_model), intent(inout) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: gap            !! distance up to which markers coincide [m]
    type(measured) :: now
    call self%measure%init_from_assembly(p, gap)
    now = self%deformation(p)
    self%assembled = now%x
  end subroutine spring_from_assembly

  !> Static stiffness at a deformation; of a characteristic the largest where no load acts and the question is what holds at all.
  pure real(wp) function present_stiffness(self, with, d) result(k)   ! [N/m] or [N m/rad]
    class(spring_model), intent(in) :: self
    type(conditions), intent(in) :: with
    real(wp), intent(in) :: d              !! [m] or [rad]
    real(wp) :: h(0:2)
    k = self%stiffness
    if (.not. allocated(self%history) .or. .not. with%load_factor > 0.0_wp) return
    h = self%history_value(with, d - self%unprestressed(with%prestress))
    k = h(1)
  end function present_stiffness

  !> What prestress that acts in part takes off the deformation: the free value goes from the assembled one to the deck's.
  pure real(wp) function unprestressed(self, prestress) result(d)   ! [m] or [rad]
    class(spring_model), intent(in) :: self
    real(wp), intent(in) :: prestress      !! fraction that acts [-]
    d = (1 - prestress)*self%assembled
  end function unprestressed

  !> A spring with a free length needs a direction.
  pure subroutine needs_direction(self, p, gap, fault, warning)
    class(spring_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: gap            !! [m]
    character(:), allocatable, intent(out) :: fault, warning
    type(measured) :: now
    fault = ''
    warning = ''
    call self%measure%measure(p, now)
    if (self%measure%radial .and. abs(self%measure%datum) > gap .and. now%x <= gap) fault = 'its markers coincide, so that its '// &
      'force has no direction; expected markers apart, or free_length=0'
  end subroutine needs_direction
end module springs
