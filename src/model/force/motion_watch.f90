!> Elements that do not act but watch a motion for the factors of loads (`motion_factor`): a history of the motion, or the sign by
!> which a switch chooses. They have the discrete states, which only events change; several loads may share one.
module motion_watch
  use kinds, only: wp
  use force_element, only: bilateral, by_position, conditions, element_action, root_rounding, watched_roots
  use marker, only: marker_states
  use piecewise_force, only: follow, piecewise_model
  use root_watch, only: resting
  implicit none (type, external)
  private

  integer, parameter :: from_level = 1, below_level = -1   !! states of a switch

  !> What both have in common: they act on nothing.
  type, abstract, extends(piecewise_model), public :: watch_model
  contains
    procedure :: act => no_action
  end type watch_model

  !> A history of its measure.
  type, extends(watch_model), public :: history_watch
  contains
    procedure :: signal => history_signal
  end type history_watch

  !> 1 where its measure is at a level or above, -1 below.
  type, extends(watch_model), public :: switch_watch
    real(wp) :: level = 0.0_wp             !! [any]
  contains
    procedure :: signal => switch_signal
    procedure :: roots => switch_roots
    procedure :: switch => change_over
    procedure :: state_word => switch_word
  end type switch_watch

contains

  !> It does nothing.
  pure subroutine no_action(self, p, with, z, zd, zdd, x)
    class(watch_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp), intent(in) :: z(*), zd(*)    !! not used [-]
    real(wp), intent(inout) :: zdd(*)      !! left as they are [-]
    type(element_action), intent(inout) :: x
    x = element_action()
  end subroutine no_action

  !> Value and slope; where no load acts and the question is what holds at all, the steepest one.
  pure subroutine history_signal(self, p, with, h)
    class(history_watch), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp), intent(out) :: h(0:1)        !! [any]
    real(wp) :: f(0:2), x, rate, rounding
    call self%followed(p, with%stage, x, rate, rounding)
    f = self%history_value(with, x)
    h = f(0:1)
    if (.not. with%load_factor > 0.0_wp) h(1) = -self%history%steepest()
  end subroutine history_signal

  !> Its side.
  pure subroutine switch_signal(self, p, with, h)
    class(switch_watch), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp), intent(out) :: h(0:1)        !! 1 or -1, no slope [-]
    h = [real(side(self, p, with), wp), 0.0_wp]
  end subroutine switch_signal

  !> The state that it keeps, else that of the motion: at the level the side to which the motion goes, where that is known.
  pure integer function side(self, p, with)
    class(switch_watch), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp) :: x, rate, zero
    side = with%state
    if (.not. any(side == [by_position, bilateral])) return
    call distance(self, p, with, x, rate, zero)
    if (abs(x) <= zero) x = merge(rate, 0.0_wp, rate < huge(1.0_wp))
    side = merge(below_level, from_level, x < 0.0_wp)
  end function side

  !> How far the motion is above the level, its rate, and what counts as zero: of a rate also what solves leave of one at rest.
  pure subroutine distance(self, p, with, x, rate, zero)
    class(switch_watch), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp), intent(out) :: x, rate, zero   !! [any], huge where it is not known [any/s], [any]
    call follow(self%measure, self%size, p, with%stage, x, rate, zero)
    x = x - self%level
    zero = max(zero, root_rounding*abs(self%level))
    if (self%measure%rate) zero = max(zero, resting*merge(1.0_wp, self%size, self%measure%angular))
  end subroutine distance

  !> The distance to the level.
  pure subroutine switch_roots(self, p, with, watched)
    class(switch_watch), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    type(watched_roots), intent(out) :: watched
    real(wp) :: x, rate, zero
    integer :: now
    call distance(self, p, with, x, rate, zero)
    now = side(self, p, with)
    watched%g(1) = now*x
    watched%rate(1) = merge(rate, now*rate, rate >= huge(1.0_wp))
    watched%zero(1) = zero
  end subroutine switch_roots

  !> To the other side; where no event has led to it, that of the motion.
  pure subroutine change_over(self, p, with, which, state, event_value)
    class(switch_watch), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    integer, intent(in) :: which           !! the root that fell to zero; 0: no event
    integer, intent(out) :: state
    real(wp), intent(out) :: event_value   !! not used [-]
    type(conditions) :: now
    now = with
    if (which == 0) now%state = by_position
    state = side(self, p, now)
    if (which > 0) state = -state
    event_value = 0.0_wp
  end subroutine change_over

  !> Which history it chooses.
  pure function switch_word(self, state) result(word)
    class(switch_watch), intent(in) :: self
    integer, intent(in) :: state
    character(:), allocatable :: word
    word = 'first'
    if (state == below_level) word = 'second'
  end function switch_word
end module motion_watch
