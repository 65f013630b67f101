!> The generalized-alpha method as a transient sees it. A step is in `alpha_newton`.
module alpha_stepper
  use kinds, only: wp
  use archive, only: value_archive
  use alpha_newton, only: solve_trial, take_trial
  use alpha_start, only: start_method, change_step
  use alpha_state, only: alpha_solver, set_up_alpha, pack, exchange_alpha
  use generalized_alpha, only: chung_hulbert
  use implicit_march, only: implicit_stepper, exchange_march, start_again
  use second_order_system, only: near_length, second_order_ode
  use step_control, only: same_length
  use summary_text, only: summary_record
  implicit none (type, external)
  private

  !> The method.
  type, extends(implicit_stepper), public :: alpha_march
    real(wp) :: spectral_radius = 0.9_wp      !! [-]
    type(alpha_solver) :: solver
  contains
    procedure :: set_up
    procedure :: solve_step
    procedure :: take_step
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
  !> so that those of a short piece would shake a longer one. A shorter one changes the method's variables.
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
        call change_step(s, system, h, merge(near_length, 0.0_wp, self%roots%locating))
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
end module alpha_stepper
