!> The energy that the method itself takes out of the dissipative coordinates in a step, beside what their damping takes: the
!> identity of `implicit_energy` with (alpha/omega2) D as the mass of z (theory.md, section 5).
module implicit_term_energy
  use kinds, only: wp
  use body, only: body_model
  use implicit_model, only: implicit_solver, ghm_term
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: keep_terms, removed_from_terms

contains

  !> Notes z, z', z'' and az of the step's start, before the step's end replaces them.
  subroutine keep_terms(self)
    type(implicit_solver), intent(inout) :: self
    integer :: i
    do i = 1, size(self%z)
      self%old(i, 1) = self%z(i)
      self%old(i, 2) = self%zd(i)
      self%old(i, 3) = self%zdd(i)
      self%old(i, 4) = self%az(i)
    end do
  end subroutine keep_terms

  !> Energy taken out by the step from what `keep_terms` noted to the present z, z', z'' [J].
  function removed_from_terms(self, m) result(energy)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    real(wp) :: energy, h, dz, rate, change, acceleration
    integer :: i, k
    h = self%now%h
    do i = 1, size(self%z)
      dz = self%z(i) - self%old(i, 1)
      rate = 0.5_wp*(self%zd(i) + self%old(i, 2))
      change = self%zd(i) - self%old(i, 2)
      acceleration = 0.5_wp*(self%zdd(i) + self%old(i, 3))
      self%old(i, 1) = rate
      self%old(i, 2) = change - h*acceleration
      self%old(i, 3) = acceleration
      self%old(i, 4) = h*rate - dz
    end do
    energy = 0.0_wp
    do k = 1, size(self%terms)
      energy = energy - term_pairs(self%terms(k), m, self%old)
    end do
  end function removed_from_terms

  !> x1^T W x2 + x3^T W x4 of one term, W = (alpha/omega2) D [J].
  pure function term_pairs(t, m, x) result(total)
    type(ghm_term), intent(in) :: t
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in) :: x(:, :)          !! (nz, 4)
    real(wp) :: total
    integer :: i, j
    total = 0.0_wp
    if (t%body == 0) then
      i = t%o + 1
      total = m%s%springs(t%spring)%stiffness*(x(i, 1)*x(i, 2) + x(i, 3)*x(i, 4))
    else if (m%s%bodies(t%body)%modal) then
      associate (k => m%s%bodies(t%body)%runs(t%run)%stiffness)
        do j = 1, t%n
          do i = 1, t%n
            total = total + k(i, j)*(x(t%o + i, 1)*x(t%o + j, 2) + x(t%o + i, 3)*x(t%o + j, 4))
          end do
        end do
      end associate
    else
      total = run_pairs(m%s%bodies(t%body), t, x)
    end if
    total = total*t%alpha/t%w2
  end function term_pairs

  !> The same with D alone over the elements of a nodal body's run [J alpha/omega2].
  pure function run_pairs(bo, t, x) result(total)
    type(body_model), intent(in) :: bo
    type(ghm_term), intent(in) :: t
    real(wp), intent(in) :: x(:, :)
    real(wp) :: total
    integer :: e, i, j
    total = 0.0_wp
    i = t%o
    do e = bo%runs(t%run)%first, bo%runs(t%run)%last
      do j = 1, 3, 2
        if (bo%nd == 3) total = total + bo%factors(8, e)*x(i + 1, j)*x(i + 1, j + 1)
        associate (a => i + bo%nd - 1, b => i + bo%nd)
          total = total + bo%factors(9, e)*(x(a, j)*(4*x(a, j + 1) + 2*x(b, j + 1)) + x(b, j)*(2*x(a, j + 1) + 4*x(b, j + 1)))
        end associate
      end do
      i = i + bo%nd
    end do
  end function run_pairs
end module implicit_term_energy
