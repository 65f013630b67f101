!> The ends of constraint rows on moving bodies, grouped by body: two ends of one body couple their rows through it. Their
!> pairs are the graph by which the multipliers' matrix S = Phi_q M^-1 Phi_q^T is ordered, and each has its entry of S.
module row_ends
  use kinds, only: wp
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: collect_ends

contains

  !> Lists the ends of all rows, body by body, orders the joint graph and finds the entries of S.
  subroutine collect_ends(self)
    type(mechanism_model), intent(inout) :: self
    call count_ends(self)
    call list_ends(self)
    call order_rows(self)
    call find_slots(self)
  end subroutine collect_ends

  !> First end of each body.
  pure subroutine count_ends(self)
    type(mechanism_model), intent(inout) :: self
    integer :: k, side, body
    allocate (self%end_first(size(self%s%bodies) + 1), source=0)
    do k = 1, size(self%s%constraints)
      associate (c => self%s%constraints(k)%item)
        do side = 1, 2
          body = self%s%places(merge(c%ia, c%ib, side == 1))%body
          if (body > 0) self%end_first(body + 1) = self%end_first(body + 1) + c%rows
        end do
      end associate
    end do
    self%end_first(1) = 1
    do k = 1, size(self%s%bodies)
      self%end_first(k + 1) = self%end_first(k + 1) + self%end_first(k)
    end do
  end subroutine count_ends

  !> Row, place, body and side of every end; the ends of every row.
  pure subroutine list_ends(self)
    type(mechanism_model), intent(inout) :: self
    integer, allocatable :: fill(:)             !! next end of each body
    integer :: n, k, i, side, body, place, e
    n = self%end_first(size(self%end_first)) - 1
    allocate (self%end_row(n), self%end_place(n), self%end_body(n), self%end_is_a(n), self%row_place(2, self%s%rows))
    allocate (self%end_local(n), self%of_row(2, self%s%rows), source=0)
    allocate (self%w(3, n), self%jw(3, n), self%g(3, n), self%lever(3, n), source=0.0_wp)
    fill = self%end_first(1:size(self%end_first) - 1)
    do k = 1, size(self%s%constraints)
      associate (c => self%s%constraints(k)%item)
        do i = c%first, c%first + c%rows - 1
          self%row_place(:, i) = [c%ia, c%ib]
          do side = 1, 2
            place = self%row_place(side, i)
            body = self%s%places(place)%body
            if (body == 0) cycle
            e = fill(body)
            fill(body) = e + 1
            self%end_row(e) = i
            self%end_place(e) = place
            self%end_body(e) = body
            self%end_is_a(e) = side == 1
            self%of_row(side, i) = e
          end do
        end do
      end associate
    end do
  end subroutine list_ends

  !> Orders S by the pairs of rows that meet on a body, and the same matrix of the frames alone.
  subroutine order_rows(self)
    type(mechanism_model), intent(inout) :: self
    integer, allocatable :: rows(:), cols(:)    !! (pairs)
    integer :: n, body, e, f
    n = 0
    do body = 1, size(self%s%bodies)
      n = n + (self%end_first(body + 1) - self%end_first(body))**2/2
    end do
    allocate (rows(n), cols(n))
    n = 0
    do body = 1, size(self%s%bodies)
      do e = self%end_first(body), self%end_first(body + 1) - 1
        do f = self%end_first(body), e - 1
          n = n + 1
          rows(n) = self%end_row(e)
          cols(n) = self%end_row(f)
        end do
      end do
    end do
    call self%schur%set_up(self%s%rows, rows(1:n), cols(1:n))
    if (any(self%flexible)) self%closing = self%schur
  end subroutine order_rows

  !> Entries of S for all pairs of ends.
  pure subroutine find_slots(self)
    type(mechanism_model), intent(inout) :: self
    integer :: n, b, e, f, i, j
    n = 0
    do b = 1, size(self%s%bodies)
      i = self%end_first(b + 1) - self%end_first(b)
      n = n + i*(i + 1)/2
    end do
    allocate (self%slot(n))
    n = 0
    do b = 1, size(self%s%bodies)
      do e = self%end_first(b), self%end_first(b + 1) - 1
        i = self%schur%position(self%end_row(e))
        do f = self%end_first(b), e
          n = n + 1
          j = self%schur%position(self%end_row(f))
          self%slot(n) = 1 + abs(i - j) + (self%schur%kd + 1)*(min(i, j) - 1)
          if (i == j .and. f < e) self%slot(n) = -self%slot(n)
        end do
      end do
    end do
  end subroutine find_slots
end module row_ends
