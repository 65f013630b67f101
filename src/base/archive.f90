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
    procedure, private :: exchange_values, exchange_reals, exchange_table, exchange_words
    generic :: exchange => exchange_values, exchange_reals, exchange_table, exchange_words
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

  !> One word.
  subroutine exchange_word(self, n)
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
  end subroutine exchange_word

  !> Values, up to eight.
  subroutine exchange_values(self, x, x2, x3, x4, x5, x6, x7, x8)
    class(value_archive), intent(inout) :: self
    class(*), intent(inout) :: x              !! an integer of either kind, a truth value, a real, or text of a fixed length
    class(*), intent(inout), optional :: x2, x3, x4, x5, x6, x7, x8
    call exchange_value(self, x)
    if (present(x2)) call exchange_value(self, x2)
    if (present(x3)) call exchange_value(self, x3)
    if (present(x4)) call exchange_value(self, x4)
    if (present(x5)) call exchange_value(self, x5)
    if (present(x6)) call exchange_value(self, x6)
    if (present(x7)) call exchange_value(self, x7)
    if (present(x8)) call exchange_value(self, x8)
  end subroutine exchange_values

  !> One value; text takes a word for each character.
  subroutine exchange_value(self, x)
    class(value_archive), intent(inout) :: self
    class(*), intent(inout) :: x
    integer(ip) :: word
    integer :: k
    select type (x)
    type is (integer(ip))
      call exchange_word(self, x)
    type is (integer)
      word = int(x, ip)
      call exchange_word(self, word)
      if (abs(word) <= huge(x)) x = int(word)
    type is (logical)
      word = merge(1_ip, 0_ip, x)
      call exchange_word(self, word)
      x = word == 1_ip
    type is (real(wp))
      word = transfer(x, word)
      call exchange_word(self, word)
      if (.not. self%saving) x = transfer(word, x)
    type is (character(*))
      do k = 1, len(x)
        word = iachar(x(k:k))
        call exchange_word(self, word)
        x(k:k) = achar(word)
      end do
    class default
      self%damaged = .true.
    end select
  end subroutine exchange_value

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

  !> Words with their number: what `transfer` makes of a list of records.
  subroutine exchange_words(self, x)
    class(value_archive), intent(inout) :: self
    integer(ip), allocatable, intent(inout) :: x(:)
    integer :: k, n
    n = size(x)
    call self%exchange(n)
    if (self%damaged .or. n < 0) return
    if (.not. self%saving) x = [(0_ip, k=1, n)]
    do k = 1, n
      call exchange_word(self, x(k))
    end do
  end subroutine exchange_words

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
