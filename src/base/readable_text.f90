!> Text of any origin (decks, names of files, titles) as it may be shown: letters of UTF-8 that can be printed. A byte that is no
!> part of UTF-8 counts as a letter of Latin-1. Control characters, which could steer a terminal or break a line, become `?`.
module readable_text
  use growing_text, only: text_buffer
  implicit none (type, external)
  private
  public :: readable, one_line, printable, json_text

  character(*), parameter, public :: tab = achar(9), lf = achar(10)

contains

  !> A text of several lines: their ends and tabs stay.
  pure function readable(s) result(t)
    character(*), intent(in) :: s     !! any text
    character(:), allocatable :: t
    type(text_buffer) :: clean
    integer :: k, n, code
    k = 1
    do while (k <= len(s))
      call first_letter(s(k:min(k + 3, len(s))), n, code)
      if (code == 9 .or. code == 10) then
        call clean%add(s(k:k))
      else if (is_control(code)) then
        call clean%add('?')
      else if (n == 1 .and. code >= 128) then
        call clean%add(char(192 + code/64)//char(128 + mod(code, 64)))
      else
        call clean%add(s(k:k + n - 1))
      end if
      k = k + n
    end do
    t = clean%all()
  end function readable

  !> A text as one line: its line ends and tabs are blanks.
  pure function one_line(s) result(t)
    character(*), intent(in) :: s     !! any text
    character(:), allocatable :: t
    integer :: k
    t = readable(s)
    do k = 1, len(t)
      if (t(k:k) == tab .or. t(k:k) == lf) t(k:k) = ' '
    end do
  end function one_line

  !> A faulty text as a message shows it: tabs and line ends become `?` too, and it is cut after `most` characters.
  pure function printable(s, most) result(t)
    character(*), intent(in) :: s     !! any text
    integer, intent(in) :: most       !! longest text wanted
    character(:), allocatable :: t
    integer :: k, last
    t = readable(s)
    do k = 1, len(t)
      if (t(k:k) == tab .or. t(k:k) == lf) t(k:k) = '?'
    end do
    if (len(t) <= most) return
    last = most
    do while (last > 1 .and. iand(iachar(t(last + 1:last + 1)), 192) == 128)
      last = last - 1               ! not in the middle of a letter
    end do
    t = t(1:last)//'...'
  end function printable

  !> A text as JSON has it, with nothing lost.
  pure function json_text(s) result(text)
    character(*), intent(in) :: s
    character(:), allocatable :: text
    type(text_buffer) :: json
    character(*), parameter :: digits = '0123456789abcdef'
    integer :: i, k, n, code
    call json%add('"')
    k = 1
    do while (k <= len(s))
      call first_letter(s(k:min(k + 3, len(s))), n, code)
      if (code == 10) then
        call json%add('\n')
      else if (code == 34 .or. code == 92) then
        call json%add('\'//achar(code))
      else if (is_control(code) .or. (n == 1 .and. code >= 128)) then
        call json%add('\u')
        do i = 12, 0, -4                           ! no control character needs more than four digits
          call json%add(digits(iand(shiftr(code, i), 15) + 1:iand(shiftr(code, i), 15) + 1))
        end do
      else
        call json%add(s(k:k + n - 1))
      end if
      k = k + n
    end do
    call json%add('"')
    text = json%all()
  end function json_text

  !> The letter with which a text begins: how many bytes it has, and its number in Unicode.
  pure subroutine first_letter(s, n, code)
    character(*), intent(in) :: s     !! not empty
    integer, intent(out) :: n, code
    integer, parameter :: least(4) = [0, 128, 2048, 65536]   ! a letter is not written with more bytes than it needs
    integer :: k, byte
    byte = iachar(s(1:1))
    code = byte
    n = 1
    if (byte >= 192 .and. byte < 224) n = 2
    if (byte >= 224 .and. byte < 240) n = 3
    if (byte >= 240 .and. byte < 248) n = 4
    if (n == 1) return
    if (n <= len(s)) code = iand(byte, 2**(7 - n) - 1)
    do k = 2, min(n, len(s))
      if (iand(iachar(s(k:k)), 192) /= 128) exit
      code = 64*code + iand(iachar(s(k:k)), 63)
    end do
    if (k == n + 1 .and. n <= len(s) .and. code >= least(n) .and. code < 1114112 .and. code/2048 /= 27) return
    n = 1                             ! no letter of UTF-8; 27*2048 is the first of the halves that UTF-16 alone has
    code = byte
  end subroutine first_letter

  !> Whether a character is not to be shown: controls, separators of lines, and what changes the direction of writing.
  pure logical function is_control(code) result(yes)
    integer, intent(in) :: code       !! its number in Unicode
    yes = code < 32 .or. (code >= 127 .and. code < 160) .or. any(code == [1564, 8206, 8207, 65279]) .or. &
          (code >= 8232 .and. code <= 8238) .or. (code >= 8294 .and. code <= 8297)
  end function is_control
end module readable_text
