!> Checksum of a text that is written piece by piece; how it is cut into pieces does not matter. Fletcher's two sums over the
!> 32-bit halves of its words, modulo 2^32 - 1: 1.5 instructions a letter.
module text_checksum
  use archive, only: digest, text_words
  use kinds, only: ip
  implicit none (type, external)
  private

  integer(ip), parameter :: low = 4294967295_ip
  integer, parameter :: letters = 8              !! of a word
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
    character(:), allocatable :: text
    integer :: whole
    text = self%rest(1:mod(self%length, int(letters, ip)))//piece
    whole = len(text)/letters
    call add_words(whole, text, self%sums)
    self%rest = text(whole*letters + 1:)
    self%length = self%length + len(piece)
  end subroutine add

  !> Adds whole words to the sums.
  pure subroutine add_words(n, text, sums)
    integer, intent(in) :: n                     !! words
    character(letters), intent(in) :: text(n)    !! as words
    integer(ip), intent(inout) :: sums(2)
    integer(ip) :: a, b, word
    integer :: k
    a = sums(1)
    b = sums(2)
    do k = 1, n
      word = transfer(text(k), word)
      a = a + iand(word, low)
      b = b + a
      a = a + shiftr(word, 32)
      b = b + a
      if (mod(k, block) /= 0) cycle
      a = mod(a, low)
      b = mod(b, low)
    end do
    sums = mod([a, b], low)
  end subroutine add_words

  !> A number that tells the text from another one.
  pure integer(ip) function value(self)
    class(running_checksum), intent(in) :: self
    value = digest([self%length, self%sums, text_words(self%rest(1:mod(self%length, int(letters, ip))))])
  end function value
end module text_checksum
