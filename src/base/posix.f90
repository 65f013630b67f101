!> The few calls of the operating system on files that Fortran lacks: folders, locks, atomic replacement, writes that tell
!> whether they succeeded.
module posix
  use kinds, only: ip
  use, intrinsic :: iso_c_binding, only: c_int, c_char, c_null_char, c_long, c_size_t
  implicit none (type, external)
  private
  public :: make_folder, lock_file, replace_file, remove_file, is_terminal, sync_file, close_lock, truncate_file
  public :: create_file, extend_file, write_bytes, close_file, file_size, drop_lock, tell, c_open, c_close
  public :: standard_output, standard_error, nameless_file, read_back

  integer, parameter :: lock_exclusive_now = 6      !! LOCK_EX + LOCK_NB
  integer, parameter :: read_only = 0, write_only = 1   !! O_RDONLY, O_WRONLY
  integer, parameter :: at_once = 2048              !! O_NONBLOCK: a pipe that nobody reads is refused, not waited for
  integer, parameter :: from_end = 2                !! SEEK_END
  integer, parameter :: exists = 0                  !! F_OK
  integer, parameter :: was_interrupted = 4         !! EINTR
  integer, parameter :: standard_output = 1, standard_error = 2   !! handles for write_bytes
  character(:, c_char), allocatable :: locked   !! path of the lock that this process holds

  interface
    !> mkdir(2): makes one folder.
    integer(c_int) function c_mkdir(path, mode) bind(c, name='mkdir')
      import :: c_char, c_int
      character(kind=c_char), intent(in) :: path(*)
      integer(c_int), value :: mode
    end function c_mkdir
    !> creat(2): opens a file for writing, made anew.
    integer(c_int) function c_creat(path, mode) bind(c, name='creat')
      import :: c_char, c_int
      character(kind=c_char), intent(in) :: path(*)
      integer(c_int), value :: mode
    end function c_creat
    !> access(2): 0 where there is such a file.
    integer(c_int) function c_access(path, mode) bind(c, name='access')
      import :: c_char, c_int
      character(kind=c_char), intent(in) :: path(*)
      integer(c_int), value :: mode
    end function c_access
    !> open(2): opens a file that exists.
    integer(c_int) function c_open(path, flags) bind(c, name='open')
      import :: c_char, c_int
      character(kind=c_char), intent(in) :: path(*)
      integer(c_int), value :: flags
    end function c_open
    !> close(2).
    integer(c_int) function c_close(fd) bind(c, name='close')
      import :: c_int
      integer(c_int), value :: fd
    end function c_close
    !> fsync(2): data to the disk.
    integer(c_int) function c_fsync(fd) bind(c, name='fsync')
      import :: c_int
      integer(c_int), value :: fd
    end function c_fsync
    !> isatty(3): 1 for a terminal.
    integer(c_int) function c_isatty(fd) bind(c, name='isatty')
      import :: c_int
      integer(c_int), value :: fd
    end function c_isatty
    !> flock(2): locks an open file.
    integer(c_int) function c_flock(fd, operation) bind(c, name='flock')
      import :: c_int
      integer(c_int), value :: fd, operation
    end function c_flock
    !> The last system call's errno.
    integer(c_int) function c_errno() bind(c, name='_gfortran_ierrno_i4')
      import :: c_int
    end function c_errno
    !> write(2): bytes to an open file; how many were taken, -1 on failure.
    integer(c_long) function c_write(fd, bytes, count) bind(c, name='write')
      import :: c_char, c_int, c_size_t, c_long
      integer(c_int), value :: fd
      character(kind=c_char), intent(in) :: bytes(*)
      integer(c_size_t), value :: count
    end function c_write
    !> mkstemp(3): makes and opens a file whose name ends with letters of its own choice, in place of XXXXXX.
    integer(c_int) function c_mkstemp(name) bind(c, name='mkstemp')
      import :: c_char, c_int
      character(kind=c_char), intent(inout) :: name(18)
    end function c_mkstemp
    !> read(2): bytes from an open file; how many there were.
    integer(c_long) function c_read(fd, bytes, count) bind(c, name='read')
      import :: c_char, c_int, c_size_t, c_long
      integer(c_int), value :: fd
      integer(c_size_t), value :: count
      character(kind=c_char), intent(out) :: bytes(count)
    end function c_read
    !> lseek(2): where the next byte of an open file goes.
    integer(c_long) function c_lseek(fd, offset, whence) bind(c, name='lseek')
      import :: c_int, c_long
      integer(c_int), value :: fd, whence
      integer(c_long), value :: offset
    end function c_lseek
    !> rename(2): in one step, over an existing file.
    integer(c_int) function c_rename(from, to) bind(c, name='rename')
      import :: c_char, c_int
      character(kind=c_char), intent(in) :: from(*), to(*)
    end function c_rename
    !> unlink(2): removes a file.
    integer(c_int) function c_unlink(path) bind(c, name='unlink')
      import :: c_char, c_int
      character(kind=c_char), intent(in) :: path(*)
    end function c_unlink
    !> truncate(2): cuts a file to a length.
    integer(c_int) function c_truncate(path, length) bind(c, name='truncate')
      import :: c_char, c_int, c_long
      character(kind=c_char), intent(in) :: path(*)
      integer(c_long), value :: length
    end function c_truncate
  end interface

contains

  !> Makes a folder and its parents; where that fails, so will the first file in it.
  subroutine make_folder(path)
    character(*), intent(in) :: path
    integer :: k
    integer(c_int) :: status
    do k = 2, len(path)
      if (path(k:k) == '/') status = c_mkdir(path(1:k - 1)//c_null_char, int(o'777'))
    end do
    status = c_mkdir(path//c_null_char, int(o'777'))
  end subroutine make_folder

  !> Opens and locks a file for this process alone; the lock ends with the process. Handle: > 0 locked, 0 held by
  !> another process, -1 the file cannot be written.
  integer function lock_file(path) result(handle)
    character(*), intent(in) :: path
    integer(c_int) :: status
    handle = create_file(path)
    if (handle < 0) return
    status = c_flock(handle, lock_exclusive_now)
    if (status /= 0) then
      status = c_close(handle)
      handle = 0
    else
      locked = path//c_null_char
    end if
  end function lock_file

  !> Ends a lock and removes its file.
  subroutine close_lock(path, handle)
    character(*), intent(in) :: path
    integer, intent(in) :: handle
    integer(c_int) :: status
    if (handle <= 0) return
    status = c_unlink(path//c_null_char)
    status = c_close(handle)
    deallocate (locked)
  end subroutine close_lock

  !> Removes the file of the lock that this process holds, if it holds one: for a process that has to end at once.
  subroutine drop_lock()
    integer(c_int) :: status
    if (allocated(locked)) status = c_unlink(locked)
  end subroutine drop_lock

  !> Renames a file over another in one step.
  logical function replace_file(from, to) result(ok)
    character(*), intent(in) :: from, to
    ok = c_rename(from//c_null_char, to//c_null_char) == 0
  end function replace_file

  !> Removes an ordinary file, if there is one; a pipe of that name belongs to somebody else and stays.
  subroutine remove_file(path)
    character(*), intent(in) :: path
    integer(c_int) :: status
    if (file_size(path) >= 0) status = c_unlink(path//c_null_char)
  end subroutine remove_file

  !> Makes an empty file, in place of an old one, and opens it for writing; negative where that fails or where a pipe stands
  !> there. The run-time library's own files do not report a full disk reliably: what it could not write is lost in silence.
  integer function create_file(path) result(handle)
    character(*), intent(in) :: path
    integer(c_int) :: status
    if (c_access(path//c_null_char, exists) == 0) then
      handle = extend_file(path)
      if (handle < 0) return
      status = c_close(handle)
    end if
    handle = c_creat(path//c_null_char, int(o'666'))
  end function create_file

  !> Opens a temporary file without a name, which the system removes when it is closed; negative where that fails.
  integer function nameless_file() result(handle)
    character(18, c_char) :: name
    integer(c_int) :: status
    name = '/tmp/biela.XXXXXX'//c_null_char
    handle = c_mkstemp(name)
    if (handle >= 0) status = c_unlink(name)
  end function nameless_file

  !> All that was written to an open file, which is closed.
  function read_back(handle) result(text)
    integer, intent(in) :: handle
    character(:), allocatable :: text
    integer(c_long) :: bytes, start
    integer(c_int) :: status
    bytes = c_lseek(handle, 0_c_long, from_end)
    start = c_lseek(handle, 0_c_long, 0)
    allocate (character(max(0_c_long, bytes)) :: text)
    if (bytes > 0) bytes = c_read(handle, text, int(bytes, c_size_t))
    status = c_close(handle)
  end function read_back

  !> Opens a file that exists to write behind its end; negative where that fails.
  integer function extend_file(path) result(handle)
    character(*), intent(in) :: path
    integer(c_int) :: status
    handle = c_open(path//c_null_char, ior(write_only, at_once))
    if (handle < 0) return
    if (c_lseek(handle, 0_c_long, from_end) >= 0) return
    status = c_close(handle)
    handle = -1
  end function extend_file

  !> Bytes of a file; -1 where it cannot be read, or is a pipe or a folder.
  integer(ip) function file_size(path) result(bytes)
    character(*), intent(in) :: path
    integer(c_int) :: fd, status
    bytes = -1
    if (c_access(path//'/.'//c_null_char, exists) == 0) return
    fd = c_open(path//c_null_char, ior(read_only, at_once))
    if (fd < 0) return
    bytes = c_lseek(fd, 0_c_long, from_end)
    status = c_close(fd)
  end function file_size

  !> Writes bytes; ok only where all of them are written.
  logical function write_bytes(handle, bytes) result(ok)
    integer, intent(in) :: handle
    character(*), intent(in) :: bytes
    integer(c_long) :: done, here
    integer(c_int) :: code
    done = 0
    do while (done < len(bytes))
      here = c_write(handle, bytes(done + 1:), int(len(bytes) - done, c_size_t))
      code = 0
      if (here < 0) code = c_errno()
      if (code == was_interrupted) cycle
      if (here <= 0) exit
      done = done + here
    end do
    ok = done == len(bytes)
  end function write_bytes

  !> A line of text to standard error. The run-time library's unit would end the program where that is closed.
  subroutine tell(line)
    character(*), intent(in) :: line
    logical :: written
    written = write_bytes(standard_error, line//new_line('a'))
  end subroutine tell

  !> Closes a file; ok only where nothing written to it was lost.
  logical function close_file(handle) result(ok)
    integer, intent(in) :: handle
    ok = c_close(handle) == 0
  end function close_file

  !> Cuts a file to a length in bytes.
  logical function truncate_file(path, length) result(ok)
    character(*), intent(in) :: path
    integer(ip), intent(in) :: length
    ok = c_truncate(path//c_null_char, length) == 0
  end function truncate_file

  !> Whether a file descriptor is a terminal (1: standard output, 2: standard error).
  logical function is_terminal(fd) result(yes)
    integer, intent(in) :: fd
    yes = c_isatty(fd) == 1
  end function is_terminal

  !> Waits until what was written to a file (or the names in a folder) is on the disk.
  logical function sync_file(path) result(ok)
    character(*), intent(in) :: path
    integer(c_int) :: fd, status
    fd = c_open(path//c_null_char, read_only)
    ok = fd >= 0
    if (.not. ok) return
    ok = c_fsync(fd) == 0
    status = c_close(fd)
  end function sync_file
end module posix
