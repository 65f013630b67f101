!> The one place that turns deck records into a scene of the model.
module build_scene
  use kinds, only: wp, pi
  use errors, only: fault_list
  use deck_records, only: deck, place_record, joint_record, drive_record, history_record, force_record, spring_record
  use build_bodies, only: build_body
  use body, only: body_model
  use body_setup, only: body_length
  use constraint, only: constraint_model
  use distance_joint, only: distance_model
  use history, only: history_function, corner, fit_table, kind_polynomial, kind_sine, kind_ramp, kind_cycloid, &
                     kind_table, kind_pulse
  use line_joint, only: line_model
  use load, only: load_model, axes_global, axes_body, axes_section, stage_all, stage_static, stage_transient, &
                  load_force, load_torque, load_about
  use pin_joint, only: pin_model
  use place, only: place_model
  use rotation_drive, only: rotation_model
  use scene_model, only: scene
  use spring, only: spring_model
  implicit none (type, external)
  private
  public :: build, make_place, make_history

  !> Places found so far, body by body, so that each is kept once.
  type :: place_table
    type(place_model), allocatable :: items(:)
    integer, allocatable :: next(:)        !! next place of the same body, 0: none
    integer, allocatable :: head(:)        !! (0:nb) first place of each body
    integer :: count = 0
  end type place_table

contains

  !> Builds the scene of a deck. Where faults are added the scene must not be used.
  subroutine build(d, s, faults)
    type(deck), intent(in) :: d
    type(scene), intent(out) :: s
    type(fault_list), intent(inout) :: faults
    type(place_table) :: places
    integer :: most
    s%title = d%scene%title
    s%gravity = d%scene%gravity
    call build_all_bodies(d, s, faults)
    if (faults%count > 0) return
    most = 2*(size(d%joints) + size(d%drives) + size(d%springs)) + size(d%forces)
    allocate (places%items(most))
    allocate (places%next(most), places%head(0:size(s%bodies)), source=0)
    s%size = scene_size(d, s)
    call build_constraints(d, s, places, faults)
    call build_springs(d, s, places)
    call build_loads(d, s, places)
    s%places = places%items(1:places%count)
    call list_loaded(s)
    call number_unknowns(d, s)
  end subroutine build

  !> Bodies with their lumps.
  subroutine build_all_bodies(d, s, faults)
    type(deck), intent(in) :: d
    type(scene), intent(inout) :: s
    type(fault_list), intent(inout) :: faults
    integer, allocatable :: first(:), list(:), fill(:)
    integer :: k, nb
    nb = size(d%bodies)
    allocate (s%bodies(nb), first(nb + 1), list(size(d%lumps)), fill(nb))
    first = 0
    do k = 1, size(d%lumps)
      first(d%lumps(k)%place%body + 1) = first(d%lumps(k)%place%body + 1) + 1
    end do
    first(1) = 1
    do k = 1, nb
      first(k + 1) = first(k + 1) + first(k)
    end do
    fill = first(1:nb)
    do k = 1, size(d%lumps)
      list(fill(d%lumps(k)%place%body)) = k
      fill(d%lumps(k)%place%body) = fill(d%lumps(k)%place%body) + 1
    end do
    do k = 1, nb
      call build_body(d, k, list(first(k):first(k + 1) - 1), s%bodies(k), faults)
    end do
  end subroutine build_all_bodies

  !> A place of the model from a deck's place.
  function make_place(s, r) result(p)
    type(scene), intent(in) :: s
    type(place_record), intent(in) :: r
    type(place_model) :: p
    p%body = r%body
    p%node = r%node
    p%x = r%point
    if (r%node == 0 .or. r%body == 0) return
    associate (b => s%bodies(r%body))
      p%x = b%x(:, r%node)
      if (.not. b%flexible) return
      if (b%modal) then
        p%psi = b%psi(3*r%node - 2:3*r%node, :)
      else
        p%dof = b%dof(:, r%node)
      end if
    end associate
  end function make_place

  !> Index of a place, added where it is new.
  integer function find_place(s, places, r) result(k)
    type(scene), intent(in) :: s
    type(place_table), intent(inout) :: places
    type(place_record), intent(in) :: r
    k = places%head(r%body)
    do while (k > 0)
      if (places%items(k)%node == r%node) then
        if (r%node > 0) return
        if (all(abs(places%items(k)%x - r%point) <= 0.0_wp)) return
      end if
      k = places%next(k)
    end do
    places%count = places%count + 1
    k = places%count
    places%items(k) = make_place(s, r)
    places%next(k) = places%head(r%body)
    places%head(r%body) = k
  end function find_place

  !> The scene's size S: the largest distance between two places, nodes or mass centres of one body, or between two
  !> places on the ground (deck.md). Frames on which drives, torques and torsional springs act are not places.
  function scene_size(d, s) result(size_s)
    type(deck), intent(in) :: d
    type(scene), intent(in) :: s
    real(wp) :: size_s                      !! [m]
    real(wp), allocatable :: points(:, :)   !! (2, n) points of one body [m]
    type(place_record), allocatable :: list(:)
    integer, allocatable :: first(:), sorted(:)
    integer :: b, k, n
    call list_points(d, list)
    call sort_by_body(list%body, size(s%bodies), first, sorted)
    size_s = 0.0_wp
    do b = 0, size(s%bodies)
      n = first(b + 1) - first(b)
      allocate (points(2, n + 1))
      do k = 1, n
        points(:, k) = list(sorted(first(b) + k - 1))%point
      end do
      if (b > 0) then
        points(:, n + 1) = s%bodies(b)%i1/s%bodies(b)%mass
        size_s = max(size_s, body_length(reshape([s%bodies(b)%x, points], [2, s%bodies(b)%nn + n + 1])))
      else
        size_s = max(size_s, body_length(points(:, 1:n)))
      end if
      deallocate (points)
    end do
    if (size_s > 0.0_wp) return
    size_s = maxval(sqrt(s%bodies%i11/s%bodies%mass))     ! one body held at its mass centre: radius of gyration
    if (.not. size_s > 0.0_wp) size_s = 1.0_wp
  end function scene_size

  !> All places that are points, nodes left out (bodies know their nodes).
  subroutine list_points(d, list)
    type(deck), intent(in) :: d
    type(place_record), allocatable, intent(out) :: list(:)
    integer :: k, n
    allocate (list(2*(size(d%joints) + size(d%drives) + size(d%springs)) + size(d%forces) + size(d%sensors)))
    n = 0
    do k = 1, size(d%joints)
      call put(d%joints(k)%a)
      call put(d%joints(k)%b)
    end do
    do k = 1, size(d%drives)
      if (d%drives(k)%type == 'rotation') cycle
      call put(d%drives(k)%a)
      call put(d%drives(k)%b)
    end do
    do k = 1, size(d%springs)
      if (d%springs(k)%type == 'torsional') cycle
      call put(d%springs(k)%a)
      call put(d%springs(k)%b)
    end do
    do k = 1, size(d%forces)
      if (d%forces(k)%type /= 'torque') call put(d%forces(k)%place)
    end do
    do k = 1, size(d%sensors)
      if (any(d%sensors(k)%quantity == [character(12) :: 'position', 'velocity', 'acceleration'])) &
        call put(d%sensors(k)%place)
    end do
    list = list(1:n)
  contains
    !> Adds a place that is a point.
    subroutine put(place)
      type(place_record), intent(in) :: place
      if (place%node > 0) return
      n = n + 1
      list(n) = place
    end subroutine put
  end subroutine list_points

  !> Numbers of the entries of each body (0: the ground), body after body.
  pure subroutine sort_by_body(body, nb, first, sorted)
    integer, intent(in) :: body(:), nb
    integer, allocatable, intent(out) :: first(:)    !! (0:nb+1) first entry of each body in sorted
    integer, allocatable, intent(out) :: sorted(:)
    integer, allocatable :: fill(:)
    integer :: k
    allocate (first(0:nb + 1), source=0)
    allocate (sorted(size(body)))
    do k = 1, size(body)
      first(body(k) + 1) = first(body(k) + 1) + 1
    end do
    first(0) = 1
    do k = 1, nb + 1
      first(k) = first(k) + first(k - 1)
    end do
    allocate (fill(0:nb), source=first(0:nb))
    do k = 1, size(body)
      sorted(fill(body(k))) = k
      fill(body(k)) = fill(body(k)) + 1
    end do
  end subroutine sort_by_body

  !> Joints, then drives, with their rows numbered.
  subroutine build_constraints(d, s, places, faults)
    type(deck), intent(in) :: d
    type(scene), intent(inout) :: s
    type(place_table), intent(inout) :: places
    type(fault_list), intent(inout) :: faults
    integer :: k, n
    s%joints = size(d%joints)
    allocate (s%constraints(size(d%joints) + size(d%drives)))
    do k = 1, size(s%constraints)
      if (k <= s%joints) then
        call make_joint(d, d%joints(k), s%constraints(k)%item)
        call find_ends(d%joints(k)%a, d%joints(k)%b, s%constraints(k)%item)
      else
        n = k - s%joints
        call make_drive(d, d%drives(n), s%constraints(k)%item, faults)
        call find_ends(d%drives(n)%a, d%drives(n)%b, s%constraints(k)%item)
      end if
      s%constraints(k)%item%first = s%rows + 1
      s%constraints(k)%item%size = s%size
      s%rows = s%rows + s%constraints(k)%item%rows
    end do
  contains
    !> Places of both ends.
    subroutine find_ends(a, b, c)
      type(place_record), intent(in) :: a, b
      class(constraint_model), intent(inout) :: c
      c%ia = find_place(s, places, a)
      c%ib = find_place(s, places, b)
    end subroutine find_ends
  end subroutine build_constraints

  !> The factory of joints: the deck's word into the kind.
  subroutine make_joint(d, r, item)
    type(deck), intent(in) :: d
    type(joint_record), intent(in) :: r
    class(constraint_model), allocatable, intent(out) :: item
    type(pin_model) :: pin
    type(line_model) :: line
    type(distance_model) :: distance
    select case (r%type)
    case ('revolute', 'weld')
      pin%name = r%name
      pin%welded = r%type == 'weld'
      pin%rows = merge(3, 2, pin%welded)
      pin%angle = deck_angle(d, r%a%body) - deck_angle(d, r%b%body)
      allocate (item, source=pin)
    case ('slider', 'prismatic')
      line%name = r%name
      line%prismatic = r%type == 'prismatic'
      line%rows = merge(2, 1, line%prismatic)
      line%direction = r%direction + pi/2
      line%angle = deck_angle(d, r%a%body) - deck_angle(d, r%b%body)
      allocate (item, source=line)
    case default
      distance%name = r%name
      distance%rows = 1
      distance%length = r%length
      distance%pending = .not. r%has_length
      allocate (item, source=distance)
    end select
  end subroutine make_joint

  !> Angle of a body in the deck, 0 for the ground [rad].
  pure function deck_angle(d, k) result(angle)
    type(deck), intent(in) :: d
    integer, intent(in) :: k
    real(wp) :: angle
    angle = 0.0_wp
    if (k > 0) angle = d%bodies(k)%angle
  end function deck_angle

  !> The factory of drives.
  subroutine make_drive(d, r, item, faults)
    type(deck), intent(in) :: d
    type(drive_record), intent(in) :: r
    class(constraint_model), allocatable, intent(out) :: item
    type(fault_list), intent(inout) :: faults
    type(rotation_model) :: rotation
    type(line_model) :: line
    type(history_function) :: h
    call make_history(d%histories(r%history), h)
    call check_smooth(d, r, h, faults)
    if (r%type == 'rotation') then
      rotation%name = r%name
      rotation%rows = 1
      rotation%drive = .true.
      rotation%rate = r%rate
      rotation%target = h
      allocate (item, source=rotation)
    else
      line%name = r%name
      line%rows = 1
      line%drive = .true.
      line%rate = r%rate
      line%target = h
      line%direction = r%direction
      allocate (item, source=line)
    end if
  end subroutine make_drive

  !> A drive cannot follow a jump, nor a jump of slope where the quantity itself is driven.
  subroutine check_smooth(d, r, h, faults)
    type(deck), intent(in) :: d
    type(drive_record), intent(in) :: r
    type(history_function), intent(in) :: h
    type(fault_list), intent(inout) :: faults
    type(corner), allocatable :: corners(:)
    character(24) :: text
    real(wp) :: until
    integer :: k
    corners = h%corners()
    until = huge(1.0_wp)
    if (d%transient%present) until = d%transient%t_end
    do k = 1, size(corners)
      if (corners(k)%time <= 0.0_wp .or. corners(k)%time >= until) cycle
      if (corners(k)%order > merge(0, 1, r%rate)) cycle
      write (text, '(es12.5)') corners(k)%time
      call faults%add(r%at%file, r%at%line, 'drive/'//trim(r%name), 'history "'//trim(h%name)//'" has a jump'// &
                      merge(' of slope', '         ', corners(k)%order == 1)//' at t = '//trim(adjustl(text))// &
                      ' s, which no mechanism can follow; expected a history with continuous '// &
                      merge('values          ', 'value and slope ', r%rate))
    end do
  end subroutine check_smooth

  !> A history of the model from its record.
  subroutine make_history(r, h)
    type(history_record), intent(in) :: r
    type(history_function), intent(out) :: h
    h%name = r%name
    h%start = r%start
    h%finish = r%finish
    h%v0 = r%start_value
    h%v1 = r%end_value
    select case (r%kind)
    case ('polynomial')
      h%kind = kind_polynomial
      h%c = r%coefficients
    case ('sine')
      h%kind = kind_sine
      h%offset = r%offset
      h%amplitude = r%amplitude
      h%omega = 2*pi*r%frequency
      h%phase = r%phase
    case ('ramp')
      h%kind = kind_ramp
    case ('cycloid')
      h%kind = kind_cycloid
    case ('table')
      h%kind = kind_table
      h%t = r%time
      h%y = r%values
      call fit_table(h)
    case default
      h%kind = kind_pulse
      h%v1 = r%value
    end select
  end subroutine make_history

  !> Springs.
  subroutine build_springs(d, s, places)
    type(deck), intent(in) :: d
    type(scene), intent(inout) :: s
    type(place_table), intent(inout) :: places
    integer :: k
    allocate (s%springs(size(d%springs)))
    do k = 1, size(d%springs)
      associate (r => d%springs(k), sp => s%springs(k))
        sp%name = r%name
        sp%torsional = r%type == 'torsional'
        sp%stiffness = r%stiffness
        sp%damping = r%damping
        sp%free = r%free
        sp%pending = .not. r%has_free
        sp%alpha = r%ghm_alpha
        sp%zeta = r%ghm_zeta
        sp%omega = r%ghm_omega
        sp%ia = find_place(s, places, r%a)
        sp%ib = find_place(s, places, r%b)
      end associate
    end do
  end subroutine build_springs

  !> Loads.
  subroutine build_loads(d, s, places)
    type(deck), intent(in) :: d
    type(scene), intent(inout) :: s
    type(place_table), intent(inout) :: places
    integer :: k
    allocate (s%loads(size(d%forces)))
    do k = 1, size(d%forces)
      call fill_load(d, d%forces(k), s%loads(k))
      s%loads(k)%place = find_place(s, places, d%forces(k)%place)
    end do
  end subroutine build_loads

  !> One load without its place.
  subroutine fill_load(d, r, l)
    type(deck), intent(in) :: d
    type(force_record), intent(in) :: r
    type(load_model), intent(inout) :: l
    l%name = r%name
    l%f = [r%fx, r%fy]
    l%moment = r%moment
    l%centre = r%centre
    l%timed = r%history > 0
    if (l%timed) call make_history(d%histories(r%history), l%factor)
    select case (r%type)
    case ('force')
      l%kind = load_force
    case ('torque')
      l%kind = load_torque
    case default
      l%kind = load_about
    end select
    l%axes = axes_global
    if (r%axes == 'body') l%axes = axes_body
    if (r%axes == 'section') l%axes = axes_section
    l%stage = stage_all
    if (r%stage == 'static') l%stage = stage_static
    if (r%stage == 'transient') l%stage = stage_transient
  end subroutine fill_load

  !> Places on bodies where springs and loads act, sorted by body.
  subroutine list_loaded(s)
    type(scene), intent(inout) :: s
    logical, allocatable :: acts(:)
    integer :: k, nb, b
    integer, allocatable :: fill(:)
    nb = size(s%bodies)
    allocate (acts(size(s%places)), source=.false.)
    do k = 1, size(s%springs)
      acts([s%springs(k)%ia, s%springs(k)%ib]) = .true.
    end do
    do k = 1, size(s%loads)
      acts(s%loads(k)%place) = .true.
    end do
    allocate (s%loaded_first(nb + 1), fill(nb))
    s%loaded_first = 0
    do k = 1, size(acts)
      b = s%places(k)%body
      if (acts(k) .and. b > 0) s%loaded_first(b + 1) = s%loaded_first(b + 1) + 1
    end do
    s%loaded_first(1) = 1
    do b = 1, nb
      s%loaded_first(b + 1) = s%loaded_first(b + 1) + s%loaded_first(b)
    end do
    allocate (s%loaded(s%loaded_first(nb + 1) - 1))
    fill = s%loaded_first(1:nb)
    do k = 1, size(acts)
      b = s%places(k)%body
      if (.not. acts(k) .or. b == 0) cycle
      s%loaded(fill(b)) = k
      fill(b) = fill(b) + 1
    end do
  end subroutine list_loaded

  !> Offsets of all unknowns, and the deck's own start.
  subroutine number_unknowns(d, s)
    type(deck), intent(in) :: d
    type(scene), intent(inout) :: s
    integer :: k, i
    allocate (s%qo(size(s%bodies)), s%zo(size(s%bodies)))
    do k = 1, size(s%bodies)
      s%qo(k) = s%nq
      s%zo(k) = s%nz
      s%nq = s%nq + 3 + s%bodies(k)%nf
      s%nz = s%nz + s%bodies(k)%nz
    end do
    do k = 1, size(s%springs)
      s%springs(k)%offset = s%nz
      s%nz = s%nz + size(s%springs(k)%alpha)
    end do
    s%ny = 2*s%nq + 2*s%nz + 2
    allocate (s%q0(s%nq), s%v0(s%nq), source=0.0_wp)
    allocate (s%stated(s%nq), source=.false.)
    do k = 1, size(s%bodies)
      i = s%qo(k)
      associate (r => d%bodies(k))
        s%q0(i + 1:i + 3) = [r%position, r%angle]
        s%v0(i + 1:i + 3) = [r%velocity, r%angular_velocity]
        s%stated(i + 1:i + 2) = r%velocity_stated
        s%stated(i + 3) = r%angular_velocity_stated
      end associate
    end do
  end subroutine number_unknowns
end module build_scene
