!> Where the joints, drives, springs and loads of a deck act, and by what: each kind says whether by forces or by a moment.
module acting_markers
  use body, only: body_model
  use deck_records, only: deck, marker_record
  use scene_model, only: scene
  implicit none (type, external)
  private
  public :: list_markers, list_acting, coordinates_under_load

  !> A marker of the deck, and what acts on it.
  type, public :: acting_marker
    type(marker_record) :: marker
    logical :: acts(3) = .false.           !! on x, on y, on the section angle
  end type acting_marker

contains

  !> (3, n) markers a and b of all joints and drives, then of all springs, loads and stops; the one marker of a load stands twice.
  !> The third one is the carrier of a gear.
  pure function list_markers(d) result(list)
    type(deck), intent(in) :: d
    type(marker_record), allocatable :: list(:, :)
    allocate (list(3, size(d%joints) + size(d%drives) + size(d%springs) + size(d%forces) + size(d%stops)))
    list(1, :) = [d%joints%a, d%drives%a, d%springs%a, d%forces%marker, d%stops%a]
    list(2, :) = [d%joints%b, d%drives%b, d%springs%b, d%forces%marker, d%stops%b]
    list(3, :size(d%joints)) = d%joints%c
  end function list_markers

  !> The same with what acts on them.
  pure function list_acting(d, s) result(list)
    type(deck), intent(in) :: d
    type(scene), intent(in) :: s           !! its joints, drives, springs and loads are made
    type(acting_marker), allocatable :: list(:, :)
    integer :: k, n
    n = s%permanent
    allocate (list(3, n + s%acting))
    list%marker = list_markers(d)
    do k = 1, n
      call set_acts(list(:, k), s%constraints(k)%item%acts_on())
      if (k <= size(d%joints)) list(3, k)%acts(3) = d%joints(k)%type == 'gear'
    end do
    do k = n + 1, size(s%constraints)
      associate (c => s%constraints(k)%item)
        call set_acts(list(:, c%parent), c%acts_on())
      end associate
    end do
    do k = 1, s%acting
      call set_acts(list(:, n + k), s%forces(k)%item%acts)
    end do
  end function list_acting

  !> Adds what acts on markers a and b.
  pure subroutine set_acts(pair, acts)
    type(acting_marker), intent(inout) :: pair(:)
    logical, intent(in) :: acts(6)
    pair(1)%acts = pair(1)%acts .or. acts(1:3)
    pair(2)%acts = pair(2)%acts .or. acts(4:6)
  end subroutine set_acts

  !> Numbers of the elastic coordinates of a body on which something acts: forces on displacements, moments on rotations. A body
  !> reduced to modes may keep their static shapes.
  pure function coordinates_under_load(acting, k, b) result(list)
    type(acting_marker), intent(in) :: acting(:, :)
    integer, intent(in) :: k               !! number of the body
    type(body_model), intent(in) :: b      !! with its nodal coordinates numbered
    integer, allocatable :: list(:)
    logical :: acts(3, b%nn)               ! u, v, rotation
    integer :: i, side
    acts = .false.
    do i = 1, size(acting, 2)
      do side = 1, 3
        associate (at => acting(side, i)%marker, on => acting(side, i)%acts)
          if (at%body /= k .or. at%node == 0) cycle
          acts(1:2, at%node) = acts(1:2, at%node) .or. any(on(1:2))     ! one global axis lies along both axes of a turned body
          acts(3, at%node) = acts(3, at%node) .or. on(3)
        end associate
      end do
    end do
    list = pack(b%dof(:3, :), acts .and. b%dof(:3, :) > 0)
  end function coordinates_under_load
end module acting_markers
