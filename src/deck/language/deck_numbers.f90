!> Turns single words of a deck into numbers, strictly: what is not exactly a number is refused with a
!> reason, and no conversion can overflow.
module deck_numbers
  use kinds, only: wp, ip
  use text, only: digits, lower, short_text
  implicit none (type, external)
  private
  public :: read_real, read_integer, read_logical, whole_number, check_range

  character(*), parameter :: out_of_range = 'is out of range, expected 0 or a magnitude from 1e-60 to 1e60'
  character(*), parameter :: out_of_integers = 'is out of range, expected a whole number up to 2147483647'
  integer, parameter, public :: decades = 60     !! magnitudes from 1e-60 to 1e60: products of five stay finite, as of reciprocals

contains

  !> A whole number from the value of an expression, which may be rounded. `problem` is empty if it is one.
  pure subroutine whole_number(x, n, problem)
    real(wp), intent(in) :: x                            !! [-]
    integer, intent(inout) :: n                          !! unchanged if there is a problem
    character(:), allocatable, intent(out) :: problem    !! what is wrong, what was expected
    problem = ''
    if (abs(x) > real(huge(n), wp)) then
      problem = out_of_integers
    else if (abs(x - anint(x)) > 1.0e-9_wp) then
      problem = 'is no whole number, expected one'
      if (abs(x - anint(x)) < 1.0e-3_wp) problem = 'differs from a whole number by '//short_text(x - anint(x), 1)// &
        ', expected at most 1e-9'
    else
      n = nint(x)
    end if
  end subroutine whole_number

  !> Whether a finite number may stand in a deck. `problem` is empty if it may.
  pure subroutine check_range(x, problem)
    real(wp), intent(in) :: x                            !! [any]
    character(:), allocatable, intent(out) :: problem    !! what is wrong, what was expected
    problem = ''
    if (abs(x) > 10.0_wp**decades .or. (abs(x) > 0.0_wp .and. abs(x) < 10.0_wp**(-decades))) problem = out_of_range
  end subroutine check_range

  !> A real number; integers count as reals. `problem` is empty if it is one.
  pure subroutine read_real(word, x, problem)
    character(*), intent(in) :: word                     !! without blanks
    real(wp), intent(inout) :: x                         !! unchanged if there is a problem [as the variable]
    character(:), allocatable, intent(out) :: problem    !! what is wrong, what was expected
    character(:), allocatable :: core
    real(wp) :: value                                    ! [as the variable]
    integer :: decade, status
    logical :: number, zero
    problem = ''
    call analyse(word, number, zero, decade)
    if (.not. number) then
      problem = 'is not a number, expected one such as 1.5e-3'
      core = lower(word(sign_length(word) + 1:))
      if (index(core, 'nan(') == 1) core = 'nan'
      if (any(core == [character(8) :: 'nan', 'inf', 'infinity'])) problem = 'is not finite, expected a finite number'
    else if (.not. zero .and. abs(decade) > decades + 1) then      ! its conversion may overflow
      problem = out_of_range
    else if (zero) then
      x = 0.0_wp
    else
      read (word, *, iostat=status) value
      if (status /= 0) problem = 'is not a number, expected one such as 1.5e-3'
      if (status == 0) call check_range(value, problem)
      if (len(problem) == 0) x = value
    end if
  end subroutine read_real

  !> Whether a word is a number, whether it is zero, and the decade of its first digit that is not zero.
  pure subroutine analyse(word, number, zero, decade)
    character(*), intent(in) :: word
    logical, intent(out) :: number
    logical, intent(out) :: zero
    integer, intent(out) :: decade     !! 0 for 1..9.99, -1 for 0.1..0.999
    integer :: start, mantissa_end, point, first
    integer(ip) :: exponent
    decade = 0
    zero = .false.
    start = sign_length(word) + 1
    mantissa_end = scan(lower(word), 'ed') - 1
    if (mantissa_end < 0) mantissa_end = len(word)
    number = .false.
    if (mantissa_end < start) return
    associate (mantissa => word(start:mantissa_end))
      if (verify(mantissa, digits//'.') > 0 .or. scan(mantissa, digits) == 0) return
      point = index(mantissa, '.')
      if (point /= index(mantissa, '.', back=.true.)) return
      if (point == 0) point = len(mantissa) + 1
      first = verify(mantissa, '0.')
      zero = first == 0
      decade = merge(point - first - 1, point - first, first < point)
    end associate
    number = .true.
    exponent = 0
    if (mantissa_end < len(word)) call read_digits(word(mantissa_end + 2:), exponent, number)
    decade = decade + int(min(max(exponent, -100000_ip), 100000_ip))
  end subroutine analyse

  !> A sign and digits as a whole number, at most one more than an integer can be.
  pure subroutine read_digits(word, n, is_integer)
    character(*), intent(in) :: word
    integer(ip), intent(out) :: n
    logical, intent(out) :: is_integer     !! whether it is one
    integer :: start, i
    start = sign_length(word) + 1
    is_integer = len(word) >= start
    if (is_integer) is_integer = verify(word(start:), digits) == 0
    n = 0
    if (.not. is_integer) return
    do i = start, len(word)
      n = min(10_ip*n + index(digits, word(i:i)) - 1, int(huge(1), ip) + 1_ip)
    end do
    if (word(1:1) == '-') n = -n
  end subroutine read_digits

  !> A whole number. `problem` is empty if it is one.
  pure subroutine read_integer(word, n, problem)
    character(*), intent(in) :: word                     !! without blanks
    integer, intent(inout) :: n                          !! unchanged if there is a problem
    character(:), allocatable, intent(out) :: problem    !! what is wrong, what was expected
    integer :: decade
    integer(ip) :: value
    logical :: is_integer, number, zero
    problem = ''
    call read_digits(word, value, is_integer)
    if (is_integer .and. abs(value) <= huge(n)) then
      n = int(value)
    else if (is_integer) then
      problem = out_of_integers
    else
      call analyse(word, number, zero, decade)
      problem = 'is not a number, expected a whole number'
      if (number) problem = 'is a real number, expected a whole number'
    end if
  end subroutine read_integer

  !> A logical value. `known` tells whether it is one.
  pure subroutine read_logical(word, x, known)
    character(*), intent(in) :: word                     !! without blanks
    logical, intent(inout) :: x                          !! unchanged if it is none
    logical, intent(out) :: known
    known = .true.
    select case (lower(word))
    case ('.true.', 'true', '.t.', 't')
      x = .true.
    case ('.false.', 'false', '.f.', 'f')
      x = .false.
    case default
      known = .false.
    end select
  end subroutine read_logical

  !> 1 for a word that begins with a sign, else 0.
  pure integer function sign_length(word)
    character(*), intent(in) :: word
    sign_length = scan(word(:min(1, len(word))), '+-')
  end function sign_length
end module deck_numbers
