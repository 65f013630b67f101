!> Text results: numbers with 17 significant digits. The buffer is written in complete lines, so that a file ends with a complete
!> row whenever a run stops.
module text_file
  use decimal, only: number_width, write_number
  use kinds, only: wp, ip
  use archive, only: value_archive
  use own_files, only: table_mark
  use posix, only: create_file, extend_file, write_bytes, close_file, cut_file, open_to_read, read_bytes, sync_file
  use readable_text, only: one_line
  use text_checksum, only: running_checksum
  implicit none (type, external)
  private
  public :: result_file

  integer, parameter :: buffer_size = 65536   !! characters that wait at most, unless one row is longer

  !> An open result file.
  type :: result_file
    integer :: handle = -1                    !! of the open file
    integer :: used = 0                       !! characters waiting in the buffer
    type(running_checksum) :: written         !! of what was handed to the system without failure, always whole lines
    integer(ip) :: expected(2) = 0            !! length and checksum at the checkpoint of an interrupted run
    logical :: failed = .false.
    character(:), allocatable :: buffer
  contains
    procedure :: open => open_file
    procedure :: covers
    procedure :: resume
    procedure :: head
    procedure :: line
    procedure :: row
    procedure :: flush => flush_file
    procedure :: sync
    procedure :: exchange
    procedure :: close => close_result
  end type result_file

contains

  !> Opens a file, replacing an old one.
  subroutine open_file(self, path)
    class(result_file), intent(inout) :: self
    character(*), intent(in) :: path
    self%used = 0
    self%written = running_checksum()
    if (.not. allocated(self%buffer)) allocate (character(buffer_size) :: self%buffer)
    self%handle = create_file(path)
    self%failed = self%handle < 0
  end subroutine open_file

  !> Whether a file begins with the text that its checkpoint counts on, which may be none.
  logical function covers(self, path) result(yes)
    class(result_file), intent(inout) :: self
    character(*), intent(in) :: path
    character(buffer_size) :: piece
    integer :: handle, n
    logical :: closed
    self%written = running_checksum()
    yes = self%expected(1) == 0
    if (yes) return
    handle = open_to_read(path, wait=0)
    do while (handle >= 0 .and. self%written%length < self%expected(1))
      n = read_bytes(handle, piece(1:min(int(buffer_size, ip), self%expected(1) - self%written%length)))
      if (n <= 0) exit
      call self%written%add(piece(1:n))
    end do
    if (handle >= 0) closed = close_file(handle)
    yes = handle >= 0 .and. all([self%written%length, self%written%value()] == self%expected)
  end function covers

  !> Opens a file of an interrupted run, which covers what its checkpoint counts on, and cuts it to that.
  subroutine resume(self, path)
    class(result_file), intent(inout) :: self
    character(*), intent(in) :: path
    self%used = 0
    if (.not. allocated(self%buffer)) allocate (character(buffer_size) :: self%buffer)
    self%handle = extend_file(path)
    self%failed = self%handle < 0
    if (.not. self%failed) self%failed = .not. cut_file(self%handle, self%written%length)
  end subroutine resume

  !> Writes one line of text.
  subroutine line(self, text)
    class(result_file), intent(inout) :: self
    character(*), intent(in) :: text
    call make_room(self, len(text) + 1)
    call put(self, text)
    call put(self, new_line('a'))
  end subroutine line

  !> Writes one row of numbers, where given after the time.
  subroutine row(self, values, time)
    class(result_file), intent(inout) :: self
    real(wp), intent(in) :: values(:)         !! [unit of each column]
    real(wp), intent(in), optional :: time    !! first column [s]
    integer :: k
    call make_room(self, number_width*(size(values) + 1) + 1)
    if (present(time)) call put_number(self, time)
    do k = 1, size(values)
      call put_number(self, values(k))
    end do
    call put(self, new_line('a'))
  end subroutine row

  !> Puts one number into the buffer, which has room for it.
  subroutine put_number(self, x)
    class(result_file), intent(inout) :: self
    real(wp), intent(in) :: x                 !! [unit of its column]
    call write_number(x, self%buffer(self%used + 1:self%used + number_width))
    self%used = self%used + number_width
  end subroutine put_number

  !> Makes room in the buffer for a complete line: a line is never written in parts.
  subroutine make_room(self, n)
    class(result_file), intent(inout) :: self
    integer, intent(in) :: n                  !! characters of the line
    if (self%used + n <= len(self%buffer)) return
    call self%flush()
    if (n <= len(self%buffer)) return
    deallocate (self%buffer)
    allocate (character(n) :: self%buffer)
  end subroutine make_room

  !> Puts characters into the buffer, which has room for them.
  subroutine put(self, text)
    class(result_file), intent(inout) :: self
    character(*), intent(in) :: text
    self%buffer(self%used + 1:self%used + len(text)) = text
    self%used = self%used + len(text)
  end subroutine put

  !> Hands the buffer to the system.
  subroutine flush_file(self)
    class(result_file), intent(inout) :: self
    if (self%used > 0 .and. .not. self%failed .and. self%handle >= 0) then
      self%failed = .not. write_bytes(self%handle, self%buffer(1:self%used))
      if (.not. self%failed) call self%written%add(self%buffer(1:self%used))
    end if
    self%used = 0
  end subroutine flush_file

  !> Hands the buffer to the system and waits until it is on the disk.
  impure elemental subroutine sync(self)
    class(result_file), intent(inout) :: self
    if (self%handle < 0) return
    call self%flush()
    if (.not. self%failed) self%failed = .not. sync_file(self%handle)
  end subroutine sync

  !> Length and checksum of a file that has just been synchronised, for the checkpoint.
  subroutine exchange(self, a)
    class(result_file), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    if (a%saving) self%expected = [self%written%length, self%written%value()]
    call a%exchange(self%expected(1), self%expected(2))
  end subroutine exchange

  !> Writes the rest of the buffer and closes the file. A row that could not be written completely is cut off.
  impure elemental subroutine close_result(self)
    class(result_file), intent(inout) :: self
    logical :: cut
    if (self%handle < 0) return
    call self%flush()
    if (self%failed) cut = cut_file(self%handle, self%written%length)
    if (.not. close_file(self%handle)) self%failed = .true.
    self%handle = -1
  end subroutine close_result

  !> First lines of a result file: what it holds, which deck it is of.
  subroutine head(self, what, deck_name, title)
    class(result_file), intent(inout) :: self
    character(*), intent(in) :: what          !! what the file holds
    character(*), intent(in) :: deck_name
    character(*), intent(in) :: title         !! empty: none
    call self%line(table_mark//what)
    call self%line('# deck: '//one_line(deck_name))
    if (len(title) > 0) call self%line('# title: '//one_line(title))
  end subroutine head
end module text_file
