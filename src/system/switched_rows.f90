!> Rows that switch, where they are off: they hold nothing, and their multipliers follow a law. Of friction, where it slips, the
!> multiplier is the friction force, a function of the joint's other multipliers (theory.md, section 13).
module switched_rows
  use kinds, only: wp
  use friction_law, only: force_of, row_slips
  use evaluation_results, only: conditions_of, evaluation
  use mechanism, only: mechanism_model
  use stops, only: stop_model
  implicit none (type, external)
  private
  public :: leave_open, slip_gaps, slip_slope, stop_slope

contains

  !> Sets the gaps of rows that are off to zero.
  pure subroutine leave_open(ev, gap)
    type(evaluation), intent(in) :: ev
    real(wp), intent(inout) :: gap(:)        !! (rows) [m] or a derivative
    if (.not. allocated(ev%rows%off)) return
    where (ev%rows%off) gap = 0.0_wp
  end subroutine leave_open

  !> For rows that are off: the error of their multipliers against the law that they follow, instead of their gaps.
  subroutine slip_gaps(m, ev, lambda, gap)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: lambda(:)        !! (rows) [N]
    real(wp), intent(inout) :: gap(:)        !! (rows) [m] or a derivative, [N] where off
    integer :: k
    if (.not. allocated(ev%rows%off)) return
    where (ev%rows%off) gap = -lambda
    do k = 1, size(m%s%friction)
      associate (law => m%s%friction(k))
        if (ev%rows%off(law%row)) gap(law%row) = force_of(law, ev%switches%state(law%number), lambda, ev%rows%pressed(law%row), &
                                                          ev%switches%event_value(law%number)) - lambda(law%row)
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
    reaction = 0
    slope = 0.0_wp
    if (k > size(m%s%friction)) return          ! a rigid stop
    associate (law => m%s%friction(k))
      if (law%element > 0) return            ! it follows the motion
      reaction = [law%first, merge(law%first + 1, 0, law%rows > 1)]
      slope = law%force_slope(ev%switches%state(law%number), lambda, ev%switches%event_value(law%number))
    end associate
  end subroutine slip_slope

  !> How the friction of a stop that slips follows the motion of the stop's markers (x, y, section angle of a, then of b).
  subroutine stop_slope(m, ev, k, by_place, by_rate)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: k                 !! its number among those with friction
    real(wp), intent(out) :: by_place(6)     !! [N/m], [N]
    real(wp), intent(out) :: by_rate(6)      !! [N s/m], [N s]
    real(wp) :: mu                           ! [-]
    by_place = 0.0_wp
    by_rate = 0.0_wp
    associate (law => m%s%friction(k))
      if (abs(ev%switches%state(law%number)) /= row_slips) return
      mu = sign(law%kinetic, real(ev%switches%state(law%number), wp))
      select type (stop => m%s%forces(law%element)%item)
      class is (stop_model)
        call stop%force_slopes(ev%p, conditions_of(m, ev, law%element), by_place, by_rate)
      end select
      by_place = mu*by_place
      by_rate = mu*by_rate
    end associate
  end subroutine stop_slope
end module switched_rows
