!> Meshes of beams with another number of elements.
module deck_mesh
  use kinds, only: wp
  use deck_records, only: deck, marker_record
  implicit none (type, external)
  private
  public :: set_elements

contains

  !> A beam's mesh with another number of elements of one length; all that names a node names the nearest one then.
  !> A sensor of an element sees all that stand for it, in a mesh with a multiple of the elements.
  subroutine set_elements(d, b, elements)
    type(deck), intent(inout) :: d
    integer, intent(in) :: b                   !! body
    integer, intent(in) :: elements
    integer :: k, before(elements)             ! the element that had the middle of each one
    real(wp) :: ratio                          ! of the numbers of elements [-]
    associate (r => d%bodies(b))
      before = [(1 + (2*k - 1)*r%elements/(2*elements), k=1, elements)]
      r%element_material = r%element_material(before)
      r%element_section = r%element_section(before)
      ratio = real(elements, wp)/r%elements
      r%elements = elements
      r%nodes = elements + 1
      if (allocated(r%reference_node)) r%reference_node = nearest_node(r%reference_node, ratio)
      where (r%slip_held > 0) r%slip_held = nearest_node(r%slip_held, ratio)
    end associate
    call renumber(d%lumps%marker, b, ratio)
    call renumber(d%joints%a, b, ratio)
    call renumber(d%joints%b, b, ratio)
    call renumber(d%joints%c, b, ratio)
    call renumber(d%drives%a, b, ratio)
    call renumber(d%drives%b, b, ratio)
    call renumber(d%springs%a, b, ratio)
    call renumber(d%springs%b, b, ratio)
    call renumber(d%forces%marker, b, ratio)
    call renumber(d%stops%a, b, ratio)
    call renumber(d%stops%b, b, ratio)
    call renumber(d%sensors%marker, b, ratio)
    call renumber(d%sensors%other, b, ratio)
    do k = 1, size(d%sensors)
      associate (s => d%sensors(k))
        if (s%marker%body /= b .or. s%element == 0) cycle
        s%finer = nint(ratio)*s%finer
        s%element = 1 + (s%element - 1)*nint(ratio)
      end associate
    end do
  end subroutine set_elements

  !> Gives the markers on a body their nodes in another mesh of it.
  elemental subroutine renumber(marker, b, ratio)
    type(marker_record), intent(inout) :: marker
    integer, intent(in) :: b                   !! body
    real(wp), intent(in) :: ratio              !! of the numbers of elements [-]
    if (marker%body == b .and. marker%node > 0) marker%node = nearest_node(marker%node, ratio)
  end subroutine renumber

  !> The node nearest to another one in a mesh with a multiple of its elements.
  elemental integer function nearest_node(node, ratio) result(next)
    integer, intent(in) :: node                !! of the other mesh
    real(wp), intent(in) :: ratio              !! of the numbers of elements [-]
    next = 1 + nint((node - 1)*ratio)
  end function nearest_node
end module deck_mesh
