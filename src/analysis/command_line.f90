!> The command line: biela [--check [--json]] [--flat] [--jobs N] [--output DIR] [--restart] [--set NAME=VALUE] [--quiet]
!> DECK.nml ..., --version, --help [WORD]; a deck named - is read from standard input.
module command_line
  use deck_help, only: help_text, nearest_help
  use deck_paths, only: deck_name
  use errors, only: status_ok, status_failed, status_bad_input, status_no_output
  use posix, only: most_children, write_bytes, standard_output, tell
  use readable_text, only: one_line
  use run_deck, only: print_words, run_options
  use summary, only: version
  use text, only: lower, nearest_word, to_text
  implicit none (type, external)
  private
  public :: command, parse_arguments, print_ending

  character(10), parameter :: known(11) = [character(10) :: '--check', '--flat', '--jobs', '--json', '--orbit', '--output', &
                                           '--restart', '--set', '--quiet', '--version', '--help']

  !> What the user asked for; decks is not allocated where there is nothing to run.
  type :: command
    character(:), allocatable :: decks(:)
    type(run_options) :: options
    integer :: jobs = 1                       !! decks that run at a time
  end type command

contains

  !> Reads the arguments; prints help, version or what is wrong with them.
  subroutine parse_arguments(asked, status)
    type(command), intent(out) :: asked
    integer, intent(out) :: status
    character(:), allocatable :: word, folder, decks(:), settings(:)
    integer :: k, n, set
    status = status_ok
    asked%options%output = ''
    asked%options%orbit = ''
    n = 0
    set = 0
    allocate (character(longest()) :: decks(command_argument_count()), settings(command_argument_count()))
    k = 0
    do while (k < command_argument_count() .and. status == status_ok)
      k = k + 1
      word = argument(k)
      select case (word)
      case ('--check')
        asked%options%check = .true.
      case ('--json')
        asked%options%json = .true.
      case ('--flat')
        asked%options%flat = .true.
      case ('--set')
        k = k + 1
        set = set + 1
        if (k <= command_argument_count()) settings(set) = argument(k)
        if (k > command_argument_count()) call complain('--set needs NAME=VALUE', status)
      case ('--restart')
        asked%options%restart = .true.
      case ('--quiet')
        asked%options%quiet = .true.
      case ('--output', '-o', '--orbit')
        k = k + 1
        folder = argument(k)
        if (word == '--orbit') asked%options%orbit = folder
        if (word /= '--orbit') asked%options%output = folder
        if (len(folder) == 0 .or. index(folder, '--') == 1) call complain(word//' needs a folder', status)
      case ('--version')
        call print_words('biela', 'biela '//version//new_line('a'), status)
        return
      case ('--jobs', '-j')
        k = k + 1
        call read_jobs(k, asked%jobs, status)
      case ('--help', '-h')
        call print_help(argument(k + 1), status)
        return
      case default
        n = n + 1
        decks(n) = word
        if (index(word, '-') == 1 .and. word /= '-') call complain('unknown option '//word//suggestion(word), status)
        if (len_trim(word) < len(word)) then       ! the run-time library would open the file without the blank
          call complain('the path "'//word//'" ends with a blank, expected a file name without one at its end', status)
        end if
      end select
    end do
    if (asked%jobs > 1 .and. asked%options%check) call complain('--jobs goes without --check', status)
    if (asked%options%json .and. .not. (asked%options%check .or. asked%options%flat)) call complain('--json goes with --check '// &
                                                                                                    'or --flat', status)
    if (asked%options%flat .and. (asked%options%check .or. asked%options%restart .or. asked%jobs > 1 .or. n > 1 .or. &
                                  len(asked%options%output) > 0)) call complain('--flat goes with one deck and --set alone', status)
    if (n == 0) call complain('no deck given', status)
    if (count(decks(1:n) == '-') > 1) call complain('standard input (-) holds one deck', status)
    if (n > 1 .and. len(asked%options%output) > 0) call complain('--output goes with one deck', status)
    if (status /= status_ok) return
    asked%decks = decks(1:n)
    asked%options%settings = settings(1:set)
    if (.not. asked%options%check) call warn_of_one_name(asked%decks, asked%jobs, status)
  end subroutine parse_arguments

  !> Decks with the same name in different folders share results/<deck name>: only the results of the last one would remain.
  !> Side by side they are refused.
  subroutine warn_of_one_name(decks, jobs, status)
    character(*), intent(in) :: decks(:)      !! paths of the decks
    integer, intent(in) :: jobs               !! decks that run at a time
    integer, intent(inout) :: status
    integer :: k, j
    do k = 2, size(decks)
      do j = 1, k - 1
        if (deck_name(trim(decks(j))) /= deck_name(trim(decks(k)))) cycle
        if (jobs > 1) call complain('--jobs: '//trim(decks(j))//' and '//trim(decks(k))//' cannot run side by side, both '// &
                                    'write into results/'//deck_name(trim(decks(k))), status)
        if (jobs > 1) return
        call tell('biela: warning: the results of '//trim(decks(k))//' replace those of '// &
          trim(decks(j))//', both are written into results/'//deck_name(trim(decks(k)))//' (one deck and --output keeps both)')
        exit
      end do
    end do
  end subroutine warn_of_one_name

  !> One argument, empty where there is none.
  function argument(k) result(word)
    integer, intent(in) :: k
    character(:), allocatable :: word
    integer :: length
    call get_command_argument(k, length=length)
    allocate (character(length) :: word)
    if (length > 0) call get_command_argument(k, word)
  end function argument

  !> Length of the longest argument.
  integer function longest()
    integer :: k, length
    longest = 1
    do k = 1, command_argument_count()
      call get_command_argument(k, length=length)
      longest = max(longest, length)
    end do
  end function longest

  !> The nearest known option, as a question.
  function suggestion(word) result(text)
    character(*), intent(in) :: word
    character(:), allocatable :: text
    integer :: k
    k = nearest_word(word, known)
    text = ''
    if (k > 0) text = ', did you mean '//trim(known(k))//'?'
  end function suggestion

  !> Says what is wrong with the command line.
  subroutine complain(text, status)
    character(*), intent(in) :: text
    integer, intent(inout) :: status
    if (status == status_ok) call tell('biela: '//text//' (biela --help)')
    status = status_bad_input
  end subroutine complain

  !> Reads how many decks run at a time.
  subroutine read_jobs(k, jobs, status)
    integer, intent(in) :: k                  !! number of the argument
    integer, intent(out) :: jobs
    integer, intent(inout) :: status
    character(:), allocatable :: word
    word = argument(k)
    jobs = 0
    if (len(word) > 0 .and. len(word) <= 4 .and. verify(word, '0123456789') == 0) read (word, *) jobs
    if (jobs >= 1 .and. jobs <= most_children) return
    if (k > command_argument_count()) call complain('--jobs needs a number', status)
    call complain('--jobs needs a number from 1 to '//to_text(most_children)//', found "'//word//'"', status)
  end subroutine read_jobs

  !> One line that says how one of several decks ended.
  subroutine print_ending(deck, status, more)
    character(*), intent(in) :: deck          !! its path
    character(*), intent(in) :: more          !! words at the end of the line
    integer, intent(inout) :: status          !! its exit status
    character(:), allocatable :: words
    select case (status)
    case (status_ok)
      words = 'done'
    case (status_failed)
      words = 'an analysis failed'
    case (status_bad_input)
      words = 'refused'
    case (status_no_output)
      words = 'results could not be written'
    case default
      words = 'stopped by a signal'
    end select
    if (.not. write_bytes(standard_output, one_line(deck)//': '//words//more//new_line('a'))) status = max(status, status_no_output)
  end subroutine print_ending

  !> The help text, or what is known of a group or key of decks.
  subroutine print_help(word, status)
    character(*), intent(in) :: word          !! empty or an option: the help text
    integer, intent(inout) :: status
    character(*), parameter :: lf = new_line('a')
    character(:), allocatable :: text
    if (len(word) > 0 .and. index(word, '-') /= 1) then
      text = help_text(lower(word))
      if (len(text) > 0) then
        call print_words('biela', text, status)
      else
        text = nearest_help(lower(word))
        if (len(text) > 0) text = ', did you mean '//text//'?'
        call complain('no group or key of decks is called '//one_line(word)//text, status)
      end if
      return
    end if
    call print_words('biela', 'biela: planar flexible mechanisms with viscoelastic damping'//lf//lf// &
      '  biela DECK.nml ...             run every analysis of each deck, results in results/<deck name>/; - is standard'//lf// &
      '                                 input, with results in results/stdin/'//lf// &
      '  biela --check DECK.nml         read, validate, assemble; print the model and the step advice, write nothing'//lf// &
      '  biela --check --json DECK.nml  the same as JSON, with all positions of the assembled scene'//lf// &
      '  biela --set L=0.3 DECK.nml     with that value of the parameter L, or of a key: section/rod/height=0.02,'//lf// &
      '                                 transient/step=1e-5; may stand several times'//lf// &
      '  biela --flat DECK.nml          print the deck as one text: parts in their places, numbers for expressions;'//lf// &
      '                                 with --json its groups and their values'//lf// &
      '  biela --output DIR DECK.nml    results in DIR/ instead (one deck); short -o'//lf// &
      '  biela --orbit DIR DECK.nml     seek the cycle of &periodic from that of another run, whose results are in DIR/'//lf// &
      '  biela --restart DECK.nml       continue an interrupted transient from its last checkpoint'//lf// &
      '  biela --jobs N DECK.nml ...    N decks at a time, one line a deck; short -j'//lf// &
      '  biela --quiet ...              no progress, warnings and errors only'//lf// &
      '  biela --help WORD              a group of decks with its keys, or a key: unit, range, default, meaning'//lf// &
      '  biela --version | --help (-h)'//lf//lf// &
      'Exit status: 0 done; 1 an analysis failed, results up to the last good time are on disk; 2 the command line or'//lf// &
      'a deck is wrong, nothing was written; 3 results, or lines that were asked for on standard output, could not be'//lf// &
      'written; 128 + signal when stopped by a signal.'// &
      lf, status)
  end subroutine print_help
end module command_line
