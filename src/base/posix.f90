!> The few calls of the operating system on files that Fortran lacks: folders, locks, atomic replacement, writes that tell
!> whether they succeeded. Nothing is written through a symbolic link, and no file that exists is emptied.
module posix
  use kinds, only: ip
  use readable_text, only: one_line
  use text, only: lower
  use, intrinsic :: iso_c_binding, only: c_int, c_char, c_null_char, c_long, c_ptr, c_size_t, c_associated, &
    c_f_pointer
  implicit none (type, external)
  private
  public :: make_folder, lock_file, replace_file, remove_file, remove_scratch, is_terminal, sync_file, sync_folder, close_lock
  public :: create_file, extend_file, cut_file, write_bytes, close_file, file_size, drop_lock, tell, c_open, c_close
  public :: standard_input, standard_output, standard_error, nameless_file, read_back, open_to_read, read_bytes, size_of
  public :: reason, host_name, current_folder, c_getpid

  integer, parameter :: lock_exclusive_now = 6      !! LOCK_EX + LOCK_NB
  integer, parameter :: read_only = 0, read_write = 2   !! O_RDONLY, O_RDWR
  integer, parameter :: at_once = 2048              !! O_NONBLOCK: a pipe that nobody reads is refused, not waited for
  integer, parameter :: from_end = 2                !! SEEK_END
  integer, parameter :: exists = 0                  !! F_OK
  integer, parameter :: was_interrupted = 4         !! EINTR
  integer, parameter :: most_lock_trials = 1000     !! times that others may take a lock in between
  integer, parameter :: standard_input = 0, standard_output = 1, standard_error = 2   !! handles
  character(:, c_char), allocatable :: locked   !! path of the lock that this process holds

  interface
    !> mkdir(2): makes one folder.
    integer(c_int) function c_mkdir(path, mode) bind(c, name='mkdir')
      import :: c_char, c_int
      character(kind=c_char), intent(in) :: path(*)
      integer(c_int), value :: mode
    end function c_mkdir
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
    !> gethostname(3): name of this machine.
    integer(c_int) function c_gethostname(name, room) bind(c, name='gethostname')
      import :: c_char, c_int, c_size_t
      ! allow(C072): a buffer of any length is filled
      character(kind=c_char), intent(out) :: name(*)
      integer(c_size_t), value :: room
    end function c_gethostname
    !> getcwd(3): the current folder, a null pointer where it cannot be found.
    type(c_ptr) function c_getcwd(path, room) bind(c, name='getcwd')
      import :: c_char, c_ptr, c_size_t
      ! allow(C072): a buffer of any length is filled
      character(kind=c_char), intent(out) :: path(*)
      integer(c_size_t), value :: room
    end function c_getcwd
    !> strerror(3): the words for it, a C string.
    type(c_ptr) function c_strerror(number) bind(c, name='strerror')
      import :: c_int, c_ptr
      integer(c_int), value :: number
    end function c_strerror
    !> write(2): bytes to an open file; how many were taken, -1 on failure.
    integer(c_long) function c_write(fd, bytes, count) bind(c, name='write')
      import :: c_char, c_int, c_size_t, c_long
      integer(c_int), value :: fd
      character(kind=c_char), intent(in) :: bytes(*)
      integer(c_size_t), value :: count
    end function c_write
    !> mkstemp(3): makes and opens a new file whose name ends with letters of its own choice, in place of XXXXXX.
    integer(c_int) function c_mkstemp(name) bind(c, name='mkstemp')
      import :: c_char, c_int
      ! allow(C072): a buffer of any length is filled
      character(kind=c_char), intent(inout) :: name(*)
    end function c_mkstemp
    !> readlink(2): where a symbolic link leads; negative for anything else.
    integer(c_long) function c_readlink(path, target, room) bind(c, name='readlink')
      import :: c_char, c_size_t, c_long
      character(kind=c_char), intent(in) :: path(*)
      ! allow(C072): a buffer of any length is filled
      character(kind=c_char), intent(out) :: target(*)
      integer(c_size_t), value :: room
    end function c_readlink
    !> getpid(2): number of this process.
    integer(c_int) function c_getpid() bind(c, name='getpid')
      import :: c_int
    end function c_getpid
    !> ftruncate(2): cuts an open file to a length.
    integer(c_int) function c_ftruncate(fd, length) bind(c, name='ftruncate')
      import :: c_int, c_long
      integer(c_int), value :: fd
      integer(c_long), value :: length
    end function c_ftruncate
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

  !> Opens and locks a file for this process alone; the lock ends with the process. Handle: > 0: locked; 0: another process
  !> holds it; -1: the file cannot be written. Between opening and locking, the former holder may remove the file and a third
  !> process may make another. So the file that is locked must still be the file of that name.
  integer function lock_file(path) result(handle)
    character(*), intent(in) :: path
    character(80) :: here, there
    integer(c_int) :: status, other
    integer :: trial
    do trial = 1, most_lock_trials
      call make_lock(path)
      handle = extend_file(path)
      if (handle < 0) then
        if (is_free(path)) cycle
        return
      end if
      if (c_flock(handle, lock_exclusive_now) /= 0) then
        status = c_close(handle)
        handle = 0
        return
      end if
      other = c_open(path//c_null_char, ior(read_only, at_once))
      here = first_line(handle)
      there = first_line(other)
      if (other >= 0) status = c_close(other)
      if (other >= 0 .and. here == there) then
        locked = path//c_null_char
        return
      end if
      status = c_close(handle)
    end do
    handle = -1
  end function lock_file

  !> Makes a lock's file where there is none, with a text that no other file has.
  subroutine make_lock(path)
    character(*), intent(in) :: path
    integer(ip) :: clock
    integer :: unit, status
    open (newunit=unit, file=path, status='new', action='write', iostat=status)   ! exclusive, not through a link
    if (status /= 0) return
    call system_clock(clock)
    ! allow(C181)
    write (unit, '(i0, 1x, i0)', iostat=status) c_getpid(), clock   ! on a full disk the lock holds without its text
    ! allow(C181)
    close (unit, iostat=status)
  end subroutine make_lock

  !> Up to 80 characters at the beginning of an open file; empty where there is none.
  function first_line(handle) result(text)
    integer, intent(in) :: handle
    character(80, c_char) :: text
    integer(c_long) :: bytes
    text = ''
    if (handle < 0) return
    if (c_lseek(handle, 0_c_long, 0) < 0) return
    bytes = c_read(handle, text, len(text, c_size_t))
    if (bytes < 1) text = ''
  end function first_line

  !> Ends a lock and removes its file.
  subroutine close_lock(handle)
    integer, intent(in) :: handle
    integer(c_int) :: status
    if (handle <= 0) return
    call drop_lock()
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

  !> Removes a result, or the link that has its name; a pipe or a folder belongs to somebody else and stays.
  subroutine remove_file(path)
    character(*), intent(in) :: path
    integer(c_int) :: status
    logical :: ours
    ours = is_link(path)
    if (.not. ours) ours = file_size(path) >= 0
    if (ours) status = c_unlink(path//c_null_char)
  end subroutine remove_file

  !> Removes what create_file has made or would replace, nothing else.
  subroutine remove_scratch(path)
    character(*), intent(in) :: path
    integer(c_int) :: status
    integer :: handle
    handle = extend_file(path)
    if (handle < 0) return
    status = c_unlink(path//c_null_char)
    status = c_close(handle)
  end subroutine remove_scratch

  !> Whether a path is a symbolic link.
  logical function is_link(path) result(yes)
    character(*), intent(in) :: path
    character(1, c_char) :: target
    yes = c_readlink(path//c_null_char, target, 1_c_size_t) >= 0
  end function is_link

  !> Whether nothing has that name.
  logical function is_free(path) result(yes)
    character(*), intent(in) :: path
    yes = .not. is_link(path)
    if (yes) yes = c_access(path//c_null_char, exists) /= 0
  end function is_free

  !> Makes an empty file and opens it for writing. An ordinary file of that name is replaced, not emptied: its other names keep
  !> what it holds. Negative where that fails, or where a link, pipe, device or folder has the name.
  !> The run-time library's own files do not report a full disk reliably: what it could not write is lost in silence.
  integer function create_file(path) result(handle)
    character(*), intent(in) :: path
    integer :: unit, status
    handle = -1
    call remove_scratch(path)
    open (newunit=unit, file=path, status='new', action='write', iostat=status)   ! exclusive, not through a link
    if (status /= 0) return
    ! allow(C181)
    close (unit, iostat=status)
    handle = extend_file(path)
  end function create_file

  !> Opens a temporary file without a name, which the system removes when it is closed; negative where that fails.
  integer function nameless_file() result(handle)
    character(:, c_char), allocatable :: name
    integer(c_int) :: status
    name = '/tmp/biela.XXXXXX'//c_null_char
    handle = c_mkstemp(name)
    if (handle >= 0) status = c_unlink(name)
  end function nameless_file

  !> All that was written to an open file, which is closed.
  function read_back(handle) result(text)
    integer, intent(in) :: handle
    character(:), allocatable :: text
    integer(c_long) :: bytes
    integer(c_int) :: status
    allocate (character(max(0_ip, size_of(handle))) :: text)
    bytes = c_read(handle, text, len(text, c_size_t))
    status = c_close(handle)
  end function read_back

  !> Opens an ordinary file that exists to write behind its end; negative where that fails, or where it is something else.
  integer function extend_file(path) result(handle)
    character(*), intent(in) :: path
    integer(c_long) :: bytes
    integer(c_int) :: status
    handle = -1
    if (is_link(path)) return
    handle = c_open(path//c_null_char, ior(read_write, at_once))
    if (handle < 0) return
    bytes = c_lseek(handle, 0_c_long, from_end)        ! a pipe has no position, a device no length
    if (bytes >= 0) then
      if (c_ftruncate(handle, bytes) == 0) return
    end if
    status = c_close(handle)
    handle = -1
  end function extend_file

  !> Bytes of a file; -1 where it cannot be read, or is a pipe or a folder.
  integer(ip) function file_size(path) result(bytes)
    character(*), intent(in) :: path
    integer(c_int) :: fd, status
    bytes = -1
    if (c_access(path//'/.'//c_null_char, exists) == 0) return
    fd = open_to_read(path, wait=.false.)
    if (fd < 0) return
    bytes = size_of(fd)
    status = c_close(fd)
  end function file_size

  !> Opens a file that exists for reading; negative where that fails.
  integer function open_to_read(path, wait) result(handle)
    character(*), intent(in) :: path
    logical, intent(in) :: wait               !! until a pipe is written to
    handle = c_open(path//c_null_char, ior(read_only, merge(0, at_once, wait)))
  end function open_to_read

  !> Bytes of an open file, which is then read from its beginning; -1 where it is a pipe.
  integer(ip) function size_of(handle) result(bytes)
    integer, intent(in) :: handle
    bytes = c_lseek(handle, 0_c_long, from_end)
    if (c_lseek(handle, 0_c_long, 0) < 0) bytes = -1
  end function size_of

  !> Reads the next bytes; how many there were, 0 at the end, negative where that fails.
  integer function read_bytes(handle, bytes) result(n)
    integer, intent(in) :: handle
    ! allow(C072): a buffer of any length is filled
    character(*), intent(out) :: bytes
    integer(c_int) :: code
    do
      n = int(c_read(handle, bytes, len(bytes, c_size_t)))
      if (n >= 0) return
      code = c_errno()
      if (code /= was_interrupted) return
    end do
  end function read_bytes

  !> Name of this machine; empty where the system does not tell.
  function host_name() result(name)
    character(:), allocatable :: name
    character(256, c_char) :: letters
    name = ''
    letters = repeat(c_null_char, len(letters))
    if (c_gethostname(letters, len(letters, c_size_t)) == 0) name = letters(:index(letters//c_null_char, c_null_char) - 1)
  end function host_name

  !> The current folder with a closing slash; empty where the system does not tell.
  function current_folder() result(path)
    character(:), allocatable :: path
    character(4096, c_char) :: letters
    path = ''
    letters = repeat(c_null_char, len(letters))
    if (c_associated(c_getcwd(letters, len(letters, c_size_t)))) path = letters(:index(letters//c_null_char, c_null_char) - 1)//'/'
  end function current_folder

  !> Why the last call of the system failed, in its words: `no such file or directory`.
  function reason() result(words)
    character(:), allocatable :: words
    character(kind=c_char), pointer :: letters(:)
    integer :: k
    call c_f_pointer(c_strerror(c_errno()), letters, [200])
    words = ''
    do k = 1, size(letters)
      if (letters(k) == c_null_char) exit
      words = words//letters(k)
    end do
    words(:1) = lower(words(:1))
  end function reason

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

  !> A line of text to standard error, without what could steer a terminal. The run-time library's own unit would end the program
  !> where standard error is closed.
  subroutine tell(line)
    character(*), intent(in) :: line
    logical :: written
    written = write_bytes(standard_error, one_line(line)//new_line('a'))
  end subroutine tell

  !> Closes a file; ok only where nothing written to it was lost.
  logical function close_file(handle) result(ok)
    integer, intent(in) :: handle
    ok = c_close(handle) == 0
  end function close_file

  !> Cuts an open file to a length in bytes; what is written then goes behind it.
  logical function cut_file(handle, length) result(ok)
    integer, intent(in) :: handle
    integer(ip), intent(in) :: length
    ok = c_ftruncate(handle, length) == 0
    if (ok) ok = c_lseek(handle, 0_c_long, from_end) >= 0
  end function cut_file

  !> Whether a file descriptor is a terminal (1: standard output, 2: standard error).
  logical function is_terminal(fd) result(yes)
    integer, intent(in) :: fd
    yes = c_isatty(fd) == 1
  end function is_terminal

  !> Waits until what was written to an open file is on the disk.
  logical function sync_file(handle) result(ok)
    integer, intent(in) :: handle
    ok = c_fsync(handle) == 0
  end function sync_file

  !> Waits until the names in a folder are on the disk.
  logical function sync_folder(path) result(ok)
    character(*), intent(in) :: path
    integer(c_int) :: fd, status
    fd = c_open(path//c_null_char, read_only)
    ok = fd >= 0
    if (.not. ok) return
    ok = c_fsync(fd) == 0
    status = c_close(fd)
  end function sync_folder
end module posix
