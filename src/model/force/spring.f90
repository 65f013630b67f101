!> The law of springs and dampers between two markers, with viscoelastic terms on their one deformation (a viscoelastic joint).
!> Kinds say what the deformation is. theory.md, section 5.
module spring
  use kinds, only: wp
  use constraint, only: marker_stiffness
  use force_element, only: force_model, conditions, element_action
  use marker, only: marker_states
  use small_matrices, only: outer
  implicit none (type, external)
  private

  !> A spring.
  type, abstract, extends(force_model), public :: spring_model
    real(wp) :: free = 0.0_wp              !! free length [m] or angle [rad]
    real(wp) :: assembled = 0.0_wp         !! deformation in the assembled scene [m] or [rad]
    logical :: pending = .false.           !! free value still to be taken from the assembled positions
  contains
    procedure :: act => spring_act
    procedure :: tangent => spring_tangent
    procedure :: energy => spring_energy
    procedure :: relax => spring_relax
    procedure :: init_from_assembly => spring_settle
    procedure :: unprestressed => spring_prestress
  end type spring_model

contains

  !> Force (tension > 0) or moment that opposes the deformation, accelerations of the dissipative coordinates, power.
  pure subroutine spring_act(self, p, with, z, zd, zdd, x)
    class(spring_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp), intent(in) :: z(*)           !! (nz) all internal variables [m, rad]
    real(wp), intent(in) :: zd(*)          !! (nzd) rates of those of second order [m/s, rad/s]
    real(wp), intent(inout) :: zdd(*)      !! (nz) their highest derivatives [m/s2, rad/s2], [m/s, rad/s]
    type(element_action), intent(inout) :: x
    real(wp) :: d(1), ds(1), dd, e(3), f
    call self%deformation(p, d(1), dd, e)
    d = d - self%unprestressed(with%prestress)
    ds = d
    x%dissipated = self%damping*dd**2
    if (size(self%law%alpha) > 0) call self%follow(1, d, z, zd, zdd, ds, x%dissipated)
    f = self%stiffness*ds(1) + self%damping*dd
    x%force = f
    x%a = -f*e
    x%b = f*e
  end subroutine spring_act

  !> Stiffness and damping along the deformation, which grows linearly with the markers' motion.
  pure subroutine spring_tangent(self, p, with, part, force, k)
    class(spring_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp), intent(in) :: part(2)        !! factors of stiffness and damping [-]
    real(wp), intent(in) :: force          !! present force [N] or [N m]
    type(marker_stiffness), intent(inout) :: k
    real(wp) :: d, dd, e(3)
    call self%deformation(p, d, dd, e)
    k%k = part(1)*self%stiffness*outer([e, -e], [e, -e])
    k%c = part(2)*self%damping*outer([e, -e], [e, -e])
  end subroutine spring_tangent

  !> Energy stored in the spring and its viscoelastic terms [J].
  pure real(wp) function spring_energy(self, p, z, zd) result(energy)
    class(spring_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: z(*), zd(*)    !! all internal variables [m, rad] and rates
    real(wp) :: d(1), dd, e(3)
    call self%deformation(p, d(1), dd, e)
    energy = 0.5_wp*self%stiffness*d(1)**2 + self%stored(1, d, z, zd)
  end function spring_energy

  !> Viscoelastic terms at rest follow the deformation.
  pure subroutine spring_relax(self, p, prestress, z)
    class(spring_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: prestress      !! fraction that acts [-]
    real(wp), intent(inout) :: z(*)        !! (nz) all internal variables [m, rad]
    real(wp) :: d, dd, e(3)
    call self%deformation(p, d, dd, e)
    d = d - self%unprestressed(prestress)
    z(self%offset + 1:self%offset + self%law%second) = d
    z(self%first_order + 1:self%first_order + self%law%first) = d
  end subroutine spring_relax

  !> Takes a free length or angle that the deck leaves open from the assembled positions: 0 where markers coincide, a bush.
  subroutine spring_settle(self, p, gap)
    class(spring_model), intent(inout) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: gap            !! distance up to which markers coincide [m]
    real(wp) :: d, dd, e(3)
    if (self%pending) then
      self%free = 0.0_wp
      call self%deformation(p, d, dd, e)
      if (self%angular .or. abs(d) > gap) self%free = d
      self%pending = .false.
    end if
    call self%deformation(p, self%assembled, dd, e)
  end subroutine spring_settle

  !> While prestress grows the free value goes from the assembled length or angle to the deck's.
  pure real(wp) function spring_prestress(self, prestress) result(d)   ! [m] or [rad]
    class(spring_model), intent(in) :: self
    real(wp), intent(in) :: prestress      !! fraction that acts [-]
    d = (1 - prestress)*self%assembled
  end function spring_prestress
end module spring
