!> Reader of &periodic, and what it asks of the transient that turns and follows.
module deck_periodic
  use errors, only: fault_list
  use text, only: quoted
  use deck_input, only: deck_source
  use deck_records, only: deck, periodic_record
  use deck_take, only: take
  implicit none (type, external)
  private
  public :: read_periodic, check_periodic

contains

  !> &periodic
  subroutine read_periodic(deck, c)
    class(deck_source), intent(inout) :: deck
    type(periodic_record), intent(inout) :: c
    call take(deck, c)
    c%free_period = deck%is_given('period_guess')
    if (c%free_period) c%period = c%period_guess
    c%own_tolerance = deck%is_given('tolerance')
  end subroutine read_periodic

  !> A turn is a run of the transient: methods and corrections whose map of one turn has other multipliers than the motion are
  !> refused.
  subroutine check_periodic(d, faults)
    type(deck), intent(in) :: d
    type(fault_list), intent(inout) :: faults
    if (.not. d%periodic%present) return
    if (.not. d%transient%present) then
      call d%periodic%at%blame(faults, 'a turn is a run of a transient, expected &transient with method and step')
    else if (d%transient%method == 'generalized_alpha') then
      call d%transient%at%blame(faults, 'the multipliers of method=''generalized_alpha'' have wrong phases beside &periodic, '// &
                                'expected ''rk4'', ''dopri5'' or ''radau''')
    else if (d%transient%stabilization /= 'projection') then
      call d%transient%at%blame(faults, 'stabilization='//quoted(trim(d%transient%stabilization))//' does not apply beside '// &
                                '&periodic, expected ''projection''')
    end if
  end subroutine check_periodic
end module deck_periodic
