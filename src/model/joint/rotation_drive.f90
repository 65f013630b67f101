!> Rotation drive: the angle of frame or section a minus that of b follows a history, directly or by its rate.
module rotation_drive
  use kinds, only: wp
  use constraint, only: constraint_model, constraint_rows
  use history, only: history_model, breakpoint, drive_breakpoints, drive_values
  use marker, only: marker_states
  implicit none (type, external)
  private

  !> size (angle_a - angle_b - target(t)) = 0.
  type, extends(constraint_model), public :: rotation_model
    logical :: rate = .false.             !! the history gives the rate
    real(wp) :: origin = 0.0_wp           !! by rate: the deck's own value of the angle [rad]
    class(history_model), allocatable :: target
  contains
    procedure :: evaluate => rotation_rows
    procedure :: init_from_deck => rotation_begin
    procedure :: acts_on => rotation_acts_on
    procedure :: breakpoints => rotation_breakpoints
    procedure :: input => rotation_input
  end type rotation_model

contains

  !> The angle, or its rate.
  pure subroutine rotation_input(self, value, rate)
    class(rotation_model), intent(in) :: self
    real(wp), intent(out) :: value        !! [m]
    logical, intent(out) :: rate
    value = self%size
    rate = self%rate
  end subroutine rotation_input

  !> The row.
  pure subroutine rotation_rows(self, t, p, r)
    class(rotation_model), intent(in) :: self
    real(wp), intent(in) :: t   !! [s]
    type(marker_states), intent(in) :: p
    type(constraint_rows), intent(inout) :: r
    real(wp) :: h(0:2)
    integer :: i
    i = self%first
    call drive_values(self%target, self%rate, self%origin, t, r%left_limit, h)
    call self%hold_angle(i, h(0), p, r)
    r%phi_t(i) = -self%size*h(1)
    r%acceleration_bias(i) = -self%size*h(2)
  end subroutine rotation_rows

  !> It acts on section angles alone.
  pure function rotation_acts_on(self) result(yes)
    class(rotation_model), intent(in) :: self
    logical :: yes(6)
    yes = [.false., .false., .true., .false., .false., .true.]
  end function rotation_acts_on

  !> A drive by rate starts from the deck's own value.
  subroutine rotation_begin(self, p)
    class(rotation_model), intent(inout) :: self
    type(marker_states), intent(in) :: p
    if (self%rate) self%origin = p%angle(self%ia) - p%angle(self%ib)
  end subroutine rotation_begin

  !> Breakpoints of its history.
  pure function rotation_breakpoints(self, until) result(list)
    class(rotation_model), intent(in) :: self
    real(wp), intent(in) :: until         !! end of the run [s]
    type(breakpoint), allocatable :: list(:)
    list = drive_breakpoints(self%target, self%rate, until)
  end function rotation_breakpoints
end module rotation_drive
