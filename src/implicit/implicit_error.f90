!> Local error of an implicit step, for the step control.
module implicit_error
  use kinds, only: wp
  use dynamics, only: evaluate, set_frames, place_kinematics
  use implicit_blocks, only: elastic_filter
  use implicit_ghm, only: end_terms
  use implicit_model, only: implicit_solver
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: error_vector, remember_error

contains

  !> Estimated local error e of the trial step, and the state y that it leads to: positions from the change of the
  !> accelerations over the step, rates from the change of that change (Geradin & Cardona, Flexible Multibody Dynamics). The
  !> accelerations are those of the equations at the ends of the step: the method's own ones carry, where constraints hold,
  !> the rounding of Phi = 0 over h2. What elastic and dissipative coordinates do faster than the step resolves is filtered
  !> out (Hairer & Wanner, Solving Ordinary Differential Equations II, IV.8). Energies are not measured.
  subroutine error_vector(self, m, t1, e, y)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: t1                !! end of the step [s]
    real(wp), intent(inout) :: e(:), y(:)     !! (layout in `scene_model`)
    integer :: nq, nz
    nq = m%s%nq
    nz = m%s%nz
    self%old(:, 1) = self%z
    self%old(:, 2) = self%zd
    self%old(:, 3) = self%zdd
    self%old(:, 4) = self%az
    call set_frames(m, self%q1)
    call place_kinematics(m, self%q1, self%v1)
    call end_terms(self, m)
    call evaluate(m, t1, self%q1, self%v1, self%z, self%zd)
    self%acceleration1(1:nq) = m%a
    self%acceleration1(nq + 1:nq + nz) = m%zdd
    y(1:nq) = self%q1
    y(nq + 1:2*nq) = self%v1
    y(2*nq + 1:2*nq + nz) = self%z
    y(2*nq + nz + 1:2*nq + 2*nz) = self%zd
    y(2*nq + 2*nz + 1:) = 0.0_wp
    self%z = self%old(:, 1)
    self%zd = self%old(:, 2)
    self%zdd = self%old(:, 3)
    self%az = self%old(:, 4)
    call differences(self, e, nq, nz)
    call filter(self, m, e, nq, nz)
  end subroutine error_vector

  !> The estimate before it is filtered.
  pure subroutine differences(self, e, nq, nz)
    type(implicit_solver), intent(in) :: self
    real(wp), intent(inout) :: e(:)
    integer, intent(in) :: nq, nz
    real(wp) :: fq, fv, ratio, h, d
    integer :: i, o
    h = self%now%h
    ratio = 0.0_wp
    if (self%h_before > 0.0_wp) ratio = h/self%h_before
    fq = self%method%local*h**2
    fv = self%method%local_rate*h*2*ratio/(1 + ratio)       ! of divided differences over unequal steps
    do i = 1, nq + nz
      d = self%acceleration1(i) - self%acceleration(i)
      o = i
      if (i > nq) o = nq + i
      e(o) = fq*d
      o = o + merge(nz, nq, i > nq)
      e(o) = fv*(d - ratio*self%before(i))
    end do
    e(2*(nq + nz) + 1:) = 0.0_wp
  end subroutine differences

  !> Takes out what the step does not resolve.
  subroutine filter(self, m, e, nq, nz)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    real(wp), intent(inout) :: e(:)
    integer, intent(in) :: nq, nz
    real(wp) :: f
    integer :: b, i, n, k
    do b = 1, size(self%b)
      i = m%s%qo(b) + 3
      n = self%b(b)%nf
      if (n > 0) call elastic_filter(self%b(b), m%s%bodies(b), self%now%c1, e(i + 1:i + n), e(nq + i + 1:nq + i + n))
    end do
    do k = 1, size(self%terms)
      f = self%now%d1*self%terms(k)%dinv
      i = 2*nq + self%terms(k)%o
      n = self%terms(k)%n
      e(i + 1:i + n) = f*e(i + 1:i + n)
      e(nz + i + 1:nz + i + n) = f*e(nz + i + 1:nz + i + n)
    end do
  end subroutine filter

  !> The estimate's memory of an accepted step.
  subroutine remember_error(self)
    type(implicit_solver), intent(inout) :: self
    self%before = self%acceleration1 - self%acceleration
    self%acceleration = self%acceleration1
    self%h_before = self%now%h
  end subroutine remember_error
end module implicit_error
