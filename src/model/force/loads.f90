!> Loads: a wrench on one marker, scaled by a history of time, a factor that follows motions or a controller, and by the part of the
!> loads that acts. Each kind says the wrench of a unit factor and its tangent.
module loads
  use kinds, only: wp
  use constraint, only: marker_stiffness
  use force_element, only: conditions, element_action, force_model, stage_all, stage_transient
  use history, only: breakpoint, history_model
  use marker, only: marker_states, turn
  implicit none (type, external)
  private

  !> A load.
  type, abstract, extends(force_model), public :: load_model
    class(history_model), allocatable :: history   !! of time; not allocated: none
    integer :: stage = stage_all                  !! the analyses in which it acts
  contains
    procedure :: act => load_act
    procedure :: tangent => load_tangent
    procedure :: components => no_components
    procedure :: unit_tangent => no_unit_tangent  !! of minus the wrench by displacement and turn of the marker, global axes
    procedure :: breakpoints => load_breakpoints
    procedure :: slope => load_slope
    procedure :: init_from_assembly => load_from_assembly
    procedure :: present_factor
  end type load_model

  !> It acts by a force on its marker.
  type, extends(load_model), public :: point_force_model
    real(wp) :: f(2) = 0.0_wp              !! in global axes, in those of the frame (in_frame), or of the section [N]
    logical :: in_section = .false.        !! it keeps its direction in the section's axes
  contains
    procedure :: unit_wrench => point_wrench
    procedure :: unit_tangent => point_tangent
    procedure :: components => point_components
  end type point_force_model

  !> A torque.
  type, extends(load_model), public :: torque_model
    real(wp) :: moment = 0.0_wp            !! [N m]
  contains
    procedure :: unit_wrench => torque_wrench
  end type torque_model

  !> A torque about a centre, which acts by a force on its marker; the arm makes the torque.
  type, extends(load_model), public :: central_torque_model
    real(wp) :: moment = 0.0_wp            !! [N m]
    real(wp) :: centre(2) = 0.0_wp         !! global [m]
  contains
    procedure :: unit_wrench => central_wrench
    procedure :: unit_tangent => central_tangent
    procedure :: components => both_places
    procedure :: check => needs_arm
  end type central_torque_model

contains

  !> The factor of the load; 0 in analyses in which it does not act [-].
  pure real(wp) function present_factor(self, p, with) result(s)
    class(load_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp) :: h(-1:2)                    ! [any]
    s = 0.0_wp
    if (self%stage /= stage_all .and. self%stage /= with%stage) return
    s = with%load_factor
    if (self%controller + self%motion_factor > 0) s = with%signal*with%load_factor
    if (.not. allocated(self%history)) return
    call self%history%evaluate(with%t, with%left_limit, h)
    s = h(0)*with%load_factor
  end function present_factor

  !> How the wrench grows with an argument; where no load acts and the question is what holds at all, that of a unit load factor.
  pure function load_slope(self, p, with) result(w)
    class(load_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp) :: w(6)                       !! [N, N m] over the argument's unit
    w = 0.0_wp
    if (self%stage /= stage_all .and. self%stage /= with%stage) return
    w(1:3) = with%slopes(1)*self%unit_wrench(p, with)
    if (self%controller > 0 .or. with%load_factor > 0.0_wp) w = with%load_factor*w
  end function load_slope

  !> The free lengths of springs whose deformations it follows.
  subroutine load_from_assembly(self, p, gap)
    class(load_model), intent(inout) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: gap            !! distance up to which markers coincide [m]
    integer :: k
    do k = 1, self%motions
      call self%arguments(k)%item%init_from_assembly(p, gap)
    end do
  end subroutine load_from_assembly

  !> The wrench and the power that it puts in.
  pure subroutine load_act(self, p, with, z, zd, zdd, x)
    class(load_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp), intent(in) :: z(*), zd(*)    !! not used [-]
    real(wp), intent(inout) :: zdd(*)      !! left as they are [-]
    type(element_action), intent(inout) :: x
    x%a = self%present_factor(p, with)*self%unit_wrench(p, with)
    x%input = dot_product(x%a(1:2), p%v(:, self%ia)) + x%a(3)*p%rate(self%ia)
  end subroutine load_act

  !> The tangent of minus the wrench.
  pure subroutine load_tangent(self, p, with, part, force, k)
    class(load_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp), intent(in) :: part(2)        !! not used [-]
    real(wp), intent(in) :: force          !! not used [N]
    type(marker_stiffness), intent(inout) :: k
    k%k = 0.0_wp
    k%c = 0.0_wp
    k%k(1:3, 1:3) = self%present_factor(p, with)*self%unit_tangent(p, with)
  end subroutine load_tangent

  !> Most loads do not change with the motion of their marker.
  pure function no_unit_tangent(self, p, with) result(k)
    class(load_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp) :: k(3, 3)                    !! [N/m, N]
    k = 0.0_wp
  end function no_unit_tangent

  !> Without a tangent nothing is joined.
  pure function no_components(self) result(list)
    class(load_model), intent(in) :: self
    integer, allocatable :: list(:)
    allocate (list(0))
  end function no_components

  !> The breakpoints of its history, if it acts in a transient analysis.
  pure function load_breakpoints(self, until) result(list)
    class(load_model), intent(in) :: self
    real(wp), intent(in) :: until          !! end of the run [s]
    type(breakpoint), allocatable :: list(:)
    allocate (list(0))
    if (.not. allocated(self%history)) return
    if (any(self%stage == [stage_all, stage_transient])) list = self%history%breakpoints(until)
  end function load_breakpoints

  !> The wrench: the force as the deck gives it, turned with the frame or the section.
  pure function point_wrench(self, p, with) result(w)
    class(point_force_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp) :: w(3)                       !! [N, N m]
    w = [self%f, 0.0_wp]
    if (self%in_frame) w(1:2) = with%axes(1)*self%f + with%axes(2)*turn(self%f)
    if (self%in_section) w(1:2) = cos(p%angle(self%ia))*self%f + sin(p%angle(self%ia))*turn(self%f)
  end function point_wrench

  !> A force in the section's axes turns with its angle.
  pure function point_tangent(self, p, with) result(k)
    class(point_force_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp) :: k(3, 3), w(3)              !! [N/m, N]
    w = self%unit_wrench(p, with)
    k = 0.0_wp
    if (self%in_section) k(1:2, 3) = -turn(w(1:2))
  end function point_tangent

  !> Its tangent joins the force and the angle of the section.
  pure function point_components(self) result(list)
    class(point_force_model), intent(in) :: self
    integer, allocatable :: list(:)
    list = pack([1, 2, 3], self%in_section)
  end function point_components

  !> The wrench: the moment alone.
  pure function torque_wrench(self, p, with) result(w)
    class(torque_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp) :: w(3)                       !! [N, N m]
    w = [0.0_wp, 0.0_wp, self%moment]
  end function torque_wrench

  !> The wrench: a force across the line to the centre.
  pure function central_wrench(self, p, with) result(w)
    class(central_torque_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp) :: w(3), arm(2)               !! [N, N m]
    arm = p%r(:, self%ia) - self%centre
    w = [self%moment*turn(arm)/max(dot_product(arm, arm), tiny(1.0_wp)), 0.0_wp]
  end function central_wrench

  !> The force turns and changes with the arm.
  pure function central_tangent(self, p, with) result(k)
    class(central_torque_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp) :: k(3, 3), d(2), n2          !! [N/m, N]
    d = p%r(:, self%ia) - self%centre
    n2 = max(dot_product(d, d), sqrt(tiny(1.0_wp)))         ! its inverse times a moment stays a number
    k = 0.0_wp
    k(1:2, 1) = -self%moment*([0.0_wp, 1.0_wp]/n2 - 2*turn(d)*(d(1)/n2)/n2)
    k(1:2, 2) = -self%moment*([-1.0_wp, 0.0_wp]/n2 - 2*turn(d)*(d(2)/n2)/n2)
  end function central_tangent

  !> Its tangent depends on the position.
  pure function both_places(self) result(list)
    class(central_torque_model), intent(in) :: self
    integer, allocatable :: list(:)
    list = [1, 2]
  end function both_places

  !> A marker at the centre is a fault: there is no arm.
  pure subroutine needs_arm(self, p, gap, fault, warning)
    class(central_torque_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: gap            !! distance up to which markers coincide [m]
    character(:), allocatable, intent(out) :: fault, warning
    fault = ''
    warning = ''
    if (norm2(p%r(:, self%ia) - self%centre) <= gap) fault = 'its marker is at the centre, where the torque has no arm; '// &
      'expected them apart, or type=''torque'''
  end subroutine needs_arm
end module loads
