!> Meshes of beams with elements='auto': a node wherever the deck names a place, and between them elements of nearly one length.
module deck_mesh
  use kinds, only: wp
  use deck_records, only: deck, marker_record
  use sorting, only: ascending
  implicit none (type, external)
  private
  public :: set_mesh

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
    logical :: placing
    places = [0.0_wp, 1.0_wp]
    placing = .false.
    call visit_all()
    places = places(ascending(places))
    places = [places(1), pack(places(2:), places(2:) - places(:size(places) - 1) > same)]
    longest = maxval(places(2:) - places(:size(places) - 1))
    associate (r => d%bodies(b))
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
    placing = .true.
    call visit_all()
  contains
    !> All markers of the deck.
    subroutine visit_all()
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
    end subroutine visit_all

    !> Collects the places of some markers, or gives the markers their nodes.
    subroutine visit(markers)
      type(marker_record), intent(inout) :: markers(:)
      integer :: i
      do i = 1, size(markers)
        if (markers(i)%body /= b .or. markers(i)%share < 0.0_wp) cycle
        if (placing) then
          markers(i)%node = minloc(abs(d%bodies(b)%stations - markers(i)%share), 1)
        else
          places = [places, markers(i)%share]
        end if
      end do
    end subroutine visit
  end subroutine set_mesh
end module deck_mesh
