!> Meshes of beams with elements='auto': a node wherever the deck names a place, and between them elements of nearly one length.
!> Other meshes with another number of elements.
module deck_mesh
  use kinds, only: wp
  use deck_records, only: deck, marker_record
  use sorting, only: ascending
  implicit none (type, external)
  private
  public :: set_elements, set_mesh

  integer, parameter :: collecting = 1, placing = 2, renumbering = 3   !! what is done with markers

contains

  !> Meshes a body with elements no longer than a part of the longest way between two places, and gives each marker its node.
  subroutine set_mesh(d, b, level)
    type(deck), intent(inout) :: d
    integer, intent(in) :: b                   !! body
    integer, intent(in) :: level               !! elements of that way
    real(wp), allocatable :: places(:)         ! of the length [-]
    real(wp) :: longest                        ! of the length [-]
    real(wp), parameter :: same = 1.0e-9_wp    ! places closer than that are one [-]
    integer :: k, j, n, last
    places = [0.0_wp, 1.0_wp]
    call visit_all(d, b, collecting, places)
    places = places(ascending(places))
    places = [places(1), pack(places(2:), places(2:) - places(:size(places) - 1) > same)]
    longest = maxval(places(2:) - places(:size(places) - 1))
    associate (r => d%bodies(b))
      r%mesh_level = level
      last = r%nodes
      r%stations = [0.0_wp]
      do k = 2, size(places)
        n = ceiling((places(k) - places(k - 1))/longest*level - same)
        r%stations = [r%stations, (places(k - 1) + (places(k) - places(k - 1))*real(j, wp)/n, j=1, n)]
      end do
      r%nodes = size(r%stations)
      r%elements = r%nodes - 1
      r%element_material = spread(r%element_material(1), 1, r%elements)
      r%element_section = spread(r%element_section(1), 1, r%elements)
      if (allocated(r%reference_node)) then
        where (r%reference_node == last) r%reference_node = r%nodes
      end if
    end associate
    call visit_all(d, b, placing, places)
  end subroutine set_mesh

  !> A beam's mesh with another number of elements of one length; all that names a node names the nearest one then.
  subroutine set_elements(d, b, elements)
    type(deck), intent(inout) :: d
    integer, intent(in) :: b                   !! body
    integer, intent(in) :: elements
    real(wp), allocatable :: none(:)           ! [-]
    integer :: k, before(elements)             ! the element that had the middle of each one
    real(wp) :: ratio                          ! [-]
    associate (r => d%bodies(b))
      before = [(1 + (2*k - 1)*r%elements/(2*elements), k=1, elements)]
      r%element_material = r%element_material(before)
      r%element_section = r%element_section(before)
      ratio = real(elements, wp)/r%elements
      r%elements = elements
      r%nodes = elements + 1
      if (allocated(r%reference_node)) r%reference_node = nearest_node(r%reference_node, ratio)
    end associate
    none = [real(wp) ::]
    call visit_all(d, b, renumbering, none, ratio)
  end subroutine set_elements

  !> The node nearest to another one in a mesh with a multiple of its elements.
  elemental integer function nearest_node(node, ratio) result(next)
    integer, intent(in) :: node                !! of the other mesh
    real(wp), intent(in) :: ratio              !! of the numbers of elements [-]
    next = 1 + nint((node - 1)*ratio)
  end function nearest_node

  !> All markers of the deck.
  subroutine visit_all(d, b, task, places, ratio)
    type(deck), intent(inout) :: d
    integer, intent(in) :: b                   !! body
    integer, intent(in) :: task
    real(wp), allocatable, intent(inout) :: places(:)   !! of the length [-]
    real(wp), intent(in), optional :: ratio    !! of the numbers of elements [-]
    call visit(d%lumps%marker)
    call visit(d%joints%a)
    call visit(d%joints%b)
    call visit(d%joints%c)
    call visit(d%drives%a)
    call visit(d%drives%b)
    call visit(d%springs%a)
    call visit(d%springs%b)
    call visit(d%forces%marker)
    call visit(d%stops%a)
    call visit(d%stops%b)
    call visit(d%sensors%marker)
    call visit(d%sensors%other)
  contains
    !> Collects the places of some markers, or gives the markers their nodes.
    subroutine visit(markers)
      type(marker_record), intent(inout) :: markers(:)
      integer :: i
      do i = 1, size(markers)
        associate (marker => markers(i))
          if (marker%body /= b) cycle
          if (task == renumbering .and. marker%node > 0) marker%node = nearest_node(marker%node, ratio)
          if (task == renumbering .or. marker%share < 0.0_wp) cycle
          if (task == collecting) places = [places, marker%share]
          if (task == placing) marker%node = minloc(abs(d%bodies(b)%stations - marker%share), 1)
        end associate
      end do
    end subroutine visit
  end subroutine visit_all
end module deck_mesh
