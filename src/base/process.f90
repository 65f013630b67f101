!> Signals, the three standard streams, and what happens when memory or stack run out: however a run ends, it says why and
!> leaves no lock behind.
module process
  use errors, only: status_failed, status_signal
  use posix, only: c_open, drop_lock, standard_error, standard_output, tell
  use, intrinsic :: iso_c_binding, only: c_int, c_char, c_null_char, c_funptr, c_funloc, c_loc, c_intptr_t, c_null_funptr
  implicit none (type, external)
  private
  public :: begin_process, hold_signals, caught_signal, start_child, wait_for_child, leave

  integer, parameter :: signal_interrupt = 2, signal_memory = 11, signal_terminate = 15, signal_file_size = 25
  integer, parameter :: read_only = 0, write_only = 1      !! O_RDONLY, O_WRONLY
  integer(c_intptr_t), parameter :: on_own_stack = 134217728_c_intptr_t   !! SA_ONSTACK
  integer(c_int), volatile :: received = 0                 !! the last signal caught
  logical, volatile :: held = .false.                      !! signals are noted; else they end the program
  character(kind=c_char), target :: own_stack(65536)       !! of the handler of memory faults
  integer, parameter, public :: most_children = 1024       !! that run at a time
  integer(c_int), volatile :: children(most_children) = 0  !! which a signal is handed on to; 0: none

  interface
    !> signal(2): sets a handler.
    function c_signal(number, handler) bind(c, name='signal') result(old)
      import :: c_int, c_funptr
      integer(c_int), value :: number
      type(c_funptr), value :: handler
      type(c_funptr) :: old
    end function c_signal
    !> _exit(2): ends the process at once.
    subroutine c_exit(status) bind(c, name='_exit')
      import :: c_int
      integer(c_int), value :: status
    end subroutine c_exit
    !> fork(2): 0 in the new process, there its number; negative where none can be made.
    function c_fork() bind(c, name='fork') result(child)
      import :: c_int
      integer(c_int) :: child
    end function c_fork
    !> waitpid(2): waits until a child has ended.
    function c_waitpid(child, status, options) bind(c, name='waitpid') result(ended)
      import :: c_int
      integer(c_int), value :: child, options
      integer(c_int), intent(out) :: status
      integer(c_int) :: ended
    end function c_waitpid
    !> kill(2): sends a signal.
    function c_kill(child, number) bind(c, name='kill') result(status)
      import :: c_int
      integer(c_int), value :: child, number
      integer(c_int) :: status
    end function c_kill
    !> dup2(2): makes a handle mean another file.
    function c_dup2(from, to) bind(c, name='dup2') result(fd)
      import :: c_int
      integer(c_int), value :: from, to
      integer(c_int) :: fd
    end function c_dup2
    !> dup(2): a second handle; -1 where the first is none.
    function c_dup(fd) bind(c, name='dup') result(other)
      import :: c_int
      integer(c_int), value :: fd
      integer(c_int) :: other
    end function c_dup
    !> close(2).
    function c_close(fd) bind(c, name='close') result(status)
      import :: c_int
      integer(c_int), value :: fd
      integer(c_int) :: status
    end function c_close
    !> sigaltstack(2): where handlers run that ask for it.
    function c_sigaltstack(stack, old) bind(c, name='sigaltstack') result(status)
      import :: c_int, c_intptr_t
      integer(c_intptr_t), intent(in) :: stack(3)
      integer(c_intptr_t), intent(out), optional :: old(3)
      integer(c_int) :: status
    end function c_sigaltstack
    !> sigaction(2): sets a handler with its flags.
    function c_sigaction(number, action, old) bind(c, name='sigaction') result(status)
      import :: c_int, c_intptr_t
      integer(c_int), value :: number
      integer(c_intptr_t), intent(in) :: action(19)
      integer(c_intptr_t), intent(out), optional :: old(19)
      integer(c_int) :: status
    end function c_sigaction
  end interface

contains

  !> Prepares streams and handlers; called before anything else.
  subroutine begin_process()
    type(c_funptr) :: old
    call fill_standard_handles()
    call watch_memory()
    old = c_signal(int(signal_interrupt, c_int), c_funloc(note_signal))
    old = c_signal(int(signal_terminate, c_int), c_funloc(note_signal))
    ! a write beyond a limit on file sizes then fails like one on a full disk, instead of ending the program (SIG_IGN is 1)
    old = c_signal(int(signal_file_size, c_int), transfer(1_c_intptr_t, c_null_funptr))
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
      other = c_open('/dev/null'//c_null_char, int(merge(write_only, read_only, fd == standard_error), c_int))
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
    if (status == 0) status = c_sigaction(int(signal_memory, c_int), action)
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
    if (.not. held) call c_exit(int(status_signal + number, c_int))
  end subroutine note_signal

  !> A second process that goes on from here, its output and messages in a file; 0 in that process, its number in this one,
  !> negative where the system gives none. Signals that this process catches are handed on to it.
  integer function start_child(handle) result(child)
    integer, intent(in) :: handle                          !! of the open file
    integer(c_int) :: status
    integer :: k
    child = int(c_fork())
    if (child == 0) then
      children = 0
      held = .false.
      status = c_dup2(int(handle, c_int), int(standard_output, c_int))
      status = c_dup2(int(handle, c_int), int(standard_error, c_int))
    else if (child > 0) then
      do k = 1, most_children
        if (children(k) == 0) exit
      end do
      children(k) = int(child, c_int)
      if (received > 0) status = c_kill(int(child, c_int), received)   ! caught before the child stood in the list
    end if
  end function start_child

  !> Waits until any child has ended; its number, 0 where there is none, and its exit status (128 + signal that ended it).
  subroutine wait_for_child(child, status)
    integer, intent(out) :: child, status
    integer(c_int) :: ended, word
    ended = c_waitpid(-1_c_int, word, 0_c_int)
    child = max(0, int(ended))
    if (child == 0) return
    where (children == ended) children = 0
    status = iand(int(word)/256, 255)
    if (iand(int(word), 127) /= 0) status = status_signal + iand(int(word), 127)
  end subroutine wait_for_child

  !> Ends this process at once with an exit status.
  subroutine leave(status)
    integer, intent(in) :: status
    call c_exit(int(status, c_int))
  end subroutine leave

  !> Number of the signal caught, 0: none.
  function caught_signal() result(number)
    integer :: number
    number = int(received)
  end function caught_signal

  !> Removes the lock, writes one line to standard error and ends the process.
  subroutine end_now(words, status)
    character(*), intent(in) :: words
    integer, intent(in) :: status                          !! exit status
    call drop_lock()
    call tell('biela: '//words)
    call c_exit(int(status, c_int))
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
