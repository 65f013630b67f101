!> Elements that do not act but watch a motion: for the factors of loads (`motion_factor`), or for the corners of a profile's law.
!> They have the discrete states, which only events change; several loads may share one.
module motion_watch
  use kinds, only: wp
  use force_element, only: conditions, element_action
  use history, only: breakpoint
  use marker, only: marker_states
  use piecewise_force, only: piecewise_model
  use simple_histories, only: pulse_model
  implicit none (type, external)
  private

  integer, parameter :: from_level = 1, below_level = -1   !! states of a switch

  !> A history of its measure.
  type, extends(piecewise_model), public :: history_watch
  contains
    procedure :: act => no_action
    procedure :: signal
  end type history_watch

  !> By which a switch chooses: the history is 1 where the measure is at a level or above, 0 below. These events are told.
  type, extends(history_watch), public :: switch_watch
  contains
    procedure :: set_level
    procedure :: switch => change_over
    procedure :: state_word => switch_word
  end type switch_watch

contains

  !> It does nothing.
  pure subroutine no_action(self, p, with, z, zd, zdd, x)
    class(history_watch), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp), intent(in) :: z(*), zd(*)    !! not used [-]
    real(wp), intent(inout) :: zdd(*)      !! left as they are [-]
    type(element_action), intent(inout) :: x
    x = element_action()
  end subroutine no_action

  !> Value and slope; where no load acts and the question is what holds at all, the steepest one.
  pure subroutine signal(self, p, with, h)
    class(history_watch), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp), intent(out) :: h(0:1)        !! [any]
    real(wp) :: f(0:2), x, rate, rounding
    call self%followed(p, with%stage, x, rate, rounding)
    f = self%history_value(with, x)
    h = f(0:1)
    if (.not. with%load_factor > 0.0_wp) h(1) = -self%history%steepest()
  end subroutine signal

  !> The history of a switch: it steps at the level.
  subroutine set_level(self, level)
    class(switch_watch), intent(inout) :: self
    real(wp), intent(in) :: level          !! [any]
    type(pulse_model), allocatable :: step
    allocate (step)
    step%value = 1.0_wp
    step%start = level
    step%finish = huge(1.0_wp)
    step%breaks = [breakpoint(level, 0)]
    call move_alloc(step, self%history)
    call self%watch_corners(0)
  end subroutine set_level

  !> To the other side; where no event has led to it, that of the motion.
  pure subroutine change_over(self, p, with, which, state, event_value)
    class(switch_watch), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    integer, intent(in) :: which           !! the root that fell to zero; 0: no event
    integer, intent(out) :: state
    real(wp), intent(out) :: event_value   !! [any]
    real(wp) :: h(-1:2)                    ! [any]
    call self%history_watch%switch(p, with, which, state, event_value)
    call self%history%evaluate(event_value, .false., h)
    state = merge(from_level, below_level, h(0) > 0.0_wp)
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
