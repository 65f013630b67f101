!> Values that a checkpoint keeps. The same procedure `exchange` saves and restores them, in the same order, so that the two
!> cannot disagree. Numbers keep their bits. Also the project's 64-bit digest.
module archive
  use kinds, only: wp, ip, low
  implicit none (type, external)
  private
  public :: digest, text_words

  !> A sequence of 64-bit words.
  type, public :: value_archive
    logical :: saving = .true.
    logical :: damaged = .false.              !! restoring: the words do not fit what is asked for
    integer(ip) :: count = 0                  !! words used (saving) or read (restoring)
    integer(ip), allocatable :: words(:)
  contains
    procedure :: begin_saving
    procedure :: begin_restoring
    procedure :: complete
    procedure, private :: exchange_long, exchange_integer, exchange_logical, exchange_real, exchange_reals, exchange_table, &
                          exchange_text
    generic :: exchange => exchange_long, exchange_integer, exchange_logical, exchange_real, exchange_reals, exchange_table, &
                           exchange_text
  end type value_archive

contains

  !> An empty archive to be filled.
  subroutine begin_saving(self)
    class(value_archive), intent(inout) :: self
    self%saving = .true.
    self%damaged = .false.
    self%count = 0
    if (.not. allocated(self%words)) allocate (self%words(256))
  end subroutine begin_saving

  !> An archive from which values are restored.
  subroutine begin_restoring(self, words)
    class(value_archive), intent(inout) :: self
    integer(ip), intent(in) :: words(:)
    self%saving = .false.
    self%damaged = .false.
    self%count = 0
    self%words = words
  end subroutine begin_restoring

  !> Whether everything that was saved has been restored, and nothing else.
  pure logical function complete(self) result(yes)
    class(value_archive), intent(in) :: self
    yes = .not. self%damaged .and. self%count == size(self%words)
  end function complete

  !> One long integer.
  subroutine exchange_long(self, n)
    class(value_archive), intent(inout) :: self
    integer(ip), intent(inout) :: n
    self%count = self%count + 1
    if (self%saving) then
      if (self%count > size(self%words)) self%words = [self%words, self%words]
      self%words(self%count) = n
    else if (self%count <= size(self%words)) then
      n = self%words(self%count)
    else
      self%damaged = .true.
    end if
  end subroutine exchange_long

  !> One integer.
  subroutine exchange_integer(self, n)
    class(value_archive), intent(inout) :: self
    integer, intent(inout) :: n
    integer(ip) :: word
    word = int(n, ip)
    call self%exchange(word)
    if (abs(word) <= huge(n)) n = int(word)
  end subroutine exchange_integer

  !> One truth value.
  subroutine exchange_logical(self, yes)
    class(value_archive), intent(inout) :: self
    logical, intent(inout) :: yes
    integer(ip) :: word
    word = merge(1_ip, 0_ip, yes)
    call self%exchange(word)
    yes = word == 1_ip
  end subroutine exchange_logical

  !> One real.
  subroutine exchange_real(self, x)
    class(value_archive), intent(inout) :: self
    real(wp), intent(inout) :: x              !! [any]
    integer(ip) :: word
    word = transfer(x, word)
    call self%exchange(word)
    if (.not. self%saving) x = transfer(word, x)
  end subroutine exchange_real

  !> Arrays of reals, up to four.
  subroutine exchange_reals(self, x, x2, x3, x4)
    class(value_archive), intent(inout) :: self
    real(wp), intent(inout) :: x(:)           !! [any]
    real(wp), intent(inout), optional :: x2(:), x3(:), x4(:)   !! [any]
    call exchange_array(self, x)
    if (present(x2)) call exchange_array(self, x2)
    if (present(x3)) call exchange_array(self, x3)
    if (present(x4)) call exchange_array(self, x4)
  end subroutine exchange_reals

  !> An array of reals, with its size.
  subroutine exchange_array(self, x)
    class(value_archive), intent(inout) :: self
    real(wp), intent(inout) :: x(:)           !! [any]
    integer :: k, n
    n = size(x)
    call self%exchange(n)
    if (n /= size(x)) self%damaged = .true.
    if (self%damaged) return
    do k = 1, n
      call self%exchange(x(k))
    end do
  end subroutine exchange_array

  !> A table of reals, column by column.
  subroutine exchange_table(self, x)
    class(value_archive), intent(inout) :: self
    real(wp), intent(inout) :: x(:, :)        !! [any]
    integer :: k
    do k = 1, size(x, 2)
      call self%exchange(x(:, k))
    end do
  end subroutine exchange_table

  !> Text of a fixed length, a character a word.
  subroutine exchange_text(self, x)
    class(value_archive), intent(inout) :: self
    ! allow(C072): texts differ in length
    character(*), intent(inout) :: x
    integer :: k, code
    do k = 1, len(x)
      code = iachar(x(k:k))
      call self%exchange(code)
      x(k:k) = achar(code)
    end do
  end subroutine exchange_text

  !> A number that changes with every bit of the words: two 32-bit multiplicative hashes side by side, no overflow.
  pure integer(ip) function digest(words) result(hash)
    integer(ip), intent(in) :: words(:)
    integer(ip) :: a, b, x
    integer :: k, half
    a = 2166136261_ip
    b = 374761393_ip
    do k = 1, size(words)
      do half = 0, 1
        x = iand(shiftr(words(k), 32*half), low)
        a = iand(ieor(a, x)*16777619_ip, low)
        b = iand(ieor(b, x), low)
        b = iand(ieor(b, shiftr(b, 15))*1540483477_ip, low)
        b = ieor(b, shiftr(b, 13))
      end do
    end do
    hash = ieor(shiftl(b, 32), ieor(a, shiftr(a, 16)))
  end function digest

  !> Text as words: its length, then its characters, eight a word.
  pure function text_words(text) result(words)
    character(*), intent(in) :: text
    integer(ip), allocatable :: words(:)
    integer :: k, w
    allocate (words(1 + (len(text) + 7)/8), source=0_ip)
    words(1) = len(text)
    do k = 1, len(text)
      w = 2 + (k - 1)/8
      words(w) = ior(shiftl(words(w), 8), int(iachar(text(k:k)), ip))
    end do
  end function text_words
end module archive
