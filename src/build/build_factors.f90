!> Factors of loads that follow motions, from the histories of the deck: what goes by one argument is one history, which a watch
!> watches; sums, products and switches of several arguments are the nodes of a factor (`motion_factor`).
module build_factors
  use kinds, only: wp
  use build_history, only: make_history
  use build_markers, only: marker_table
  use build_quantities, only: make_quantity
  use deck_origin, only: origin
  use deck_records, only: column_record, deck, force_record
  use errors, only: fault_list
  use force_element, only: append, force_model
  use history, only: history_model
  use motion_factor, only: is_product, is_sum, is_switch, of_motion, of_time
  use motion_watch, only: history_watch, switch_watch
  use scene_model, only: scene
  use text, only: quoted
  implicit none (type, external)
  private
  public :: check_users, follows_time, gives_back, place_watches, require_continuous

  !> A part of what scales a load: a history of one argument, or what joins others.
  type :: part
    integer :: kind = 0                            !! that of a node of a factor; 0: there is no such factor
    integer :: record = 0                          !! number of the history
    integer :: owner = 0                           !! number of the part that it is a part of; 0: the whole
    type(column_record) :: column                  !! its argument; none: time
    logical :: inherited = .true.                  !! that is the argument of the load
  end type part

  !> How many factors a scene has, and what its watches are of, so that each stands once.
  type, public :: factor_list
    integer :: count = 0                           !! factors so far
    integer, allocatable :: histories(:)           !! (watches) each one's history
    type(column_record), allocatable :: columns(:) !! (watches) what it watches
  contains
    procedure :: find
  end type factor_list

contains

  !> The parts of what scales a load, the whole first.
  function parts_of(d, record, column) result(list)
    type(deck), intent(in) :: d
    integer, intent(in) :: record                  !! number of the history; 0: there is none
    type(column_record), intent(in) :: column      !! argument of the load; none: time
    type(part), allocatable :: list(:)
    allocate (list(0))
    if (record > 0) call add(part(record=record, column=column))
  contains
    !> Appends a part as its owner sees it, and what it is made of.
    recursive subroutine add(x)
      type(part), intent(in) :: x
      type(part) :: now, inner
      integer :: k
      associate (h => d%histories(x%record))
        now = x
        if (h%argument%sensor > 0) then
          now%column = h%argument
          now%inherited = .false.
        end if
        if (is_plain(d, x%record, now%column)) then
          now%kind = merge(of_time, of_motion, now%column%sensor == 0)
        else
          if (h%kind == 'sum') now%kind = is_sum
          if (h%kind == 'product') now%kind = is_product
          if (h%kind == 'switch') now%kind = is_switch
        end if
        list = [list, now]
        inner = now
        if (now%kind == is_switch) inner = x           ! its argument is that of the choice alone
        inner%kind = 0
        inner%owner = size(list)
        if (.not. any(now%kind == [is_sum, is_product, is_switch])) return
        do k = 1, size(h%parts)
          inner%record = h%parts(k)
          call add(inner)
        end do
      end associate
    end subroutine add
  end function parts_of

  !> The factor of a load. Its watches stand behind the elements that act.
  subroutine find(self, d, s, r, order, number, faults)
    class(factor_list), intent(inout) :: self
    type(deck), intent(in) :: d
    type(scene), intent(inout) :: s
    type(force_record), intent(in) :: r            !! with a history that follows a motion
    integer, intent(in) :: order                   !! highest derivative whose jumps are events
    integer, intent(out) :: number
    type(fault_list), intent(inout) :: faults
    type(part), allocatable :: list(:)
    integer :: k, j
    logical :: used                                ! the load's own argument is
    list = parts_of(d, r%history, r%argument)
    self%count = self%count + 1
    number = self%count
    allocate (s%factors(number)%nodes(size(list)))
    used = .false.
    do k = 1, size(list)
      associate (x => list(k), h => d%histories(list(k)%record), node => s%factors(number)%nodes(k))
        node%kind = x%kind
        node%parts = pack([(j, j=1, size(list))], list%owner == k)
        if (x%kind == is_sum) node%factors = h%factors
        if (x%kind == of_time) call make_history(d, x%record, node%history)
        if (any(x%kind == [is_sum, is_product, of_time])) cycle
        used = used .or. x%inherited
        if (x%kind == 0) then
          call h%at%blame(faults, 'a sequence has a time of its own, which its parts share, but one of them has an argument '// &
                          'of its own, expected the argument at the sequence')
        else if (x%column%sensor == 0) then
          call h%at%blame(faults, 'a switch chooses by the sign of a column, expected argument=''SENSOR.COLUMN''')
        else
          node%watch = watch_of(x%record, x%column)
        end if
      end associate
    end do
    if (r%argument%sensor > 0 .and. .not. used) call r%at%blame(faults, 'every part of history '// &
      quoted(trim(d%histories(r%history)%name))//' has an argument of its own, expected no argument here')
    associate (nodes => s%factors(number)%nodes)
      s%factors(number)%arguments = pack(nodes%watch, nodes%kind == of_motion)
    end associate
  contains
    !> The watch of a history of motion or of a switch, made where it is new.
    integer function watch_of(record, column) result(k)
      integer, intent(in) :: record
      type(column_record), intent(in) :: column
      class(history_watch), allocatable :: watch
      class(force_model), allocatable :: item
      type(switch_watch), allocatable :: choice
      do k = 1, size(self%histories)
        if (self%histories(k) == record .and. self%columns(k)%sensor == column%sensor .and. &
            self%columns(k)%number == column%number) return
      end do
      if (d%histories(record)%kind == 'switch') then
        allocate (choice)
        call choice%set_level(d%histories(record)%level)
        s%choices = s%choices + 1
        call move_alloc(choice, watch)
      else
        allocate (watch)
        call make_history(d, record, watch%history)
        call watch%watch_corners(order)
        call require_continuous(r%at, 'history', watch%history, faults)
      end if
      watch%name = d%histories(record)%name
      watch%group = 'history'
      self%histories = [self%histories, record]
      self%columns = [self%columns, column]
      call move_alloc(watch, item)
      call append(s%forces, item)
    end function watch_of
  end subroutine find

  !> The quantities that watches watch, between markers of the scene, and with them the arguments of the loads.
  subroutine place_watches(d, s, watched, markers)
    type(deck), intent(in) :: d
    type(scene), intent(inout) :: s              !! its bodies are set up
    type(column_record), intent(in) :: watched(:)
    type(marker_table), intent(inout) :: markers
    integer :: k, j
    do k = 1, size(watched)
      associate (f => s%forces(s%acting + k)%item)
        call make_quantity(d, s, d%sensors(watched(k)%sensor), watched(k)%number, markers, f%measure)
        f%ia = f%measure%ia
        f%ib = f%measure%ib
        f%size = s%size
      end associate
    end do
    do k = 1, s%acting
      associate (f => s%forces(k)%item)
        if (f%motion_factor == 0) cycle
        f%motions = size(s%factors(f%motion_factor)%arguments)
        allocate (f%arguments(f%motions))
        do j = 1, f%motions
          allocate (f%arguments(j)%item, source=s%forces(s%acting + s%factors(f%motion_factor)%arguments(j))%item%measure)
        end do
      end associate
    end do
  end subroutine place_watches

  !> Whether a load follows a history of time alone.
  logical function follows_time(d, r) result(yes)
    type(deck), intent(in) :: d
    type(force_record), intent(in) :: r
    type(part), allocatable :: list(:)
    list = parts_of(d, r%history, r%argument)
    yes = size(list) == 1 .and. all(list%kind == of_time)
  end function follows_time

  !> Whether a history and all its parts are functions of one argument.
  pure recursive logical function is_plain(d, record, column) result(yes)
    type(deck), intent(in) :: d
    integer, intent(in) :: record                  !! number of the history
    type(column_record), intent(in) :: column      !! its argument; none: time
    integer :: k
    associate (h => d%histories(record))
      yes = h%kind /= 'switch'
      if (.not. allocated(h%parts)) return
      do k = 1, size(h%parts)
        associate (own => d%histories(h%parts(k))%argument)
          if (own%sensor > 0) yes = yes .and. own%sensor == column%sensor .and. own%number == column%number
        end associate
        yes = yes .and. is_plain(d, h%parts(k), column)
      end do
    end associate
  end function is_plain

  !> Whether the work of a load depends on where one place is alone: it gives back on the way back what it has taken. Angles go on.
  logical function gives_back(d, r) result(yes)
    type(deck), intent(in) :: d
    type(force_record), intent(in) :: r
    type(part), allocatable :: list(:)
    list = parts_of(d, r%history, r%argument)
    yes = size(list) == 1 .and. all(list%kind == of_motion)
    if (yes) yes = any(d%sensors(list(1)%column%sensor)%quantity == [character(8) :: 'position', 'distance'])
  end function gives_back

  !> Drives, controllers, springs and profiles have an argument already: their histories have none.
  subroutine check_users(d, faults)
    type(deck), intent(in) :: d
    type(fault_list), intent(inout) :: faults
    integer :: k
    do k = 1, size(d%drives)
      call check(d%drives(k)%at, d%drives(k)%history, 'a drive prescribes a motion over time')
      if (d%drives(k)%rate .and. has_product(d%drives(k)%history)) call d%drives(k)%at%blame(faults, 'rate=.true. needs the '// &
        'integral of its history, which a product does not have in closed form, expected a table, or a history of the position')
    end do
    do k = 1, size(d%controllers)
      call check(d%controllers(k)%at, d%controllers(k)%history, 'what a controller follows is given over time')
    end do
    do k = 1, size(d%springs)
      if (d%springs(k)%characteristic > 0) call check(d%springs(k)%at, d%springs(k)%characteristic, &
                                                      'a characteristic is a function of the deformation')
    end do
    do k = 1, size(d%profiles)
      if (d%profiles(k)%history > 0) call check(d%profiles(k)%at, d%profiles(k)%history, 'a profile is a function of its angle')
    end do
  contains
    !> Reports one history with an argument of its own.
    subroutine check(at, record, why)
      type(origin), intent(in) :: at               !! of its user
      integer, intent(in) :: record
      character(*), intent(in) :: why
      type(part), allocatable :: list(:)
      list = parts_of(d, record, column_record())
      if (size(list) == 1 .and. all(list%kind == of_time)) return
      call at%blame(faults, why//', but history '//quoted(trim(d%histories(record)%name))//' follows a motion (by an '// &
                    'argument or a switch), expected one without, or a &force that it scales')
    end subroutine check

    !> Whether a history is a product or has one among its parts.
    pure recursive logical function has_product(record) result(yes)
      integer, intent(in) :: record
      integer :: k
      associate (h => d%histories(record))
        yes = h%kind == 'product'
        do k = 1, size(h%parts)
          yes = yes .or. has_product(h%parts(k))
        end do
      end associate
    end function has_product
  end subroutine check_users

  !> A function of motion may not jump: a motion might rest where it does, and the force there would have no value.
  subroutine require_continuous(at, variable, h, faults)
    type(origin), intent(in) :: at
    character(*), intent(in) :: variable
    class(history_model), intent(in) :: h
    type(fault_list), intent(inout) :: faults
    if (h%lowest_order() > 0) return
    call at%blame(faults, variable//'='//quoted(trim(h%name))//' jumps from one value to another, which a function of motion '// &
      'may not, expected a steep rise instead (kind=''ramp'', ''cycloid'' or ''table'')')
  end subroutine require_continuous
end module build_factors
