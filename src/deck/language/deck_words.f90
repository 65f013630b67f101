!> Words of a list, names and references from the open group, each by its row in the table of keys.
module deck_words
  use readable_text, only: printable
  use text, only: lower, meant_word, quoted, to_text
  use deck_input, only: deck_source
  use deck_get, only: check_form, fault, get
  use deck_key, only: expectation, longest_word, split, word_number
  use deck_keys, only: group_names, in_body, in_drive, in_force, in_sensor, keys
  use deck_names, only: doubtful, not_there
  use deck_origin, only: name_length
  use deck_syntax, only: name_characters, string_value, value_token
  implicit none (type, external)
  private
  public :: get_word, get_name, get_reference, get_references, get_column, get_letters, get_input, valid_name

  !> Words that users try, each with the deck's word for it.
  character(12), parameter :: synonyms(2, 13) = reshape([character(12) :: 'rotation', 'angle', 'displacement', 'position', &
    'force', 'reaction', 'strain', 'internal', 'mode', 'coordinate', &
    'pin', 'revolute', 'fixed', 'weld', 'clamp', 'weld', 'translation', 'prismatic', &
    'rod', 'distance', 'rotational', 'torsional', 'moment', 'torque', 'step', 'pulse'], [2, 13])

contains

  !> One word of a list; it keeps its default where the group does not give it. A choice decides which keys apply.
  subroutine get_word(deck, row, word)
    class(deck_source), intent(inout) :: deck
    integer, intent(in) :: row                    !! of the key in the table
    ! allow(C072): as long as a record keeps it
    character(*), intent(inout) :: word           !! receives the word in lower case; blank: none
    character(:), allocatable :: value
    logical :: known
    call get(deck, row, value)
    if (allocated(value)) then
      if (word_number(keys(row)%words, lower(value)) > 0) then
        word = lower(value)
      else
        call wrong_word(deck, row, value)
      end if
    end if
    if (keys(row)%type /= 'choice') return
    known = deck%is_set(keys(row)%name) .or. .not. (deck%is_given(keys(row)%name) .or. keys(row)%required)
    call deck%choose(row, word, known)
  end subroutine get_word

  !> A list of letters, each one of a list of known ones.
  subroutine get_letters(deck, row, found)
    class(deck_source), intent(inout) :: deck
    integer, intent(in) :: row                            !! of the key in the table
    character(1), allocatable, intent(out) :: found(:)    !! the letters in lower case, size 0 if faulty
    character(name_length), allocatable :: values(:)
    integer :: k
    call text_list(deck, row, values)
    allocate (found(size(values)))
    do k = 1, size(values)
      found(k) = lower(values(k)(1:1))
      if (word_number(keys(row)%words, lower(trim(values(k)))) > 0) cycle
      call wrong_word(deck, row, trim(values(k)))
      found = found(:0)
      return
    end do
  end subroutine get_letters

  !> The group's own name, with the prefix of its part.
  subroutine get_name(deck, row, name)
    class(deck_source), intent(inout) :: deck
    integer, intent(in) :: row                    !! of the key in the table
    ! allow(C072): as long as a record keeps it
    character(*), intent(inout) :: name
    character(:), allocatable :: value, problem, shown
    call get(deck, row, value)
    if (.not. allocated(value)) return
    call valid_name(deck%prefix()//value, problem)
    if (len(problem) > 0) then
      shown = quoted(printable(deck%prefix()//value, 40))
      if (len(deck%prefix()) > 0) shown = shown//', with the prefix of the part,'
      call fault(deck, row, '='//shown//' '//problem)
    else
      name = deck%prefix()//value
      call note_part(deck, row, 1, deck%file())
    end if
  end subroutine get_name

  !> Notes whose prefix belongs in front of a name.
  subroutine note_part(deck, row, k, part)
    class(deck_source), intent(inout) :: deck
    integer, intent(in) :: row             !! of the key in the table
    integer, intent(in) :: k               !! which of its values
    integer, intent(in) :: part            !! number of a file of the part
    type(value_token) :: token
    token = deck%token(deck%assignment_of(keys(row)%name), k)
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
  subroutine get_reference(deck, row, number, kind)
    class(deck_source), intent(inout) :: deck
    integer, intent(in) :: row                    !! of the key in the table
    integer, intent(inout) :: number              !! receives the number of the named thing; 0: the ground
    integer, intent(in) :: kind                   !! what it names, a number of a group
    character(:), allocatable :: value
    logical :: good
    call get(deck, row, value)
    if (allocated(value)) call resolve(deck, row, 1, value, kind, number, good)
  end subroutine get_reference

  !> A column of a sensor: `tip.x`, or the sensor's name alone where it has one column. `deck_columns` judges it.
  subroutine get_column(deck, row, sensor, suffix)
    class(deck_source), intent(inout) :: deck
    integer, intent(in) :: row                    !! of the key in the table
    integer, intent(inout) :: sensor              !! receives the number of the sensor
    ! allow(C072): as long as a record keeps it
    character(*), intent(inout) :: suffix         !! what follows the sensor's name, with the point
    character(:), allocatable :: value
    integer :: point
    logical :: good
    call get(deck, row, value)
    if (.not. allocated(value)) return
    point = index(value, '.')
    if (point == 0) point = len(value) + 1
    suffix = lower(value(point:))
    call resolve(deck, row, 1, value(:point - 1), in_sensor, sensor, good)
  end subroutine get_column

  !> A list of references to named things.
  subroutine get_references(deck, row, numbers, kind)
    class(deck_source), intent(inout) :: deck
    integer, intent(in) :: row                       !! of the key in the table
    integer, allocatable, intent(out) :: numbers(:)  !! numbers of the named things, size 0 if faulty
    integer, intent(in) :: kind                      !! what it names, a number of a group
    character(name_length), allocatable :: values(:)
    integer :: k
    logical :: good
    call text_list(deck, row, values)
    allocate (numbers(size(values)), source=0)
    do k = 1, size(values)
      call resolve(deck, row, k, trim(values(k)), kind, numbers(k), good)
      if (good) cycle                               ! of a faulty list the first fault is reported
      numbers = numbers(:0)
      return
    end do
  end subroutine get_references

  !> A list of names or words in quotes, one for each value token.
  subroutine text_list(deck, row, values)
    class(deck_source), intent(inout) :: deck
    integer, intent(in) :: row                                        !! of the key in the table
    character(name_length), allocatable, intent(out) :: values(:)     !! the texts, size 0 if not given or faulty
    character(name_length), allocatable :: list(:)
    type(value_token) :: token
    character(:), allocatable :: problem
    integer :: assignment, k
    logical :: good
    allocate (values(0))
    call deck%look_up(row, assignment)
    if (assignment == 0) return
    allocate (list(deck%tokens(assignment)))
    do k = 1, size(list)
      token = deck%token(assignment, k)
      call check_form(deck, row, token, string_value, 'text in quotes', good)
      if (.not. good) return
      call valid_name(deck%word(token), problem)
      if (len(problem) > 0) then
        call fault(deck, row, '='//deck%written(token)//' '//problem)
        return
      end if
      list(k) = deck%word(token)
    end do
    call move_alloc(list, values)
    call deck%mark_good(assignment)
  end subroutine text_list

  !> A reference to a force or a drive.
  subroutine get_input(deck, row, force, drive)
    class(deck_source), intent(inout) :: deck
    integer, intent(in) :: row             !! of the key in the table
    integer, intent(inout) :: force        !! number of the force, 0 if it names none
    integer, intent(inout) :: drive        !! number of the drive, 0 if it names none
    integer, parameter :: kinds(2) = [in_force, in_drive]
    character(:), allocatable :: value, best
    integer :: found(2), home, part, k
    call get(deck, row, value)
    if (.not. allocated(value)) return
    home = deck%home(deck%token(deck%assignment_of(keys(row)%name), 1))
    best = ''
    do k = 1, 2
      call deck%find(home, kinds(k), value, found(k), part)
      if (found(k) > 0) call note_part(deck, row, 1, part)
      if (len(best) == 0) call deck%nearest(home, kinds(k), value, best)
    end do
    force = max(found(1), 0)
    drive = max(found(2), 0)
    if (all(found > 0)) call fault(deck, row, '='//quoted(printable(value, 40))//' names both a force and a drive, expected '// &
      'different names for them')
    if (all(found == not_there)) call names_nothing(deck, row, value, 'force or drive', best)
  end subroutine get_input

  !> Finds what a reference names. One that names nothing is faulty, and reported unless it may name what could not be read.
  subroutine resolve(deck, row, k, value, kind, number, good)
    class(deck_source), intent(inout) :: deck
    integer, intent(in) :: row            !! of the key in the table
    integer, intent(in) :: k              !! which of its values
    character(*), intent(in) :: value     !! the name it gives
    integer, intent(in) :: kind           !! what it names
    integer, intent(inout) :: number      !! receives the number of the thing, 0: the ground
    logical, intent(out) :: good          !! whether it names something
    character(:), allocatable :: best
    integer :: found, home, part
    good = kind == in_body .and. lower(value) == 'ground'
    if (good) number = 0
    if (good) return
    home = deck%home(deck%token(deck%assignment_of(keys(row)%name), k))
    call deck%find(home, kind, value, found, part)
    good = found > 0
    if (good) number = found
    if (good) call note_part(deck, row, k, part)
    if (good) return
    call deck%mark_faulty(keys(row)%name)
    if (found == doubtful) return
    call deck%nearest(home, kind, value, best)
    call names_nothing(deck, row, value, trim(group_names(kind)), best)
  end subroutine resolve

  !> Reports a reference that names nothing, with the nearest name where there is one.
  subroutine names_nothing(deck, row, value, what, best)
    class(deck_source), intent(inout) :: deck
    integer, intent(in) :: row            !! of the key in the table
    character(*), intent(in) :: value     !! the name it gives
    character(*), intent(in) :: what      !! what it should name
    character(*), intent(in) :: best      !! nearest name, empty: none
    character(:), allocatable :: expected
    expected = 'expected '//expectation(keys(row))
    if (len(best) > 0) expected = 'did you mean '//quoted(best)//'?'
    call fault(deck, row, '='//quoted(printable(value, 40))//' names no '//what//', '//expected)
  end subroutine names_nothing

  !> Reports a word that is not in its list; its key is then faulty.
  subroutine wrong_word(deck, row, value)
    class(deck_source), intent(inout) :: deck
    integer, intent(in) :: row              !! of the key in the table
    character(*), intent(in) :: value       !! its word
    character(:), allocatable :: expected
    character(longest_word), allocatable :: words(:)
    integer :: near, k
    call deck%mark_faulty(keys(row)%name)
    words = split(keys(row)%words)
    near = 0
    do k = 1, size(synonyms, 2)
      if (synonyms(1, k) == lower(value)) near = max(near, findloc(words == synonyms(2, k), .true., 1))
    end do
    if (near == 0) near = meant_word(value, words)
    expected = 'expected '//expectation(keys(row))
    if (near > 0) expected = 'did you mean '//quoted(trim(words(near)))//'?'
    call fault(deck, row, '='//quoted(printable(value, 40))//' is not known, '//expected)
  end subroutine wrong_word
end module deck_words
