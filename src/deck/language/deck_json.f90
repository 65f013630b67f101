!> A deck as groups of values, as JSON: for programs that want numbers and words. Expressions have their values, names the prefix of
!> their part, tables their whole path.
module deck_json
  use kinds, only: wp
  use growing_text, only: text_buffer
  use readable_text, only: json_text
  use summary_text, only: json_number
  use text, only: lower, to_text
  use deck_cursor, only: group_cursor
  use deck_flat, only: number_text, table_path
  use deck_keys, only: in_parameter
  use deck_numbers, only: read_integer, read_real
  use deck_syntax, only: bad_value, expression_value, null_value, string_value, value_token
  implicit none (type, external)
  private
  public :: groups_json

contains

  !> A list of objects, one a group: `group`, its kind, and each of its keys with a list of values. The deck has no faults.
  function groups_json(deck, list, parameters) result(text)
    class(group_cursor), intent(inout) :: deck
    integer, intent(in) :: list(:)             !! the groups, in their order
    real(wp), intent(in) :: parameters(:)      !! values of its parameters [any]
    character(:), allocatable :: text, key
    type(text_buffer) :: json
    integer, allocatable :: values(:)
    integer :: a, k, n, number                 ! assignment, group, value, parameters so far
    number = 0
    call json%add('[')
    do k = 1, size(list)
      deck%current = list(k)
      deck%head = deck%parts%groups(list(k))%first_assignment - 1
      deck%count = deck%parts%groups(list(k))%assignments
      if (k > 1) call json%add(', ')
      call json%add('{"group": '//json_text(deck%group_word(list(k))))
      if (deck%parts%groups(list(k))%kind == in_parameter) number = number + 1
      do a = 1, deck%count
        key = trim(deck%parts%assignments(deck%head + a)%name)
        call json%add(', '//json_text(key)//': [')
        values = deck%expanded(a)
        do n = 1, size(values)
          if (n > 1) call json%add(', ')
          if (deck%parts%groups(list(k))%kind == in_parameter .and. key == 'value') then
            call json%add(number_text(parameters(number)))
          else
            call json%add(value_text(deck, key, deck%token(a, values(n))))
          end if
        end do
        call json%add(']')
      end do
      call json%add('}')
    end do
    call json%add(']')
    text = json%all()
  end function groups_json

  !> One value.
  function value_text(deck, key, token) result(text)
    class(group_cursor), intent(in) :: deck
    character(*), intent(in) :: key            !! for which it stands
    type(value_token), intent(in) :: token
    character(:), allocatable :: text, problem
    real(wp) :: x                              ! [as the value]
    integer :: n
    select case (token%form)
    case (expression_value)
      text = number_text(token%number)
    case (null_value, bad_value)
      text = 'null'
    case (string_value)
      text = deck%word(token)
      if (token%part > 0) text = deck%parts%sources(token%part)%prefix//text
      if (key == 'file') text = table_path(deck%parts%sources(deck%file())%path, text)
      text = json_text(text)
    case default
      text = deck%raw(token%first, token%last)
      n = 0
      call read_integer(text, n, problem)
      if (len(problem) == 0) then
        text = to_text(n)
        return
      end if
      x = 0.0_wp
      call read_real(text, x, problem)
      if (len(problem) == 0) then
        text = json_number(x)
      else if (scan(lower(text(1:min(2, len(text)))), 'tf') > 0 .and. (text(1:1) == '.' .or. len(text) == 1)) then
        text = merge('true ', 'false', scan(lower(text(1:min(2, len(text)))), 't') > 0)
      else
        text = json_text(text)
      end if
    end select
  end function value_text
end module deck_json
