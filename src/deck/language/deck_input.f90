!> The group of a deck that is being read: which keys it gives, what became of them, and every fault. A key that its group does not
!> have is unknown; one that stands in the table for other kinds alone does not apply. Faults of one cause are reported once.
module deck_input
  use kinds, only: wp
  use readable_text, only: printable
  use text, only: joined, lower, meant_word, nearest_word, quoted, to_text
  use errors, only: most_shown
  use deck_cursor, only: group_cursor
  use deck_key, only: expectation, kinds_text, longest_word, split, word_number
  use deck_keys, only: first_key, group_kinds, keys, last_key
  use deck_names, only: name_table, not_there
  use deck_syntax, only: bad_value, taken, unknown, usable
  implicit none (type, external)
  private

  !> What is expected of a key that is required and not given.
  type :: note
    character(:), allocatable :: expected
  end type note

  !> A deck with its tables of names; of the open group: what decides which keys apply, and which ones are missing.
  type, extends(group_cursor), public :: deck_source
    type(name_table) :: names(group_kinds)
    character(:), allocatable :: tables        !! a line for each file of numbers, so that a restart notices a changed one
    character(:), allocatable :: table_files   !! their paths, a null character behind each
    logical, allocatable :: body_known(:)      !! bodies whose kind and nodes are known
    logical :: choice_known = .true.           !! it is known what applies; otherwise everything does, and nothing is missing
    logical :: any_choice = .false.            !! it is not to be known
    integer, private :: kind = 0               ! of the open group
    integer, private :: faults_before = 0      ! faults when it was opened
    integer, private :: selector = 0           ! row of the key that decides what applies
    integer, private :: choice = 0             ! which of its words is given, 0: none
    character(longest_word), private :: choice_word = ''   ! that word
    type(note), private :: missing(size(keys))
  contains
    procedure :: find => find_name
    procedure :: nearest => nearest_name
    procedure :: open => open_group
    procedure :: close => close_group
    procedure :: row_of
    procedure :: applies
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
    procedure :: need
    procedure :: for_choice
    procedure :: refuse
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
    class(deck_source), intent(in) :: self
    integer, intent(in) :: file                !! number of the file
    integer, intent(in) :: kind                !! what it should name
    character(*), intent(in) :: name           !! as written there
    character(:), allocatable, intent(out) :: best
    integer :: level
    best = ''
    level = file
    if (self%faults%count > most_shown) level = 0           ! nobody reads it
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
    call self%enter(number)
    self%kind = self%parts%groups(number)%kind
    self%selector = 0
    self%choice = 0
    self%choice_word = ''
    self%choice_known = .true.
    self%any_choice = .false.
    self%faults_before = self%faults%count
  end subroutine open_group

  !> Closes the group: reports keys that it does not have, those that do not apply, and those that are missing.
  subroutine close_group(self)
    class(deck_source), intent(inout) :: self
    integer :: k
    do k = 1, self%count
      if (self%parts%assignments(self%head + k)%state == unknown) call report(k)
    end do
    do k = first_key(self%kind), last_key(self%kind)
      if (.not. allocated(self%missing(k)%expected)) cycle
      if (self%parts%groups(self%current)%complete) call self%complain('', trim(keys(k)%name)//' is missing, expected '// &
        self%missing(k)%expected)
      deallocate (self%missing(k)%expected)
    end do
  contains
    !> Reports a key that does not apply, or an unknown one with the nearest known one, which is then not reported as missing.
    subroutine report(k)
      integer, intent(in) :: k   !! which assignment of the group
      character(longest_word) :: names(first_key(self%kind):last_key(self%kind))
      character(:), allocatable :: name, meant
      character(longest_word), allocatable :: known(:)
      integer :: near, kinds, i
      associate (a => self%parts%assignments(self%head + k))
        name = lower(self%raw(a%first, a%last))
        kinds = 0
        do i = lbound(names, 1), ubound(names, 1)
          names(i) = keys(i)%name
          if (names(i) == name) kinds = ior(kinds, keys(i)%kinds)
          if (self%is_given(names(i)) .or. any(names(:i - 1) == names(i))) names(i) = ''
        end do
        if (len(name) == 0) then
          if (a%values > 0 .and. .not. a%equals) call self%add_fault(a%line, 'value '// &
            self%written(self%parts%values(a%first_value))//' without a variable, expected name=value')
        else if (kinds /= 0) then
          call self%add_fault(a%line, name//elsewhere(self, kinds))
        else if (index(name, '(') > 1) then
          meant = name(1:index(name, '(') - 1)
          call self%add_fault(a%line, 'subscript in '//printable(name, 40)//', expected the whole list, '//meant// &
            '=value,value,...')
          call forget(self%row_of(meant))
        else
          near = meant_word(name, names)
          known = pack(keys(first_key(self%kind):last_key(self%kind))%name, &
            [(applies(self, i), i=first_key(self%kind), last_key(self%kind))])
          meant = 'expected one of '//joined(pack(known, [(all(known(:i - 1) /= known(i)), i=1, size(known))]), ', ')
          if (near > 0) meant = 'did you mean '//trim(names(lbound(names, 1) + near - 1))//'?'
          call self%add_fault(a%line, 'unknown variable '//printable(name, 40)//', '//meant)
          if (near > 0) call forget(lbound(names, 1) + near - 1)
        end if
      end associate
    end subroutine report

    !> A key that is meant is not missing.
    subroutine forget(row)
      integer, intent(in) :: row   !! 0: none
      if (row == 0) return
      if (allocated(self%missing(row)%expected)) deallocate (self%missing(row)%expected)
    end subroutine forget
  end subroutine close_group

  !> What is wrong with a key of other kinds.
  function elsewhere(self, kinds) result(t)
    class(deck_source), intent(in) :: self
    integer, intent(in) :: kinds             !! for which it stands in the table
    character(:), allocatable :: t
    associate (selector => keys(self%selector))
      t = kinds_text(selector, kinds)
      if (.not. self%is_given(trim(selector%name))) then
        t = ' applies to '//t//' only, expected '//trim(selector%name)//' to be given'
      else
        t = ' does not apply to '//kinds_text(selector, ibset(0, self%choice - 1))//', it applies to '//t
      end if
    end associate
  end function elsewhere

  !> Row of a key of the open group in the table: of several that which applies; 0: there is none.
  pure integer function row_of(self, name) result(row)
    class(deck_source), intent(in) :: self
    character(*), intent(in) :: name
    integer :: k
    row = 0
    do k = first_key(self%kind), last_key(self%kind)
      if (keys(k)%name /= name) cycle
      row = k
      if (applies(self, k)) return
    end do
  end function row_of

  !> Finds the assignment of a key. `assignment` is 0 where there is nothing to read:
  !> - it is not given: noted as missing where it is required
  !> - its form is faulty: reported
  !> - it does not apply: reported when the group is closed.
  subroutine look_up(self, row, assignment)
    class(deck_source), intent(inout) :: self
    integer, intent(in) :: row                    !! of the key in the table
    integer, intent(out) :: assignment            !! number of the assignment in the group
    assignment = 0
    if (.not. applies(self, row)) return
    call find_assignment(keys(row)%name)
    if (assignment == 0) then
      if (keys(row)%required) call self%need(keys(row)%name)
    else if (self%parts%assignments(self%head + assignment)%state /= unknown) then
      assignment = 0                              ! read under another row, while it is not known which one applies
    else
      self%parts%assignments(self%head + assignment)%state = taken
      call check_form(trim(keys(row)%name))
    end if
  contains
    !> First assignment of a key; further ones are reported.
    subroutine find_assignment(name)
      character(*), intent(in) :: name
      integer :: k
      assignment = self%assignment_of(name)
      k = assignment
      do while (k > 0)
        k = self%assignment_of(name, k)
        if (k == 0) exit
        associate (a => self%parts%assignments(self%head + k))
          if (a%state /= unknown) cycle
          a%state = taken
          call self%add_fault(a%line, trim(name)//' is set twice, first in line '// &
            to_text(self%parts%assignments(self%head + assignment)%line)//', expected one value')
        end associate
      end do
    end subroutine find_assignment

    !> Reports an assignment without equals sign or without values; one with a reported value is unusable.
    subroutine check_form(name)
      character(*), intent(in) :: name
      associate (a => self%parts%assignments(self%head + assignment))
        if (.not. a%equals) then
          call self%add_fault(a%line, 'no = after '//name//', expected '//name//'=value')
          assignment = 0
        else if (a%values == 0) then
          call self%add_fault(a%line, name//' has no value, expected '//name//'=value')
          assignment = 0
        else if (any(self%parts%values(a%first_value:a%first_value + a%values - 1)%form == bad_value)) then
          assignment = 0
          self%faults_before = -1           ! its fault, which is reported, is one of the group
        end if
      end associate
    end subroutine check_form
  end subroutine look_up

  !> Whether a row of the table applies to the group; all do while the kind is not known.
  pure logical function applies(self, row) result(yes)
    class(deck_source), intent(in) :: self
    integer, intent(in) :: row
    yes = keys(row)%kinds == 0 .or. .not. self%choice_known
    if (.not. yes .and. self%choice > 0) yes = btest(keys(row)%kinds, self%choice - 1)
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

  !> Sets the word that decides which other keys apply.
  subroutine choose(self, row, word, known)
    class(deck_source), intent(inout) :: self
    integer, intent(in) :: row           !! of the key in the table
    character(*), intent(in) :: word     !! blank: none
    logical, intent(in) :: known         !! .false.: it could not be read
    character(:), allocatable :: name
    integer :: k
    name = trim(keys(row)%name)
    self%selector = row
    self%choice_word = word
    self%choice = word_number(keys(row)%words, trim(word))
    self%choice_known = known .and. .not. self%any_choice
    if (.not. known .or. self%is_given(name)) return
    do k = 1, self%count                 ! where it is misspelt (`knd='beam'`) that alone is reported
      associate (a => self%parts%assignments(self%head + k))
        if (nearest_word(lower(self%raw(a%first, a%last)), [name]) > 0) self%choice_known = .false.
      end associate
    end do
  end subroutine choose

  !> Whether the selecting key is known to have one of these words.
  pure logical function is_choice(self, words) result(yes)
    class(deck_source), intent(in) :: self
    character(*), intent(in) :: words   !! blanks between them
    yes = self%choice_known .and. word_number(words, trim(self%choice_word)) > 0
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

  !> Reports each of some variables that is given.
  subroutine refuse(self, names, message)
    class(deck_source), intent(inout) :: self
    character(*), intent(in) :: names     !! blanks between them
    character(*), intent(in) :: message   !! what is wrong, what was expected; the name stands before it
    integer :: k
    associate (list => split(names))
      do k = 1, size(list)
        if (self%is_set(list(k))) call self%complain(trim(list(k)), trim(list(k))//message)
      end do
    end associate
  end subroutine refuse

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

  !> Notes that a key is required, if it is not given and known to apply; reported when the group is closed.
  subroutine need(self, name, expected)
    class(deck_source), intent(inout) :: self
    character(*), intent(in) :: name                 !! key
    character(*), intent(in), optional :: expected   !! in place of what its row says
    integer :: row
    row = self%row_of(name)
    if (self%is_given(name) .or. .not. applies(self, row) .or. (keys(row)%kinds /= 0 .and. .not. self%choice_known)) return
    if (present(expected)) then
      self%missing(row)%expected = expected
    else
      self%missing(row)%expected = expectation(keys(row))
      if (keys(row)%kinds /= 0) self%missing(row)%expected = expectation(keys(row))//self%for_choice()
    end if
  end subroutine need

  !> ` for kind='beam'`: where something is required.
  function for_choice(self) result(t)
    class(deck_source), intent(in) :: self
    character(:), allocatable :: t
    t = ' for '//kinds_text(keys(self%selector), ibset(0, self%choice - 1))
  end function for_choice
end module deck_input
