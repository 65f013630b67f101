!> The tangential row of a joint with dry friction: the relative angle of the sections of a pin, the position along the line of a
!> slider or prismatic joint. Where the joint sticks, the row holds and its multiplier is the friction; where it slips, the row is
!> off and its multiplier is what `friction_law` says.
module friction_row
  use kinds, only: wp
  use constraint, only: constraint_model, row_motion
  use friction_law, only: coulomb_law, most_pads, row_at_limit, row_parted, row_stuck, row_slips
  use root_watch, only: watched_roots, resting, root_rounding
  implicit none (type, external)
  private

  !> The row.
  type, extends(constraint_model), public :: friction_model
    type(coulomb_law) :: law
  contains
    procedure :: holds => friction_holds
    procedure :: bounds => static_limit
    procedure :: roots => friction_roots
    procedure :: state_word => friction_word
  end type friction_model

contains

  !> It holds while it sticks.
  pure logical function friction_holds(self, state) result(yes)
    class(friction_model), intent(in) :: self
    integer, intent(in) :: state
    yes = state == row_stuck
  end function friction_holds

  !> The static limit, either way.
  pure function static_limit(self, side, lambda, pressed) result(bounds)
    class(friction_model), intent(in) :: self
    integer, intent(in) :: side           !! 0
    real(wp), intent(in) :: lambda(:)     !! multipliers of all rows [N]
    real(wp), intent(in) :: pressed       !! force of its stop [N]
    real(wp) :: bounds(2)                 ! [N]
    bounds = [-1, 1]*self%law%limit(.true., lambda, pressed)
  end function static_limit

  !> Sticking: what is left to the static limit. Slipping: the speed, and the normal forces, at whose change of sign the limit has a
  !> kink. At rest without sticking: how far it is from moving.
  pure subroutine friction_roots(self, now, lambda, watched)
    class(friction_model), intent(in) :: self
    type(row_motion), intent(in) :: now
    real(wp), intent(in) :: lambda(:)     !! [N]
    type(watched_roots), intent(out) :: watched
    real(wp) :: c, n(most_pads), noise       ! [N]
    integer :: k
    watched = watched_roots()
    noise = now%noise/now%compliance
    select case (abs(now%state))
    case (row_stuck)
      c = self%law%limit(.true., lambda, now%pressed)
      watched%g(1) = c*(1 + resting) - abs(lambda(self%first))
      watched%rate(1) = huge(1.0_wp)
      watched%zero(1) = root_rounding*c + noise
    case (row_slips)
      watched%g(1) = now%state*now%rate
      watched%rate(1) = now%state*now%acceleration
      watched%zero(1) = now%still
      n = self%law%pads(lambda)*self%law%pad_signs(now%event_value)
      do k = 1, most_pads
        if (.not. abs(n(k)) > 0.0_wp) cycle
        watched%g(1 + k) = n(k)
        watched%rate(1 + k) = huge(1.0_wp)
        watched%zero(1 + k) = noise
      end do
    case (row_parted)
      return
    case default
      watched%g(1) = resting*self%size - abs(now%rate)
      watched%rate(1) = -sign(now%acceleration, now%acceleration*now%rate)
      watched%zero(1) = root_rounding*resting*self%size
    end select
  end subroutine friction_roots

  !> A state in a word.
  pure function friction_word(self, state) result(word)
    class(friction_model), intent(in) :: self
    integer, intent(in) :: state
    character(:), allocatable :: word
    select case (state)
    case (row_stuck)
      word = 'stuck'
    case (row_slips)
      word = 'forward'
    case (-row_slips)
      word = 'backward'
    case (row_at_limit, -row_at_limit)
      word = 'at_limit'
    case (row_parted)
      word = 'parted'
    case default
      word = 'unloaded'
    end select
  end function friction_word
end module friction_row
