!> The process: its standard streams, signals, the end of memory, and children that run decks. However a run ends, it says why.
!> A lock that a killed process leaves behind no longer locks.
module process
  use errors, only: status_failed, status_signal
  use posix, only: c_close, c_getpid, c_open, drop_lock, standard_error, standard_output, tell
  use, intrinsic :: iso_c_binding, only: c_int, c_null_char, c_funptr, c_funloc, c_intptr_t, c_null_funptr
  implicit none (type, external)
  private
  public :: begin_process, end_process, hold_signals, caught_signal, start_child, wait_for_child, c_exit

  integer, parameter :: signal_interrupt = 2, signal_memory = 11, signal_alarm = 14, signal_terminate = 15, signal_file_size = 25, &
                        signal_pipe = 13
  integer, parameter :: read_only = 0, write_only = 1      !! O_RDONLY, O_WRONLY
  integer(c_int), volatile :: received = 0                 !! the last signal caught
  logical, volatile :: note_only = .false.                 !! signals are noted; else they end the program
  logical :: ended = .false.                               !! the program ends by its own decision
  integer(c_int) :: parent = 0                             !! of a child: the process that started it
  integer, parameter, public :: most_children = 1024       !! that run at a time
  integer(c_int), volatile :: children(most_children) = 0  !! which a signal is handed on to; 0: none

  interface
    !> dup(2): a second handle; -1 where the first is none.
    integer(c_int) function c_dup(fd) bind(c, name='dup')
      import :: c_int
      integer(c_int), value :: fd
    end function c_dup
    !> dup2(2): makes a handle mean another file.
    integer(c_int) function c_dup2(from, to) bind(c, name='dup2')
      import :: c_int
      integer(c_int), value :: from, to
    end function c_dup2
    !> kill(2): sends a signal.
    integer(c_int) function c_kill(child, number) bind(c, name='kill')
      import :: c_int
      integer(c_int), value :: child, number
    end function c_kill
    !> signal(2): sets a handler.
    type(c_funptr) function c_signal(number, handler) bind(c, name='signal')
      import :: c_int, c_funptr
      integer(c_int), value :: number
      type(c_funptr), value :: handler
    end function c_signal
    !> _exit(2): ends the process at once.
    subroutine c_exit(status) bind(c, name='_exit')
      import :: c_int
      integer(c_int), value :: status
    end subroutine c_exit
    !> fork(2): 0 in the new process, there its number; negative where none can be made.
    integer(c_int) function c_fork() bind(c, name='fork')
      import :: c_int
    end function c_fork
    !> waitpid(2): waits until a child has ended.
    integer(c_int) function c_waitpid(child, status, options) bind(c, name='waitpid')
      import :: c_int
      integer(c_int), value :: child, options
      integer(c_int), intent(out) :: status
    end function c_waitpid
    !> alarm(2): sends this process a signal in so many seconds.
    integer(c_int) function c_alarm(seconds) bind(c, name='alarm')
      import :: c_int
      integer(c_int), value :: seconds
    end function c_alarm
    !> getppid(2): number of the process that started this one, or of another one where that has ended.
    integer(c_int) function c_getppid() bind(c, name='getppid')
      import :: c_int
    end function c_getppid
    !> atexit(3): what is called when the program ends by exit(3), as the run-time library ends it.
    integer(c_int) function c_atexit(handler) bind(c, name='atexit')
      import :: c_int, c_funptr
      type(c_funptr), value :: handler
    end function c_atexit
  end interface

contains

  !> Prepares streams and handlers; called before anything else.
  subroutine begin_process()
    type(c_funptr) :: old
    integer(c_int) :: status
    call fill_standard_handles()
    status = c_atexit(c_funloc(say_why_ended))
    old = c_signal(signal_memory, c_funloc(memory_fault))
    old = c_signal(signal_interrupt, c_funloc(note_signal))
    old = c_signal(signal_terminate, c_funloc(note_signal))
    ! a write beyond a limit on file sizes, or to a pipe that nobody reads any more, then fails like one on a full disk, instead of
    ! ending the program (SIG_IGN is 1)
    old = c_signal(signal_file_size, transfer(1_c_intptr_t, c_null_funptr))
    old = c_signal(signal_pipe, transfer(1_c_intptr_t, c_null_funptr))
  end subroutine begin_process

  !> A standard stream that is closed would give its number to the next file opened, a result file perhaps. Instead nothing
  !> can be read from the input or written to the output, and messages are lost.
  subroutine fill_standard_handles()
    integer(c_int) :: fd, other
    do fd = 0, standard_error
      other = c_dup(fd)
      if (other >= 0) then
        other = c_close(other)
        cycle
      end if
      other = c_open('/dev/null'//c_null_char, merge(write_only, read_only, fd == standard_error))
    end do
  end subroutine fill_standard_handles

  !> The program ends by its own decision: no further message is written.
  subroutine end_process()
    ended = .true.
  end subroutine end_process

  !> Called when the program ends. The run-time library ends it where memory cannot be had, with a line for programmers.
  subroutine say_why_ended() bind(c)
    if (ended) return
    call drop_lock()
    call tell('biela: stopped, most likely because the deck needs more memory than the system gives; rows on disk are complete')
  end subroutine say_why_ended

  !> The handler of memory faults: compiled code does not ask everywhere whether it got the memory that it writes to.
  subroutine memory_fault(number) bind(c)
    integer(c_int), value :: number
    call say_why_ended()
    call c_exit(status_failed)
  end subroutine memory_fault

  !> While results are written signals are noted for `caught_signal`; at other times they end the program.
  subroutine hold_signals(yes)
    logical, intent(in) :: yes
    note_only = yes
  end subroutine hold_signals

  !> The handler of signals.
  subroutine note_signal(number) bind(c)
    integer(c_int), value :: number
    integer :: k
    integer(c_int) :: status
    received = number
    do k = 1, most_children
      if (children(k) > 0) status = c_kill(children(k), number)
    end do
    if (.not. note_only) call c_exit(status_signal + number)
  end subroutine note_signal

  !> The handler of a child's alarm, once a second: a child whose parent has been killed ends as by a signal.
  subroutine look_for_parent(number) bind(c)
    integer(c_int), value :: number
    integer(c_int) :: status
    if (c_getppid() == parent) status = c_alarm(1_c_int)
    if (c_getppid() /= parent) call note_signal(signal_terminate)
  end subroutine look_for_parent

  !> A second process that goes on from here, its output and messages in a file; 0 in that process, its number in this one,
  !> negative where the system gives none. Signals that this process catches are handed on to it.
  integer function start_child(handle) result(child)
    integer, intent(in) :: handle                          !! of the open file
    integer(c_int) :: status
    type(c_funptr) :: old
    integer :: starter
    starter = c_getpid()
    child = c_fork()
    if (child == 0) then
      children = 0
      note_only = .false.
      parent = starter
      old = c_signal(signal_alarm, c_funloc(look_for_parent))
      call look_for_parent(signal_alarm)
      status = c_dup2(handle, standard_output)
      status = c_dup2(handle, standard_error)
    else if (child > 0) then
      children(findloc(children, 0, 1)) = child
      if (received > 0) status = c_kill(child, received)   ! caught before the child stood in the list
    end if
  end function start_child

  !> Waits until any child has ended; its number, 0 where there is none, and its exit status (128 + signal that ended it).
  subroutine wait_for_child(child, status)
    integer, intent(out) :: child, status
    integer(c_int) :: ended, word
    ended = c_waitpid(-1, word, 0)
    child = max(0, ended)
    if (child == 0) return
    where (children == ended) children = 0
    status = iand(word/256, 255)
    if (iand(word, 127) /= 0) status = status_signal + iand(word, 127)
  end subroutine wait_for_child

  !> Number of the signal caught, 0: none.
  integer function caught_signal() result(number)
    number = received
  end function caught_signal
end module process
