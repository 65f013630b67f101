!> Files of a results folder: their names, and which ones biela has written, by how they begin. Only these are replaced and removed.
module own_files
  use posix, only: close_file, open_sole, read_bytes, remove_file, remove_scratch
  use readable_text, only: lf
  use whole_file, only: read_file
  implicit none (type, external)
  private
  public :: is_others, remove_own, drawn_files, clear_folder

  integer, parameter, public :: summaries = 2          !! of the names, the first ones
  character(*), parameter, public :: result_names(13) = [character(22) :: 'summary.json', 'summary.txt', 'static.txt', &
    'modes.txt', 'poles.txt', 'frequency_response.txt', 'floquet.txt', 'orbit.txt', 'history.txt', 'energy.txt', 'motion.txt', &
    'events.txt', 'checkpoint']
  character(*), parameter, public :: endings(4) = [character(5) :: '', '.new', '.new1', '.new2']   !! behind names, during a run
  character(*), parameter, public :: table_mark = '# biela: '          !! beginning of tables
  character(*), parameter, public :: checkpoint_mark = repeat('b', 8)  !! beginning of checkpoints

contains

  !> Whether a path names a file that biela has not written, and whose contents would be lost: links and files with other names
  !> are replaced, what they lead to stays. A run that was killed may leave an empty file.
  logical function is_others(path) result(yes)
    character(*), intent(in) :: path
    character(65536) :: head
    integer :: handle, n
    logical :: closed
    handle = open_sole(path)
    yes = handle < -1                                   ! what cannot be read is somebody else's
    if (handle < 0) return
    n = read_bytes(handle, head)
    closed = close_file(handle)
    associate (text => head(:max(n, 0)))
      yes = n /= 0 .and. index(text, table_mark) /= 1 .and. index(text, checkpoint_mark) /= 1 .and. &
            index(text, '{'//lf//'  "version": "') /= 1 .and. &
            .not. (index(text, 'deck: ') == 1 .and. index(text, lf//lf//'model'//lf) > 0)
    end associate
  end function is_others

  !> Removes a file that biela has written, if there is one.
  subroutine remove_own(path)
    character(*), intent(in) :: path
    if (.not. is_others(path)) call remove_file(path)
  end subroutine remove_own

  !> Removes what earlier runs have left in a folder, and what was drawn of them; the summary, which is this run's, stays.
  subroutine clear_folder(folder)
    character(*), intent(in) :: folder
    character(:), allocatable :: names, path
    integer :: k, i, first, length
    do k = 1, size(result_names)
      if (k > summaries) call remove_own(folder//'/'//trim(result_names(k)))
      do i = 2, size(endings)
        path = folder//'/'//trim(result_names(k))//trim(endings(i))
        if (.not. is_others(path)) call remove_scratch(path)
      end do
    end do
    names = drawn_files(folder)
    first = 1
    do while (first <= len(names))
      length = index(names(first:), lf) - 1
      call remove_file(folder//'/'//names(first:first + length - 1))
      first = first + length + 1
    end do
    call remove_file(folder//'/.drawn')
  end subroutine clear_folder

  !> What the programs of post/ drew of the former run, names that end with a line feed: they note them in `.drawn`, one a line, of
  !> files that stand beside it or in the folder `vtk` there.
  function drawn_files(folder) result(names)
    character(*), intent(in) :: folder
    character(:), allocatable :: names
    character(:), allocatable :: notes, problem
    integer :: first, length
    names = ''
    call read_file(folder//'/.drawn', notes, problem)
    first = 1
    do while (first <= len(notes))            ! each line ends with a line feed
      length = index(notes(first:), lf) - 1
      associate (name => notes(first:first + length - 1))
        if (length > 0 .and. index(name(merge(5, 1, index(name, 'vtk/') == 1):), '/') == 0) names = names//name//lf
      end associate
      first = first + length + 1
    end do
  end function drawn_files
end module own_files
