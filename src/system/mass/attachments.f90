!> The places where constraints act on flexible bodies: what a unit force there does to the body's elastic coordinates,
!> columns m_ff^-1 E_k^T, and the compliances E_i m_ff^-1 E_j^T between the places (theory.md, section 7). All constant.
module attachments
  use kinds, only: wp
  use banded, only: band_solve
  use body, only: body_model
  use mechanism, only: mechanism_model, flexible_attachments
  use place, only: place_model
  implicit none (type, external)
  private
  public :: attach_places

contains

  !> Attachments of every flexible body.
  subroutine attach_places(self)
    type(mechanism_model), intent(inout) :: self
    logical, allocatable :: acts(:, :)           !! (3, places) whether constraints act on u, v and the rotation of a place
    integer, allocatable :: local(:)
    integer :: k, b
    allocate (local(size(self%s%places)), source=0)
    allocate (acts(3, size(self%s%places)), source=.false.)
    do k = 1, size(self%s%constraints)
      associate (c => self%s%constraints(k)%item)
        if (c%moves()) acts(1:2, [c%ia, c%ib]) = .true.
        if (c%turns_a()) acts(3, c%ia) = .true.
        if (c%turns_b()) acts(3, c%ib) = .true.
      end associate
    end do
    do b = 1, size(self%s%bodies)
      if (.not. self%s%bodies(b)%flexible) cycle
      call list_places(self, b, local)
      associate (at => self%attached(b), bo => self%s%bodies(b))
        call number_columns(self%s%places(at%place), acts(:, at%place), bo%modal, at%column)
        call fill_columns(self%s%places(at%place), bo, at)
        call fill_compliances(self%s%places(at%place), bo, at)
      end associate
    end do
  end subroutine attach_places

  !> Lists the places at the ends of rows on one body, each once, and the number of each end's place in that list.
  pure subroutine list_places(self, b, local)
    type(mechanism_model), intent(inout) :: self
    integer, intent(in) :: b
    integer, intent(inout) :: local(:)           !! work space: zero on the places of this body
    integer :: k, n, e
    n = 0
    do e = self%end_first(b), self%end_first(b + 1) - 1
      k = self%end_place(e)
      if (local(k) == 0) then
        n = n + 1
        local(k) = n
      end if
      self%end_local(e) = local(k)
    end do
    allocate (self%attached(b)%place(n))
    do e = self%end_first(b), self%end_first(b + 1) - 1
      self%attached(b)%place(self%end_local(e)) = self%end_place(e)
    end do
  end subroutine list_places

  !> Numbers the columns that are needed: where a constraint acts on a coordinate that the body has.
  pure subroutine number_columns(places, acts, modal, column)
    type(place_model), intent(in) :: places(:)   !! (na) attached places of one body
    logical, intent(in) :: acts(:, :)            !! (3, na)
    logical, intent(in) :: modal                 !! the body has modal coordinates
    integer, allocatable, intent(out) :: column(:, :)   !! (3, na) 0: none needed
    integer :: i, c, nc
    allocate (column(3, size(places)), source=0)
    nc = 0
    do i = 1, size(places)
      do c = 1, 3
        if (modal) then
          if (.not. allocated(places(i)%psi)) cycle
        else
          if (places(i)%dof(c) == 0) cycle
        end if
        if (.not. acts(c, i)) cycle
        nc = nc + 1
        column(c, i) = nc
      end do
    end do
  end subroutine number_columns

  !> The columns m_ff^-1 E_k^T.
  subroutine fill_columns(places, bo, at)
    type(place_model), intent(in) :: places(:)   !! (na) attached places of the body
    type(body_model), intent(inout) :: bo        !! its factor's work space changes
    type(flexible_attachments), intent(inout) :: at
    integer :: i, c, nc
    nc = max(0, maxval(at%column))
    allocate (at%columns(bo%nf, nc), at%load(nc), source=0.0_wp)
    do i = 1, size(places)
      do c = 1, 3
        if (at%column(c, i) == 0) cycle
        associate (x => at%columns(:, at%column(c, i)))
          if (bo%modal) then
            x = places(i)%psi(c, :)
          else
            x(places(i)%dof(c)) = 1.0_wp
            call band_solve(bo%mff, x)
          end if
        end associate
      end do
    end do
  end subroutine fill_columns

  !> Compliances between the places, E_k m_ff^-1 S-bar^T, and room for what an evaluation fills in.
  pure subroutine fill_compliances(places, bo, at)
    type(place_model), intent(in) :: places(:)   !! (na) attached places of the body
    type(body_model), intent(in) :: bo
    type(flexible_attachments), intent(inout) :: at
    integer :: n, i, j, c
    n = size(places)
    allocate (at%compliance(3, 3, n, n), at%ep(3, 2, n), at%ex(3, n), at%ey(3, n), source=0.0_wp)
    do i = 1, n
      at%ep(:, 1, i) = places(i)%elastic(bo%pmat(:, 1))
      at%ep(:, 2, i) = places(i)%elastic(bo%pmat(:, 2))
      do j = 1, n
        do c = 1, 3
          if (at%column(c, j) > 0) at%compliance(:, c, i, j) = places(i)%elastic(at%columns(:, at%column(c, j)))
        end do
      end do
    end do
  end subroutine fill_compliances
end module attachments
