!> The generalized-alpha method as a transient sees it: fixed steps (`alpha_fixed`) or steps by the estimated error
!> (`alpha_adaptive`). A step is in `alpha_newton`.
module alpha_stepper
  use kinds, only: wp
  use alpha_adaptive, only: advance_adaptive
  use alpha_fixed, only: advance_fixed
  use alpha_march, only: alpha_steps
  use generalized_alpha, only: chung_hulbert
  use alpha_state, only: set_up_alpha
  use ode_system, only: ode
  use second_order_system, only: second_order_ode
  use time_stepper, only: lost
  implicit none (type, external)
  private

  !> The method.
  type, extends(alpha_steps), public :: implicit_stepper
  contains
    procedure :: begin
    procedure :: advance
  end type implicit_stepper

contains

  !> Takes the state; the method's own variables follow with the first step, whose size they need.
  subroutine begin(self, system, t, y)
    class(implicit_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in) :: y(:)              !! (n)
    self%t = t
    self%y = y
    self%trial = y
    if (self%adaptive) allocate (self%dense(size(y), 4), self%error(size(y)), source=0.0_wp)
    if (self%adaptive) call self%norm%watch(y)
    select type (system)
    class is (second_order_ode)
      call system%start_implicit()
      call set_up_alpha(self%solver, system, chung_hulbert(self%spectral_radius))
      call system%derivative(t, y, .false., self%trial)
    end select
  end subroutine begin

  !> Marches towards an output time (see `time_stepper`).
  subroutine advance(self, system, from, to, most, y, outcome)
    class(implicit_stepper), intent(inout) :: self
    class(ode), intent(inout) :: system
    real(wp), intent(in) :: from, to          !! [s]
    integer, intent(in) :: most
    real(wp), intent(inout) :: y(:)           !! (n)
    integer, intent(out) :: outcome
    outcome = lost
    select type (system)
    class is (second_order_ode)
      if (self%adaptive) then
        call advance_adaptive(self, system, from, to, most, y, outcome)
      else
        call advance_fixed(self, system, from, to, most, y, outcome)
      end if
    end select
  end subroutine advance
end module alpha_stepper
