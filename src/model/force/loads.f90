!> Loads: a wrench on one marker, scaled by a history of time, a factor that follows motions or a controller, and by the part of the
!> loads that acts.
module loads
  use kinds, only: wp
  use constraint, only: marker_stiffness
  use force_element, only: conditions, element_action, force_model, stage_all, stage_static, stage_transient
  use history, only: breakpoint, history_model
  use marker, only: marker_states, turn
  implicit none (type, external)
  private

  !> A load.
  type, extends(force_model), public :: load_model
    real(wp) :: f(2) = 0.0_wp                     !! force in global axes, in those of the frame (in_frame), or of the section [N]
    real(wp) :: moment = 0.0_wp                   !! or a torque [N m]
    logical :: in_section = .false.               !! the force keeps its direction in the section's axes
    logical :: central = .false.                  !! the torque is about a centre, and acts by a force on its marker across the arm
    real(wp) :: centre(2) = 0.0_wp                !! global [m]
    class(history_model), allocatable :: history   !! of time; not allocated: none
  contains
    procedure :: act => load_act
    procedure :: tangent => load_tangent
    procedure :: components => load_components
    procedure :: unit_wrench => load_wrench
    procedure :: breakpoints => load_breakpoints
    procedure :: check => needs_arm
    procedure :: present_factor
  end type load_model

contains

  !> The factor of the load; 0 in analyses in which it does not act [-].
  pure real(wp) function present_factor(self, p, with) result(s)
    class(load_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp) :: h(-1:2)                    ! [any]
    s = 0.0_wp
    if (self%controller > 0) then          ! it acts where the controller is switched on
      if (self%stage == stage_static) return
    else if (self%stage /= stage_all .and. self%stage /= with%stage) then
      return
    end if
    s = with%load_factor
    if (self%controller + self%motion_factor > 0) s = with%signal*with%load_factor
    if (.not. allocated(self%history)) return
    call self%history%evaluate(with%t, with%left_limit, h)
    s = h(0)*with%load_factor
  end function present_factor

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

  !> The tangent of minus the wrench, by displacement and turn of the marker: a force in the section's axes turns with its angle,
  !> that of a torque about a centre changes with the arm.
  pure subroutine load_tangent(self, p, with, part, force, k)
    class(load_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp), intent(in) :: part(2)        !! not used [-]
    real(wp), intent(in) :: force          !! not used [N]
    type(marker_stiffness), intent(inout) :: k
    real(wp) :: w(3), d(2), n2             ! [N, N m], [m], [m2]
    k%k = 0.0_wp
    k%c = 0.0_wp
    if (self%in_section) then
      w = self%unit_wrench(p, with)
      k%k(1:2, 3) = -turn(w(1:2))
    else if (self%central) then
      d = p%r(:, self%ia) - self%centre
      n2 = max(dot_product(d, d), sqrt(tiny(1.0_wp)))       ! its inverse times a moment stays a number
      k%k(1:2, 1) = -self%moment*([0.0_wp, 1.0_wp]/n2 - 2*turn(d)*(d(1)/n2)/n2)
      k%k(1:2, 2) = -self%moment*([-1.0_wp, 0.0_wp]/n2 - 2*turn(d)*(d(2)/n2)/n2)
    end if
    k%k = self%present_factor(p, with)*k%k
  end subroutine load_tangent

  !> What the tangent joins.
  pure function load_components(self) result(list)
    class(load_model), intent(in) :: self
    integer, allocatable :: list(:)
    list = pack([1, 2, 3], self%in_section .or. ([1, 2, 3] < 3 .and. self%central))
  end function load_components

  !> The breakpoints of its history, if it acts in a transient analysis.
  pure function load_breakpoints(self, until) result(list)
    class(load_model), intent(in) :: self
    real(wp), intent(in) :: until          !! end of the run [s]
    type(breakpoint), allocatable :: list(:)
    allocate (list(0))
    if (.not. allocated(self%history)) return
    if (any(self%stage == [stage_all, stage_transient])) list = self%history%breakpoints(until)
  end function load_breakpoints

  !> The wrench: the force as the deck gives it, turned with the frame or the section; the moment, or a force across the arm.
  pure function load_wrench(self, p, with) result(w)
    class(load_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp) :: w(3), arm(2)               !! [N, N m]
    w = [self%f, self%moment]
    if (self%acts(3)) return               ! a plain torque
    if (self%in_frame) w(1:2) = with%axes(1)*self%f + with%axes(2)*turn(self%f)
    if (self%in_section) w(1:2) = cos(p%angle(self%ia))*self%f + sin(p%angle(self%ia))*turn(self%f)
    if (.not. self%central) return
    arm = p%r(:, self%ia) - self%centre
    w = [self%moment*turn(arm)/max(dot_product(arm, arm), tiny(1.0_wp)), 0.0_wp]
  end function load_wrench

  !> A marker at the centre is a fault: there is no arm.
  pure subroutine needs_arm(self, p, gap, fault, warning)
    class(load_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: gap            !! distance up to which markers coincide [m]
    character(:), allocatable, intent(out) :: fault, warning
    fault = ''
    warning = ''
    if (self%central .and. norm2(p%r(:, self%ia) - self%centre) <= gap) fault = 'its marker is at the centre, where the torque '// &
      'has no arm; expected them apart, or type=''torque'''
  end subroutine needs_arm
end module loads
