!> What is known of one key of a group, and what is expected of it in words. The rows are in `deck_keys`, which the build makes
!> from `keys.txt`.
module deck_key
  use kinds, only: wp
  use text, only: joined, quoted, to_text
  implicit none (type, external)
  private
  public :: in_range, is_whole, range_text, expectation, kinds_text, word_number, split

  integer, parameter, public :: longest_word = 21   !! letters of the longest key, and of the longest word that one may have

  !> One row of the table.
  type, public :: key
    character(longest_word) :: name
    character(12) :: type                    !! what its value is: 'real', 'word', '&body', ...; with '...' a list
    character(20) :: unit
    character(12) :: default                 !! that counts where it is not given; empty: its meaning says so
    logical :: required
    real(wp) :: low, high                    !! its range; huge: no limit [as the key]
    logical :: strict                        !! the limits do not belong to it
    character(220) :: words                  !! that may be, blanks between them
    integer :: kinds                         !! bit k - 1: it applies to the k-th word of the group's choice; 0: always
    character(360) :: meaning
    character(160) :: instead                !! what to do instead of the value 0, where that is out of range
    character(80) :: rules                   !! what it asks of other keys of its group (`deck_rules`)
  end type key

contains

  !> Whether a number lies in the range of a key.
  pure logical function in_range(v, x) result(yes)
    type(key), intent(in) :: v
    real(wp), intent(in) :: x                !! [as the key]
    yes = x >= v%low .and. x <= v%high
    if (v%strict) yes = x > v%low .and. x < v%high
  end function in_range

  !> Whether a key takes whole numbers.
  pure logical function is_whole(v) result(yes)
    type(key), intent(in) :: v
    yes = index(v%type, 'integer') == 1 .or. v%type == 'auto'
  end function is_whole

  !> A range in words: `density > 0`, `0 < tolerance < 1`, `spectral_radius from 0 to 0.99`; without limits `phase=number`.
  pure function range_text(v) result(t)
    type(key), intent(in) :: v
    character(:), allocatable :: t
    character(:), allocatable :: above, name
    name = trim(v%name)
    above = ' >= '
    if (v%strict) above = ' > '
    if (v%low <= -huge(v%low)) then
      t = name//'=number'
    else if (v%high >= huge(v%high)) then
      t = name//above//to_text(v%low)
    else if (v%strict) then
      t = to_text(v%low)//' < '//name//' < '//to_text(v%high)
    else
      t = name//' from '//to_text(v%low)//' to '//to_text(v%high)
    end if
  end function range_text

  !> What is expected where a key is missing.
  pure function expectation(v) result(t)
    type(key), intent(in) :: v
    character(:), allocatable :: t
    select case (v%type)
    case ('real')
      t = range_text(v)
    case ('integer')
      t = range_text(v)//' (a whole number)'
    case ('auto')
      t = range_text(v)//' (a whole number) or ''auto'''
    case ('pair')
      t = trim(v%name)//'=x,y'
    case ('real...')
      t = trim(v%name)//'=number,number,...'
    case ('integer...')
      t = trim(v%name)//'=number,number,... (whole numbers)'
    case ('word', 'choice', 'letter...')
      t = in_quotes(split(v%words), 'or')
    case ('column')
      t = 'a column of a &sensor'
    case ('input')
      t = 'the name of a &force or &drive'
    case ('text', 'name')
      t = trim(v%name)//'=''...'''
    case ('logical')
      t = '.true. or .false.'
    case default
      t = 'the name of a &'//trim(v%words)
    end select
  end function expectation

  !> Position of a word in a list, 0: it is not there.
  pure integer function word_number(words, word) result(n)
    character(*), intent(in) :: words        !! blanks between them
    character(*), intent(in) :: word         !! any text
    integer :: i, at
    n = 0
    at = index(' '//words//' ', ' '//word//' ')
    if (at == 0 .or. len(word) == 0 .or. scan(word, ' ') > 0) return
    n = 1 + count([(words(i:i) == ' ', i=1, at - 1)])
  end function word_number

  !> The words of a list.
  pure function split(words) result(list)
    character(*), intent(in) :: words        !! blanks between them
    character(longest_word), allocatable :: list(:)
    integer :: first, last
    allocate (list(0))
    first = 1
    do while (first <= len_trim(words))
      last = first + index(words(first:)//' ', ' ') - 2
      list = [character(longest_word) :: list, words(first:last)]
      first = last + 2
    end do
  end function split

  !> Kinds as a user writes them: `kind='beam' and 'frame'`.
  pure function kinds_text(selector, kinds) result(t)
    type(key), intent(in) :: selector        !! the choice of the group
    integer, intent(in) :: kinds             !! bit k - 1: its k-th word
    character(:), allocatable :: t
    character(longest_word), allocatable :: words(:)
    integer :: k
    words = split(selector%words)
    t = trim(selector%name)//'='//in_quotes(pack(words, [(btest(kinds, k - 1), k=1, size(words))]), 'and')
  end function kinds_text

  !> Words in quotes: 'u', 'v' or 'r'.
  pure function in_quotes(words, before_last) result(t)
    character(*), intent(in) :: words(:)
    character(*), intent(in) :: before_last  !! `and` or `or`
    character(:), allocatable :: t
    integer :: n
    n = size(words)
    t = quoted(trim(words(n)))
    if (n > 1) t = quoted(joined(words(:n - 1), ''', '''))//' '//before_last//' '//t
  end function in_quotes
end module deck_key
