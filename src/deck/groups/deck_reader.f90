!> Reads a deck: splits it and its included files into groups, registers all names, reads every group into its record,
!> and reports all faults at once, sorted by file and line.
module deck_reader
  use kinds, only: wp
  use growing_text, only: text_buffer
  use text, only: either, exact_text, joined, nearest_word, quoted
  use errors, only: fault_list
  use deck_keys, only: group_kinds, group_names, is_single, is_named, in_parameter, in_scene, in_material, in_section, &
    in_history, in_profile, in_body, in_lump, in_joint, in_drive, in_force, in_spring, in_stop, in_sensor, in_controller, &
    in_static, in_modal, in_periodic, in_response
  use deck_input, only: deck_source
  use deck_files, only: read_source
  use deck_names, only: doubtful
  use deck_paths, only: deck_name
  use deck_words, only: valid_name
  use deck_records, only: deck
  use sorting, only: sort_by_number
  use deck_flat, only: flat_text
  use deck_overrides, only: add_override, check_overrides
  use deck_parameters, only: compute_values, parameter_value
  use deck_properties, only: read_parameter, read_material, read_section
  use deck_histories, only: read_history, check_histories
  use deck_profiles, only: read_profile
  use deck_bodies, only: read_body
  use deck_joints, only: read_lump, read_joint, read_drive, read_spring, read_force, read_stop
  use deck_columns, only: find_column
  use deck_controllers, only: read_controller, check_controllers
  use deck_periodic, only: read_periodic, check_periodic
  use deck_sensors, only: read_sensor
  use deck_take, only: take
  use deck_temperature, only: set_temperatures
  use deck_transient, only: read_transient
  implicit none (type, external)
  private
  public :: read_deck

contains

  !> Reads the deck of a file. It must not be used if there are faults.
  subroutine read_deck(path, d, faults, settings, library)
    character(*), intent(in) :: path               !! file name as the user gave it
    type(deck), intent(out) :: d                   !! the deck
    type(fault_list), intent(out) :: faults        !! everything that is wrong with it
    character(*), intent(in), optional :: settings(:)       !! NAME=VALUE of the command line
    logical, intent(in), optional :: library       !! a deck without bodies is no fault
    type(deck_source) :: source
    type(parameter_value), allocatable :: p(:)
    type(text_buffer) :: text, files
    integer, allocatable :: list(:)                ! groups in reading order
    character(:), allocatable :: problem
    integer, allocatable :: kinds(:)               ! kind of each group of the list, 0: not to be read
    integer :: numbers(group_kinds)                ! how many of each kind
    integer :: k
    logical :: needed                              ! a body is
    d%path = path
    d%name = deck_name(path)
    allocate (list(0), source%parts%overrides(0))
    source%tables = ''
    source%table_files = ''
    if (present(settings)) then
      do k = 1, size(settings)
        call add_override(source, trim(settings(k)), '', 0, 0)
      end do
    end if
    call read_source(source, path, 0, '', list, problem)
    if (len(problem) > 0) then
      call faults%add(path, 0, '', 'cannot be read: '//problem//', expected a deck file')
      return
    end if
    do k = 1, source%parts%source_count
      if (file_of(source%parts%sources(k)%path) < k) cycle
      call files%add(source%parts%sources(k)%path//achar(0))
      if (k > 1) call text%add('! '//source%parts%sources(k)%path//achar(10))
      call text%add(source%parts%sources(k)%text)
    end do
    call check_overrides(source, path)
    call classify()
    call compute_values(source, pack(list, kinds == in_parameter), path, p)
    call allocate_records()
    call read_groups()
    if (.not. d%transient%present) d%transient%accuracy = 0.0_wp
    call check_inertia()
    call check_response()
    call check_reduction()
    call check_periodic(d, source%faults)
    do k = 1, size(d%forces)
      call find_column(d, d%forces(k)%at, 'argument', d%forces(k)%argument, source%faults)
    end do
    do k = 1, size(d%histories)
      call find_column(d, d%histories(k)%at, 'argument', d%histories(k)%argument, source%faults)
    end do
    call check_controllers(d, source)
    call check_histories(source, d%histories, d%transient%t_end)
    call set_temperatures(d, source%faults)
    d%settings = ''
    do k = 1, size(p)                              ! parameters that the command line sets
      if (p(k)%source == 0) d%settings = d%settings//'! --set '//trim(d%parameters(k)%name)//'='// &
        exact_text(d%parameters(k)%value)//achar(10)
    end do
    d%text = text%all()//source%tables//d%settings
    d%inputs = files%all()//source%table_files
    needed = .true.
    if (present(library)) needed = .not. library
    if (needed .and. source%names(in_body)%is_empty()) call source%faults%add(path, 0, '', 'no &body, expected at least one')
    call sort_faults()
    if (faults%count == 0) d%flat = flat_text(source, d%parameters%name, d%parameters%value)
  contains
    !> Finds the kind of every group, counts them and registers the names.
    subroutine classify()
      integer :: first(group_kinds)                          ! first group of each kind
      integer :: k
      numbers = 0
      allocate (kinds(size(list)))
      do k = 1, size(list)
        associate (g => list(k))
          call source%open(g)
          kinds(k) = source%parts%groups(g)%kind
          if (kinds(k) == 0) then
            call unknown_group(g)
            cycle
          end if
          associate (kind => kinds(k))
            if (is_single(kind) .and. numbers(kind) > 0) then
              call source%complain('', 'a second &'//trim(group_names(kind))//', the first is in '// &
                source%location_of(first(kind))//', expected one')
              kind = 0
              cycle
            end if
            if (numbers(kind) == 0) first(kind) = g
            numbers(kind) = numbers(kind) + 1
            if (is_named(kind)) call register(kind, numbers(kind), g)
          end associate
        end associate
      end do
    end subroutine classify

    !> Registers the name of the open group; reports one that is taken. Where it cannot be read, any reference may mean it.
    subroutine register(kind, number, group)
      integer, intent(in) :: kind     !! kind of the group
      integer, intent(in) :: number   !! what the name stands for
      integer, intent(in) :: group    !! the group
      character(:), allocatable :: name, problem
      integer :: earlier
      name = full_name()
      call valid_name(name, problem)
      if (len(problem) > 0) then
        source%names(kind)%complete = .false.
        return
      end if
      call source%names(kind)%add(name, number, group, earlier)
      if (earlier > 0) call source%complain('name', 'name='//quoted(name)//' is taken by the '// &
        trim(group_names(kind))//' in '//source%location_of(earlier)//', expected another name')
    end subroutine register

    !> Name of the open group with the prefix of its part; empty where it has none.
    function full_name() result(name)
      character(:), allocatable :: name
      name = source%peek('name')
      if (len(name) > 0) name = source%prefix()//name
    end function full_name

    !> Reports the open group as unknown. References to names that it may have defined raise no further faults.
    subroutine unknown_group(group)
      integer, intent(in) :: group    !! the group
      character(:), allocatable :: word, name, problem
      integer :: near, kind, earlier
      word = source%group_word(group)
      near = nearest_word(word, group_names)
      if (near > 0) then
        call source%complain('', 'unknown group, did you mean &'//trim(group_names(near))//'?')
      else if (len(word) > 0) then
        call source%complain('', 'unknown group, expected one of '//joined(group_names, ', '))
      end if
      name = full_name()
      call valid_name(name, problem)
      do kind = 1, group_kinds
        if (near > 0 .and. near /= kind) cycle
        if (len(problem) > 0) then
          source%names(kind)%complete = .false.
        else
          call source%names(kind)%add(name, doubtful, group, earlier)
        end if
      end do
    end subroutine unknown_group

    !> One record for every group that repeats.
    subroutine allocate_records()
      d%scene%title = ''
      allocate (d%parameters(numbers(in_parameter)))
      allocate (d%materials(numbers(in_material)), d%sections(numbers(in_section)), d%histories(numbers(in_history)), &
                d%profiles(numbers(in_profile)))
      allocate (d%bodies(numbers(in_body)), d%lumps(numbers(in_lump)), d%joints(numbers(in_joint)))
      allocate (d%drives(numbers(in_drive)), d%forces(numbers(in_force)), d%springs(numbers(in_spring)))
      allocate (d%stops(numbers(in_stop)), d%sensors(numbers(in_sensor)), &
                d%controllers(numbers(in_controller)), source%body_known(numbers(in_body)))
      source%body_known = .false.
    end subroutine allocate_records

    !> Reads all groups, kind by kind, so that what a group names is read before it.
    subroutine read_groups()
      integer :: kind, number, k
      do kind = 1, group_kinds
        number = 0
        do k = 1, size(list)
          if (kinds(k) /= kind) cycle
          number = number + 1
          if (.not. source%parts%groups(list(k))%readable) cycle
          call source%open(list(k))
          call read_group(kind, number)
          call source%close()
        end do
      end do
    end subroutine read_groups

    !> Reads the open group into its record.
    subroutine read_group(kind, number)
      integer, intent(in) :: kind       !! kind of the group
      integer, intent(in) :: number     !! which one of its kind
      select case (kind)
      case (in_parameter)
        call read_parameter(source, d%parameters(number), p(number))
      case (in_scene)
        call take(source, d%scene)
      case (in_material)
        call read_material(source, d%materials(number))
      case (in_section)
        call read_section(source, d%sections(number))
      case (in_history)
        call read_history(source, d%histories(number))
      case (in_profile)
        call read_profile(source, d%profiles(number))
      case (in_body)
        call read_body(source, d%sections, d%bodies(number), source%body_known(number))
      case (in_lump)
        call read_lump(source, d, d%lumps(number))
      case (in_joint)
        call read_joint(source, d, d%joints(number))
      case (in_drive)
        call read_drive(source, d, d%drives(number))
      case (in_force)
        call read_force(source, d, d%forces(number))
      case (in_spring)
        call read_spring(source, d, d%springs(number))
      case (in_stop)
        call read_stop(source, d, d%stops(number))
      case (in_sensor)
        call read_sensor(source, d, d%sensors(number))
      case (in_controller)
        call read_controller(source, d%controllers(number))
      case (in_static)
        call take(source, d%static)
      case (in_modal)
        call take(source, d%modal)
      case (in_response)
        call take(source, d%response)
      case (in_periodic)
        call read_periodic(source, d%periodic)
      case default
        call read_transient(source, d%transient, d%periodic)
      end select
    end subroutine read_group

    !> Powers, energies and pressures are products, a largest stress changes its place: they have no linear response.
    subroutine check_response()
      integer :: k
      do k = 1, size(d%sensors)
        if (d%response%present .and. any(d%sensors(k)%quantity == [character(6) :: 'power', 'work', 'energy', 'stress'])) call &
          d%sensors(k)%at%blame(source%faults, 'quantity='//quoted(trim(d%sensors(k)%quantity))//' has no linear response, '// &
          'expected it in a deck without &frequency_response')
        if (d%response%present .and. d%sensors(k)%modulus > 0.0_wp) call d%sensors(k)%at%blame(source%faults, &
          'a pressure has no linear response, expected no modulus in a deck with &frequency_response')
      end do
    end subroutine check_response

    !> The number of modes is found by the accuracy of a transient; the error of modes is found beside nodal coordinates, which have
    !> no amplitudes.
    subroutine check_reduction()
      integer :: k
      do k = 1, size(d%bodies)
        if (d%bodies(k)%auto_modes .and. .not. d%transient%accuracy > 0.0_wp) call d%bodies(k)%at%blame(source%faults, &
          'modes=''auto'' is found by what keeps the accuracy of a transient, expected &transient with accuracy')
      end do
      if (d%transient%check_reduction .and. .not. any(d%bodies%modes > 0)) call d%transient%at%blame(source%faults, &
        'check_reduction=.true. estimates the error of a given number of modes, expected a body with modes > 0')
      if (d%transient%check_mesh .and. .not. any(d%bodies%kind == 'beam')) call d%transient%at%blame(source%faults, &
        'check_mesh=.true. estimates the error of a number of elements, expected a beam')
      if (d%transient%check_mesh .and. size(d%sensors) == 0) call d%transient%at%blame(source%faults, &
        'check_mesh=.true. compares columns of sensors (the nodes of motion.txt are others in each mesh), expected a &sensor')
      do k = 1, size(d%sensors)
        if (d%sensors(k)%quantity /= 'coordinate' .or. d%sensors(k)%marker%body == 0) cycle
        associate (b => d%bodies(d%sensors(k)%marker%body))
          if (d%transient%check_mesh .and. b%kind == 'beam') call d%sensors(k)%at%blame(source%faults, 'quantity='// &
            quoted(trim(d%sensors(k)%quantity))//' means another thing in each mesh, expected it without check_mesh')
          if (b%auto_modes .or. (b%modes > 0 .and. d%transient%check_reduction)) call d%sensors(k)%at%blame(source%faults, &
            'quantity=''coordinate'' of a mode has nothing to be compared with in nodal coordinates, expected it without '// &
            either('modes=''auto''', 'check_reduction', b%auto_modes))
        end associate
      end do
    end subroutine check_reduction

    !> A rigid body needs inertia about its mass centre, its own or that of lumps.
    subroutine check_inertia()
      logical, allocatable :: turns(:)      ! bodies whose rotation has inertia
      integer :: k
      if (source%faults%count > 0) return
      turns = d%bodies%kind /= 'rigid' .or. d%bodies%inertia > 0.0_wp
      do k = 1, size(d%lumps)
        associate (l => d%lumps(k), i => d%lumps(k)%marker%body)
          turns(i) = turns(i) .or. l%inertia > 0.0_wp
          if (l%mass > 0.0_wp) turns(i) = turns(i) .or. any(abs(l%marker%point - d%bodies(i)%com) > 0.0_wp)
        end associate
      end do
      do k = 1, size(d%bodies)
        if (.not. turns(k)) call d%bodies(k)%at%blame(source%faults, 'inertia=0 and no lump away from the '// &
          'mass centre: its rotation has no inertia, expected inertia > 0')
      end do
    end subroutine check_inertia

    !> Number of the file that was first read from a path.
    pure integer function file_of(shown) result(file)
      character(*), intent(in) :: shown     !! the path
      do file = 1, source%parts%source_count
        if (source%parts%sources(file)%path == shown) return
      end do
    end function file_of

    !> The faults by file, in the order in which the files were read, and by line; those of one line as they were found.
    subroutine sort_faults()
      integer, allocatable :: first(:), by_line(:), by_file(:), file(:)
      integer :: k
      if (source%faults%count == 0) return
      associate (found => source%faults%items(1:source%faults%count))
        call sort_by_number(found%line, maxval(found%line), first, by_line)
        file = [(file_of(found(by_line(k))%file), k=1, size(found))]
        call sort_by_number(file, source%parts%source_count, first, by_file)
        do k = 1, size(found)
          associate (f => found(by_line(by_file(k))))
            call faults%add(f%file, f%line, f%subject, f%message)
          end associate
        end do
      end associate
    end subroutine sort_faults
  end subroutine read_deck
end module deck_reader
