!> The energy that the method itself takes out in a step. With M the mass matrix and bars for means of both ends,
!>
!>   kinetic + potential change = vbar^T M (dv - h abar) + abar^T M (h vbar - dq) + what forces and damping do (trapezoidal)
!>
!> where a = v' are the accelerations of the equations: the first two terms vanish for the trapezoidal rule (spectral radius
!> 1) and are the method's numerical damping otherwise. Dissipative coordinates: `implicit_term_energy`.
module implicit_energy
  use kinds, only: wp
  use body, only: body_model
  use implicit_element, only: gather, mass_pairs
  use implicit_model, only: implicit_solver, implicit_body
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: removed_energy

contains

  !> Energy taken out by the step from q, v, vd to q1, v1, vd1 [J].
  function removed_energy(self, m) result(energy)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    real(wp) :: energy, h
    integer :: i, b, n
    h = self%now%h
    do i = 1, size(self%q)
      self%pairs(i, 1) = 0.5_wp*(self%v(i) + self%v1(i))
      self%pairs(i, 3) = 0.5_wp*(self%vd(i) + self%vd1(i))
      self%pairs(i, 2) = self%v1(i) - self%v(i) - h*self%pairs(i, 3)
      self%pairs(i, 4) = h*self%pairs(i, 1) - (self%q1(i) - self%q(i))
    end do
    energy = 0.0_wp
    do b = 1, size(self%b)
      i = m%s%qo(b)
      n = self%b(b)%nf
      energy = energy - body_pairs(self%b(b), m%s%bodies(b), m%c(b), m%sn(b), self%q1(i + 4:i + 3 + n), &
                                   self%pairs(i + 1:i + 3 + n, :))
    end do
  end function removed_energy

  !> x1^T M x2 + x3^T M x4 of one body.
  function body_pairs(t, bo, c, s, q, x) result(sum)
    type(implicit_body), intent(inout) :: t
    type(body_model), intent(in) :: bo
    real(wp), intent(in) :: c, s              !! of the frame angle [-]
    real(wp), intent(in) :: q(:)              !! (nf) elastic coordinates
    real(wp), intent(in) :: x(:, :)           !! (3 + nf, 4) frames in global axes
    real(wp) :: sum, p(2), r(2, 4), f(2, 4), tf(4)
    integer :: j, k
    p = bo%i1
    do j = 1, 4
      r(1, j) = c*x(1, j) + s*x(2, j)
      r(2, j) = c*x(2, j) - s*x(1, j)
    end do
    f = 0.0_wp
    tf = 0.0_wp
    do k = 1, t%nf
      p = p + bo%sbar(k, :)*q(k)
      do j = 1, 4
        f(:, j) = f(:, j) + bo%sbar(k, :)*x(3 + k, j)
        tf(j) = tf(j) + bo%c0(k)*x(3 + k, j)
      end do
    end do
    sum = 0.0_wp
    do j = 1, 3, 2
      sum = sum + bo%mass*dot_product(r(:, j), r(:, j + 1)) + x(3, j)*bo%i11*x(3, j + 1) &
            + x(3, j)*(p(1)*r(2, j + 1) - p(2)*r(1, j + 1) + tf(j + 1)) &
            + x(3, j + 1)*(p(1)*r(2, j) - p(2)*r(1, j) + tf(j)) &
            + dot_product(r(:, j), f(:, j + 1)) + dot_product(r(:, j + 1), f(:, j))
    end do
    if (t%nf > 0) sum = sum + elastic_pairs(t, bo, x)
  end function body_pairs

  !> The elastic part, x1^T m_ff x2 + x3^T m_ff x4.
  function elastic_pairs(t, bo, x) result(sum)
    type(implicit_body), intent(inout) :: t
    type(body_model), intent(in) :: bo
    real(wp), intent(in) :: x(:, :)           !! (3 + nf, 4)
    real(wp) :: sum
    integer :: k, c, i
    if (bo%modal) then
      sum = dot_product(x(4:, 1), x(4:, 2)) + dot_product(x(4:, 3), x(4:, 4))
      return
    end if
    t%x(1:t%nf) = x(4:, 1)
    call gather(t%el, t%x, t%el%q)
    t%x(1:t%nf) = x(4:, 2)
    call gather(t%el, t%x, t%el%v)
    t%x(1:t%nf) = x(4:, 3)
    call gather(t%el, t%x, t%el%a)
    t%x(1:t%nf) = x(4:, 4)
    call gather(t%el, t%x, t%el%g)
    sum = mass_pairs(t%el)
    do k = 1, size(bo%lumps)
      do c = 1, 3
        i = bo%dof(c, bo%lumps(k)%node)
        if (i > 0) sum = sum + merge(bo%lumps(k)%inertia, bo%lumps(k)%mass, c == 3) &
                         *(x(3 + i, 1)*x(3 + i, 2) + x(3 + i, 3)*x(3 + i, 4))
      end do
    end do
  end function elastic_pairs
end module implicit_energy
