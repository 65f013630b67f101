!> Meshes of beams with elements='auto': a node wherever the deck names a place, and between them elements of nearly one length.
!> Other meshes with each element halved.
module deck_mesh
  use kinds, only: wp
  use deck_records, only: deck, marker_record
  use sorting, only: ascending
  implicit none (type, external)
  private
  public :: halve_elements, set_mesh

  integer, parameter :: collecting = 1, placing = 2, halving = 3   !! what is done with markers

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

  !> A beam's mesh with twice as many elements; all that names a node means the same place.
  subroutine halve_elements(d, b)
    type(deck), intent(inout) :: d
    integer, intent(in) :: b                   !! body
    real(wp), allocatable :: none(:)           ! [-]
    integer :: k
    associate (r => d%bodies(b))
      r%elements = 2*r%elements
      r%nodes = r%elements + 1
      r%element_material = r%element_material([((k + 1)/2, k=1, r%elements)])
      r%element_section = r%element_section([((k + 1)/2, k=1, r%elements)])
      if (allocated(r%reference_node)) r%reference_node = 2*r%reference_node - 1
    end associate
    none = [real(wp) ::]
    call visit_all(d, b, halving, none)
  end subroutine halve_elements

  !> All markers of the deck.
  subroutine visit_all(d, b, task, places)
    type(deck), intent(inout) :: d
    integer, intent(in) :: b                   !! body
    integer, intent(in) :: task
    real(wp), allocatable, intent(inout) :: places(:)   !! of the length [-]
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
          if (task == halving .and. marker%node > 0) marker%node = 2*marker%node - 1
          if (task == halving .or. marker%share < 0.0_wp) cycle
          if (task == collecting) places = [places, marker%share]
          if (task == placing) marker%node = minloc(abs(d%bodies(b)%stations - marker%share), 1)
        end associate
      end do
    end subroutine visit
  end subroutine visit_all
end module deck_mesh
