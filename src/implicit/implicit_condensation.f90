!> Condensation of a Newton iteration: elastic coordinates onto the frames, frames onto the rows between bodies, and the
!> correction back from rows to frames to elastic coordinates (theory.md, section 7).
module implicit_condensation
  use kinds, only: wp
  use implicit_blocks, only: invert3
  use implicit_model, only: implicit_solver, implicit_body
  use implicit_rows, only: solve_rows
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: condense_frame, condense_rows, trial_correction

contains

  !> Condenses the elastic coordinates onto the frame; the inverse of the condensed frame.
  subroutine condense_frame(t, m, b, c1, bad)
    type(implicit_body), intent(inout) :: t
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: b
    real(wp), intent(in) :: c1               !! [1/s2]
    logical, intent(out) :: bad
    real(wp) :: a(3, 3), x(2), rx(2), rc, y(2)
    integer :: j, k
    a = t%trr
    if (t%nf > 0) then
      do j = 1, 2
        x = c1*t%pss(:, j)
        a(1, j) = a(1, j) - t%k1*x(1) + t%k2*x(2)
        a(2, j) = a(2, j) - t%k1*x(2) - t%k2*x(1)
      end do
      y = 0.0_wp
      rx = 0.0_wp
      rc = 0.0_wp
      associate (bo => m%s%bodies(b))
        do k = 1, t%nf
          y = y + bo%sbar(k, :)*t%col(k)
          rx = rx + t%row(k)*t%xs(k, :)
          rc = rc + t%row(k)*t%col(k)
        end do
      end associate
      a(1, 3) = a(1, 3) - t%k1*y(1) + t%k2*y(2)
      a(2, 3) = a(2, 3) - t%k1*y(2) - t%k2*y(1)
      a(3, 1:2) = a(3, 1:2) - c1*rx
      a(3, 3) = a(3, 3) - rc
      do j = 1, size(t%rxe)
        rc = 0.0_wp
        do k = 1, t%nf
          rc = rc + t%row(k)*t%xe(k, j)
        end do
        t%rxe(j) = rc
      end do
      do j = 1, t%na
        t%exy(:, j) = m%s%places(t%place(j))%elastic(t%col(1:t%nf))
      end do
    end if
    call invert3(a, t%minv, bad)
  end subroutine condense_frame

  !> Ends of all rows on the condensed frames, and the rows' compliance.
  subroutine condense_rows(self, m)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    integer :: b, e
    self%rows%s = 0.0_wp
    do b = 1, size(self%b)
      do e = self%rows%first(b), self%rows%first(b + 1) - 1
        call one_end(self, m, b, e)
      end do
      call add_compliance(self, b)
    end do
  end subroutine condense_rows

  !> One end: row and column on place and condensed frame.
  subroutine one_end(self, m, b, e)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: b, e
    real(wp) :: w(3), j(3), n(2), rel(2), x(2)
    integer :: i, k, l, c, col
    associate (r => self%rows, t => self%b(b))
      i = r%row(e)
      k = r%place(e)
      w = 0.0_wp
      n = 0.0_wp
      select case (r%kind(e))
      case (-1)
        n = m%rows%na(:, i)
        w(3) = m%rows%sa(i)
      case (-2)
        n = m%rows%nb(:, i)
        w(3) = m%rows%sb(i)
      case (1, 4)
        n(1) = 1.0_wp
      case (2, 5)
        n(2) = 1.0_wp
      case default
        w(3) = 1.0_wp
      end select
      w(1) = m%c(b)*n(1) + m%sn(b)*n(2)
      w(2) = m%c(b)*n(2) - m%sn(b)*n(1)
      j = [w(1), w(2), w(3) + m%p%rho(1, k)*w(2) - m%p%rho(2, k)*w(1)]
      r%wc(:, e) = w
      r%jc(:, e) = j
      if (r%kind(e) > 3) then                ! what turning adds to a place's rate
        rel = m%p%v(:, k) - self%v1(m%s%qo(b) + 1:m%s%qo(b) + 2)
        rel = [m%c(b)*rel(1) + m%sn(b)*rel(2), m%c(b)*rel(2) - m%sn(b)*rel(1)]
        j = [0.0_wp, 0.0_wp, w(2)*rel(1) - w(1)*rel(2)]
        w(1:2) = self%v1(m%s%qo(b) + 3)*[w(2), -w(1)]
        r%wc(:, e) = 0.0_wp
        r%jc(:, e) = 0.0_wp
      end if
      r%wr(:, e) = w
      r%jr(:, e) = j
      if (t%nf > 0) then
        l = r%local(e)
        r%jr(1, e) = j(1) - self%now%c1*dot_product(t%exs(:, 1, l), w)
        r%jr(2, e) = j(2) - self%now%c1*dot_product(t%exs(:, 2, l), w)
        r%jr(3, e) = j(3) - dot_product(t%exy(:, l), w)
        x = 0.0_wp
        do c = 1, 3
          col = t%column(c, l)
          if (col == 0) cycle
          x = x + t%sxe(:, col)*r%wc(c, e)
          r%jc(3, e) = r%jc(3, e) - t%rxe(col)*r%wc(c, e)
        end do
        r%jc(1, e) = r%jc(1, e) - t%k1*x(1) + t%k2*x(2)
        r%jc(2, e) = r%jc(2, e) - t%k1*x(2) - t%k2*x(1)
      end if
      do c = 1, 3
        r%mj(c, e) = t%minv(c, 1)*r%jc(1, e) + t%minv(c, 2)*r%jc(2, e) + t%minv(c, 3)*r%jc(3, e)
      end do
    end associate
  end subroutine one_end

  !> One body's part of the rows' compliance.
  subroutine add_compliance(self, b)
    type(implicit_solver), intent(inout) :: self
    integer, intent(in) :: b
    real(wp) :: x
    integer :: e, f, i, j, c
    associate (r => self%rows, t => self%b(b))
      do e = r%first(b), r%first(b + 1) - 1
        i = r%position(r%row(e))
        do f = r%first(b), r%first(b + 1) - 1
          if (r%kind(f) > 3) cycle
          x = r%jr(1, e)*r%mj(1, f) + r%jr(2, e)*r%mj(2, f) + r%jr(3, e)*r%mj(3, f)
          if (t%nf > 0) then
            do c = 1, 3
              x = x + r%wc(c, f)*(r%wr(1, e)*t%compliance(1, c, r%local(e), r%local(f)) &
                                  + r%wr(2, e)*t%compliance(2, c, r%local(e), r%local(f)) &
                                  + r%wr(3, e)*t%compliance(3, c, r%local(e), r%local(f)))
            end do
          end if
          j = r%position(r%row(f))
          r%s(j - i, i) = r%s(j - i, i) + x
        end do
      end do
    end associate
  end subroutine add_compliance

  !> The correction dq (global axes) and that of the multipliers (rows%y), from solved elastic residuals.
  subroutine trial_correction(self, m)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    integer :: b
    self%rows%d = 0.0_wp
    do b = 1, size(self%b)
      call free_frame(self, m, b)
    end do
    call solve_rows(self%rows, m%rows%phi)
    do b = 1, size(self%b)
      call body_correction(self, m, b)
    end do
  end subroutine trial_correction

  !> A frame's correction without rows, and what the rows see of it.
  subroutine free_frame(self, m, b)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: b
    real(wp) :: x(2), y, rc(3)
    integer :: e, k
    associate (t => self%b(b), r => self%rows)
      rc = t%rr
      if (t%nf > 0) then
        x = 0.0_wp
        y = 0.0_wp
        do k = 1, t%nf
          x = x + m%s%bodies(b)%sbar(k, :)*t%ff(k)
          y = y + t%row(k)*t%ff(k)
        end do
        rc(1) = rc(1) - t%k1*x(1) + t%k2*x(2)
        rc(2) = rc(2) - t%k1*x(2) - t%k2*x(1)
        rc(3) = rc(3) - y
        do k = 1, t%na
          t%exf(:, k) = m%s%places(t%place(k))%elastic(t%ff(1:t%nf))
        end do
      end if
      do k = 1, 3
        t%d0(k) = -(t%minv(k, 1)*rc(1) + t%minv(k, 2)*rc(2) + t%minv(k, 3)*rc(3))
      end do
      do e = r%first(b), r%first(b + 1) - 1
        y = dot_product(r%jr(:, e), t%d0)
        if (t%nf > 0) y = y - dot_product(r%wr(:, e), t%exf(:, r%local(e)))
        r%d(r%row(e)) = r%d(r%row(e)) + y
      end do
    end associate
  end subroutine free_frame

  !> A body's part of dq.
  subroutine body_correction(self, m, b)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: b
    real(wp) :: x(3)
    integer :: e, i, k, c, col
    associate (t => self%b(b), r => self%rows)
      x = t%d0
      if (t%nf > 0) t%load = 0.0_wp
      do e = r%first(b), r%first(b + 1) - 1
        x = x - r%mj(:, e)*r%y(r%row(e))
        if (t%nf == 0) cycle
        do c = 1, 3
          col = t%column(c, r%local(e))
          if (col > 0) t%load(col) = t%load(col) + r%wc(c, e)*r%y(r%row(e))
        end do
      end do
      i = m%s%qo(b)
      self%dq(i + 1) = m%c(b)*x(1) - m%sn(b)*x(2)
      self%dq(i + 2) = m%sn(b)*x(1) + m%c(b)*x(2)
      self%dq(i + 3) = x(3)
      if (t%nf == 0) return
      x(1:2) = self%now%c1*x(1:2)
      do k = 1, t%nf
        self%dq(i + 3 + k) = -t%ff(k) - t%xs(k, 1)*x(1) - t%xs(k, 2)*x(2) - t%col(k)*x(3)
      end do
      do c = 1, size(t%load)
        do k = 1, t%nf
          self%dq(i + 3 + k) = self%dq(i + 3 + k) - t%load(c)*t%xe(k, c)
        end do
      end do
    end associate
  end subroutine body_correction
end module implicit_condensation
