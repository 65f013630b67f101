!> Numbers as text with 17 significant digits, correctly rounded: what the format ES25.16E3 gives, twenty times faster.
!> A number m 2^q is multiplied by a power of ten that is known to some 105 bits. Then 17 digits stand before the point and 48
!> good bits behind it. Where these bits do not show whether the rest is above or below one half (ties), the format decides.
module decimal
  use kinds, only: wp
  use, intrinsic :: iso_fortran_env, only: int64
  implicit none (type, external)
  private
  public :: number_width, write_number

  integer, parameter :: number_width = 25                    !! characters of a number: a blank, the sign, 23 more
  integer, parameter :: wide = selected_int_kind(38)         !! integers of 128 bits
  integer, parameter :: first = -325, last = 341             !! powers of ten that doubles need
  integer(int64), parameter :: ten16 = 10_int64**16, ten17 = 10_int64**17
  integer :: i                                               ! counts places
  integer(int64), parameter :: nibbles = sum([(15*2_int64**i, i=0, 48, 16)])   ! 15 in every second byte
  integer(int64), parameter :: zeros = sum([(iachar('0')*2_int64**i, i=0, 56, 8)])   ! the characters 00000000

  !> Powers of ten: 10^p = (high 2^63 + low) 2^shift, good to 105 bits, with 2^62 <= high < 2^63; and as doubles.
  !> Filled at the first use, constant from then on.
  type :: power_table
    logical :: filled = .false.
    integer(int64) :: high(first:last) = 0, low(first:last) = 0
    integer :: shift(first:last) = 0
    real(wp) :: value(first:309) = 0.0_wp                    !! 10^p rounded down, huge where it overflows [-]
    character(5) :: exponent(first:last) = ''                !! p as it is written
  end type power_table
  type(power_table) :: table

contains

  !> Writes x right-adjusted into 25 characters.
  subroutine write_number(x, text)
    real(wp), intent(in) :: x   !! [any]
    character(number_width), intent(out) :: text
    integer(int64) :: digits
    integer :: e
    logical :: known
    if (.not. table%filled) call fill_table()
    if (abs(x) <= 0.0_wp) then
      text = '  0.0000000000000000E+000'
      if (sign(1.0_wp, x) < 0.0_wp) text(2:2) = '-'
      return
    end if
    call round_to_digits(abs(x), digits, e, known)
    if (known) then
      call put_digits(digits, e, text)
      if (x < 0.0_wp) text(2:2) = '-'
    else
      write (text, '(es25.16e3)') x
    end if
  end subroutine write_number

  !> x = digits 10^(e-16), rounded to nearest, with 10^16 <= digits < 10^17; known is false where the table is too coarse.
  pure subroutine round_to_digits(x, digits, e, known)
    real(wp), intent(in) :: x                                !! not negative [-]
    integer(int64), intent(out) :: digits
    integer, intent(out) :: e
    logical, intent(out) :: known
    integer(int64) :: bits, m, rest
    integer :: q, try
    digits = 0
    e = 0
    known = x > 0.0_wp .and. x <= huge(1.0_wp)
    if (.not. known) return
    bits = transfer(x, bits)
    q = int(shiftr(bits, 52))
    m = iand(bits, 2_int64**52 - 1)
    if (q == 0) then                                         ! subnormal
      q = leadz(m) - 1
      m = shiftl(m, q)
      q = -1074 - q
    else
      m = shiftl(m + 2_int64**52, 10)
      q = q - 1085
    end if                                                   ! x = m 2^q, 2^62 <= m < 2^63
    e = floor_log10(x, q)
    do try = 1, 2
      call scale_up(m, q, 16 - e, digits, rest, known)
      if (digits >= ten16 .or. .not. known) exit
      e = e - 1                                              ! x lies just below a power of ten that is no double
    end do
    if (rest > 0) digits = digits + 1
    if (digits < ten17) return
    digits = ten16                                           ! rounded up to the next power of ten
    e = e + 1
  end subroutine round_to_digits

  !> Largest e with 10^e <= x, within one at a power of ten that is no double. x = m 2^q with 2^62 <= m < 2^63.
  pure integer function floor_log10(x, q) result(e)
    real(wp), intent(in) :: x   !! positive [-]
    integer, intent(in) :: q
    e = int(shifta((q + 62)*1292913986_int64, 32))           ! log10(2) 2^32
    e = max(e, -324)
    if (x >= table%value(e + 1)) e = e + 1
  end function floor_log10

  !> digits = floor(m 2^q 10^p); rest is positive where the fraction is above one half, negative below; known is false
  !> where it is one half within the table's error.
  pure subroutine scale_up(m, q, p, digits, rest, known)
    integer(int64), intent(in) :: m
    integer, intent(in) :: q, p
    integer(int64), intent(out) :: digits, rest
    logical, intent(out) :: known
    integer(int64), parameter :: doubt = 2_int64**17         ! 105 of 126 bits are good
    integer(int64) :: upper, lower                           ! halves of 63 bits: 64-bit operations cost less
    integer(wide) :: top
    integer :: k
    top = int(m, wide)*int(table%high(p), wide) + shiftr(int(m, wide)*int(table%low(p), wide), 63)
    k = -(q + table%shift(p) + 126)                          ! x 10^p = top 2^-(k+63), k from 5 to 13
    upper = int(shiftr(top, 63), int64)
    lower = int(iand(top, int(huge(1_int64), wide)), int64)
    digits = shiftr(upper, k)
    rest = ior(shiftl(upper - shiftl(digits, k), 63 - k), shiftr(lower, k)) - 2_int64**62   ! (fraction - 1/2) 2^63
    known = abs(rest) > doubt
  end subroutine scale_up

  !> Lays out the digits: d.ddddddddddddddddE+eee.
  pure subroutine put_digits(digits, e, text)
    integer(int64), intent(in) :: digits
    integer, intent(in) :: e
    character(number_width), intent(out) :: text
    integer :: left, right                                   ! of 9 and 8 digits
    left = int(digits/10_int64**8)
    right = int(digits - left*10_int64**8)
    text(1:2) = '  '
    text(3:3) = achar(iachar('0') + left/10**8)
    text(4:4) = '.'
    text(5:12) = eight_digits(mod(left, 10**8))
    text(13:20) = eight_digits(right)
    text(21:25) = table%exponent(e)
  end subroutine put_digits

  !> A number of at most eight digits. Its halves, their halves and the digits stand side by side in one integer, first ones lowest;
  !> products with 10486 2^-20, 103 2^-10 are quotients by 100, 10. Bytes are kept from the lowest on.
  pure function eight_digits(n) result(text)
    integer, intent(in) :: n
    character(8) :: text
    integer(int64) :: x, tens                                ! each part's quotient stays below the next part
    x = n/10000 + shiftl(int(mod(n, 10000), int64), 32)
    tens = iand(shiftr(10486*x, 20), 127 + shiftl(127_int64, 32))
    x = tens + shiftl(x - 100*tens, 16)
    tens = iand(shiftr(103*x, 10), nibbles)
    x = tens + shiftl(x - 10*tens, 8)
    text = transfer(x + zeros, text)
  end function eight_digits

  !> Powers of ten by products with 10 = 1.25 2^3 and 1/10 = 0.8 2^-3, each wrong by two of the last bits at most.
  subroutine fill_table()
    integer(wide), parameter :: least = 2_wide**125
    integer(wide) :: bits                                    ! 10^p = bits 2^shift, from least to below twice of it
    integer :: p, shift
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
    do p = first, 308                                        ! high without its last 10 bits is a double
      table%value(p) = scale(real(shiftr(table%high(p), 10), wp), table%shift(p) + 73)
    end do
    table%value(309) = huge(1.0_wp)
    table%filled = .true.
  end subroutine fill_table

  !> Keeps a power of ten.
  subroutine store_power(p, bits, shift)
    integer, intent(in) :: p, shift
    integer(wide), intent(in) :: bits
    character(8) :: number
    number = eight_digits(abs(p))
    table%high(p) = int(shiftr(bits, 63), int64)
    table%low(p) = int(iand(bits, int(huge(1_int64), wide)), int64)
    table%shift(p) = shift
    table%exponent(p) = merge('E-', 'E+', p < 0)//number(6:)
  end subroutine store_power
end module decimal
