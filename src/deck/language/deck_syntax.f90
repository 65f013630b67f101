!> The parts of a deck as written, before their meaning is read: values, assignments and groups, each with its position
!> in the text. Plain arrays that grow by doubling; a deck of any size is read in linear time.
module deck_syntax
  use kinds, only: wp
  use readable_text, only: printable
  use text, only: digits, letters, lower
  use deck_key, only: longest_word
  use deck_paths, only: path_from
  implicit none (type, external)
  private
  public :: group_subject

  character(*), parameter, public :: name_characters = letters//digits//'_-'   !! what a name may consist of, in lower case

  integer, parameter, public :: shown = 40          !! characters of a faulty text shown in a message
  integer, parameter, public :: most_parts = 5000   !! files of a deck, histories that one is made of: parts of parts grow fast
  integer, parameter, public :: most = 1000000      !! repeats of a value, breakpoints of a history

  integer, parameter, public :: bare_value = 1      !! a number, a logical, or a word without quotes
  integer, parameter, public :: string_value = 2    !! text in quotes
  integer, parameter, public :: null_value = 3      !! nothing between two commas
  integer, parameter, public :: expression_value = 4   !! an expression in braces
  integer, parameter, public :: bad_value = 5       !! unusable, its fault already reported

  integer, parameter, public :: unknown = 0, taken = 1, usable = 2   !! what became of an assignment

  !> One value of an assignment.
  type, public :: value_token
    integer :: form = bare_value
    integer :: first = 0      !! first character in the file's text, inside the quotes
    integer :: last = 0       !! last character, inside the quotes
    integer :: repeats = 1    !! repeat count: so many values are alike
    integer :: line = 0
    integer :: position = 0   !! among all values
    logical :: copy = .false. !! of the value before it, by a repeat count
    integer :: scope = 0      !! number of the file whose names and folder it means; 0: of that in which it stands
    integer :: part = 0       !! of a name: number of the file whose prefix belongs in front of it; 0: none
    real(wp) :: number = huge(1.0_wp)   !! value of an expression, huge: not computed yet [as the variable]
  end type value_token

  !> `name = values`
  type, public :: setting
    integer :: first = 0           !! first character of the name in the file's text
    integer :: last = 0            !! last character of the name
    character(longest_word + 1) :: name = ''   !! in lower case; of a longer one, which no variable has, the beginning
    integer :: line = 0
    integer :: first_value = 1     !! position of its first value
    integer :: values = 0          !! number of values
    logical :: equals = .true.     !! .false.: the equals sign is missing
    integer :: state = unknown     !! what became of it
  end type setting

  !> `&name assignments /`
  type, public :: group
    integer :: kind = 0            !! which group of the table of keys, 0: unknown
    integer :: file = 0            !! number of its file
    integer :: first = 0           !! first character of its name in the file's text
    integer :: last = 0            !! last character of its name
    integer :: line = 0
    integer :: slash = 0           !! its closing slash in the file's text
    integer :: included = 0        !! of an &include: number of the file that it brings
    integer :: first_assignment = 1
    integer :: assignments = 0
    logical :: readable = .true.   !! .false.: its text cannot be trusted, the fault is already reported
    logical :: complete = .true.   !! .false.: parts may be missing, the fault is already reported
  end type group

  !> A file of the deck.
  type, public :: source
    character(:), allocatable :: path   !! as shown in messages
    character(:), allocatable :: key    !! the same without needless `.` and `..`
    character(:), allocatable :: text   !! whole text, lines end with a line feed
    integer :: parent = 0               !! number of the file that includes it, 0: the deck itself
    character(:), allocatable :: prefix !! of the names that it defines, those of the parts around it in front
    integer :: outer = 0                !! number of the file of the part around it, 0: it belongs to the deck itself
    integer :: first_group = 1, last_group = 0   !! its groups
  end type source

  !> A value that stands in the place of a deck's own (`deck_overrides`).
  type, public :: override
    character(:), allocatable :: shown          !! as written, for messages
    logical :: plain = .false.                  !! NAME=VALUE of a parameter
    character(:), allocatable :: group, name    !! in lower case, the name with its prefix; '': the only group of its kind
    character(:), allocatable :: key, value     !! '': the group goes; '': the key goes
    integer :: item = 0                         !! number of a value of a list, 0: all of it; -1: there is none
    integer :: values = 1                       !! how many it has; -1: something else stands there
    character(:), allocatable :: target         !! the group for which it holds, `kind/name`
    integer :: include = 0, line = 0            !! the &include in which it stands, its line; 0: the command line
    integer :: uses = 0                         !! groups for which it holds
  end type override

  !> Everything that stands in the deck and its included files.
  type, public :: syntax
    type(source), allocatable :: sources(:)
    integer :: source_count = 0
    type(group), allocatable :: groups(:)
    integer :: group_count = 0
    type(override), allocatable :: overrides(:)   !! those that prevail first
    type(setting), allocatable :: assignments(:)
    integer :: assignment_count = 0
    type(value_token), allocatable :: values(:)
    integer :: value_count = 0
    logical :: has_expressions = .false.
  contains
    procedure :: add_source
    procedure :: add_group
    procedure :: add_assignment
    procedure :: add_value
  end type syntax

contains

  !> Appends a file.
  subroutine add_source(self, path, text, parent, prefix)
    class(syntax), intent(inout) :: self
    character(*), intent(in) :: path   !! as shown in messages
    character(*), intent(in) :: text   !! whole text
    integer, intent(in) :: parent      !! number of the file that includes it
    character(*), intent(in) :: prefix !! of its names beside that of its parent
    if (.not. allocated(self%sources)) allocate (self%sources(4))
    if (self%source_count == size(self%sources)) self%sources = [self%sources, self%sources]
    self%source_count = self%source_count + 1
    associate (new => self%sources(self%source_count))
      new = source(path=path, text=text, parent=parent, prefix=prefix)
      new%key = path_from('', path)
      if (parent > 0) then
        new%prefix = self%sources(parent)%prefix//prefix
        new%outer = merge(parent, self%sources(parent)%outer, len(prefix) > 0)
      end if
    end associate
  end subroutine add_source

  !> Appends a group; assignments that are appended after it belong to it.
  subroutine add_group(self, new)
    class(syntax), intent(inout) :: self
    type(group), intent(in) :: new   !! its own count of assignments is 0
    if (.not. allocated(self%groups)) allocate (self%groups(64))
    if (self%group_count == size(self%groups)) self%groups = [self%groups, self%groups]
    self%group_count = self%group_count + 1
    self%groups(self%group_count) = new
    self%groups(self%group_count)%first_assignment = self%assignment_count + 1
  end subroutine add_group

  !> Appends an assignment to the last group; values that are appended after it belong to it.
  subroutine add_assignment(self, new)
    class(syntax), intent(inout) :: self
    type(setting), intent(in) :: new   !! its own count of values is 0
    if (.not. allocated(self%assignments)) allocate (self%assignments(256))
    if (self%assignment_count == size(self%assignments)) self%assignments = [self%assignments, self%assignments]
    self%assignment_count = self%assignment_count + 1
    self%assignments(self%assignment_count) = new
    self%assignments(self%assignment_count)%first_value = self%value_count + 1
    self%groups(self%group_count)%assignments = self%groups(self%group_count)%assignments + 1
  end subroutine add_assignment

  !> Appends a value to the last assignment, as often as its repeat count says.
  subroutine add_value(self, new)
    class(syntax), intent(inout) :: self
    type(value_token), intent(in) :: new
    integer :: k
    if (.not. allocated(self%values)) allocate (self%values(512))
    do k = 1, new%repeats
      if (self%value_count == size(self%values)) self%values = [self%values, self%values]
      self%value_count = self%value_count + 1
      self%values(self%value_count) = new
      self%values(self%value_count)%copy = k > 1
      self%values(self%value_count)%position = self%value_count
    end do
    self%has_expressions = self%has_expressions .or. new%form == expression_value
    self%assignments(self%assignment_count)%values = self%assignments(self%assignment_count)%values + new%repeats
  end subroutine add_value

  !> `group/name` of a group, for messages; only `group` if its name cannot be read. The name has the prefix of its part.
  function group_subject(list, number) result(subject)
    type(syntax), intent(in) :: list
    integer, intent(in) :: number   !! which group
    character(:), allocatable :: subject
    integer :: k
    associate (g => list%groups(number))
      associate (body => list%sources(g%file)%text)
        subject = printable(lower(body(g%first:g%last)), shown)
        do k = g%first_assignment, g%first_assignment + g%assignments - 1
          if (list%assignments(k)%name /= 'name') cycle
          if (list%assignments(k)%values < 1) exit
          associate (v => list%values(list%assignments(k)%first_value))
            if (v%form /= string_value .or. v%last < v%first) exit
            if (verify(lower(body(v%first:v%last)), name_characters) > 0) exit
            subject = subject//'/'//list%sources(g%file)%prefix//printable(body(v%first:v%last), shown)
            return
          end associate
        end do
        if (len(list%sources(g%file)%prefix) > 0) subject = subject//' of part '//list%sources(g%file)%prefix
      end associate
    end associate
  end function group_subject
end module deck_syntax
