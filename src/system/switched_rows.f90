!> Rows that switch, where they are off: they hold nothing, and their multipliers follow a law. Of friction, where it slips, the
!> multiplier is the friction force, a function of the joint's other multipliers (theory.md, section 13).
module switched_rows
  use kinds, only: wp
  use evaluation_results, only: evaluation
  use friction_row, only: friction_model
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: leave_open, slip_gaps, slip_slope

contains

  !> What rows that are off are open by counts for nothing.
  pure subroutine leave_open(ev, gap)
    type(evaluation), intent(in) :: ev
    real(wp), intent(inout) :: gap(:)        !! (rows) [m] or a derivative
    if (.not. allocated(ev%rows%off)) return
    where (ev%rows%off) gap = 0.0_wp
  end subroutine leave_open

  !> What the multipliers of rows that are off miss of what they follow, instead of what the rows are open by.
  subroutine slip_gaps(m, ev, lambda, gap)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: lambda(:)        !! (rows) [N]
    real(wp), intent(inout) :: gap(:)        !! (rows) [m] or a derivative, [N] where off
    integer :: k, i
    do k = m%s%permanent + 1, size(m%s%constraints)
      associate (item => m%s%constraints(k)%item)
        i = item%first
        if (.not. ev%rows%off(i)) cycle
        gap(i) = -lambda(i)
        select type (row => item)
        class is (friction_model)
          gap(i) = row%force(ev%switches%state(row%switch_number), lambda) - lambda(i)
        end select
      end associate
    end do
  end subroutine slip_gaps

  !> How the multiplier of a row that is off follows those of up to two others.
  subroutine slip_slope(m, ev, k, lambda, reaction, slope)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: k                 !! the row's number among those that switch
    real(wp), intent(in) :: lambda(:)        !! (rows) [N]
    integer, intent(out) :: reaction(2)      !! those rows; 0: none
    real(wp), intent(out) :: slope(2)        !! [-]
    integer :: i
    reaction = 0
    slope = 0.0_wp
    select type (row => m%s%constraints(m%s%permanent + k)%item)
    class is (friction_model)
      reaction(1:row%joint_rows) = [(row%joint_first + i, i=0, row%joint_rows - 1)]
      slope(1:row%joint_rows) = row%force_slope(ev%switches%state(row%switch_number), lambda)
    end select
  end subroutine slip_slope
end module switched_rows
