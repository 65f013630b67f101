!> What Fortran lacks of the operating system, by `system_calls.c`: files that are replaced, locked and written whole, signals,
!> child processes.
module posix
  use readable_text, only: one_line
  use text, only: lower
  use, intrinsic :: iso_c_binding, only: c_bool, c_char, c_int, c_long, c_null_char
  implicit none (type, external)
  private
  public :: make_folder, lock_file, close_lock, replace_file, remove_file, remove_scratch, create_file, extend_file, cut_file
  public :: write_bytes, close_file, file_size, same_file, open_sole, open_to_read, size_of, read_bytes
  public :: nameless_file, read_back, sync_file, is_terminal, tell, reason, host_name, current_folder
  public :: begin_process, end_process, caught_signal, hold_signals, start_child, wait_for_child, exit_at_once

  integer, parameter, public :: standard_input = 0, standard_output = 1, standard_error = 2   !! handles
  integer, parameter, public :: most_children = 1024              !! that run at a time, as in system_calls.c
  integer, parameter, public :: size_of_folder = -2               !! in place of bytes, as in system_calls.c
  integer, parameter :: of_error = 0, of_host = 1, of_folder = 2  !! what `c_words` tells

  interface
    !> Makes a folder and its parents; where that fails, so will the first file in it.
    subroutine make_folder(path) bind(c, name='biela_make_folder')
      import :: c_char
      character(*, c_char), intent(in) :: path
    end subroutine make_folder
    !> Opens and locks a file for this process alone: > 0: its handle; 0: another process holds it; -1: it cannot be written.
    integer(c_int) function lock_file(path) bind(c, name='biela_lock_file')
      import :: c_char, c_int
      character(*, c_char), intent(in) :: path
    end function lock_file
    !> Ends a lock and removes its file.
    subroutine close_lock(handle) bind(c, name='biela_close_lock')
      import :: c_int
      integer(c_int), value :: handle
    end subroutine close_lock
    !> Renames a file over another in one step.
    logical(c_bool) function replace_file(from, to) bind(c, name='biela_replace_file')
      import :: c_bool, c_char
      character(*, c_char), intent(in) :: from, to
    end function replace_file
    !> Removes a result, or the link that has its name; a pipe or a folder stays.
    subroutine remove_file(path) bind(c, name='biela_remove_file')
      import :: c_char
      character(*, c_char), intent(in) :: path
    end subroutine remove_file
    !> Removes what create_file has made or would replace, nothing else.
    subroutine remove_scratch(path) bind(c, name='biela_remove_scratch')
      import :: c_char
      character(*, c_char), intent(in) :: path
    end subroutine remove_scratch
    !> Makes an empty file in place of an ordinary one of that name; negative where that fails.
    integer(c_int) function create_file(path) bind(c, name='biela_create_file')
      import :: c_char, c_int
      character(*, c_char), intent(in) :: path
    end function create_file
    !> Opens an ordinary file that exists, to be cut where writing goes on; negative where that fails.
    integer(c_int) function extend_file(path) bind(c, name='biela_extend_file')
      import :: c_char, c_int
      character(*, c_char), intent(in) :: path
    end function extend_file
    !> Cuts an open file to a length in bytes; what is written then goes behind it.
    logical(c_bool) function cut_file(handle, length) bind(c, name='biela_cut_file')
      import :: c_bool, c_int, c_long
      integer(c_int), value :: handle
      integer(c_long), value :: length
    end function cut_file
    !> Writes bytes; ok only where all of them are written.
    logical(c_bool) function write_bytes(handle, bytes) bind(c, name='biela_write_bytes')
      import :: c_bool, c_char, c_int
      integer(c_int), value :: handle
      character(*, c_char), intent(in) :: bytes
    end function write_bytes
    !> Closes a file; ok only where nothing written to it was lost.
    logical(c_bool) function close_file(handle) bind(c, name='biela_close_file')
      import :: c_bool, c_int
      integer(c_int), value :: handle
    end function close_file
    !> Bytes of a file; negative where it cannot be read or is no ordinary file.
    integer(c_long) function file_size(path) bind(c, name='biela_file_size')
      import :: c_char, c_long
      character(*, c_char), intent(in) :: path
    end function file_size
    !> Whether two paths lead to one file.
    logical(c_bool) function same_file(one, other) bind(c, name='biela_same_file')
      import :: c_bool, c_char
      character(*, c_char), intent(in) :: one, other
    end function same_file
    !> Opens an ordinary file for reading that has no other name and is no link; -1: there is none, -2: it cannot be read.
    integer(c_int) function open_sole(path) bind(c, name='biela_open_sole')
      import :: c_char, c_int
      character(*, c_char), intent(in) :: path
    end function open_sole
    !> Opens a file that exists for reading (wait > 0: until a pipe is written to); negative where that fails.
    integer(c_int) function open_to_read(path, wait) bind(c, name='biela_open_to_read')
      import :: c_char, c_int
      character(*, c_char), intent(in) :: path
      integer(c_int), value :: wait
    end function open_to_read
    !> Bytes of an open file, which is then read from its beginning; negative where it is no ordinary file.
    integer(c_long) function size_of(handle) bind(c, name='biela_size_of')
      import :: c_int, c_long
      integer(c_int), value :: handle
    end function size_of
    !> Reads the next bytes; how many there were, 0 at the end, negative where that fails.
    integer(c_int) function read_bytes(handle, room) bind(c, name='biela_read_bytes')
      import :: c_char, c_int
      integer(c_int), value :: handle
      ! allow(C072): a buffer of any length is filled
      character(*, c_char), intent(inout) :: room
    end function read_bytes
    !> Opens a temporary file, which the system removes when it is closed; negative where that fails.
    integer(c_int) function nameless_file() bind(c, name='biela_nameless_file')
      import :: c_int
    end function nameless_file
    !> Waits until what was written to an open file, or the names in an open folder, are on the disk.
    logical(c_bool) function sync_file(handle) bind(c, name='biela_sync_file')
      import :: c_bool, c_int
      integer(c_int), value :: handle
    end function sync_file
    !> Whether a handle is a terminal.
    logical(c_bool) function is_terminal(handle) bind(c, name='biela_is_terminal')
      import :: c_bool, c_int
      integer(c_int), value :: handle
    end function is_terminal
    !> Words of the system, null characters behind them.
    subroutine c_words(what, room) bind(c, name='biela_words')
      import :: c_char, c_int
      integer(c_int), value :: what
      ! allow(C072): a buffer of any length is filled
      character(*, c_char), intent(inout) :: room
    end subroutine c_words
    !> Prepares streams and handlers of signals; called before anything else.
    subroutine begin_process() bind(c, name='biela_begin_process')
    end subroutine begin_process
    !> The program ends by its own decision: nothing more is said.
    subroutine end_process() bind(c, name='biela_end_process')
    end subroutine end_process
    !> Number of the signal caught, 0: none.
    integer(c_int) function caught_signal() bind(c, name='biela_caught_signal')
      import :: c_int
    end function caught_signal
    !> Notes signals (1) while results are written; else (0) they end the program.
    subroutine hold_signals(yes) bind(c, name='biela_hold_signals')
      import :: c_int
      integer(c_int), value :: yes
    end subroutine hold_signals
    !> A second process that goes on from here, its output in a file: 0 in it, its number in this one, negative: none.
    integer(c_int) function start_child(handle) bind(c, name='biela_start_child')
      import :: c_int
      integer(c_int), value :: handle
    end function start_child
    !> Number of a child that has ended, 0: there is none, and its exit status (128 + signal that ended it).
    integer(c_int) function wait_for_child(status) bind(c, name='biela_wait_for_child')
      import :: c_int
      integer(c_int), intent(out) :: status
    end function wait_for_child
    !> Ends the process at once.
    subroutine exit_at_once(status) bind(c, name='_exit')
      import :: c_int
      integer(c_int), value :: status
    end subroutine exit_at_once
  end interface

contains

  !> All that was written to an open file, which is closed.
  function read_back(handle) result(text)
    integer, intent(in) :: handle
    character(:), allocatable :: text
    integer :: n
    logical :: closed
    allocate (character(max(0_c_long, size_of(handle))) :: text)
    n = read_bytes(handle, text)
    closed = close_file(handle)
  end function read_back

  !> A line of text to standard error, without what could steer a terminal. The run-time library's own unit would end the program
  !> where standard error is closed.
  subroutine tell(line)
    character(*), intent(in) :: line
    logical :: written
    written = write_bytes(standard_error, one_line(line)//new_line('a'))
  end subroutine tell

  !> Why the last call of the system failed, in its words: `no such file or directory`.
  function reason() result(words)
    character(:), allocatable :: words
    words = words_of(of_error)
    words(:1) = lower(words(:1))
  end function reason

  !> Name of this machine; empty where the system does not tell.
  function host_name() result(name)
    character(:), allocatable :: name
    name = words_of(of_host)
  end function host_name

  !> The current folder with a closing slash; empty where the system does not tell.
  function current_folder() result(path)
    character(:), allocatable :: path
    path = words_of(of_folder)
    if (len(path) > 0) path = path//'/'
  end function current_folder

  !> Words of the system, without what it leaves behind them.
  function words_of(what) result(words)
    integer, intent(in) :: what
    character(:), allocatable :: words
    character(4096, c_char) :: letters
    call c_words(what, letters)
    words = letters(:index(letters, c_null_char) - 1)
  end function words_of
end module posix
