!> A deck as groups of values, as JSON: for programs that want numbers and words.
module deck_json
  use kinds, only: wp
  use growing_text, only: text_buffer
  use readable_text, only: json_text
  use summary_text, only: json_number
  use text, only: either, to_text
  use deck_cursor, only: group_cursor
  use deck_lexer, only: split_groups
  use deck_numbers, only: read_integer, read_logical, read_real
  use deck_syntax, only: string_value, value_token
  implicit none (type, external)
  private
  public :: groups_json

contains

  !> A list of objects, one a group: `group`, its kind, and each of its keys with a list of values.
  function groups_json(flat) result(text)
    character(*), intent(in) :: flat           !! the deck as `flat_text` gives it
    character(:), allocatable :: text
    type(group_cursor) :: deck
    type(text_buffer) :: json
    integer :: a, k, n                         ! assignment, group, value
    call deck%parts%add_source('', flat, 0, '')
    call split_groups(deck, 1)
    call json%add('[')
    do k = 1, deck%parts%group_count
      call deck%enter(k)
      call json%add(either('', ', ', k == 1)//'{"group": '//json_text(deck%group_word(k)))
      do a = 1, deck%count
        call json%add(', '//json_text(trim(deck%parts%assignments(deck%head + a)%name))//': [')
        do n = 1, deck%tokens(a)
          call json%add(either('', ', ', n == 1)//value_text(deck, deck%token(a, n)))
        end do
        call json%add(']')
      end do
      call json%add('}')
    end do
    call json%add(']')
    text = json%all()
  end function groups_json

  !> One value.
  function value_text(deck, token) result(text)
    class(group_cursor), intent(in) :: deck
    type(value_token), intent(in) :: token
    character(:), allocatable :: text, problem
    real(wp) :: x                              ! [as the value]
    integer :: n
    logical :: yes, known
    text = deck%word(token)
    n = 0
    x = 0.0_wp
    yes = .false.
    call read_integer(text, n, problem)
    known = .false.
    if (token%form /= string_value) call read_logical(text, yes, known)
    if (token%form == string_value) then
      text = json_text(text)
    else if (known) then
      text = either('true', 'false', yes)
    else if (len(problem) == 0) then
      text = to_text(n)
    else
      call read_real(text, x, problem)           ! a deck without faults has no other values
      text = json_number(x)
    end if
  end function value_text
end module deck_json
