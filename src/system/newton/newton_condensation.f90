!> Condensation of a Newton iteration: elastic coordinates onto the frames, frames onto the rows between bodies, and the
!> correction back from rows to frames to elastic coordinates (theory.md, section 7).
module newton_condensation
  use kinds, only: wp
  use body, only: body_model
  use border_rows, only: solve_rows
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  use newton_system, only: newton_matrix, newton_body
  use marker, only: marker_model
  use small_matrices, only: invert3
  implicit none (type, external)
  private
  public :: condense_frame, condense_rows, correction, fill_columns

contains

  !> Condenses the elastic coordinates onto the frame; the inverse of the condensed frame.
  subroutine condense_frame(t, m, b, c1, bad)
    type(newton_body), intent(inout) :: t
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: b
    real(wp), intent(in) :: c1               !! [1/s2]
    logical, intent(out) :: bad
    real(wp) :: a(3, 3), x(2), rx(2), rc, y(2)
    integer :: j, k
    a = t%eq%block
    if (t%eq%n > 0) then
      do j = 1, 2
        x = c1*t%at%pss(:, j)
        a(1, j) = a(1, j) - t%eq%origin(1)*x(1) + t%eq%origin(2)*x(2)
        a(2, j) = a(2, j) - t%eq%origin(1)*x(2) - t%eq%origin(2)*x(1)
      end do
      y = 0.0_wp
      rx = 0.0_wp
      rc = 0.0_wp
      associate (body => m%s%bodies(b))
        do k = 1, t%eq%n
          y = y + body%shape%sbar(k, :)*t%eq%column(k)
          rx = rx + t%eq%row(k)*t%at%xs(k, :)
          rc = rc + t%eq%row(k)*t%eq%column(k)
        end do
      end associate
      a(1, 3) = a(1, 3) - t%eq%origin(1)*y(1) + t%eq%origin(2)*y(2)
      a(2, 3) = a(2, 3) - t%eq%origin(1)*y(2) - t%eq%origin(2)*y(1)
      a(3, 1:2) = a(3, 1:2) - c1*rx
      a(3, 3) = a(3, 3) - rc
      do j = 1, size(t%at%rxe)
        rc = 0.0_wp
        do k = 1, t%eq%n
          rc = rc + t%eq%row(k)*t%at%xe(k, j)
        end do
        t%at%rxe(j) = rc
      end do
      do j = 1, t%at%na
        t%at%exy(:, j) = m%s%markers(t%at%marker(j))%elastic(t%eq%column(1:t%eq%n))
      end do
    end if
    call invert3(a, t%inverse, bad)
  end subroutine condense_frame

  !> Sides of all rows on the condensed frames, and the rows' compliance.
  subroutine condense_rows(self, m, ev, v)
    type(newton_matrix), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: v(:)             !! (nq) rates [m/s, rad/s]
    integer :: b, e
    self%rows%s = 0.0_wp
    do b = 1, size(self%b)
      do e = self%rows%first(b), self%rows%first(b + 1) - 1
        call one_end(self, m, ev, v, b, e)
      end do
      call add_compliance(self, b)
    end do
  end subroutine condense_rows

  !> One side: row and column on marker and condensed frame.
  subroutine one_end(self, m, ev, v, b, e)
    type(newton_matrix), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: v(:)             !! (nq) [m/s, rad/s]
    integer, intent(in) :: b, e
    real(wp) :: w(3), j(3), n(2), rel(2), x(2)
    integer :: i, k, l, c, col
    associate (r => self%rows, t => self%b(b))
      i = r%row(e)
      k = r%marker(e)
      w = 0.0_wp
      n = 0.0_wp
      select case (r%kind(e))
      case (-1)
        n = ev%rows%na(:, i)
        w(3) = ev%rows%sa(i)
      case (-2)
        n = ev%rows%nb(:, i)
        w(3) = ev%rows%sb(i)
      case (1, 4)
        n(1) = 1.0_wp
      case (2, 5)
        n(2) = 1.0_wp
      case default
        w(3) = 1.0_wp
      end select
      w(1) = ev%frame%cos(b)*n(1) + ev%frame%sin(b)*n(2)
      w(2) = ev%frame%cos(b)*n(2) - ev%frame%sin(b)*n(1)
      j = [w(1), w(2), w(3) + ev%p%rho(1, k)*w(2) - ev%p%rho(2, k)*w(1)]
      r%marker_column(:, e) = w
      r%frame_column(:, e) = j
      if (r%kind(e) > 3) then                ! what turning adds to a marker's rate
        rel = ev%p%v(:, k) - v(m%s%qo(b) + 1:m%s%qo(b) + 2)
        rel = [ev%frame%cos(b)*rel(1) + ev%frame%sin(b)*rel(2), ev%frame%cos(b)*rel(2) - ev%frame%sin(b)*rel(1)]
        j = [0.0_wp, 0.0_wp, w(2)*rel(1) - w(1)*rel(2)]
        w(1:2) = v(m%s%qo(b) + 3)*[w(2), -w(1)]
        r%marker_column(:, e) = 0.0_wp
        r%frame_column(:, e) = 0.0_wp
      end if
      r%marker_row(:, e) = w
      r%frame_row(:, e) = j
      if (t%eq%n > 0) then
        l = r%local(e)
        r%frame_row(1, e) = j(1) - self%c1*dot_product(t%at%exs(:, 1, l), w)
        r%frame_row(2, e) = j(2) - self%c1*dot_product(t%at%exs(:, 2, l), w)
        r%frame_row(3, e) = j(3) - dot_product(t%at%exy(:, l), w)
        x = 0.0_wp
        do c = 1, 3
          col = t%at%column(c, l)
          if (col == 0) cycle
          x = x + t%at%sxe(:, col)*r%marker_column(c, e)
          r%frame_column(3, e) = r%frame_column(3, e) - t%at%rxe(col)*r%marker_column(c, e)
        end do
        r%frame_column(1, e) = r%frame_column(1, e) - t%eq%origin(1)*x(1) + t%eq%origin(2)*x(2)
        r%frame_column(2, e) = r%frame_column(2, e) - t%eq%origin(1)*x(2) - t%eq%origin(2)*x(1)
      end if
      do c = 1, 3
        r%solved_column(c, e) = t%inverse(c, 1)*r%frame_column(1, e) + t%inverse(c, 2)*r%frame_column(2, e) &
                                + t%inverse(c, 3)*r%frame_column(3, e)
      end do
    end associate
  end subroutine one_end

  !> One body's part of the rows' compliance.
  subroutine add_compliance(self, b)
    type(newton_matrix), intent(inout) :: self
    integer, intent(in) :: b
    real(wp) :: x
    integer :: e, f, i, j, c
    associate (r => self%rows, t => self%b(b))
      do e = r%first(b), r%first(b + 1) - 1
        i = r%position(r%row(e))
        do f = r%first(b), r%first(b + 1) - 1
          if (r%kind(f) > 3) cycle
          x = r%frame_row(1, e)*r%solved_column(1, f) + r%frame_row(2, e)*r%solved_column(2, f) &
              + r%frame_row(3, e)*r%solved_column(3, f)
          if (t%eq%n > 0) then
            do c = 1, 3
              x = x + r%marker_column(c, f)*(r%marker_row(1, e)*t%at%compliance(1, c, r%local(e), r%local(f)) &
                                  + r%marker_row(2, e)*t%at%compliance(2, c, r%local(e), r%local(f)) &
                                  + r%marker_row(3, e)*t%at%compliance(3, c, r%local(e), r%local(f)))
            end do
          end if
          j = r%position(r%row(f))
          r%s(j - i, i) = r%s(j - i, i) + x
        end do
      end do
    end associate
  end subroutine add_compliance

  !> The correction dq (global axes) and that of the multipliers (rows%y), from solved elastic residuals.
  subroutine correction(self, m, ev, gap, dq)
    type(newton_matrix), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: gap(:)           !! (rows) what the rows are open by [m]
    real(wp), intent(out) :: dq(:)           !! (nq) [m, rad]
    integer :: b
    self%rows%d = 0.0_wp
    do b = 1, size(self%b)
      call free_frame(self, m, b)
    end do
    call solve_rows(self%rows, gap)
    do b = 1, size(self%b)
      call body_correction(self, m, ev, b, dq)
    end do
  end subroutine correction

  !> A frame's correction without rows, and what the rows see of it.
  subroutine free_frame(self, m, b)
    type(newton_matrix), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: b
    real(wp) :: x(2), y, rc(3)
    integer :: e, k
    associate (t => self%b(b), r => self%rows)
      rc = t%eq%frame
      if (t%eq%n > 0) then
        x = 0.0_wp
        y = 0.0_wp
        do k = 1, t%eq%n
          x = x + m%s%bodies(b)%shape%sbar(k, :)*t%eq%elastic(k)
          y = y + t%eq%row(k)*t%eq%elastic(k)
        end do
        rc(1) = rc(1) - t%eq%origin(1)*x(1) + t%eq%origin(2)*x(2)
        rc(2) = rc(2) - t%eq%origin(1)*x(2) - t%eq%origin(2)*x(1)
        rc(3) = rc(3) - y
        do k = 1, t%at%na
          t%at%exf(:, k) = m%s%markers(t%at%marker(k))%elastic(t%eq%elastic(1:t%eq%n))
        end do
      end if
      do k = 1, 3
        t%free(k) = -(t%inverse(k, 1)*rc(1) + t%inverse(k, 2)*rc(2) + t%inverse(k, 3)*rc(3))
      end do
      do e = r%first(b), r%first(b + 1) - 1
        y = dot_product(r%frame_row(:, e), t%free)
        if (t%eq%n > 0) y = y - dot_product(r%marker_row(:, e), t%at%exf(:, r%local(e)))
        r%d(r%row(e)) = r%d(r%row(e)) + y
      end do
    end associate
  end subroutine free_frame

  !> A body's part of dq.
  subroutine body_correction(self, m, ev, b, dq)
    type(newton_matrix), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: b
    real(wp), intent(inout) :: dq(:)         !! (nq) [m, rad]
    real(wp) :: x(3)
    integer :: e, i, k, c, col
    associate (t => self%b(b), r => self%rows)
      x = t%free
      if (t%eq%n > 0) t%at%load = 0.0_wp
      do e = r%first(b), r%first(b + 1) - 1
        x = x - r%solved_column(:, e)*r%y(r%row(e))
        if (t%eq%n == 0) cycle
        do c = 1, 3
          col = t%at%column(c, r%local(e))
          if (col > 0) t%at%load(col) = t%at%load(col) + r%marker_column(c, e)*r%y(r%row(e))
        end do
      end do
      i = m%s%qo(b)
      dq(i + 1) = ev%frame%cos(b)*x(1) - ev%frame%sin(b)*x(2)
      dq(i + 2) = ev%frame%sin(b)*x(1) + ev%frame%cos(b)*x(2)
      dq(i + 3) = x(3)
      if (t%eq%n == 0) return
      x(1:2) = self%c1*x(1:2)
      do k = 1, t%eq%n
        dq(i + 3 + k) = -t%eq%elastic(k) - t%at%xs(k, 1)*x(1) - t%at%xs(k, 2)*x(2) - t%eq%column(k)*x(3)
      end do
      do c = 1, size(t%at%load)
        do k = 1, t%eq%n
          dq(i + 3 + k) = dq(i + 3 + k) - t%at%load(c)*t%at%xe(k, c)
        end do
      end do
    end associate
  end subroutine body_correction

  !> Columns of the inverse elastic block, T0^-1 S-bar^T and T0^-1 E^T, and their products.
  subroutine fill_columns(t, body, markers, whole)
    type(newton_body), intent(inout) :: t
    type(body_model), intent(in) :: body
    type(marker_model), intent(in) :: markers(:)
    logical, intent(in) :: whole             !! by the whole block
    real(wp) :: unit(3)
    integer :: i, j
    associate (at => t%at)
      at%whole = whole
      at%xs = body%shape%sbar
      call t%block%solve_two(whole, at%xs(:, 1), at%xs(:, 2))
      at%xe = 0.0_wp
      at%compliance = 0.0_wp
      do j = 1, size(at%xe, 2)
        unit = 0.0_wp
        unit(at%component_of(j)) = 1.0_wp
        call markers(at%marker(at%marker_of(j)))%push_elastic(unit, at%xe(:, j))
        call t%block%solve(whole, at%xe(:, j))
        do i = 1, 2
          at%sxe(i, j) = dot_product(body%shape%sbar(:, i), at%xe(:, j))
        end do
        do i = 1, at%na
          at%compliance(:, at%component_of(j), i, at%marker_of(j)) = markers(at%marker(i))%elastic(at%xe(:, j))
        end do
      end do
      do j = 1, 2
        do i = 1, 2
          at%pss(i, j) = dot_product(body%shape%sbar(:, i), at%xs(:, j))
        end do
        do i = 1, at%na
          at%exs(:, j, i) = markers(at%marker(i))%elastic(at%xs(:, j))
        end do
      end do
    end associate
  end subroutine fill_columns
end module newton_condensation
