!> A progress line on a terminal: fraction, simulated time, estimated time left. Nothing in a pipe or when quiet.
module progress
  use kinds, only: wp, ip
  use posix, only: is_terminal, standard_error, write_bytes
  use text, only: es_text, fixed_text, to_text
  implicit none (type, external)
  private
  public :: progress_line

  !> State of the line.
  type :: progress_line
    logical :: shown = .false.
    character(:), allocatable :: what         !! runs, with a blank behind
    integer :: width = 60                     !! characters on the screen
    integer(ip) :: start = 0, last = 0, rate = 1   !! clock counts
  contains
    procedure :: begin
    procedure :: report
    procedure :: tell
    procedure :: finish
  end type progress_line

contains

  !> Starts the clock.
  subroutine begin(self, quiet, what)
    class(progress_line), intent(inout) :: self
    logical, intent(in) :: quiet
    character(*), intent(in) :: what          !! runs, with a blank behind; empty: a run alone
    self%shown = .not. quiet
    if (self%shown) self%shown = is_terminal(standard_error)
    self%what = what
    call system_clock(self%start, self%rate)
    self%last = self%start
  end subroutine begin

  !> Shows where the run is, at most five times a second.
  subroutine report(self, t, t_end)
    class(progress_line), intent(inout) :: self
    real(wp), intent(in) :: t, t_end          !! simulated time reached and wanted [s]
    integer(ip) :: now
    real(wp) :: seconds, left
    if (.not. self%shown) return
    call system_clock(now)
    seconds = real(now - self%start, wp)/real(self%rate, wp)
    left = seconds*(t_end - t)/max(t, tiny(1.0_wp))
    call self%tell(fixed_text(100*t/t_end, 1)//' %   t = '//es_text(t, 4)//' s   about '//to_text(nint(min(left, 9.9e6_wp)))// &
                   ' s left   ')
  end subroutine report

  !> Shows words about a run, at most five times a second.
  subroutine tell(self, words)
    class(progress_line), intent(inout) :: self
    character(*), intent(in) :: words
    integer(ip) :: now
    logical :: written
    if (.not. self%shown) return
    call system_clock(now)
    if (real(now - self%last, wp) < 0.2_wp*real(self%rate, wp)) return
    self%last = now
    self%width = max(self%width, len(self%what) + len(words))
    written = write_bytes(standard_error, char(13)//self%what//words)
  end subroutine tell

  !> Clears the line.
  subroutine finish(self)
    class(progress_line), intent(inout) :: self
    logical :: written
    if (self%shown .and. self%last > self%start) then
      written = write_bytes(standard_error, char(13)//repeat(' ', self%width)//char(13))
    end if
  end subroutine finish
end module progress
