!> Springs and dampers between two markers, with viscoelastic terms on their one deformation (a viscoelastic joint). Kinds say what
!> the deformation is: the angle between two sections, or the distance of two markers minus a free length. Linear springs without a
!> free length are bushes, which pull their markers together in whatever direction these move apart. theory.md, section 5. A
!> characteristic, a history of the deformation, may stand for the stiffness (section 3).
module springs
  use kinds, only: wp
  use constraint, only: marker_stiffness
  use force_element, only: conditions, element_action, root_rounding
  use marker, only: marker_states
  use measures, only: angle_between, distance_between
  use piecewise_force, only: piecewise_model
  use small_matrices, only: outer
  implicit none (type, external)
  private

  !> A spring.
  type, abstract, extends(piecewise_model), public :: spring_model
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
    procedure :: followed => spring_followed
    procedure :: present_stiffness
  end type spring_model

  !> One torsional spring.
  type, extends(spring_model), public :: torsional_model
  contains
    procedure :: deformation => turn_of_sections
    procedure :: acts_on
  end type torsional_model

  !> One linear spring.
  type, extends(spring_model), public :: linear_model
  contains
    procedure :: deformation => stretch
    procedure :: acts_on => line_acts_on
    procedure :: tangent => line_tangent
    procedure :: in_all_directions => is_bush
    procedure :: along_line => always
    procedure :: fault => no_direction
  end type linear_model

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
    real(wp) :: d(1), ds(1), dd, e(3), f, h(0:2), lost(1)
    call self%deformation(p, d(1), dd, e)
    d = d - self%unprestressed(with%prestress)
    ds = d
    lost = self%damping*dd**2
    if (size(self%law%alpha) > 0) call self%follow(1, d, z, zd, zdd, ds, 0, lost)
    x%dissipated = lost(1)
    if (allocated(self%history)) then
      h = self%history_value(with, d(1))
      f = h(0) + self%damping*dd
    else
      f = self%stiffness*ds(1) + self%damping*dd
    end if
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
    k%k = part(1)*self%present_stiffness(with, d)*outer([e, -e], [e, -e])
    k%c = part(2)*self%damping*outer([e, -e], [e, -e])
  end subroutine spring_tangent

  !> Energy stored in the spring and its viscoelastic terms [J].
  pure real(wp) function spring_energy(self, p, z, zd) result(energy)
    class(spring_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: z(*), zd(*)    !! all internal variables [m, rad] and rates
    real(wp) :: d(1), dd, e(3), h(-1:2), at_rest(-1:2)
    call self%deformation(p, d(1), dd, e)
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

  !> The deformation, of which a characteristic is a function.
  pure subroutine spring_followed(self, p, stage, x, rate, rounding)
    class(spring_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    integer, intent(in) :: stage           !! the analysis
    real(wp), intent(out) :: x             !! [m] or [rad]
    real(wp), intent(out) :: rate          !! [m/s] or [rad/s]
    real(wp), intent(out) :: rounding      !! [m] or [rad]
    real(wp) :: e(3)
    call self%deformation(p, x, rate, e)
    rounding = max(self%size, maxval(abs(p%r(:, [self%ia, self%ib]))))
    if (self%angular) rounding = max(1.0_wp, abs(p%angle(self%ia)), abs(p%angle(self%ib)))
    rounding = root_rounding*rounding
  end subroutine spring_followed

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

  !> While prestress grows the free value goes from the assembled length or angle to the deck's.
  pure real(wp) function spring_prestress(self, prestress) result(d)   ! [m] or [rad]
    class(spring_model), intent(in) :: self
    real(wp), intent(in) :: prestress      !! fraction that acts [-]
    d = (1 - prestress)*self%assembled
  end function spring_prestress

  !> Relative angle and its rate.
  pure subroutine turn_of_sections(self, p, d, dd, e)
    class(torsional_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(out) :: d             !! [rad]
    real(wp), intent(out) :: dd            !! [rad/s]
    real(wp), intent(out) :: e(3)          !! [-]
    real(wp) :: g(6)
    call angle_between(p, self%ia, self%ib, d, dd, g)
    d = d - self%free
    e = g(1:3)
  end subroutine turn_of_sections

  !> It acts by moments.
  pure function acts_on(self) result(yes)
    class(torsional_model), intent(in) :: self
    logical :: yes(6)
    yes = [.false., .false., .true., .false., .false., .true.]
  end function acts_on

  !> It acts by forces.
  pure function line_acts_on(self) result(yes)
    class(linear_model), intent(in) :: self
    logical :: yes(6)
    yes = [.true., .true., .false., .true., .true., .false.]
  end function line_acts_on

  !> Stretch, its rate, and the direction from b to a.
  pure subroutine stretch(self, p, d, dd, e)
    class(linear_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(out) :: d             !! [m]
    real(wp), intent(out) :: dd            !! [m/s]
    real(wp), intent(out) :: e(3)          !! [-]
    real(wp) :: g(6)
    call distance_between(p, self%ia, self%ib, d, dd, g)
    d = d - self%free
    e = g(1:3)
  end subroutine stretch

  !> Stiffness and damping along the spring, force over length across it; in every direction where the markers of a bush coincide.
  pure subroutine line_tangent(self, p, with, part, force, k)
    class(linear_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp), intent(in) :: part(2)        !! factors of stiffness and damping [-]
    real(wp), intent(in) :: force          !! present force [N]
    type(marker_stiffness), intent(inout) :: k
    real(wp) :: g(6), across(6), e(3), d, dd, length, c
    call self%deformation(p, d, dd, e)
    g = [e, -e]
    across = [-e(2), e(1), 0.0_wp, e(2), -e(1), 0.0_wp]
    c = part(2)*self%damping
    if (self%in_all_directions() .and. d <= 64*epsilon(1.0_wp)*maxval(abs(p%r(:, self%ia)))) then
      g = [1.0_wp, 0.0_wp, 0.0_wp, -1.0_wp, 0.0_wp, 0.0_wp]
      across = cshift(g, -1)
      k%k = part(1)*self%present_stiffness(with, d)*(outer(g, g) + outer(across, across))
      k%c = c*(outer(g, g) + outer(across, across))
      return
    end if
    length = max(d + self%free, tiny(1.0_wp))
    dd = dot_product(across(1:2), p%v(:, self%ia) - p%v(:, self%ib))
    k%k = part(1)*self%present_stiffness(with, d)*outer(g, g) + force/length*outer(across, across) + c*dd/length*outer(g, across)
    k%c = c*outer(g, g)                    ! e turns: the rate along it changes, the last term of k%k
  end subroutine line_tangent

  !> A spring without a free length is a bush.
  pure logical function is_bush(self)
    class(linear_model), intent(in) :: self
    is_bush = .not. self%free > 0.0_wp
  end function is_bush

  !> Its line turns with its markers.
  pure logical function always(self)
    class(linear_model), intent(in) :: self
    always = .true.
  end function always

  !> A spring with a free length needs a direction.
  pure function no_direction(self, p, gap) result(text)
    class(linear_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: gap            !! [m]
    character(:), allocatable :: text
    text = ''
    if (abs(self%free) > gap .and. norm2(p%r(:, self%ia) - p%r(:, self%ib)) <= gap) text = 'its markers coincide, so that '// &
      'its force has no direction; expected markers apart, or free_length=0'
  end function no_direction
end module springs
