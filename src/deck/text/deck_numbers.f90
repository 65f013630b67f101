!> Turns single words of a deck into numbers and logicals, strictly: what is not exactly a number is refused with a
!> reason, and no conversion can overflow.
module deck_numbers
  use kinds, only: wp, ip
  use text, only: lower
  implicit none (type, external)
  private
  public :: read_real, read_integer, read_logical

  character(*), parameter :: digits = '0123456789'
  integer, parameter :: decades = 60     !! magnitudes from 1e-60 to below 1e60: products of a few stay finite

contains

  !> A real number; integers count as reals. `problem` is empty if it is one.
  pure subroutine read_real(word, x, problem)
    character(*), intent(in) :: word                     !! without blanks
    real(wp), intent(inout) :: x                         !! unchanged if there is a problem [as the variable]
    character(:), allocatable, intent(out) :: problem    !! what is wrong, what was expected
    integer :: decade, status
    logical :: number, zero
    problem = ''
    call analyse(word, number, zero, decade)
    if (.not. number) then
      problem = 'is not a number, expected one such as 1.5e-3'
      if (is_endless(word)) problem = 'is not finite, expected a finite number'
    else if (.not. zero .and. abs(decade) >= decades .and. decade /= -decades) then
      problem = 'is out of range, expected 0 or a magnitude from 1e-60 to 1e60'
    else if (zero) then
      x = 0.0_wp
    else
      read (word, *, iostat=status) x
      if (status /= 0) problem = 'is not a number, expected one such as 1.5e-3'
    end if
  end subroutine read_real

  !> Whether a word is a number, whether it is zero, and the decade of its first digit that is not zero.
  pure subroutine analyse(word, number, zero, decade)
    character(*), intent(in) :: word
    logical, intent(out) :: number
    logical, intent(out) :: zero
    integer, intent(out) :: decade     !! 0 for 1..9.99, -1 for 0.1..0.999
    integer :: start, mantissa_end, point, first
    decade = 0
    zero = .false.
    start = 1
    if (scan(word(1:min(1, len(word))), '+-') == 1) start = 2
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
    if (mantissa_end < len(word)) call add_exponent(word(mantissa_end + 2:), decade, number)
  end subroutine analyse

  !> Adds a decimal exponent to a decade; an absurdly large one counts as 100000.
  pure subroutine add_exponent(word, decade, number)
    character(*), intent(in) :: word       !! what follows the letter e
    integer, intent(inout) :: decade
    logical, intent(out) :: number         !! whether it is an exponent
    integer :: start, i, exponent
    start = 1
    if (scan(word(1:min(1, len(word))), '+-') == 1) start = 2
    number = len(word) >= start
    if (number) number = verify(word(start:), digits) == 0
    if (.not. number) return
    exponent = 0
    do i = start, len(word)
      exponent = min(10*exponent + index(digits, word(i:i)) - 1, 100000)
    end do
    if (word(1:1) == '-') exponent = -exponent
    decade = decade + exponent
  end subroutine add_exponent

  !> Whether a word means a number that is not finite: nan, nan(...), inf, infinity, with a sign or without.
  pure logical function is_endless(word) result(yes)
    character(*), intent(in) :: word    !! word of the deck
    character(:), allocatable :: core
    core = lower(word)
    if (scan(core(1:min(1, len(core))), '+-') == 1) core = core(2:)
    yes = core == 'nan' .or. index(core, 'nan(') == 1 .or. core == 'inf' .or. core == 'infinity'
  end function is_endless

  !> A whole number. `problem` is empty if it is one.
  pure subroutine read_integer(word, n, problem)
    character(*), intent(in) :: word                     !! without blanks
    integer, intent(inout) :: n                          !! unchanged if there is a problem
    character(:), allocatable, intent(out) :: problem    !! what is wrong, what was expected
    integer :: start, i, decade
    integer(ip) :: value
    logical :: number, zero
    problem = ''
    start = 1
    if (scan(word(1:min(1, len(word))), '+-') == 1) start = 2
    if (len(word) < start) then
      problem = 'is not a number, expected a whole number'
    else if (verify(word(start:), digits) > 0) then
      call analyse(word, number, zero, decade)
      problem = 'is not a number, expected a whole number'
      if (number) problem = 'is a real number, expected a whole number'
    else
      value = 0_ip
      do i = start, len(word)
        value = min(10_ip*value + index(digits, word(i:i)) - 1, int(huge(n), ip) + 1_ip)
      end do
      if (value > huge(n)) then
        problem = 'is out of range, expected a whole number up to 2147483647'
      else
        n = int(value)
        if (word(1:1) == '-') n = -n
      end if
    end if
  end subroutine read_integer

  !> A logical value. `problem` is empty if it is one.
  pure subroutine read_logical(word, yes, problem)
    character(*), intent(in) :: word                     !! without blanks
    logical, intent(inout) :: yes                        !! unchanged if there is a problem
    character(:), allocatable, intent(out) :: problem    !! what is wrong, what was expected
    problem = ''
    select case (lower(word))
    case ('.true.', 'true', '.t.', 't')
      yes = .true.
    case ('.false.', 'false', '.f.', 'f')
      yes = .false.
    case default
      problem = 'is not a logical value, expected .true. or .false.'
    end select
  end subroutine read_logical
end module deck_numbers
