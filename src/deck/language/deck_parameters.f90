!> Parameters of a deck and the values of its expressions. A parameter stands for its own value, or for what the command line
!> (`--set`) or the &include of its part says in its place. Names in an expression are those of parameters that the file in
!> which it stands can name (find_name of deck_input).
module deck_parameters
  use kinds, only: wp
  use readable_text, only: printable
  use text, only: either, nearest_word
  use deck_input, only: deck_source
  use deck_keys, only: in_parameter
  use deck_names, only: not_there
  use deck_numbers, only: check_range
  use deck_overrides, only: complain, written_as
  use deck_syntax, only: value_token, bare_value, expression_value, bad_value
  use expression, only: constants, evaluate, find_names, name_letters
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
    character(:), allocatable :: shown        !! for messages: `value={2*L} `
    integer :: state = untouched
    real(wp) :: value = 0.0_wp                !! [as the parameter]
    logical :: used = .false.                 !! an expression names it
  end type parameter_value

contains

  !> Gives all parameters and all expressions of a deck their values. An expression that has none is reported and unusable.
  subroutine compute_values(deck, groups, path, p)
    class(deck_source), intent(inout) :: deck
    integer, intent(in) :: groups(:)                       !! those that define parameters, in the order of their numbers
    character(*), intent(in) :: path                       !! of the deck, for messages
    type(parameter_value), allocatable, intent(out) :: p(:)
    integer, allocatable :: stack(:)                       ! parameters that wait for the next one
    integer :: k
    allocate (p(size(groups)), stack(size(groups)))
    do k = 1, size(p)
      call read_own_value(k)
    end do
    call apply_settings()
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
      if (deck%tokens(assignment) /= 1) return
      token = deck%token(assignment, 1)
      if (token%form /= bare_value .and. token%form /= expression_value) return
      p(k)%text = deck%raw(token%first, token%last)
      p(k)%shown = 'value='//p(k)%text//' '
      p(k)%line = token%line
      p(k)%file = deck%home(token)
      p(k)%token = token%position
      p(k)%state = untouched
      if (token%form == expression_value) p(k)%text = inside(p(k)%text)
    end subroutine read_own_value

    !> Takes NAME=VALUE of the command line and of every &include. What comes first prevails: the command line, then outer parts.
    subroutine apply_settings()
      character(:), allocatable :: best, prefix
      integer :: i, file, k
      do i = 1, size(deck%parts%overrides)
        associate (one => deck%parts%overrides(i))
          file = 1
          if (one%include > 0) file = deck%parts%groups(one%include)%included
          if (.not. one%plain .or. index(one%shown, '=') == 0 .or. file == 0) cycle
          prefix = deck%parts%sources(file)%prefix
          k = deck%names(in_parameter)%find(one%name)
          if (k == not_there) then
            call deck%names(in_parameter)%nearest(one%name, best)
            if (len(best) > 0) best = 'did you mean '//best(len(prefix) + 1:)//'?'
            if (len(best) == 0) best = 'expected the name of a &parameter there'
            call complain(deck, path, one%include, one%line, written_as(one)//'names no parameter of the '// &
                          either('deck', 'part', one%include == 0)//', '//best)
          else if (k > 0) then
            if (p(k)%source == one%include) then
              call complain(deck, path, one%include, one%line, written_as(one)//'sets '// &
                            trim(adjustl(one%shown(:index(one%shown, '=') - 1)))//' twice, expected one value')
            else if (p(k)%source == p(k)%group) then
              p(k)%source = one%include
              p(k)%file = 1
              if (one%include > 0) p(k)%file = deck%parts%groups(one%include)%file
              p(k)%line = one%line
              p(k)%shown = written_as(one)
              p(k)%text = inside(one%value)
              p(k)%state = untouched
            end if
          end if
        end associate
      end do
    end subroutine apply_settings

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
        call compute(p(k)%text, p(k)%file, p(k)%value, needed, problem, good)
        if (needed == 0) then
          p(k)%state = known
          if (.not. good) call mark_faulty(k)
          if (len(problem) > 0) call complain(deck, path, p(k)%source, p(k)%line, p(k)%shown//problem)
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
          call complain(deck, path, p(needed)%source, p(needed)%line, p(needed)%shown//'depends on itself ('// &
            chain(3:)//', '//name_of(needed)//'), expected parameters that do not')
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
      character(name_letters), allocatable :: names(:)
      real(wp), allocatable :: values(:)                    ! of the names [as the parameters]
      character(:), allocatable :: best
      integer :: j, k
      needed = 0
      x = 0.0_wp
      problem = ''
      good = .true.
      call find_names(text, names)
      allocate (values(size(names)), source=0.0_wp)
      do j = 1, size(names)
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
      call evaluate(text, names, values, x, problem)
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
              if (token%copy) then
                token%form = deck%parts%values(v - 1)%form
                token%number = deck%parts%values(v - 1)%number
              end if
              if (token%form /= expression_value .or. token%copy) cycle
              call compute(inside(deck%raw(token%first, token%last)), deck%home(token), token%number, needed, problem, good)
              if (good) cycle
              token%form = bad_value
              if (len(problem) > 0) call deck%add_fault(token%line, trim(deck%parts%assignments(a)%name)//'='// &
                printable(deck%raw(token%first, token%last), 80)//' '//problem)
            end associate
          end do
        end do
      end do
    end subroutine fill_expressions
  end subroutine compute_values

  !> An expression without the braces around it, if it has any.
  pure function inside(text) result(core)
    character(*), intent(in) :: text
    character(:), allocatable :: core
    core = text
    if (index(text, '{') == 1 .and. index(text, '}', back=.true.) == len(text)) core = text(2:len(text) - 1)
  end function inside
end module deck_parameters
