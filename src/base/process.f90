!> Signals, the three standard streams, and what happens when memory or stack run out: however a run ends, it says why and
!> leaves no lock behind.
module process
  use errors, only: status_failed, status_signal
  use posix, only: c_close, c_open, drop_lock, standard_error, standard_output, tell
  use, intrinsic :: iso_c_binding, only: c_int, c_char, c_null_char, c_funptr, c_funloc, c_loc, c_intptr_t, c_null_funptr
  implicit none (type, external)
  private
  public :: begin_process, hold_signals, caught_signal, start_child, wait_for_child, c_exit

  integer, parameter :: signal_interrupt = 2, signal_memory = 11, signal_terminate = 15, signal_file_size = 25
  integer, parameter :: read_only = 0, write_only = 1      !! O_RDONLY, O_WRONLY
  integer(c_intptr_t), parameter :: on_own_stack = 134217728_c_intptr_t   !! SA_ONSTACK
  integer(c_int), volatile :: received = 0                 !! the last signal caught
  logical, volatile :: held = .false.                      !! signals are noted; else they end the program
  character(kind=c_char), target :: own_stack(65536)       !! of the handler of memory faults
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
    !> sigaltstack(2): where handlers run that ask for it.
    integer(c_int) function c_sigaltstack(stack, old) bind(c, name='sigaltstack')
      import :: c_int, c_intptr_t
      integer(c_intptr_t), intent(in) :: stack(3)
      integer(c_intptr_t), intent(out), optional :: old(3)
    end function c_sigaltstack
    !> sigaction(2): sets a handler with its flags.
    integer(c_int) function c_sigaction(number, action, old) bind(c, name='sigaction')
      import :: c_int, c_intptr_t
      integer(c_int), value :: number
      integer(c_intptr_t), intent(in) :: action(19)
      integer(c_intptr_t), intent(out), optional :: old(19)
    end function c_sigaction
  end interface

contains

  !> Prepares streams and handlers; called before anything else.
  subroutine begin_process()
    type(c_funptr) :: old
    call fill_standard_handles()
    call watch_memory()
    old = c_signal(signal_interrupt, c_funloc(note_signal))
    old = c_signal(signal_terminate, c_funloc(note_signal))
    ! a write beyond a limit on file sizes then fails like one on a full disk, instead of ending the program (SIG_IGN is 1)
    old = c_signal(signal_file_size, transfer(1_c_intptr_t, c_null_funptr))
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

  !> Gives the handler of memory faults a stack of its own, since it may be called because the ordinary one is full.
  subroutine watch_memory()
    integer(c_intptr_t) :: stack(3), action(19)            ! stack_t: address, flags, bytes; sigaction: handler first
    type(c_funptr) :: handler
    integer(c_int) :: status
    handler = c_funloc(memory_fault)
    action = 0
    action(1) = transfer(handler, action(1))
    action(18) = on_own_stack                              ! behind the handler and 128 bytes of a signal mask
    stack = [transfer(c_loc(own_stack), stack(1)), 0_c_intptr_t, int(size(own_stack), c_intptr_t)]
    status = c_sigaltstack(stack)
    if (status == 0) status = c_sigaction(signal_memory, action)
  end subroutine watch_memory

  !> The handler of memory faults.
  subroutine memory_fault() bind(c)
    call end_now('the stack or the memory has ended (ulimit -s, ulimit -v), or the program has a fault', status_failed)
  end subroutine memory_fault

  !> While results are written signals are noted for `caught_signal`; at other times they end the program.
  subroutine hold_signals(yes)
    logical, intent(in) :: yes
    held = yes
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
    if (.not. held) call c_exit(status_signal + number)
  end subroutine note_signal

  !> A second process that goes on from here, its output and messages in a file; 0 in that process, its number in this one,
  !> negative where the system gives none. Signals that this process catches are handed on to it.
  integer function start_child(handle) result(child)
    integer, intent(in) :: handle                          !! of the open file
    integer(c_int) :: status
    integer :: k
    child = c_fork()
    if (child == 0) then
      children = 0
      held = .false.
      status = c_dup2(handle, standard_output)
      status = c_dup2(handle, standard_error)
    else if (child > 0) then
      do k = 1, most_children
        if (children(k) == 0) exit
      end do
      children(k) = child
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

  !> Removes the lock, writes one line to standard error and ends the process.
  subroutine end_now(words, status)
    character(*), intent(in) :: words
    integer, intent(in) :: status                          !! exit status
    call drop_lock()
    call tell('biela: '//words)
    call c_exit(status)
  end subroutine end_now

  !> In place of the run-time library's procedure of this name, which compiled code calls where memory cannot be had; its
  !> arguments, a source line and words for programmers, are left alone.
  subroutine allocation_failed() bind(c, name='_gfortran_os_error_at')
    call end_now('memory has ended: the deck needs more than the system gives; rows on disk are complete', status_failed)
  end subroutine allocation_failed

  !> The same for temporary variables.
  subroutine temporary_failed() bind(c, name='_gfortran_os_error')
    call allocation_failed()
  end subroutine temporary_failed
end module process
