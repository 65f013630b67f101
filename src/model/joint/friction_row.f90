!> The tangential row of a joint with dry friction: the relative angle of the sections of a pin, the way along the line of a slider
!> or prismatic joint. Where the joint sticks, the row holds and its multiplier is the friction; where it slips, the row is off and
!> its multiplier is what `friction_law` says.
module friction_row
  use kinds, only: wp
  use constraint, only: constraint_rows, row_motion
  use friction_law, only: coulomb_law, most_pads
  use line_joint, only: line_model
  use marker, only: marker_states
  use root_watch, only: watched_roots, root_rounding
  implicit none (type, external)
  private

  !> States: sticks; slips in the direction of its sign; at rest without sticking, as other rows carry it, with the static
  !> limit in the direction of its sign, or with no force.
  integer, parameter, public :: row_stuck = 0, row_slips = 1, row_carried = 2, row_idle = 3
  real(wp), parameter, public :: creeping = 1.0e-10_wp   !! a slower joint is at rest, sizes a second [1/s]

  real(wp), parameter, public :: grip = 1.0e-11_wp       !! a row that sticks holds by so much more: it does not come and go [-]
  real(wp), parameter, public :: stopped = 1.0e-13_wp    !! a rate so small is zero where one slips, sizes a second [1/s]

  !> The row.
  type, extends(line_model), public :: friction_model
    type(coulomb_law) :: law
    integer :: joint_first = 0            !! first row of its joint
    integer :: joint_rows = 0             !! its rows
  contains
    procedure :: evaluate => friction_rows
    procedure :: acts_on => friction_acts_on
    procedure :: components => friction_components
    procedure :: holds => friction_holds
    procedure :: roots => friction_roots
    procedure :: state_word => friction_word
    procedure :: force => friction_force
    procedure :: force_slope
    procedure :: measure => way
    procedure :: sticking_limit
    procedure :: pad_signs
    procedure :: slides
    procedure :: share
    procedure :: pad_code
  end type friction_model

contains

  !> The row, whatever its state.
  pure subroutine friction_rows(self, t, p, r)
    class(friction_model), intent(in) :: self
    real(wp), intent(in) :: t   !! [s]
    type(marker_states), intent(in) :: p
    type(constraint_rows), intent(inout) :: r
    if (self%angular) then
      call self%hold_angle(self%first, 0.0_wp, p, r)
    else
      call self%line_model%evaluate(t, p, r)
    end if
  end subroutine friction_rows

  !> On angles, or as a line.
  pure function friction_acts_on(self) result(yes)
    class(friction_model), intent(in) :: self
    logical :: yes(6)
    yes = [.false., .false., .true., .false., .false., .true.]
    if (.not. self%angular) yes = self%line_model%acts_on()
  end function friction_acts_on

  !> An angle is linear.
  pure function friction_components(self, grounded) result(list)
    class(friction_model), intent(in) :: self
    logical, intent(in) :: grounded
    integer, allocatable :: list(:)
    list = self%line_model%components(grounded)
    if (self%angular) list = list(:0)
  end function friction_components

  !> It holds while it sticks.
  pure logical function friction_holds(self, state) result(yes)
    class(friction_model), intent(in) :: self
    integer, intent(in) :: state
    yes = state == row_stuck
  end function friction_holds

  !> The multiplier of a row that is off.
  pure real(wp) function friction_force(self, state, lambda) result(f)   ! [N]
    class(friction_model), intent(in) :: self
    integer, intent(in) :: state
    real(wp), intent(in) :: lambda(:)     !! multipliers of all rows [N]
    f = 0.0_wp
    if (abs(state) == row_slips .or. abs(state) == row_carried) f = sign(1, state) &
      *self%law%limit(self%size, lambda(self%joint_first:self%joint_first + self%joint_rows - 1), abs(state) == row_carried)
  end function friction_force

  !> Derivatives of that force by the joint's multipliers.
  pure function force_slope(self, state, lambda) result(d)
    class(friction_model), intent(in) :: self
    integer, intent(in) :: state
    real(wp), intent(in) :: lambda(:)     !! multipliers of all rows [N]
    real(wp) :: d(self%joint_rows)           ! [-]
    d = 0.0_wp
    if (abs(state) == row_slips .or. abs(state) == row_carried) d = sign(1, state) &
      *self%law%slope(self%size, lambda(self%joint_first:self%joint_first + self%joint_rows - 1), abs(state) == row_carried)
  end function force_slope

  !> Sticking: what is left to the static limit. Slipping: the speed, and the normal forces, at whose change of sign the limit has a
  !> kink. At rest without sticking: how far it is from moving.
  pure subroutine friction_roots(self, now, lambda, watched)
    class(friction_model), intent(in) :: self
    type(row_motion), intent(in) :: now
    real(wp), intent(in) :: lambda(:)     !! [N]
    type(watched_roots), intent(out) :: watched
    real(wp) :: c, n(most_pads), scale
    integer :: k
    watched = watched_roots()
    associate (at => lambda(self%joint_first:self%joint_first + self%joint_rows - 1))
      scale = maxval(abs(lambda))
      select case (abs(now%state))
      case (row_stuck)
        c = self%sticking_limit(lambda)
        watched%g(1) = c*(1 + grip) - abs(lambda(self%first))
        watched%rate(1) = huge(1.0_wp)
        watched%zero(1) = root_rounding*(c + scale)
      case (row_slips)
        watched%g(1) = now%state*now%rate
        watched%rate(1) = now%state*now%acceleration
        watched%zero(1) = root_rounding*now%speed + stopped*self%size
        n = self%law%pads(self%size, at)*self%pad_signs(now%memory)
        do k = 1, most_pads
          if (.not. abs(n(k)) > 0.0_wp) cycle
          watched%g(1 + k) = n(k)
          watched%rate(1 + k) = huge(1.0_wp)
          watched%zero(1 + k) = root_rounding*scale
        end do
      case default
        watched%g(1) = creeping*self%size - abs(now%rate)
        watched%rate(1) = -sign(now%acceleration, now%acceleration*now%rate)
        watched%zero(1) = root_rounding*creeping*self%size
      end select
    end associate
  end subroutine friction_roots

  !> Signs of the pads' normal forces while a row slips, which it keeps as 0 to 3 in its memory.
  pure function pad_signs(self, memory) result(s)
    class(friction_model), intent(in) :: self
    real(wp), intent(in) :: memory        !! [-]
    real(wp) :: s(most_pads)              ! [-]
    s = 1.0_wp - 2*[mod(nint(memory), 2), nint(memory)/2]
  end function pad_signs

  !> The same from the multipliers; those that have just fallen to zero are the opposite of before.
  pure real(wp) function pad_code(self, lambda, before, fallen) result(memory)   ! [-]
    class(friction_model), intent(in) :: self
    real(wp), intent(in) :: lambda(:)     !! multipliers of all rows [N]
    real(wp), intent(in) :: before        !! [-]
    logical, intent(in) :: fallen(most_pads)
    logical :: negative(most_pads)
    negative = self%law%pads(self%size, lambda(self%joint_first:self%joint_first + self%joint_rows - 1)) < 0.0_wp
    negative = merge(self%pad_signs(before) > 0.0_wp, negative, fallen)
    memory = dot_product([1, 2], merge(1, 0, negative))
  end function pad_code

  !> What the row measures.
  pure function way(self, p) result(x)
    class(friction_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp) :: x                         ! [m]
    if (self%angular) then
      x = self%size*(p%angle(self%ia) - p%angle(self%ib))
    else
      x = self%line_model%measure(p)
    end if
  end function way

  !> Up to which force it sticks.
  pure real(wp) function sticking_limit(self, lambda) result(c)   ! [N]
    class(friction_model), intent(in) :: self
    real(wp), intent(in) :: lambda(:)     !! multipliers of all rows [N]
    c = self%law%limit(self%size, lambda(self%joint_first:self%joint_first + self%joint_rows - 1), .true.)
  end function sticking_limit

  !> The direction in which it slides, 0 at rest.
  pure integer function slides(self, state)
    class(friction_model), intent(in) :: self
    integer, intent(in) :: state
    slides = merge(sign(1, state), 0, abs(state) == row_slips)
  end function slides

  !> Part of its limit that acts: 1 where it slips.
  pure real(wp) function share(self, state, lambda)   ! [-]
    class(friction_model), intent(in) :: self
    integer, intent(in) :: state
    real(wp), intent(in) :: lambda(:)     !! multipliers of all rows [N]
    share = merge(1.0_wp, 0.0_wp, abs(lambda(self%first)) > 0.0_wp)
    if (abs(state) /= row_slips) share = abs(lambda(self%first))/max(self%sticking_limit(lambda), tiny(1.0_wp))
  end function share

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
    case default
      word = 'carried'
    end select
  end function friction_word
end module friction_row
