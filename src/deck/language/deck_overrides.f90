!> Values that stand in the place of a deck's own: NAME=VALUE of a parameter (`deck_parameters` takes it), GROUP/KEY=VALUE or
!> GROUP/NAME/KEY=VALUE, of the command line or of an &include. The latter are written into the text of the file, so that all
!> that is told or printed of the deck has them.
module deck_overrides
  use readable_text, only: printable
  use text, only: lower, nearest_word, quoted, to_text
  use deck_cursor, only: group_cursor
  use deck_keys, only: group_names
  use deck_lexer, only: split_groups
  use deck_numbers, only: read_integer
  use deck_syntax, only: override, string_value
  implicit none (type, external)
  private
  public :: add_override, override_file, note_scopes, check_overrides, complain, written_as

contains

  !> Notes a setting; those that were noted before prevail.
  subroutine add_override(deck, setting, prefix, include, line)
    class(group_cursor), intent(inout) :: deck
    character(*), intent(in) :: setting        !! NAME=VALUE, GROUP/KEY=VALUE, GROUP/NAME/KEY=VALUE, KEY(2)=VALUE of a list; no
                                               !! VALUE: the key goes; GROUP/NAME/=: the group goes
    character(*), intent(in) :: prefix         !! of the names of the part for which it holds
    integer, intent(in) :: include, line       !! the &include in which it stands, its line; 0: the command line
    type(override), allocatable :: more(:)
    character(:), allocatable :: path, problem
    integer :: equals, first, last, bracket, k, n
    n = size(deck%parts%overrides)
    allocate (more(n + 1))
    do k = 1, n
      more(k) = deck%parts%overrides(k)
    end do
    equals = index(setting, '=')
    path = lower(trim(adjustl(setting(:equals - 1))))
    first = index(path, '/')
    last = index(path, '/', back=.true.)
    associate (new => more(n + 1))
      new%shown = trim(setting)
      new%value = trim(adjustl(setting(equals + 1:)))
      new%group = path(:first - 1)
      new%name = ''
      if (last > first) new%name = lower(prefix)//path(first + 1:last - 1)
      new%plain = first == 0
      if (new%plain) new%name = lower(prefix)//path
      new%key = path(last + 1:)
      new%include = include
      new%line = line
      new%target = 'parameter/'//new%name
      if (new%plain) new%key = 'value'
      bracket = index(new%key, '(')
      if (bracket > 0) then
        call read_integer(new%key(bracket + 1:max(bracket, len(new%key) - 1)), new%item, problem)
        if (len(problem) > 0 .or. new%item < 1 .or. new%key(len(new%key):) /= ')') new%item = -1
        new%key = new%key(:bracket - 1)
      end if
      if (.not. new%plain) new%values = value_count(new%value)
    end associate
    call move_alloc(more, deck%parts%overrides)
  end subroutine add_override

  !> Number of values in a text as it may stand behind a key; -1: there is something else in it.
  integer function value_count(text) result(n)
    character(*), intent(in) :: text
    type(group_cursor) :: trial
    call trial%parts%add_source('', '&x k='//text//' /'//achar(10), 0, '')
    call split_groups(trial, 1)
    n = -1
    if (trial%faults%count > 0 .or. trial%parts%group_count /= 1 .or. trial%parts%assignment_count /= 1) return
    call trial%enter(1)
    n = trial%tokens(1)
  end function value_count

  !> Whether a setting holds for a group of the deck, which is then open.
  logical function meant(deck, k, g) result(yes)
    class(group_cursor), intent(inout) :: deck
    integer, intent(in) :: k, g                !! the setting, the group
    call deck%enter(g)
    yes = deck%group_word(g) == deck%parts%overrides(k)%group
    if (yes .and. len(deck%parts%overrides(k)%name) > 0) yes = lower(deck%prefix()//deck%peek('name')) == &
      deck%parts%overrides(k)%name
  end function meant

  !> Notes of the values that settings have written into a file that is split for the last time in which file they were written:
  !> its names and its folder are meant.
  subroutine note_scopes(deck, first_group)
    class(group_cursor), intent(inout) :: deck
    integer, intent(in) :: first_group         !! of the file, the last so far
    integer :: k, g, a, first, last
    do k = size(deck%parts%overrides), 1, -1   ! as they were written
      if (deck%parts%overrides(k)%plain .or. deck%parts%overrides(k)%values < 1) cycle
      do g = first_group, deck%parts%group_count
        if (.not. meant(deck, k, g)) cycle
        a = deck%assignment_of(deck%parts%overrides(k)%key)
        if (a == 0) cycle
        first = deck%parts%assignments(deck%head + a)%first_value
        last = first + deck%tokens(a) - 1
        if (deck%parts%overrides(k)%item > 0) first = first + deck%parts%overrides(k)%item - 1
        if (deck%parts%overrides(k)%item > 0) last = min(first, last)
        deck%parts%values(first:last)%scope = 1
        if (deck%parts%overrides(k)%include > 0) deck%parts%values(first:last)%scope = &
          deck%parts%groups(deck%parts%overrides(k)%include)%file
      end do
    end do
  end subroutine note_scopes

  !> Writes what holds for the groups of a file into its text, one setting at a time: changed is which one, 0 none. The file
  !> has to be split again after each.
  subroutine override_file(deck, file, first_group, next, changed)
    class(group_cursor), intent(inout) :: deck
    integer, intent(in) :: file, first_group   !! its first group
    integer, intent(inout) :: next             !! number of the setting that is tried first, the last one at the beginning
    logical, intent(out) :: changed
    integer :: g, chosen
    changed = .false.
    do while (next > 0 .and. .not. changed)
      chosen = 0                               ! changed when all groups were looked at: places behind it move
      do g = first_group, deck%parts%group_count
        if (.not. meant(deck, next, g)) cycle
        deck%parts%overrides(next)%uses = deck%parts%overrides(next)%uses + 1
        deck%parts%overrides(next)%target = deck%group_word(g)//'/'//lower(deck%prefix()//deck%peek('name'))
        if (chosen == 0 .and. deck%parts%groups(g)%readable .and. deck%parts%groups(g)%slash > 0) chosen = g
      end do
      if (chosen > 0) call change(next, chosen)
      next = next - 1
    end do
  contains
    !> Writes a setting into a group.
    subroutine change(k, g)
      integer, intent(in) :: k, g
      integer :: a, begin, end
      call deck%enter(g)
      associate (group => deck%parts%groups(g), new => deck%parts%overrides(k), text => deck%parts%sources(file)%text)
        changed = new%item >= 0 .and. new%values >= 0 .and. (new%item == 0 .or. new%values == 1)
        if (.not. changed) return
        a = deck%assignment_of(new%key)
        if (len(new%key) == 0) then
          call put(group%first - 1, group%slash, '')
        else if (a == 0 .and. (len(new%value) == 0 .or. new%item > 0)) then
          changed = .false.
          if (new%item > 0) new%item = -1
        else if (a == 0) then
          call put(group%slash, group%slash - 1, ' '//new%key//'='//new%value//' ')
        else if (new%item > 0) then
          changed = new%item <= deck%tokens(a)
          if (changed) changed = deck%parts%values(deck%parts%assignments(deck%head + a)%first_value + new%item - 1)%repeats == 1
          if (changed) call ends(a, new%item, new%item, begin, end)
          if (changed) call put(begin, end, new%value)
          if (.not. changed) new%item = -1
        else
          call ends(a, 1, deck%tokens(a), begin, end)
          if (deck%tokens(a) > 0) begin = deck%parts%assignments(deck%head + a)%last + &
            verify(text(deck%parts%assignments(deck%head + a)%last + 1:), ' =')
          if (len(new%value) > 0) call put(begin, end, new%value)
          if (len(new%value) == 0) call put(deck%parts%assignments(deck%head + a)%first, comma_after(end), '')
        end if
      end associate
    end subroutine change

    !> First and last character of some values of an assignment, quotes included.
    subroutine ends(a, one, other, begin, end)
      integer, intent(in) :: a, one, other     !! the assignment; numbers of the values
      integer, intent(out) :: begin, end
      integer :: quote
      begin = deck%parts%assignments(deck%head + a)%last + 2
      end = begin - 1
      if (other == 0) return
      quote = merge(1, 0, deck%parts%values(deck%parts%assignments(deck%head + a)%first_value + one - 1)%form == string_value)
      associate (head => deck%token(a, one), tail => deck%token(a, other))
        begin = head%first - quote
        end = tail%last
        if (tail%form == string_value) end = end + 1
      end associate
    end subroutine ends

    !> The last character of the comma that follows a value, if one does.
    integer function comma_after(last) result(place)
      integer, intent(in) :: last
      place = last + verify(deck%parts%sources(file)%text(last + 1:), ' '//achar(9))
      if (deck%parts%sources(file)%text(place:place) /= ',') place = last
    end function comma_after

    !> Puts a text in the place of characters of the file; its lines keep their numbers.
    subroutine put(begin, end, new)
      integer, intent(in) :: begin, end
      character(*), intent(in) :: new
      character(:), allocatable :: text
      integer :: k, lines
      text = deck%parts%sources(file)%text
      lines = count([(text(k:k) == achar(10), k=begin, end)])
      deck%parts%sources(file)%text = text(:begin - 1)//new//repeat(achar(10), lines)//text(end + 1:)
    end subroutine put
  end subroutine override_file

  !> Reports settings that hold for no group, for several, or for no value of a list, that have no value, or that set a key again.
  subroutine check_overrides(deck, path)
    class(group_cursor), intent(inout) :: deck
    character(*), intent(in) :: path           !! of the deck, for messages
    character(:), allocatable :: problem
    integer :: j, k, near
    do k = 1, size(deck%parts%overrides)
      associate (one => deck%parts%overrides(k))
        problem = ''
        if (index(one%shown, '=') == 0) then
          problem = 'has no =, expected NAME=VALUE'
        else if (one%plain) then
          cycle
        else if (.not. any(group_names == one%group)) then
          near = nearest_word(one%group, group_names)
          problem = 'names no kind of group, expected GROUP/NAME/KEY=VALUE'
          if (near > 0) problem = 'names no kind of group, did you mean '//trim(group_names(near))//'?'
        else if (one%uses /= 1) then
          problem = 'names '//to_text(one%uses)//' groups of the deck, expected one: GROUP/NAME/KEY=VALUE'
        else if (one%item < 0) then
          problem = 'names no single value, expected the number of one that the deck states, without a repeat count'
        else if (one%values < 0) then
          problem = 'has no value as decks have it, expected one, or a list of them, alone'
        else if (one%item > 0 .and. one%values /= 1) then
          problem = 'has '//to_text(one%values)//' values, expected the one that it names'
        else if (any([(set_before(j, k), j=1, size(deck%parts%overrides))])) then
          problem = 'sets '//one%target//'/'//one%key//' twice, expected one value'
        end if
        if (len(problem) > 0) call complain(deck, path, one%include, one%line, written_as(one)//problem)
      end associate
    end do
  contains
    !> Whether a setting sets what another one has set before it, or sets as the value of a parameter.
    pure logical function set_before(j, k) result(yes)
      integer, intent(in) :: j, k
      associate (one => deck%parts%overrides(j), other => deck%parts%overrides(k))
        yes = (j < k .or. one%plain) .and. one%include == other%include .and. one%target == other%target .and. &
              (one%key == other%key .or. min(len(one%key), len(other%key)) == 0) .and. &
              (one%item == other%item .or. one%item*other%item == 0)
      end associate
    end function set_before
  end subroutine check_overrides

  !> A setting as it stands on the command line or in its &include, with a blank behind it.
  function written_as(one) result(text)
    type(override), intent(in) :: one
    character(:), allocatable :: text
    text = '--set '//printable(one%shown, 80)//' '
    if (one%include > 0) text = 'set='//quoted(printable(one%shown, 80))//' '
  end function written_as

  !> Reports a fault of a group or of the command line.
  subroutine complain(deck, path, group, line, message)
    class(group_cursor), intent(inout) :: deck
    character(*), intent(in) :: path           !! of the deck
    integer, intent(in) :: group, line         !! 0: the command line
    character(*), intent(in) :: message
    if (group > 0) deck%current = group
    if (group > 0) call deck%add_fault(line, message)
    if (group == 0) call deck%faults%add(path, 0, '', message)
  end subroutine complain
end module deck_overrides
