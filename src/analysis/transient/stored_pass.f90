!> Rows and events of a pass, with which the next one is compared (theory.md, section 12). There is one table: the next pass
!> puts its rows in place of those that it has been compared with. The columns are those of sensors, without any of all frames and
!> nodes.
module stored_pass
  use kinds, only: wp, ip
  use archive, only: value_archive
  use result_columns, only: motion_columns, result_column
  use scene_run, only: run_state
  use switching, only: event_list
  implicit none (type, external)
  private
  public :: compared_columns

  !> A pass.
  type, public :: pass_rows
    real(wp), allocatable :: values(:, :)     !! (columns, 0:outputs) [of the column]
    type(event_list) :: events                !! of that pass
    type(event_list) :: present               !! of the pass under way
    integer :: given = 0                      !! events of that pass up to the last row that was read
    logical :: filled = .false.               !! there is such a pass
  contains
    procedure :: recall
    procedure :: keep
    procedure :: turn
    procedure :: forget
    procedure :: exchange
  end type pass_rows

contains

  !> The columns.
  function compared_columns(run) result(columns)
    type(run_state), intent(in) :: run
    type(result_column), allocatable :: columns(:)
    columns = run%list%column
    if (run%list%columns == 0) columns = motion_columns(run%sys%m)
  end function compared_columns

  !> A row, and the events since the last one that was read.
  subroutine recall(self, row, time, values, events)
    class(pass_rows), intent(inout) :: self
    integer(ip), intent(in) :: row
    real(wp), intent(in) :: time              !! of the row [s]
    real(wp), intent(out) :: values(:)        !! (columns) [of the column]
    type(event_list), intent(inout) :: events !! receives them
    values = self%values(:, row)
    do while (self%given < self%events%count)
      if (self%events%items(self%given + 1)%t > time) exit
      self%given = self%given + 1
      call events%add(self%events%items(self%given))
    end do
  end subroutine recall

  !> A row of the pass under way, and its events since the last row.
  subroutine keep(self, row, values, events)
    class(pass_rows), intent(inout) :: self
    integer(ip), intent(in) :: row
    real(wp), intent(in) :: values(:)         !! (columns) [of the column]
    type(event_list), intent(in) :: events
    integer :: k
    self%values(:, row) = values
    do k = 1, events%count
      call self%present%add(events%items(k))
    end do
  end subroutine keep

  !> The pass under way has come to its end.
  subroutine turn(self)
    class(pass_rows), intent(inout) :: self
    self%events = self%present
    call self%forget()
    self%filled = .true.
  end subroutine turn

  !> The pass under way is over: its rows stand over those of the one before.
  subroutine forget(self)
    class(pass_rows), intent(inout) :: self
    self%present%count = 0
    self%given = 0
    self%filled = .false.
  end subroutine forget

  !> Saves or restores all of it.
  subroutine exchange(self, a)
    class(pass_rows), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    if (.not. allocated(self%values)) return
    call a%exchange(self%values)
    call self%events%exchange(a)
    call self%present%exchange(a)
    call a%exchange(self%given, self%filled)
  end subroutine exchange
end module stored_pass
