!> Text results: numbers with 17 significant digits, buffered, written as a stream of bytes.
module text_file
  use decimal, only: number_width, write_number
  use kinds, only: wp, ip
  implicit none (type, external)
  private
  public :: result_file

  integer, parameter :: buffer_size = 65536

  !> An open result file.
  type :: result_file
    integer :: unit = -1
    integer :: used = 0                       !! characters waiting in the buffer
    integer(ip) :: written = 0                !! bytes handed to the system
    logical :: failed = .false.
    character(:), allocatable :: path
    character(:), allocatable :: buffer       !! buffer_size characters
  contains
    procedure :: open => open_file
    procedure :: line
    procedure :: row
    procedure :: flush => flush_file
    procedure :: close => close_file
  end type result_file

contains

  !> Opens a file, replacing an old one.
  subroutine open_file(self, path)
    class(result_file), intent(inout) :: self
    character(*), intent(in) :: path
    integer :: status
    self%path = path
    self%used = 0
    self%written = 0
    if (.not. allocated(self%buffer)) allocate (character(buffer_size) :: self%buffer)
    open (newunit=self%unit, file=path, access='stream', form='unformatted', status='replace', action='write', &
          iostat=status)
    self%failed = status /= 0
  end subroutine open_file

  !> Writes one line of text.
  subroutine line(self, text)
    class(result_file), intent(inout) :: self
    character(*), intent(in) :: text
    call put(self, text)
    call put(self, new_line('a'))
  end subroutine line

  !> Writes one row of numbers, where given after the time.
  subroutine row(self, values, time)
    class(result_file), intent(inout) :: self
    real(wp), intent(in) :: values(:)         !! each in the unit of its column
    real(wp), intent(in), optional :: time    !! first column [s]
    integer :: k
    if (present(time)) call put_number(self, time)
    do k = 1, size(values)
      call put_number(self, values(k))
    end do
    call put(self, new_line('a'))
  end subroutine row

  !> Puts one number into the buffer.
  subroutine put_number(self, x)
    class(result_file), intent(inout) :: self
    real(wp), intent(in) :: x
    if (self%used + number_width > buffer_size) call self%flush()
    call write_number(x, self%buffer(self%used + 1:self%used + number_width))
    self%used = self%used + number_width
  end subroutine put_number

  !> Puts characters into the buffer.
  subroutine put(self, text)
    class(result_file), intent(inout) :: self
    character(*), intent(in) :: text
    integer :: from, n
    from = 1
    do while (from <= len(text))
      n = min(len(text) - from + 1, buffer_size - self%used)
      self%buffer(self%used + 1:self%used + n) = text(from:from + n - 1)
      self%used = self%used + n
      from = from + n
      if (self%used == buffer_size) call self%flush()
    end do
  end subroutine put

  !> Hands the buffer to the system.
  subroutine flush_file(self)
    class(result_file), intent(inout) :: self
    integer :: status
    if (self%failed) self%used = 0
    if (self%used == 0) return
    write (self%unit, iostat=status) self%buffer(1:self%used)
    if (status /= 0) self%failed = .true.
    self%written = self%written + self%used
    self%used = 0
  end subroutine flush_file

  !> Writes what is left and closes the file.
  subroutine close_file(self)
    class(result_file), intent(inout) :: self
    integer :: status
    if (self%unit == -1) return
    call self%flush()
    close (self%unit, iostat=status)
    if (status /= 0) self%failed = .true.
    self%unit = -1
  end subroutine close_file
end module text_file
