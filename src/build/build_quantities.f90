!> What sensors of the deck show, in terms of the model: quantities of motion, of each its kind, and sources of power.
module build_quantities
  use kinds, only: wp
  use deck_marker, only: body_text
  use errors, only: fault_list
  use text, only: to_text
  use build_markers, only: elastic_marker, find_marker, marker_table
  use deck_records, only: deck, marker_record, sensor_record
  use measure, only: measure_model
  use measures, only: difference, distance, elastic_measure
  use scene_model, only: power_source, scene
  implicit none (type, external)
  private
  public :: check_coordinates, friction_of, list_integrated, make_quantity, source_of

contains

  !> Elastic coordinates and cores that sensors name exist.
  subroutine check_coordinates(d, s, faults)
    type(deck), intent(in) :: d
    type(scene), intent(in) :: s              !! its bodies are set up
    type(fault_list), intent(inout) :: faults
    character(:), allocatable :: name
    integer :: k
    do k = 1, size(d%sensors)
      if (all(d%sensors(k)%quantity /= ['coordinate', 'slip      '])) cycle
      name = body_text(d, d%sensors(k)%marker%body)
      associate (r => d%sensors(k), b => s%bodies(d%sensors(k)%marker%body))
        if (r%index > b%nf) call r%at%blame(faults, 'index='//to_text(r%index)//' is out of range for '//name// &
          ', expected 1 to '//to_text(b%nf))
        if (r%quantity == 'slip' .and. size(b%dof, 1) == 3) call r%at%blame(faults, name//' has no cores, expected a body of '// &
          'layers with cores')
      end associate
    end do
  end subroutine check_coordinates

  !> The quantity that a column of a sensor shows, between markers that are added where they are new.
  subroutine make_quantity(d, s, r, column, markers, item)
    type(deck), intent(in) :: d
    type(scene), intent(in) :: s              !! its bodies are set up
    type(sensor_record), intent(in) :: r
    integer, intent(in) :: column             !! among its columns of motion (`deck_columns`)
    type(marker_table), intent(inout) :: markers
    class(measure_model), allocatable, intent(out) :: item
    type(marker_record) :: a, b               ! b: the ground's origin, where nothing else is named
    a = r%marker
    b = r%other
    select case (r%quantity)
    case ('position', 'velocity')
      item = difference(column)
    case ('angle', 'angular_velocity')
      item = difference(3)
    case ('deflection', 'coordinate')
      allocate (elastic_measure :: item)
      item%acts([1, 2, 4, 5]) = .true.         ! a lies on the line through b
      b = marker_record(body=a%body)
    case ('spring')
      a = d%springs(r%spring)%a
      b = d%springs(r%spring)%b
      allocate (item, source=s%forces(r%spring)%item%measure)
    case ('contact')
      if (r%joint > 0) then
        a = d%joints(r%joint)%a
        b = d%joints(r%joint)%b
        allocate (item, source=s%constraints(r%joint)%item%measures(1)%item)
      else
        a = d%stops(r%stop)%a
        b = d%stops(r%stop)%b
        allocate (item, source=s%forces(s%switching(r%stop))%item%measure)
      end if
    case default
      item = distance()
    end select
    item%rate = any(r%quantity == [character(20) :: 'velocity', 'angular_velocity']) .or. &
                (r%quantity == 'coordinate' .and. column == 2)
    if (r%quantity == 'coordinate') then
      item%ia = elastic_marker(s, markers, a%body, 0, r%index)
    else if (r%quantity == 'deflection') then
      item%ia = elastic_marker(s, markers, a%body, a%node, column)
    else
      item%ia = find_marker(s, markers, a)
    end if
    item%ib = find_marker(s, markers, b)
  end subroutine make_quantity

  !> Sources whose powers are integrated, in the deck's order of their sensors, then bodies that their losses warm.
  subroutine list_integrated(d, s)
    type(deck), intent(in) :: d
    type(scene), intent(inout) :: s              !! its constraints and force elements are made
    integer :: k, n
    n = count(d%bodies%thermal_resistance > 0.0_wp)
    allocate (s%integrated(n + count(integrates(d%sensors))))
    s%integrated(size(s%integrated) - n + 1:)%body = pack([(k, k=1, size(d%bodies))], d%bodies%thermal_resistance > 0.0_wp)
    n = 0
    do k = 1, size(d%sensors)
      if (.not. integrates(d%sensors(k))) cycle
      n = n + 1
      s%integrated(n) = source_of(s, d%sensors(k))
      s%integrated(n)%sensor = k
    end do
  end subroutine list_integrated

  !> Whether a sensor's power is integrated for it; what layers lose is among the losses of the scene.
  elemental logical function integrates(r)
    type(sensor_record), intent(in) :: r
    integrates = r%quantity == 'work' .or. (r%quantity == 'energy' .and. r%layer == 0)
  end function integrates

  !> The drive, force, spring, joint or body that a sensor names.
  pure type(power_source) function source_of(s, r) result(source)
    type(scene), intent(in) :: s
    type(sensor_record), intent(in) :: r
    source%body = r%marker%body
    if (r%force > 0) source%element = s%springs + r%force
    if (r%spring > 0) source%element = r%spring
    if (r%drive > 0) source%drive = s%joints + r%drive
    if (r%joint > 0) source%joint = [r%joint, friction_of(s, r%joint)]
  end function source_of

  !> The constraint that is the friction of a joint or stop; none where it has none.
  pure function friction_of(s, joint) result(row)
    type(scene), intent(in) :: s
    integer, intent(in) :: joint                 !! its number, of stops behind those of constraints; 0: no joint
    integer, allocatable :: row(:)
    integer :: k
    row = [(s%permanent + k, k=1, size(s%friction))]
    row = pack(row, [(s%constraints(row(k))%item%parent == joint, k=1, size(row))])
    if (joint == 0) row = row(:0)
  end function friction_of
end module build_quantities
