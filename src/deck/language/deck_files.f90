!> The files of a deck: reads them, splits them into groups, follows &include, and keeps the groups in reading order.
module deck_files
  use text, only: read_file, quoted
  use deck_input, only: deck_source, required
  use deck_get, only: get
  use deck_kinds, only: group_number, in_include
  use deck_lexer, only: split_groups
  use deck_paths, only: beside, from_input
  implicit none (type, external)
  private
  public :: read_source

contains

  !> Reads a file and all that it includes; appends its groups, those of included files in the place of the &include.
  recursive subroutine read_source(deck, path, parent, list, problem)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: path                       !! file, relative to the current folder
    integer, intent(in) :: parent                          !! number of the file that includes it, 0: none
    integer, allocatable, intent(inout) :: list(:)         !! receives the groups other than &include, in reading order
    character(:), allocatable, intent(out) :: problem      !! why it cannot be read, empty if it can
    character(:), allocatable :: content
    integer :: file, next, last, j, k
    if (path == from_input .and. parent == 0) then
      call read_file('/dev/stdin', content, problem)
    else
      call read_file(path, content, problem)
    end if
    if (len(problem) > 0) return
    call deck%parts%add_source(path, content, parent)
    file = deck%parts%source_count
    next = deck%parts%group_count + 1
    call split_groups(deck, file)
    last = deck%parts%group_count
    do k = next, last
      if (group_number(deck%group_word(k)) /= in_include) cycle
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
    character(:), allocatable :: name, path, problem
    allocate (character(0) :: name)
    if (deck%parts%groups(number)%readable) then
      call deck%open(number)
      call get(deck, 'file', name, required)
      if (deck%is_set('file') .and. len(name) == 0) call deck%complain('file', 'file='''' is empty, expected the '// &
        'name of a deck file')
      call deck%close()
    end if
    if (len(name) == 0) then
      deck%names%complete = .false.               ! what it would have defined is not known
      return
    end if
    path = beside(deck%parts%sources(file)%path, name)
    call check_repeated(deck, path, file, problem)
    if (len(problem) == 0) then
      call read_source(deck, path, file, list, problem)
      if (len(problem) > 0) problem = ' cannot be read: '//problem//', expected a deck file beside this one'
      if (len(problem) > 0) deck%names%complete = .false.
    end if
    if (len(problem) > 0) call deck%complain('file', 'file='//quoted(name)//problem)
  end subroutine follow

  !> A file may be read once only; one that includes itself would never end.
  subroutine check_repeated(deck, path, file, problem)
    class(deck_source), intent(in) :: deck
    character(*), intent(in) :: path                       !! file to be read
    integer, intent(in) :: file                            !! number of the file that includes it
    character(:), allocatable, intent(out) :: problem      !! empty if it may be read
    integer :: k
    problem = ''
    k = file
    do while (k > 0)
      if (beside('', deck%parts%sources(k)%path) == beside('', path)) then
        problem = ' includes itself, expected files that do not lead back to themselves'
        return
      end if
      k = deck%parts%sources(k)%parent
    end do
    do k = 1, deck%parts%source_count
      if (beside('', deck%parts%sources(k)%path) == beside('', path)) problem = &
        ' is included before, expected every file once'
    end do
  end subroutine check_repeated
end module deck_files
