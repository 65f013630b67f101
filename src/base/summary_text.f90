!> A run's summary: a list of facts, each with name, value, unit and sentence, written once for two readers. A sentence names the
!> facts in it in braces; summary.txt shows it with their values, rounded, summary.json holds the values in full under the names, so
!> that the two cannot differ.
module summary_text
  use kinds, only: wp, ip
  use archive, only: value_archive
  use growing_text, only: text_buffer
  use posix, only: tell
  use readable_text, only: json_text
  use text, only: exact_text, short_text, to_text
  implicit none (type, external)
  private
  public :: json_number

  !> A summary that is being written.
  type, public :: summary_record
    character(:), allocatable :: path             !! of the deck, in front of warnings on standard error
    type(text_buffer) :: words                    !! lines so far, and the beginning of the next one
    type(text_buffer) :: members                  !! of the JSON object, so far
    type(text_buffer) :: warnings                 !! elements of its list of warnings, so far
    type(text_buffer) :: outside                  !! those among them that tell of motion which the model does not hold for
    character(8) :: open_brackets = ''            !! '{' or '[' of the objects and lists that are not closed
    logical :: silent = .false.                   !! warnings go to `pending` instead of standard error
    type(text_buffer) :: pending                !! their lines
  contains
    procedure :: say
    procedure :: line
    procedure :: item
    procedure :: table
    procedure :: section
    procedure :: word
    procedure :: open => open_bracket
    procedure :: close => close_bracket
    procedure :: append
    procedure :: warn
    procedure :: json
    procedure :: member
    procedure :: exchange
  end type summary_record

contains

  !> A part of a line. In braces stand, each after the name of its fact: nothing (the next value, in few digits), a number (so many
  !> decimals of d.ddE+ee), # (a count), % (in hundredths), or = and a word, of which `word` takes any letters.
  subroutine say(self, sentence, values)
    class(summary_record), intent(inout) :: self
    character(*), intent(in) :: sentence
    real(wp), intent(in), optional :: values(:)   !! [units that the sentence names]
    integer :: from, left, right, n
    n = 0
    from = 1
    do
      left = from + index(sentence(from:), '{') - 1
      right = from + index(sentence(from:), '}') - 1
      if (left < from .or. right < left) exit
      call self%words%add(sentence(from:left - 1))
      call one_fact(sentence(left + 1:right - 1))
      from = right + 1
    end do
    call self%words%add(sentence(from:))
  contains
    !> What stands in a pair of braces.
    subroutine one_fact(fact)
      character(*), intent(in) :: fact
      character(:), allocatable :: shown, full
      integer :: mark
      mark = index(fact, '=')
      if (mark > 0) then
        call self%word('', fact(:mark - 1), fact(mark + 1:))
        return
      end if
      n = n + 1
      mark = index(fact//' ', ' ')
      full = json_number(values(n))
      select case (fact(min(mark + 1, len(fact) + 1):))
      case ('')
        shown = to_text(values(n))
      case ('#')
        full = to_text(nint(values(n), ip))
        shown = full
      case ('%')
        shown = to_text(anint(100*values(n))/100)
      case default
        shown = short_text(values(n), index('123456789', fact(mark + 1:)))
      end select
      call self%words%add(shown)
      call self%member(fact(:mark - 1), full)
    end subroutine one_fact
  end subroutine say

  !> Ends the present line of words; braces as in `say`.
  subroutine line(self, sentence, values)
    class(summary_record), intent(inout) :: self
    character(*), intent(in) :: sentence          !! rest of the line
    real(wp), intent(in), optional :: values(:)   !! [units that the sentence names]
    call self%say(sentence//new_line('a'), values)
  end subroutine line

  !> An object of a list and its line; braces as in `say`.
  subroutine item(self, sentence, values)
    class(summary_record), intent(inout) :: self
    character(*), intent(in) :: sentence
    real(wp), intent(in), optional :: values(:)   !! [units that the sentence names]
    call self%open('', '{')
    call self%line(sentence, values)
    call self%close()
  end subroutine item

  !> An object with a value for each column, a line each.
  subroutine table(self, name, columns, values, decimals, rest)
    class(summary_record), intent(inout) :: self
    character(*), intent(in) :: name              !! of the object
    character(*), intent(in) :: columns(:)        !! name[unit]
    real(wp), intent(in) :: values(:)             !! [of the column]
    integer, intent(in) :: decimals
    character(*), intent(in), optional :: rest(:)  !! of the lines
    integer :: k
    call self%open(name, '{')
    do k = 1, size(columns)
      call self%say('    '//trim(columns(k))//' {'//trim(columns(k))//' '//to_text(decimals)//'}', values(k:k))
      if (present(rest)) call self%words%add(trim(rest(k)))
      call self%line('')
    end do
    call self%close()
  end subroutine table

  !> An object with a heading of its own.
  subroutine section(self, name, heading)
    class(summary_record), intent(inout) :: self
    character(*), intent(in) :: name, heading
    call self%line('')
    call self%line(heading)
    call self%open(name, '{')
  end subroutine section

  !> A fact that is a word, of any letters.
  subroutine word(self, lead, name, value)
    class(summary_record), intent(inout) :: self
    character(*), intent(in) :: lead              !! words in front of it
    character(*), intent(in) :: name              !! of the fact in summary.json
    character(*), intent(in) :: value
    call self%words%add(lead//value)
    call self%member(name, json_text(value))
  end subroutine word

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
    if (self%outside%used > 0 .and. part%outside%used > 0) call self%outside%add(',')
    call self%outside%add(part%outside%all())
    self%open_brackets = part%open_brackets
  end subroutine append

  !> Saves or restores a part.
  subroutine exchange(self, a)
    class(summary_record), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    call a%exchange(self%open_brackets)
    call exchange_buffer(self%words)
    call exchange_buffer(self%members)
    call exchange_buffer(self%warnings)
    call exchange_buffer(self%outside)
    call exchange_buffer(self%pending)
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

  !> Warnings, `warning: ...` in a line each, into the words, the list of summary.json and, with the deck's path, standard error.
  subroutine warn(self, sentences, in_words, outside)
    class(summary_record), intent(inout) :: self
    character(*), intent(in) :: sentences         !! separated by line ends
    logical, intent(in), optional :: in_words     !! .false.: not into the words
    logical, intent(in), optional :: outside      !! .true.: the model does not hold for this motion
    integer :: from, to
    from = 1
    do while (from <= len(sentences))
      to = from + index(sentences(from:)//new_line('a'), new_line('a')) - 2
      associate (sentence => sentences(from:to))
        if (.not. present(in_words)) call self%words%add('  warning: '//sentence//new_line('a'))
        if (self%silent) then
          call self%pending%add(self%path//': warning: '//sentence//new_line('a'))
        else
          call tell(self%path//': warning: '//sentence)
        end if
        if (self%warnings%used > 0) call self%warnings%add(',')
        call self%warnings%add(new_line('a')//'    '//json_text(sentence))
        if (present(outside)) then
          if (self%outside%used > 0) call self%outside%add(',')
          call self%outside%add(new_line('a')//'    '//json_text(sentence))
        end if
      end associate
      from = to + 2
    end do
  end subroutine warn

  !> All figures as a JSON object.
  function json(self) result(text)
    class(summary_record), intent(in) :: self
    character(:), allocatable :: text
    text = '{'//self%members%all()//','//new_line('a')//'  "warnings": ['//self%warnings%all()//'],'//new_line('a')// &
      '  "outside_model": ['//self%outside%all()//']'//new_line('a')//'}'
  end function json

  !> A number as JSON has it, in as few digits as give it back; null where it is infinite or none.
  function json_number(x) result(text)
    real(wp), intent(in) :: x                     !! [any]
    character(:), allocatable :: text
    text = 'null'
    if (abs(x) < huge(1.0_wp)) text = exact_text(x)
  end function json_number
end module summary_text
