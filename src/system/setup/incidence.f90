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
    integer, allocatable :: others(:)
    integer :: k, i, row
    associate (at => self%incidence)
      call at%begin(3*self%s%rows)
      call at%add_constraints(self%s)
      call at%sort(size(self%s%bodies))
      allocate (at%row_marker(2, self%s%rows))
      allocate (at%with_carrier(0), at%carrier(0), at%places(0), at%angles(0), others(0), at%datum(self%s%rows))
      do k = 1, size(self%s%constraints)
        associate (c => self%s%constraints(k)%item)
          do i = 1, c%rows
            row = c%first + i - 1
            at%row_marker(:, row) = [c%ia, c%ib]
            at%datum(row) = c%measures(i)%item%datum
            if (.not. c%is_plain(i)) then
              others = [others, k, i]
            else if (c%measures(i)%item%angular) then
              at%angles = [at%angles, row]
            else
              at%places = [at%places, row]
            end if
          end do
          if (c%ic > 0) then
            at%with_carrier = [at%with_carrier, c%first]
            at%carrier = [at%carrier, c%ic]
          end if
        end associate
      end do
      at%others = reshape(others, [2, size(others)/2])
    end associate
    call order_rows(self, schur)
  end subroutine collect_incidence

  !> Orders S by the pairs of rows that meet on a body, and finds the entry of each pair of sides, themselves included.
  subroutine order_rows(self, schur)
    type(mechanism_model), intent(inout) :: self
    type(multiplier_system), intent(inout) :: schur
    integer, allocatable :: rows(:), cols(:)    !! (pairs)
    logical, allocatable :: same(:)             !! (pairs) a side with itself
    integer :: n, b, e, f
    associate (at => self%incidence)
      n = sum([((at%first(b + 1) - at%first(b))*(at%first(b + 1) - at%first(b) + 1)/2, b=1, size(self%s%bodies))])
      allocate (rows(n), cols(n), same(n))
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
      call schur%set_up(self%s%rows, rows, cols, same)
    end associate
  end subroutine order_rows
end module incidence
