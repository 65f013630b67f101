!> Signals in analyses that have no checkpoint: what was found so far is written, the summary says where the run stopped.
module interruption
  use errors, only: failure, status_signal
  use process, only: caught_signal
  use text, only: to_text
  implicit none (type, external)
  private
  public :: stop_if_signalled

contains

  !> Raises a failure where a signal has come.
  subroutine stop_if_signalled(analysis, fail)
    character(*), intent(in) :: analysis     !! which one
    type(failure), intent(inout) :: fail
    if (caught_signal() > 0) call fail%raise(status_signal + caught_signal(), 'stopped by signal '// &
      to_text(caught_signal())//' in the '//analysis//', whose results may be incomplete; run the deck again')
  end subroutine stop_if_signalled
end module interruption
