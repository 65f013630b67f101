!> A deck as text, with one of its groups open: the names and values of the group as they are written, and its faults.
module deck_cursor
  use kinds, only: wp
  use readable_text, only: printable
  use text, only: lower, to_text, quoted
  use errors, only: fault_list
  use deck_origin, only: origin
  use deck_syntax, only: syntax, value_token, string_value, null_value, expression_value, group_subject
  implicit none (type, external)
  private

  !> A deck, its faults so far, and the group that is open.
  type, public :: group_cursor
    type(syntax) :: parts
    type(fault_list) :: faults
    integer :: current = 0     !! the open group
    integer :: line = 0        !! its line
    integer :: head = 0        !! number of assignments before its first
    integer :: count = 0       !! its assignments
  contains
    procedure :: enter
    procedure :: at => group_origin
    procedure :: group_word
    procedure :: location_of
    procedure :: assignment_of
    procedure :: peek
    procedure :: word
    procedure :: token
    procedure :: tokens
    procedure :: written
    procedure :: raw
    procedure :: file
    procedure :: home
    procedure :: prefix
    procedure :: add_fault
  end type group_cursor

contains

  !> Opens a group.
  subroutine enter(self, number)
    class(group_cursor), intent(inout) :: self
    integer, intent(in) :: number   !! which group of the deck
    self%current = number
    self%line = self%parts%groups(number)%line
    self%head = self%parts%groups(number)%first_assignment - 1
    self%count = self%parts%groups(number)%assignments
  end subroutine enter

  !> Where the open group stands.
  type(origin) function group_origin(self) result(at)
    class(group_cursor), intent(in) :: self
    at%file = self%parts%sources(self%parts%groups(self%current)%file)%path
    at%line = self%line
    at%subject = group_subject(self%parts, self%current)
  end function group_origin

  !> The word after `&` of a group, in lower case.
  pure function group_word(self, number) result(word)
    class(group_cursor), intent(in) :: self
    integer, intent(in) :: number   !! which group of the deck
    character(:), allocatable :: word
    associate (g => self%parts%groups(number))
      word = self%parts%sources(g%file)%text(g%first:g%last)
    end associate
    word = lower(word)
  end function group_word

  !> Where another group stands, in words: `line 7`, `line 7 of lib.nml`.
  pure function location_of(self, number) result(t)
    class(group_cursor), intent(in) :: self
    integer, intent(in) :: number   !! which group of the deck
    character(:), allocatable :: t
    associate (g => self%parts%groups(number))
      t = 'line '//to_text(g%line)
      if (g%file /= self%parts%groups(self%current)%file) t = t//' of '//self%parts%sources(g%file)%path
    end associate
  end function location_of

  !> Number of the first assignment of a variable, or of the next one; 0: there is none.
  pure integer function assignment_of(self, name, after) result(assignment)
    class(group_cursor), intent(in) :: self
    character(*), intent(in) :: name
    integer, intent(in), optional :: after   !! an earlier assignment
    integer :: first
    first = 1
    if (present(after)) first = after + 1
    do assignment = first, self%count
      if (self%parts%assignments(self%head + assignment)%name == name) return
    end do
    assignment = 0
  end function assignment_of

  !> Text of a variable as it stands there, without declaring or checking it; empty where there is none.
  pure function peek(self, name) result(value)
    class(group_cursor), intent(in) :: self
    character(*), intent(in) :: name
    character(:), allocatable :: value
    type(value_token) :: only
    integer :: assignment
    value = ''
    assignment = self%assignment_of(name)
    if (assignment == 0) return
    if (self%tokens(assignment) /= 1) return
    only = self%token(assignment, 1)
    if (only%form == string_value) value = self%word(only)
  end function peek

  !> One value of an assignment as written, without its quotes, doubled quotes made single.
  pure function word(self, token) result(t)
    class(group_cursor), intent(in) :: self
    type(value_token), intent(in) :: token
    character(:), allocatable :: t
    character(1) :: quote
    integer :: i, n
    t = self%raw(token%first, token%last)
    if (token%form /= string_value) return
    quote = self%raw(token%first - 1, token%first - 1)
    n = 0
    i = 1
    do while (i <= len(t))
      n = n + 1
      t(n:n) = t(i:i)
      i = i + merge(2, 1, t(i:i) == quote)
    end do
    t = t(1:n)
  end function word

  !> The k-th value of an assignment.
  pure type(value_token) function token(self, assignment, k) result(v)
    class(group_cursor), intent(in) :: self
    integer, intent(in) :: assignment    !! number of the assignment in the group
    integer, intent(in) :: k        !! which value
    v = self%parts%values(self%parts%assignments(self%head + assignment)%first_value + k - 1)
  end function token

  !> Number of values of an assignment.
  pure integer function tokens(self, assignment) result(n)
    class(group_cursor), intent(in) :: self
    integer, intent(in) :: assignment    !! number of the assignment in the group
    n = self%parts%assignments(self%head + assignment)%values
  end function tokens

  !> One value as it stands in the deck, for messages.
  pure function written(self, token) result(t)
    class(group_cursor), intent(in) :: self
    type(value_token), intent(in) :: token
    character(:), allocatable :: t
    select case (token%form)
    case (string_value)
      t = quoted(printable(self%word(token), 40))
    case (null_value)
      t = 'nothing'
    case (expression_value)
      t = printable(self%raw(token%first, token%last), 80)
      if (token%number < huge(1.0_wp)) t = t//' = '//to_text(token%number)
    case default
      t = printable(self%raw(token%first, token%last), 40)
    end select
  end function written

  !> Characters of the file that the open group stands in.
  pure function raw(self, first, last) result(t)
    class(group_cursor), intent(in) :: self
    integer, intent(in) :: first, last
    character(:), allocatable :: t
    t = self%parts%sources(self%parts%groups(self%current)%file)%text(first:last)
  end function raw

  !> Number of the file that the open group stands in.
  pure integer function file(self)
    class(group_cursor), intent(in) :: self
    file = self%parts%groups(self%current)%file
  end function file

  !> Number of the file whose names and folder a value of the open group means.
  pure integer function home(self, token)
    class(group_cursor), intent(in) :: self
    type(value_token), intent(in) :: token
    home = merge(token%scope, self%file(), token%scope > 0)
  end function home

  !> What belongs in front of the names that the open group defines.
  pure function prefix(self)
    class(group_cursor), intent(in) :: self
    character(:), allocatable :: prefix
    prefix = self%parts%sources(self%file())%prefix
  end function prefix

  !> Appends a fault of the open group.
  subroutine add_fault(self, line, message)
    class(group_cursor), intent(inout) :: self
    integer, intent(in) :: line
    character(*), intent(in) :: message
    call self%faults%add(self%parts%sources(self%parts%groups(self%current)%file)%path, line, &
      group_subject(self%parts, self%current), message)
  end subroutine add_fault
end module deck_cursor
