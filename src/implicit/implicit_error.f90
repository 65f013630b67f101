!> Local error of an implicit step, for the step control.
module implicit_error
  use kinds, only: wp
  use dynamics, only: evaluate, set_frames, place_kinematics, constraint_values, row_rates
  use implicit_blocks, only: elastic_filter
  use implicit_ghm, only: end_terms
  use implicit_model, only: implicit_solver
  use implicit_start, only: along_rows
  use mechanism, only: mechanism_model
  use projection, only: project
  use singular, only: evaluate_branch
  implicit none (type, external)
  private
  public :: error_vector, own_error, nearly_dependent, remember_error

  real(wp), parameter :: weak = 1.0e-3_wp     !! relative pivot of the rows from which their estimate is doubted [-]

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
    logical :: ok
    nq = m%s%nq
    nz = m%s%nz
    self%old(:, 1) = self%z
    self%old(:, 2) = self%zd
    self%old(:, 3) = self%zdd
    self%old(:, 4) = self%az
    call set_frames(m, self%q1)
    call place_kinematics(m, self%q1, self%v1)
    call end_terms(self, m)
    self%change = self%v1
    if (m%s%rows > 0) then                    ! the rates' own offset from Phi' = 0 would show in the accelerations
      call constraint_values(m, t1)
      call row_rates(m, m%rows%phi)
      call along_rows(self, m)
      self%change = self%change + self%dq
    end if
    call evaluate(m, t1, self%q1, self%change, self%z, self%zd)
    if (nearly_dependent(m)) then             ! there they amplify the rest of it, too
      self%dq = self%q1
      call project(m, t1, self%dq, self%change, self%z, self%zd, ok)
      call evaluate_branch(m, t1, self%dq, self%change, self%z, self%zd)
    end if
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
    call differences(self, e, nq, nz, self%acceleration1, self%acceleration, self%before)
    call filter(self, m, e, nq, nz)
  end subroutine error_vector

  !> The same estimate with the method's own accelerations, a second opinion next to singular positions: there those of the
  !> equations amplify the rounding of positions without bound.
  subroutine own_error(self, m, e)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    real(wp), intent(inout) :: e(:)           !! (layout in `scene_model`)
    call differences(self, e, m%s%nq, m%s%nz, self%vd1, self%vd, self%before_own)
    call filter(self, m, e, m%s%nq, m%s%nz)
  end subroutine own_error

  !> Whether rows are nearly dependent at the last evaluation.
  pure function nearly_dependent(m) result(yes)
    type(mechanism_model), intent(in) :: m
    logical :: yes
    integer :: k
    yes = m%schur%singular
    do k = 1, m%schur%n                       ! the factor holds 1/pivot
      yes = yes .or. m%schur%f(0, k)*m%schur%s(0, k)*weak > 1.0_wp
    end do
  end function nearly_dependent

  !> The estimate before it is filtered, from accelerations of the coordinates at both ends and their last change.
  pure subroutine differences(self, e, nq, nz, a1, a, before)
    type(implicit_solver), intent(in) :: self
    real(wp), intent(inout) :: e(:)
    integer, intent(in) :: nq, nz
    real(wp), intent(in) :: a1(nq), a(nq), before(nq)   !! [m/s2, rad/s2]
    real(wp) :: fq, fv, ratio, h, d
    integer :: i
    h = self%now%h
    ratio = 0.0_wp
    if (self%h_before > 0.0_wp) ratio = h/self%h_before
    fq = self%method%local*h**2
    fv = self%method%local_rate*h*2*ratio/(1 + ratio)       ! of divided differences over unequal steps
    do i = 1, nq
      d = a1(i) - a(i)
      e(i) = fq*d
      e(nq + i) = fv*(d - ratio*before(i))
    end do
    do i = nq + 1, nq + nz
      d = self%acceleration1(i) - self%acceleration(i)
      e(nq + i) = fq*d
      e(nq + nz + i) = fv*(d - ratio*self%before(i))
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
    self%before_own = self%vd1 - self%vd
    self%acceleration = self%acceleration1
    self%h_before = self%now%h
  end subroutine remember_error
end module implicit_error
