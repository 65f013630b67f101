!> Markers of the model from markers of the deck, each kept once; the size of a scene.
module build_markers
  use kinds, only: wp
  use acting_markers, only: acting_marker
  use body_setup, only: body_length
  use sorting, only: sort_by_number
  use deck_records, only: marker_record
  use marker, only: marker_model
  use scene_model, only: scene
  implicit none (type, external)
  private
  public :: marker_table, begin_markers, find_marker, elastic_marker, scene_size, list_loaded

  !> Markers found so far, body by body, so that each is kept once.
  type :: marker_table
    type(marker_model), allocatable :: items(:)
    integer, allocatable :: next(:)        !! next marker of the same body, 0: none
    integer, allocatable :: head(:)        !! (0:nb) first marker of each body
    integer :: count = 0
  end type marker_table

contains

  !> An empty table for the markers of so many bodies.
  pure type(marker_table) function begin_markers(bodies) result(markers)
    integer, intent(in) :: bodies
    allocate (markers%items(16))
    allocate (markers%next(16), markers%head(0:bodies), source=0)
  end function begin_markers

  !> The marker of the model for a marker of the deck.
  type(marker_model) function make_marker(s, r) result(p)
    type(scene), intent(in) :: s
    type(marker_record), intent(in) :: r
    p%body = r%body
    p%node = r%node
    p%x = r%point
    if (r%node == 0 .or. r%body == 0) return
    associate (b => s%bodies(r%body))
      p%x = b%x(:, r%node)
      if (b%flexible) call b%basis%attach(b, p)
    end associate
  end function make_marker

  !> Index of a marker, added where it is new. A moment on the frame of a body takes any marker of that frame.
  integer function find_marker(s, markers, r, moment_only) result(k)
    type(scene), intent(in) :: s
    type(marker_table), intent(inout) :: markers
    type(marker_record), intent(in) :: r
    logical, intent(in), optional :: moment_only    !! what acts there acts by a moment alone
    logical :: any_point
    any_point = .false.
    if (present(moment_only)) any_point = moment_only
    k = markers%head(r%body)
    do while (k > 0)
      if (markers%items(k)%node == r%node) then
        if (r%node > 0 .or. any_point) return
        if (all(abs(markers%items(k)%x - r%point) <= 0.0_wp)) return
      end if
      k = markers%next(k)
    end do
    k = add_marker(markers, make_marker(s, r))
    markers%next(k) = markers%head(r%body)
    markers%head(r%body) = k
  end function find_marker

  !> Index of a new marker that shows an elastic motion (`elastic_measure`): from the origin of its body it moves along x of the
  !> body by u, v or rotation of a node, or by one elastic coordinate. On a rigid body it stays there.
  integer function elastic_marker(s, markers, body, node, number) result(k)
    type(scene), intent(in) :: s
    type(marker_table), intent(inout) :: markers
    integer, intent(in) :: body, node         !! node 0: a coordinate of the body
    integer, intent(in) :: number             !! 1 to 3: u, v, rotation; or number of the coordinate
    type(marker_model) :: p, at
    p%body = body
    associate (b => s%bodies(body))
      if (b%flexible) then
        at%node = max(node, 1)
        call b%basis%attach(b, at)
        if (allocated(at%psi)) then
          allocate (p%psi(3, b%nf), source=0.0_wp)
          if (node > 0) p%psi(1, :) = at%psi(number, :)
          if (node == 0) p%psi(1, number) = 1.0_wp
        else
          p%dof(1) = number
          if (node > 0) p%dof(1) = at%dof(number)
        end if
      end if
    end associate
    k = add_marker(markers, p)
  end function elastic_marker

  !> Index of a marker that is appended to a table.
  integer function add_marker(markers, p) result(k)
    type(marker_table), intent(inout) :: markers
    type(marker_model), intent(in) :: p
    if (markers%count == size(markers%items)) then
      markers%items = [markers%items, markers%items]
      markers%next = [markers%next, markers%next]
    end if
    markers%count = markers%count + 1
    k = markers%count
    markers%items(k) = p
    markers%next(k) = 0
  end function add_marker

  !> The scene's size S: the largest distance between two markers, nodes or mass centres of one body, or between two markers on
  !> the ground. Errors are small against S. So points count only where forces act, not where moments or sensors are.
  real(wp) function scene_size(s, acting) result(size_s)   ! [m]
    type(scene), intent(in) :: s
    type(acting_marker), intent(in) :: acting(:, :)
    real(wp), allocatable :: points(:)      ! x and y of all points of one body [m]
    type(marker_record), allocatable :: list(:)
    integer, allocatable :: first(:), sorted(:)
    integer :: b, k
    list = pack(acting%marker, (acting%acts(1) .or. acting%acts(2)) .and. acting%marker%node == 0)   ! bodies have their nodes
    call sort_by_number(list%body, size(s%bodies), first, sorted)
    size_s = 0.0_wp
    do b = 0, size(s%bodies)
      points = [(list(sorted(k))%point, k=first(b), first(b + 1) - 1)]
      if (b > 0) points = [s%bodies(b)%x, s%bodies(b)%i1/s%bodies(b)%mass, points]
      size_s = max(size_s, body_length(reshape(points, [2, size(points)/2])))
    end do
    if (size_s > 0.0_wp) return
    size_s = maxval(sqrt(s%bodies%i11/s%bodies%mass))     ! one body, fixed at its mass centre: radius of gyration
    if (.not. size_s > 0.0_wp) size_s = 1.0_wp
  end function scene_size

  !> Markers on bodies where springs and loads act, sorted by body.
  subroutine list_loaded(s)
    type(scene), intent(inout) :: s
    logical, allocatable :: acts(:)
    integer, allocatable :: first(:), sorted(:)
    integer :: k
    allocate (acts(size(s%markers)), source=.false.)
    do k = 1, s%acting
      acts([s%forces(k)%item%ia, s%forces(k)%item%ib]) = .true.
    end do
    associate (active => pack([(k, k=1, size(acts))], acts))
      call sort_by_number(s%markers(active)%body, size(s%bodies), first, sorted)
      s%loaded = active(sorted(first(1):))
    end associate
    s%loaded_first = first(1:) - first(1) + 1
  end subroutine list_loaded
end module build_markers
