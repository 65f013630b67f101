!> The variables that a group knows, collected while they are asked for, and the required ones that it does not give.
module deck_known
  use text, only: meant_word, joined
  use deck_syntax, only: longest
  implicit none (type, external)
  private

  !> One variable.
  type, public :: variable
    character(longest) :: name = ''
    logical :: applies = .false.               ! it applies to this kind of the group
    logical :: given = .false.                 ! the group gives it
    character(:), allocatable :: missing       !! what is expected, where it is required and not given; empty otherwise
  end type variable

  !> The variables of the open group.
  type, public :: variable_list
    type(variable), allocatable :: items(:)
    integer :: count = 0
  contains
    procedure :: declare
    procedure :: note_missing
    procedure :: position_of
    procedure :: nearest_variable
    procedure :: applicable
  end type variable_list

contains

  !> Adds a variable, once even if it is declared for several kinds.
  subroutine declare(self, name, applies, given)
    class(variable_list), intent(inout) :: self
    character(*), intent(in) :: name   !! variable
    logical, intent(in) :: applies     !! whether it applies
    logical, intent(in) :: given       !! whether the group gives it
    integer :: k
    k = self%position_of(name)
    if (k == 0) then
      if (.not. allocated(self%items)) allocate (self%items(40))
      if (self%count == size(self%items)) self%items = [self%items, self%items]
      self%count = self%count + 1
      k = self%count
      self%items(k) = variable(name, .false., .false., '')
    end if
    self%items(k)%applies = self%items(k)%applies .or. applies
    self%items(k)%given = given
  end subroutine declare

  !> Notes that a declared variable is required and not given.
  subroutine note_missing(self, name, expected)
    class(variable_list), intent(inout) :: self
    character(*), intent(in) :: name       !! variable
    character(*), intent(in) :: expected   !! what is expected
    integer :: k
    k = self%position_of(name)
    if (k > 0) self%items(k)%missing = expected
  end subroutine note_missing

  !> Position of a variable, 0 if it is not declared.
  pure integer function position_of(self, name) result(k)
    class(variable_list), intent(in) :: self
    character(*), intent(in) :: name   !! variable
    do k = self%count, 1, -1
      if (self%items(k)%name == name) return
    end do
  end function position_of

  !> Position of the variable that a misspelt word means, 0 if none is near. A variable that the group gives already is not meant.
  pure integer function nearest_variable(self, word) result(k)
    class(variable_list), intent(in) :: self
    character(*), intent(in) :: word   !! misspelt word
    character(longest) :: names(self%count)
    names = self%items(1:self%count)%name
    where (self%items(1:self%count)%given) names = ''
    k = meant_word(word, names)
  end function nearest_variable

  !> The variables that apply, with commas between.
  pure function applicable(self) result(t)
    class(variable_list), intent(in) :: self
    character(:), allocatable :: t
    character(longest) :: names(self%count)
    logical :: applies(self%count)
    names = self%items(1:self%count)%name
    applies = self%items(1:self%count)%applies
    t = joined(pack(names, applies), ', ')
  end function applicable
end module deck_known
