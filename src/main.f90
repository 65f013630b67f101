!> biela: planar flexible mechanisms with viscoelastic damping. Reads the command line, runs each deck, ends with the
!> highest exit status. The only place that stops the program.
program biela
  use command_line, only: parse_arguments, print_ending, command
  use errors, only: status_ok, status_signal
  use lapack, only: use_one_blas_thread
  use posix, only: begin_process, caught_signal, end_process
  use run_deck, only: run_one_deck
  use side_by_side, only: run_side_by_side
  implicit none (type, external)
  type(command) :: asked
  integer :: k, status, ended
  call begin_process()
  call parse_arguments(asked, status)
  if (status == status_ok .and. allocated(asked%decks)) then
    call use_one_blas_thread()
    if (asked%jobs > 1) call run_side_by_side(asked%decks, asked%options, min(asked%jobs, size(asked%decks)), status)
    do k = 1, merge(0, size(asked%decks), asked%jobs > 1)
      ended = run_one_deck(trim(asked%decks(k)), asked%options)
      if (size(asked%decks) > 1 .and. .not. asked%options%quiet) call print_ending(trim(asked%decks(k)), ended, '')
      status = max(status, ended)
      if (caught_signal() > 0 .and. k < size(asked%decks)) status = status_signal + caught_signal()
      if (status > status_signal) exit
    end do
  end if
  call end_process()
  if (status /= status_ok) stop status, quiet=.true.
end program biela
