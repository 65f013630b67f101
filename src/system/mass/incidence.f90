!> The sides of constraint rows on moving bodies, grouped by body: two sides of one body couple their rows through it. Their
!> pairs are the graph by which the multipliers' matrix S = Phi_q M^-1 Phi_q^T is ordered, and each has its entry of S.
module incidence
  use mechanism, only: mechanism_model
  use multipliers, only: multiplier_system
  implicit none (type, external)
  private
  public :: collect_incidence

contains

  !> Lists the sides of all rows, body by body, orders the joint graph and finds the entries of S.
  subroutine collect_incidence(self, schur)
    type(mechanism_model), intent(inout) :: self
    type(multiplier_system), intent(out) :: schur
    call count_sides(self)
    call list_sides(self)
    call order_rows(self, schur)
  end subroutine collect_incidence

  !> First side of each body.
  pure subroutine count_sides(self)
    type(mechanism_model), intent(inout) :: self
    integer :: k, side, body
    allocate (self%incidence%first(size(self%s%bodies) + 1), source=0)
    do k = 1, size(self%s%constraints)
      associate (c => self%s%constraints(k)%item)
        do side = 1, 2
          body = self%s%markers(merge(c%ia, c%ib, side == 1))%body
          if (body > 0) self%incidence%first(body + 1) = self%incidence%first(body + 1) + c%rows
        end do
      end associate
    end do
    self%incidence%first(1) = 1
    do k = 1, size(self%s%bodies)
      self%incidence%first(k + 1) = self%incidence%first(k + 1) + self%incidence%first(k)
    end do
  end subroutine count_sides

  !> Row, marker and body of every side; the sides of every row.
  pure subroutine list_sides(self)
    type(mechanism_model), intent(inout) :: self
    integer, allocatable :: fill(:)             !! next side of each body
    integer :: n, k, i, side, body, marker, e
    n = self%incidence%first(size(self%incidence%first)) - 1
    allocate (self%incidence%row(n), self%incidence%marker(n), self%incidence%body(n), self%incidence%is_a(n), &
              self%incidence%row_marker(2, self%s%rows))
    allocate (self%incidence%attachment(n), self%incidence%of_row(2, self%s%rows), source=0)
    fill = self%incidence%first(1:size(self%incidence%first) - 1)
    do k = 1, size(self%s%constraints)
      associate (c => self%s%constraints(k)%item)
        do i = c%first, c%first + c%rows - 1
          self%incidence%row_marker(:, i) = [c%ia, c%ib]
          do side = 1, 2
            marker = self%incidence%row_marker(side, i)
            body = self%s%markers(marker)%body
            if (body == 0) cycle
            e = fill(body)
            fill(body) = e + 1
            self%incidence%row(e) = i
            self%incidence%marker(e) = marker
            self%incidence%body(e) = body
            self%incidence%is_a(e) = side == 1
            self%incidence%of_row(side, i) = e
          end do
        end do
      end associate
    end do
  end subroutine list_sides

  !> Orders S by the pairs of rows that meet on a body, and finds the entry of each pair of sides, themselves included.
  subroutine order_rows(self, schur)
    type(mechanism_model), intent(inout) :: self
    type(multiplier_system), intent(inout) :: schur
    integer, allocatable :: rows(:), cols(:)    !! (pairs)
    logical, allocatable :: same(:)             !! (pairs) a side with itself
    integer :: n, b, e, f, i, j
    associate (at => self%incidence)
      n = sum([((at%first(b + 1) - at%first(b))*(at%first(b + 1) - at%first(b) + 1)/2, b=1, size(self%s%bodies))])
      allocate (rows(n), cols(n), same(n), at%entry(n))
      n = 0
      do b = 1, size(self%s%bodies)
        do e = at%first(b), at%first(b + 1) - 1
          do f = at%first(b), e
            n = n + 1
            rows(n) = at%row(e)
            cols(n) = at%row(f)
            same(n) = e == f
          end do
        end do
      end do
      call schur%set_up(self%s%rows, pack(rows, .not. same), pack(cols, .not. same))
      do n = 1, size(rows)
        i = schur%position(rows(n))
        j = schur%position(cols(n))
        at%entry(n) = 1 + abs(i - j) + (schur%kd + 1)*(min(i, j) - 1)
        if (i == j .and. .not. same(n)) at%entry(n) = -at%entry(n)
      end do
    end associate
  end subroutine order_rows
end module incidence
