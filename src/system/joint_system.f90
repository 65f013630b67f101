!> The joints' part of the equations of motion: unit wrenches of the constraint rows condensed onto the frames, the
!> multipliers' matrix S = Phi_q M^-1 Phi_q^T and right-hand side, and what multipliers do to the coordinates
!> (theory.md, sections 6 and 7). Loops run over plain arrays; rigid bodies never touch their models.
module joint_system
  use kinds, only: wp
  use mechanism, only: mechanism_model, flexible_attachments
  implicit none (type, external)
  private
  public :: constraint_values, row_rates, condense_constraints, joint_accelerations, push_frame, push_elastic, &
            apply_multipliers, solve_frame, add_frame_compliance

contains

  !> Phi, its gradients and the other parts of every constraint, from the places' states.
  subroutine constraint_values(self, t)
    type(mechanism_model), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    integer :: k
    self%rows%left = self%left
    do k = 1, size(self%s%constraints)
      call self%s%constraints(k)%item%evaluate(t, self%p, self%rows)
    end do
  end subroutine constraint_values

  !> Rates of all rows, Phi_q v + Phi_t [m/s].
  pure subroutine row_rates(self, rate)
    type(mechanism_model), intent(in) :: self
    real(wp), intent(out), contiguous :: rate(:)      !! (rows)
    call add_place_terms(self%s%rows, size(self%p%rate), self%row_place, self%rows%na, self%rows%nb, self%p%v, &
                         self%rows%phi_t, rate)
    call add_angle_terms(self%s%rows, size(self%p%rate), self%row_place, self%rows%sa, self%rows%sb, self%p%rate, rate)
  end subroutine row_rates

  !> y = x + n_a.u_a + n_b.u_b of every row, u a vector at each place.
  pure subroutine add_place_terms(n, np, place, na, nb, u, x, y)
    integer, intent(in) :: n, np
    integer, intent(in) :: place(2, n)
    real(wp), intent(in) :: na(2, n), nb(2, n), u(2, np), x(n)
    real(wp), intent(out) :: y(n)
    integer :: i
    do i = 1, n
      y(i) = x(i) + ((na(1, i)*u(1, place(1, i)) + na(2, i)*u(2, place(1, i))) &
                     + (nb(1, i)*u(1, place(2, i)) + nb(2, i)*u(2, place(2, i))))
    end do
  end subroutine add_place_terms

  !> y = y + s_a u_a + s_b u_b of every row, u a number at each place.
  pure subroutine add_angle_terms(n, np, place, sa, sb, u, y)
    integer, intent(in) :: n, np
    integer, intent(in) :: place(2, n)
    real(wp), intent(in) :: sa(n), sb(n), u(np)
    real(wp), intent(inout) :: y(n)
    integer :: i
    do i = 1, n
      y(i) = y(i) + (sa(i)*u(place(1, i)) + sb(i)*u(place(2, i)))
    end do
  end subroutine add_angle_terms

  !> Unit-multiplier wrenches in body axes, condensed onto the frames, and S = Phi_q M^-1 Phi_q^T.
  subroutine condense_constraints(self)
    type(mechanism_model), intent(inout) :: self
    integer :: b, first, last, n
    call self%schur%clear()
    do b = 1, size(self%c)
      first = self%end_first(b)
      last = self%end_first(b + 1) - 1
      n = last - first + 1
      if (n == 0) cycle
      call unit_wrenches(n, self%end_row(first:last), self%end_place(first:last), self%end_is_a(first:last), self%c(b), &
                         self%sn(b), self%s%rows, self%rows%na, self%rows%nb, self%rows%sa, self%rows%sb, &
                         size(self%place_body), self%p%rho, self%w(:, first:last), self%jw(:, first:last))
      if (self%flexible(b) .and. .not. self%frozen) then
        call condense_elastic(n, self%end_local(first:last), self%attached(b), self%w(:, first:last), self%jw(:, first:last))
        call add_elastic_compliance(n, self%end_local(first:last), self%end_row(first:last), self%attached(b), &
                                    self%w(:, first:last), self%s%rows, self%schur%position, self%schur%scale, &
                                    self%schur%kd, self%schur%s)
      end if
      call add_frame_compliance(n, self%end_row(first:last), self%low(:, b), self%dinv(:, b), self%jw(:, first:last), &
                                self%g(:, first:last), self%s%rows, self%schur%position, self%schur%scale, &
                                self%schur%kd, self%schur%s)
    end do
  end subroutine condense_constraints

  !> Wrenches w of unit multipliers on one body, in body axes, and J^T w on its frame as if it were rigid.
  pure subroutine unit_wrenches(n, row, place, is_a, c, s, rows, na, nb, sa, sb, np, rho, w, jw)
    integer, intent(in) :: n, rows, np
    integer, intent(in) :: row(n), place(n)
    logical, intent(in) :: is_a(n)
    real(wp), intent(in) :: c, s            !! of the frame angle [-]
    real(wp), intent(in) :: na(2, rows), nb(2, rows), sa(rows), sb(rows)
    real(wp), intent(in) :: rho(2, np)
    real(wp), intent(out) :: w(3, n), jw(3, n)
    real(wp) :: x, y, m
    integer :: e, i, k
    do e = 1, n
      i = row(e)
      k = place(e)
      if (is_a(e)) then
        x = na(1, i); y = na(2, i); m = sa(i)
      else
        x = nb(1, i); y = nb(2, i); m = sb(i)
      end if
      w(1, e) = c*x + s*y
      w(2, e) = c*y - s*x
      w(3, e) = m
      jw(1, e) = w(1, e)
      jw(2, e) = w(2, e)
      jw(3, e) = m + rho(1, k)*w(2, e) - rho(2, k)*w(1, e)
    end do
  end subroutine unit_wrenches

  !> What the elastic coordinates take from J^T w.
  pure subroutine condense_elastic(n, local, at, w, jw)
    integer, intent(in) :: n
    integer, intent(in) :: local(n)         !! attachment of each end
    type(flexible_attachments), intent(in) :: at
    real(wp), intent(in) :: w(3, n)
    real(wp), intent(inout) :: jw(3, n)
    integer :: e, j, c
    do e = 1, n
      j = local(e)
      do c = 1, 3
        jw(1, e) = jw(1, e) - at%ep(c, 1, j)*w(c, e)
        jw(2, e) = jw(2, e) - at%ep(c, 2, j)*w(c, e)
        jw(3, e) = jw(3, e) - at%ey(c, j)*w(c, e)
      end do
    end do
  end subroutine condense_elastic

  !> Adds w_e . (E m_ff^-1 E^T) w_f of all pairs of ends of one body to S.
  pure subroutine add_elastic_compliance(n, local, row, at, w, rows, position, scale, kd, s)
    integer, intent(in) :: n, rows, kd
    integer, intent(in) :: local(n), row(n), position(rows)
    type(flexible_attachments), intent(in) :: at
    real(wp), intent(in) :: w(3, n), scale(rows)
    real(wp), intent(inout) :: s(0:kd, rows)
    real(wp) :: x
    integer :: e, f, c, i, j
    do e = 1, n
      i = position(row(e))
      do f = 1, e
        x = 0.0_wp
        do c = 1, 3
          x = x + w(c, f)*(w(1, e)*at%compliance(1, c, local(e), local(f)) &
                           + w(2, e)*at%compliance(2, c, local(e), local(f)) &
                           + w(3, e)*at%compliance(3, c, local(e), local(f)))
        end do
        j = position(row(f))
        x = x*scale(row(e))*scale(row(f))
        if (i == j .and. f < e) x = 2*x      ! both places of one row on the same body
        s(abs(i - j), min(i, j)) = s(abs(i - j), min(i, j)) + x
      end do
    end do
  end subroutine add_elastic_compliance

  !> Adds (J^T w)^T Mc^-1 J^T w of all pairs of ends of one body to S, by g = L^-1 J^T w.
  pure subroutine add_frame_compliance(n, row, low, dinv, jw, g, rows, position, scale, kd, s)
    integer, intent(in) :: n, rows, kd
    integer, intent(in) :: row(n), position(rows)
    real(wp), intent(in) :: low(3), dinv(3), jw(3, n), scale(rows)
    real(wp), intent(out) :: g(3, n)
    real(wp), intent(inout) :: s(0:kd, rows)
    real(wp) :: h(3), x
    integer :: e, f, i, j
    do e = 1, n
      g(1, e) = jw(1, e)
      g(2, e) = jw(2, e) - low(1)*jw(1, e)
      g(3, e) = jw(3, e) - low(2)*jw(1, e) - low(3)*g(2, e)
      h = g(:, e)*dinv*scale(row(e))
      i = position(row(e))
      do f = 1, e
        x = (h(1)*g(1, f) + h(2)*g(2, f) + h(3)*g(3, f))*scale(row(f))
        j = position(row(f))
        if (i == j .and. f < e) x = 2*x      ! both places of one row on the same body
        s(abs(i - j), min(i, j)) = s(abs(i - j), min(i, j)) + x
      end do
    end do
  end subroutine add_frame_compliance

  !> lambda = Phi_q a_free + (second derivative at zero acceleration): what the multipliers must cancel [m/s2].
  pure subroutine joint_accelerations(self)
    type(mechanism_model), intent(inout) :: self
    integer :: b, e, i, j
    call add_place_terms(self%s%rows, size(self%place_body), self%row_place, self%rows%na, self%rows%nb, self%p%bias, &
                         self%rows%extra, self%lambda)
    do b = 1, size(self%c)
      do e = self%end_first(b), self%end_first(b + 1) - 1
        i = self%end_row(e)
        self%lambda(i) = self%lambda(i) + (self%jw(1, e)*self%free(1, b) + self%jw(2, e)*self%free(2, b) &
                                           + self%jw(3, e)*self%free(3, b))
      end do
      if (.not. self%flexible(b)) cycle
      do e = self%end_first(b), self%end_first(b + 1) - 1
        i = self%end_row(e)
        j = self%end_local(e)
        self%lambda(i) = self%lambda(i) + dot_product(self%w(:, e), self%attached(b)%ex(:, j))
      end do
    end do
  end subroutine joint_accelerations

  !> Solves the factored 3 x 3 system of a frame in place.
  pure subroutine solve_frame(low, dinv, x)
    real(wp), intent(in) :: low(3), dinv(3)
    real(wp), intent(inout) :: x(3)
    x(2) = x(2) - low(1)*x(1)
    x(3) = x(3) - low(2)*x(1) - low(3)*x(2)
    x = x*dinv
    x(2) = x(2) - low(3)*x(3)
    x(1) = x(1) - low(1)*x(2) - low(2)*x(3)
  end subroutine solve_frame

  !> Mc^-1 J^T w lambda of one body's frame, body axes.
  pure subroutine push_frame(self, b, lambda, x)
    type(mechanism_model), intent(in) :: self
    integer, intent(in) :: b
    real(wp), intent(in), contiguous :: lambda(:)     !! (rows)
    real(wp), intent(out) :: x(3)
    real(wp) :: l
    integer :: e
    x = 0.0_wp
    do e = self%end_first(b), self%end_first(b + 1) - 1
      l = lambda(self%end_row(e))
      x(1) = x(1) + self%jw(1, e)*l
      x(2) = x(2) + self%jw(2, e)*l
      x(3) = x(3) + self%jw(3, e)*l
    end do
    call solve_frame(self%low(:, b), self%dinv(:, b), x)
  end subroutine push_frame

  !> Subtracts m_ff^-1 E^T w lambda from elastic accelerations (or corrections).
  subroutine push_elastic(self, b, lambda, a)
    type(mechanism_model), intent(inout) :: self
    integer, intent(in) :: b
    real(wp), intent(in), contiguous :: lambda(:)     !! (rows)
    real(wp), intent(inout), contiguous :: a(:)       !! (nf)
    integer :: e, c, j, k
    associate (at => self%attached(b))
      at%load = 0.0_wp
      do e = self%end_first(b), self%end_first(b + 1) - 1
        j = self%end_local(e)
        do c = 1, 3
          k = at%column(c, j)
          if (k > 0) at%load(k) = at%load(k) + self%w(c, e)*lambda(self%end_row(e))
        end do
      end do
      do k = 1, size(at%load)
        do j = 1, size(a)
          a(j) = a(j) - at%load(k)*at%columns(j, k)
        end do
      end do
    end associate
  end subroutine push_elastic

  !> dq = -M^-1 Phi_q^T mu with the factors of the last evaluation: the mass-orthogonal correction (theory.md, section 6).
  subroutine apply_multipliers(self, mu, dq)
    type(mechanism_model), intent(inout) :: self
    real(wp), intent(in), contiguous :: mu(:)         !! (rows)
    real(wp), intent(out), contiguous :: dq(:)        !! (nq), global axes
    real(wp) :: x(3)
    integer :: b, i, n
    do b = 1, size(self%c)
      call push_frame(self, b, mu, x)
      i = self%s%qo(b)
      dq(i + 1) = self%sn(b)*x(2) - self%c(b)*x(1)
      dq(i + 2) = -self%sn(b)*x(1) - self%c(b)*x(2)
      dq(i + 3) = -x(3)
      if (.not. self%flexible(b)) cycle
      n = self%s%bodies(b)%nf
      if (self%frozen) then
        dq(i + 4:i + 3 + n) = 0.0_wp
        cycle
      end if
      associate (bo => self%s%bodies(b))
        call follow_frame(n, bo%pmat, bo%tx(1:), x, dq(i + 4:i + 3 + n))
      end associate
      call push_elastic(self, b, mu, dq(i + 4:i + 3 + n))
    end do
  end subroutine apply_multipliers

  !> Elastic coordinates that follow a correction -x of the frame: m_ff^-1 (S-bar^T, m_theta_f^T) x.
  pure subroutine follow_frame(n, pmat, tx, x, dq)
    integer, intent(in) :: n
    real(wp), intent(in) :: pmat(n, 2), tx(n), x(3)
    real(wp), intent(out) :: dq(n)
    integer :: k
    do k = 1, n
      dq(k) = pmat(k, 1)*x(1) + pmat(k, 2)*x(2) + tx(k)*x(3)
    end do
  end subroutine follow_frame
end module joint_system
