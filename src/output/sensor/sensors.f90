!> The sensors of a scene: columns of history.txt from one evaluated, projected state, and their amplitudes in the linear response
!> (input/README.md, &sensor).
module sensors
  use kinds, only: wp
  use acceleration_sensor, only: acceleration_sensor_model
  use build_markers, only: begin_markers, find_marker, marker_table
  use build_quantities, only: friction_of, make_quantity, source_of
  use contact_sensor, only: contact_sensor_model
  use controller_sensor, only: controller_sensor_model
  use deck_columns, only: motion_suffixes
  use deck_records, only: deck, sensor_record
  use dynamics, only: one_marker
  use elastic_sensors, only: coordinate_sensor_model, deflection_sensor_model
  use element_courses, only: balanced
  use energy_sensors, only: energy_sensor_model, power_sensor_model, work_sensor_model
  use evaluation_results, only: evaluation
  use force_sensors, only: spring_sensor_model, stop_sensor_model
  use layer_sensors, only: layer_sensor_model, slip_sensor_model
  use mechanism, only: mechanism_model
  use marker, only: marker_model, marker_states
  use measure, only: measure_model
  use quantity_sensor, only: quantity_sensor_model
  use row_sensors, only: friction_sensor_model, reaction_sensor_model
  use result_columns, only: result_column
  use section_sensors, only: section_sensor_model, stress_sensor_model
  use sensor, only: observation, sensor_box, sensor_model, harmonic_motion
  use text, only: either, to_text
  implicit none (type, external)
  private
  public :: sensor_list, set_up_sensors, read_sensors, read_linear_sensors

  !> All sensors of a scene.
  type :: sensor_list
    type(sensor_box), allocatable :: sensors(:)
    integer, allocatable :: first(:)                !! first column of each sensor
    integer :: columns = 0
    type(result_column), allocatable :: column(:)   !! each of them
    type(marker_model), allocatable :: markers(:)   !! between which they measure
    type(marker_states) :: p                        !! of these markers
  end type sensor_list

contains

  !> Columns of every sensor of the deck.
  subroutine set_up_sensors(d, m, list)
    type(deck), intent(in) :: d
    type(mechanism_model), intent(in) :: m
    type(sensor_list), intent(out) :: list
    type(result_column), allocatable :: own(:)      ! of a sensor, without its name
    type(marker_table) :: markers
    integer :: k, n
    n = size(d%sensors)
    allocate (list%sensors(n), list%first(n), list%column(n))
    markers = begin_markers(size(m%s%bodies))
    do k = 1, n
      call make_sensor(d, k, m, markers, list%sensors(k)%item, own)
      associate (s => list%sensors(k)%item)
        s%number = find_marker(m%s, markers, d%sensors(k)%marker)
        s%marker = markers%items(s%number)
      end associate
      list%first(k) = list%columns + 1
      own = own%of(trim(d%sensors(k)%name))
      own%quantity = d%sensors(k)%quantity
      do while (size(list%column) < list%columns + size(own))
        list%column = [list%column, list%column]
      end do
      list%column(list%columns + 1:list%columns + size(own)) = own
      list%columns = list%columns + size(own)
    end do
    list%column = list%column(:list%columns)
    list%markers = markers%items(1:markers%count)
    call list%p%allocate(size(list%markers))
  end subroutine set_up_sensors

  !> The factory of sensors: the deck's word into the kind, and its columns, whose names lack the sensor's.
  subroutine make_sensor(d, number, m, markers, item, columns)
    type(deck), intent(in) :: d
    integer, intent(in) :: number                  !! of the sensor
    type(mechanism_model), intent(in) :: m
    type(marker_table), intent(inout) :: markers
    class(sensor_model), allocatable, intent(out) :: item
    type(result_column), allocatable, intent(out) :: columns(:)
    type(quantity_sensor_model), allocatable :: quantities
    type(sensor_record) :: r
    type(reaction_sensor_model) :: reaction        ! a constructor would never free its list
    type(slip_sensor_model) :: slip
    type(power_sensor_model) :: power
    type(contact_sensor_model), allocatable :: contact
    character(:), allocatable :: unit
    type(result_column), allocatable :: ends(:)
    type(result_column), parameter :: both_fibres(2) = [result_column('.top', 'Pa'), result_column('.bottom', 'Pa')]
    integer, allocatable :: row(:)                 ! the friction's number among the constraints
    integer :: k
    r = d%sensors(number)
    select case (r%quantity)
    case ('acceleration')
      item = acceleration_sensor_model(first=1, last=2, against=find_marker(m%s, markers, r%other))
      columns = [result_column('.x', 'm/s2'), result_column('.y', 'm/s2')]
    case ('angular_acceleration')
      item = acceleration_sensor_model(first=3, last=3, against=find_marker(m%s, markers, r%other))
      columns = [result_column('', 'rad/s2')]
    case ('deflection')
      item = deflection_sensor_model()
      columns = [result_column('.u', 'm'), result_column('.v', 'm'), result_column('.r', 'rad')]
    case ('coordinate')
      item = coordinate_sensor_model(index=r%index)
      associate (basis => m%s%bodies(r%marker%body)%basis)
        unit = 'm'
        if (basis%rotation(r%index)) unit = 'rad'
        if (basis%reduced_from > 0) unit = 'kg^.5*m'
      end associate
      columns = [result_column('.q', unit), result_column('.qd', unit//'/s'), result_column('.qdd', unit//'/s2')]
    case ('reaction')
      reaction%constraints = [merge(r%joint, m%s%joints + r%drive, r%joint > 0), friction_of(m%s, r%joint)]
      item = reaction
      columns = [result_column('.fx', 'N'), result_column('.fy', 'N'), result_column('.m', 'Nm')]
    case ('friction')
      row = friction_of(m%s, merge(r%joint, m%s%permanent + m%s%acting - m%s%stops + r%stop, r%joint > 0))
      item = friction_sensor_model(constraint=row(1))
      columns = [result_column('.f', 'N'), result_column('.rate', 'm/s'), result_column('.state', '-'), &
                 result_column('.share', '-')]
      if (m%s%constraints(row(1))%item%angular) columns(1:2) = [result_column('.f', 'Nm'), result_column('.rate', 'rad/s')]
    case ('internal')
      item = section_sensor_model(first=r%element, last=r%element + r%finer - 1, along=r%along, &
                                  balanced=balanced(m%s%bodies(r%marker%body)))
      columns = [result_column('.n', 'N'), result_column('.q', 'N'), result_column('.m1', 'Nm'), result_column('.m2', 'Nm')]
      ends = [result_column('.n2', 'N'), result_column('.q2', 'N')]
      if (m%s%bodies(r%marker%body)%elements(r%element)%fibre > 0.0_wp) then
        columns = [columns, result_column('.s', 'Pa'), ends, both_fibres, result_column('.along', '-', number=.true.)]
      else
        columns = [columns, ends]
      end if
    case ('layer')
      associate (b => m%s%bodies(r%marker%body))
        associate (layer => b%layers%sections(b%layers%kinds(b%layers%kind(r%element))%section)%layers(r%layer))
          item = layer_sensor_model(first=r%element, last=r%element + r%finer - 1, layer=r%layer, core=layer%core > 0, &
                                    along=r%along, balanced=balanced(b))
          columns = [result_column('.s', 'Pa'), both_fibres, result_column('.along', '-', number=.true.)]
          if (layer%core > 0) columns = [columns(1), result_column('.tau', 'Pa'), columns(2:), result_column('.tau1', 'Pa'), &
                                         result_column('.tau2', 'Pa')]
        end associate
      end associate
    case ('slip')
      call slip%find(m%s%bodies(r%marker%body), r%marker%node)
      item = slip
      allocate (columns(size(slip%entry)))
      do k = 1, size(columns)
        columns(k) = result_column('.g'//to_text(k), 'rad')
      end do
    case ('power')
      power%source = source_of(m%s, r)
      item = power
      columns = [result_column('', 'W')]
    case ('work')
      item = work_sensor_model(integral=findloc(m%s%integrated%sensor, number, 1))
      columns = [result_column('', 'J')]
    case ('stress')
      item = stress_sensor_model(balanced=balanced(m%s%bodies(r%marker%body)))
      columns = [result_column('.s', 'Pa'), result_column('.element', '-', number=.true.), &
                 result_column('.node', '-', number=.true.), result_column('.along', '-', number=.true.), both_fibres]
    case ('energy')
      item = energy_sensor_model(integral=findloc(m%s%integrated%sensor, number, 1), layer=r%layer)
      columns = [result_column('.strain', 'J'), result_column('.dissipated', 'J')]
      if (r%layer == 0) columns = [result_column('.kinetic', 'J'), columns]
    case ('stop')
      item = stop_sensor_model(element=m%s%switching(r%stop))
      columns = [result_column('.f', 'N'), result_column('.gap', 'm'), result_column('.state', '-')]
      if (m%s%forces(m%s%switching(r%stop))%item%angular) columns(1:2) = [result_column('.f', 'Nm'), result_column('.gap', 'rad')]
    case ('contact')
      allocate (contact)
      contact%direction = r%direction
      if (r%modulus > 0.0_wp) contact%hardness = r%modulus/r%width
      if (r%joint > 0) then
        call contact%of(m%s%constraints(r%joint)%item%measures(1)%item)
        contact%row = m%s%constraints(r%joint)%item%first
      else
        contact%stop%element = m%s%switching(r%stop)
        call contact%of(m%s%forces(contact%stop%element)%item%measure)
      end if
      columns = [result_column('.f', 'N'), result_column('.gap', 'm'), result_column('.x', 'm'), result_column('.y', 'm'), &
                 result_column('.angle', 'rad'), result_column('.p', 'Pa')]
      if (.not. r%modulus > 0.0_wp) columns = columns(:5)
      call move_alloc(contact, item)
    case ('controller')
      item = controller_sensor_model(controller=r%controller)
      columns = [result_column('.out', '-'), result_column('.error', unit_of(m%s%controllers(r%controller)%quantity)), &
                 result_column('.limited', '-')]
    case ('spring')
      item = spring_sensor_model(element=r%spring)
      columns = [result_column('.f', 'N'), result_column('.d', 'm')]
      if (m%s%forces(r%spring)%item%angular) columns = [result_column('.f', 'Nm'), result_column('.d', 'rad')]
    case default                                   ! all others are quantities of motion
      associate (suffixes => motion_suffixes(r%quantity))
        allocate (quantities)
        allocate (quantities%columns(size(suffixes)), columns(size(suffixes)))
        do k = 1, size(suffixes)
          call make_quantity(d, m%s, r, k, markers, quantities%columns(k)%item)
          columns(k) = result_column(suffixes(k), unit_of(quantities%columns(k)%item))
        end do
      end associate
      call move_alloc(quantities, item)
    end select
  end subroutine make_sensor

  !> Unit of a quantity of motion.
  pure function unit_of(q) result(unit)
    class(measure_model), intent(in) :: q
    character(:), allocatable :: unit
    unit = either('rad', 'm', q%angular)//either('/s', '', q%rate)
  end function unit_of

  !> Values of all columns at an evaluated state (m holds the accelerations and multipliers of that state).
  subroutine read_sensors(list, m, ev, y, values)
    type(sensor_list), intent(inout), target :: list
    type(mechanism_model), intent(in), target :: m
    type(evaluation), intent(in), target :: ev
    real(wp), intent(in), contiguous, target :: y(:)  !! state [m, rad] and per second
    real(wp), intent(out), contiguous :: values(:)    !! (columns) [their units]
    integer :: k, b, i, j, n
    do k = 1, size(list%markers)
      b = list%markers(k)%body
      if (b > 0) then
        i = m%s%qo(b)
        j = m%s%nq + i
        n = m%s%bodies(b)%nf
        call one_marker(list%markers(k), ev%frame%cos(b), ev%frame%sin(b), y(i + 1:i + 3), y(j + 1:j + 3), n, &
                        y(i + 4:i + 3 + n), y(j + 4:j + 3 + n), list%p, k)
      else
        list%p%r(:, k) = list%markers(k)%x
      end if
    end do
    do k = 1, size(list%sensors)
      call list%sensors(k)%item%read(observation(m, ev, list%markers, list%p, y), values(list%first(k):))
    end do
  end subroutine read_sensors

  !> Amplitudes of all columns for a harmonic motion. m holds the evaluation of the present state; list has read it.
  subroutine read_linear_sensors(list, m, ev, y, motion, values)
    type(sensor_list), intent(in), target :: list
    type(mechanism_model), intent(in), target :: m
    type(evaluation), intent(in), target :: ev
    real(wp), intent(in), contiguous, target :: y(:)   !! present state [m, rad] and per second
    type(harmonic_motion), intent(in) :: motion
    complex(wp), intent(out) :: values(:)         !! (columns) [their units]
    integer :: k
    do k = 1, size(list%sensors)
      call list%sensors(k)%item%respond(observation(m, ev, list%markers, list%p, y), motion, values(list%first(k):))
    end do
  end subroutine read_linear_sensors
end module sensors
