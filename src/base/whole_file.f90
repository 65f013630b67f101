!> Whole files as text: decks, included files, tables of numbers. A deck may also come from a pipe.
module whole_file
  use growing_text, only: text_buffer
  use kinds, only: ip
  use posix, only: close_file, open_to_read, read_bytes, reason, size_of, size_of_folder, standard_input
  implicit none (type, external)
  private
  public :: read_file

  character(*), parameter, public :: from_input = '-'   !! path of a deck that stands on standard input
  integer, parameter :: longest = 200000000        !! more is endless input [bytes]
  integer, parameter :: at_a_time = 65536          !! [bytes]

contains

  !> A file with line feeds as its only line ends (CR LF and lone CR become LF), always with one at the end; a byte order mark
  !> is dropped. `problem` is empty if the file could be read. A pipe or a device is refused, not waited for, unless the
  !> program is handed one as its deck (`-`, `/dev/stdin`, `/dev/fd/63`). A file without a size is not read: it may be the system's,
  !> where reading takes away what others would read (/proc/kmsg).
  subroutine read_file(path, content, problem, handed)
    character(*), intent(in) :: path                       !! file name
    character(:), allocatable, intent(out) :: content      !! its text
    character(:), allocatable, intent(out) :: problem      !! why it could not be read
    logical, intent(in), optional :: handed                !! the path may mean what the program is handed
    type(text_buffer) :: raw
    character(at_a_time) :: piece
    integer(ip) :: bytes
    integer :: handle, n
    logical :: stream, closed
    content = ''
    problem = ''
    stream = .false.
    if (present(handed)) stream = handed .and. (path == from_input .or. path == '/dev/stdin' .or. index(path, '/dev/fd/') == 1)
    handle = standard_input
    if (path /= from_input .or. .not. stream) handle = open_to_read(path, wait=merge(1, 0, stream))
    if (handle < 0) then
      problem = reason()
      return
    end if
    if (.not. stream) then
      bytes = size_of(handle)
      if (bytes < 0) problem = 'not an ordinary file'
      if (bytes == 0) problem = 'empty, or not an ordinary file'
      if (bytes == size_of_folder) problem = 'is a directory'
    end if
    do while (len(problem) == 0)
      n = read_bytes(handle, piece)
      if (n < 0) problem = reason()
      if (n <= 0) exit
      call raw%add(piece(:n))
      if (raw%used > longest) problem = 'endless or too long'
    end do
    if (handle /= standard_input) closed = close_file(handle)   ! its number would be the next file's
    if (len(problem) > 0) return
    call normalize(raw%all(), content)
    if (index(content, achar(0)) > 0) problem = 'it is no text in UTF-8: it has zero bytes'
  end subroutine read_file

  !> Line feeds as the only line ends, one at the end, no byte order mark.
  pure subroutine normalize(raw, content)
    character(*), intent(in) :: raw                      !! bytes of a file
    character(:), allocatable, intent(out) :: content    !! the same text
    character(*), parameter :: cr = achar(13), lf = achar(10)
    character(*), parameter :: mark = char(239)//char(187)//char(191)   ! UTF-8
    integer :: i, n
    allocate (character(len(raw) + 1) :: content)
    n = 0
    do i = 1, len(raw)
      if (raw(i:i) == lf .and. i > 1) then
        if (raw(i - 1:i - 1) == cr) cycle
      end if
      n = n + 1
      content(n:n) = merge(lf, raw(i:i), raw(i:i) == cr)
    end do
    if (n > 0) then
      if (content(n:n) /= lf) n = n + 1
      content(n:n) = lf
    end if
    content = content(1:n)
    if (index(content, mark) == 1) content = content(4:)
  end subroutine normalize
end module whole_file
