!> Splits the text of a deck into groups, assignments and values, each with its line. It follows the namelist format
!> (comments, quotes, repeat counts, any mixture of blanks, commas and new lines), but a string ends on its line and
!> nothing but comments stands between groups.
module deck_lexer
  use text, only: lower, to_text, word_hash, printable
  use errors, only: fault_list
  use deck_kinds, only: group_number, name_characters
  use deck_syntax, only: syntax, group, assignment, value_token, bare_value, string_value, null_value, bad_value
  implicit none (type, external)
  private
  public :: split_groups, group_subject

  character(*), parameter :: lf = achar(10), tab = achar(9), single = '''', double = '"'
  character(*), parameter :: word_end = ' ,;=/!&'//single//double//tab//lf   !! characters that end a word
  character(*), parameter :: digits = '0123456789'
  integer, parameter :: most_repeats = 10000000   !! a larger repeat count is a slip of the pen
  integer, parameter :: shown = 40                !! characters of a faulty text shown in a message

  !> A position in the text of one file.
  type :: scanner
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
  end type scanner

contains

  !> Appends the groups of one file to `list` and its faults to `faults`.
  subroutine split_groups(list, file, faults)
    type(syntax), intent(inout) :: list        !! receives the groups
    integer, intent(in) :: file                !! number of a file of `list`
    type(fault_list), intent(inout) :: faults  !! receives the faults
    type(scanner) :: s
    character(:), allocatable :: word
    s%text = list%sources(file)%text
    s%path = list%sources(file)%path
    s%file = file
    do
      call s%skip_blanks()
      if (s%at_end()) exit
      if (s%next() == '&') then
        s%position = s%position + 1
        call read_group(s, list, faults)
        cycle
      end if
      if (s%next() == '$') s%position = s%position + 1
      word = word_ahead(s)
      if (group_number(word) > 0) then
        call faults%add(s%path, s%line, word, 'a group starts with &, expected &'//word)
        call read_group(s, list, faults)
      else
        call skip_stray(s, list, faults)
      end if
    end do
  end subroutine split_groups

  !> Reads one group; the scanner stands on its name and ends behind its slash.
  subroutine read_group(s, list, faults)
    type(scanner), intent(inout) :: s
    type(syntax), intent(inout) :: list
    type(fault_list), intent(inout) :: faults
    type(group) :: new
    character(:), allocatable :: word
    word = word_ahead(s)
    new%file = s%file
    new%line = s%line
    new%first = s%position
    new%last = s%position + len(word) - 1
    s%position = new%last + 1
    s%open = .false.
    s%expecting = .false.
    s%semicolon = .false.
    call list%add_group(new)
    if (len(word) == 0) then
      list%groups(list%group_count)%readable = .false.
      call faults%add(s%path, s%line, '', '& without the name of a group, expected one such as &body')
    end if
    do
      call s%skip_blanks()
      if (s%at_end()) then
        call missing_slash(s, list, 'the end of the file', faults)
        exit
      end if
      if (s%next() == '/') then
        s%slash_line = s%line
        s%position = s%position + 1
        exit
      else if (s%next() == '&') then
        call close_at_group(s, list, faults)
        exit
      end if
      call read_part(s, list, faults)
    end do
  end subroutine read_group

  !> Reads the next part of a group: a comma, a string, or a word, which is a value or the name of a variable.
  subroutine read_part(s, list, faults)
    type(scanner), intent(inout) :: s
    type(syntax), intent(inout) :: list
    type(fault_list), intent(inout) :: faults
    select case (s%next())
    case (',')
      s%position = s%position + 1
      if (.not. s%open) return
      if (s%expecting) call list%add_value(value_token(form=null_value, line=s%line))
      s%expecting = .true.
    case ('=')
      call faults%add(s%path, s%line, group_subject(list, list%group_count), &
        '= without the name of a variable before it, expected name=value')
      s%position = s%position + 1
      list%groups(list%group_count)%whole = .false.
      call list%add_assignment(assignment(first=s%position, last=s%position - 1, line=s%line, equals=.true.))
      s%open = .true.
      s%expecting = .true.
    case (';')
      if (.not. s%semicolon) call faults%add(s%path, s%line, group_subject(list, list%group_count), &
        '; does not separate anything, expected a blank, a comma or a new line')
      s%semicolon = .true.
      s%position = s%position + 1
    case (single, double)
      call read_string(s, 1, list, faults)
    case default
      call read_word(s, list, faults)
    end select
  end subroutine read_part

  !> Reads a string, which ends on its line; a doubled quote stands for one.
  subroutine read_string(s, repeats, list, faults)
    type(scanner), intent(inout) :: s
    integer, intent(in) :: repeats             !! repeat count in front of it
    type(syntax), intent(inout) :: list
    type(fault_list), intent(inout) :: faults
    character(1) :: quote
    integer :: first, i
    quote = s%next()
    first = s%position + 1
    i = first
    do
      if (s%text(i:i) == lf) then
        if (list%groups(list%group_count)%readable) call faults%add(s%path, s%line, &
          group_subject(list, list%group_count), 'a quote is not closed on its line: '// &
          quote//printable(s%text(first:i - 1), shown))
        list%groups(list%group_count)%readable = .false.
        s%position = i
        return
      end if
      if (s%text(i:i) == quote) then
        if (s%text(i + 1:i + 1) /= quote) exit
        i = i + 1
      end if
      i = i + 1
    end do
    s%position = i + 1
    call take_value(s, list, value_token(form=string_value, first=first, last=i - 1, repeats=repeats, line=s%line))
  end subroutine read_string

  !> Reads a word: the name of a variable if an equals sign follows, a value otherwise.
  subroutine read_word(s, list, faults)
    type(scanner), intent(inout) :: s
    type(syntax), intent(inout) :: list
    type(fault_list), intent(inout) :: faults
    character(:), allocatable :: word
    type(assignment) :: new
    integer :: first, line
    logical :: equals
    word = word_ahead(s)
    first = s%position
    line = s%line
    s%position = first + len(word)
    equals = .false.
    if (is_letter(word(1:1))) equals = equals_ahead(s)
    if (equals .or. begins_assignment(s, list, word)) then
      new = assignment(first=first, last=first + len(word) - 1, line=line, equals=equals)
      new%hash = word_hash(lower(word))
      call list%add_assignment(new)
      s%open = .true.
      s%expecting = .true.
    else
      call read_bare(s, word, first, line, list, faults)
    end if
  end subroutine read_word

  !> Takes a word without quotes as a value, its repeat count split off.
  subroutine read_bare(s, word, first, line, list, faults)
    type(scanner), intent(inout) :: s
    character(*), intent(in) :: word           !! the word, the scanner stands behind it
    integer, intent(in) :: first               !! its first character
    integer, intent(in) :: line                !! its line
    type(syntax), intent(inout) :: list
    type(fault_list), intent(inout) :: faults
    type(value_token) :: new
    integer :: star, status
    new = value_token(form=bare_value, first=first, last=first + len(word) - 1, line=line)
    star = verify(word, digits)
    if (star > 1) then
      if (word(star:star) == '*') then
        read (word(1:star - 1), *, iostat=status) new%repeats
        if (star > 9) status = 1
        if (status == 0) then
          if (new%repeats < 1 .or. new%repeats > most_repeats) status = 1
        end if
        if (status /= 0) then
          call faults%add(s%path, line, group_subject(list, list%group_count), 'repeat count '// &
            printable(word(1:star - 1), shown)//'* is out of range, expected 1 to '//to_text(most_repeats))
          new%form = bad_value
          new%repeats = 1
        end if
        new%first = first + star
        if (star == len(word)) then
          if (scan(s%next(), single//double) > 0 .and. status == 0) then
            call read_string(s, new%repeats, list, faults)
            return
          end if
          if (status == 0) new%form = null_value
        end if
      end if
    end if
    call take_value(s, list, new)
  end subroutine read_bare

  !> Appends a value to the open assignment; a value before any variable starts one without a name.
  subroutine take_value(s, list, new)
    type(scanner), intent(inout) :: s
    type(syntax), intent(inout) :: list
    type(value_token), intent(in) :: new
    if (.not. s%open) then
      call list%add_assignment(assignment(first=new%first, last=new%first - 1, line=new%line, equals=.false.))
      s%open = .true.
    end if
    call list%add_value(new)
    s%expecting = .false.
  end subroutine take_value

  !> Whether a word without an equals sign behind it was meant as the name of a variable: it looks like one, and no
  !> value is due.
  pure function begins_assignment(s, list, word) result(yes)
    class(scanner), intent(in) :: s
    type(syntax), intent(in) :: list
    character(*), intent(in) :: word
    logical :: yes
    yes = .false.
    if (.not. is_letter(word(1:1))) return
    if (.not. s%open) then
      yes = .true.
      return
    end if
    select case (lower(word))
    case ('t', 'f', 'true', 'false', 'nan', 'inf', 'infinity')
    case default
      yes = list%assignments(list%assignment_count)%values > 0 .and. .not. s%expecting
    end select
  end function begins_assignment

  !> Whether a character is an ASCII letter.
  pure function is_letter(c) result(yes)
    character(1), intent(in) :: c
    logical :: yes
    yes = lge(lower(c), 'a') .and. lle(lower(c), 'z')
  end function is_letter

  !> Whether the next character that is not blank or comment is an equals sign; if so the scanner moves behind it.
  function equals_ahead(s) result(yes)
    type(scanner), intent(inout) :: s
    logical :: yes
    integer :: position, line
    position = s%position
    line = s%line
    call s%skip_blanks()
    yes = .false.
    if (.not. s%at_end()) yes = s%next() == '='
    if (yes) then
      s%position = s%position + 1
    else
      s%position = position
      s%line = line
    end if
  end function equals_ahead

  !> The word at the scanner's position, with a subscript in brackets if it has one; may be empty.
  pure function word_ahead(s) result(word)
    type(scanner), intent(in) :: s
    character(:), allocatable :: word
    integer :: last, bracket, closing
    last = s%position + scan(s%text(s%position:), word_end) - 2
    bracket = index(s%text(s%position:last), '(')
    if (bracket > 0 .and. is_letter(s%text(s%position:s%position)) .and. index(s%text(s%position:last), ')') == 0) then
      closing = scan(s%text(last + 1:), ')'//lf//'='//single//double)
      if (s%text(last + closing:last + closing) == ')') last = last + closing
    end if
    word = s%text(s%position:last)
  end function word_ahead

  !> Reports a group without its closing slash.
  subroutine missing_slash(s, list, before, faults)
    type(scanner), intent(in) :: s
    type(syntax), intent(in) :: list
    character(*), intent(in) :: before         !! where the group ends instead
    type(fault_list), intent(inout) :: faults
    associate (g => list%groups(list%group_count))
      if (g%readable) call faults%add(s%path, g%line, group_subject(list, list%group_count), &
        'no closing slash before '//before//', expected /')
    end associate
  end subroutine missing_slash

  !> Ends a group where the next one starts, or at an old-style &end.
  subroutine close_at_group(s, list, faults)
    type(scanner), intent(inout) :: s
    type(syntax), intent(in) :: list
    type(fault_list), intent(inout) :: faults
    character(:), allocatable :: word
    s%position = s%position + 1
    word = word_ahead(s)
    if (lower(word) == 'end') then
      s%position = s%position + len(word)
      s%slash_line = s%line
    else
      s%position = s%position - 1
    end if
    call missing_slash(s, list, '&'//printable(word, shown)//' in line '//to_text(s%line), faults)
  end subroutine close_at_group

  !> Reports text between groups, once, and goes on at the next group.
  subroutine skip_stray(s, list, faults)
    type(scanner), intent(inout) :: s
    type(syntax), intent(inout) :: list
    type(fault_list), intent(inout) :: faults
    integer :: last
    last = s%position + index(s%text(s%position:), lf) - 2
    call faults%add(s%path, s%line, '', 'text between groups: '''//printable(trim(s%text(s%position:last)), shown)// &
      ''', expected a group such as &body or a comment after !')
    if (s%line == s%slash_line) list%groups(list%group_count)%whole = .false.   ! its slash came too early
    do while (.not. s%at_end())
      if (s%next() == '&' .and. scan(s%text(s%position - 1:s%position - 1), ' '//tab//lf//'/') > 0) exit
      if (s%next() == '!') then
        call s%skip_line()
      else
        if (s%next() == lf) s%line = s%line + 1
        s%position = s%position + 1
      end if
    end do
  end subroutine skip_stray

  !> `group/name` of a group, for messages; only `group` if its name cannot be read.
  function group_subject(list, number) result(subject)
    type(syntax), intent(in) :: list
    integer, intent(in) :: number   !! which group
    character(:), allocatable :: subject
    integer :: k, hash
    associate (g => list%groups(number))
      associate (body => list%sources(g%file)%text)
        subject = printable(lower(body(g%first:g%last)), shown)
        hash = word_hash('name')
        do k = g%first_assignment, g%first_assignment + g%assignments - 1
          if (list%assignments(k)%hash /= hash) cycle
          if (list%assignments(k)%values < 1) exit
          associate (v => list%values(list%assignments(k)%first_value))
            if (v%form == string_value .and. v%last >= v%first .and. &
              verify(lower(body(v%first:v%last)), name_characters) == 0) subject = subject//'/'// &
              printable(body(v%first:v%last), shown)
          end associate
          exit
        end do
      end associate
    end associate
  end function group_subject

  !> Whether all characters have been read.
  pure function at_end(self) result(yes)
    class(scanner), intent(in) :: self
    logical :: yes
    yes = self%position > len(self%text)
  end function at_end

  !> The next character.
  pure function next(self) result(c)
    class(scanner), intent(in) :: self
    character(1) :: c
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
end module deck_lexer
