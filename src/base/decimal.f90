!> Numbers as text with 17 significant digits, correctly rounded: what the format ES25.16E3 gives, thirty times faster.
!> A number m 2^(q-1075) is multiplied by a power of ten that is known to some 105 bits. Then 17 digits stand before the point and
!> 48 good bits behind it. Where these bits do not show whether the rest is above or below one half (ties), the format decides.
module decimal
  use kinds, only: wp
  use, intrinsic :: iso_fortran_env, only: int32, int64
  implicit none (type, external)
  private
  public :: number_width, write_number

  integer, parameter :: number_width = 25                    !! characters of a number: a blank, the sign, 23 more
  integer, parameter :: wide = selected_int_kind(38)         !! integers of 128 bits
  integer, parameter :: first = -308, last = 324             !! powers of ten that doubles need
  integer(int64), parameter :: ten4 = 10_int64**4, ten8 = 10_int64**8, ten17 = 10_int64**17
  integer(int64), parameter :: per_ten4 = 109951163_int64    !! 2^40/10^4, rounded up: in its place for up to eight digits
  integer(int64), parameter :: per_ten8 = 1441151881_int64   !! 2^57/10^8, rounded up: for nine digits
  integer(int64), parameter :: implicit_bit = 2_int64**52    !! of a double's mantissa
  integer(wide), parameter :: word = 2_wide**64

  !> Powers of ten: 10^p = (high 2^64 + low) 2^(shift + 947), good to 105 bits, with 2^61 <= high <= 2^62. And the characters of all
  !> numbers of four digits. Filled at the first use, constant from then on.
  type :: power_table
    logical :: filled = .false.
    integer(int64) :: high(first:last) = 0, low(first:last) = 0
    integer(int64) :: shift(first:last) = 0
    character(8) :: exponent(first:last) = ''                !! p as it is written, right-adjusted
    character(4) :: four(0:9999) = ''
  end type power_table
  type(power_table) :: table

contains

  !> Writes x right-adjusted into 25 characters.
  subroutine write_number(x, text)
    real(wp), intent(in) :: x   !! [any]
    character(number_width), intent(out) :: text
    integer(int64) :: bits, magnitude, digits, e
    logical :: known
    if (.not. table%filled) call fill_table()
    bits = transfer(x, bits)
    magnitude = iand(bits, huge(bits))
    call round_to_digits(magnitude, digits, e, known)
    if (.not. known) then
      call write_by_format(x, text)
      return
    end if
    call put_digits(digits, e, text)
    if (bits < 0) text(2:2) = '-'
  end subroutine write_number

  !> Numbers that the table does not decide, zeros, subnormal ones, infinities and what is no number.
  subroutine write_by_format(x, text)
    real(wp), intent(in) :: x   !! [any]
    character(number_width), intent(out) :: text
    if (abs(x) <= 0.0_wp) then
      text = '  0.0000000000000000E+000'
      if (sign(1.0_wp, x) < 0.0_wp) text(2:2) = '-'
    else
      write (text, '(es25.16e3)') x
    end if
  end subroutine write_by_format

  !> A number = digits 10^(e-16), rounded to nearest, with 10^16 <= digits < 10^17; known is false where the table is too coarse,
  !> and where it is zero, subnormal or none.
  pure subroutine round_to_digits(bits, digits, e, known)
    integer(int64), intent(in) :: bits                       !! of the number without its sign
    integer(int64), intent(out) :: digits, e
    logical, intent(out) :: known
    integer(int64), parameter :: doubt = 2_int64**17         ! 105 of 126 bits are good
    integer(int64), parameter :: log10_2 = 1292913986        ! log10(2) 2^32
    integer(int64) :: m, q, p, rest, shifted
    integer(wide) :: top
    q = shiftr(bits, 52)
    digits = 0
    e = 0
    known = q > 0 .and. q < 2047
    if (.not. known) return
    m = iand(bits, implicit_bit - 1) + implicit_bit          ! the number = m 2^(q-1075), 2^52 <= m < 2^53
    e = shifta((shiftr(bits, 32) - 1023*2_int64**20)*log10_2, 52)   ! of a chord of the logarithm: seldom 1 too small
    do
      p = 16 - e
      shifted = shiftl(m, iand(q + table%shift(p), 63_int64))   ! from 1 to 11 places; iand spares a test for more than 63
      top = int(shifted, wide)*int(table%high(p), wide) + shifta(int(shifted, wide)*int(table%low(p), wide), 64)
      digits = int(shifta(top, 64), int64)                   ! the number 10^p = top 2^-64
      rest = int(top - digits*word - word/2, int64)          ! (fraction - 1/2) 2^64
      if (rest > 0) digits = digits + 1
      known = rest > doubt .or. rest < -doubt                ! abs(-2^63) is no number of 64 bits
      if (digits < ten17 .or. .not. known) exit
      e = e + 1                                              ! the number is not below 10^(e+1), or is rounded up to that
    end do
  end subroutine round_to_digits

  !> Lays out the digits: d.ddddddddddddddddE+eee.
  pure subroutine put_digits(digits, e, text)
    integer(int64), intent(in) :: digits, e
    character(number_width), intent(out) :: text
    integer(int64) :: left, first_one                        ! nine digits
    left = digits/ten8
    first_one = shiftr(left*per_ten8, 57)
    text(18:25) = table%exponent(e)
    text(1:2) = '  '
    text(3:3) = achar(iachar('0') + int(first_one))
    text(4:4) = '.'
    call put_eight(left - first_one*ten8, text(5:12))
    call put_eight(digits - left*ten8, text(13:20))
  end subroutine put_digits

  !> A number of at most eight digits, with leading zeros.
  pure subroutine put_eight(n, text)
    integer(int64), intent(in) :: n
    character(8), intent(out) :: text
    integer(int64) :: upper
    upper = shiftr(n*per_ten4, 40)
    text(1:4) = table%four(upper)
    text(5:8) = table%four(n - upper*ten4)
  end subroutine put_eight

  !> Digits of numbers below ten thousand; powers of ten by products with 10 = 1.25 2^3 and 1/10 = 0.8 2^-3, each wrong by two of
  !> the last bits at most.
  subroutine fill_table()
    integer(wide), parameter :: least = 2_wide**125
    integer(wide) :: bits                                    ! 10^p = bits 2^shift, from least to below twice of it
    integer(int32) :: pair(0:99)
    integer :: p, k, shift
    do p = 0, 99
      pair(p) = iachar('0') + p/10 + 256*(iachar('0') + mod(p, 10))
    end do
    do p = 0, 99
      do k = 0, 99
        table%four(100*p + k) = transfer(pair(p) + 65536*pair(k), table%four(0))
      end do
    end do
    bits = least
    shift = -125
    do p = 0, last
      call store_power(p, bits, shift)
      bits = bits + shiftr(bits, 2)
      shift = shift + 3
      if (bits < 2*least) cycle
      bits = shiftr(bits, 1)
      shift = shift + 1
    end do
    bits = least
    shift = -125
    do p = -1, first, -1
      bits = bits - bits/5
      shift = shift - 3
      if (bits < least) then
        bits = 2*bits
        shift = shift - 1
      end if
      call store_power(p, bits, shift)
    end do
    table%filled = .true.
  end subroutine fill_table

  !> Keeps a power of ten.
  subroutine store_power(p, bits, shift)
    integer, intent(in) :: p, shift
    integer(wide), intent(in) :: bits
    character(8) :: number
    call put_eight(int(abs(p), int64), number)
    table%exponent(p) = '   '//merge('E-', 'E+', p < 0)//number(6:)
    table%high(p) = int(shiftr(bits + word/2, 64), int64)
    table%low(p) = int(bits - table%high(p)*word, int64)
    table%shift(p) = shift - 947
  end subroutine store_power
end module decimal
