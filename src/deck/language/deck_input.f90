!> The group of a deck that is being read: which variables it gives, which of them were asked for, and every fault.
!> A reader declares a variable by asking for it (modules deck_get, deck_words). A variable that no reader asked for
!> is unknown; one that is asked for under another kind does not apply. Faults of one cause are reported once.
module deck_input
  use kinds, only: wp
  use readable_text, only: printable
  use text, only: lower, to_text, nearest_word, quoted
  use deck_kinds, only: group_kinds
  use deck_names, only: name_table, not_there
  use deck_cursor, only: group_cursor
  use deck_known, only: variable_list
  use deck_syntax, only: longest, bad_value, unknown, elsewhere, taken, usable
  implicit none (type, external)
  private

  logical, parameter, public :: required = .true.   !! for the argument `need` of the readers

  !> A deck with its tables of names; of the open group: which variables were asked for and what became of them.
  type, extends(group_cursor), public :: deck_source
    type(name_table) :: names(group_kinds)
    logical, allocatable :: body_known(:)      !! bodies whose kind and nodes are known
    integer, private :: faults_before = 0      ! faults when it was opened
    type(variable_list), private :: known               ! variables asked for
    character(longest), private :: selector = ''        ! the variable that decides what applies
    character(longest), private :: choice = ''          ! its value
    logical :: choice_known = .true.           !! it is known what applies
  contains
    procedure :: find => find_name
    procedure :: nearest => nearest_name
    procedure :: open => open_group
    procedure :: close => close_group
    procedure :: look_up
    procedure :: mark_good
    procedure :: mark_faulty
    procedure :: choose
    procedure :: is_choice
    procedure :: is_given
    procedure :: is_set
    procedure :: is_known
    procedure :: is_clean
    procedure :: complain
    procedure :: note_missing
    procedure :: forbid_both
    procedure :: check_order
  end type deck_source

contains

  !> What a name in a file stands for: in the part that the file belongs to, else in the part around it, level by level.
  subroutine find_name(self, file, kind, name, number, part)
    class(deck_source), intent(in) :: self
    integer, intent(in) :: file                !! number of the file
    integer, intent(in) :: kind                !! what it should name
    character(*), intent(in) :: name           !! as written there
    integer, intent(out) :: number             !! of the named thing, or not_there or doubtful
    integer, intent(out), optional :: part     !! number of a file of the part in which it was found
    integer :: level, found
    number = not_there
    level = file
    do while (level > 0 .and. number <= not_there)
      found = self%names(kind)%find(self%parts%sources(level)%prefix//name)
      if (found /= not_there) number = found
      if (present(part)) part = level
      level = self%parts%sources(level)%outer
    end do
  end subroutine find_name

  !> The known name nearest to a misspelt one, as it would be written in a file; empty if none is near.
  subroutine nearest_name(self, file, kind, name, best)
    class(deck_source), intent(inout) :: self
    integer, intent(in) :: file                !! number of the file
    integer, intent(in) :: kind                !! what it should name
    character(*), intent(in) :: name           !! as written there
    character(:), allocatable, intent(out) :: best
    integer :: level
    best = ''
    level = file
    do while (level > 0 .and. len(best) == 0)
      associate (prefix => self%parts%sources(level)%prefix)
        call self%names(kind)%nearest(prefix//name, best)
        if (index(lower(best), lower(prefix)) == 1) best = best(len(prefix) + 1:)
      end associate
      level = self%parts%sources(level)%outer
    end do
  end subroutine nearest_name

  !> Opens a group.
  subroutine open_group(self, number)
    class(deck_source), intent(inout) :: self
    integer, intent(in) :: number   !! which group of the deck
    associate (g => self%parts%groups(number))
      self%current = number
      self%line = g%line
      self%head = g%first_assignment - 1
      self%count = g%assignments
    end associate
    self%known%count = 0
    self%selector = ''
    self%choice = ''
    self%choice_known = .true.
    self%faults_before = self%faults%count
  end subroutine open_group

  !> Closes the group: reports unknown variables, those that do not apply, and those that are missing.
  subroutine close_group(self)
    class(deck_source), intent(inout) :: self
    integer :: k
    do k = 1, self%count
      associate (state => self%parts%assignments(self%head + k)%state)
        if (state == unknown) call report_unknown(k)
        if (state == elsewhere) call report_elsewhere(k)
      end associate
    end do
    if (.not. self%parts%groups(self%current)%complete) return
    do k = 1, self%known%count
      associate (v => self%known%items(k))
        if (v%missing /= '') call self%complain('', trim(v%name)//' is missing, expected '//v%missing)
      end associate
    end do
  contains
    !> Reports an unknown variable and suggests the nearest known one, which is then not reported as missing.
    subroutine report_unknown(k)
      integer, intent(in) :: k   !! which assignment of the group
      character(:), allocatable :: name, meant, message
      integer :: near
      associate (a => self%parts%assignments(self%head + k))
        name = lower(self%raw(a%first, a%last))
        if (len(name) == 0) then
          if (a%values > 0 .and. .not. a%equals) call self%add_fault(a%line, 'value '// &
            self%written(self%parts%values(a%first_value))//' without a variable, expected name=value')
          return
        end if
        if (index(name, '(') > 1) then
          meant = name(1:index(name, '(') - 1)
          near = self%known%position_of(meant)
          message = 'subscript in '//printable(name, 40)//', expected the whole list, '//meant//'=value,value,...'
        else
          near = self%known%nearest_variable(name)
          message = 'expected one of '//self%known%applicable()
          if (near > 0) message = 'did you mean '//trim(self%known%items(near)%name)//'?'
          message = 'unknown variable '//printable(name, 40)//', '//message
        end if
        if (near > 0) self%known%items(near)%missing = ''
        call self%add_fault(a%line, message)
      end associate
    end subroutine report_unknown

    !> Reports a variable that applies to other kinds only.
    subroutine report_elsewhere(k)
      integer, intent(in) :: k   !! which assignment of the group
      character(:), allocatable :: which
      associate (a => self%parts%assignments(self%head + k))
        which = kinds_text(trim(self%selector), a%applies)
        if (self%choice == '') then
          call self%add_fault(a%line, trim(a%name)//' applies to '//which//' only, expected '//trim(self%selector)// &
            ' to be given')
        else
          call self%add_fault(a%line, trim(a%name)//' does not apply to '//trim(self%selector)//'='// &
            quoted(trim(self%choice))//', it applies to '//which)
        end if
      end associate
    end subroutine report_elsewhere
  end subroutine close_group

  !> Kinds as a user writes them: `kind='beam' and 'frame'`.
  pure function kinds_text(selector, kinds) result(t)
    character(*), intent(in) :: selector   !! `kind`, `type`, ...
    character(*), intent(in) :: kinds      !! values, blanks between them
    character(:), allocatable :: t
    integer :: first, last
    t = ''
    first = 1
    do while (first <= len(kinds))
      last = first + index(kinds(first:)//' ', ' ') - 2
      if (len(t) > 0) t = t//trim(merge(',   ', ' and', last < len(kinds)))//' '
      t = t//quoted(kinds(first:last))
      first = last + 2
    end do
    t = selector//'='//t
  end function kinds_text

  !> Declares a variable and finds its assignment. `assignment` is 0 where there is nothing to read:
  !> - it is not given: noted as missing where it is required and applies
  !> - its form is faulty: reported
  !> - it does not apply: reported when the group is closed.
  subroutine look_up(self, name, need, kinds, expected, assignment)
    class(deck_source), intent(inout) :: self
    character(*), intent(in) :: name              !! variable, lower case
    logical, intent(in), optional :: need         !! whether it is required
    character(*), intent(in), optional :: kinds   !! values of the selecting variable that it applies to
    character(*), intent(in) :: expected          !! what is expected where it is missing
    integer, intent(out) :: assignment            !! number of the assignment in the group
    logical :: here
    here = .true.
    if (present(kinds)) here = applies(self, kinds)
    call find_assignment()
    call self%known%declare(name, here, assignment > 0)
    if (assignment == 0) then
      if (.not. (present(need) .and. here)) return
      if (need .and. (self%choice_known .or. .not. present(kinds))) call self%note_missing(name, expected, kinds)
    else if (.not. here) then
      associate (a => self%parts%assignments(self%head + assignment))
        if (a%state == unknown) a%applies = kinds
        if (a%state == elsewhere) a%applies = a%applies//' '//kinds
        if (a%state == unknown) a%state = elsewhere
      end associate
      assignment = 0
    else
      self%parts%assignments(self%head + assignment)%state = taken
      call check_form()
    end if
  contains
    !> First assignment of a variable; further ones are reported.
    subroutine find_assignment()
      integer :: k
      assignment = self%assignment_of(name)
      k = assignment
      do while (k > 0)
        k = self%assignment_of(name, k)
        if (k == 0) exit
        associate (a => self%parts%assignments(self%head + k))
          if (a%state /= unknown) cycle
          a%state = taken
          call self%add_fault(a%line, name//' is set twice, first in line '// &
            to_text(self%parts%assignments(self%head + assignment)%line)//', expected one value')
        end associate
      end do
    end subroutine find_assignment

    !> Reports an assignment without equals sign or without values; one with a reported value is unusable.
    subroutine check_form()
      associate (a => self%parts%assignments(self%head + assignment))
        if (.not. a%equals) then
          call self%add_fault(a%line, 'no = after '//name//', expected '//name//'=value')
          assignment = 0
        else if (a%values == 0) then
          call self%add_fault(a%line, name//' has no value, expected '//name//'=value')
          assignment = 0
        else if (any(self%parts%values(a%first_value:a%first_value + a%values - 1)%form == bad_value)) then
          assignment = 0
        end if
      end associate
    end subroutine check_form
  end subroutine look_up

  !> Whether a variable that applies to these kinds applies to the group; all do while the kind is not known.
  pure logical function applies(self, kinds) result(yes)
    class(deck_source), intent(in) :: self
    character(*), intent(in) :: kinds   !! blanks between them
    yes = .not. self%choice_known
    if (.not. yes .and. self%choice /= '') yes = index(' '//kinds//' ', ' '//trim(self%choice)//' ') > 0
  end function applies

  !> Notes that the value of a variable was read and is good.
  subroutine mark_good(self, assignment)
    class(deck_source), intent(inout) :: self
    integer, intent(in) :: assignment   !! number of the assignment in the group
    self%parts%assignments(self%head + assignment)%state = usable
  end subroutine mark_good

  !> Notes that the value of a variable is faulty after all.
  subroutine mark_faulty(self, name)
    class(deck_source), intent(inout) :: self
    character(*), intent(in) :: name   !! the variable, which the group gives
    self%parts%assignments(self%head + self%assignment_of(name))%state = taken
  end subroutine mark_faulty

  !> Sets the variable that decides which others apply.
  subroutine choose(self, name, choice, known)
    class(deck_source), intent(inout) :: self
    character(*), intent(in) :: name     !! `kind`, `type`, ...
    character(*), intent(in) :: choice   !! its value, empty: none
    logical, intent(in) :: known         !! .false.: it could not be read, then everything applies and nothing is missing
    integer :: k
    self%selector = name
    self%choice = choice
    self%choice_known = known
    if (.not. known .or. self%is_given(name)) return
    do k = 1, self%count                 ! where it is misspelt (`knd='beam'`) that alone is reported
      associate (a => self%parts%assignments(self%head + k))
        if (nearest_word(lower(self%raw(a%first, a%last)), [name]) > 0) self%choice_known = .false.
      end associate
    end do
  end subroutine choose

  !> Whether the selecting variable is known to have one of these values.
  pure logical function is_choice(self, kinds) result(yes)
    class(deck_source), intent(in) :: self
    character(*), intent(in) :: kinds   !! blanks between them
    yes = self%choice_known .and. applies(self, kinds)
  end function is_choice

  !> Whether the group gives a variable, with a good or a faulty value.
  pure logical function is_given(self, name) result(yes)
    class(deck_source), intent(in) :: self
    character(*), intent(in) :: name
    yes = self%assignment_of(name) > 0
  end function is_given

  !> Whether the group gives a variable, it applies, and its value was read and is good.
  pure logical function is_set(self, name) result(yes)
    class(deck_source), intent(in) :: self
    character(*), intent(in) :: name
    integer :: k
    k = self%assignment_of(name)
    yes = k > 0
    if (yes) yes = self%parts%assignments(self%head + k)%state == usable
  end function is_set

  !> Whether the value of a variable that applies is known: it is given and good, or not given, so that the default counts.
  pure logical function is_known(self, name) result(yes)
    class(deck_source), intent(in) :: self
    character(*), intent(in) :: name
    yes = self%is_set(name) .or. .not. self%is_given(name)
  end function is_known

  !> Whether the group has shown no fault yet.
  pure logical function is_clean(self) result(yes)
    class(deck_source), intent(in) :: self
    yes = self%faults%count == self%faults_before
  end function is_clean

  !> Reports two variables that exclude each other.
  subroutine forbid_both(self, first, second, hint)
    class(deck_source), intent(inout) :: self
    character(*), intent(in) :: first, second
    character(*), intent(in) :: hint      !! what helps to decide, after a colon; may be empty
    if (self%is_given(first) .and. self%is_given(second)) call self%complain(second, first//' and '//second// &
      ' are both given, expected one of them'//hint)
  end subroutine forbid_both

  !> Reports two numbers that do not ascend.
  subroutine check_order(self, lower, x, upper, y)
    class(deck_source), intent(inout) :: self
    character(*), intent(in) :: lower, upper   !! the variables
    real(wp), intent(in) :: x, y               !! their values [as the variables]
    if (self%is_set(lower) .and. self%is_set(upper) .and. x >= y) call self%complain(upper, upper//'='//to_text(y)// &
      ' is not above '//lower//'='//to_text(x)//', expected '//lower//' < '//upper)
  end subroutine check_order

  !> Reports a fault of the group, at the line of a variable where that is given.
  subroutine complain(self, name, message)
    class(deck_source), intent(inout) :: self
    character(*), intent(in) :: name      !! variable, empty: the group as a whole
    character(*), intent(in) :: message   !! what is wrong, what was expected
    integer :: assignment
    assignment = 0
    if (len(name) > 0) assignment = self%assignment_of(name)
    if (assignment > 0) then
      call self%add_fault(self%parts%assignments(self%head + assignment)%line, message)
    else
      call self%add_fault(self%line, message)
    end if
  end subroutine complain

  !> Notes a required variable that is not given; reported when the group is closed.
  subroutine note_missing(self, name, expected, kinds)
    class(deck_source), intent(inout) :: self
    character(*), intent(in) :: name              !! variable
    character(*), intent(in) :: expected          !! what is expected
    character(*), intent(in), optional :: kinds   !! kinds that require it
    if (present(kinds)) then
      call self%known%note_missing(name, expected//' for '//trim(self%selector)//'='//quoted(trim(self%choice)))
    else
      call self%known%note_missing(name, expected)
    end if
  end subroutine note_missing
end module deck_input
