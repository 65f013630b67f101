!> Lists of numbers, of any length, from the open group.
module deck_lists
  use kinds, only: wp
  use text, only: to_text
  use deck_input, only: deck_source
  use deck_get, only: real_of, integer_of, in_range, range_text, counted
  use deck_syntax, only: value_token
  implicit none (type, external)
  private
  public :: get_list, same_length

  !> Reads a list; it has size 0 where the group does not give it or a value is faulty.
  interface get_list
    module procedure :: get_reals, get_integers
  end interface get_list

contains

  !> Real numbers, all in one range.
  subroutine get_reals(deck, name, x, need, above, kinds)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: name
    real(wp), allocatable, intent(out) :: x(:)          !! the values [as the variable]
    logical, intent(in), optional :: need
    real(wp), intent(in), optional :: above             !! every value must be greater [unit of the values]
    character(*), intent(in), optional :: kinds
    real(wp), allocatable :: values(:)
    real(wp) :: value
    type(value_token) :: token
    integer :: assignment, k, n
    logical :: good
    allocate (x(0))
    call deck%look_up(name, need, kinds, name//'=number,number,...', assignment)
    if (assignment == 0) return
    allocate (values(deck%values(assignment)))
    n = 0
    do k = 1, deck%tokens(assignment)
      token = deck%token(assignment, k)
      call real_of(deck, name, token, value, good)
      if (.not. good) return
      if (.not. in_range(value, above)) then
        call deck%complain(name, name//' has the value '//deck%written(token)//', expected every '// &
          range_text(name, above))
        return
      end if
      values(n + 1:n + token%repeats) = value
      n = n + token%repeats
    end do
    call move_alloc(values, x)
    call deck%mark_good(assignment)
  end subroutine get_reals

  !> Whole numbers.
  subroutine get_integers(deck, name, x, need, kinds)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: name
    integer, allocatable, intent(out) :: x(:)           !! the values
    logical, intent(in), optional :: need
    character(*), intent(in), optional :: kinds
    integer, allocatable :: values(:)
    type(value_token) :: token
    integer :: assignment, k, n, value
    logical :: good
    allocate (x(0))
    call deck%look_up(name, need, kinds, name//'=number,number,... (whole numbers)', assignment)
    if (assignment == 0) return
    allocate (values(deck%values(assignment)))
    n = 0
    do k = 1, deck%tokens(assignment)
      token = deck%token(assignment, k)
      call integer_of(deck, name, token, value, good)
      if (.not. good) return
      values(n + 1:n + token%repeats) = value
      n = n + token%repeats
    end do
    call move_alloc(values, x)
    call deck%mark_good(assignment)
  end subroutine get_integers

  !> Checks that two lists that belong together have equal lengths; silent where one of them is missing or faulty.
  subroutine same_length(deck, name, length, other, other_length)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: name           !! the first list
    integer, intent(in) :: length              !! its length
    character(*), intent(in) :: other          !! the other list
    integer, intent(in) :: other_length        !! its length
    if (.not. (deck%is_set(name) .and. deck%is_set(other)) .or. length == other_length) return
    call deck%complain(other, other//' has '//counted(other_length)//' and '//name//' '//to_text(length)// &
      ', expected equal numbers')
  end subroutine same_length
end module deck_lists
