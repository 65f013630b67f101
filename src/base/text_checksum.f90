!> Checksum of a text that is written piece by piece; how it is cut into pieces does not matter. Fletcher's two sums, modulo
!> a prime, over the halves of words of 64 bits, each mixed of 32 letters: half an instruction a letter.
module text_checksum
  use kinds, only: ip, low
  implicit none (type, external)
  private
  public :: digest

  integer, parameter :: letters = 32             !! of a word
  integer, parameter :: block = 8192             !! words between two reductions: the sums stay below 2^62
  integer(ip), parameter :: prime = 2_ip**32 + 15   !! no half is zero modulo it but 0

  !> The sums so far.
  type, public :: running_checksum
    integer(ip) :: length = 0                    !! letters so far
    integer(ip), private :: sums(2) = 0          !! of halves, of these sums
    character(letters), private :: rest = ''     !! the last letters, which fill no word
  contains
    procedure :: add
    procedure :: value
  end type running_checksum

contains

  !> Goes on with a piece.
  pure subroutine add(self, piece)
    class(running_checksum), intent(inout) :: self
    character(*), intent(in) :: piece
    integer :: waiting, taken, whole             ! letters of the rest, of the piece that fill it, words
    waiting = int(mod(self%length, int(letters, ip)))
    self%length = self%length + len(piece)
    taken = 0
    if (waiting > 0) then
      taken = min(letters - waiting, len(piece))
      self%rest(waiting + 1:waiting + taken) = piece(1:taken)
      if (waiting + taken < letters) return
      call add_words(1, self%rest, self%sums)
    end if
    whole = (len(piece) - taken)/letters
    call add_words(whole, piece(taken + 1:), self%sums)
    self%rest = piece(taken + whole*letters + 1:)
  end subroutine add

  !> Adds whole words to the sums. Turns by other than whole bytes bring the bits in which digits differ beside each other.
  pure subroutine add_words(n, text, sums)
    integer, intent(in) :: n                     !! words
    character(8), intent(in) :: text(4, n)       !! as words
    integer(ip), intent(inout) :: sums(2)
    integer(ip) :: a, b, word
    integer :: first, k
    do first = 1, n, block
      a = sums(1)
      b = sums(2)
      do k = first, min(first + block - 1, n)
        word = ieor(ieor(transfer(text(1, k), word), ishftc(transfer(text(2, k), word), 13)), &
                    ieor(ishftc(transfer(text(3, k), word), 27), ishftc(transfer(text(4, k), word), 43)))
        a = a + iand(word, low)
        b = b + a
        a = a + shiftr(word, 32)
        b = b + a
      end do
      sums = mod([a, b], prime)
    end do
  end subroutine add_words

  !> A number that tells the text from another one.
  pure integer(ip) function value(self)
    class(running_checksum), intent(in) :: self
    character(letters) :: rest
    integer(ip) :: sums(2)
    rest = self%rest(1:mod(self%length, int(letters, ip)))
    sums = self%sums
    call add_words(1, rest, sums)
    value = ieor(ieor(ishftc(sums(2), 32), sums(1)), ishftc(self%length, 48))
  end function value

  !> That of a text.
  pure integer(ip) function digest(text)
    character(*), intent(in) :: text
    type(running_checksum) :: sum
    call sum%add(text)
    digest = sum%value()
  end function digest
end module text_checksum
