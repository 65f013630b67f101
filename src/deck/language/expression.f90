!> Values of expressions such as `(L/2 + 3*mm)*cos(30*deg)`: + - * / ^ (or **), parentheses, functions, constants, and names whose
!> values the caller gives. Powers bind first, from the right; then signs, products, sums. No operation can overflow: results are
!> 0 or from 1e-150 to 1e150 in size, smaller ones count as 0.
module expression
  use kinds, only: wp, pi
  use readable_text, only: printable
  use text, only: digits, either, joined, letters, lower, nearest_word, to_text
  use deck_numbers, only: read_real
  use deck_origin, only: name_length
  implicit none (type, external)
  private
  public :: evaluate, find_names, is_name, is_reserved, with_unit

  integer, parameter, public :: name_letters = name_length + 1   !! so that a longer name is not taken for another one
  integer, parameter :: longest = 1000                  !! characters of an expression
  integer, parameter :: decades = 150                   !! of results

  character(5), parameter :: functions(13) = [character(5) :: 'sin', 'cos', 'tan', 'asin', 'acos', 'atan', 'atan2', 'sqrt', &
    'exp', 'log', 'abs', 'min', 'max']
  character(3), parameter, public :: constants(10) = [character(3) :: 'pi', 'deg', 'rpm', 'mm', 'um', 'ms', 'us', 'kn', 'mpa', &
    'gpa']
  real(wp), parameter :: constant_values(10) = [pi, pi/180.0_wp, pi/30.0_wp, 1.0e-3_wp, 1.0e-6_wp, 1.0e-3_wp, 1.0e-6_wp, &
    1.0e3_wp, 1.0e6_wp, 1.0e9_wp]                       !! SI [-]

  !> A word or sign of an expression.
  type :: symbol
    integer :: first = 1          !! first character
    integer :: last = 0           !! last character
    character(1) :: kind = ' '    !! blank: the end; 1: a number; a: a name; ^: a power; any other character as it is
  end type symbol

contains

  !> The next word or sign behind another one.
  pure type(symbol) function next_symbol(text, before) result(s)
    character(*), intent(in) :: text
    type(symbol), intent(in) :: before
    character(:), allocatable :: rest
    integer :: n
    n = verify(text(before%last + 1:), ' '//achar(9))
    s%first = before%last + max(1, n)
    s%last = len(text)
    if (n == 0) return      ! the end
    rest = lower(text(s%first:))
    s%kind = rest(1:1)
    n = 1
    if (scan(rest(1:1), digits//'.') > 0) then
      s%kind = '1'
      n = verify(rest//' ', digits//'.') - 1
      if (scan(rest(n + 1:min(n + 1, len(rest))), 'ed') > 0) n = n + exponent_length(rest(n + 1:))
    else if (scan(rest(1:1), letters) > 0) then
      s%kind = 'a'
      n = verify(rest//' ', letters//digits//'_') - 1
    else if (index(rest, '**') == 1) then
      s%kind = '^'
      n = 2
    end if
    s%last = s%first + n - 1
  end function next_symbol

  !> Characters of the exponent of a number, `e-3`; 0: it is none.
  pure integer function exponent_length(rest) result(n)
    character(*), intent(in) :: rest    !! begins with e or d
    integer :: sign
    sign = 0
    if (len(rest) > 1) sign = scan(rest(2:2), '+-')
    n = verify(rest(2 + sign:)//' ', digits) - 1
    if (n > 0) n = n + 1 + sign
  end function exponent_length

  !> The names in an expression that are neither constants nor functions, in lower case, each as often as it stands there.
  !> Text in quotes, a fault of its own, has none.
  pure subroutine find_names(text, names)
    character(*), intent(in) :: text
    character(name_letters), allocatable, intent(out) :: names(:)   !! a longer one is cut: no parameter has it
    character(name_letters) :: name
    type(symbol) :: now, next
    allocate (names(0))
    if (len(text) > longest) return
    now = next_symbol(text, symbol())
    do while (scan(now%kind, ' ''"') == 0)
      next = next_symbol(text, now)
      name = lower(text(now%first:now%last))
      if (now%kind == 'a' .and. next%kind /= '(' .and. .not. is_reserved(text(now%first:now%last))) then
        names = [character(name_letters) :: names, name]   ! the checked build takes an empty list for one of other letters
      end if
      now = next
    end do
  end subroutine find_names

  !> Whether a word may be a name in expressions: a letter, then letters, digits and _.
  pure logical function is_name(word) result(yes)
    character(*), intent(in) :: word     !! any case
    yes = scan(lower(word(:min(1, len(word)))), letters) == 1 .and. verify(lower(word), letters//digits//'_') == 0
  end function is_name

  !> Whether a word is a constant or a function of expressions.
  pure logical function is_reserved(word) result(yes)
    character(*), intent(in) :: word     !! any case
    yes = any(functions == lower(word)) .or. any(constants == lower(word))
  end function is_reserved

  !> A number with a unit behind it as an expression, {20*mm} for 20mm; empty for any other word.
  pure function with_unit(word) result(text)
    character(*), intent(in) :: word
    character(:), allocatable :: text, problem
    real(wp) :: x                        ! the number [any]
    integer :: k, n
    text = ''
    x = 0.0_wp
    do k = 1, size(constants)
      n = len(word) - len_trim(constants(k))
      if (n < 1) cycle
      call read_real(word(:n), x, problem)
      if (len(problem) == 0 .and. lower(word(n + 1:)) == constants(k)) text = '{'//word(:n)//'*'//word(n + 1:)//'}'
    end do
  end function with_unit

  !> Value of an expression. `problem` is empty if it has one, else it says what is wrong and what was expected.
  subroutine evaluate(text, names, values, x, problem)
    character(*), intent(in) :: text
    character(*), intent(in) :: names(:)                 !! its names, lower case
    real(wp), intent(in) :: values(:)                    !! and their values [any]
    real(wp), intent(out) :: x                           !! 0 where there is a problem [any]
    character(:), allocatable, intent(out) :: problem
    type(symbol) :: now
    problem = ''
    x = 0.0_wp
    if (len(text) > longest) then
      problem = 'is longer than '//to_text(longest)//' characters, expected a shorter one: its parts may be parameters'
      return
    end if
    now = next_symbol(text, symbol())
    if (now%kind == ' ') problem = 'is empty, expected a number or an expression such as 2*pi'
    call read_sum(x)
    if (now%kind /= ' ') call fail('has '//shown()//' where an operator is due, expected one of + - * / ^')
    if (len(problem) > 0) x = 0.0_wp
  contains
    !> The word or sign at which the reader stands.
    function shown()
      character(:), allocatable :: shown
      shown = printable(text(now%first:now%last), 40)
      if (iachar(text(now%first:now%first)) > 127) shown = 'a letter outside ASCII'
    end function shown

    !> Notes the first problem.
    subroutine fail(what)
      character(*), intent(in) :: what
      if (len(problem) == 0) problem = what
    end subroutine fail

    !> Sums and differences, from the left. The length of the text bounds how deep it is nested.
    recursive subroutine read_sum(x)
      real(wp), intent(out) :: x     !! [any]
      real(wp) :: y
      character(1) :: sign
      call read_product(x)
      do while (len(problem) == 0 .and. scan(now%kind, '+-') > 0)
        sign = now%kind
        now = next_symbol(text, now)
        call read_product(y)
        if (len(problem) == 0) call bound(x + merge(y, -y, sign == '+'), x)
      end do
    end subroutine read_sum

    !> Products and quotients, from the left.
    recursive subroutine read_product(x)
      real(wp), intent(out) :: x     !! [any]
      real(wp) :: y
      character(1) :: sign
      call read_signed(x)
      do while (len(problem) == 0 .and. scan(now%kind, '*/') > 0)
        sign = now%kind
        now = next_symbol(text, now)
        call read_signed(y)
        if (len(problem) > 0) return
        if (sign == '*') then
          call bound(x*y, x)
        else if (abs(y) > 0.0_wp) then
          call bound(x/y, x)
        else
          call fail('divides by 0, expected another divisor')
        end if
      end do
    end subroutine read_product

    !> A power with its signs.
    recursive subroutine read_signed(x)
      real(wp), intent(out) :: x     !! [any]
      character(1) :: sign
      if (scan(now%kind, '+-') > 0) then
        sign = now%kind
        now = next_symbol(text, now)
        call read_signed(x)
        if (sign == '-') x = -x
      else
        call read_power(x)
      end if
    end subroutine read_signed

    !> A power, from the right: 2^3^2 = 2^9.
    recursive subroutine read_power(x)
      real(wp), intent(out) :: x     !! [any]
      real(wp) :: y
      call read_operand(x)
      if (len(problem) > 0 .or. now%kind /= '^') return
      now = next_symbol(text, now)
      call read_signed(y)
      if (len(problem) == 0) call raise(x, y)
    end subroutine read_power

    !> x to the power y.
    subroutine raise(x, y)
      real(wp), intent(inout) :: x   !! [any]
      real(wp), intent(in) :: y      !! [-]
      logical :: negative
      if (.not. abs(x) > 0.0_wp) then
        if (y < 0.0_wp) call fail('divides by 0 (0 to the power '//to_text(y)//'), expected a power >= 0')
        x = merge(0.0_wp, 1.0_wp, abs(y) > 0.0_wp)
        return
      end if
      negative = x < 0.0_wp
      if (negative .and. abs(y - anint(y)) > 0.0_wp) call fail('raises '//to_text(x)//' to the power '//to_text(y)// &
        ', expected a whole power of a negative number')
      if (abs(y*log10(abs(x))) <= real(decades, wp)) then
        x = abs(x)**y
        if (negative .and. modulo(y, 2.0_wp) > 0.5_wp) x = -x
      else if (y*log10(abs(x)) < 0.0_wp) then
        x = 0.0_wp
      else
        call too_large()
      end if
    end subroutine raise

    !> A number, a name, a function or an expression in parentheses.
    recursive subroutine read_operand(x)
      real(wp), intent(out) :: x     !! [any]
      type(symbol) :: name
      x = 0.0_wp
      select case (now%kind)
      case ('1')
        call read_real(text(now%first:now%last), x, problem)
        if (len(problem) > 0) problem = 'has '//shown()//', which '//problem
        now = next_symbol(text, now)
      case ('a')
        name = now
        now = next_symbol(text, now)
        if (now%kind == '(') then
          call read_function(lower(text(name%first:name%last)), x)
        else
          call read_name(lower(text(name%first:name%last)), x)
        end if
      case ('(')
        now = next_symbol(text, now)
        call read_sum(x)
        call close_parenthesis()
      case ('''', '"')
        call fail('has text in quotes, expected a number, a name or (; text stands in quotes without braces')
      case (' ')
        call fail('ends too early, expected a number, a name or ( at its end')
      case default
        call fail('has '//shown()//' where a number is due, expected a number, a name or (')
      end select
    end subroutine read_operand

    !> Moves behind a closing parenthesis.
    subroutine close_parenthesis()
      if (now%kind == ' ') then
        call fail('has ( without ), expected a closing )')
      else if (now%kind /= ')') then
        call fail('has '//shown()//' where an operator is due, expected one of + - * / ^ )')
      end if
      if (len(problem) == 0) now = next_symbol(text, now)
    end subroutine close_parenthesis

    !> A constant, or a name that the caller knows.
    subroutine read_name(name, x)
      character(*), intent(in) :: name   !! lower case
      real(wp), intent(out) :: x         !! [any]
      integer :: k
      x = 0.0_wp
      k = findloc(constants == name, .true., 1)
      if (k > 0) x = constant_values(k)
      if (k > 0) return
      k = findloc(names == name, .true., 1)
      if (k > 0) x = values(k)
      if (k == 0) call fail('has '//name//' without an argument, expected '//name//'(...)')       ! that of a function
    end subroutine read_name

    !> A function with its arguments; the reader stands on the opening parenthesis.
    recursive subroutine read_function(name, x)
      character(*), intent(in) :: name   !! lower case
      real(wp), intent(out) :: x         !! [any]
      real(wp) :: y
      integer :: k, n
      x = 0.0_wp
      y = 0.0_wp
      if (.not. any(functions == name)) then
        k = nearest_word(name, functions)
        if (k > 0) call fail('has the unknown function '//printable(name, 40)//', did you mean '//trim(functions(k))//'?')
        call fail('has the unknown function '//printable(name, 40)//', expected one of '//joined(functions, ' '))
        return
      end if
      now = next_symbol(text, now)
      call read_sum(x)
      n = 1
      do while (len(problem) == 0 .and. now%kind == ',')
        now = next_symbol(text, now)
        call read_sum(y)
        n = n + 1
        if (name == 'min') x = min(x, y)
        if (name == 'max') x = max(x, y)
      end do
      call close_parenthesis()
      select case (name)
      case ('min', 'max')
        if (n < 2) call fail('gives '//name//' 1 argument, expected 2 or more')
      case ('atan2')
        if (n /= 2) call fail('gives atan2 '//to_text(n)//' argument'//either('s', '', n > 1)//', expected 2')
      case default
        if (n /= 1) call fail('gives '//name//' '//to_text(n)//' arguments, expected 1')
      end select
      if (len(problem) == 0) call apply(name, x, y)
    end subroutine read_function

    !> Applies a function to its argument, atan2 to both.
    subroutine apply(name, x, y)
      character(*), intent(in) :: name   !! lower case
      real(wp), intent(inout) :: x       !! [any]
      real(wp), intent(in) :: y          !! the last argument [any]
      select case (name)
      case ('sin')
        x = sin(x)
      case ('cos')
        x = cos(x)
      case ('tan')
        x = tan(x)
      case ('asin', 'acos')
        if (abs(x) > 1.0_wp) call outside(name, x, 'from -1 to 1')
        x = max(-1.0_wp, min(1.0_wp, x))
        if (name == 'asin') x = asin(x)
        if (name == 'acos') x = acos(x)
      case ('atan')
        x = atan(x)
      case ('atan2')
        if (.not. max(abs(x), abs(y)) > 0.0_wp) call fail('takes atan2 of 0 and 0, expected another argument')
        if (len(problem) == 0) x = atan2(x, y)
      case ('sqrt')
        if (x < 0.0_wp) call outside(name, x, '>= 0')
        x = sqrt(abs(x))
      case ('log')
        if (.not. x > 0.0_wp) call outside(name, x, '> 0')
        if (x > 0.0_wp) x = log(x)
      case ('exp')
        if (x > log(10.0_wp)*decades) call too_large()
        if (len(problem) == 0) call bound(exp(x), x)
      case ('abs')
        x = abs(x)
      case default     ! min, max
      end select
    end subroutine apply

    !> Notes an argument for which a function has no value.
    subroutine outside(name, x, expected)
      character(*), intent(in) :: name, expected
      real(wp), intent(in) :: x          !! [any]
      call fail('takes '//name//' of '//to_text(x)//', expected an argument '//expected)
    end subroutine outside

    !> Takes a result: one that is tiny is 0, one that is huge a problem.
    subroutine bound(value, x)
      real(wp), intent(in) :: value      !! [any]
      real(wp), intent(out) :: x         !! [any]
      x = value
      if (abs(x) > 10.0_wp**decades) call too_large()
      if (abs(x) < 10.0_wp**(-decades)) x = 0.0_wp
    end subroutine bound

    !> Notes a number that is not to be computed with.
    subroutine too_large()
      call fail('leads to a number beyond 1e'//to_text(decades)//', expected finite results')
    end subroutine too_large
  end subroutine evaluate
end module expression
