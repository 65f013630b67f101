!> Splits the text of a deck into groups, assignments and values, each with its line. It follows the namelist format
!> (comments, quotes, repeat counts, any mixture of blanks, commas and new lines), but a string ends on its line and
!> nothing but comments stands between groups.
module deck_lexer
  use readable_text, only: lf, printable, tab
  use text, only: digits, lower, to_text
  use deck_cursor, only: group_cursor
  use deck_keys, only: group_names
  use deck_numbers, only: read_integer
  use deck_syntax, only: group, setting, value_token, bare_value, string_value, expression_value, null_value, &
    bad_value, most, shown
  implicit none (type, external)
  private
  public :: split_groups

  character(*), parameter :: single = '''', double = '"'
  character(*), parameter :: word_end = ' ,=/!&'//single//double//tab//lf   !! characters that end a word

  !> A position in the text of one file.
  type :: scanner
    character(:), allocatable :: text
    character(:), allocatable :: path
    integer :: file = 0              !! number of the file
    integer :: position = 1          !! next character
    integer :: line = 1              !! its line
    integer :: slash_line = 0        !! line of the last closing slash
    logical :: open = .false.        !! an assignment takes values
    logical :: expecting = .false.   !! a value is due: after `=` and after a comma
  end type scanner

contains

  !> Appends the groups and the faults of one file.
  subroutine split_groups(deck, file)
    class(group_cursor), intent(inout) :: deck   !! receives both
    integer, intent(in) :: file                  !! number of the file
    type(scanner) :: s
    character(:), allocatable :: word
    s%text = deck%parts%sources(file)%text
    s%path = deck%parts%sources(file)%path
    s%file = file
    do
      call skip_blanks()
      if (at_end()) exit
      if (next() == '&') then
        s%position = s%position + 1
        call read_group()
        cycle
      end if
      word = word_ahead()
      if (any(group_names == lower(word))) then
        call deck%faults%add(s%path, s%line, word, 'a group starts with &, expected &'//word)
        call read_group()
      else
        call skip_stray()
      end if
    end do
  contains
    !> Reads one group; the scanner stands on its name and ends behind its slash.
    subroutine read_group()
      type(group) :: new
      character(:), allocatable :: word
      word = word_ahead()
      new%kind = findloc(group_names == lower(word), .true., 1)
      new%file = s%file
      new%line = s%line
      new%first = s%position
      new%last = s%position + len(word) - 1
      s%position = new%last + 1
      s%open = .false.
      s%expecting = .false.
      call deck%parts%add_group(new)
      deck%current = deck%parts%group_count
      if (len(word) == 0) then
        deck%parts%groups(deck%current)%readable = .false.
        call deck%faults%add(s%path, s%line, '', '& without the name of a group, expected one such as &body')
      end if
      do
        call skip_blanks()
        if (at_end()) then
          call missing_slash('the end of the file')
          exit
        end if
        if (next() == '/') then
          s%slash_line = s%line
          deck%parts%groups(deck%current)%slash = s%position
          s%position = s%position + 1
          exit
        else if (next() == '&') then
          call close_at_group()
          exit
        end if
        call read_part()
      end do
    end subroutine read_group

    !> Reads the next part of a group: a comma, a string, or a word, which is a value or the name of a variable.
    subroutine read_part()
      select case (next())
      case (',')
        s%position = s%position + 1
        if (.not. s%open) return
        if (s%expecting) call deck%parts%add_value(value_token(form=null_value, line=s%line))
        s%expecting = .true.
      case ('=')
        call deck%add_fault(s%line, '= without the name of a variable before it, expected name=value')
        s%position = s%position + 1
        deck%parts%groups(deck%current)%complete = .false.
        call deck%parts%add_assignment(setting(first=s%position, last=s%position - 1, line=s%line, equals=.true.))
        s%open = .true.
        s%expecting = .true.
      case (single, double)
        call read_string(1)
      case default
        call read_word()
      end select
    end subroutine read_part

    !> Reads a string, which ends on its line; a doubled quote stands for one.
    subroutine read_string(repeats)
      integer, intent(in) :: repeats             !! repeat count in front of it
      character(1) :: quote
      integer :: first, i
      quote = next()
      first = s%position + 1
      i = first
      do
        if (s%text(i:i) == lf) then
          call not_closed('quote', first - 1, quote)
          return
        end if
        if (s%text(i:i) == quote) then
          if (s%text(i + 1:i + 1) /= quote) exit
          i = i + 1
        end if
        i = i + 1
      end do
      s%position = i + 1
      call append_value(value_token(form=string_value, first=first, last=i - 1, repeats=repeats, line=s%line))
    end subroutine read_string

    !> Reports a quote or a brace that is not closed on its line; what else the group says cannot be trusted.
    subroutine not_closed(what, first, closing)
      character(*), intent(in) :: what, closing
      integer, intent(in) :: first               !! where it opens
      integer :: last
      last = first + index(s%text(first:), lf) - 2
      if (deck%parts%groups(deck%current)%readable) call deck%add_fault(s%line, 'a '//what//' is not closed on its line: '// &
        printable(s%text(first:last), shown)//', expected a closing '//closing)
      deck%parts%groups(deck%current)%readable = .false.
      s%position = last + 1
    end subroutine not_closed

    !> Reads a word: the name of a variable if an equals sign follows, a value otherwise.
    subroutine read_word()
      character(:), allocatable :: word
      type(setting) :: new
      integer :: first, line
      logical :: equals
      word = word_ahead()
      first = s%position
      line = s%line
      s%position = first + len(word)
      equals = .false.
      if (is_letter(word(1:1))) equals = skip_equals()
      if (equals .or. begins_assignment(word)) then
        new = setting(first=first, last=first + len(word) - 1, line=line, equals=equals)
        new%name = lower(word)
        call deck%parts%add_assignment(new)
        s%open = .true.
        s%expecting = .true.
      else
        call read_bare(word, first, line)
      end if
    end subroutine read_word

    !> Takes a word without quotes or an expression in braces as a value, its repeat count split off.
    subroutine read_bare(word, first, line)
      character(*), intent(in) :: word           !! the word, the scanner stands behind it
      integer, intent(in) :: first               !! its first character
      integer, intent(in) :: line                !! its line
      type(value_token) :: new
      character(:), allocatable :: problem
      integer :: star
      new = value_token(form=bare_value, first=first, last=first + len(word) - 1, line=line)
      star = verify(word, digits)
      if (star > 1) then
        if (word(star:star) == '*') then
          new%first = first + star
          call read_integer(word(1:star - 1), new%repeats, problem)
          if (len(problem) > 0 .or. new%repeats < 1 .or. new%repeats > most) then
            call deck%add_fault(line, 'repeat count '// &
              printable(word(1:star), shown)//' is out of range, expected 1* to '//to_text(most)//'*')
            new%form = bad_value
            new%repeats = 1
          else if (star == len(word)) then
            new%form = null_value
            if (scan(next(), single//double) > 0) then
              call read_string(new%repeats)
              return
            end if
          end if
        end if
      end if
      if (new%form == bare_value .and. s%text(new%first:new%first) == '{') then
        if (index(s%text(new%first:new%last), '}') == 0) then
          call not_closed('brace', new%first, '}')
          return
        else if (index(s%text(new%first:new%last), '}') == new%last - new%first + 1) then
          new%form = expression_value
        end if
      end if
      call append_value(new)
    end subroutine read_bare

    !> Appends a value to the open assignment; a value before any variable starts one without a name.
    subroutine append_value(new)
      type(value_token), intent(in) :: new
      if (.not. s%open) then
        call deck%parts%add_assignment(setting(first=new%first, last=new%first - 1, line=new%line, equals=.false.))
        s%open = .true.
      end if
      call deck%parts%add_value(new)
      s%expecting = .false.
    end subroutine append_value

    !> Whether a word without an equals sign behind it was meant as the name of a variable: it looks like a name, and no value
    !> is expected.
    pure logical function begins_assignment(word) result(yes)
      character(*), intent(in) :: word
      yes = .false.
      if (.not. is_letter(word(1:1))) return
      if (.not. s%open) then
        yes = .true.
        return
      end if
      select case (lower(word))
      case ('t', 'f', 'true', 'false', 'nan', 'inf', 'infinity')
      case default
        yes = deck%parts%assignments(deck%parts%assignment_count)%values > 0 .and. .not. s%expecting
      end select
    end function begins_assignment

    !> Reports a group without its closing slash.
    subroutine missing_slash(before)
      character(*), intent(in) :: before         !! where the group ends instead
      associate (g => deck%parts%groups(deck%current))
        if (g%readable) call deck%add_fault(g%line, 'no closing slash before '//before//', expected /')
      end associate
    end subroutine missing_slash

    !> Ends a group where the next one starts, or at an old-style &end.
    subroutine close_at_group()
      character(:), allocatable :: word
      s%position = s%position + 1
      word = word_ahead()
      if (lower(word) == 'end') then
        s%position = s%position + len(word)
        s%slash_line = s%line
      else
        s%position = s%position - 1
      end if
      call missing_slash('&'//printable(word, shown)//' in line '//to_text(s%line))
    end subroutine close_at_group

    !> Reports text between groups, once, and goes on at the next group.
    subroutine skip_stray()
      integer :: last
      last = s%position + index(s%text(s%position:), lf) - 2
      call deck%faults%add(s%path, s%line, '', 'text between groups: '''//printable(trim(s%text(s%position:last)), shown)// &
        ''', expected a group such as &body or a comment after !')
      if (s%line == s%slash_line) deck%parts%groups(deck%current)%complete = .false.   ! its slash came too early
      do while (.not. at_end())
        if (next() == '&' .and. scan(s%text(max(s%position - 1, 1):s%position - 1), ' '//tab//lf//'/') > 0) exit
        if (next() == '!') then
          call skip_line()
        else
          if (next() == lf) s%line = s%line + 1
          s%position = s%position + 1
        end if
      end do
    end subroutine skip_stray

    !> Whether all characters have been read.
    pure logical function at_end() result(yes)
      yes = s%position > len(s%text)
    end function at_end

    !> The next character.
    pure character(1) function next() result(c)
      c = s%text(s%position:s%position)
    end function next

    !> Moves over blanks, line ends and comments.
    subroutine skip_blanks()
      do while (.not. at_end())
        select case (next())
        case (' ', tab)
          s%position = s%position + 1
        case (lf)
          s%position = s%position + 1
          s%line = s%line + 1
        case ('!')
          call skip_line()
        case default
          exit
        end select
      end do
    end subroutine skip_blanks

    !> Moves to the end of the line, before its line feed.
    subroutine skip_line()
      s%position = s%position + index(s%text(s%position:), lf) - 1
    end subroutine skip_line

    !> The word at the scanner's position, with a subscript in brackets if it has one; may be empty. Whatever stands in braces
    !> on one line belongs to it.
    pure function word_ahead() result(word)
      character(:), allocatable :: word
      integer :: last, bracket, closing
      last = s%position + scan(s%text(s%position:), word_end) - 2
      bracket = 0
      if (is_letter(next())) bracket = index(s%text(s%position:last), '(')
      if (bracket > 0 .and. index(s%text(s%position:last), ')') == 0) then
        closing = scan(s%text(last + 1:), ')'//lf//'='//single//double)
        if (s%text(last + closing:last + closing) == ')') last = last + closing
      end if
      bracket = s%position
      do while (index(s%text(bracket:last), '{') > 0)
        closing = scan(s%text(last + 1:), '}'//lf)
        if (index(s%text(bracket:last), '}') == 0) then
          if (s%text(last + closing:last + closing) == lf) exit
          last = last + closing
        end if
        bracket = bracket + index(s%text(bracket:last), '}')
        last = bracket + scan(s%text(bracket:), word_end) - 2
      end do
      word = s%text(s%position:last)
    end function word_ahead

    !> Whether the next character that is not blank or comment is an equals sign; if so the scanner moves behind it.
    logical function skip_equals() result(yes)
      integer :: position, line
      position = s%position
      line = s%line
      call skip_blanks()
      yes = .false.
      if (.not. at_end()) yes = next() == '='
      if (yes) then
        s%position = s%position + 1
      else
        s%position = position
        s%line = line
      end if
    end function skip_equals
  end subroutine split_groups

  !> Whether a character is an ASCII letter.
  pure logical function is_letter(c) result(yes)
    character(1), intent(in) :: c
    yes = lge(lower(c), 'a') .and. lle(lower(c), 'z')
  end function is_letter
end module deck_lexer
