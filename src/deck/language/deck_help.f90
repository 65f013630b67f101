!> What `biela --help WORD` prints: a group with its keys, or a key in every group that has it.
module deck_help
  use deck_key, only: expectation, kinds_text, longest_word
  use deck_keys, only: first_key, group_kinds, group_meanings, group_names, keys, last_key
  use readable_text, only: lf
  use text, only: nearest_word
  implicit none (type, external)
  private
  public :: help_text, nearest_help

  integer, parameter :: line_length = 100

contains

  !> Groups and keys of that name; empty where there are none.
  function help_text(word) result(t)
    character(*), intent(in) :: word         !! in lower case; with `&` a group alone
    character(:), allocatable :: t, name
    integer :: g, k
    t = ''
    name = word(1 + merge(1, 0, index(word, '&') == 1):)
    do g = 1, group_kinds
      if (group_names(g) == name) t = t//'&'//name//': '//trim(group_meanings(g))//lf//keys_of(g, '')//lf
    end do
    do g = 1, group_kinds
      if (any([(keys(k)%name == word, k=first_key(g), last_key(g))])) t = t//'&'//trim(group_names(g))//lf//keys_of(g, word)//lf
    end do
  end function help_text

  !> The group or key nearest to a misspelt word, empty if none is near.
  function nearest_help(word) result(name)
    character(*), intent(in) :: word         !! in lower case
    character(:), allocatable :: name
    character(longest_word) :: names(group_kinds + size(keys))
    integer :: k
    names = [character(longest_word) :: group_names, keys%name]
    k = nearest_word(word, names)
    name = ''
    if (k > 0) name = trim(names(k))
  end function nearest_help

  !> The keys of a group, or one of them: what is expected, unit, default, kinds, and what it means.
  function keys_of(g, name) result(t)
    integer, intent(in) :: g                 !! the group
    character(*), intent(in) :: name         !! of the key, empty: all
    character(:), allocatable :: t, line
    integer :: choice, k
    choice = 0
    t = ''
    do k = first_key(g), last_key(g)
      associate (v => keys(k))
        if (v%type == 'choice') choice = k
        if (len(name) > 0 .and. v%name /= name) cycle
        line = expectation(v)
        if (index(line, trim(v%name)) /= 1) line = trim(v%name)//'='//line
        if (v%unit /= '') line = line//' ['//trim(v%unit)//']'
        if (v%required) line = line//', required'
        if (v%default /= '') line = line//', default '//trim(v%default)
        if (v%kinds /= 0) line = line//', with '//kinds_text(keys(choice), v%kinds)
        t = t//wrapped(line, 2, 4)//wrapped(trim(v%meaning), 6, 6)
      end associate
    end do
  end function keys_of

  !> A text in lines.
  pure function wrapped(s, first, further) result(t)
    character(*), intent(in) :: s
    integer, intent(in) :: first, further    !! blanks before the first line and the others
    character(:), allocatable :: t, rest
    integer :: last
    t = ''
    rest = repeat(' ', first)//s
    do while (len(rest) > line_length)
      last = index(rest(:line_length + 1), ' ', back=.true.)
      t = t//trim(rest(:last))//lf
      rest = repeat(' ', further)//rest(last + 1:)
    end do
    t = t//rest//lf
  end function wrapped
end module deck_help
