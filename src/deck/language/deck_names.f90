!> Names of one kind of thing and where they stand, found by hashing; also whether some could not be read, so that
!> one fault does not raise others.
module deck_names
  use kinds, only: ip
  use text, only: lower, nearest_word
  use deck_origin, only: name_length
  implicit none (type, external)
  private

  integer, parameter, public :: not_there = 0     !! no such name
  integer, parameter, public :: doubtful = -1     !! the name may belong to something that could not be read

  !> One name.
  type :: known_name
    character(name_length) :: text = ''   ! in lower case
    character(name_length) :: shown = ''  ! as the deck writes it
    integer :: number = 0                 ! what it stands for
    integer :: group = 0                  ! the group that has it
  end type known_name

  !> A table of names; case does not matter.
  type, public :: name_table
    private
    type(known_name), allocatable :: names(:)         ! in the order added
    integer, allocatable :: slots(:)                  ! open hash table: position in names, 0 free
    integer :: count = 0
    logical, public :: complete = .true.              !! .false.: some names of this kind could not be read
  contains
    procedure :: add
    procedure :: find
    procedure :: nearest
    procedure :: is_empty
  end type name_table

contains

  !> Adds a name. `earlier` is the group that has it already, 0 if it is new; the first one keeps it.
  subroutine add(self, name, number, group, earlier)
    class(name_table), intent(inout) :: self
    character(*), intent(in) :: name     !! up to name_length characters, any case
    integer, intent(in) :: number        !! what it stands for, or doubtful
    integer, intent(in) :: group         !! the group that it names
    integer, intent(out) :: earlier
    integer :: slot
    call reserve(self)
    slot = slot_of(self, lower(name))
    earlier = 0
    if (self%slots(slot) > 0) then
      associate (known => self%names(self%slots(slot)))
        if (number /= doubtful .and. known%number /= doubtful) earlier = known%group
        if (known%number == doubtful) known%number = number
      end associate
      return
    end if
    self%count = self%count + 1
    self%names(self%count) = known_name(lower(name), name, number, group)
    self%slots(slot) = self%count
  end subroutine add

  !> What a name stands for; `not_there` or `doubtful` if it cannot be used.
  integer function find(self, name) result(number)
    class(name_table), intent(in) :: self
    character(*), intent(in) :: name   !! any case
    integer :: slot
    number = merge(not_there, doubtful, self%complete)
    if (self%count == 0 .or. len_trim(name) > name_length) return
    slot = slot_of(self, lower(name))
    if (self%slots(slot) > 0) number = self%names(self%slots(slot))%number
  end function find

  !> Whether there is no name of this kind, not even one that could not be read.
  pure logical function is_empty(self) result(yes)
    class(name_table), intent(in) :: self
    yes = self%count == 0 .and. self%complete
  end function is_empty

  !> The known name nearest to a misspelt one, empty if none is near.
  pure subroutine nearest(self, name, best)
    class(name_table), intent(in) :: self
    character(*), intent(in) :: name                  !! misspelt name
    character(:), allocatable, intent(out) :: best    !! known name as the deck writes it
    integer :: k
    best = ''
    if (self%count == 0 .or. len_trim(name) > 2*name_length) return
    k = nearest_word(name, self%names(:self%count)%text)
    if (k > 0) best = trim(self%names(k)%shown)
  end subroutine nearest

  !> Slot of the hash table that holds a name or would take it.
  pure integer function slot_of(self, name) result(slot)
    class(name_table), intent(in) :: self
    character(*), intent(in) :: name   !! lower case
    slot = modulo(word_hash(name), size(self%slots)) + 1
    do
      if (self%slots(slot) == 0) return
      if (self%names(self%slots(slot))%text == name) return
      slot = modulo(slot, size(self%slots)) + 1
    end do
  end function slot_of

  !> A number in 0..2147483647 that equal words share, blanks at the end not counted.
  pure integer function word_hash(word) result(hash)
    character(*), intent(in) :: word   !! lower case word
    integer(ip) :: h
    integer :: i
    h = 5381_ip
    do i = 1, len_trim(word)
      h = iand(33_ip*h + iachar(word(i:i)), 2147483647_ip)
    end do
    hash = int(h)
  end function word_hash

  !> Makes room for one more name; at most half of the slots are ever taken.
  subroutine reserve(self)
    class(name_table), intent(inout) :: self
    integer :: k
    if (.not. allocated(self%names)) then
      allocate (self%names(16))
      allocate (self%slots(32), source=0)
    end if
    if (self%count < size(self%names)) return
    self%names = [self%names, self%names]
    self%slots = spread(0, 1, 2*size(self%names))
    do k = 1, self%count
      self%slots(slot_of(self, trim(self%names(k)%text))) = k
    end do
  end subroutine reserve
end module deck_names
