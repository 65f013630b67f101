!> Errors as values: a run-time failure travels up as `failure`, deck faults are collected in a `fault_list`
!> and shown all at once. Nothing here stops the program; only the main program does.
module errors
  use posix, only: tell
  use text, only: to_text
  implicit none (type, external)
  private
  public :: fault_list, failure

  !> Exit statuses of the program (`biela --help`).
  integer, parameter, public :: status_ok = 0         !! done
  integer, parameter, public :: status_failed = 1     !! the analysis failed; results up to the last good time are on disk
  integer, parameter, public :: status_bad_input = 2  !! command line or deck is wrong; nothing was written
  integer, parameter, public :: status_no_output = 3  !! results could not be written
  integer, parameter, public :: status_signal = 128   !! plus the signal's number: stopped cleanly by that signal

  integer, parameter, public :: most_shown = 100              !! faults that are written; nobody reads more

  !> One line of a diagnosis: where, what, and what was expected.
  type :: fault
    character(:), allocatable :: file      !! deck file as the user named it
    integer :: line = 0                    !! line in that file, 0 where no line applies
    character(:), allocatable :: subject   !! `group/name`, may be empty
    character(:), allocatable :: message   !! what is wrong, what was expected
  end type fault

  !> All faults found in one deck, in the order found.
  type :: fault_list
    type(fault), allocatable :: items(:)
    integer :: count = 0
  contains
    procedure :: add => add_fault
    procedure :: print => print_faults
  end type fault_list

  !> A failure of an analysis: the exit status and one paragraph of explanation.
  type :: failure
    integer :: status = status_ok
    character(:), allocatable :: message
    character(:), allocatable :: deck_line !! `DECK:LINE` of the group that the message names, if it names one
  contains
    procedure :: raise => raise_failure
    procedure :: tell => tell_failure
    procedure :: happened => failure_happened
  end type failure

contains

  !> Appends one fault.
  subroutine add_fault(self, file, line, subject, message)
    class(fault_list), intent(inout) :: self
    character(*), intent(in) :: file      !! deck file
    integer, intent(in) :: line           !! line, 0: none
    character(*), intent(in) :: subject   !! `group/name` or empty
    character(*), intent(in) :: message   !! what is wrong, what was expected
    if (.not. allocated(self%items)) allocate (self%items(16))
    if (self%count == size(self%items)) self%items = [self%items, self%items]
    self%count = self%count + 1
    self%items(self%count) = fault(file, line, subject, message)
  end subroutine add_fault

  !> Writes the first faults, `DECK:LINE: group/name: message` a line, to standard error, and how many more there are.
  subroutine print_faults(self)
    class(fault_list), intent(in) :: self
    character(:), allocatable :: text
    integer :: k
    do k = 1, min(self%count, most_shown)
      associate (f => self%items(k))
        text = f%file
        if (f%line > 0) text = text//':'//to_text(f%line)
        text = text//': '
        if (len(f%subject) > 0) text = text//f%subject//': '
        call tell(text//f%message)
      end associate
    end do
    if (self%count > most_shown) call tell(self%items(1)%file//': '//to_text(self%count - most_shown)//' more faults are not shown')
  end subroutine print_faults

  !> Records a failure; the first one wins, since what follows is usually its consequence.
  subroutine raise_failure(self, status, message)
    class(failure), intent(inout) :: self
    integer, intent(in) :: status        !! one of the exit statuses, not status_ok
    character(*), intent(in) :: message  !! what happened, when, which body or joint, what to try
    if (self%status /= status_ok) return
    self%status = status
    self%message = message
  end subroutine raise_failure

  !> Writes the failure to standard error, with the line of the group that it names.
  subroutine tell_failure(self, path)
    class(failure), intent(in) :: self
    character(*), intent(in) :: path     !! deck file
    if (allocated(self%deck_line)) then
      call tell(self%deck_line//': '//self%message)
    else
      call tell(path//': '//self%message)
    end if
  end subroutine tell_failure

  !> Whether a failure has been raised.
  pure logical function failure_happened(self) result(yes)
    class(failure), intent(in) :: self
    yes = self%status /= status_ok
  end function failure_happened
end module errors
