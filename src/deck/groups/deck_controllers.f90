!> Reader of &controller.
module deck_controllers
  use kinds, only: wp
  use deck_columns, only: find_column
  use deck_input, only: deck_source
  use deck_records, only: controller_record, deck_record => deck
  use deck_take, only: take
  implicit none (type, external)
  private
  public :: read_controller, check_controllers

contains

  !> &controller
  subroutine read_controller(deck, r)
    class(deck_source), intent(inout) :: deck
    type(controller_record), intent(inout) :: r
    call take(deck, r)
    if (deck%is_set('filter') .and. r%filter > 0.0_wp .and. .not. deck%is_given('kd')) call deck%complain('filter', &
      'filter is that of the derivative, expected kd')
  end subroutine read_controller

  !> What needs all records: columns that are sensed, derivatives of rates, analyses that cannot have samples.
  subroutine check_controllers(d, deck)
    type(deck_record), intent(inout) :: d         !! all groups are read
    class(deck_source), intent(inout) :: deck
    integer :: k
    do k = 1, size(d%controllers)
      associate (r => d%controllers(k))
        call find_column(d, r%at, 'argument', r%argument, deck%faults)
        if (r%argument%number > 0 .and. abs(r%kd) > 0.0_wp .and. .not. r%filter > 0.0_wp) then
          if (any(d%sensors(r%argument%sensor)%quantity == [character(20) :: 'velocity', 'angular_velocity']) .or. &
              r%argument%suffix == '.qd') call r%at%blame(deck%faults, 'kd of a rate needs accelerations, which follow from '// &
                                                    'the forces themselves, expected filter > 0 (s), or the position as argument')
        end if
        if (r%sample > 0.0_wp .and. (d%modal%present .or. d%response%present)) call r%at%blame(deck%faults, 'sample holds the '// &
          'output, and what is held has no poles; expected no sample in a deck with &modal or &frequency_response, or '// &
          'delay=sample/2 in its place')
      end associate
    end do
  end subroutine check_controllers
end module deck_controllers
