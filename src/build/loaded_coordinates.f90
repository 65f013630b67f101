!> Elastic coordinates of a body on which the deck's joints, drives, springs and loads act: those whose static shapes a body
!> reduced to modes may keep.
module loaded_coordinates
  use body, only: body_model
  use deck_records, only: deck, marker_record
  implicit none (type, external)
  private
  public :: coordinates_under_load

contains

  !> Numbers of the coordinates: displacements of nodes that a force acts on, rotations of sections that a moment acts on.
  function coordinates_under_load(d, k, b) result(list)
    type(deck), intent(in) :: d
    integer, intent(in) :: k               !! number of the body
    type(body_model), intent(in) :: b      !! with its nodal coordinates numbered
    integer, allocatable :: list(:)
    logical :: acts(3, b%nn)               ! u, v, rotation
    integer :: i
    acts = .false.
    do i = 1, size(d%joints)
      associate (j => d%joints(i))
        call note(j%a, .true., any(j%type == [character(9) :: 'weld', 'prismatic']))
        call note(j%b, .true., any(j%type == [character(9) :: 'weld', 'prismatic', 'slider']))
      end associate
    end do
    do i = 1, size(d%drives)
      associate (j => d%drives(i))
        call note(j%a, j%type == 'position', j%type == 'rotation')
        call note(j%b, j%type == 'position', .true.)
      end associate
    end do
    do i = 1, size(d%springs)
      associate (j => d%springs(i))
        call note(j%a, j%type == 'linear', j%type == 'torsional')
        call note(j%b, j%type == 'linear', j%type == 'torsional')
      end associate
    end do
    do i = 1, size(d%forces)
      call note(d%forces(i)%marker, d%forces(i)%type /= 'torque', d%forces(i)%type == 'torque')
    end do
    list = pack(b%dof, acts .and. b%dof > 0)
  contains
    !> Notes what acts on a node of the body.
    subroutine note(marker, force, moment)
      type(marker_record), intent(in) :: marker
      logical, intent(in) :: force, moment
      if (marker%body /= k .or. marker%node == 0) return
      acts(1:2, marker%node) = acts(1:2, marker%node) .or. force
      acts(3, marker%node) = acts(3, marker%node) .or. moment
    end subroutine note
  end function coordinates_under_load
end module loaded_coordinates
