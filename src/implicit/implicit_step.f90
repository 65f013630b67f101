!> Steps of the generalized-alpha method for a mechanism: Newton's method with constant elastic factors while they contract
!> well and exact ones otherwise, and what an accepted step leaves behind.
module implicit_step
  use kinds, only: wp
  use archive, only: value_archive
  use dynamics, only: set_frames, place_kinematics, applied_forces
  use implicit_condensation, only: trial_correction
  use implicit_energy, only: removed_energy
  use implicit_ghm, only: begin_terms, end_terms, dissipated_in_bodies
  use implicit_model, only: implicit_solver
  use implicit_newton, only: trial_residual, trial_tangent, trial_elastic
  use implicit_rows, only: light_shift, strong_shift
  use implicit_start, only: restore_factors, widen_scales, pack_state
  use implicit_term_energy, only: keep_terms, removed_from_terms
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: try_step, accept_step, end_step, undo_end, full_rates, exchange_solver

  integer, parameter :: most_iterations = 12       !! Newton iterations of a step
  real(wp), parameter :: slow = 0.1_wp             !! contraction from which exact elastic blocks pay [-]
  integer, parameter :: exact_steps = 50           !! steps before the constant ones are tried again
  real(wp), parameter :: relative_goal = 1.0e-5_wp !! Newton's error, of the first correction [-]
  real(wp), parameter :: loose = 1.0e-9_wp         !! and at most this, of the groups' sizes [-]
  real(wp), parameter :: rounding = 1.0e-16_wp     !! below this corrections are noise, of the groups' sizes [-]
  real(wp), parameter :: noise = 1.0e-13_wp        !! corrections below that do not shrink are rounding, of the scene's size [-]
  real(wp), parameter :: small = 1.0e-3_wp         !! Newton's error, of what the accelerations' change of change moves [-]
  real(wp), parameter :: unseen = 4*epsilon(1.0_wp)   !! corrections that positions do not show, of the scene's size [-]
  real(wp), parameter :: weak = 1.0e-5_wp          !! pivot of rows near which nothing is taken on trust [-]
  integer, parameter :: trust = 10                 !! steps between measurements of the contraction

contains

  !> Tries a step to time t1; ok is false where Newton's method fails.
  subroutine try_step(self, m, t1, ok)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: t1                !! [s]
    logical, intent(out) :: ok
    logical :: slowly
    if (self%stale) call restore_factors(self, m)
    m%left = .true.
    call begin_terms(self, m)
    self%exact = self%exact_left > 0
    call predict(self)
    call newton(self, m, t1, ok, slowly)
    if ((slowly .or. .not. ok) .and. .not. self%exact) then
      self%exact_left = exact_steps
      if (.not. ok) then
        self%exact = .true.
        call predict(self)
        call newton(self, m, t1, ok, slowly)
      end if
    end if
    if (ok .or. self%rows%nc == 0) return
    self%rows%shift = strong_shift              ! a singular position: rows that depend on others there are held back
    call predict(self)
    call newton(self, m, t1, ok, slowly)
    self%rows%shift = light_shift
  end subroutine try_step

  !> First guess: the accelerations of the step's start.
  subroutine predict(self)
    type(implicit_solver), intent(inout) :: self
    real(wp) :: a1
    integer :: i
    associate (s => self%now)
      do i = 1, size(self%q)
        self%vd1(i) = self%vd(i)
        a1 = (s%ad1 + s%ad)*self%vd(i) + s%aa*self%a(i)
        self%q1(i) = self%q(i) + s%h*self%v(i) + s%qa*self%a(i) + s%qa1*a1
        self%v1(i) = self%v(i) + s%va*self%a(i) + s%va1*a1
      end do
    end associate
    self%lambda1 = self%lambda
  end subroutine predict

  !> Newton iterations from the prediction. The tangent is that of the prediction; a new one where it contracts slowly.
  subroutine newton(self, m, t1, ok, slowly)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: t1                !! [s]
    logical, intent(out) :: ok                !! converged
    logical, intent(out) :: slowly            !! the contraction was poor
    real(wp) :: size_now, before, rate, goal, whole, before_whole, reach, blur
    integer :: k
    logical :: bad
    ok = .false.
    slowly = .false.
    before = huge(1.0_wp)
    before_whole = huge(1.0_wp)
    goal = 0.0_wp
    rate = 0.0_wp
    do k = 1, most_iterations
      call trial_residual(self, m, t1)
      if (k == 1) reach = extent(self, m)
      blur = noise*reach
      if (k == 1 .or. slowly) then
        call trial_tangent(self, m, t1, bad)
        if (bad) return
      else
        call trial_elastic(self, m)
      end if
      call trial_correction(self, m)
      self%iterations = self%iterations + 1
      call correct(self, size_now, whole)
      if (.not. whole <= 1.0e3_wp*reach) return                 ! also where it is not a number
      if (k == 1) then
        goal = max(rounding, min(loose, relative_goal*size_now))
        ok = foreseen(self, size_now, whole)
      else
        rate = size_now/before
        slowly = slowly .or. (rate > slow .and. whole > blur)
        if (k == 2) call note_contraction(self, before, max(rate, whole/before_whole))
      end if
      ok = ok .or. size_now <= rounding
      if (k > 1 .and. rate < 1.0_wp) ok = ok .or. size_now*rate <= goal*(1 - rate)
      if (k > 1) ok = ok .or. (rate > 0.2_wp .and. whole <= blur)     ! rounding of the residual
      if (k > 3) ok = ok .or. (abs(rate - 1) < 0.5_wp .and. whole <= blur/sqrt(max(self%rows%weakest, self%rows%shift)))
      if (ok) exit
      if (k > 2 .and. rate > 2.0_wp .and. size_now > loose) return
      before = size_now
      before_whole = whole
    end do
    if (.not. ok) slowly = .true.
    if (ok .and. k <= 4) slowly = .false.
  end subroutine newton

  !> How far places are from the origin, in sizes of the scene, or how many radians frames have turned: what rounding grows with.
  pure function extent(self, m) result(reach)
    type(implicit_solver), intent(in) :: self
    type(mechanism_model), intent(in) :: m
    real(wp) :: reach                         !! at least 1 [-]
    integer :: b
    reach = 1 + max(0.0_wp, maxval(abs(m%p%r)))/m%s%size             ! without places the largest is -huge
    do b = 1, size(self%b)
      reach = max(reach, abs(self%q1(m%s%qo(b) + 3)))
    end do
  end function extent

  !> Whether the first correction leaves an error that needs no second one: the contraction measured within the last steps says
  !> that what is left is a small part of the step's own error in the rates, or below the rounding of positions (Brown,
  !> Hindmarsh & Petzold 1994, on the convergence test of DASPK). The step's own error is that of `implicit_error`: what the
  !> change of the accelerations' change moves.
  function foreseen(self, norm, whole) result(yes)
    type(implicit_solver), intent(inout) :: self
    real(wp), intent(in) :: norm, whole       !! first correction, scaled two ways [-]
    logical :: yes
    real(wp) :: rate, d, ratio, change, change_whole
    integer :: i
    yes = .false.
    self%trusted = self%trusted + 1
    if (self%trusted > trust .or. self%measured_exact .neqv. self%exact) return
    if (self%rows%weakest < weak .or. .not. (self%h_before > 0.0_wp .and. self%measured > 0.0_wp)) return
    rate = self%contraction*max(1.0_wp, norm/self%measured)
    yes = rate*whole <= unseen
    if (yes .or. rate > 0.1_wp*small) return
    ratio = self%now%h/self%h_before
    change = 0.0_wp
    change_whole = 0.0_wp
    do i = 1, size(self%q1)
      d = abs(self%vd1(i) - self%vd(i) - ratio*self%before_own(i))/self%now%c1
      change = max(change, d*self%unit(i))
      change_whole = max(change_whole, d*self%whole(i))
    end do
    yes = rate*norm <= small*change .and. rate*whole <= small*change_whole
  end function foreseen

  !> Remembers the contraction from the first to the second correction.
  pure subroutine note_contraction(self, first, rate)
    type(implicit_solver), intent(inout) :: self
    real(wp), intent(in) :: first             !! first correction, scaled [-]
    real(wp), intent(in) :: rate              !! [-]
    self%contraction = rate
    self%measured = first
    self%measured_exact = self%exact
    self%trusted = 0
  end subroutine note_contraction

  !> Adds the correction; its largest component relative to its group, and relative to the scene's size or one radian.
  subroutine correct(self, norm, whole)
    type(implicit_solver), intent(inout) :: self
    real(wp), intent(out) :: norm, whole      !! [-]
    real(wp) :: d, c1, c2
    integer :: i
    logical :: finite
    c1 = self%now%c1
    c2 = self%now%c2
    norm = 0.0_wp
    whole = 0.0_wp
    finite = .true.
    do i = 1, size(self%q)
      d = self%dq(i)
      self%q1(i) = self%q1(i) + d
      self%v1(i) = self%v1(i) + c2*d
      self%vd1(i) = self%vd1(i) + c1*d
      norm = max(norm, abs(d)*self%unit(i))
      whole = max(whole, abs(d)*self%whole(i))
      finite = finite .and. abs(d) < huge(1.0_wp)
    end do
    if (.not. finite) norm = huge(1.0_wp)
    do i = 1, size(self%lambda1)
      self%lambda1(i) = self%lambda1(i) + self%rows%y(i)
    end do
  end subroutine correct

  !> Places and dissipative coordinates at the end of the trial step; those of its start are kept.
  subroutine end_step(self, m)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    call set_frames(m, self%q1)
    call place_kinematics(m, self%q1, self%v1)
    call keep_terms(self)
    call end_terms(self, m)
    self%ended = .true.
  end subroutine end_step

  !> Takes the dissipative coordinates back to the start of a step that is not (or not yet) accepted.
  subroutine undo_end(self)
    type(implicit_solver), intent(inout) :: self
    integer :: i
    if (.not. self%ended) return
    do i = 1, size(self%z)
      self%z(i) = self%old(i, 1)
      self%zd(i) = self%old(i, 2)
      self%zdd(i) = self%old(i, 3)
      self%az(i) = self%old(i, 4)
    end do
    self%ended = .false.
  end subroutine undo_end

  !> The trial step becomes the state; dissipated energy and work by the trapezoidal rule.
  subroutine accept_step(self, m, t1)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: t1                !! [s]
    real(wp) :: power, input
    integer :: k, i
    if (.not. self%ended) call end_step(self, m)
    self%ended = .false.
    self%removed = self%removed + removed_energy(self, m)
    self%removed = self%removed + removed_from_terms(self, m)
    power = dissipated_in_bodies(self, m)
    m%dissipated_power = 0.0_wp
    m%input_power = 0.0_wp
    call applied_forces(m, t1, self%q1, self%z, self%zd)
    power = power + m%dissipated_power
    input = m%input_power
    do k = m%s%joints + 1, size(m%s%constraints)
      i = m%s%constraints(k)%item%first
      input = input + self%lambda1(i)*m%rows%phi_t(i)
    end do
    self%dissipated = self%dissipated + 0.5_wp*self%now%h*(self%power + power)
    self%work = self%work + 0.5_wp*self%now%h*(self%input + input)
    self%power = power
    self%input = input
    self%h_before = self%now%h
    do i = 1, size(self%q)
      self%before_own(i) = self%vd1(i) - self%vd(i)
      self%a(i) = self%now%ad1*self%vd1(i) + self%now%ad*self%vd(i) + self%now%aa*self%a(i)
      self%q(i) = self%q1(i)
      self%v(i) = self%v1(i)
      self%vd(i) = self%vd1(i)
    end do
    self%lambda = self%lambda1
    self%steps = self%steps + 1
    if (self%exact_left > 0) self%exact_left = self%exact_left - 1
    call widen_scales(self)
  end subroutine accept_step

  !> Its rates.
  pure subroutine full_rates(self, y)
    type(implicit_solver), intent(in) :: self
    real(wp), intent(inout) :: y(:)
    call pack_state(self%v, self%vd, self%zd, self%zdd, self%power, self%input, y)
  end subroutine full_rates

  !> Saves or restores the method's state; the factors of the step are made again.
  subroutine exchange_solver(self, a)
    type(implicit_solver), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    call a%exchange(self%now%h)
    call a%exchange(self%q)
    call a%exchange(self%v)
    call a%exchange(self%vd)
    call a%exchange(self%a)
    call a%exchange(self%z)
    call a%exchange(self%zd)
    call a%exchange(self%zdd)
    call a%exchange(self%az)
    call a%exchange(self%lambda)
    call a%exchange(self%dissipated)
    call a%exchange(self%work)
    call a%exchange(self%power)
    call a%exchange(self%input)
    call a%exchange(self%removed)
    call a%exchange(self%before)
    call a%exchange(self%before_own)
    call a%exchange(self%acceleration)
    call a%exchange(self%h_before)
    call a%exchange(self%tight)
    call a%exchange(self%agreed)
    call a%exchange(self%firm)
    call a%exchange(self%exact_left)
    call a%exchange(self%contraction)
    call a%exchange(self%measured)
    call a%exchange(self%measured_exact)
    call a%exchange(self%trusted)
    call a%exchange(self%scale)
    call a%exchange(self%unit)
    call a%exchange(self%iterations)
    call a%exchange(self%constant_factors)
    call a%exchange(self%exact_factors)
    if (.not. a%saving) self%stale = .true.
  end subroutine exchange_solver
end module implicit_step
