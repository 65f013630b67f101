!> Rows and events of a pass, and by how much those of the next one differ (theory.md, section 12). There is one table: the next
!> pass puts its rows in place of those that it has been compared with. The columns are those of sensors, without any of all frames
!> and nodes.
module stored_pass
  use kinds, only: wp, ip
  use archive, only: value_archive
  use result_columns, only: motion_columns, result_column
  use scene_run, only: run_state
  use switching, only: event_list, switch_event
  implicit none (type, external)
  private
  public :: compared_columns

  !> A pass, and what the next one has shown beside it so far.
  type, public :: pass_rows
    real(wp), allocatable :: values(:, :)     !! (columns, 0:outputs) [of the column]
    type(event_list), private :: events       !! of that pass
    type(event_list), private :: present      !! of the pass under way
    integer, private :: given = 0             !! events of that pass up to the last row
    logical :: filled = .false.               !! there is such a pass
    real(wp), allocatable :: error(:)         !! (columns) largest difference [of the column]
    real(wp), allocatable :: agreed(:)        !! (columns) the same before events differ [of the column]
    type(event_list), private :: waiting      !! events of the pass under way that the other one has not had yet
    type(event_list), private :: others       !! events of the other pass that the one under way has not had yet
    integer(ip) :: matched = 0                !! events of both
    real(wp) :: event_error = 0.0_wp          !! largest difference of their times [s]
    real(wp) :: differ_at = -1.0_wp           !! time from which the events of both differ, < 0: they do not [s]
  contains
    procedure :: begin
    procedure :: compare
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

  !> No pass yet.
  pure subroutine begin(self, columns, outputs)
    class(pass_rows), intent(inout) :: self
    integer, intent(in) :: columns
    integer(ip), intent(in) :: outputs        !! rows after that of t = 0
    allocate (self%values(columns, 0:outputs), self%error(columns), self%agreed(columns), source=0.0_wp)
  end subroutine begin

  !> A row of the pass under way, with its events since the last row: compared with that of the pass before, which it replaces. Also
  !> beyond events that differ: a finer pass may come closer. Rows between an event of one pass and that of the other are left out.
  subroutine compare(self, row, time, last, values, events)
    class(pass_rows), intent(inout) :: self
    integer(ip), intent(in) :: row
    real(wp), intent(in) :: time, last        !! of this row and of the last one [s]
    real(wp), intent(in) :: values(:)         !! (columns) [of the column]
    type(event_list), intent(in) :: events
    logical :: between
    integer :: k
    if (self%filled) then
      do while (self%given < self%events%count)
        if (self%events%items(self%given + 1)%t > time) exit
        self%given = self%given + 1
        call self%others%add(self%events%items(self%given))
      end do
      call match_events(self, events, merge(time, last, row == ubound(self%values, 2)), between)
      if (.not. between) self%error = max(self%error, abs(values - self%values(:, row)))
      if (self%differ_at < 0.0_wp) self%agreed = self%error
    end if
    self%values(:, row) = values
    do k = 1, events%count
      call self%present%add(events%items(k))
    end do
  end subroutine compare

  !> Compares the events of both passes up to a row, element by element: two elements may switch in either order within the errors
  !> of their times. What one pass has had and the other not a row later, or to the end, has no counterpart: from there on they are
  !> two motions.
  subroutine match_events(self, events, last, between)
    class(pass_rows), intent(inout) :: self
    type(event_list), intent(in) :: events    !! of the pass under way since the last row
    real(wp), intent(in) :: last              !! events before this time must have one [s]
    logical, intent(out) :: between           !! this row lies between an event of one pass and that of the other
    type(switch_event) :: a, b
    integer :: k, n
    between = .false.
    if (self%differ_at >= 0.0_wp) return
    do k = 1, events%count
      call self%waiting%add(events%items(k))
    end do
    associate (mine => self%waiting, other => self%others)
      k = 1
      do while (k <= mine%count .and. self%differ_at < 0.0_wp)
        a = mine%items(k)
        n = 0
        if (other%count > 0) n = findloc(other%items(1:other%count)%element, a%element, 1)
        if (n == 0) then
          k = k + 1
          cycle
        end if
        b = other%items(n)
        if (a%from == b%from .and. a%to == b%to) then
          self%matched = self%matched + 1
          self%event_error = max(self%event_error, abs(a%t - b%t))
        else
          self%differ_at = min(a%t, b%t)
        end if
        call mine%remove(k)
        call other%remove(n)
      end do
      if (self%differ_at >= 0.0_wp) return
      call look_for_old(mine)
      call look_for_old(other)
      between = self%differ_at < 0.0_wp .and. mine%count + other%count > 0
    end associate
  contains
    !> The first event of a list, if it has no counterpart.
    subroutine look_for_old(list)
      type(event_list), intent(in) :: list
      if (list%count == 0 .or. self%differ_at >= 0.0_wp) return
      if (list%items(1)%t < last) self%differ_at = list%items(1)%t
    end subroutine look_for_old
  end subroutine match_events

  !> The pass under way has come to its end; the next one is compared with it.
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
    self%waiting%count = 0
    self%others%count = 0
    self%given = 0
    self%filled = .false.
    self%error = 0.0_wp
    self%agreed = 0.0_wp
    self%matched = 0
    self%event_error = 0.0_wp
    self%differ_at = -1.0_wp
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
    call a%exchange(self%error, self%agreed)
    call self%waiting%exchange(a)
    call self%others%exchange(a)
    call a%exchange(self%matched, self%event_error, self%differ_at)
  end subroutine exchange
end module stored_pass
