!> Numbers, logicals and free text from the open group. One call declares a variable: its name, where it goes, whether it is
!> required (`need`), its range, and the values of the group's selecting variable (`kind`, `type`, ...) to which it applies
!> (`kinds`, blanks between them; all where that is left out). The arguments of this name are the same in all modules of readers.
module deck_get
  use kinds, only: wp
  use text, only: lower, to_text, quoted
  use deck_input, only: deck_source
  use deck_numbers, only: read_real, read_integer, whole_number
  use expression, only: with_unit
  use deck_syntax, only: value_token, bare_value, string_value, null_value, expression_value
  implicit none (type, external)
  private
  public :: get, get_list, get_pair, same_length, check_form, counted

  !> Reads one value into a variable, which keeps its default where the group does not give it.
  interface get
    module procedure :: get_real, get_integer, get_logical, get_text
  end interface get

  !> Reads a list of any length; it has size 0 where the group does not give it or a value is faulty.
  interface get_list
    module procedure :: get_reals, get_integers
  end interface get_list

contains

  !> A real number.
  subroutine get_real(deck, name, x, need, above, least, most, below, kinds, hint)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: name
    real(wp), intent(inout) :: x                  !! receives the value [as the variable]
    logical, intent(in), optional :: need
    real(wp), intent(in), optional :: above, least, most, below   !! range: > above, >= least, <= most, < below [as the variable]
    character(*), intent(in), optional :: kinds
    character(*), intent(in), optional :: hint    !! what to do instead of the value 0, out of range
    character(:), allocatable :: range
    real(wp) :: value
    integer :: assignment
    logical :: good
    range = ''
    if (present(need)) range = range_text(name, above, least, most, below)
    call single_value(deck, name, need, kinds, range, assignment, good, '; decimals take a point')
    if (good) call real_of(deck, name, deck%token(assignment, 1), value, good)
    if (.not. good) return
    if (in_range(value, above, least, most, below)) then
      x = value
      call deck%mark_good(assignment)
    else
      range = range_text(name, above, least, most, below)
      if (present(hint) .and. abs(value) <= 0.0_wp) range = range//'; '//hint
      call out_of_range(deck, name, assignment, range)
    end if
  end subroutine get_real

  !> Two real numbers, a vector.
  subroutine get_pair(deck, name, x, need, kinds)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: name
    real(wp), intent(inout) :: x(2)               !! receives the values [as the variable]
    logical, intent(in), optional :: need
    character(*), intent(in), optional :: kinds
    real(wp) :: values(2)
    integer :: assignment, k
    logical :: good
    call deck%look_up(name, need, kinds, name//'=x,y', assignment)
    if (assignment == 0) return
    if (deck%values(assignment) /= 2) then
      call deck%complain(name, name//' has '//counted(deck%values(assignment))//', expected 2: '//name//'=x,y')
      return
    end if
    do k = 1, deck%tokens(assignment)
      call real_of(deck, name, deck%token(assignment, k), values(k), good)
      if (.not. good) return
    end do
    x = values(deck%expanded(assignment))
    call deck%mark_good(assignment)
  end subroutine get_pair

  !> A whole number.
  subroutine get_integer(deck, name, n, need, least, most, kinds, auto)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: name
    integer, intent(inout) :: n                   !! receives the value
    logical, intent(in), optional :: need
    real(wp), intent(in), optional :: least, most   !! range: >= least, <= most [-]
    character(*), intent(in), optional :: kinds
    logical, intent(out), optional :: auto        !! whether 'auto' stands there, where that may be; n is then left as it is
    character(:), allocatable :: range
    integer :: assignment, value
    logical :: good
    range = range_text(name, least=least, most=most)//' (a whole number)'
    if (present(auto)) range = range//' or ''auto'''
    call single_value(deck, name, need, kinds, range, assignment, good)
    if (present(auto)) auto = good .and. lower(deck%peek(name)) == 'auto'
    if (.not. good) return
    if (present(auto)) then
      if (auto) call deck%mark_good(assignment)
      if (auto) return
      good = len(deck%peek(name)) == 0
      if (.not. good) call deck%complain(name, name//'='//deck%written(deck%token(assignment, 1))//' is text, expected '//range)
    end if
    if (good) call integer_of(deck, name, deck%token(assignment, 1), value, good)
    if (.not. good) return
    if (in_range(real(value, wp), least=least, most=most)) then
      n = value
      call deck%mark_good(assignment)
    else
      call out_of_range(deck, name, assignment, range)
    end if
  end subroutine get_integer

  !> Real numbers, all in one range.
  subroutine get_reals(deck, name, x, need, above, kinds)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: name
    real(wp), allocatable, intent(out) :: x(:)          !! the values [as the variable]
    logical, intent(in), optional :: need
    real(wp), intent(in), optional :: above             !! every value must be greater [unit of the values]
    character(*), intent(in), optional :: kinds
    real(wp), allocatable :: values(:)
    integer :: assignment, k
    logical :: good
    allocate (x(0))
    call deck%look_up(name, need, kinds, name//'=number,number,...', assignment)
    if (assignment == 0) return
    allocate (values(deck%tokens(assignment)))
    do k = 1, size(values)
      call real_of(deck, name, deck%token(assignment, k), values(k), good)
      if (.not. good) return
      if (in_range(values(k), above)) cycle
      call deck%complain(name, name//' has the value '//deck%written(deck%token(assignment, k))//', expected every '// &
        range_text(name, above))
      return
    end do
    x = values(deck%expanded(assignment))
    call deck%mark_good(assignment)
  end subroutine get_reals

  !> Whole numbers.
  subroutine get_integers(deck, name, x, need, kinds)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: name
    integer, allocatable, intent(out) :: x(:)           !! the values
    logical, intent(in), optional :: need
    character(*), intent(in), optional :: kinds
    integer, allocatable :: values(:)
    integer :: assignment, k
    logical :: good
    allocate (x(0))
    call deck%look_up(name, need, kinds, name//'=number,number,... (whole numbers)', assignment)
    if (assignment == 0) return
    allocate (values(deck%tokens(assignment)))
    do k = 1, size(values)
      call integer_of(deck, name, deck%token(assignment, k), values(k), good)
      if (.not. good) return
    end do
    x = values(deck%expanded(assignment))
    call deck%mark_good(assignment)
  end subroutine get_integers

  !> Checks that two lists that belong together have equal lengths; silent where one of them is missing or faulty.
  subroutine same_length(deck, name, length, other, other_length)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: name           !! the first list
    integer, intent(in) :: length              !! its length
    character(*), intent(in) :: other          !! the other list
    integer, intent(in) :: other_length        !! its length
    if (.not. (deck%is_set(name) .and. deck%is_set(other)) .or. length == other_length) return
    call deck%complain(other, other//' has '//counted(other_length)//' and '//name//' '//to_text(length)// &
      ', expected equal numbers')
  end subroutine same_length

  !> A logical value.
  subroutine get_logical(deck, name, x, kinds)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: name
    logical, intent(inout) :: x                   !! receives the value
    character(*), intent(in), optional :: kinds
    integer :: assignment
    logical :: good
    call single_value(deck, name, .false., kinds, '.true. or .false.', assignment, good)
    if (good) call check_form(deck, name, deck%token(assignment, 1), bare_value, '.true. or .false.', good)
    if (.not. good) return
    select case (lower(deck%word(deck%token(assignment, 1))))
    case ('.true.', 'true', '.t.', 't')
      x = .true.
    case ('.false.', 'false', '.f.', 'f')
      x = .false.
    case default
      call check_word(deck, name, deck%token(assignment, 1), 'is not a logical value, expected .true. or .false.', good)
    end select
    if (good) call deck%mark_good(assignment)
  end subroutine get_logical

  !> Free text of any length without control characters.
  subroutine get_text(deck, name, t, need, kinds, expected)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: name
    character(:), allocatable, intent(inout) :: t       !! receives the value
    logical, intent(in), optional :: need
    character(*), intent(in), optional :: kinds
    character(*), intent(in), optional :: expected      !! what is expected where it is missing
    character(:), allocatable :: value, wanted
    integer :: assignment, i
    logical :: good
    wanted = name//'=''...'''
    if (present(expected)) wanted = expected
    call single_value(deck, name, need, kinds, wanted, assignment, good)
    if (good) call check_form(deck, name, deck%token(assignment, 1), string_value, 'text in quotes', good)
    if (.not. good) return
    value = deck%word(deck%token(assignment, 1))
    do i = 1, len(value)
      if ((iachar(value(i:i)) >= 32 .and. iachar(value(i:i)) /= 127) .or. iachar(value(i:i)) == 9) cycle
      call deck%complain(name, name//'='//deck%written(deck%token(assignment, 1))// &
        ' has a control character, expected plain text')
      return
    end do
    t = value
    call deck%mark_good(assignment)
  end subroutine get_text

  !> Declares a variable, and checks that it is given with one value.
  subroutine single_value(deck, name, need, kinds, wanted, assignment, good, hint)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: name
    logical, intent(in), optional :: need
    character(*), intent(in), optional :: kinds
    character(*), intent(in) :: wanted            !! what is expected where it is missing
    integer, intent(out) :: assignment            !! number of its assignment in the group, 0: nothing to read
    logical, intent(out) :: good
    character(*), intent(in), optional :: hint    !! added where two whole numbers stand, as in 1,5
    character(:), allocatable :: expected
    integer :: k
    call deck%look_up(name, need, kinds, wanted, assignment)
    good = .false.
    if (assignment == 0) return
    good = deck%values(assignment) == 1
    if (good) return
    expected = 'expected 1'
    if (present(hint) .and. deck%tokens(assignment) == 2) then
      if (all([(verify(deck%written(deck%token(assignment, k)), '+-0123456789') == 0, k=1, 2)])) expected = expected//hint
    end if
    if (deck%tokens(assignment) == 1) then
      associate (only => deck%token(assignment, 1))
        expected = expected//'; '//to_text(only%repeats)//'* is a repeat count, an expression stands in braces: {2*pi}'
      end associate
    end if
    call deck%complain(name, name//' has '//counted(deck%values(assignment))//', '//expected)
  end subroutine single_value

  !> Checks that a value is text in quotes, or a word without them, such as a number.
  subroutine check_form(deck, name, token, form, expected, good)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: name
    type(value_token), intent(in) :: token     !! the value
    integer, intent(in) :: form                !! string_value or bare_value
    character(*), intent(in) :: expected       !! what was expected
    logical, intent(out) :: good
    good = token%form == form
    if (good) return
    select case (token%form)
    case (string_value)
      call deck%complain(name, name//'='//deck%written(token)//' is text, expected '//expected//' without quotes')
    case (bare_value)
      call deck%complain(name, name//'='//deck%written(token)//' is not in quotes, expected '//name//'='// &
        quoted(deck%written(token)))
    case (expression_value)
      call deck%complain(name, name//'='//deck%written(token)//' is a number, expected '//expected//', without braces')
    case (null_value)
      call deck%complain(name, name//' has an empty value, expected '//expected)
    case default     ! reported already
    end select
  end subroutine check_form

  !> A real number from one value.
  subroutine real_of(deck, name, token, x, good)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: name
    type(value_token), intent(in) :: token     !! the value
    real(wp), intent(out) :: x                 !! 0 if it is not good [as the variable]
    logical, intent(out) :: good
    character(:), allocatable :: problem, braced
    x = token%number
    good = token%form == expression_value
    if (good) return
    call check_form(deck, name, token, bare_value, 'a number', good)
    if (.not. good) return
    call read_real(deck%word(token), x, problem)
    if (index(problem, ' 1.5e-3') > 0) then
      braced = with_unit(deck%word(token))
      problem = problem//' or {2*pi}'
      if (len(braced) > 0) problem = 'is not a number, expected '//braced
    end if
    call check_word(deck, name, token, problem, good)
  end subroutine real_of

  !> A whole number from one value.
  subroutine integer_of(deck, name, token, n, good)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: name
    type(value_token), intent(in) :: token     !! the value
    integer, intent(out) :: n                  !! 0 if it is not good
    logical, intent(out) :: good
    character(:), allocatable :: problem
    n = 0
    if (token%form == expression_value) then
      call whole_number(token%number, n, problem)
      if (len(problem) == 0) deck%parts%values(token%position)%number = n
    else
      call check_form(deck, name, token, bare_value, 'a whole number', good)
      if (.not. good) return
      call read_integer(deck%word(token), n, problem)
    end if
    call check_word(deck, name, token, problem, good)
  end subroutine integer_of

  !> Reports what is wrong with a value, if anything is.
  subroutine check_word(deck, name, token, problem, good)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: name
    type(value_token), intent(in) :: token     !! the value
    character(*), intent(in) :: problem        !! what is wrong, what was expected; empty: nothing
    logical, intent(out) :: good
    good = len(problem) == 0
    if (.not. good) call deck%complain(name, name//'='//deck%written(token)//' '//problem)
  end subroutine check_word

  !> Reports a value out of its range.
  subroutine out_of_range(deck, name, assignment, range)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: name
    integer, intent(in) :: assignment        !! number of the assignment in the group
    character(*), intent(in) :: range   !! what was expected
    call deck%complain(name, name//'='//deck%written(deck%token(assignment, 1))//' is out of range, expected '//range)
  end subroutine out_of_range

  !> A number of values in words.
  pure function counted(n) result(t)
    integer, intent(in) :: n
    character(:), allocatable :: t
    t = to_text(n)//' values'
    if (n == 1) t = '1 value'
  end function counted

  !> Whether a number lies in a range.
  pure logical function in_range(x, above, least, most, below) result(yes)
    real(wp), intent(in) :: x                  !! [as the variable]
    real(wp), intent(in), optional :: above, least, most, below   !! range: > above, >= least, <= most, < below [as the variable]
    yes = .true.
    if (present(above)) yes = x > above
    if (present(least)) yes = yes .and. x >= least
    if (present(most)) yes = yes .and. x <= most
    if (present(below)) yes = yes .and. x < below
  end function in_range

  !> A range in words: `density > 0`, `0 < tolerance < 1`, `spectral_radius from 0 to 0.99`; no other combinations.
  pure function range_text(name, above, least, most, below) result(t)
    character(*), intent(in) :: name
    real(wp), intent(in), optional :: above, least, most, below   !! range: > above, >= least, <= most, < below [as the variable]
    character(:), allocatable :: t
    t = name
    if (present(above)) t = t//' > '//to_text(above)
    if (present(least)) t = t//' >= '//to_text(least)
    if (present(above) .and. present(below)) t = to_text(above)//' < '//name//' < '//to_text(below)
    if (present(least) .and. present(most)) t = name//' from '//to_text(least)//' to '//to_text(most)
    if (t == name) t = name//'=number'
  end function range_text
end module deck_get
