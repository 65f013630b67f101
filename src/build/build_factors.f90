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
  use motion_factor, only: factor_node, is_product, is_sum, is_switch, motion_factor_model, of_motion
  use motion_watch, only: history_watch, switch_watch, watch_model
  use scene_model, only: scene
  use text, only: quoted
  implicit none (type, external)
  private
  public :: check_users, gives_back, of_time, place_watches, require_continuous

  !> What the factors and watches of a scene are of, so that each stands once.
  type, public :: factor_list
    integer :: count = 0                           !! factors so far
    integer, allocatable :: keys(:, :)             !! (3, loads) of each factor: history, sensor and column of its argument
    integer, allocatable :: histories(:)           !! (watches) each one's history
    type(column_record), allocatable :: columns(:) !! (watches) what it watches
  contains
    procedure :: begin
    procedure :: find
  end type factor_list

contains

  !> No factor yet, in a scene with so many loads.
  subroutine begin(self, loads, s)
    class(factor_list), intent(inout) :: self
    integer, intent(in) :: loads
    type(scene), intent(inout) :: s
    allocate (self%keys(3, loads), self%histories(0), self%columns(0), s%factors(loads))
  end subroutine begin

  !> The factor of a load, made where it is new, as are its watches, which stand behind the elements that act.
  subroutine find(self, d, s, r, order, number, faults)
    class(factor_list), intent(inout) :: self
    type(deck), intent(in) :: d
    type(scene), intent(inout) :: s
    type(force_record), intent(in) :: r            !! with a history that follows a motion
    integer, intent(in) :: order                   !! highest derivative whose jumps are events
    integer, intent(out) :: number
    type(fault_list), intent(inout) :: faults
    type(motion_factor_model) :: f
    integer :: key(3), k
    logical :: used                                ! the load's own argument is
    key = [r%history, r%argument%sensor, r%argument%number]
    do number = 1, self%count
      if (all(self%keys(:, number) == key)) return
    end do
    allocate (f%nodes(0))
    used = .false.
    call add_node(r%history, r%argument, .true., k)
    if (r%argument%sensor > 0 .and. .not. used) call r%at%blame(faults, 'every part of history '// &
      quoted(trim(d%histories(r%history)%name))//' has an argument of its own, expected no argument here')
    f%arguments = pack(f%nodes%watch, f%nodes%kind == of_motion)
    s%factors(number) = f
    self%keys(:, number) = key
    self%count = number
  contains
    !> Appends the nodes of a history; its own is the last one.
    recursive subroutine add_node(record, outer, inherited, number)
      integer, intent(in) :: record                !! number of the history
      type(column_record), intent(in) :: outer     !! argument of what it is a part of; none: time
      logical, intent(in) :: inherited             !! that is the load's own
      integer, intent(out) :: number
      type(factor_node) :: node
      type(factor_node), allocatable :: longer(:)  ! an array constructor would leak (gfortran)
      type(column_record) :: column
      integer :: k
      logical :: from_load
      associate (h => d%histories(record))
        from_load = inherited .and. h%argument%sensor == 0
        column = outer
        if (h%argument%sensor > 0) column = h%argument
        if (is_plain(d, record, column)) then
          used = used .or. from_load
          if (column%sensor == 0) then
            call make_history(d, record, node%history)
          else
            node%kind = of_motion
            node%watch = watch_of(record, column)
          end if
        else
          select case (h%kind)
          case ('sum')
            node%kind = is_sum
            node%factors = h%factors
          case ('product')
            node%kind = is_product
          case ('switch')
            node%kind = is_switch
            if (column%sensor == 0) then
              call h%at%blame(faults, 'a switch chooses by the sign of a column, expected argument=''SENSOR.COLUMN''')
              number = 0
              return
            end if
            node%watch = watch_of(record, column)
            used = used .or. from_load
            column = outer                         ! its argument is that of the choice alone
            from_load = inherited
          case default
            call h%at%blame(faults, 'a sequence has a time of its own, which its parts share, but one of them has an argument '// &
                            'of its own, expected the argument at the sequence')
            number = 0
            return
          end select
          allocate (node%parts(size(h%parts)))
          do k = 1, size(h%parts)
            call add_node(h%parts(k), column, from_load, node%parts(k))
          end do
        end if
      end associate
      number = size(f%nodes) + 1
      allocate (longer(number))
      longer(:number - 1) = f%nodes
      longer(number) = node
      call move_alloc(longer, f%nodes)
    end subroutine add_node

    !> The watch of a history of motion or of a switch, made where it is new.
    integer function watch_of(record, column) result(k)
      integer, intent(in) :: record
      type(column_record), intent(in) :: column
      class(watch_model), allocatable :: watch
      class(force_model), allocatable :: item
      type(switch_watch), allocatable :: choice
      do k = 1, size(self%histories)
        if (self%histories(k) == record .and. self%columns(k)%sensor == column%sensor .and. &
            self%columns(k)%number == column%number) return
      end do
      if (d%histories(record)%kind == 'switch') then
        allocate (choice)
        choice%level = d%histories(record)%level
        choice%switches = .true.
        s%choices = s%choices + 1
        call move_alloc(choice, watch)
      else
        allocate (history_watch :: watch)
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
  pure logical function of_time(d, r) result(yes)
    type(deck), intent(in) :: d
    type(force_record), intent(in) :: r
    yes = r%history > 0 .and. r%argument%sensor == 0
    if (yes) yes = d%histories(r%history)%argument%sensor == 0
    if (yes) yes = is_plain(d, r%history, r%argument)
  end function of_time

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
        if (.not. yes) return
        associate (own => d%histories(h%parts(k))%argument)
          if (own%sensor > 0) yes = own%sensor == column%sensor .and. own%number == column%number
        end associate
        yes = yes .and. is_plain(d, h%parts(k), column)
      end do
    end associate
  end function is_plain

  !> Whether the work of a load depends on where one place is alone: it gives back on the way back what it has taken. Angles go on.
  pure logical function gives_back(d, r) result(yes)
    type(deck), intent(in) :: d
    type(force_record), intent(in) :: r
    type(column_record) :: column
    yes = .false.
    if (r%history == 0) return
    column = r%argument
    if (d%histories(r%history)%argument%sensor > 0) column = d%histories(r%history)%argument
    if (column%sensor == 0) return
    yes = any(d%sensors(column%sensor)%quantity == [character(8) :: 'position', 'distance']) .and. is_plain(d, r%history, column)
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
      if (d%histories(record)%argument%sensor == 0 .and. is_plain(d, record, column_record())) return
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
