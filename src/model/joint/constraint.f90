!> Base of all joints and drives: rows of Phi(q, t) = 0 between two markers. A row's gradient with respect
!> to each marker is a unit wrench: a direction n (global) on the marker's position and s on its section angle. A gear acts
!> on the section angle of a third marker, too. Rows are in metres: angles count times the scene's size.
module constraint
  use kinds, only: wp
  use history, only: breakpoint, drive_values, history_model
  use marker, only: marker_states
  use root_watch, only: watched_roots
  implicit none (type, external)
  private

  !> Rows of all constraints, as arrays: zero but for what a constraint sets.
  type, public :: constraint_rows
    real(wp), allocatable :: na(:, :)     !! (2, n) gradient with respect to the position of marker a [-]
    real(wp), allocatable :: sa(:)        !! (n) with respect to the section angle of marker a [m]
    real(wp), allocatable :: nb(:, :)     !! (2, n) the same at marker b [-]
    real(wp), allocatable :: sb(:)        !! (n) [m]
    real(wp), allocatable :: sc(:)        !! (n) of rows with a carrier: with respect to its section angle [m]
    real(wp), allocatable :: phi(:)       !! (n) Phi [m]
    real(wp), allocatable :: phi_t(:)     !! (n) its partial derivative in time [m/s]
    logical :: left_limit = .false.       !! jumps of histories at the time of evaluation do not act yet
    real(wp), allocatable :: acceleration_bias(:) !! (n) part of the second derivative beside the markers' accelerations [m/s2]
    logical, allocatable :: off(:)        !! (n) it holds nothing now; allocated where rows switch
    real(wp), allocatable :: acceleration(:)   !! (n) second derivatives, zero but for rounding of rows that hold; likewise [m/s2]
    real(wp) :: largest = 0.0_wp          !! of accelerations without multipliers, of frames and of rows [m/s2]
    real(wp) :: strongest = 0.0_wp        !! of the multipliers [N]
  end type constraint_rows

  !> State and motion of a row that switches, whether it holds or not.
  type, public :: row_motion
    integer :: state = 0
    real(wp) :: memory = 0.0_wp           !! what it keeps from its last event: a row that holds the value it is measured from [m]
    real(wp) :: rate = 0.0_wp             !! [m/s]
    real(wp) :: acceleration = 0.0_wp     !! [m/s2]
    real(wp) :: still = 0.0_wp            !! a rate so small is none [m/s]
    real(wp) :: compliance = 0.0_wp       !! its acceleration by a unit multiplier [1/kg]
    real(wp) :: noise = 0.0_wp            !! an acceleration so small is none [m/s2]
  end type row_motion

  !> Second derivatives of lambda.Phi with respect to (x, y, angle) of marker a, then of marker b.
  type, public :: marker_stiffness
    integer :: ia = 0, ib = 0             !! markers
    real(wp) :: k(6, 6) = 0.0_wp          !! d(wrench on markers)/d(marker displacements) [N/m, N, N m]
    real(wp) :: c(6, 6) = 0.0_wp          !! d(wrench on markers)/d(marker velocities) [N s/m ...]
  end type marker_stiffness

  !> A joint or a drive.
  type, abstract, public :: constraint_model
    character(32) :: name = ''
    integer :: ia = 0, ib = 0             !! markers a and b
    integer :: ic = 0                     !! gears: marker of the carrier, 0: none
    integer :: first = 0                  !! its first row
    integer :: rows = 0                   !! number of rows
    logical :: drive = .false.            !! depends on time
    real(wp) :: size = 1.0_wp             !! the scene's size, weight of angle rows [m]
    class(history_model), allocatable :: target   !! of drives
    logical :: rate = .false.             !! drives: the history gives the rate
    real(wp) :: origin = 0.0_wp           !! drives: what the history, or its integral, is added to [m] or [rad]
    logical :: pending = .false.          !! takes its value from the assembled positions; until then its one row holds nothing
    logical :: angular = .false.          !! drives: the quantity is an angle
    integer :: switch_number = 0          !! its number among the elements that switch, 0: it holds always
    logical :: one_sided = .false.        !! rows that switch: it only pushes, at a limit
    integer :: parent = 0                 !! rows that switch: the joint whose markers it has, 0: they are its own
  contains
    procedure(evaluate_rows), deferred :: evaluate
    procedure :: geometric => no_geometric
    procedure(list_actions), deferred :: acts_on   !! whether rows can act on x, y, section angle of marker a, then of b
    procedure :: init_from_deck => keep_as_is !! takes what it needs from the markers of the deck
    procedure :: init_from_assembly => settle !! takes what it needs from the assembled markers
    procedure :: measure => no_quantity       !! the quantity that a drive prescribes
    procedure :: start_value                  !! what a drive makes of it at t = 0
    procedure :: breakpoints => drive_breakpoints !! times at which accelerations are not smooth, with the order of their jump
    procedure :: components => no_components   !! of the markers (1 to 3 of a, 4 to 6 of b) that `geometric` joins
    procedure :: line_turns => has_no_line     !! whether it holds marker a on a line that turns with section b
    procedure :: fault => no_fault             !! what is wrong with it as assembled; empty: nothing
    procedure :: release_angle => holds_none   !! drops the row that keeps a relative angle, says whether there was one
    procedure :: hold_angle               !! the row that keeps a relative angle
    procedure :: holds => always          !! whether the row of an element that switches holds in a state
    procedure :: relation => as_it_is     !! how it holds in a state, at a limit: as `friction_law` has states of rows
    procedure :: state_of => as_it_is     !! the state by that
    procedure :: bounds => no_bounds      !! between which its multiplier holds it at rest
    procedure :: place => present_place   !! where it holds if it begins to here
    procedure :: roots => no_roots        !! what that watches in its present state
    procedure :: state_word => no_word    !! a state in a word, for files
  end type constraint_model

  !> Makes an array of different kinds possible.
  type, public :: constraint_box
    class(constraint_model), allocatable :: item
  end type constraint_box

  abstract interface
    !> Fills this constraint's rows from the states of the markers.
    pure subroutine evaluate_rows(self, t, p, r)
      import :: constraint_model, marker_states, constraint_rows, wp
      class(constraint_model), intent(in) :: self
      real(wp), intent(in) :: t                     !! [s]
      type(marker_states), intent(in) :: p
      type(constraint_rows), intent(inout) :: r
    end subroutine evaluate_rows

    !> Components of the markers on which the rows may act, in any state.
    pure function list_actions(self) result(yes)
      import :: constraint_model
      class(constraint_model), intent(in) :: self
      logical :: yes(6)
    end function list_actions
  end interface

contains

  !> Second derivatives of lambda.Phi with respect to the states of both markers: zero, since most rows are linear in them.
  pure subroutine no_geometric(self, p, lambda, k)
    class(constraint_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: lambda(:)             !! multipliers of all rows [N]
    type(marker_stiffness), intent(inout) :: k    !! k%k is set
    k%k = 0.0_wp
  end subroutine no_geometric

  !> Most rows are linear in positions and angles.
  pure function no_components(self, grounded) result(list)
    class(constraint_model), intent(in) :: self
    logical, intent(in) :: grounded               !! marker b is fixed to the ground
    integer, allocatable :: list(:)
    allocate (list(0))
  end function no_components

  !> Most constraints have no line.
  pure logical function has_no_line(self) result(yes)
    class(constraint_model), intent(in) :: self
    yes = .false.
  end function has_no_line

  !> Most constraints can hold wherever their markers are.
  pure function no_fault(self, gap) result(text)
    class(constraint_model), intent(in) :: self
    real(wp), intent(in) :: gap                   !! distance up to which markers coincide [m]
    character(:), allocatable :: text
    text = ''
  end function no_fault

  !> Most constraints take nothing from the positions of the deck.
  subroutine keep_as_is(self, p)
    class(constraint_model), intent(inout) :: self
    type(marker_states), intent(in) :: p
  end subroutine keep_as_is

  !> A relative drive takes the assembled value.
  subroutine settle(self, p)
    class(constraint_model), intent(inout) :: self
    type(marker_states), intent(in) :: p
    if (self%pending) self%origin = self%measure(p)
    self%pending = .false.
  end subroutine settle

  !> Joints prescribe no quantity.
  pure function no_quantity(self, p) result(x)
    class(constraint_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp) :: x                                 !! [m] or [rad]
    x = 0.0_wp
  end function no_quantity

  !> Value that a drive prescribes at t = 0.
  pure function start_value(self) result(x)
    class(constraint_model), intent(in) :: self
    real(wp) :: x                                 !! [m] or [rad]
    real(wp) :: h(0:2)
    call drive_values(self%target, self%rate, self%origin, 0.0_wp, .false., h)
    x = h(0)
  end function start_value

  !> The breakpoints of a drive's history: accelerations jump two orders below the quantity, one below its rate. Joints have none.
  pure function drive_breakpoints(self, until) result(list)
    class(constraint_model), intent(in) :: self
    real(wp), intent(in) :: until                 !! end of the run [s]
    type(breakpoint), allocatable :: list(:)
    allocate (list(0))
    if (.not. self%drive) return
    list = self%target%breakpoints(until)
    list%order = max(0, list%order - merge(1, 2, self%rate))
  end function drive_breakpoints

  !> Most constraints keep no relative angle.
  subroutine holds_none(self, released)
    class(constraint_model), intent(inout) :: self
    logical, intent(out) :: released
    released = .false.
  end subroutine holds_none

  !> Most rows hold always.
  pure logical function always(self, state) result(yes)
    class(constraint_model), intent(in) :: self
    integer, intent(in) :: state
    yes = .true.
  end function always

  !> States of most rows are relations.
  pure integer function as_it_is(self, state, side) result(other)
    class(constraint_model), intent(in) :: self
    integer, intent(in) :: state
    integer, intent(in) :: side                   !! limit of a stop: 1 upper, -1 lower; of others 0
    other = state
  end function as_it_is

  !> Most rows hold whatever acts.
  pure function no_bounds(self, side, lambda) result(bounds)
    class(constraint_model), intent(in) :: self
    integer, intent(in) :: side                   !! limit of a stop
    real(wp), intent(in) :: lambda(:)             !! multipliers of all rows [N]
    real(wp) :: bounds(2)                         ! [N]
    bounds = [-1, 1]*huge(1.0_wp)
  end function no_bounds

  !> Most rows hold where they are.
  pure real(wp) function present_place(self, p, side) result(x)   ! [m]
    class(constraint_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    integer, intent(in) :: side                   !! limit of a stop
    x = self%measure(p)
  end function present_place

  !> Most rows watch nothing.
  pure subroutine no_roots(self, now, lambda, watched)
    class(constraint_model), intent(in) :: self
    type(row_motion), intent(in) :: now
    real(wp), intent(in) :: lambda(:)             !! multipliers of all rows [N]
    type(watched_roots), intent(out) :: watched
    watched = watched_roots()
  end subroutine no_roots

  !> Most rows have no states.
  pure function no_word(self, state) result(word)
    class(constraint_model), intent(in) :: self
    integer, intent(in) :: state
    character(:), allocatable :: word
    word = 'none'
  end function no_word

  !> One row: the angle of section a minus that of section b stays as it is.
  pure subroutine hold_angle(self, i, angle, p, r)
    class(constraint_model), intent(in) :: self
    integer, intent(in) :: i                      !! row
    real(wp), intent(in) :: angle                 !! relative angle [rad]
    type(marker_states), intent(in) :: p
    type(constraint_rows), intent(inout) :: r
    r%sa(i) = self%size
    r%sb(i) = -self%size
    r%phi(i) = self%size*(p%angle(self%ia) - p%angle(self%ib) - angle)
  end subroutine hold_angle
end module constraint
