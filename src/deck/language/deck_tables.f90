!> Tables of numbers in files as they come from spreadsheets, measurements and biela itself:
!> - semicolons, tabs, commas or blanks separate columns
!> - numbers may stand in quotes, and have decimal commas; beside commas that separate, one of thousands is refused
!> - empty lines, comments after #, ! or %, and headings, which have no number in a column that is read, are passed over.
module deck_tables
  use kinds, only: wp
  use readable_text, only: lf, printable, tab
  use text, only: digits, to_text
  use deck_numbers, only: read_real
  implicit none (type, external)
  private
  public :: read_columns

contains

  !> Two columns of a table. `problem` is empty if they could be read.
  subroutine read_columns(content, columns, x, y, problem)
    character(*), intent(in) :: content                    !! text of the file, lines end with a line feed
    integer, intent(in) :: columns(2)                      !! which columns
    real(wp), allocatable, intent(out) :: x(:), y(:)       !! their numbers [as the file]
    character(:), allocatable, intent(out) :: problem      !! what is wrong, what was expected
    real(wp), allocatable :: found(:, :)
    real(wp) :: row(2)
    character(1) :: separator
    integer :: first, last, line, n, pass
    logical :: any_number, settled
    n = 0
    do last = 1, len(content)
      if (content(last:last) == lf) n = n + 1
    end do
    allocate (found(2, n))
    settled = .false.                                      ! the first whole row tells how all lines are separated, headings too
    do pass = 1, 2
      problem = ''
      n = 0
      line = 0
      first = 1
      do while (first <= len(content) .and. len(problem) == 0)
        last = first + index(content(first:), lf) - 2
        line = line + 1
        if (.not. is_comment(content(first:last))) then
          if (.not. settled) separator = separator_of(content(first:last))
          call read_row(content(first:last), separator, columns, row, any_number, problem)
          if (len(problem) == 0) then
            n = n + 1
            found(:, n) = row
            settled = .true.
            if (pass == 1) exit
          else if (pass == 1 .or. (n == 0 .and. .not. any_number)) then
            problem = ''                                   ! a heading
          else
            problem = 'line '//to_text(line)//' '//problem
          end if
        end if
        first = last + 2
      end do
    end do
    x = found(1, :n)
    y = found(2, :n)
    if (n == 0 .and. len(problem) == 0) problem = 'has no row with numbers in columns '//to_text(columns(1))//' and '// &
      to_text(columns(2))//', expected rows of numbers'
  end subroutine read_columns

  !> Whether a line holds nothing but blanks or a comment.
  pure logical function is_comment(line) result(yes)
    character(*), intent(in) :: line
    integer :: first
    first = verify(line, ' '//tab)
    yes = first == 0
    if (.not. yes) yes = scan(line(first:first), '#!%') == 1
  end function is_comment

  !> What separates the columns of a line: a semicolon or a tab if it has one, else a comma, else blanks; also blanks where
  !> every comma stands between two digits and blanks stand between words, as in `0,5  1,25`.
  pure character(1) function separator_of(line) result(separator)
    character(*), intent(in) :: line
    character(:), allocatable :: core
    integer :: i
    core = trim(adjustl(line))
    separator = ' '
    if (scan(core, ';') > 0) then
      separator = ';'
    else if (scan(core, tab) > 0) then
      separator = tab
    else if (scan(core, ',') > 0) then
      if (scan(core, ' ') == 0 .or. scan(core, '"''') > 0) separator = ','
      do i = 1, len(core)
        if (core(i:i) /= ',') cycle
        if (scan(core(max(i - 1, 1):min(i + 1, len(core))), ' ') > 0) separator = ','
      end do
    end if
  end function separator_of

  !> The numbers in two columns of a line.
  subroutine read_row(line, separator, columns, row, any_number, problem)
    character(*), intent(in) :: line
    character(1), intent(in) :: separator
    integer, intent(in) :: columns(2)
    real(wp), intent(out) :: row(2)                        !! [as the file]
    logical, intent(out) :: any_number                     !! one of them has a number
    character(:), allocatable, intent(out) :: problem      !! with the first that has none
    character(:), allocatable :: word, fault
    integer :: k
    row = 0.0_wp
    any_number = .false.
    problem = ''
    do k = 1, 2
      word = field(line, separator, columns(k))
      if (len(word) == 0) then
        fault = 'has nothing in column '//to_text(columns(k))//', expected a number'
      else
        call read_real(word, row(k), fault)
        any_number = any_number .or. len(fault) == 0
        if (may_be_thousands(word)) fault = 'may have a comma of thousands or of decimals, expected a decimal point'
        if (len(fault) > 0) fault = 'has '''//printable(word, 40)//''' in column '//to_text(columns(k))//', which '//fault
      end if
      if (len(problem) == 0) problem = fault
    end do
  end subroutine read_row

  !> One column of a line without quotes and blanks, its decimal comma made a point; empty where there is none. Blanks are
  !> counted as one separator.
  pure function field(line, separator, column) result(word)
    character(*), intent(in) :: line
    character(1), intent(in) :: separator
    integer, intent(in) :: column
    character(:), allocatable :: word
    character(1) :: quote
    integer :: i, at, comma
    word = ''
    quote = ' '
    at = 1
    do i = 1, len(line)
      if (quote /= ' ' .and. line(i:i) == quote) then
        quote = ' '
      else if (quote == ' ' .and. scan(line(i:i), '"''') == 1) then
        quote = line(i:i)
      else if (quote == ' ' .and. line(i:i) == separator) then
        if (separator == ' ') then
          if (len_trim(line(:i)) == 0) cycle
          if (i < len(line)) then
            if (line(i + 1:i + 1) == ' ') cycle
          end if
        end if
        at = at + 1
        if (at > column) exit
      else if (at == column) then
        word = word//line(i:i)
      end if
    end do
    word = trim(adjustl(word))
    comma = index(word, ',')
    if (separator == ',' .and. may_be_thousands(word)) return
    if (comma > 0) word(comma:comma) = '.'
  end function field

  !> Whether a comma in a number may part thousands, as in 1,250: one to three digits, the first not 0, and three behind it.
  pure logical function may_be_thousands(word) result(yes)
    character(*), intent(in) :: word
    integer :: first, comma
    first = 1 + scan(word(:min(1, len(word))), '+-')
    comma = index(word, ',')
    yes = comma > first .and. comma <= first + 3 .and. len(word) == comma + 3
    if (yes) yes = verify(word(first:comma - 1)//word(comma + 1:), digits) == 0 .and. word(first:first) /= '0'
  end function may_be_thousands
end module deck_tables
