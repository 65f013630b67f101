!> A run's summary, written once for two readers: words for people (summary.txt) and named figures for programs
!> (summary.json). One call writes a figure into a line of words and stores it under its name, so that the two cannot differ.
module summary_text
  use kinds, only: wp, ip
  use archive, only: value_archive
  use growing_text, only: text_buffer
  use readable_text, only: json_text
  use text, only: es_text, exact_text, to_text
  implicit none (type, external)
  private
  public :: json_number

  !> A summary that is being written.
  type, public :: summary_record
    type(text_buffer) :: words                    !! lines so far, and the beginning of the next one
    type(text_buffer) :: members                  !! of the JSON object, so far
    type(text_buffer) :: warnings                 !! elements of its list of warnings, so far
    character(8) :: open_brackets = ''            !! '{' or '[' of the objects and lists that are not closed
    logical :: silent = .false.                   !! warnings go to `held_back` instead of standard error
    type(text_buffer) :: held_back                !! their lines
  contains
    procedure :: line
    procedure :: open => open_bracket
    procedure :: close => close_bracket
    procedure :: append
    procedure :: warning
    procedure :: json
    procedure :: member
    procedure :: exchange
    procedure, private :: put_integer, put_long, put_real, put_word
    generic :: figure => put_integer, put_long, put_real, put_word
  end type summary_record

contains

  !> Ends the present line of words.
  subroutine line(self, words)
    class(summary_record), intent(inout) :: self
    character(*), intent(in) :: words             !! rest of the line
    call self%words%add(words//new_line('a'))
  end subroutine line

  !> An integer after the words in front of it. `rest` ends the line.
  subroutine put_integer(self, lead, name, n, rest)
    class(summary_record), intent(inout) :: self
    character(*), intent(in) :: lead              !! words in front of the number
    character(*), intent(in) :: name              !! of the figure in summary.json
    integer, intent(in) :: n                      !! any count
    character(*), intent(in), optional :: rest    !! words behind it, which end the line
    call self%put_long(lead, name, int(n, ip), rest)
  end subroutine put_integer

  !> An integer of 64 bits.
  subroutine put_long(self, lead, name, n, rest)
    class(summary_record), intent(inout) :: self
    character(*), intent(in) :: lead, name
    integer(ip), intent(in) :: n                  !! any count
    character(*), intent(in), optional :: rest
    call self%words%add(lead//to_text(n))
    call self%member(name, to_text(n))
    if (present(rest)) call self%line(rest)
  end subroutine put_long

  !> A real number: rounded in the words, in full in the figure.
  subroutine put_real(self, lead, name, x, decimals, rest)
    class(summary_record), intent(inout) :: self
    character(*), intent(in) :: lead, name
    real(wp), intent(in) :: x                     !! [unit that the words name]
    integer, intent(in), optional :: decimals     !! of d.ddE+ee; left out: few digits
    character(*), intent(in), optional :: rest
    if (present(decimals)) then
      call self%words%add(lead//es_text(x, decimals))
    else
      call self%words%add(lead//to_text(x))
    end if
    call self%member(name, json_number(x))
    if (present(rest)) call self%line(rest)
  end subroutine put_real

  !> A word.
  subroutine put_word(self, lead, name, word, rest)
    class(summary_record), intent(inout) :: self
    character(*), intent(in) :: lead, name
    character(*), intent(in) :: word              !! any text
    character(*), intent(in), optional :: rest
    call self%words%add(lead//word)
    call self%member(name, json_text(word))
    if (present(rest)) call self%line(rest)
  end subroutine put_word

  !> Adds a member with its value as JSON has it; inside a list the name is left out.
  subroutine member(self, name, value)
    class(summary_record), intent(inout) :: self
    character(*), intent(in) :: name, value
    if (self%members%used > 0 .and. scan(self%members%last(), '{[') == 0) call self%members%add(',')
    call self%members%add(new_line('a')//repeat('  ', len_trim(self%open_brackets) + 1))
    if (.not. in_list(self)) call self%members%add(json_text(name)//': ')
    call self%members%add(value)
  end subroutine member

  !> Whether the innermost bracket is that of a list.
  pure logical function in_list(self) result(yes)
    class(summary_record), intent(in) :: self
    integer :: depth
    depth = len_trim(self%open_brackets)
    yes = .false.
    if (depth > 0) yes = self%open_brackets(depth:depth) == '['
  end function in_list

  !> Opens an object or a list.
  subroutine open_bracket(self, name, bracket)
    class(summary_record), intent(inout) :: self
    character(*), intent(in) :: name              !! of the object; without a meaning inside a list
    character(1), intent(in) :: bracket           !! '{' or '['
    call self%member(name, bracket)
    self%open_brackets(len_trim(self%open_brackets) + 1:) = bracket
  end subroutine open_bracket

  !> Closes the object or list opened last.
  subroutine close_bracket(self)
    class(summary_record), intent(inout) :: self
    integer :: depth
    depth = len_trim(self%open_brackets)
    call self%members%add(new_line('a')//repeat('  ', depth)//merge(']', '}', in_list(self)))
    self%open_brackets(depth:) = ''
  end subroutine close_bracket

  !> Appends a part that was written separately; brackets that it left open stay open.
  subroutine append(self, part)
    class(summary_record), intent(inout) :: self
    type(summary_record), intent(in) :: part
    call self%words%add(part%words%all())
    if (self%members%used > 0 .and. part%members%used > 0) call self%members%add(',')
    call self%members%add(part%members%all())
    if (self%warnings%used > 0 .and. part%warnings%used > 0) call self%warnings%add(',')
    call self%warnings%add(part%warnings%all())
    self%open_brackets = part%open_brackets
  end subroutine append

  !> Saves or restores a part whose brackets are closed.
  subroutine exchange(self, a)
    class(summary_record), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    call exchange_buffer(self%words)
    call exchange_buffer(self%members)
    call exchange_buffer(self%warnings)
    call exchange_buffer(self%held_back)
  contains
    !> One of its texts.
    subroutine exchange_buffer(buffer)
      type(text_buffer), intent(inout) :: buffer
      character(:), allocatable :: text
      integer :: n
      text = buffer%all()
      n = len(text)
      call a%exchange(n)
      if (.not. a%saving) text = repeat(' ', n)
      call a%exchange(text)
      if (.not. a%saving) buffer = text_buffer()
      if (.not. a%saving) call buffer%add(text)
    end subroutine exchange_buffer
  end subroutine exchange

  !> Adds a sentence to the list of warnings of summary.json; into the words the caller writes it.
  subroutine warning(self, sentence)
    class(summary_record), intent(inout) :: self
    character(*), intent(in) :: sentence
    if (self%warnings%used > 0) call self%warnings%add(',')
    call self%warnings%add(new_line('a')//'    '//json_text(sentence))
  end subroutine warning

  !> All figures as a JSON object.
  function json(self) result(text)
    class(summary_record), intent(in) :: self
    character(:), allocatable :: text
    text = '{'//self%members%all()//','//new_line('a')//'  "warnings": ['//self%warnings%all()//']'//new_line('a')//'}'
  end function json

  !> A number as JSON has it, in as few digits as give it back; null where it is infinite or none.
  function json_number(x) result(text)
    real(wp), intent(in) :: x                     !! [any]
    character(:), allocatable :: text
    text = 'null'
    if (abs(x) < huge(1.0_wp)) text = exact_text(x)
  end function json_number
end module summary_text
