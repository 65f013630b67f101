!> Sensors: columns of history.txt from one evaluated, projected state (input/README.md, &sensor).
module sensors
  use kinds, only: wp
  use deck_records, only: deck, sensor_record
  use dynamics, only: one_place
  use build_places, only: make_place
  use beam_element, only: deformation_matrix
  use body, only: body_model
  use mechanism, only: mechanism_model
  use place, only: place_model, place_states, turn
  implicit none (type, external)
  private
  public :: sensor_list, set_up_sensors, read_sensors

  !> All sensors of a scene.
  type :: sensor_list
    type(sensor_record), allocatable :: records(:)
    type(place_model), allocatable :: places(:)     !! of each sensor
    integer, allocatable :: first(:)                !! first column of each sensor
    integer :: columns = 0
    character(80), allocatable :: names(:)          !! name[unit] of each column
    type(place_states) :: p
  end type sensor_list

contains

  !> Columns of every sensor of the deck.
  subroutine set_up_sensors(d, m, list)
    type(deck), intent(in) :: d
    type(mechanism_model), intent(in) :: m
    type(sensor_list), intent(out) :: list
    character(20), allocatable :: suffix(:)
    integer :: k, j, n
    n = size(d%sensors)
    list%records = d%sensors
    allocate (list%places(n), list%first(n), list%names(4*n))
    call list%p%allocate(n)
    do k = 1, n
      list%first(k) = list%columns + 1
      list%places(k) = make_place(m%s, d%sensors(k)%place)
      call suffixes(d, m, d%sensors(k), suffix)
      if (list%columns + size(suffix) > size(list%names)) list%names = [list%names, list%names]
      do j = 1, size(suffix)
        list%columns = list%columns + 1
        list%names(list%columns) = trim(d%sensors(k)%name)//suffix(j)
      end do
    end do
  end subroutine set_up_sensors

  !> Suffixes with units of the columns of one sensor.
  subroutine suffixes(d, m, r, list)
    type(deck), intent(in) :: d
    type(mechanism_model), intent(in) :: m
    type(sensor_record), intent(in) :: r
    character(20), allocatable, intent(out) :: list(:)
    select case (r%quantity)
    case ('position')
      list = [character(20) :: '.x[m]', '.y[m]']
    case ('velocity')
      list = [character(20) :: '.x[m/s]', '.y[m/s]']
    case ('acceleration')
      list = [character(20) :: '.x[m/s2]', '.y[m/s2]']
    case ('angle')
      list = [character(20) :: '[rad]']
    case ('angular_velocity')
      list = [character(20) :: '[rad/s]']
    case ('angular_acceleration')
      list = [character(20) :: '[rad/s2]']
    case ('deflection')
      list = [character(20) :: '.u[m]', '.v[m]', '.r[rad]']
    case ('coordinate')
      list = coordinate_units(m%s%bodies(r%place%body), r%index)
    case ('reaction')
      list = [character(20) :: '.fx[N]', '.fy[N]', '.m[Nm]']
    case ('internal')
      list = [character(20) :: '.n[N]', '.q[N]', '.m1[Nm]', '.m2[Nm]']
      if (m%s%bodies(r%place%body)%fibre(r%element) > 0.0_wp) list = [list, [character(20) :: '.s[Pa]']]
    case default
      if (d%springs(r%spring)%type == 'torsional') then
        list = [character(20) :: '.f[Nm]', '.d[rad]']
      else
        list = [character(20) :: '.f[N]', '.d[m]']
      end if
    end select
  end subroutine suffixes

  !> Units of an elastic coordinate: metres, radians, or modal.
  function coordinate_units(b, index) result(list)
    type(body_model), intent(in) :: b
    integer, intent(in) :: index
    character(20), allocatable :: list(:)
    if (b%modal) then
      list = [character(20) :: '.q[kg^.5*m]', '.qd[kg^.5*m/s]', '.qdd[kg^.5*m/s2]']
    else if (any(b%dof(3, :) == index)) then
      list = [character(20) :: '.q[rad]', '.qd[rad/s]', '.qdd[rad/s2]']
    else
      list = [character(20) :: '.q[m]', '.qd[m/s]', '.qdd[m/s2]']
    end if
  end function coordinate_units

  !> Values of all columns at an evaluated state (m holds the accelerations and multipliers of that state).
  subroutine read_sensors(list, m, q, v, z, values)
    type(sensor_list), intent(inout) :: list
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in), contiguous :: q(:), v(:)    !! (nq) positions [m, rad] and rates [m/s, rad/s]
    real(wp), intent(in), contiguous :: z(:)          !! (nz) dissipative coordinates [m, rad]
    real(wp), intent(out), contiguous :: values(:)        !! (columns) [unit of each column]
    integer :: k, b, i, n
    do k = 1, size(list%records)
      associate (r => list%records(k), x => values(list%first(k):))
        b = r%place%body
        if (b > 0) then
          i = m%s%qo(b)
          n = m%s%bodies(b)%nf
          call one_place(list%places(k), m%c(b), m%sn(b), q(i + 1:i + 3), v(i + 1:i + 3), n, &
                         q(i + 4:i + 3 + n), v(i + 4:i + 3 + n), list%p, k)
        else
          list%p%r(:, k) = list%places(k)%x
        end if
        call read_one(list, k, m, q, v, z, x)
      end associate
    end do
  end subroutine read_sensors

  !> Columns of one sensor.
  subroutine read_one(list, k, m, q, v, z, x)
    type(sensor_list), intent(in) :: list
    integer, intent(in) :: k
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in) :: q(:), v(:), z(:)   !! as in read_sensors [m, rad], [m/s, rad/s]
    real(wp), intent(inout) :: x(:)            !! the sensor's columns [unit of each column]
    real(wp) :: u(3)
    integer :: i, b
    associate (r => list%records(k))
      b = r%place%body
      select case (r%quantity)
      case ('position')
        x(1:2) = list%p%r(:, k)
      case ('velocity')
        x(1:2) = list%p%v(:, k)
      case ('acceleration')
        x(1:2) = point_acceleration(list, k, m)
      case ('angle')
        x(1) = list%p%angle(k)
      case ('angular_velocity')
        x(1) = list%p%rate(k)
      case ('angular_acceleration')
        u = elastic_part(list%places(k), m, b, m%a)
        x(1) = u(3)
        if (b > 0) x(1) = x(1) + m%a(m%s%qo(b) + 3)
      case ('deflection')
        x(1:3) = elastic_part(list%places(k), m, b, q)
      case ('coordinate')
        i = m%s%qo(b) + 3 + r%index
        x(1:3) = [q(i), v(i), m%a(i)]
      case ('reaction')
        x(1:3) = reaction(m, merge(r%joint, m%s%joints + r%drive, r%joint > 0))
      case ('internal')
        call section_forces(m%s%bodies(b), r%element, q(m%s%qo(b) + 4:m%s%qo(b) + 3 + m%s%bodies(b)%nf), &
                            v(m%s%qo(b) + 4:m%s%qo(b) + 3 + m%s%bodies(b)%nf), z, x)
      case default
        x(1) = m%action(r%spring)%force
        x(2) = spring_deformation(m, r%spring)
      end select
    end associate
  end subroutine read_one

  !> Elastic part (u, v, rotation) of a vector of coordinates or accelerations at a place.
  pure function elastic_part(place, m, b, q) result(u)
    type(place_model), intent(in) :: place
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: b
    real(wp), intent(in) :: q(:)              !! (nq) [m, rad] or their accelerations
    real(wp) :: u(3)
    integer :: i
    u = 0.0_wp
    if (b == 0 .or. place%node == 0) return
    i = m%s%qo(b) + 3
    u = m%s%bodies(b)%displacement(place%node, q(i + 1:i + m%s%bodies(b)%nf))
  end function elastic_part

  !> Acceleration of the material point of a sensor, global axes [m/s2].
  pure function point_acceleration(list, k, m) result(a)
    type(sensor_list), intent(in) :: list
    integer, intent(in) :: k
    type(mechanism_model), intent(in) :: m
    real(wp) :: a(2), u(3), rel(2)
    integer :: b, i
    b = list%records(k)%place%body
    a = 0.0_wp
    if (b == 0) return
    i = m%s%qo(b)
    u = elastic_part(list%places(k), m, b, m%a)
    rel = u(1:2) + m%a(i + 3)*turn(list%p%rho(:, k))
    a = m%a(i + 1:i + 2) + list%p%bias(:, k) + [m%c(b)*rel(1) - m%sn(b)*rel(2), m%sn(b)*rel(1) + m%c(b)*rel(2)]
  end function point_acceleration

  !> Force and moment (about place a) of a constraint on body a: -(gradient)^T lambda [N, N, N m].
  pure function reaction(m, k) result(f)
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: k                  !! constraint
    real(wp) :: f(3)
    integer :: i
    f = 0.0_wp
    associate (c => m%s%constraints(k)%item)
      do i = c%first, c%first + c%rows - 1
        f(1:2) = f(1:2) - m%rows%na(:, i)*m%lambda(i)
        f(3) = f(3) - m%rows%sa(i)*m%lambda(i)
      end do
    end associate
  end function reaction

  !> Deformation of a spring at the evaluated state [m] or [rad].
  pure function spring_deformation(m, k) result(d)
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: k
    real(wp) :: d, dd, e(3)
    call m%s%forces(k)%item%deformation(m%p, d, dd, e)
  end function spring_deformation

  !> N, Q and end moments of an element with its largest outer-fibre stress (input/README.md, 'internal').
  subroutine section_forces(b, e, qf, vf, z, x)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    real(wp), intent(in) :: qf(:), vf(:)      !! (nf) elastic coordinates [m, rad] and rates [m/s, rad/s]
    real(wp), intent(in) :: z(:)              !! (nz) internal variables [m, rad]
    real(wp), intent(inout) :: x(:)           !! n, q, m1, m2 [N, N m]; for sections with a shape, s [Pa]
    real(wp) :: d(3), rate(3), n, m1, m2
    associate (g => b%elements(e))
      if (b%modal) then
        d = modal_strain(b, e, qf, z)
      else
        d = 0.0_wp
        if (size(b%runs) > 0) then
          d(4 - b%nd:3) = b%ds(:, e)
        else
          d(4 - b%nd:3) = b%d(:, e)
        end if
      end if
      rate = 0.0_wp
      if (b%rayleigh) rate = g%ray_k*matmul(deformation_matrix(g), element_coordinates(b, e, vf))
      d = d + rate
      n = 0.0_wp
      if (b%axial) n = g%ea_l*d(1)
      m1 = g%ei_l*(4*d(2) + 2*d(3))
      m2 = g%ei_l*(2*d(2) + 4*d(3))
      x(1:4) = [n, -(m1 + m2)/g%length, -m1, m2]
      if (b%fibre(e) > 0.0_wp) x(5) = abs(n)/b%area(e) + max(abs(m1), abs(m2))*b%fibre(e)/b%second(e)
    end associate
  end subroutine section_forces

  !> Nodal coordinates of an element from elastic coordinates (6).
  pure function element_coordinates(b, e, qf) result(a)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e
    real(wp), intent(in) :: qf(:)   !! (nf) elastic coordinates or rates [m, rad], [m/s, rad/s]
    real(wp) :: a(6)
    a(1:3) = b%displacement(b%en(1, e), qf)
    a(4:6) = b%displacement(b%en(2, e), qf)
  end function element_coordinates

  !> Deformations of an element of a modal body with the differences of its material's terms.
  pure function modal_strain(b, e, qf, z) result(d)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e
    real(wp), intent(in) :: qf(:), z(:)   !! (nf) elastic coordinates, dissipative coordinates of the body [m, rad]
    real(wp) :: d(3)
    real(wp) :: x(size(qf))
    integer :: r, k, o
    x = qf
    do r = 1, size(b%runs)
      if (b%runs(r)%material /= b%material(e)) cycle
      do k = 1, size(b%runs(r)%law%alpha)
        o = b%runs(r)%offset + (k - 1)*b%nf
        if (k > b%runs(r)%law%second) o = b%runs(r)%first_order + (k - 1 - b%runs(r)%law%second)*b%nf
        x = x + b%runs(r)%law%alpha(k)*(qf - z(o + 1:o + b%nf))
      end do
    end do
    d = matmul(deformation_matrix(b%elements(e)), element_coordinates(b, e, x))
  end function modal_strain
end module sensors
