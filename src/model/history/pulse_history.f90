!> A value between two times, nothing otherwise.
module pulse_history
  use kinds, only: wp
  use history, only: history_model, reached
  implicit none (type, external)
  private

  !> The value from start until finish.
  type, extends(history_model), public :: pulse_model
    real(wp) :: value = 0.0_wp          !! [unit]
    real(wp) :: start = 0.0_wp          !! [s]
    real(wp) :: finish = 0.0_wp         !! [s]
  contains
    procedure :: evaluate => pulse_value
  end type pulse_model

contains

  !> The derivatives are zero on both sides of the jumps.
  pure subroutine pulse_value(self, t, left_limit, h)
    class(pulse_model), intent(in) :: self
    real(wp), intent(in) :: t           !! [s]
    logical, intent(in) :: left_limit   !! limit from below
    real(wp), intent(out) :: h(-1:2)    !! [unit s, unit, unit/s, unit/s2]
    h = 0.0_wp
    h(-1) = self%value*(min(max(t, self%start), self%finish) - self%start)
    if (reached(t, self%start, left_limit) .and. .not. reached(t, self%finish, left_limit)) h(0) = self%value
  end subroutine pulse_value
end module pulse_history
