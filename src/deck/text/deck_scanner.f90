!> A position in the text of a file of a deck, and the steps from word to word.
module deck_scanner
  use text, only: lower
  implicit none (type, external)
  private
  public :: is_letter

  character(*), parameter, public :: lf = achar(10), tab = achar(9), single = '''', double = '"'
  character(*), parameter :: word_end = ' ,;=/!&'//single//double//tab//lf   !! characters that end a word

  !> A position in the text of one file.
  type, public :: scanner
    character(:), allocatable :: text
    character(:), allocatable :: path
    integer :: file = 0              !! number of the file
    integer :: position = 1          !! next character
    integer :: line = 1              !! its line
    integer :: slash_line = 0        !! line of the last closing slash
    logical :: open = .false.        !! an assignment takes values
    logical :: semicolon = .false.   !! a semicolon of the group was reported
    logical :: expecting = .false.   !! a value is due: after `=` and after a comma
  contains
    procedure :: at_end
    procedure :: next
    procedure :: skip_blanks
    procedure :: skip_line
    procedure :: word_ahead
    procedure :: skip_equals
  end type scanner

contains

  !> Whether all characters have been read.
  pure logical function at_end(self) result(yes)
    class(scanner), intent(in) :: self
    yes = self%position > len(self%text)
  end function at_end

  !> The next character.
  pure character(1) function next(self) result(c)
    class(scanner), intent(in) :: self
    c = self%text(self%position:self%position)
  end function next

  !> Moves over blanks, line ends and comments.
  pure subroutine skip_blanks(self)
    class(scanner), intent(inout) :: self
    do while (.not. self%at_end())
      select case (self%next())
      case (' ', tab)
        self%position = self%position + 1
      case (lf)
        self%position = self%position + 1
        self%line = self%line + 1
      case ('!')
        call self%skip_line()
      case default
        exit
      end select
    end do
  end subroutine skip_blanks

  !> Moves to the end of the line, before its line feed.
  pure subroutine skip_line(self)
    class(scanner), intent(inout) :: self
    self%position = self%position + index(self%text(self%position:), lf) - 1
  end subroutine skip_line

  !> The word at the scanner's position, with a subscript in brackets if it has one; may be empty.
  pure function word_ahead(self) result(word)
    class(scanner), intent(in) :: self
    character(:), allocatable :: word
    integer :: last, bracket, closing
    last = self%position + scan(self%text(self%position:), word_end) - 2
    bracket = 0
    if (is_letter(self%next())) bracket = index(self%text(self%position:last), '(')
    if (bracket > 0 .and. index(self%text(self%position:last), ')') == 0) then
      closing = scan(self%text(last + 1:), ')'//lf//'='//single//double)
      if (self%text(last + closing:last + closing) == ')') last = last + closing
    end if
    word = self%text(self%position:last)
  end function word_ahead

  !> Whether the next character that is not blank or comment is an equals sign; if so the scanner moves behind it.
  logical function skip_equals(self) result(yes)
    class(scanner), intent(inout) :: self
    integer :: position, line
    position = self%position
    line = self%line
    call self%skip_blanks()
    yes = .false.
    if (.not. self%at_end()) yes = self%next() == '='
    if (yes) then
      self%position = self%position + 1
    else
      self%position = position
      self%line = line
    end if
  end function skip_equals

  !> Whether a character is an ASCII letter.
  pure logical function is_letter(c) result(yes)
    character(1), intent(in) :: c
    yes = lge(lower(c), 'a') .and. lle(lower(c), 'z')
  end function is_letter
end module deck_scanner
