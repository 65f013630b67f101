!> Readers of &history and &force.
module deck_loads
  use kinds, only: wp
  use text, only: to_text
  use deck_input, only: deck_source, required
  use deck_get, only: get, get_pair
  use deck_lists, only: get_list, same_length
  use deck_words, only: get_name, get_choice, get_word, get_reference
  use deck_kinds, only: in_history
  use deck_place, only: read_place, forbid_ground
  use deck_records, only: deck_record => deck, history_record, force_record
  implicit none (type, external)
  private
  public :: read_history, read_force

contains

  !> &history
  subroutine read_history(deck, h)
    class(deck_source), intent(inout) :: deck
    type(history_record), intent(inout) :: h
    h%at = deck%at()
    call get_name(deck, h%name)
    h%kind = 'polynomial'
    call get_choice(deck, 'kind', h%kind, [character(10) :: 'polynomial', 'sine', 'ramp', 'cycloid', 'table', 'pulse'])
    call get_list(deck, 'coefficients', h%coefficients, required, kinds='polynomial')
    call get(deck, 'offset', h%offset, kinds='sine')
    call get(deck, 'amplitude', h%amplitude, required, kinds='sine')
    call get(deck, 'frequency', h%frequency, required, least=0.0_wp, kinds='sine')
    call get(deck, 'phase', h%phase, kinds='sine')
    call get(deck, 'start_value', h%start_value, required, kinds='ramp cycloid')
    call get(deck, 'end_value', h%end_value, required, kinds='ramp cycloid')
    call get(deck, 'start', h%start, required, kinds='ramp cycloid pulse')
    call get(deck, 'finish', h%finish, required, kinds='ramp cycloid pulse')
    call get_list(deck, 'time', h%time, required, kinds='table')
    call get_list(deck, 'value', h%values, required, kinds='table')
    if (deck%choice_is_known() .and. .not. deck%is_choice('table')) then
      call get(deck, 'value', h%value, required, kinds='pulse')
    end if
    if (deck%is_set('start') .and. deck%is_set('finish') .and. h%finish <= h%start) call deck%complain('finish', &
      'finish='//to_text(h%finish)//' is not later than start='//to_text(h%start)//', expected finish > start')
    call check_table(deck, h)
  end subroutine read_history

  !> A table needs two points or more, in order of time.
  subroutine check_table(deck, h)
    class(deck_source), intent(inout) :: deck
    type(history_record), intent(in) :: h
    integer :: k
    if (.not. deck%is_choice('table')) return
    call same_length(deck, 'time', size(h%time), 'value', size(h%values))
    if (.not. deck%is_set('time')) return
    if (size(h%time) < 2) call deck%complain('time', 'time has 1 value, expected at least 2')
    do k = 2, size(h%time)
      if (h%time(k) > h%time(k - 1)) cycle
      call deck%complain('time', 'time is not ordered: value '//to_text(k)//', '//to_text(h%time(k))// &
        ', is not later than value '//to_text(k - 1)//', '//to_text(h%time(k - 1))//', expected increasing times')
      return
    end do
  end subroutine check_table

  !> &force
  subroutine read_force(deck, d, f)
    class(deck_source), intent(inout) :: deck
    type(deck_record), intent(in) :: d            !! its bodies and histories are read
    type(force_record), intent(inout) :: f
    f%at = deck%at()
    call get_name(deck, f%name)
    f%type = 'force'
    call get_choice(deck, 'type', f%type, [character(12) :: 'force', 'torque', 'torque_about'])
    call read_place(deck, d, '', f%place, required, point_kinds='force torque_about', frame_kinds='torque')
    call forbid_ground(deck, 'body', f%place%body, 'does not move, no load acts on it')
    call get(deck, 'fx', f%fx, kinds='force')
    call get(deck, 'fy', f%fy, kinds='force')
    call get_word(deck, 'axes', f%axes, [character(7) :: 'global', 'body', 'section'], kinds='force')
    call get(deck, 'moment', f%moment, required, kinds='torque torque_about')
    call get_pair(deck, 'centre', f%centre, required, kinds='torque_about')
    call get_reference(deck, 'history', in_history, f%history)
    call get_word(deck, 'stage', f%stage, [character(9) :: 'all', 'static', 'transient'])
  end subroutine read_force
end module deck_loads
