!> The files of a deck: reads them, splits them into groups, follows &include, and keeps the groups in reading order.
module deck_files
  use whole_file, only: read_file
  use readable_text, only: printable
  use text, only: nearest_word, quoted, to_text
  use deck_input, only: deck_source
  use deck_get, only: get
  use deck_keys, only: group_names, in_include
  use deck_lexer, only: split_groups
  use deck_overrides, only: add_override, note_scopes, override_file
  use expression, only: is_name
  use deck_paths, only: path_from
  use deck_syntax, only: most_parts, string_value, value_token
  implicit none (type, external)
  private
  public :: read_source

contains

  !> Reads a file and the files that it includes, and appends their groups. Groups of an included file stand where its &include is.
  recursive subroutine read_source(deck, path, parent, prefix, list, problem)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: path                       !! file, relative to the current folder
    integer, intent(in) :: parent                          !! number of the file that includes it, 0: none
    character(*), intent(in) :: prefix                     !! of the names that it defines
    integer, allocatable, intent(inout) :: list(:)         !! receives the groups other than &include, in reading order
    character(:), allocatable, intent(out) :: problem      !! why it cannot be read, empty if it can
    character(:), allocatable :: content
    integer :: file, next, last, faults, values, assignments, setting, j, k
    logical :: changed
    call read_file(path, content, problem, handed=parent == 0)
    if (len(problem) > 0) return
    call deck%parts%add_source(path, content, parent, prefix)
    file = deck%parts%source_count
    next = deck%parts%group_count + 1
    faults = deck%faults%count
    values = deck%parts%value_count
    assignments = deck%parts%assignment_count
    setting = size(deck%parts%overrides)
    do
      call split_groups(deck, file)
      call override_file(deck, file, next, setting, changed)
      if (.not. changed) exit
      deck%faults%count = faults
      deck%parts%value_count = values
      deck%parts%assignment_count = assignments
      deck%parts%group_count = next - 1
    end do
    call note_scopes(deck, next)
    last = deck%parts%group_count
    deck%parts%sources(file)%first_group = next
    deck%parts%sources(file)%last_group = last
    if (parent > 0 .and. deck%faults%count > faults) then
      if (.not. any([(nearest_word(deck%group_word(k), group_names) > 0, k=next, last)])) then
        problem = 'it holds no group of a deck'             ! a file of another kind; nothing of it is shown
        deck%faults%count = faults
        deck%parts%group_count = next - 1
        return
      end if
    end if
    do k = next, last
      if (deck%parts%groups(k)%kind /= in_include) cycle
      list = [list, (j, j=next, k - 1)]
      next = k + 1
      call follow(deck, k, file, list)
    end do
    list = [list, (j, j=next, last)]
  end subroutine read_source

  !> Reads the file that an &include names.
  recursive subroutine follow(deck, number, file, list)
    class(deck_source), intent(inout) :: deck
    integer, intent(in) :: number                 !! the group
    integer, intent(in) :: file                   !! number of its file
    integer, allocatable, intent(inout) :: list(:)
    character(:), allocatable :: name, path, prefix, problem
    type(value_token) :: token
    integer :: settings, k
    allocate (character(0) :: name)
    allocate (character(0) :: prefix)
    if (deck%parts%groups(number)%readable) then
      call deck%open(number)
      call get(deck, deck%row_of('file'), name)
      if (deck%is_set('file') .and. len(name) == 0) call deck%complain('file', 'file='''' is empty, expected the '// &
        'name of a deck file')
      call get(deck, deck%row_of('prefix'), prefix)
      call deck%look_up(deck%row_of('set'), settings)
      do k = 1, merge(deck%tokens(max(settings, 1)), 0, settings > 0)
        token = deck%token(settings, k)
        if (token%form == string_value) then
          call add_override(deck, deck%word(token), deck%parts%sources(file)%prefix//prefix, number, token%line)
        else
          call deck%add_fault(token%line, 'set='//deck%written(token)//' is no text in quotes, expected set=''NAME=VALUE'',...')
        end if
      end do
      if (len(prefix) > 0 .and. .not. is_name(prefix)) then
        call deck%complain('prefix', 'prefix='//quoted(printable(prefix, 40))//' cannot begin the names of parameters, '// &
          'expected a letter, then letters, digits and _')
        name = ''
      end if
      call deck%close()
    end if
    if (len(name) == 0) then
      deck%names%complete = .false.               ! what it would have defined is not known
      return
    end if
    path = path_from(deck%parts%sources(deck%home(deck%token(deck%assignment_of('file'), 1)))%path, name)
    call check_repeated(deck, path, file, prefix, problem)
    if (len(problem) == 0) then
      deck%parts%groups(number)%included = deck%parts%source_count + 1
      call read_source(deck, path, file, prefix, list, problem)
      if (len(problem) > 0) problem = ' cannot be read: '//problem//', expected a deck file beside this one'
      if (len(problem) > 0) deck%names%complete = .false.
    end if
    if (len(problem) > 0) call deck%open(number)
    if (len(problem) > 0) call deck%complain('file', 'file='//quoted(name)//problem)
  end subroutine follow

  !> A file may be read once for each prefix; one that includes itself would never end.
  subroutine check_repeated(deck, path, file, prefix, problem)
    class(deck_source), intent(in) :: deck
    character(*), intent(in) :: path                       !! file to be read
    integer, intent(in) :: file                            !! number of the file that includes it
    character(*), intent(in) :: prefix                     !! of its names
    character(:), allocatable, intent(out) :: problem      !! empty if it may be read
    integer :: k
    problem = ''
    if (deck%parts%source_count >= most_parts) problem = ' is one file too many, expected at most '//to_text(most_parts)
    do k = 1, deck%parts%source_count
      if (deck%parts%sources(k)%key /= path .or. deck%parts%sources(k)%prefix /= deck%parts%sources(file)%prefix//prefix) cycle
      problem = ' is included before with the same names, expected every file once, or another prefix'
    end do
    k = file
    do while (k > 0)
      if (deck%parts%sources(k)%key == path) problem = ' includes itself, directly or through others, expected files that do not'
      k = deck%parts%sources(k)%parent
    end do
  end subroutine check_repeated
end module deck_files
