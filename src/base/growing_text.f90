!> A text that is written piece by piece: its buffer doubles when it is full, so that a piece costs as little in a long text as
!> in a short one.
module growing_text
  implicit none (type, external)
  private

  !> The text so far.
  type, public :: text_buffer
    integer :: used = 0                           !! characters
    integer, private :: capacity = 0              !! for how many there is room
    character(:), allocatable, private :: room    !! the text in the first of them
  contains
    procedure :: add
    procedure :: all => whole_text
    procedure :: last
  end type text_buffer

contains

  !> Appends a piece.
  pure subroutine add(self, piece)
    class(text_buffer), intent(inout) :: self
    character(*), intent(in) :: piece
    character(:), allocatable :: larger
    integer :: n
    if (len(piece) == 0) return                   ! there may be no room yet, of which even no character can be set
    n = self%used + len(piece)
    if (n > self%capacity) then
      self%capacity = max(64, 2*n)
      allocate (character(self%capacity) :: larger)
      if (self%used > 0) larger(1:self%used) = self%room(1:self%used)
      call move_alloc(larger, self%room)
    end if
    self%room(self%used + 1:n) = piece
    self%used = n
  end subroutine add

  !> The whole text.
  pure function whole_text(self) result(text)
    class(text_buffer), intent(in) :: self
    character(:), allocatable :: text
    text = ''
    if (self%used > 0) text = self%room(1:self%used)
  end function whole_text

  !> Its last character, a blank where it is empty.
  pure character(1) function last(self) result(letter)
    class(text_buffer), intent(in) :: self
    letter = ' '
    if (self%used > 0) letter = self%room(self%used:self%used)
  end function last
end module growing_text
