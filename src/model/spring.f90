!> Springs and dampers between two places, with viscoelastic terms on their one deformation (a viscoelastic joint).
!> Deformation: length minus free length, or angle of a minus angle of b minus free angle. theory.md, section 5.
module spring
  use kinds, only: wp
  use small_matrices, only: outer
  use place, only: place_states
  use constraint, only: place_stiffness
  use viscoelastic_law, only: viscoelastic_terms
  implicit none (type, external)
  private

  !> One spring.
  type, public :: spring_model
    character(32) :: name = ''
    logical :: torsional = .false.
    integer :: ia = 0, ib = 0              !! places a and b
    real(wp) :: stiffness = 0.0_wp         !! static: [N/m] or [N m/rad]
    real(wp) :: damping = 0.0_wp           !! [N s/m] or [N m s/rad]
    real(wp) :: free = 0.0_wp              !! free length [m] or angle [rad]
    logical :: pending = .false.           !! free value still to be taken from the assembled positions
    integer :: offset = 0                  !! of its internal variables of second order among the scene's, from 0
    integer :: first_order = 0             !! of those of first order
    type(viscoelastic_terms) :: law
  contains
    procedure :: deformation => spring_deformation
    procedure :: force => spring_force
    procedure :: tangent => spring_tangent
    procedure :: every_way
  end type spring_model

contains

  !> Deformation, its rate, and the direction from b to a (linear springs).
  pure subroutine spring_deformation(self, p, d, dd, e)
    class(spring_model), intent(in) :: self
    type(place_states), intent(in) :: p
    real(wp), intent(out) :: d             !! [m] or [rad]
    real(wp), intent(out) :: dd            !! its rate
    real(wp), intent(out) :: e(2)          !! [-]
    real(wp) :: length
    e = 0.0_wp
    if (self%torsional) then
      d = p%angle(self%ia) - p%angle(self%ib) - self%free
      dd = p%rate(self%ia) - p%rate(self%ib)
    else
      e = p%r(:, self%ia) - p%r(:, self%ib)
      length = hypot(e(1), e(2))
      e = e/max(length, tiny(1.0_wp))
      d = length - self%free
      dd = dot_product(e, p%v(:, self%ia) - p%v(:, self%ib))
    end if
  end subroutine spring_deformation

  !> Force (tension > 0) or moment that opposes the deformation, with the dissipative accelerations and the power.
  pure subroutine spring_force(self, d, dd, z, zd, zdd, f, power)
    class(spring_model), intent(in) :: self
    real(wp), intent(in) :: d, dd          !! deformation and rate
    real(wp), intent(in) :: z(*), zd(*)    !! (nz) all internal variables, (nzd) rates of those of second order [m, rad] and per s
    real(wp), intent(inout) :: zdd(*)      !! (nz) their highest derivatives [m/s2, rad/s2], [m/s, rad/s]
    real(wp), intent(out) :: f             !! [N] or [N m]
    real(wp), intent(out) :: power         !! dissipated [W]
    integer :: k, i
    f = self%stiffness*d + self%damping*dd
    power = self%damping*dd**2
    associate (law => self%law)
      do k = 1, law%second
        i = self%offset + k
        f = f + self%stiffness*law%alpha(k)*(d - z(i))
        zdd(i) = (d - z(i) - law%viscosity(k)*zd(i))/law%inertia(k)
        power = power + self%stiffness*law%alpha(k)*law%viscosity(k)*zd(i)**2
      end do
      do k = law%second + 1, law%second + law%first
        i = self%first_order + k - law%second
        f = f + self%stiffness*law%alpha(k)*(d - z(i))
        zdd(i) = (d - z(i))/law%viscosity(k)
        power = power + self%stiffness*law%alpha(k)*law%viscosity(k)*zdd(i)**2
      end do
    end associate
  end subroutine spring_force

  !> Whether the spring pulls its places together whatever direction they part in: a bush.
  pure logical function every_way(self)
    class(spring_model), intent(in) :: self
    every_way = .not. (self%torsional .or. self%free > 0.0_wp)
  end function every_way

  !> Place-level tangent of the spring's wrenches (residual side: + opposes): k_eff along the deformation, c_eff on its
  !> rate, force/length across it; both in every direction where the places of a bush coincide.
  pure subroutine spring_tangent(self, p, keff, ceff, f, t)
    class(spring_model), intent(in) :: self
    type(place_states), intent(in) :: p
    real(wp), intent(in) :: keff           !! stiffness seen by the deformation [N/m] or [N m/rad]
    real(wp), intent(in) :: ceff           !! damping seen by its rate
    real(wp), intent(in) :: f              !! present force [N] or [N m]
    type(place_stiffness), intent(inout) :: t
    real(wp) :: g(6), e(2), across(2), d, dd, length, vt
    t%ia = self%ia
    t%ib = self%ib
    t%k = 0.0_wp
    t%c = 0.0_wp
    g = 0.0_wp
    call self%deformation(p, d, dd, e)
    if (self%torsional) then
      g(3) = 1.0_wp
      g(6) = -1.0_wp
    else
      g(1:2) = e
      g(4:5) = -e
    end if
    t%k = keff*outer(g, g)
    t%c = ceff*outer(g, g)
    if (self%torsional) return
    if (self%every_way() .and. d <= 64*epsilon(1.0_wp)*maxval(abs(p%r(:, self%ia)))) then
      g = [1.0_wp, 0.0_wp, 0.0_wp, -1.0_wp, 0.0_wp, 0.0_wp]
      t%k = keff*(outer(g, g) + outer(cshift(g, -1), cshift(g, -1)))
      t%c = ceff*(outer(g, g) + outer(cshift(g, -1), cshift(g, -1)))
      return
    end if
    length = max(d + self%free, tiny(1.0_wp))
    across = [-e(2), e(1)]
    vt = dot_product(across, p%v(:, self%ia) - p%v(:, self%ib))
    t%k = t%k + f/length*outer([across, 0.0_wp, -across, 0.0_wp], [across, 0.0_wp, -across, 0.0_wp]) &
          + ceff*vt/length*outer(g, [across, 0.0_wp, -across, 0.0_wp])   ! e turns: the rate along it changes
  end subroutine spring_tangent
end module spring
