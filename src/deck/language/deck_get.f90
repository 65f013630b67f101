!> Numbers, logicals and free text from the open group. One call reads one row of the table of keys into a variable, which keeps its
!> default where the group does not give the key.
module deck_get
  use kinds, only: wp
  use text, only: either, lower, to_text, quoted
  use deck_input, only: deck_source
  use deck_key, only: expectation, in_range, is_whole, range_text
  use deck_keys, only: keys
  use deck_numbers, only: read_integer, read_logical, read_real, whole_number
  use expression, only: with_unit
  use deck_syntax, only: value_token, bare_value, string_value, null_value, expression_value
  implicit none (type, external)
  private
  public :: get, get_auto, get_list, get_pair, check_form, fault, counted

  !> Reads one value.
  interface get
    module procedure :: get_real, get_integer, get_logical, get_text
  end interface get

  !> Reads a list of any length; it has size 0 where the group does not give it or a value is faulty.
  interface get_list
    module procedure :: get_reals, get_integers
  end interface get_list

contains

  !> A real number.
  subroutine get_real(deck, row, x)
    class(deck_source), intent(inout) :: deck
    integer, intent(in) :: row                    !! of the key in the table
    real(wp), intent(inout) :: x                  !! receives the value [as the key]
    real(wp) :: value
    integer :: assignment
    logical :: good
    call single_value(deck, row, assignment, good)
    if (good) call number_of(deck, row, deck%token(assignment, 1), value, good)
    if (.not. good) return
    if (in_range(keys(row), value)) then
      x = value
      call deck%mark_good(assignment)
    else
      call fault(deck, row, '='//deck%written(deck%token(assignment, 1))//' is out of range, expected '//expectation(keys(row))// &
        either('; '//trim(keys(row)%instead), '', keys(row)%instead /= '' .and. abs(value) <= 0.0_wp))
    end if
  end subroutine get_real

  !> Two real numbers, a vector.
  subroutine get_pair(deck, row, x)
    class(deck_source), intent(inout) :: deck
    integer, intent(in) :: row                    !! of the key in the table
    real(wp), intent(inout) :: x(2)               !! receives the values [as the key]
    real(wp), allocatable :: values(:)
    call get_reals(deck, row, values)
    if (size(values) == 2) x = values
  end subroutine get_pair

  !> A whole number.
  subroutine get_integer(deck, row, n)
    class(deck_source), intent(inout) :: deck
    integer, intent(in) :: row                    !! of the key in the table
    integer, intent(inout) :: n                   !! receives the value
    real(wp) :: x
    x = n
    call get_real(deck, row, x)
    n = nint(x)
  end subroutine get_integer

  !> A whole number, or 'auto': the number is then left as it is.
  subroutine get_auto(deck, row, n, auto)
    class(deck_source), intent(inout) :: deck
    integer, intent(in) :: row                    !! of the key in the table
    integer, intent(inout) :: n                   !! receives the value
    logical, intent(out) :: auto                  !! whether 'auto' stands there
    integer :: assignment
    logical :: good
    auto = lower(deck%peek(keys(row)%name)) == 'auto'
    if (len(deck%peek(keys(row)%name)) == 0) then
      call get_integer(deck, row, n)
      return
    end if
    call single_value(deck, row, assignment, good)
    if (good .and. auto) call deck%mark_good(assignment)
    auto = auto .and. good
    if (good .and. .not. auto) call check_word(deck, row, deck%token(assignment, 1), 'is text, expected '// &
      expectation(keys(row)), good)
  end subroutine get_auto

  !> Numbers, all in one range; as many as may be, or the two of a vector.
  subroutine get_reals(deck, row, x)
    class(deck_source), intent(inout) :: deck
    integer, intent(in) :: row                          !! of the key in the table
    real(wp), allocatable, intent(out) :: x(:)          !! the values, size 0 if not given or faulty [as the key]
    real(wp), allocatable :: values(:)
    integer :: assignment, k
    logical :: good
    allocate (x(0))
    call deck%look_up(row, assignment)
    if (assignment == 0) return
    if (keys(row)%type == 'pair' .and. deck%tokens(assignment) /= 2) then
      call fault(deck, row, ' has '//counted(deck%tokens(assignment))//', expected 2: '//expectation(keys(row)))
      return
    end if
    allocate (values(deck%tokens(assignment)))
    do k = 1, size(values)
      call number_of(deck, row, deck%token(assignment, k), values(k), good)
      if (.not. good) return
      if (in_range(keys(row), values(k))) cycle
      call fault(deck, row, ' has the value '//deck%written(deck%token(assignment, k))//', expected every '//range_text(keys(row)))
      return
    end do
    call move_alloc(values, x)
    call deck%mark_good(assignment)
  end subroutine get_reals

  !> Whole numbers.
  subroutine get_integers(deck, row, n)
    class(deck_source), intent(inout) :: deck
    integer, intent(in) :: row                          !! of the key in the table
    integer, allocatable, intent(out) :: n(:)           !! the values, size 0 if not given or faulty
    real(wp), allocatable :: x(:)
    call get_reals(deck, row, x)
    n = nint(x)
  end subroutine get_integers

  !> A logical value.
  subroutine get_logical(deck, row, x)
    class(deck_source), intent(inout) :: deck
    integer, intent(in) :: row                    !! of the key in the table
    logical, intent(inout) :: x                   !! receives the value
    integer :: assignment
    logical :: good
    call single_value(deck, row, assignment, good)
    if (good) call check_form(deck, row, deck%token(assignment, 1), bare_value, expectation(keys(row)), good)
    if (.not. good) return
    call read_logical(deck%word(deck%token(assignment, 1)), x, good)
    if (.not. good) call check_word(deck, row, deck%token(assignment, 1), 'is not a logical value, expected '// &
      expectation(keys(row)), good)
    if (good) call deck%mark_good(assignment)
  end subroutine get_logical

  !> Free text of any length without control characters.
  subroutine get_text(deck, row, t)
    class(deck_source), intent(inout) :: deck
    integer, intent(in) :: row                          !! of the key in the table
    character(:), allocatable, intent(inout) :: t       !! receives the value
    character(:), allocatable :: value
    integer :: assignment, i
    logical :: good
    call single_value(deck, row, assignment, good)
    if (good) call check_form(deck, row, deck%token(assignment, 1), string_value, 'text in quotes', good)
    if (.not. good) return
    value = deck%word(deck%token(assignment, 1))
    do i = 1, len(value)
      if ((iachar(value(i:i)) >= 32 .and. iachar(value(i:i)) /= 127) .or. iachar(value(i:i)) == 9) cycle
      call check_word(deck, row, deck%token(assignment, 1), 'has a control character, expected plain text', good)
      return
    end do
    t = value
    call deck%mark_good(assignment)
  end subroutine get_text

  !> Finds the one value of a key.
  subroutine single_value(deck, row, assignment, good)
    class(deck_source), intent(inout) :: deck
    integer, intent(in) :: row                    !! of the key in the table
    integer, intent(out) :: assignment            !! number of its assignment in the group, 0: nothing to read
    logical, intent(out) :: good
    character(:), allocatable :: expected
    integer :: k
    call deck%look_up(row, assignment)
    good = .false.
    if (assignment == 0) return
    good = deck%tokens(assignment) == 1
    if (good) return
    expected = 'expected 1'
    associate (first => deck%token(assignment, 1), n => deck%tokens(assignment))
      if (first%repeats == n) then
        expected = expected//'; '//to_text(n)//'* is a repeat count, an expression stands in braces: {2*pi}'
      else if (keys(row)%type == 'real' .and. n == 2) then       ! as in 1,5
        if (all([(verify(deck%written(deck%token(assignment, k)), '+-0123456789') == 0, k=1, 2)])) expected = expected// &
          '; decimals take a point'
      end if
      call fault(deck, row, ' has '//counted(n)//', '//expected)
    end associate
  end subroutine single_value

  !> Checks that a value is text in quotes, or a word without them, such as a number.
  subroutine check_form(deck, row, token, form, expected, good)
    class(deck_source), intent(inout) :: deck
    integer, intent(in) :: row                 !! of the key in the table
    type(value_token), intent(in) :: token     !! the value
    integer, intent(in) :: form                !! string_value or bare_value
    character(*), intent(in) :: expected       !! what was expected
    logical, intent(out) :: good
    good = token%form == form
    if (good) return
    select case (token%form)
    case (string_value)
      call fault(deck, row, '='//deck%written(token)//' is text, expected '//expected//' without quotes')
    case (bare_value)
      call fault(deck, row, '='//deck%written(token)//' is not in quotes, expected '//trim(keys(row)%name)//'='// &
        quoted(deck%written(token)))
    case (expression_value)
      call fault(deck, row, '='//deck%written(token)//' is a number, expected '//expected//', without braces')
    case (null_value)
      call fault(deck, row, ' has an empty value, expected '//expected)
    case default     ! reported already
    end select
  end subroutine check_form

  !> A number from one value: a whole one where the key takes such.
  subroutine number_of(deck, row, token, x, good)
    class(deck_source), intent(inout) :: deck
    integer, intent(in) :: row                 !! of the key in the table
    type(value_token), intent(in) :: token     !! the value
    real(wp), intent(out) :: x                 !! [as the key]
    logical, intent(out) :: good
    character(:), allocatable :: problem, braced
    integer :: n
    x = token%number
    good = token%form == expression_value
    if (good .and. .not. is_whole(keys(row))) return
    n = 0
    problem = ''
    if (good) then
      call whole_number(token%number, n, problem)
      if (len(problem) == 0) deck%parts%values(token%position)%number = n
    else if (is_whole(keys(row))) then
      call check_form(deck, row, token, bare_value, 'a whole number', good)
      if (good) call read_integer(deck%word(token), n, problem)
    else
      call check_form(deck, row, token, bare_value, 'a number', good)
      if (good) call read_real(deck%word(token), x, problem)
      if (index(problem, ' 1.5e-3') > 0) then
        braced = with_unit(deck%word(token))
        problem = problem//' or {2*pi}'
        if (len(braced) > 0) problem = 'is not a number, expected '//braced
      end if
    end if
    if (is_whole(keys(row))) x = n
    if (good) call check_word(deck, row, token, problem, good)
  end subroutine number_of

  !> Reports what is wrong with a value, if anything is.
  subroutine check_word(deck, row, token, problem, good)
    class(deck_source), intent(inout) :: deck
    integer, intent(in) :: row                 !! of the key in the table
    type(value_token), intent(in) :: token     !! the value
    character(*), intent(in) :: problem        !! what is wrong, what was expected; empty: nothing
    logical, intent(out) :: good
    good = len(problem) == 0
    if (.not. good) call fault(deck, row, '='//deck%written(token)//' '//problem)
  end subroutine check_word

  !> Reports a fault of a key.
  subroutine fault(deck, row, message)
    class(deck_source), intent(inout) :: deck
    integer, intent(in) :: row                 !! of the key in the table
    character(*), intent(in) :: message        !! what is wrong, what was expected; the key's name stands before it
    call deck%complain(trim(keys(row)%name), trim(keys(row)%name)//message)
  end subroutine fault

  !> A number of values in words.
  pure function counted(n) result(t)
    integer, intent(in) :: n
    character(:), allocatable :: t
    t = to_text(n)//' values'
    if (n == 1) t = '1 value'
  end function counted

end module deck_get
