!> Names of files: folders, names without ending, paths relative to a file.
module deck_paths
  use whole_file, only: from_input
  implicit none (type, external)
  private
  public :: deck_name, path_from

contains

  !> Folder of a file with its closing slash, empty for the current one.
  pure function folder_of(path) result(folder)
    character(*), intent(in) :: path
    character(:), allocatable :: folder
    folder = path(1:index(path, '/', back=.true.))
  end function folder_of

  !> File name without folder and `.nml`, or with it where the rest would be a folder's `.` or `..`; `stdin` for a deck from
  !> standard input.
  pure function deck_name(path) result(name)
    character(*), intent(in) :: path
    character(:), allocatable :: name
    integer :: last
    if (path == from_input) then
      name = 'stdin'
      return
    end if
    name = path(index(path, '/', back=.true.) + 1:)
    last = len(name) - 4
    if (last <= 0 .or. name == '..nml' .or. name == '...nml') return
    if (name(last + 1:) == '.nml') name = name(1:last)
  end function deck_name

  !> Path of a file that another one names relative to itself, without needless `.` and `..`.
  pure function path_from(file, relative) result(path)
    character(*), intent(in) :: file       !! the file that names it
    character(*), intent(in) :: relative   !! as named
    character(:), allocatable :: path
    character(:), allocatable :: part, rest
    integer :: slash
    rest = relative
    if (index(relative, '/') /= 1) rest = folder_of(file)//relative
    path = ''
    if (index(rest, '/') == 1) path = '/'
    do while (len(rest) > 0)
      slash = index(rest//'/', '/')
      part = rest(1:slash - 1)
      rest = rest(min(slash + 1, len(rest) + 1):)
      if (part == '' .or. part == '.') cycle
      if (part == '..' .and. len(path) > 1 .and. index('/'//path, '/../', back=.true.) < max(1, len(path) - 2)) then
        path = folder_of(path(1:len(path) - 1))
      else
        path = path//part
        if (len(rest) > 0) path = path//'/'
      end if
    end do
    if (len(path) == 0) path = '.'           ! the current folder
  end function path_from
end module deck_paths
