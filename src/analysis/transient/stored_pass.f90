!> Rows and events of a pass, and by how much those of the next one differ (theory.md, section 12). The columns are those of
!> sensors, without any of all frames and nodes.
module stored_pass
  use kinds, only: wp, ip
  use archive, only: value_archive
  use column_ranges, only: column_range
  use energy_balance, only: distrusted
  use result_columns, only: motion_columns, result_column
  use scene_run, only: run_state
  use step_counts, only: step_count
  use switching, only: event_list, switch_event
  implicit none (type, external)
  private
  public :: compared_columns

  real(wp), parameter, public :: least_range = 1.0e-3_wp   !! that counts, of the largest one of its kind [-]
  real(wp), parameter :: half_digits = sqrt(epsilon(1.0_wp))   ! what singular positions leave of a value [-]

  !> The last pass that was finished, and that under way.
  type, public :: pass_rows
    real(wp), allocatable :: before(:, :), values(:, :)   !! (columns, 0:outputs) [of the column]
    type(event_list) :: events_before, events
    real(wp), private :: output_step = 0.0_wp, t_end = 0.0_wp   !! [s]
    logical :: filled = .false.               !! there is a pass before
  contains
    procedure :: begin
    procedure :: note
    procedure :: difference
    procedure :: turn
    procedure :: exchange
  end type pass_rows

  !> What two passes show beside each other.
  type, public :: pass_difference
    real(wp), allocatable :: error(:)         !! (columns) largest difference [of the column]
    real(wp), allocatable :: range(:)         !! (columns) by how much they move; 0: rounding, noise [of the column]
    real(wp), allocatable :: asked(:)         !! (columns) errors that the accuracy allows; huge: any [of the column]
    logical, allocatable :: absolute(:)       !! (columns) these are not set by the range alone
    logical, allocatable :: unseen(:)         !! (columns) whether they move is not known: the error may be all of the range
    integer :: matched = 0                    !! events of both
    real(wp) :: event_error = 0.0_wp          !! largest difference of their times [s]
    real(wp) :: differ_at = -1.0_wp           !! time from which the events of both differ, < 0: they do not [s]
  end type pass_difference

contains

  !> The columns.
  function compared_columns(run) result(columns)
    type(run_state), intent(in) :: run
    type(result_column), allocatable :: columns(:)
    columns = run%list%column
    if (run%list%columns == 0) columns = motion_columns(run%sys%m)
  end function compared_columns

  !> No pass yet.
  subroutine begin(self, run)
    class(pass_rows), intent(inout) :: self
    type(run_state), intent(in) :: run
    self%output_step = run%d%transient%output_step
    self%t_end = run%d%transient%t_end
    allocate (self%values(size(compared_columns(run)), 0:step_count(0.0_wp, self%t_end, self%output_step)), source=0.0_wp)
    allocate (self%events%items(0), self%events_before%items(0))
  end subroutine begin

  !> A row of the pass under way, with its events since the last row; the last one of many rebounds may be dated behind the end.
  subroutine note(self, row, values, events)
    class(pass_rows), intent(inout) :: self
    integer(ip), intent(in) :: row
    real(wp), intent(in) :: values(:)         !! (columns) [of the column]
    type(event_list), intent(in) :: events
    integer :: k
    self%values(:, row) = values
    do k = 1, events%count
      if (events%items(k)%t < self%t_end) call self%events%add(events%items(k))
    end do
  end subroutine note

  !> The pass under way has come to its end; the next one is compared with it, if it was not lost.
  subroutine turn(self, lost)
    class(pass_rows), intent(inout) :: self
    logical, intent(in) :: lost
    self%filled = .not. lost
    self%before = self%values
    self%events_before = self%events
    self%events%count = 0
  end subroutine turn

  !> What the pass under way, at its end, shows beside the one before. Rows between an event of one pass and that of the other are
  !> left out.
  function difference(self, run, share) result(x)
    class(pass_rows), intent(in) :: self
    type(run_state), intent(in) :: run
    real(wp), intent(in) :: share             !! of a motion that counts as a scale (`rounded_share`) [-]
    type(pass_difference) :: x
    type(column_range) :: seen
    logical :: between(0:ubound(self%values, 2))
    integer :: k
    call match_events(self, x, between)
    allocate (x%error(size(self%values, 1)), source=0.0_wp)
    do k = 0, ubound(between, 1)
      if (.not. between(k)) x%error = max(x%error, abs(self%values(:, k) - self%before(:, k)))
    end do
    seen = column_range(minval(self%values, 2), maxval(self%values, 2))
    x%range = seen%moved(run%sys%m%s, compared_columns(run), run%d%transient%t_end, share)
    call find_asked(run, max(abs(seen%low), abs(seen%high)), x)
    if (allocated(run%model_error)) where (x%asked < huge(1.0_wp)) x%error = x%error + run%model_error
  end function difference

  !> Compares events element by element: two elements may switch in either order within the errors of their times. What one pass has
  !> and the other not, or more than a row later, has no counterpart: from there on they are two motions.
  subroutine match_events(self, x, between)
    class(pass_rows), intent(in) :: self
    type(pass_difference), intent(inout) :: x
    logical, intent(out) :: between(0:)       !! (rows) events of both passes
    type(switch_event), allocatable :: a(:), b(:)
    real(wp), allocatable :: first(:), last(:)   ! (pairs) earlier and later time [s]
    integer :: k, n
    between = .false.
    first = [real(wp) ::]
    last = first
    associate (mine => self%events%items(:self%events%count), other => self%events_before%items(:self%events_before%count))
      do k = 1, maxval([mine%element, other%element])
        a = pack(mine, mine%element == k)
        b = pack(other, other%element == k)
        n = min(size(a), size(b))
        n = findloc([a(:n)%from == b(:n)%from .and. a(:n)%to == b(:n)%to .and. &
                     abs(row_before(a(:n)%t) - row_before(b(:n)%t)) <= 1, .false.], .false., 1) - 1
        first = [first, min(a(:n)%t, b(:n)%t)]
        last = [last, max(a(:n)%t, b(:n)%t)]
        if (n == max(size(a), size(b))) cycle
        associate (at => minval([a(n + 1:)%t, b(n + 1:)%t]))
          x%differ_at = merge(at, min(at, x%differ_at), x%differ_at < 0.0_wp)
        end associate
      end do
    end associate
    do k = 1, size(first)
      if (x%differ_at >= 0.0_wp .and. first(k) >= x%differ_at) cycle
      x%matched = x%matched + 1
      x%event_error = max(x%event_error, last(k) - first(k))
      between(row_before(first(k)) + 1:row_before(last(k))) = .true.
    end do
  contains
    !> Number of the last row before a time.
    elemental integer(ip) function row_before(t) result(row)
      real(wp), intent(in) :: t               !! [s]
      row = int(t/self%output_step, ip)
    end function row_before
  end subroutine match_events

  !> The error that each column may have: the accuracy of its sensor times its range, or the sensor's floor; any where a column is
  !> constant but for rounding, or counts states or elements. Without an accuracy it is that of results that can be trusted. A range
  !> counts at least a thousandth of the largest one of the same quantity and unit: a column that hardly moves beside them shall not
  !> set the cost. A range errs by up to twice the error of its values: below that it may be noise, which is no measure. Values of
  !> that quantity are one: a column whose error is small beside them is constant, as far as two passes can tell.
  subroutine find_asked(run, value, x)
    type(run_state), intent(in) :: run
    real(wp), intent(in) :: value(:)          !! (columns) largest one [of the column]
    type(pass_difference), intent(inout) :: x
    type(result_column), allocatable :: columns(:)
    real(wp) :: range(size(value))            ! (columns) [of the column]
    real(wp) :: accuracy, floor, counted, scale, level   ! [-], [of the column]
    integer :: k, n
    columns = compared_columns(run)
    range = x%range
    x%asked = spread(huge(1.0_wp), 1, size(columns))
    x%absolute = spread(.false., 1, size(columns))
    x%unseen = x%absolute
    do k = 1, size(columns)
      if (.not. range(k) > 0.0_wp .or. columns(k)%unit == '-') cycle
      accuracy = merge(run%d%transient%accuracy, distrusted, run%d%transient%accuracy > 0.0_wp)
      floor = 0.0_wp
      n = count(run%list%first <= k)
      if (n > 0) floor = run%d%sensors(n)%floor
      if (n > 0) accuracy = merge(run%d%sensors(n)%accuracy, accuracy, run%d%sensors(n)%accuracy > 0.0_wp)
      associate (kind => columns%quantity == columns(k)%quantity .and. columns%unit == columns(k)%unit)
        counted = max(range(k), least_range*maxval(range, kind))
        scale = maxval(value, kind)
      end associate
      level = max(half_digits, least_range*accuracy)*scale
      x%asked(k) = max(accuracy*counted, floor)
      x%unseen(k) = x%error(k) > x%asked(k) .and. x%error(k) <= distrusted*scale .and. &
                    range(k) <= max(2*x%error(k), half_digits*scale)
      if (x%unseen(k) .and. x%error(k) <= level) then
        x%asked(k) = level
        x%range(k) = 0.0_wp
        x%unseen(k) = .false.
      end if
      x%absolute(k) = x%asked(k) > accuracy*range(k)
    end do
  end subroutine find_asked

  !> Saves or restores all of it.
  subroutine exchange(self, a)
    class(pass_rows), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    if (.not. allocated(self%values)) return
    call a%exchange(self%values)
    call a%exchange(self%filled)
    call self%events%exchange(a)
    call self%events_before%exchange(a)
    if (.not. self%filled) return
    if (.not. a%saving) self%before = self%values
    call a%exchange(self%before)
  end subroutine exchange
end module stored_pass
