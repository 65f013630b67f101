!> What loads have in common: a wrench on one marker, scaled by a history and by the part of the loads that acts. Kinds say the
!> wrench of a unit factor and its tangent.
module load
  use kinds, only: wp
  use constraint, only: marker_stiffness
  use force_element, only: force_model, conditions, element_action, stage_all, stage_transient
  use history, only: breakpoint, history_model
  use marker, only: marker_states
  implicit none (type, external)
  private

  !> A load.
  type, abstract, extends(force_model), public :: load_model
    integer :: stage = stage_all                  !! the analyses in which it acts
    class(history_model), allocatable :: history  !! of its size; not allocated: 1
  contains
    procedure :: act => load_act
    procedure :: tangent => load_tangent
    procedure :: unit_tangent => no_unit_tangent  !! of minus the wrench by displacement and turn of the marker, global axes
    procedure :: breakpoints => load_breakpoints
    procedure :: present_factor
  end type load_model

contains

  !> The factor of the load at a time; 0 in analyses in which it does not act [-].
  pure real(wp) function present_factor(self, with) result(s)
    class(load_model), intent(in) :: self
    type(conditions), intent(in) :: with
    real(wp) :: h(-1:2)
    s = 0.0_wp
    if (self%stage /= stage_all .and. self%stage /= with%stage) return
    s = with%load_factor
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
    x%a = self%present_factor(with)*self%unit_wrench(p, with)
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
    k%k(1:3, 1:3) = self%present_factor(with)*self%unit_tangent(p, with)
  end subroutine load_tangent

  !> Most loads do not change with the motion of their marker.
  pure function no_unit_tangent(self, p, with) result(k)
    class(load_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp) :: k(3, 3)                    !! [N/m, N]
    k = 0.0_wp
  end function no_unit_tangent

  !> The breakpoints of its history, if it acts in a transient analysis.
  pure function load_breakpoints(self, until) result(list)
    class(load_model), intent(in) :: self
    real(wp), intent(in) :: until          !! end of the run [s]
    type(breakpoint), allocatable :: list(:)
    allocate (list(0))
    if (allocated(self%history) .and. any(self%stage == [stage_all, stage_transient])) list = self%history%breakpoints(until)
  end function load_breakpoints
end module load
