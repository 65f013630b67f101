!> Several decks side by side, each in a process of its own. The messages of a deck are shown together when it has ended, then
!> one line: how it ended, how long it took, how many warnings it gave.
module side_by_side
  use kinds, only: wp, ip
  use command_line, only: print_ending
  use errors, only: status_failed, status_signal
  use posix, only: caught_signal, exit_at_once, hold_signals, nameless_file, read_back, standard_error, start_child, tell, &
    wait_for_child, write_bytes
  use run_deck, only: run_one_deck, run_options
  use text, only: either, fixed_text, to_text
  implicit none (type, external)
  private
  public :: run_side_by_side

  !> A deck that runs.
  type :: job
    integer :: deck = 0                       !! index of the deck, 0: none
    integer :: child = 0                      !! number of the process
    integer :: output = -1                    !! handle of the file with what it says
    integer(ip) :: started = 0                !! count of the clock
  end type job

contains

  !> Runs all decks, at most as many at a time as there are jobs; the status is the highest of theirs. After a signal no deck
  !> is begun any more, and those that run end as the signal ends a single run.
  subroutine run_side_by_side(decks, options, jobs, status)
    character(*), intent(in) :: decks(:)      !! their paths
    type(run_options), intent(in) :: options
    integer, intent(in) :: jobs               !! that run at a time
    integer, intent(inout) :: status          !! exit status
    type(job) :: running(jobs)
    integer :: next, k, child, ended
    call hold_signals(1)
    next = 1
    do
      do k = 1, jobs
        if (running(k)%deck > 0 .or. next > size(decks)) cycle
        if (caught_signal() > 0) cycle
        call begin(trim(decks(next)), options, running(k))
        running(k)%deck = next
        next = next + 1
        if (running(k)%child <= 0) call finish(status_failed, running(k))
      end do
      if (all(running%deck == 0)) then
        if (caught_signal() > 0) exit
        if (next > size(decks)) exit
        cycle
      end if
      child = wait_for_child(ended)
      k = findloc(running%child, child, 1)
      if (k > 0) call finish(ended, running(k))
    end do
    call hold_signals(0)
    if (caught_signal() > 0) status = max(status, status_signal + caught_signal())
  contains
    !> Shows what a deck said and how it ended.
    subroutine finish(ended, one)
      integer, intent(in) :: ended            !! exit status
      type(job), intent(inout) :: one
      character(:), allocatable :: said
      integer(ip) :: now, rate
      integer :: final
      logical :: ok
      said = ''
      if (one%output >= 0) said = read_back(one%output)
      ok = write_bytes(standard_error, said)
      call system_clock(now, rate)
      final = ended
      if (.not. options%quiet) call print_ending(trim(decks(one%deck)), final, ', '// &
        fixed_text(real(now - one%started, wp)/real(rate, wp), 2)//' s, '//warnings(said))
      status = max(status, final)
      one = job()
    end subroutine finish
  end subroutine run_side_by_side

  !> Starts a process that runs a deck and ends with its exit status.
  subroutine begin(deck, options, one)
    character(*), intent(in) :: deck          !! its path
    type(run_options), intent(in) :: options
    type(job), intent(inout) :: one
    type(run_options) :: silent
    call system_clock(one%started)
    one%child = -1
    one%output = nameless_file()
    if (one%output >= 0) one%child = start_child(one%output)
    if (one%child < 0) call tell(deck//': no process can be started for it')
    if (one%child /= 0) return
    silent = options
    silent%quiet = .true.
    call exit_at_once(run_one_deck(deck, silent))
  end subroutine begin

  !> How many warnings there are among lines, in words.
  function warnings(said) result(words)
    character(*), intent(in) :: said
    character(:), allocatable :: words
    integer :: n, from, at
    n = 0
    from = 1
    do
      at = index(said(from:), 'warning: ')
      if (at == 0) exit
      n = n + 1
      from = from + at
    end do
    words = to_text(n)//either(' warning', ' warnings', n == 1)
  end function warnings
end module side_by_side
