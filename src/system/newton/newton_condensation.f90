!> Condensation of the dynamic stiffness T(c1, c2) of a mechanism: elastic coordinates onto the frames, frames onto the rows between
!> bodies (theory.md, section 7). One text for real constants, those of generalized_alpha and the real one of radau, and, as the
!> complex twin, for the complex one of radau.
module newton_condensation
  use kinds, only: wp, number
  use body_terms, only: body_equations
  use border_row_lists, only: from_argument, from_friction, from_joint
  use border_rows, only: factor_rows
  use condensed_system, only: condensed_matrix, condensed_body
  use constraint, only: marker_stiffness
  use elastic_columns, only: fill_columns, seen
  use evaluation_results, only: evaluation, conditions_of
  use force_element, only: conditions
  use mechanism, only: mechanism_model
  use row_sides, only: side_a, side_b, side_c
  use small_matrices, only: invert3
  use switched_rows, only: slip_slope, stop_slope
  implicit none (type, external)
  private
  public :: add_tangent, condense

contains

  !> Adds a part of a body's tangent: a real one times 1 or i.
  subroutine add_tangent(x, eq, part, first)
    type(condensed_body), intent(inout) :: x
    type(body_equations), intent(in) :: eq
    real(number), intent(in) :: part         !! [-]
    logical, intent(in) :: first             !! nothing was there before
    if (first) then
      x%frame = part*eq%block
      x%origin = part*eq%origin
      if (x%n == 0) return
      x%column = part*eq%column(1:x%n)
      x%row = part*eq%row(1:x%n)
    else
      x%frame = x%frame + part*eq%block
      x%origin = x%origin + part*eq%origin
      if (x%n == 0) return
      x%column = x%column + part*eq%column(1:x%n)
      x%row = x%row + part*eq%row(1:x%n)
    end if
  end subroutine add_tangent

  !> Condenses the tangent that was given and factors its rows; the elastic residuals are solved at the same time.
  subroutine condense(self, m, ev, eq, v, a, lambda, full_block, shift, bad)
    type(condensed_matrix), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    type(body_equations), intent(in) :: eq(:)   !! at the state of the last residual
    real(wp), intent(in), contiguous :: v(:), a(:)   !! (nq) [m/s, rad/s] and accelerations
    real(wp), intent(in) :: lambda(:)        !! (rows) [N]
    logical, intent(in) :: full_block        !! factors the full elastic blocks
    real(wp), intent(in) :: shift            !! of the constraint rows, relative [-]
    logical, intent(out) :: bad
    integer :: b, i
    bad = .not. (full_block .or. self%factored)
    if (bad) return
    self%full_block = full_block
    self%solved = .true.
    call fill_laws(self, m, ev, lambda)
    call fill_open_rows(self, m, ev, lambda)
    do b = 1, size(self%b)
      associate (x => self%b(b))
        if (x%n > 0) then
          i = m%s%qo(b) + 3
          if (full_block) then
            call x%block%factor_full(eq(b), m%s%bodies(b), self%c2, v(i), a(i), bad)
            if (bad) return
          end if
          if (full_block .or. x%at%full_block) call fill_columns(x, m%s%bodies(b), m%s%markers, full_block)
          call x%block%solve_two(full_block, x%elastic, x%column)
        end if
        call condense_frame(x, m, b, self%c1, bad)
        if (bad) return
      end associate
    end do
    call condense_rows(self, m, ev, v)
    call factor_rows(self%rows, shift)
    bad = self%rows%bad
  end subroutine condense

  !> Marker-level tangents of curved joints, of force elements and of their friction.
  subroutine fill_laws(self, m, ev, lambda)
    type(condensed_matrix), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: lambda(:)        !! (rows) [N]
    type(marker_stiffness) :: p
    type(conditions) :: with
    integer :: k
    do k = 1, size(self%rows%laws)
      associate (i => self%rows%laws(k)%item, r => self%rows)
        if (r%laws(k)%kind == from_joint) then
          call m%s%constraints(i)%item%geometric(ev%p, lambda, p)
          r%k(:, :, k) = p%k
        else if (r%laws(k)%kind == from_friction) then
          call stop_slope(m, ev, i, p%k(1, :), p%c(1, :))
          r%k(1, :, k) = p%k(1, :) + self%c2*p%c(1, :)
          r%g(1, :, k) = p%c(1, :)
        else
          associate (f => m%s%forces(i)%item)
            if (r%laws(k)%kind == from_argument .and. f%controller > 0) then
              with = conditions_of(m, ev, i)
              with%slopes = [1.0_wp, 0.0_wp]
              call f%argument_tangent(ev%p, with, 1, p)
              r%k(:, :, k) = self%element_factor(i)*(p%k + self%c2*p%c)   ! of its controller
              cycle
            else if (r%laws(k)%kind == from_argument) then
              call f%argument_tangent(ev%p, conditions_of(m, ev, i, r%laws(k)%argument), r%laws(k)%argument, p)
            else
              call f%tangent(ev%p, conditions_of(m, ev, i), [1.0_wp, 1.0_wp], ev%action(i)%force, p)
            end if
            r%k(:, :, k) = p%k + self%c2*p%c
            r%g(:, :, k) = p%c
            if (f%law%order() == 0) cycle           ! such an element has no argument
            call f%tangent(ev%p, conditions_of(m, ev, i), [1.0_wp, 0.0_wp], 0.0_wp, p)
            r%k(:, :, k) = r%k(:, :, k) + (self%element_factor(i) - 1)*p%k
          end associate
        end if
      end associate
    end do
  end subroutine fill_laws

  !> Rows that are off, with the slopes of their multipliers.
  subroutine fill_open_rows(self, m, ev, lambda)
    type(condensed_matrix), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: lambda(:)        !! (rows) [N]
    integer :: k
    do k = 1, size(self%rows%open)
      associate (x => self%rows%open(k))
        x%off = ev%rows%off(x%row)
        if (x%off) call slip_slope(m, ev, k, lambda, x%reaction, x%slope)
      end associate
    end do
  end subroutine fill_open_rows

  !> Condenses the elastic coordinates onto the frame; the inverse of the condensed frame.
  subroutine condense_frame(t, m, b, c1, bad)
    type(condensed_body), intent(inout) :: t
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: b
    real(number), intent(in) :: c1           !! [1/s2]
    logical, intent(out) :: bad
    real(number) :: a(3, 3), x(2), rx(2), rc, y(2)
    integer :: j, k
    a = t%frame
    if (t%n > 0) then
      do j = 1, 2
        x = c1*t%at%pss(:, j)
        a(1, j) = a(1, j) - t%origin(1)*x(1) + t%origin(2)*x(2)
        a(2, j) = a(2, j) - t%origin(1)*x(2) - t%origin(2)*x(1)
      end do
      y = 0.0_wp
      rx = 0.0_wp
      associate (body => m%s%bodies(b))
        do k = 1, t%n
          y = y + body%shape%sbar(k, :)*t%column(k)
          rx = rx + t%row(k)*t%at%xs(k, :)
          a(3, 3) = a(3, 3) - t%row(k)*t%column(k)
        end do
      end associate
      a(1, 3) = a(1, 3) - t%origin(1)*y(1) + t%origin(2)*y(2)
      a(2, 3) = a(2, 3) - t%origin(1)*y(2) - t%origin(2)*y(1)
      a(3, 1:2) = a(3, 1:2) - c1*rx
      do j = 1, size(t%at%rxe)
        rc = 0.0_wp
        do k = 1, t%n
          rc = rc + t%row(k)*t%at%xe(k, j)
        end do
        t%at%rxe(j) = rc
      end do
      do j = 1, size(t%at%marker)
        t%at%exy(:, j) = seen(m%s%markers(t%at%marker(j)), t%column)
      end do
    end if
    call invert3(a, t%inverse, bad)
  end subroutine condense_frame

  !> Sides of all rows on the condensed frames, and the rows' compliance.
  subroutine condense_rows(self, m, ev, v)
    type(condensed_matrix), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: v(:)             !! (nq) rates [m/s, rad/s]
    integer :: b, e
    self%rows%s = 0.0_wp
    do b = 1, size(self%b)
      do e = self%rows%first(b), self%rows%first(b + 1) - 1
        call condense_side(self, m, ev, v, b, e)
      end do
      call add_compliance(self, b)
    end do
  end subroutine condense_rows

  !> One side: row and column on marker and condensed frame.
  subroutine condense_side(self, m, ev, v, b, e)
    type(condensed_matrix), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: v(:)             !! (nq) [m/s, rad/s]
    integer, intent(in) :: b, e
    real(wp) :: w(3), j(3), rel(2)
    real(number) :: x(2)
    integer :: k, l, c, col
    associate (r => self%rows, t => self%b(b))
      k = r%marker(e)
      w = side_direction(ev, r%kind(e), r%row(e), b)
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
      if (t%n > 0) then
        l = r%attachment(e)
        r%frame_row(1, e) = j(1) - self%c1*dot_product(w, t%at%exs(:, 1, l))
        r%frame_row(2, e) = j(2) - self%c1*dot_product(w, t%at%exs(:, 2, l))
        r%frame_row(3, e) = j(3) - dot_product(w, t%at%exy(:, l))
        x = 0.0_wp
        do c = 1, 3
          col = t%at%column(c, l)
          if (col == 0) cycle
          x = x + t%at%sxe(:, col)*r%marker_column(c, e)
          r%frame_column(3, e) = r%frame_column(3, e) - t%at%rxe(col)*r%marker_column(c, e)
        end do
        r%frame_column(1, e) = r%frame_column(1, e) - t%origin(1)*x(1) + t%origin(2)*x(2)
        r%frame_column(2, e) = r%frame_column(2, e) - t%origin(1)*x(2) - t%origin(2)*x(1)
      end if
      do c = 1, 3
        r%solved_column(c, e) = t%inverse(c, 1)*r%frame_column(1, e) + t%inverse(c, 2)*r%frame_column(2, e) &
                                + t%inverse(c, 3)*r%frame_column(3, e)
      end do
    end associate
  end subroutine condense_side

  !> Direction of a row at the marker of a side: displacement in body axes, rotation.
  pure function side_direction(ev, kind, row, b) result(w)
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: kind              !! of the side (`row_system`)
    integer, intent(in) :: row, b
    real(wp) :: w(3)                         !! [-, -, m]
    real(wp) :: n(2)                         ! displacement in global axes [-]
    w = 0.0_wp
    n = 0.0_wp
    select case (kind)
    case (side_a)
      n = ev%rows%na(:, row)
      w(3) = ev%rows%sa(row)
    case (side_b)
      n = ev%rows%nb(:, row)
      w(3) = ev%rows%sb(row)
    case (side_c)
      w(3) = ev%rows%sc(row)
    case (1, 4)
      n(1) = 1.0_wp
    case (2, 5)
      n(2) = 1.0_wp
    case default
      w(3) = 1.0_wp
    end select
    w(1) = ev%frame%cos(b)*n(1) + ev%frame%sin(b)*n(2)
    w(2) = ev%frame%cos(b)*n(2) - ev%frame%sin(b)*n(1)
  end function side_direction

  !> One body's part of the rows' compliance.
  subroutine add_compliance(self, b)
    type(condensed_matrix), intent(inout) :: self
    integer, intent(in) :: b
    real(number) :: x
    integer :: e, f, i, j, c
    associate (r => self%rows, t => self%b(b))
      do e = r%first(b), r%first(b + 1) - 1
        i = r%position(r%row(e))
        do f = r%first(b), r%first(b + 1) - 1
          if (r%kind(f) > 3) cycle
          x = r%frame_row(1, e)*r%solved_column(1, f) + r%frame_row(2, e)*r%solved_column(2, f) &
              + r%frame_row(3, e)*r%solved_column(3, f)
          if (t%n > 0) then
            do c = 1, 3
              x = x + r%marker_column(c, f)*(r%marker_row(1, e)*t%at%compliance(1, c, r%attachment(e), r%attachment(f)) &
                                  + r%marker_row(2, e)*t%at%compliance(2, c, r%attachment(e), r%attachment(f)) &
                                  + r%marker_row(3, e)*t%at%compliance(3, c, r%attachment(e), r%attachment(f)))
            end do
          end if
          j = r%position(r%row(f))
          r%s(j - i, i) = r%s(j - i, i) + x
        end do
      end do
    end associate
  end subroutine add_compliance
end module newton_condensation
