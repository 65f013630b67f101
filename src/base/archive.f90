!> Values that a checkpoint keeps. The same procedure `exchange` saves and restores them, in the same order, so that the two
!> cannot disagree. Numbers keep their bits.
module archive
  use kinds, only: wp, ip
  implicit none (type, external)
  private

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
end module archive
