!> The sides of rows on moving bodies, body by body, and the markers of flexible bodies where rows act: once for the constraint rows
!> of the mass solve and for all rows of an implicit step.
module row_sides
  use sorting, only: sort_by_number
  use scene_model, only: scene
  implicit none (type, external)
  private

  integer, parameter, public :: side_a = -1, side_b = -2, side_c = -3   !! kinds of side: of constraint rows; others: positive

  !> Sides, while they are collected in the order in which they come.
  type, public :: side_list
    integer :: sides = 0
    integer, allocatable :: first(:)            !! (nb+1) first side of each body
    integer, allocatable :: row(:)              !! (sides) row
    integer, allocatable :: body(:)             !! (sides) body
    integer, allocatable :: marker(:)           !! (sides) marker
    integer, allocatable :: kind(:)             !! (sides) side_a, side_b, side_c; other rows: component of the marker
    logical, allocatable :: acts(:, :)          !! (3, sides) components of the marker, in body axes, that the row may see
    integer, allocatable :: attachment(:)       !! (sides) the marker's number among those attached to the body (flexible bodies)
  contains
    procedure :: begin
    procedure :: add
    procedure :: add_constraints
    procedure :: sort
    procedure :: attach
  end type side_list

  !> The markers of a flexible body where rows act, and the columns of an inverse elastic matrix that they need.
  type, public :: attached_markers
    integer, allocatable :: marker(:)           !! (na) in the scene's list
    integer, allocatable :: column(:, :)        !! (3, na) column of each marker's u, v, rotation, 0: none needed
    integer, allocatable :: owner(:), component(:)   !! (nc) of each column: number of its marker (1 to na), u, v or rotation
  end type attached_markers

contains

  !> Room for sides.
  subroutine begin(self, most)
    class(side_list), intent(inout) :: self
    integer, intent(in) :: most                 !! sides
    allocate (self%row(most), self%body(most), self%marker(most), self%kind(most), self%acts(3, most))
  end subroutine begin

  !> Adds one side, unless its marker is on the ground.
  subroutine add(self, s, marker, row, kind, acts)
    class(side_list), intent(inout) :: self
    type(scene), intent(in) :: s
    integer, intent(in) :: marker, row, kind
    logical, intent(in) :: acts(3)              !! on x, y, section angle: what acts along one global axis acts along both of a body
    if (s%markers(marker)%body == 0) return
    self%sides = self%sides + 1
    self%row(self%sides) = row
    self%body(self%sides) = s%markers(marker)%body
    self%marker(self%sides) = marker
    self%kind(self%sides) = kind
    self%acts(:, self%sides) = [any(acts(1:2)), any(acts(1:2)), acts(3)]
  end subroutine add

  !> Adds the sides of all constraint rows.
  subroutine add_constraints(self, s)
    class(side_list), intent(inout) :: self
    type(scene), intent(in) :: s
    logical :: acts(6)
    integer :: k, i
    do k = 1, size(s%constraints)
      associate (c => s%constraints(k)%item)
        acts = c%acts_on()
        do i = c%first, c%first + c%rows - 1
          call self%add(s, c%ia, i, side_a, acts(1:3))
          call self%add(s, c%ib, i, side_b, acts(4:6))
          if (c%ic > 0) call self%add(s, c%ic, i, side_c, [.false., .false., .true.])
        end do
      end associate
    end do
  end subroutine add_constraints

  !> Sorts the sides by body.
  subroutine sort(self, bodies)
    class(side_list), intent(inout) :: self
    integer, intent(in) :: bodies
    integer, allocatable :: first(:), sorted(:)
    call sort_by_number(self%body(1:self%sides), bodies, first, sorted)
    self%first = first(1:bodies + 1)
    self%row = self%row(sorted)
    self%body = self%body(sorted)
    self%marker = self%marker(sorted)
    self%kind = self%kind(sorted)
    self%acts = self%acts(:, sorted)
    allocate (self%attachment(self%sides), source=0)
  end subroutine sort

  !> Lists the markers of the sides on one flexible body, each once, and the columns that are needed: where a row acts on a
  !> component that the body moves.
  subroutine attach(self, s, b, local, at)
    class(side_list), intent(inout) :: self
    type(scene), intent(in) :: s
    integer, intent(in) :: b                    !! body
    integer, intent(inout) :: local(:)          !! (markers) work space: zero on the markers of this body
    class(attached_markers), intent(inout) :: at
    logical, allocatable :: needed(:, :)        !! (3, na)
    integer :: e, i, c, na
    na = 0
    do e = self%first(b), self%first(b + 1) - 1
      if (local(self%marker(e)) == 0) then
        na = na + 1
        local(self%marker(e)) = na
      end if
      self%attachment(e) = local(self%marker(e))
    end do
    allocate (at%marker(na))
    allocate (at%column(3, na), source=0)
    allocate (needed(3, na), source=.false.)
    do e = self%first(b), self%first(b + 1) - 1
      i = self%attachment(e)
      at%marker(i) = self%marker(e)
      needed(:, i) = needed(:, i) .or. self%acts(:, e)
    end do
    do i = 1, na
      do c = 1, 3
        needed(c, i) = needed(c, i) .and. s%markers(at%marker(i))%moves(c)
      end do
    end do
    at%owner = pack(spread([(i, i=1, na)], 1, 3), needed)
    at%component = pack(spread([1, 2, 3], 2, na), needed)
    do i = 1, size(at%owner)
      at%column(at%component(i), at%owner(i)) = i
    end do
  end subroutine attach
end module row_sides
