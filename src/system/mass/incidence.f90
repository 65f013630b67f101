!> The sides of constraint rows on moving bodies, grouped by body: two sides of one body couple their rows through it. Their
!> pairs are the graph by which the multipliers' matrix S = Phi_q M^-1 Phi_q^T is ordered, and each has its entry of S.
module incidence
  use kinds, only: wp
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: collect_incidence

contains

  !> Lists the sides of all rows, body by body, orders the joint graph and finds the entries of S.
  subroutine collect_incidence(self)
    type(mechanism_model), intent(inout) :: self
    call count_sides(self)
    call list_sides(self)
    call order_rows(self)
    call find_entries(self)
  end subroutine collect_incidence

  !> First side of each body.
  pure subroutine count_sides(self)
    type(mechanism_model), intent(inout) :: self
    integer :: k, side, body
    allocate (self%side_first(size(self%s%bodies) + 1), source=0)
    do k = 1, size(self%s%constraints)
      associate (c => self%s%constraints(k)%item)
        do side = 1, 2
          body = self%s%markers(merge(c%ia, c%ib, side == 1))%body
          if (body > 0) self%side_first(body + 1) = self%side_first(body + 1) + c%rows
        end do
      end associate
    end do
    self%side_first(1) = 1
    do k = 1, size(self%s%bodies)
      self%side_first(k + 1) = self%side_first(k + 1) + self%side_first(k)
    end do
  end subroutine count_sides

  !> Row, marker, body and side of every end; the sides of every row.
  pure subroutine list_sides(self)
    type(mechanism_model), intent(inout) :: self
    integer, allocatable :: fill(:)             !! next side of each body
    integer :: n, k, i, side, body, marker, e
    n = self%side_first(size(self%side_first)) - 1
    allocate (self%side_row(n), self%end_marker(n), self%side_body(n), self%side_is_a(n), self%row_marker(2, self%s%rows))
    allocate (self%side_attachment(n), self%of_row(2, self%s%rows), source=0)
    allocate (self%w(3, n), self%frame_wrench(3, n), self%g(3, n), self%rigid_wrench(3, n), source=0.0_wp)
    fill = self%side_first(1:size(self%side_first) - 1)
    do k = 1, size(self%s%constraints)
      associate (c => self%s%constraints(k)%item)
        do i = c%first, c%first + c%rows - 1
          self%row_marker(:, i) = [c%ia, c%ib]
          do side = 1, 2
            marker = self%row_marker(side, i)
            body = self%s%markers(marker)%body
            if (body == 0) cycle
            e = fill(body)
            fill(body) = e + 1
            self%side_row(e) = i
            self%end_marker(e) = marker
            self%side_body(e) = body
            self%side_is_a(e) = side == 1
            self%of_row(side, i) = e
          end do
        end do
      end associate
    end do
  end subroutine list_sides

  !> Orders S by the pairs of rows that meet on a body, and the same matrix of the frames alone.
  subroutine order_rows(self)
    type(mechanism_model), intent(inout) :: self
    integer, allocatable :: rows(:), cols(:)    !! (pairs)
    integer :: n, body, e, f
    n = 0
    do body = 1, size(self%s%bodies)
      n = n + (self%side_first(body + 1) - self%side_first(body))**2/2
    end do
    allocate (rows(n), cols(n))
    n = 0
    do body = 1, size(self%s%bodies)
      do e = self%side_first(body), self%side_first(body + 1) - 1
        do f = self%side_first(body), e - 1
          n = n + 1
          rows(n) = self%side_row(e)
          cols(n) = self%side_row(f)
        end do
      end do
    end do
    call self%schur%set_up(self%s%rows, rows(1:n), cols(1:n))
    if (any(self%flexible)) self%closing = self%schur
  end subroutine order_rows

  !> Entries of S for all pairs of sides.
  pure subroutine find_entries(self)
    type(mechanism_model), intent(inout) :: self
    integer :: n, b, e, f, i, j
    n = 0
    do b = 1, size(self%s%bodies)
      i = self%side_first(b + 1) - self%side_first(b)
      n = n + i*(i + 1)/2
    end do
    allocate (self%slot(n))
    n = 0
    do b = 1, size(self%s%bodies)
      do e = self%side_first(b), self%side_first(b + 1) - 1
        i = self%schur%position(self%side_row(e))
        do f = self%side_first(b), e
          n = n + 1
          j = self%schur%position(self%side_row(f))
          self%slot(n) = 1 + abs(i - j) + (self%schur%kd + 1)*(min(i, j) - 1)
          if (i == j .and. f < e) self%slot(n) = -self%slot(n)
        end do
      end do
    end do
  end subroutine find_entries
end module incidence
