!> Where a record of a deck comes from, and the name by which other groups refer to it.
module deck_origin
  use errors, only: fault_list
  implicit none (type, external)
  private

  integer, parameter, public :: name_length = 32   !! longest name a deck may use

  !> The group of a record, for messages.
  type, public :: origin
    character(:), allocatable :: file
    integer :: line = 0                      !! where it starts
    character(:), allocatable :: subject     !! `group/name`
  contains
    procedure :: blame
  end type origin

  !> What all groups with a name have.
  type, public :: named_record
    type(origin) :: at
    character(name_length) :: name = ''
  end type named_record

contains

  !> Adds a fault of the group.
  subroutine blame(self, faults, message)
    class(origin), intent(in) :: self
    type(fault_list), intent(inout) :: faults
    character(*), intent(in) :: message   !! what is wrong, what was expected
    call faults%add(self%file, self%line, self%subject, message)
  end subroutine blame
end module deck_origin
