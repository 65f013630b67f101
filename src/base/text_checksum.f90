!> Checksum of a text that is written piece by piece; how it is cut into pieces does not matter. Fletcher's two sums, modulo
!> 2^32 - 1, over the halves of words of 64 bits, each mixed of 32 letters: half an instruction a letter.
module text_checksum
  use archive, only: digest, text_words
  use kinds, only: ip, low
  implicit none (type, external)
  private

  integer, parameter :: letters = 32             !! of a word
  integer, parameter :: block = 8192             !! words between two reductions: the sums stay below 2^62

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
      sums = mod([a, b], low)
    end do
  end subroutine add_words

  !> A number that tells the text from another one.
  pure integer(ip) function value(self)
    class(running_checksum), intent(in) :: self
    value = digest([self%length, self%sums, text_words(self%rest(1:mod(self%length, int(letters, ip))))])
  end function value
end module text_checksum
