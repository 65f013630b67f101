!> Corrections by a condensed dynamic stiffness: from residuals to rows, then back to frames and to elastic coordinates (theory.md,
!> section 7).
module newton_correction
  use kinds, only: wp, number
  use border_rows, only: solve_rows, solve_gaps
  use condensed_system, only: condensed_matrix
  use elastic_columns, only: seen
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: take_residual, correction, row_correction

contains

  !> Takes residuals, frames' origins in global axes.
  subroutine take_residual(self, m, ev, r)
    type(condensed_matrix), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(number), intent(in) :: r(:)         !! (nq) [N, N m]
    integer :: b, i
    self%solved = .false.
    do b = 1, size(self%b)
      associate (x => self%b(b))
        i = m%s%qo(b)
        x%force(1) = ev%frame%cos(b)*r(i + 1) + ev%frame%sin(b)*r(i + 2)
        x%force(2) = ev%frame%cos(b)*r(i + 2) - ev%frame%sin(b)*r(i + 1)
        x%force(3) = r(i + 3)
        if (x%n == 0) cycle
        x%elastic = r(i + 4:i + 3 + x%n)
      end associate
    end do
  end subroutine take_residual

  !> Solves the elastic residuals with the blocks that stand, unless the tangent was condensed with them.
  subroutine solve_elastic(self)
    type(condensed_matrix), intent(inout) :: self
    integer :: b
    if (self%solved) return
    self%solved = .true.
    do b = 1, size(self%b)
      associate (x => self%b(b))
        if (x%n > 0) call x%block%solve(self%full_block, x%elastic)
      end associate
    end do
  end subroutine solve_elastic

  !> The correction dq (global axes) and that of the multipliers (rows%y), from the residuals that were taken.
  subroutine correction(self, m, ev, gap, dq, lambda)
    type(condensed_matrix), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(number), intent(in) :: gap(:)       !! (rows) what the rows are open by [m]
    real(number), intent(out) :: dq(:)       !! (nq) [m, rad]
    real(number), intent(in), optional :: lambda(:)   !! (rows) multipliers over their held values [N]
    integer :: b
    call solve_elastic(self)
    self%rows%d = 0.0_wp
    do b = 1, size(self%b)
      call free_frame(self, m, b)
    end do
    call solve_rows(self%rows, gap, lambda)
    do b = 1, size(self%b)
      call body_correction(self, m, ev, b, self%rows%y, dq)
    end do
  end subroutine correction

  !> The same without residuals, for each column of the rows' gaps.
  subroutine row_correction(self, m, ev, gap, dq, dlambda)
    type(condensed_matrix), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(number), intent(in) :: gap(:, :)    !! (rows, columns) [m] or its derivatives
    real(number), intent(out) :: dq(:, :)    !! (nq, columns) [m, rad] or theirs
    real(number), intent(out) :: dlambda(:, :)   !! (rows, columns) [N] or theirs
    integer :: b, k
    call solve_gaps(self%rows, gap)
    do b = 1, size(self%b)
      self%b(b)%free = 0.0_wp
      if (self%b(b)%n > 0) self%b(b)%elastic = 0.0_wp
      do k = 1, size(gap, 2)
        call body_correction(self, m, ev, b, self%rows%closing(:, k), dq(:, k))
      end do
    end do
    dlambda = self%rows%closing(1:size(gap, 1), 1:size(gap, 2))
  end subroutine row_correction

  !> A frame's correction without rows, and what the rows see of it.
  subroutine free_frame(self, m, b)
    type(condensed_matrix), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: b
    real(number) :: x(2), y, rc(3)
    integer :: e, k
    associate (t => self%b(b), r => self%rows)
      rc = t%force
      if (t%n > 0) then
        x = 0.0_wp
        y = 0.0_wp
        do k = 1, t%n
          x = x + m%s%bodies(b)%shape%sbar(k, :)*t%elastic(k)
          y = y + t%row(k)*t%elastic(k)
        end do
        rc(1) = rc(1) - t%origin(1)*x(1) + t%origin(2)*x(2)
        rc(2) = rc(2) - t%origin(1)*x(2) - t%origin(2)*x(1)
        rc(3) = rc(3) - y
        do k = 1, size(t%at%marker)
          t%at%exf(:, k) = seen(m%s%markers(t%at%marker(k)), t%elastic)
        end do
      end if
      do k = 1, 3
        t%free(k) = -(t%inverse(k, 1)*rc(1) + t%inverse(k, 2)*rc(2) + t%inverse(k, 3)*rc(3))
      end do
      do e = r%first(b), r%first(b + 1) - 1
        y = sum(r%frame_row(:, e)*t%free)
        if (t%n > 0) y = y - sum(r%marker_row(:, e)*t%at%exf(:, r%attachment(e)))
        r%d(r%row(e)) = r%d(r%row(e)) + y
      end do
    end associate
  end subroutine free_frame

  !> A body's part of dq.
  subroutine body_correction(self, m, ev, b, y, dq)
    type(condensed_matrix), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: b
    real(number), intent(in) :: y(:)         !! of all rows [N]
    real(number), intent(inout) :: dq(:)     !! (nq) [m, rad]
    real(number) :: x(3)
    integer :: e, i, k, c, col
    associate (t => self%b(b), r => self%rows)
      x = t%free
      if (t%n > 0) t%at%load = 0.0_wp
      do e = r%first(b), r%first(b + 1) - 1
        x = x - r%solved_column(:, e)*y(r%row(e))
        if (t%n == 0) cycle
        do c = 1, 3
          col = t%at%column(c, r%attachment(e))
          if (col > 0) t%at%load(col) = t%at%load(col) + r%marker_column(c, e)*y(r%row(e))
        end do
      end do
      i = m%s%qo(b)
      dq(i + 1) = ev%frame%cos(b)*x(1) - ev%frame%sin(b)*x(2)
      dq(i + 2) = ev%frame%sin(b)*x(1) + ev%frame%cos(b)*x(2)
      dq(i + 3) = x(3)
      if (t%n == 0) return
      x(1:2) = self%c1*x(1:2)
      do k = 1, t%n
        dq(i + 3 + k) = -t%elastic(k) - t%at%xs(k, 1)*x(1) - t%at%xs(k, 2)*x(2) - t%column(k)*x(3)
      end do
      do c = 1, size(t%at%load)
        do k = 1, t%n
          dq(i + 3 + k) = dq(i + 3 + k) - t%at%load(c)*t%at%xe(k, c)
        end do
      end do
    end associate
  end subroutine body_correction
end module newton_correction
