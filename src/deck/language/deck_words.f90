!> Words of a list, names and references from the open group.
module deck_words
  use readable_text, only: printable
  use text, only: lower, to_text, meant_word, joined, quoted
  use deck_input, only: deck_source, required
  use deck_get, only: check_form, get
  use deck_kinds, only: group_names, name_characters, in_body, in_force, in_drive, in_sensor
  use deck_names, only: doubtful
  use deck_origin, only: name_length, named_record
  use deck_syntax, only: string_value, value_token
  implicit none (type, external)
  private
  public :: get_word, get_choice, get_name, get_reference, get_references, get_column, get_letters, get_input, &
    valid_name

  !> Words that users try, each with the deck's word for it.
  character(12), parameter :: synonyms(2, 13) = reshape([character(12) :: 'rotation', 'angle', 'displacement', 'position', &
    'force', 'reaction', 'strain', 'internal', 'mode', 'coordinate', &
    'pin', 'revolute', 'fixed', 'weld', 'clamp', 'weld', 'translation', 'prismatic', &
    'rod', 'distance', 'rotational', 'torsional', 'moment', 'torque', 'step', 'pulse'], [2, 13])

contains

  !> One word of a list; it keeps its default where the group does not give it.
  subroutine get_word(deck, name, word, words, need, kinds)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: name
    ! allow(C072): the words of records differ in length
    character(*), intent(inout) :: word           !! receives the word in lower case
    character(*), intent(in) :: words(:)          !! the words that may be
    logical, intent(in), optional :: need
    character(*), intent(in), optional :: kinds
    character(:), allocatable :: value, wanted
    wanted = ''
    if (present(need)) wanted = word_list(words)
    call get(deck, name, value, need, kinds, wanted)
    if (.not. deck%is_set(name)) return
    if (len_trim(value) > 0 .and. any(words == lower(value))) then
      word = lower(value)
    else
      call wrong_word(deck, name, value, words)
    end if
  end subroutine get_word

  !> The word that decides which variables of the group apply.
  subroutine get_choice(deck, name, word, words, need)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: name
    ! allow(C072): the words of records differ in length
    character(*), intent(inout) :: word      !! receives the word; blank: none
    character(*), intent(in) :: words(:)     !! the words that may be
    logical, intent(in), optional :: need
    logical :: known
    call get_word(deck, name, word, words, need)
    known = deck%is_known(name)
    if (present(need)) known = known .and. (deck%is_set(name) .or. .not. need)
    call deck%choose(name, trim(word), known)
  end subroutine get_choice

  !> A list of letters, each one of a list of known ones.
  subroutine get_letters(deck, name, found, words, kinds)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: name
    character(1), allocatable, intent(out) :: found(:)    !! the letters in lower case, size 0 if faulty
    character(*), intent(in) :: words(:)                  !! the words that may be
    character(*), intent(in), optional :: kinds
    character(name_length), allocatable :: values(:)
    integer :: k
    call text_list(deck, name, values, '', .false., kinds)
    allocate (found(size(values)))
    do k = 1, size(values)
      found(k) = lower(values(k)(1:1))
      if (any(words == lower(values(k)))) cycle
      call wrong_word(deck, name, trim(values(k)), words)
      found = found(:0)
      return
    end do
    if (size(found) > 0) found = found(deck%expanded(deck%assignment_of(name)))
  end subroutine get_letters

  !> Where the group stands, and its own name.
  subroutine get_name(deck, r)
    class(deck_source), intent(inout) :: deck
    class(named_record), intent(inout) :: r
    character(:), allocatable :: value, problem, shown
    r%at = deck%at()
    call get(deck, 'name', value, need=.true.)
    if (.not. deck%is_set('name')) return
    call valid_name(deck%prefix()//value, problem)
    if (len(problem) > 0) then
      shown = quoted(printable(deck%prefix()//value, 40))
      if (len(deck%prefix()) > 0) shown = shown//', with the prefix of the part,'
      call deck%complain('name', 'name='//shown//' '//problem)
    else
      r%name = deck%prefix()//value
      call note_part(deck, 'name', 1, deck%file())
    end if
  end subroutine get_name

  !> Notes whose prefix belongs in front of a name.
  subroutine note_part(deck, name, k, part)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: name       !! variable
    integer, intent(in) :: k               !! which of its values, repeat counts not expanded
    integer, intent(in) :: part            !! number of a file of the part
    type(value_token) :: token
    token = deck%token(deck%assignment_of(name), k)
    deck%parts%values(token%position)%part = part
  end subroutine note_part

  !> Whether a text can be a name. `problem` is empty if it can.
  pure subroutine valid_name(value, problem)
    character(*), intent(in) :: value                    !! the text
    character(:), allocatable, intent(out) :: problem    !! what is wrong, what was expected
    integer :: i
    problem = ''
    i = verify(lower(value), name_characters)
    if (len(value) == 0) then
      problem = 'is empty, expected letters, digits, _ and -'
    else if (i > 0) then
      problem = 'has a character that names may not have, expected letters, digits, _ and -'
    else if (len(value) > name_length) then
      problem = 'is too long ('//to_text(len(value))//' characters), expected up to '//to_text(name_length)
    end if
  end subroutine valid_name

  !> A reference to a named thing.
  subroutine get_reference(deck, name, kind, number, need, kinds)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: name
    integer, intent(in) :: kind                   !! what it names, one of deck_kinds
    integer, intent(inout) :: number              !! receives the number of the named thing; 0: the ground
    logical, intent(in), optional :: need
    character(*), intent(in), optional :: kinds
    character(:), allocatable :: value
    logical :: good
    call get(deck, name, value, need, kinds, 'the name of a &'//trim(group_names(kind)))
    if (deck%is_set(name)) call resolve(deck, name, 1, value, kind, number, good)
  end subroutine get_reference

  !> A column of a sensor: `tip.x`, or the sensor's name alone where it has one column. `deck_columns` judges it.
  subroutine get_column(deck, name, sensor, suffix, need)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: name
    integer, intent(inout) :: sensor              !! receives the number of the sensor
    ! allow(C072): as long as a record keeps it
    character(*), intent(out) :: suffix           !! what follows the sensor's name, with the point
    logical, intent(in), optional :: need
    character(:), allocatable :: value
    integer :: point
    logical :: good
    suffix = ''
    call get(deck, name, value, need, expected='a column of a &sensor')
    if (.not. deck%is_set(name)) return
    point = index(value, '.')
    if (point == 0) point = len(value) + 1
    suffix = lower(value(point:))
    call resolve(deck, name, 1, value(:point - 1), in_sensor, sensor, good)
  end subroutine get_column

  !> A list of references to named things.
  subroutine get_references(deck, name, kind, numbers, need, kinds)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: name
    integer, intent(in) :: kind                      !! what it names, one of deck_kinds
    integer, allocatable, intent(out) :: numbers(:)  !! numbers of the named things, size 0 if faulty
    logical, intent(in) :: need
    character(*), intent(in), optional :: kinds
    character(name_length), allocatable :: values(:)
    type(value_token) :: before
    integer :: assignment, k
    logical :: good, all_good
    call text_list(deck, name, values, 'the name of a &'//trim(group_names(kind)), need, kinds)
    allocate (numbers(size(values)), source=0)
    if (size(values) == 0) return
    all_good = .true.
    assignment = deck%assignment_of(name)
    do k = 1, size(values)
      if (k > 1 .and. values(k) == values(max(k - 1, 1))) then      ! a fault of it is reported already
        numbers(k) = numbers(k - 1)
        before = deck%token(assignment, k - 1)
        call note_part(deck, name, k, before%part)
      else
        call resolve(deck, name, k, trim(values(k)), kind, numbers(k), good)
        all_good = all_good .and. good
      end if
    end do
    numbers = numbers(deck%expanded(assignment))
    if (.not. all_good) numbers = [integer ::]
  end subroutine get_references

  !> A list of names or words in quotes, one for each value token.
  subroutine text_list(deck, name, values, expected, need, kinds)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: name
    character(name_length), allocatable, intent(out) :: values(:)     !! the texts, size 0 if faulty
    character(*), intent(in) :: expected                              !! what is expected if it is missing
    logical, intent(in) :: need
    character(*), intent(in), optional :: kinds
    character(name_length), allocatable :: list(:)
    type(value_token) :: token
    character(:), allocatable :: problem
    integer :: assignment, k
    logical :: good
    allocate (values(0))
    call deck%look_up(name, need, kinds, expected, assignment)
    if (assignment == 0) return
    allocate (list(deck%tokens(assignment)))
    do k = 1, size(list)
      token = deck%token(assignment, k)
      call check_form(deck, name, token, string_value, 'text in quotes', good)
      if (.not. good) return
      call valid_name(deck%word(token), problem)
      if (len(problem) > 0) then
        call deck%complain(name, name//'='//deck%written(token)//' '//problem)
        return
      end if
      list(k) = deck%word(token)
    end do
    call move_alloc(list, values)
    call deck%mark_good(assignment)
  end subroutine text_list

  !> A reference to a force or a drive.
  subroutine get_input(deck, name, force, drive)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: name
    integer, intent(inout) :: force        !! number of the force, 0 if it names none
    integer, intent(inout) :: drive        !! number of the drive, 0 if it names none
    character(:), allocatable :: value, best
    integer :: as_force, as_drive, part
    call get(deck, name, value, required, expected='the name of a &force or &drive')
    if (.not. deck%is_set(name)) return
    call deck%find(deck%file(), in_force, value, as_force, part)
    if (as_force > 0) call note_part(deck, name, 1, part)
    call deck%find(deck%file(), in_drive, value, as_drive, part)
    if (as_drive > 0) call note_part(deck, name, 1, part)
    if (as_force > 0 .and. as_drive > 0) then
      call deck%complain(name, name//'='//quoted(printable(value, 40))//' names both a force and a drive, expected '// &
        'different names for them')
    else if (as_force > 0 .or. as_drive > 0) then
      force = max(as_force, 0)
      drive = max(as_drive, 0)
    else if (as_force /= doubtful .and. as_drive /= doubtful) then
      call deck%nearest(deck%file(), in_force, value, best)
      if (len(best) == 0) call deck%nearest(deck%file(), in_drive, value, best)
      call names_nothing(deck, name, value, 'force or drive', 'force or &drive', best)
    end if
  end subroutine get_input

  !> Finds what a reference names. One that names nothing is faulty, and reported unless it may name what could not be read.
  subroutine resolve(deck, name, k, value, kind, number, good)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: name
    integer, intent(in) :: k              !! which of its values, repeat counts not expanded
    character(*), intent(in) :: value     !! the name it gives
    integer, intent(in) :: kind           !! what it names
    integer, intent(inout) :: number      !! receives the number of the thing, 0: the ground
    logical, intent(out) :: good          !! whether it names something
    character(:), allocatable :: best
    integer :: found, part
    good = kind == in_body .and. lower(value) == 'ground'
    if (good) number = 0
    if (good) return
    call deck%find(deck%file(), kind, value, found, part)
    good = found > 0
    if (good) number = found
    if (good) call note_part(deck, name, k, part)
    if (good) return
    call deck%mark_faulty(name)
    if (found == doubtful) return
    call deck%nearest(deck%file(), kind, value, best)
    call names_nothing(deck, name, value, trim(group_names(kind)), trim(group_names(kind)), best)
  end subroutine resolve

  !> Reports a reference that names nothing, with the nearest name where there is one.
  subroutine names_nothing(deck, name, value, what, groups, best)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: name
    character(*), intent(in) :: value     !! the name it gives
    character(*), intent(in) :: what      !! what it should name
    character(*), intent(in) :: groups    !! words of the groups that define such things
    character(*), intent(in) :: best      !! nearest name, empty: none
    character(:), allocatable :: expected
    expected = 'expected the name of a &'//groups
    if (len(best) > 0) expected = 'did you mean '//quoted(best)//'?'
    call deck%complain(name, name//'='//quoted(printable(value, 40))//' names no '//what//', '//expected)
  end subroutine names_nothing

  !> Reports a word that is not in its list; its variable is then faulty.
  subroutine wrong_word(deck, name, value, words)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: name
    character(*), intent(in) :: value       !! its word
    character(*), intent(in) :: words(:)    !! the words that may be
    character(:), allocatable :: expected
    integer :: near, k
    call deck%mark_faulty(name)
    near = 0
    do k = 1, size(synonyms, 2)
      if (synonyms(1, k) == lower(value)) near = max(near, findloc(words == synonyms(2, k), .true., 1))
    end do
    if (near == 0) near = meant_word(value, words)
    expected = 'expected '//word_list(words)
    if (near > 0) expected = 'did you mean '//quoted(trim(words(near)))//'?'
    call deck%complain(name, name//'='//quoted(printable(value, 40))//' is not known, '//expected)
  end subroutine wrong_word

  !> Two words or more in quotes: 'u', 'v' or 'r'.
  pure function word_list(words) result(t)
    character(*), intent(in) :: words(:)
    character(:), allocatable :: t
    integer :: n
    n = size(words)
    t = quoted(joined(words(1:n - 1), ''', '''))//' or '//quoted(trim(words(n)))
  end function word_list
end module deck_words
