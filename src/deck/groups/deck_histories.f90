!> Reader of &history.
module deck_histories
  use kinds, only: wp
  use readable_text, only: printable
  use whole_file, only: read_file
  use step_counts, only: rounding_of
  use text, only: to_text, quoted
  use text_checksum, only: digest
  use deck_input, only: deck_source
  use deck_numbers, only: decades
  use deck_paths, only: path_from
  use deck_records, only: history_record
  use deck_syntax, only: most, most_parts
  use deck_tables, only: read_columns
  use deck_take, only: take
  implicit none (type, external)
  private
  public :: read_history, read_lists, check_histories

contains

  !> &history
  subroutine read_history(deck, h)
    class(deck_source), intent(inout) :: deck
    type(history_record), intent(inout) :: h
    call take(deck, h)
    if (deck%is_choice('table')) then
      call read_lists(deck, 'time', 'value', h%file, h%columns, h%time, h%values)
      if (size(h%time) > 0 .and. deck%is_given('file')) call take_points('file', 'time (column '//to_text(h%columns(1))//')')
      if (size(h%time) > 0 .and. .not. deck%is_given('file')) call take_points('time', 'time')
    end if
    if (deck%is_choice('switch') .and. deck%is_set('histories') .and. size(h%parts) /= 2) call deck%complain('histories', &
      'a switch chooses one of '//to_text(size(h%parts))//' histories, expected two: from its level on, and below it')
    if (.not. deck%is_given('factors')) h%factors = spread(1.0_wp, 1, size(h%parts))
    call check_ends()
  contains
    !> Scales and shifts the points of a table. It needs two or more, in order of time.
    subroutine take_points(name, what)
      character(*), intent(in) :: name       !! variable that is to blame
      character(*), intent(in) :: what       !! the times, in words
      integer :: k
      h%time = h%time_scale*h%time + h%time_shift
      h%values = h%value_scale*h%values
      if (any(abs([h%time, h%values]) > 10.0_wp**decades)) call deck%complain(name, 'scaled times or values are '// &
        'beyond '//to_text(10.0_wp**decades)//', expected time_scale, time_shift and value_scale that keep them below')
      if (size(h%time) < 2) call deck%complain(name, what//' has 1 value, expected at least 2')
      do k = 2, size(h%time)
        if (h%time(k) > h%time(k - 1)) cycle
        call deck%complain(name, what//' is not ordered: value '//to_text(k)//', '//to_text(h%time(k))// &
          ', is not later than value '//to_text(k - 1)//', '//to_text(h%time(k - 1))//', expected increasing times')
        return
      end do
    end subroutine take_points

    !> Conditions at the ends of a table have to suit its interpolation, and a periodic table has to close.
    subroutine check_ends()
      integer :: n
      if (.not. deck%is_choice('table') .or. .not. deck%is_clean()) return
      n = size(h%values)
      if (deck%is_given('ends')) then
        if (h%periodic) then
          call deck%complain('ends', 'ends does not apply to periodic=.true., it applies to tables that end')
        else if (h%interpolation == 'linear') then
          call deck%complain('ends', 'ends does not apply to interpolation=''linear'', it applies to ''spline'' and ''pchip''')
        else if (h%interpolation == 'pchip' .and. h%ends /= 'rest') then
          call deck%complain('ends', 'ends='//quoted(trim(h%ends))//' does not apply to interpolation=''pchip'', expected '// &
            '''rest'' or no ends')
        end if
      end if
      if (n == 0 .or. .not. h%periodic) return
      if (abs(h%values(n) - h%values(1)) <= 1.0e-9_wp*maxval(abs(h%values))) return
      call deck%complain('periodic', 'the table begins with '//to_text(h%values(1))//' and ends with '//to_text(h%values(n))// &
        ', expected equal values for periodic=.true.')
    end subroutine check_ends
  end subroutine read_history

  !> Two lists of equal length, of the open group or from columns of its file, of which the deck keeps a line. Size 0: they could
  !> not be read.
  subroutine read_lists(deck, first, second, file, columns, x, y)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: first, second          !! the keys of the lists
    character(:), allocatable, intent(in) :: file
    integer, allocatable, intent(inout) :: columns(:)  !! 1, 2 if not given
    real(wp), allocatable, intent(inout) :: x(:), y(:) !! [as the file]
    character(:), allocatable :: path, content, problem
    if (deck%is_given(first) .or. deck%is_given(second)) then
      if (deck%is_given('file')) x = [real(wp) ::]     ! the rule of these keys has told that both are given
      return
    end if
    if (.not. deck%is_set('file')) return
    if (.not. deck%is_given('columns')) columns = [1, 2]
    if (size(columns) /= 2 .or. any(columns < 1)) then
      if (deck%is_set('columns')) call deck%complain('columns', 'columns are not two numbers of columns, expected '// &
        'columns=1,2 ('//first//', '//second//')')
      return
    end if
    path = path_from(deck%parts%sources(deck%home(deck%token(deck%assignment_of('file'), 1)))%path, file)
    call read_file(path, content, problem)
    if (len(file) == 0) then
      problem = ' is empty, expected the name of a table of numbers beside this deck'
    else if (len(problem) > 0) then
      problem = ' cannot be read: '//problem//', expected a table of numbers beside this deck'
    else
      call read_columns(content, columns, x, y, problem)
      deck%table_files = deck%table_files//path//achar(0)
      deck%tables = deck%tables//'! '//deck%group_word(deck%current)//' '//deck%prefix()//deck%peek('name')//': '// &
                    to_text(size(x))//' points of '//path//', digest '//to_text(digest(content))//achar(10)
      if (len(problem) > 0) problem = ' '//problem
    end if
    if (len(problem) == 0) return
    x = [real(wp) ::]
    call deck%complain('file', 'file='//quoted(printable(file, 80))//problem)
  end subroutine read_lists

  !> Reports sums, products, switches and sequences that contain themselves or too many others, and periods that are too short.
  subroutine check_histories(deck, list, t_end)
    class(deck_source), intent(inout) :: deck
    type(history_record), intent(in) :: list(:)
    real(wp), intent(in) :: t_end          !! end of the transient, 0: there is none [s]
    integer :: parts(size(list))           ! histories that each is made of, 0: not known yet
    integer :: i, k
    logical :: more
    if (deck%faults%count > 0) return
    parts = 0
    more = .true.
    do while (more)
      more = .false.
      do k = 1, size(list)
        if (parts(k) > 0 .or. any(parts(list(k)%parts) == 0)) cycle
        parts(k) = min(1 + sum(parts(list(k)%parts)), most_parts + 1)
        more = .true.
        if (parts(k) > most_parts) call list(k)%at%blame(deck%faults, 'is made of more than '//to_text(most_parts)// &
          ' others, expected fewer')
      end do
    end do
    do k = 1, size(list)
      if (parts(k) == 0) call list(k)%at%blame(deck%faults, 'contains itself or a history that does, expected '// &
        'histories that do not')
      if (list(k)%periodic) call check_period(list(k), max(t_end, maxval([(sum(list(i)%durations), i=1, size(list))])))
    end do
  contains
    !> Limits the number of breakpoints of a periodic history in a run, since a step ends at each of them: one for each point or
    !> part of a period. Parts may not be shorter than the rounding of time.
    subroutine check_period(h, until)
      type(history_record), intent(in) :: h
      real(wp), intent(in) :: until        !! longest time that it may be asked for [s]
      real(wp) :: begins, period, shortest   ! [s]
      integer :: n
      n = max(size(h%time), size(h%durations))
      if (size(h%time) > 0) then
        begins = h%time(1)
        period = h%time(n) - begins
        shortest = minval(h%time(2:) - h%time(:n - 1))
      else
        begins = h%start
        period = sum(h%durations)
        shortest = minval(h%durations)
      end if
      if (until*n > most*period) call h%at%blame(deck%faults, 'its period of '//to_text(period)//' s has more than '// &
        to_text(most)//' breakpoints in '//to_text(until)//' s, expected a longer period (or kind=''sine'')')
      if (shortest < 2*rounding_of(begins)) call h%at%blame(deck%faults, 'it begins at '//to_text(begins)// &
        ' s, where times are rounded to '//to_text(spacing(abs(begins)))//' s: too coarse for parts of '//to_text(shortest)// &
        ' s, expected a start nearer to t = 0')
    end subroutine check_period
  end subroutine check_histories
end module deck_histories
