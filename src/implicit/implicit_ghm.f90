!> Dissipative coordinates in an implicit step. The relations of the method make the end of the step a scalar multiple of
!> the deformation's, z1 = g delta1 + (what the past adds), so they are condensed: K_eff = K (1 + sum alpha_k (1 - g_k)),
!> and cost two passes a term and step, whatever the number of Newton iterations (theory.md, section 7).
module implicit_ghm
  use kinds, only: wp
  use body, only: body_model
  use generalized_alpha, only: alpha_step
  use implicit_model, only: implicit_solver, ghm_term
  use mechanism, only: mechanism_model
  use modal_kernel, only: modal_dissipation
  use ghm_kernel, only: run_dissipation
  use nodal_kernel, only: deformations, rayleigh_power
  implicit none (type, external)
  private
  public :: set_terms, begin_terms, end_terms, spring_state, spring_stiffness, dissipated_in_bodies

contains

  !> Coefficients of all terms for the present step size, and the stiffness they lend.
  subroutine set_terms(self, m)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    integer :: k, b, r
    do k = 1, size(self%terms)
      associate (t => self%terms(k))
        t%dinv = 1.0_wp/(self%now%d1 + t%two_zw*self%now%va1 + t%w2*self%now%qa1)
        t%g = t%w2*self%now%qa1*t%dinv
      end associate
    end do
    do b = 1, size(self%b)
      associate (bo => m%s%bodies(b))
        if (bo%modal) then
          self%b(b)%stiff = 0.0_wp
          do k = 1, bo%nf
            self%b(b)%stiff(k, k) = bo%omega2(k)
          end do
        else if (bo%flexible) then
          self%b(b)%el%kf = 1.0_wp
        end if
      end associate
    end do
    do k = 1, size(self%terms)
      b = self%terms(k)%body
      r = self%terms(k)%run
      if (b == 0) cycle
      associate (run => m%s%bodies(b)%runs(r), t => self%terms(k), x => self%terms(k)%alpha*(1 - self%terms(k)%g))
        if (m%s%bodies(b)%modal) then
          self%b(b)%stiff = self%b(b)%stiff + x*run%stiffness
        else
          self%b(b)%el%kf(run%first:run%last) = self%b(b)%el%kf(run%first:run%last) + x
        end if
      end associate
    end do
  end subroutine set_terms

  !> What the past of every term adds to the end of the step, and the history forces of the bodies.
  subroutine begin_terms(self, m)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    integer :: k, b, o, i, j
    do b = 1, size(self%b)
      if (m%s%bodies(b)%nz == 0) cycle
      if (m%s%bodies(b)%modal) self%b(b)%hm = 0.0_wp
      if (.not. m%s%bodies(b)%modal) self%b(b)%el%hs = 0.0_wp
    end do
    do k = 1, size(self%terms)
      associate (t => self%terms(k))
        o = t%o
        call past(t, self%now, t%n, self%z(o + 1), self%zd(o + 1), self%zdd(o + 1), self%az(o + 1), self%pre(o + 1), &
                  self%zk(o + 1))
        b = t%body
        if (b == 0) cycle
        associate (run => m%s%bodies(b)%runs(t%run))
          if (m%s%bodies(b)%modal) then
            do j = 1, t%n
              do i = 1, t%n
                self%b(b)%hm(i) = self%b(b)%hm(i) + t%alpha*run%stiffness(i, j)*self%zk(o + j)
              end do
            end do
          else
            call add_history(t%n, t%alpha, self%zk(o + 1), self%b(b)%el%hs(1, run%first))
          end if
        end associate
      end associate
    end do
  end subroutine begin_terms

  !> az1 = w2 dinv delta1 - pre, z1 = g delta1 + zk for one term.
  pure subroutine past(t, now, n, z, zd, zdd, az, pre, zk)
    type(ghm_term), intent(in) :: t
    type(alpha_step), intent(in) :: now
    integer, intent(in) :: n
    real(wp), intent(in) :: z(n), zd(n), zdd(n), az(n)
    real(wp), intent(inout) :: pre(n), zk(n)
    real(wp) :: zbar
    integer :: i
    do i = 1, n
      zbar = z(i) + now%h*zd(i) + now%qa*az(i)
      pre(i) = (t%w2*zbar + now%da*az(i) + now%dd*zdd(i) + t%two_zw*(zd(i) + now%va*az(i)))*t%dinv
      zk(i) = zbar - now%qa1*pre(i)
    end do
  end subroutine past

  !> hs <- hs + alpha zk.
  pure subroutine add_history(n, alpha, zk, hs)
    integer, intent(in) :: n
    real(wp), intent(in) :: alpha, zk(n)
    real(wp), intent(inout) :: hs(n)
    hs = hs + alpha*zk
  end subroutine add_history

  !> Dissipative coordinates at the end of an accepted step, from the deformations there.
  subroutine end_terms(self, m)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp) :: d(1), dd, e(2)
    integer :: k, b, o, i
    do b = 1, size(self%b)
      associate (bo => m%s%bodies(b))
        if (.not. bo%flexible) cycle
        i = m%s%qo(b) + 3
        bo%qx(1:bo%nf) = self%q1(i + 1:i + bo%nf)
        bo%vx(1:bo%nf) = self%v1(i + 1:i + bo%nf)
        if (bo%nz > 0 .and. .not. bo%modal) call deformations(bo, bo%qx, bo%d)
      end associate
    end do
    do k = 1, size(self%terms)
      associate (t => self%terms(k))
        o = t%o
        b = t%body
        if (b == 0) then
          call m%s%springs(t%spring)%deformation(m%p, d(1), dd, e)
          call advance(t, self%now, 1, d, self%pre(o + 1), self%z(o + 1), self%zd(o + 1), self%zdd(o + 1), self%az(o + 1))
        else if (m%s%bodies(b)%modal) then
          call advance(t, self%now, t%n, m%s%bodies(b)%qx(1), self%pre(o + 1), self%z(o + 1), self%zd(o + 1), &
                       self%zdd(o + 1), self%az(o + 1))
        else
          call advance(t, self%now, t%n, m%s%bodies(b)%d(1, m%s%bodies(b)%runs(t%run)%first), self%pre(o + 1), &
                       self%z(o + 1), self%zd(o + 1), self%zdd(o + 1), self%az(o + 1))
        end if
      end associate
    end do
  end subroutine end_terms

  !> One term from the start to the end of the step.
  pure subroutine advance(t, now, n, d, pre, z, zd, zdd, az)
    type(ghm_term), intent(in) :: t
    type(alpha_step), intent(in) :: now
    integer, intent(in) :: n
    real(wp), intent(in) :: d(n), pre(n)     !! deformations at the end of the step
    real(wp), intent(inout) :: z(n), zd(n), zdd(n), az(n)
    real(wp) :: a1, f
    integer :: i
    f = t%w2*t%dinv
    do i = 1, n
      a1 = f*d(i) - pre(i)
      z(i) = z(i) + now%h*zd(i) + now%qa*az(i) + now%qa1*a1
      zd(i) = zd(i) + now%va*az(i) + now%va1*a1
      zdd(i) = now%d1*a1 + now%da*az(i) + now%dd*zdd(i)
      az(i) = a1
    end do
  end subroutine advance

  !> Dissipative coordinates of the springs at the trial state, where the springs' forces are wanted.
  subroutine spring_state(self, m)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    real(wp) :: d, dd, e(2)
    integer :: k, i
    do k = 1, size(m%s%springs)
      associate (sp => m%s%springs(k))
        if (size(sp%alpha) == 0) cycle
        call sp%deformation(m%p, d, dd, e)
        do i = 1, size(self%terms)
          if (self%terms(i)%spring /= k) cycle
          self%spring_z(self%terms(i)%o + 1) = self%terms(i)%g*d + self%zk(self%terms(i)%o + 1)
        end do
      end associate
    end do
  end subroutine spring_state

  !> Stiffness of a spring with its terms condensed [N/m] or [N m/rad].
  pure function spring_stiffness(self, m, k) result(stiffness)
    type(implicit_solver), intent(in) :: self
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: k                 !! spring
    real(wp) :: stiffness
    integer :: i
    stiffness = 1.0_wp
    do i = size(self%terms), 1, -1
      if (self%terms(i)%spring == 0) exit    ! springs' terms are the last ones
      if (self%terms(i)%spring == k) stiffness = stiffness + self%terms(i)%alpha*(1 - self%terms(i)%g)
    end do
    stiffness = m%s%springs(k)%stiffness*stiffness
  end function spring_stiffness

  !> Power that GHM and Rayleigh damping dissipate in the bodies [W]; bo%vx holds the rates.
  function dissipated_in_bodies(self, m) result(power)
    type(implicit_solver), intent(in) :: self
    type(mechanism_model), intent(in) :: m
    real(wp) :: power
    integer :: b, r, i, j, o
    power = 0.0_wp
    do b = 1, size(self%b)
      associate (bo => m%s%bodies(b))
        if (.not. bo%flexible) cycle
        o = m%s%zo(b)
        if (bo%modal) then
          power = power + modal_dissipation(bo, self%zd(o + 1:o + bo%nz))
          if (.not. bo%rayleigh) cycle
          do j = 1, bo%nf
            do i = 1, bo%nf
              power = power + bo%vx(i)*bo%cmodal(i, j)*bo%vx(j)
            end do
          end do
          cycle
        end if
        do r = 1, size(bo%runs)
          power = power + run_dissipation(bo, bo%runs(r), self%zd(o + bo%runs(r)%offset + 1:o + bo%nz))
        end do
        if (bo%rayleigh) power = power + rayleigh_power(bo)
      end associate
    end do
  end function dissipated_in_bodies
end module implicit_ghm
