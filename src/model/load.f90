!> Loads: forces with global or follower axes, torques on frames and sections, torques about a fixed centre.
module load
  use kinds, only: wp
  use place, only: place_states, turn
  use history, only: history_model
  implicit none (type, external)
  private

  integer, parameter, public :: axes_global = 0, axes_body = 1, axes_section = 2
  integer, parameter, public :: stage_all = 0, stage_static = 1, stage_transient = 2
  integer, parameter, public :: load_force = 1, load_torque = 2, load_about = 3

  !> One load.
  type, public :: load_model
    character(32) :: name = ''
    integer :: kind = load_force
    integer :: place = 0                   !! where it acts
    real(wp) :: f(2) = 0.0_wp              !! [N]
    integer :: axes = axes_global
    real(wp) :: moment = 0.0_wp            !! [N m]
    real(wp) :: centre(2) = 0.0_wp         !! torque_about: global [m]
    integer :: stage = stage_all
    class(history_model), allocatable :: factor   !! not allocated: the factor is 1
  contains
    procedure :: wrench => load_wrench
    procedure :: tangent => load_tangent
    procedure :: acts => load_acts
    procedure :: scale => load_scale
  end type load_model

contains

  !> Whether the load acts in the given stage.
  pure function load_acts(self, stage) result(yes)
    class(load_model), intent(in) :: self
    integer, intent(in) :: stage           !! stage_static or stage_transient
    logical :: yes
    yes = self%stage == stage_all .or. self%stage == stage
  end function load_acts

  !> Factor of the load at a time.
  pure function load_scale(self, t, left) result(s)
    class(load_model), intent(in) :: self
    real(wp), intent(in) :: t              !! [s]
    logical, intent(in) :: left            !! a jump at t is not yet felt
    real(wp) :: s, h(0:2)
    s = 1.0_wp
    if (.not. allocated(self%factor)) return
    call self%factor%evaluate(t, left, h)
    s = h(0)
  end function load_scale

  !> Force (global axes) and moment on the place for a given factor.
  pure subroutine load_wrench(self, p, frame_angle, scale, force, moment)
    class(load_model), intent(in) :: self
    type(place_states), intent(in) :: p
    real(wp), intent(in) :: frame_angle    !! of the body [rad]
    real(wp), intent(in) :: scale          !! [-]
    real(wp), intent(out) :: force(2)      !! [N]
    real(wp), intent(out) :: moment        !! [N m]
    real(wp) :: c, s, arm(2)
    force = 0.0_wp
    moment = 0.0_wp
    select case (self%kind)
    case (load_force)
      force = self%f
      if (self%axes /= axes_global) then
        c = frame_angle
        if (self%axes == axes_section) c = p%angle(self%place)
        s = sin(c)
        c = cos(c)
        force = [c*self%f(1) - s*self%f(2), s*self%f(1) + c*self%f(2)]
      end if
      force = scale*force
    case (load_torque)
      moment = scale*self%moment
    case default   ! load_about
      arm = p%r(:, self%place) - self%centre
      force = scale*self%moment*turn(arm)/max(dot_product(arm, arm), tiny(1.0_wp))
    end select
  end subroutine load_wrench

  !> Tangent of the residual (minus the wrench, global axes) by the displacement and turn of the place, for a given factor: torques
  !> about a centre and forces that follow a section. Forces in the frame's axes turn with the frame and are not seen here.
  pure subroutine load_tangent(self, p, frame_angle, scale, k)
    class(load_model), intent(in) :: self
    type(place_states), intent(in) :: p
    real(wp), intent(in) :: frame_angle    !! of the body [rad]
    real(wp), intent(in) :: scale          !! [-]
    real(wp), intent(out) :: k(3, 3)       !! [N/m, N]
    real(wp) :: force(2), moment, d(2), n2
    k = 0.0_wp
    if (self%kind == load_about) then
      d = p%r(:, self%place) - self%centre
      n2 = max(dot_product(d, d), sqrt(tiny(1.0_wp)))       ! its inverse times a moment stays a number
      k(1:2, 1) = -scale*self%moment*([0.0_wp, 1.0_wp]/n2 - 2*turn(d)*(d(1)/n2)/n2)
      k(1:2, 2) = -scale*self%moment*([-1.0_wp, 0.0_wp]/n2 - 2*turn(d)*(d(2)/n2)/n2)
    else if (self%kind == load_force .and. self%axes == axes_section) then
      call self%wrench(p, frame_angle, scale, force, moment)
      k(1:2, 3) = -turn(force)
    end if
  end subroutine load_tangent
end module load
