!> What the keys of one group ask of each other, as the rows of `keys.txt` say it: a word, and the keys that it is about.
module deck_rules
  use kinds, only: wp
  use text, only: either, listed, to_text
  use deck_get, only: counted
  use deck_input, only: deck_source
  use deck_key, only: expectation, longest_word, split, word_number
  use deck_keys, only: keys
  use deck_numbers, only: read_real
  use deck_syntax, only: expression_value
  implicit none (type, external)
  private
  public :: check_rules

  character(*), parameter :: verbs = 'or not with beside as below upto'

contains

  !> Reports what is wrong between keys of the open group, whose values have been read.
  subroutine check_rules(deck, first, last)
    class(deck_source), intent(inout) :: deck
    integer, intent(in) :: first, last            !! rows of the group in the table
    character(longest_word), allocatable :: words(:)
    integer :: row, k, n
    do row = first, last
      if (keys(row)%rules == '' .or. .not. (deck%choice_known .and. deck%applies(row))) cycle
      words = split(keys(row)%rules)
      k = 1
      do while (k <= size(words))
        n = k
        do while (n < size(words))
          if (word_number(verbs, trim(words(n + 1))) > 0) exit
          n = n + 1
        end do
        call check_rule(deck, row, trim(words(k)), words(k + 1:n))
        k = n + 1
      end do
    end do
  end subroutine check_rules

  !> One rule of a row.
  subroutine check_rule(deck, row, verb, others)
    class(deck_source), intent(inout) :: deck
    integer, intent(in) :: row                    !! of the key in the table
    character(*), intent(in) :: verb
    character(*), intent(in) :: others(:)         !! keys of the same group
    character(:), allocatable :: name, other, choices
    character(longest_word) :: list(1 + size(others))
    logical :: given(size(others))
    integer :: k
    name = trim(keys(row)%name)
    given = [(deck%is_given(trim(others(k))), k=1, size(others))]
    if (verb == 'or' .and. .not. any(given)) then
      list(1) = name
      list(2:) = others
      choices = listed(pack(list, [.true., (deck%applies(deck%row_of(trim(others(k)))), k=1, size(others))]), 'or')
      if (keys(row)%kinds /= 0) choices = choices//deck%for_choice()
      call deck%need(name, choices)
    else if (verb == 'beside' .and. deck%is_given(name) .and. .not. any(given)) then
      call deck%complain(name, name//' has no effect without '//either(trim(others(1)), listed(others, 'or'), &
        size(others) == 1)//', expected '//either('it', 'one of them', size(others) == 1))
    end if
    do k = 1, size(others)
      other = trim(others(k))
      if (verb == 'with' .and. deck%is_given(name)) then
        call deck%need(other, expectation(keys(deck%row_of(other)))//' beside '//name)
      else if (verb == 'not' .and. deck%is_given(name) .and. given(k)) then
        call deck%complain(name, other//' and '//name//' are both given, expected one of them')
      else if (deck%is_set(name) .and. deck%is_set(other)) then
        if (verb == 'as') call check_length(name, other)
        if (verb == 'below' .or. verb == 'upto') call check_order(name, other, verb == 'below')
      end if
    end do
  contains
    !> Two lists that belong together.
    subroutine check_length(name, other)
      character(*), intent(in) :: name, other
      integer :: n, m
      n = deck%tokens(deck%assignment_of(name))
      m = deck%tokens(deck%assignment_of(other))
      if (n /= m) call deck%complain(name, name//' has '//counted(n)//' and '//other//' '//to_text(m)//', expected equal numbers')
    end subroutine check_length

    !> Two numbers that ascend, or do not descend but for the rounding of numbers as they are written.
    subroutine check_order(name, other, strictly)
      character(*), intent(in) :: name, other
      logical, intent(in) :: strictly
      real(wp) :: x, y                            ! [as the keys]
      x = number_of(name)
      y = number_of(other)
      if (strictly .and. x >= y) then
        call deck%complain(other, other//'='//to_text(y)//' is not above '//name//'='//to_text(x)//', expected '//name//' < '// &
                           other)
      else if (x - y > 1.0e-9_wp*abs(y)) then
        call deck%complain(name, name//'='//to_text(x)//' is larger than '//other//'='//to_text(y)//', expected '//name//' <= '// &
                           other)
      end if
    end subroutine check_order

    !> The value of a key that is a number.
    real(wp) function number_of(name) result(x)   ! [as the key]
      character(*), intent(in) :: name
      character(:), allocatable :: problem
      associate (token => deck%token(deck%assignment_of(name), 1))
        x = token%number
        if (token%form /= expression_value) call read_real(deck%word(token), x, problem)
      end associate
    end function number_of
  end subroutine check_rule
end module deck_rules
