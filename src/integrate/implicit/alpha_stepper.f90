!> The generalized-alpha method as a transient sees it: its start at a consistent state, change of its step, and its march. A step
!> is in `alpha_newton`.
module alpha_stepper
  use kinds, only: wp
  use archive, only: value_archive
  use alpha_newton, only: solve_trial, take_trial, prepare_step, find_offsets, find_offset
  use alpha_state, only: alpha_solver, set_up_alpha, pack, exchange_alpha, chung_hulbert, step_coefficients
  use implicit_march, only: implicit_stepper, exchange_march, start_again
  use second_order_system, only: near_length, second_order_ode
  use step_control, only: same_length
  use summary_text, only: summary_record
  implicit none (type, external)
  private
  public :: start_method

  !> The method.
  type, extends(implicit_stepper), public :: alpha_march
    real(wp) :: spectral_radius = 0.9_wp      !! [-]
    type(alpha_solver) :: solver
  contains
    procedure :: set_up
    procedure :: solve_step
    procedure :: take_step
    procedure :: keep_path
    procedure :: pack_state
    procedure :: report_work
    procedure :: implicit_work
    procedure :: exchange
  end type alpha_march

contains

  !> Work space.
  subroutine set_up(self, system)
    class(alpha_march), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    call system%start_implicit(.false.)
    call set_up_alpha(self%solver, system, chung_hulbert(self%spectral_radius), self%norm)
  end subroutine set_up

  !> Tries a step. After a shorter one the method starts anew: a step knows its accelerations to the rounding of positions over h2,
  !> so that those of a short piece would shake a longer one. A shorter one changes the method's variables: the difference of a and
  !> v' is scaled with the step (Bruels & Arnold 2008), the offset of rates with its square.
  subroutine solve_step(self, system, h, ok)
    class(alpha_march), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: h                 !! [s]
    logical, intent(out) :: ok
    logical :: same
    associate (s => self%solver, last => self%solver%newton%h)   ! last: 0 where no step has been taken since a start
      if (self%started .and. last > 0.0_wp .and. .not. self%roots%locating .and. h - last > same_length*h) then
        call start_again(self, system, ok)
        if (.not. ok) return
      end if
      same = abs(h - s%now%h) <= merge(0.0_wp, same_length*h, self%roots%locating)
      if (.not. self%started .or. (.not. last > 0.0_wp .and. .not. same)) then
        call start_method(s, system, self%t, h, self%y)
        self%started = .true.
      else if (.not. same) then
        s%offset = (h/s%now%h)**2*s%offset
        call set_step(s, system, h, merge(near_length, 0.0_wp, self%roots%locating))
      end if
    end associate
    call solve_trial(self%solver, system, self%norm, self%tried, self%roots%locating, ok)
    self%solver%needs_factors = self%roots%locating   ! another step of this length has its own factors
  end subroutine solve_step

  !> Accepts the trial step.
  subroutine take_step(self, system, h)
    class(alpha_march), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: h                 !! [s]
    call take_trial(self%solver, system, self%tried)
    self%removed = self%solver%energy%removed
    call self%end_step(system, h, self%solver%x(1:self%solver%nq))
  end subroutine take_step

  !> Cubics of positions with the rates at both ends, of rates with the accelerations.
  subroutine keep_path(self, h)
    class(alpha_march), intent(inout) :: self
    real(wp), intent(in) :: h                 !! [s]
    associate (s => self%solver, p => self%path, nq => self%solver%nq, nz => self%solver%nz)
      p(:, 0:3) = 0.0_wp
      p(1:nq, 0:3) = hermite(h, s%x(1:nq), s%v(1:nq), s%x1(1:nq), s%v1(1:nq))
      p(nq + 1:2*nq, 0:3) = hermite(h, s%v(1:nq), s%vd(1:nq), s%v1(1:nq), s%vd1(1:nq))
      p(2*nq + 1:2*nq + nz, 0:3) = hermite(h, s%x(nq + 1:), s%v(nq + 1:), s%x1(nq + 1:), s%v1(nq + 1:))
    end associate
    self%degree = 3
  end subroutine keep_path

  !> Coefficients of cubics by values and slopes at both ends [any].
  pure function hermite(h, a, da, b, db) result(c)
    real(wp), intent(in) :: h                 !! [s]
    real(wp), intent(in) :: a(:), da(:), b(:), db(:)   !! [any], [any/s]
    real(wp) :: c(size(a), 0:3)
    c(:, 0) = a
    c(:, 1) = h*da
    c(:, 2) = 3*(b - a) - h*(2*da + db)
    c(:, 3) = 2*(a - b) + h*(da + db)
  end function hermite

  !> The method's own state, whose rates are not projected.
  subroutine pack_state(self, tried, y)
    class(alpha_march), intent(in) :: self
    logical, intent(in) :: tried
    real(wp), intent(inout) :: y(:)           !! (n) [unit of each unknown]
    if (tried) then
      call pack(self%solver, self%solver%x1, self%solver%v1, self%solver%energy%sums, y)
    else
      call pack(self%solver, self%solver%x, self%solver%v, self%solver%energy%sums, y)
    end if
  end subroutine pack_state

  !> Processor time of an iteration with its share of the matrices is 3.5 times that of an explicit evaluation, as the median of ten
  !> random scenes (2.4 to 5.4; `make bench`).
  pure real(wp) function implicit_work(self) result(work)
    class(alpha_march), intent(in) :: self
    work = 3.5_wp*self%solver%newton%iterations   ! [-]
  end function implicit_work

  !> Newton iterations and factorisations.
  subroutine report_work(self, text)
    class(alpha_march), intent(in) :: self
    type(summary_record), intent(inout) :: text
    call text%say('  Newton iterations: {newton_iterations #}, factorisations of elastic blocks: constant '// &
                  '{constant_factorisations #}, exact {exact_factorisations #}', &
                  [real(wp) :: self%solver%newton%iterations, self%solver%newton%factors])
    call self%report_failures(text)
  end subroutine report_work

  !> Saves or restores the march.
  subroutine exchange(self, a)
    class(alpha_march), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    call exchange_march(self, a)
    call exchange_alpha(self%solver, a)
  end subroutine exchange

  !> Starts (or starts again, after a jump of loads) at a consistent state y at time t: with accelerations and multipliers of the
  !> equations, and the difference of an index-3 solution from them (Arnold, Bruels & Cardona 2015).
  subroutine start_method(self, system, t, h, y)
    type(alpha_solver), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in) :: h                 !! [s]
    real(wp), intent(in), contiguous :: y(:)  !! (n) the state [unit of each unknown]
    logical :: ok
    associate (nq => self%nq, nz => self%nz, nzd => self%nzd)
      self%x = [y(1:nq), y(2*nq + 1:2*nq + nz)]
      self%v(1:nq) = y(nq + 1:2*nq)
      self%v(nq + 1:nq + nzd) = y(2*nq + nz + 1:2*nq + nz + nzd)
      self%energy%sums = y(2*nq + nz + nzd + 1:)
      call system%accelerations(t, y(1:nq), y(nq + 1:2*nq), y(2*nq + 1:2*nq + nz), self%v(nq + 1:), self%vd, &
                                self%lambda, self%energy%powers)
    end associate
    self%newton%h = 0.0_wp
    self%newton%exact_left = 0
    self%newton%contraction = 1.0_wp
    call set_step(self, system, h, 0.0_wp)
    associate (nq => self%nq)                 ! differences of forces are taken: nothing may depend on the step before
      call find_offsets(self, system, self%x(nq + 1:), self%v(nq + 1:), self%vd(nq + 1:))
      call system%smooth(t, self%x(1:nq), self%v(1:nq), self%dx(nq + 1:), self%lambda, self%vd(1:nq), ok)
      if (ok) self%vd(nq + 1:) = self%resolved*self%vd(nq + 1:)
    end associate
    self%lag = 0.0_wp
    self%offset = 0.0_wp
    if (ok) call find_offset(self, system, t)
    self%lag(1:self%nq) = self%method%lag/(self%method%offset*h**2)*self%offset
  end subroutine start_method

  !> Coefficients and constant factors of a step size.
  subroutine set_step(self, system, h, near)
    type(alpha_solver), intent(inout) :: self
    class(second_order_ode), intent(inout) :: system
    real(wp), intent(in) :: h                 !! [s]
    real(wp), intent(in) :: near              !! as prepare_step has it [-]
    logical :: ok
    if (abs(h - self%now%h) <= 0.0_wp .and. .not. self%needs_factors) return
    if (abs(h - self%now%h) > 0.0_wp) then
      self%newton%contraction = 1.0_wp
      self%newton%factors(1) = self%newton%factors(1) + system%blocks
      self%now = step_coefficients(self%method, h)
    end if
    call prepare_step(self, system, near, ok)
    if (.not. ok) self%newton%exact_left = huge(0)   ! only rounding leaves no factor; the exact matrix decides then
  end subroutine set_step
end module alpha_stepper
