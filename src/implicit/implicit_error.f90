!> Local error of an implicit step, for the step control.
module implicit_error
  use kinds, only: wp
  use dynamics, only: evaluate, set_frames, place_kinematics, constraint_values, row_rates
  use implicit_blocks, only: elastic_filter
    use implicit_model, only: implicit_solver
  use implicit_start, only: along_rows, pack_state
  use implicit_step, only: end_step, undo_end
  use mechanism, only: mechanism_model
  use projection, only: project
  use singular, only: evaluate_branch
  implicit none (type, external)
  private
  public :: error_vector, own_error, compare_estimates, doubtful, back_to_equations, nearly_dependent, remember_error

  real(wp), parameter :: alike = 0.05_wp      !! difference of estimates that agree [-]
  integer, parameter :: agreements = 4        !! steps after which they count as the same
  real(wp), parameter :: weak = 1.0e-3_wp     !! relative pivot of the rows from which their estimate is doubted [-]

contains

  !> Estimated local error e of the trial step, and the state y that it leads to: positions from the change of the
  !> accelerations over the step, rates from the change of that change (Geradin & Cardona, Flexible Multibody Dynamics). What
  !> elastic and dissipative coordinates do faster than the step resolves is filtered out (Hairer & Wanner, Solving Ordinary
  !> Differential Equations II, IV.8). Energies are not measured. The accelerations are those of the equations at the
  !> ends of the step: the method's own ones carry, where constraints hold, the rounding of Phi = 0 over h2 and what a change of
  !> the step leaves. Where both were seen to give the same estimate (`compare_estimates`), the own ones, which cost nothing.
  subroutine error_vector(self, m, t1, e, y)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: t1                !! end of the step [s]
    real(wp), intent(inout) :: e(:), y(:)     !! (layout in `scene_model`)
    integer :: nq, nz
    nq = m%s%nq
    nz = m%s%nz
    call end_step(self, m)
    call pack_state(self%q1, self%v1, self%z, self%zd, 0.0_wp, 0.0_wp, y)
    if (self%tight) then
      call equations(self, m, t1)
      call undo_end(self)
      call differences(self, e, nq, self%acceleration1(1:nq), self%acceleration(1:nq), self%before(1:nq))
    else
      self%acceleration1(nq + 1:) = self%zdd
      self%acceleration(nq + 1:) = self%old(:, 3)
      call differences(self, e, nq, self%vd1, self%vd, self%before_own)
    end if
    call filter(self, m, e, nq, nz)
  end subroutine error_vector

  !> Accelerations of the equations at the end of the trial step (self%acceleration1).
  subroutine equations(self, m, t1)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: t1                !! [s]
    integer :: nq
    logical :: ok
    nq = m%s%nq
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
    self%acceleration1(nq + 1:) = m%zdd
  end subroutine equations

  !> The same estimate with the method's own accelerations, a second opinion next to singular positions: there those of the
  !> equations amplify the rounding of positions without bound.
  subroutine own_error(self, m, e)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    real(wp), intent(inout) :: e(:)           !! (layout in `scene_model`)
    call differences(self, e, m%s%nq, self%vd1, self%vd, self%before_own)
    call filter(self, m, e, m%s%nq, m%s%nz)
  end subroutine own_error

  !> Compares the estimate with that of the method's own accelerations: where they agree over several steps, the latter do.
  subroutine compare_estimates(self, error, own)
    type(implicit_solver), intent(inout) :: self
    real(wp), intent(in) :: error, own        !! measured over the tolerance [-]
    self%agreed = merge(self%agreed + 1, 0, abs(own - error) <= alike*error)
    if (self%agreed < agreements) return
    self%tight = .false.
    self%firm = self%rows%weakest
  end subroutine compare_estimates

  !> Whether the rows have become so much weaker that the method's own accelerations are no longer taken on trust.
  pure function doubtful(self) result(yes)
    type(implicit_solver), intent(in) :: self
    logical :: yes
    yes = .not. self%tight .and. self%rows%weakest < 0.1_wp*self%firm
  end function doubtful

  !> Goes back to the accelerations of the equations, at the state from which the next step starts.
  subroutine back_to_equations(self, m, t)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: t                 !! [s]
    integer :: nq
    nq = m%s%nq
    if (self%tight) return
    self%tight = .true.
    self%agreed = 0
    self%q1 = self%q
    self%v1 = self%v
    call set_frames(m, self%q)
    call place_kinematics(m, self%q, self%v)
    call equations(self, m, t)
    self%acceleration = self%acceleration1
    self%before(1:nq) = self%before_own
  end subroutine back_to_equations

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
  pure subroutine differences(self, e, nq, a1, a, before)
    type(implicit_solver), intent(in) :: self
    real(wp), intent(inout) :: e(:)
    integer, intent(in) :: nq
    real(wp), intent(in) :: a1(nq), a(nq), before(nq)   !! [m/s2, rad/s2]
    real(wp) :: fq, fv, ratio, h, d
    integer :: i, nz
    nz = size(self%z)
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
    self%acceleration = self%acceleration1
  end subroutine remember_error
end module implicit_error
