!> Where the deck's joints, drives, springs and loads act, and whether by a force, by a moment, or by both.
module acting_markers
  use body, only: body_model
  use deck_records, only: deck, marker_record
  implicit none (type, external)
  private
  public :: list_acting, coordinates_under_load

  !> A marker of the deck and what acts on it.
  type, public :: acting_marker
    type(marker_record) :: marker
    logical :: force = .false., moment = .false.
  end type acting_marker

contains

  !> The markers of all joints, drives, springs and loads.
  function list_acting(d) result(list)
    type(deck), intent(in) :: d
    type(acting_marker), allocatable :: list(:)
    integer :: k, n
    allocate (list(2*(size(d%joints) + size(d%drives) + size(d%springs)) + size(d%forces)))
    n = 0
    do k = 1, size(d%joints)
      associate (j => d%joints(k))
        call add(j%a, .true., any(j%type == [character(9) :: 'weld', 'prismatic']))
        call add(j%b, .true., any(j%type == [character(9) :: 'weld', 'prismatic', 'slider']))
      end associate
    end do
    do k = 1, size(d%drives)
      call add(d%drives(k)%a, d%drives(k)%type == 'position', d%drives(k)%type == 'rotation')
      call add(d%drives(k)%b, d%drives(k)%type == 'position', .true.)
    end do
    do k = 1, size(d%springs)
      call add(d%springs(k)%a, d%springs(k)%type == 'linear', d%springs(k)%type == 'torsional')
      call add(d%springs(k)%b, d%springs(k)%type == 'linear', d%springs(k)%type == 'torsional')
    end do
    do k = 1, size(d%forces)
      call add(d%forces(k)%marker, d%forces(k)%type /= 'torque', d%forces(k)%type == 'torque')
    end do
  contains
    !> Adds a marker.
    subroutine add(marker, force, moment)
      type(marker_record), intent(in) :: marker
      logical, intent(in) :: force, moment
      n = n + 1
      list(n) = acting_marker(marker, force, moment)
    end subroutine add
  end function list_acting

  !> Numbers of the elastic coordinates of a body on which something acts: forces on displacements, moments on rotations. A body
  !> reduced to modes may keep their static shapes.
  function coordinates_under_load(d, k, b) result(list)
    type(deck), intent(in) :: d
    integer, intent(in) :: k               !! number of the body
    type(body_model), intent(in) :: b      !! with its nodal coordinates numbered
    integer, allocatable :: list(:)
    type(acting_marker), allocatable :: acting(:)
    logical :: acts(3, b%nn)               ! u, v, rotation
    integer :: i
    acting = list_acting(d)
    acts = .false.
    do i = 1, size(acting)
      associate (at => acting(i)%marker)
        if (at%body /= k .or. at%node == 0) cycle
        acts(:, at%node) = acts(:, at%node) .or. [acting(i)%force, acting(i)%force, acting(i)%moment]
      end associate
    end do
    list = pack(b%dof, acts .and. b%dof > 0)
  end function coordinates_under_load
end module acting_markers
