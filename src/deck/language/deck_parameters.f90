!> Parameters of a deck and the values of its expressions. A parameter stands for its own value, or for what the command line
!> (`--set`) or the &include of its part says in its place. Names in an expression are those of parameters that the file in
!> which it stands can name (find_name of deck_input).
module deck_parameters
  use kinds, only: wp
  use readable_text, only: printable
  use text, only: either, lower, nearest_word, quoted
  use deck_input, only: deck_source
  use deck_keys, only: in_parameter
  use deck_names, only: not_there
  use deck_numbers, only: check_range
  use deck_overrides, only: is_override
  use deck_syntax, only: value_token, bare_value, expression_value, string_value, bad_value
  use expression, only: constants, evaluate, find_names, most_names, name_letters
  implicit none (type, external)
  private
  public :: compute_values

  integer, parameter :: untouched = 0, begun = 1, known = 2, faulty = 3   !! states of a parameter

  !> A parameter and where its value comes from.
  type, public :: parameter_value
    integer :: group = 0                      !! that defines it
    character(:), allocatable :: text         !! expression or number
    integer :: file = 1                       !! number of the file in which that stands: its names are looked up from there
    integer :: source = 0                     !! group in which it stands, 0: the command line
    integer :: line = 0                       !! its line
    integer :: token = 0                      !! position of the group's own value among all values
    character(:), allocatable :: shown        !! for messages: `value={2*L}`
    integer :: state = untouched
    real(wp) :: value = 0.0_wp                !! [as the parameter]
    logical :: used = .false.                 !! an expression names it
  end type parameter_value

contains

  !> Gives all parameters and all expressions of a deck their values. An expression that has none is reported and unusable.
  subroutine compute_values(deck, groups, path, p, settings)
    class(deck_source), intent(inout) :: deck
    integer, intent(in) :: groups(:)                       !! those that define parameters, in the order of their numbers
    character(*), intent(in) :: path                       !! of the deck, for messages
    type(parameter_value), allocatable, intent(out) :: p(:)
    character(*), intent(in), optional :: settings(:)      !! NAME=VALUE of the command line
    integer, allocatable :: stack(:)                       ! parameters that wait for the next one
    integer :: k
    allocate (p(size(groups)), stack(size(groups)))
    do k = 1, size(p)
      call read_own_value(k)
    end do
    if (present(settings)) then
      do k = 1, size(settings)
        if (.not. is_override(settings(k))) call apply_setting(trim(settings(k)), 0, 0)
      end do
    end if
    call apply_includes()
    do k = 1, size(p)
      if (p(k)%state == untouched) call resolve(k)
    end do
    if (deck%parts%has_expressions) call fill_expressions()
  contains
    !> The value that the group of a parameter gives; the reader of the group reports a faulty one.
    subroutine read_own_value(k)
      integer, intent(in) :: k                !! number of the parameter
      type(value_token) :: token
      integer :: assignment
      call deck%open(groups(k))
      p(k)%group = groups(k)
      p(k)%source = groups(k)
      p(k)%file = deck%file()
      p(k)%text = ''
      p(k)%state = faulty
      assignment = deck%assignment_of('value')
      if (assignment == 0) return
      if (deck%tokens(assignment) /= 1 .or. deck%values(assignment) /= 1) return
      token = deck%token(assignment, 1)
      if (token%form /= bare_value .and. token%form /= expression_value) return
      p(k)%text = deck%raw(token%first, token%last)
      p(k)%shown = 'value='//p(k)%text
      p(k)%line = token%line
      p(k)%token = token%position
      p(k)%state = untouched
      if (token%form == expression_value) p(k)%text = inside(p(k)%text)
    end subroutine read_own_value

    !> What every &include with `set` says of the parameters of its part. What an outer one says prevails over an inner one.
    subroutine apply_includes()
      type(value_token) :: token
      integer :: g, j, assignment
      do g = 1, deck%parts%group_count
        if (deck%parts%groups(g)%included == 0) cycle
        call deck%open(g)
        assignment = deck%assignment_of('set')
        if (assignment == 0) cycle
        do j = 1, deck%tokens(assignment)
          token = deck%token(assignment, j)
          if (token%form == string_value) then
            if (.not. is_override(deck%word(token))) call apply_setting(deck%word(token), g, token%line)
          else if (token%form /= bad_value) then
            call deck%add_fault(token%line, 'set='//deck%written(token)//' is no text in quotes, expected set=''NAME=VALUE'',...')
          end if
        end do
      end do
    end subroutine apply_includes

    !> Takes `NAME=VALUE` for the parameter of that name.
    subroutine apply_setting(text, group, line)
      character(*), intent(in) :: text
      integer, intent(in) :: group            !! &include in which it stands, 0: command line
      integer, intent(in) :: line             !! its line
      character(:), allocatable :: name, best, shown
      integer :: equals, file, k
      equals = index(text, '=')
      name = lower(trim(adjustl(text(1:max(equals - 1, 0)))))
      file = 1
      if (group > 0) file = deck%parts%groups(group)%included
      shown = '--set '//printable(text, 80)
      if (group > 0) shown = 'set='//quoted(printable(text, 80))
      if (equals == 0) then
        call complain(group, line, shown, 'has no =, expected NAME=VALUE')
        return
      end if
      k = deck%names(in_parameter)%find(deck%parts%sources(file)%prefix//name)
      if (k == not_there) then
        call deck%names(in_parameter)%nearest(deck%parts%sources(file)%prefix//name, best)
        if (len(best) > 0) best = 'did you mean '//best(len(deck%parts%sources(file)%prefix) + 1:)//'?'
        if (len(best) == 0) best = 'expected the name of a &parameter there'
        call complain(group, line, shown, 'names no parameter of the '//either('deck', 'part', group == 0)//', '//best)
      else if (k > 0) then
        if (p(k)%source == group) then
          call complain(group, line, shown, 'sets '//trim(adjustl(text(:equals - 1)))//' twice, expected one value')
        else if (p(k)%source == p(k)%group) then
          p(k)%source = group
          p(k)%file = 1
          if (group > 0) p(k)%file = deck%file()
          p(k)%line = line
          p(k)%shown = shown
          p(k)%text = inside(trim(adjustl(text(equals + 1:))))
          p(k)%state = untouched
        end if
      end if
    end subroutine apply_setting

    !> Computes a parameter, those that it needs first. The stack takes the place of recursion.
    subroutine resolve(first)
      integer, intent(in) :: first            !! number of the parameter
      character(:), allocatable :: problem, chain
      integer :: depth, needed, j, k
      logical :: good
      depth = 1
      stack(1) = first
      do while (depth > 0)
        k = stack(depth)
        p(k)%state = begun
        if (p(k)%source > 0) call deck%open(p(k)%source)
        call compute(p(k)%text, p(k)%file, p(k)%value, needed, problem, good)
        if (needed == 0) then
          p(k)%state = known
          if (.not. good) call mark_faulty(k)
          if (len(problem) > 0) call complain(p(k)%source, p(k)%line, p(k)%shown, problem)
          depth = depth - 1
        else if (p(needed)%state == untouched) then
          depth = depth + 1
          stack(depth) = needed
        else
          j = findloc(stack(1:depth), needed, 1)
          chain = ''
          do while (depth >= j)
            chain = ', '//name_of(stack(depth))//chain
            call mark_faulty(stack(depth))
            depth = depth - 1
          end do
          if (p(needed)%source > 0) call deck%open(p(needed)%source)
          call complain(p(needed)%source, p(needed)%line, p(needed)%shown, 'depends on itself ('//chain(3:)//', '// &
            name_of(needed)//'), expected parameters that do not')
        end if
      end do
    end subroutine resolve

    !> Notes that a parameter has no value, for a reason that is reported.
    subroutine mark_faulty(k)
      integer, intent(in) :: k                !! number of the parameter
      p(k)%state = faulty
      if (p(k)%source == p(k)%group) deck%parts%values(p(k)%token)%form = bad_value
    end subroutine mark_faulty

    !> Name of a parameter as its group gives it, with the prefix of its part.
    function name_of(k) result(name)
      integer, intent(in) :: k                !! number of the parameter
      character(:), allocatable :: name
      call deck%open(p(k)%group)
      name = deck%prefix()//deck%peek('name')
    end function name_of

    !> Value of an expression. Where it needs a parameter that is not computed yet `needed` is its number, else 0.
    subroutine compute(text, file, x, needed, problem, good)
      character(*), intent(in) :: text
      integer, intent(in) :: file                           !! number of the file in which it stands
      real(wp), intent(out) :: x                            !! 0 where it has no value [as the variable]
      integer, intent(out) :: needed
      character(:), allocatable, intent(out) :: problem     !! empty: none, or one that is reported elsewhere
      logical, intent(out) :: good                          !! whether it has a value
      character(name_letters) :: names(most_names)
      real(wp) :: values(most_names)
      character(:), allocatable :: best
      integer :: n, j, k
      needed = 0
      x = 0.0_wp
      problem = ''
      good = .true.
      call find_names(text, names, n)
      do j = 1, n
        call deck%find(file, in_parameter, trim(names(j)), k)
        good = good .and. k > 0
        if (k == not_there) then
          call deck%nearest(file, in_parameter, trim(names(j)), best)
          if (len(best) == 0 .and. nearest_word(names(j), constants) > 0) best = trim(constants(nearest_word(names(j), constants)))
          if (len(best) > 0) best = 'did you mean '//best//'?'
          if (len(best) == 0) best = 'expected a &parameter, a constant or a function; '// &
            'names of other things stand in quotes, without braces'
          problem = 'has the unknown name '//trim(names(j))//', '//best
          return
        end if
        if (k <= 0) cycle
        p(k)%used = .true.
        values(j) = p(k)%value
        good = good .and. p(k)%state /= faulty
        if (p(k)%state == untouched .or. p(k)%state == begun) needed = k
        if (needed > 0) return
      end do
      if (.not. good) return
      call evaluate(text, names(1:n), values(1:n), x, problem)
      if (len(problem) == 0) call check_range(x, problem)
      good = len(problem) == 0
    end subroutine compute

    !> Computes all expressions of the deck.
    subroutine fill_expressions()
      character(:), allocatable :: problem
      integer :: g, a, v, needed
      logical :: good
      do g = 1, deck%parts%group_count
        if (.not. deck%parts%groups(g)%readable) cycle
        call deck%open(g)
        do a = deck%parts%groups(g)%first_assignment, deck%parts%groups(g)%first_assignment + deck%count - 1
          do v = deck%parts%assignments(a)%first_value, deck%parts%assignments(a)%first_value + deck%parts%assignments(a)%values - 1
            associate (token => deck%parts%values(v))
              if (token%form /= expression_value) cycle
              call compute(inside(deck%raw(token%first, token%last)), deck%file(), token%number, needed, problem, good)
              if (good) cycle
              token%form = bad_value
              if (len(problem) > 0) call complain(g, token%line, trim(deck%parts%assignments(a)%name)//'='// &
                printable(deck%raw(token%first, token%last), 80), problem)
            end associate
          end do
        end do
      end do
    end subroutine fill_expressions

    !> Reports a fault of a value.
    subroutine complain(group, line, shown, problem)
      integer, intent(in) :: group                          !! in which it stands, open; 0: the command line
      integer, intent(in) :: line                           !! its line
      character(*), intent(in) :: shown, problem
      if (group > 0) call deck%add_fault(line, shown//' '//problem)
      if (group == 0) call deck%faults%add(path, 0, '', shown//' '//problem)
    end subroutine complain
  end subroutine compute_values

  !> An expression without the braces around it, if it has any.
  pure function inside(text) result(core)
    character(*), intent(in) :: text
    character(:), allocatable :: core
    core = text
    if (index(text, '{') == 1 .and. index(text, '}', back=.true.) == len(text)) core = text(2:len(text) - 1)
  end function inside
end module deck_parameters
