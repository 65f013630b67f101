!> The few calls of the operating system that Fortran lacks: folders, locks, atomic replacement, terminals, signals.
module posix
  use, intrinsic :: iso_c_binding, only: c_int, c_char, c_null_char, c_long, c_funptr, c_funloc, c_ptr, c_intptr_t, c_null_funptr, &
                                         c_size_t
  implicit none (type, external)
  private
  public :: make_folder, lock_file, replace_file, remove_file, is_terminal, sync_file, close_lock, truncate_file
  public :: create_file, extend_file, write_bytes, close_file
  public :: catch_signals, caught_signal, survive_size_limits, standard_output

  integer, parameter :: lock_exclusive_now = 6      !! LOCK_EX + LOCK_NB
  integer, parameter :: read_only = 0, write_only = 1   !! O_RDONLY, O_WRONLY
  integer, parameter :: from_end = 2                !! SEEK_END
  integer, parameter :: standard_output = 1         !! handle for write_bytes
  integer, parameter :: signal_interrupt = 2, signal_terminate = 15, signal_file_size = 25
  integer(c_int), volatile :: received = 0    !! the last signal caught

  interface
    !> mkdir(2): makes one folder.
    function c_mkdir(path, mode) bind(c, name='mkdir') result(status)
      import :: c_char, c_int
      character(kind=c_char), intent(in) :: path(*)
      integer(c_int), value :: mode
      integer(c_int) :: status
    end function c_mkdir
    !> creat(2): opens a file for writing, made anew.
    function c_creat(path, mode) bind(c, name='creat') result(fd)
      import :: c_char, c_int
      character(kind=c_char), intent(in) :: path(*)
      integer(c_int), value :: mode
      integer(c_int) :: fd
    end function c_creat
    !> flock(2): locks an open file.
    function c_open(path, flags) bind(c, name='open') result(fd)
      import :: c_char, c_int
      character(kind=c_char), intent(in) :: path(*)
      integer(c_int), value :: flags
      integer(c_int) :: fd
    end function c_open
    !> write(2): bytes to an open file; how many were taken, -1 on failure.
    function c_write(fd, bytes, count) bind(c, name='write') result(done)
      import :: c_char, c_int, c_size_t, c_long
      integer(c_int), value :: fd
      character(kind=c_char), intent(in) :: bytes(*)
      integer(c_size_t), value :: count
      integer(c_long) :: done
    end function c_write
    !> lseek(2): where the next byte of an open file goes.
    function c_lseek(fd, offset, whence) bind(c, name='lseek') result(position)
      import :: c_int, c_long
      integer(c_int), value :: fd, whence
      integer(c_long), value :: offset
      integer(c_long) :: position
    end function c_lseek
    !> flock(2): locks an open file.
    function c_flock(fd, operation) bind(c, name='flock') result(status)
      import :: c_int
      integer(c_int), value :: fd, operation
      integer(c_int) :: status
    end function c_flock
    !> close(2).
    function c_close(fd) bind(c, name='close') result(status)
      import :: c_int
      integer(c_int), value :: fd
      integer(c_int) :: status
    end function c_close
    !> rename(2): in one step, over an existing file.
    function c_rename(from, to) bind(c, name='rename') result(status)
      import :: c_char, c_int
      character(kind=c_char), intent(in) :: from(*), to(*)
      integer(c_int) :: status
    end function c_rename
    !> unlink(2): removes a file.
    function c_unlink(path) bind(c, name='unlink') result(status)
      import :: c_char, c_int
      character(kind=c_char), intent(in) :: path(*)
      integer(c_int) :: status
    end function c_unlink
    !> isatty(3): 1 for a terminal.
    function c_isatty(fd) bind(c, name='isatty') result(yes)
      import :: c_int
      integer(c_int), value :: fd
      integer(c_int) :: yes
    end function c_isatty
    !> fsync(2): data to the disk.
    function c_fsync(fd) bind(c, name='fsync') result(status)
      import :: c_int
      integer(c_int), value :: fd
      integer(c_int) :: status
    end function c_fsync
    !> truncate(2): cuts a file to a length.
    function c_truncate(path, length) bind(c, name='truncate') result(status)
      import :: c_char, c_int, c_long
      character(kind=c_char), intent(in) :: path(*)
      integer(c_long), value :: length
      integer(c_int) :: status
    end function c_truncate
    !> signal(2): sets a handler.
    function c_signal(number, handler) bind(c, name='signal') result(old)
      import :: c_int, c_funptr
      integer(c_int), value :: number
      type(c_funptr), value :: handler
      type(c_funptr) :: old
    end function c_signal
  end interface

contains

  !> Makes a folder and its parents; true where it exists afterwards or may exist already.
  subroutine make_folder(path)
    character(*), intent(in) :: path
    integer :: k
    integer(c_int) :: status
    do k = 2, len(path)
      if (path(k:k) == '/') status = c_mkdir(path(1:k - 1)//c_null_char, int(o'777', c_int))
    end do
    status = c_mkdir(path//c_null_char, int(o'777', c_int))
  end subroutine make_folder

  !> Opens and locks a file for this process alone; the lock ends with the process. Handle: > 0 locked, 0 held by
  !> another process, -1 the file cannot be written.
  function lock_file(path) result(handle)
    character(*), intent(in) :: path
    integer :: handle
    integer(c_int) :: status
    handle = int(c_creat(path//c_null_char, int(o'666', c_int)))
    if (handle < 0) return
    status = c_flock(int(handle, c_int), int(lock_exclusive_now, c_int))
    if (status /= 0) then
      status = c_close(int(handle, c_int))
      handle = 0
    end if
  end function lock_file

  !> Ends a lock and removes its file.
  subroutine close_lock(path, handle)
    character(*), intent(in) :: path
    integer, intent(in) :: handle
    integer(c_int) :: status
    if (handle <= 0) return
    status = c_unlink(path//c_null_char)
    status = c_close(int(handle, c_int))
  end subroutine close_lock

  !> Renames a file over another in one step.
  function replace_file(from, to) result(ok)
    character(*), intent(in) :: from, to
    logical :: ok
    ok = c_rename(from//c_null_char, to//c_null_char) == 0
  end function replace_file

  !> Removes a file; nothing happens where there is none.
  subroutine remove_file(path)
    character(*), intent(in) :: path
    integer(c_int) :: status
    status = c_unlink(path//c_null_char)
  end subroutine remove_file

  !> Makes an empty file, in place of an old one, and opens it for writing; negative where that fails. The run-time library's
  !> own files do not report a full disk reliably: what it could not write is lost in silence.
  function create_file(path) result(handle)
    character(*), intent(in) :: path
    integer :: handle
    handle = int(c_creat(path//c_null_char, int(o'666', c_int)))
  end function create_file

  !> Opens a file that exists to write behind its end; negative where that fails.
  function extend_file(path) result(handle)
    character(*), intent(in) :: path
    integer :: handle
    handle = int(c_open(path//c_null_char, int(write_only, c_int)))
    if (handle < 0) return
    if (c_lseek(int(handle, c_int), 0_c_long, int(from_end, c_int)) < 0) handle = -1
  end function extend_file

  !> Writes bytes; ok only where all of them are written.
  function write_bytes(handle, bytes) result(ok)
    integer, intent(in) :: handle
    character(*), intent(in) :: bytes
    logical :: ok
    integer(c_long) :: done, here
    done = 0
    do while (done < len(bytes))
      here = c_write(int(handle, c_int), bytes(done + 1:), int(len(bytes) - done, c_size_t))
      if (here <= 0) exit
      done = done + here
    end do
    ok = done == len(bytes)
  end function write_bytes

  !> Closes a file; ok only where nothing written to it was lost.
  function close_file(handle) result(ok)
    integer, intent(in) :: handle
    logical :: ok
    ok = c_close(int(handle, c_int)) == 0
  end function close_file

  !> Cuts a file to a length in bytes.
  function truncate_file(path, length) result(ok)
    character(*), intent(in) :: path
    integer(c_long), intent(in) :: length
    logical :: ok
    ok = c_truncate(path//c_null_char, length) == 0
  end function truncate_file

  !> Whether a file descriptor is a terminal (1: standard output, 2: standard error).
  function is_terminal(fd) result(yes)
    integer, intent(in) :: fd
    logical :: yes
    yes = c_isatty(int(fd, c_int)) == 1
  end function is_terminal

  !> Waits until what was written to a file (or the names in a folder) is on the disk.
  function sync_file(path) result(ok)
    character(*), intent(in) :: path
    logical :: ok
    integer(c_int) :: fd, status
    fd = c_open(path//c_null_char, int(read_only, c_int))
    ok = fd >= 0
    if (.not. ok) return
    ok = c_fsync(fd) == 0
    status = c_close(fd)
  end function sync_file

  !> From now on SIGINT and SIGTERM are only noted.
  subroutine catch_signals()
    type(c_funptr) :: old
    received = 0
    old = c_signal(int(signal_interrupt, c_int), c_funloc(note_signal))
    old = c_signal(int(signal_terminate, c_int), c_funloc(note_signal))
  end subroutine catch_signals

  !> A write beyond a limit on file sizes fails like one on a full disk, instead of ending the program (SIG_IGN is 1).
  subroutine survive_size_limits()
    type(c_funptr) :: old
    old = c_signal(int(signal_file_size, c_int), transfer(1_c_intptr_t, c_null_funptr))
  end subroutine survive_size_limits

  !> The handler: notes the signal's number, nothing else.
  subroutine note_signal(number) bind(c)
    integer(c_int), value :: number
    received = number
  end subroutine note_signal

  !> Number of the signal caught, 0: none.
  function caught_signal() result(number)
    integer :: number
    number = int(received)
  end function caught_signal
end module posix
