!> Joints and drives: rows of Phi(q, t) = 0 between two markers, weight (x - target), each with a measure x. A row's gradient with
!> respect to each marker is a unit wrench: a direction n (global) on the marker's position and s on its section angle. A gear acts
!> on the section angle of a third marker, too. Rows are in metres: angles count times the scene's size.
module constraint
  use kinds, only: wp
  use history, only: breakpoint, history_model
  use marker, only: marker_states
  use measure, only: listed, measure_box, measure_model, measured
  use root_watch, only: watched_roots
  implicit none (type, external)
  private

  integer, parameter :: most_rows = 3     !! of a joint: a weld holds everything

  !> Rows of all constraints, as arrays: zero but for what a constraint sets.
  type, public :: constraint_rows
    real(wp), allocatable :: na(:, :)     !! (2, n) gradient with respect to the position of marker a [-]
    real(wp), allocatable :: sa(:)        !! (n) with respect to the section angle of marker a [m]
    real(wp), allocatable :: nb(:, :)     !! (2, n) the same at marker b [-]
    real(wp), allocatable :: sb(:)        !! (n) [m]
    real(wp), allocatable :: sc(:)        !! (n) of rows with a carrier: with respect to its section angle [m]
    real(wp), allocatable :: phi(:)       !! (n) Phi [m]
    real(wp), allocatable :: phi_t(:)     !! (n) its partial derivative in time [m/s]
    logical :: begun = .false.            !! gradients that never change stand in it
    logical :: left_limit = .false.       !! jumps of histories at the time of evaluation do not act yet
    real(wp), allocatable :: acceleration_bias(:) !! (n) part of the second derivative beside the markers' accelerations [m/s2]
    logical, allocatable :: off(:)        !! (n) it holds nothing now; allocated where rows switch
    real(wp), allocatable :: pressed(:)   !! (n) force of the stop whose friction a row is, of others 0; likewise [N]
    real(wp), allocatable :: acceleration(:)   !! (n) second derivatives, zero but for rounding of rows that hold; likewise [m/s2]
    real(wp) :: largest = 0.0_wp          !! of accelerations without multipliers, of frames and of rows [m/s2]
    real(wp) :: strongest = 0.0_wp        !! of the multipliers [N]
  end type constraint_rows

  !> State and motion of a row that switches, whether it holds or not.
  type, public :: row_motion
    integer :: state = 0
    real(wp) :: event_value = 0.0_wp      !! what it keeps from its last event: a row that holds the value it is measured from [m]
    real(wp) :: rate = 0.0_wp             !! [m/s]
    real(wp) :: acceleration = 0.0_wp     !! [m/s2]
    real(wp) :: still = 0.0_wp            !! a rate so small is none [m/s]
    real(wp) :: compliance = 0.0_wp       !! its acceleration by a unit multiplier [1/kg]
    real(wp) :: noise = 0.0_wp            !! an acceleration so small is none [m/s2]
    real(wp) :: pressed = 0.0_wp          !! force of the stop beside it [N]
  end type row_motion

  !> Second derivatives of lambda.Phi with respect to (x, y, angle) of marker a, then of marker b.
  type, public :: marker_stiffness
    integer :: ia = 0, ib = 0             !! markers
    real(wp) :: k(6, 6) = 0.0_wp          !! d(wrench on markers)/d(marker displacements) [N/m, N, N m]
    real(wp) :: c(6, 6) = 0.0_wp          !! d(wrench on markers)/d(marker velocities) [N s/m ...]
  end type marker_stiffness

  !> A joint or a drive: what it holds are its measures.
  type, public :: constraint_model
    character(32) :: name = ''
    integer :: ia = 0, ib = 0             !! markers a and b
    integer :: ic = 0                     !! gears: marker of the carrier, 0: none
    integer :: first = 0                  !! its first row
    integer :: rows = 0                   !! number of rows
    type(measure_box), allocatable :: measures(:)   !! of each row, and possibly others behind
    logical :: drive = .false.            !! its one row depends on time
    real(wp) :: size = 1.0_wp             !! the scene's size, weight of angle rows [m]
    class(history_model), allocatable :: target   !! of drives
    logical :: rate = .false.             !! drives: the history gives the rate
    logical :: angular = .false.          !! its first measure is an angle
    integer :: switch_number = 0          !! its number among the elements that switch, 0: it holds always
    logical :: one_sided = .false.        !! rows that switch: it only pushes, at a limit
    integer :: parent = 0                 !! rows that switch: the joint whose markers it has, 0: they are its own
  contains
    procedure :: hold
    procedure :: attach
    procedure, non_overridable :: evaluate
    procedure, non_overridable :: is_plain
    procedure :: geometric
    procedure :: acts_on
    procedure :: components
    procedure :: line_turns
    procedure :: init_from_assembly
    procedure :: position
    procedure :: way
    procedure :: weight
    procedure, non_overridable :: prescribed
    procedure :: breakpoints => drive_breakpoints !! times at which accelerations are not smooth, with the order of their jump
    procedure :: fault
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

contains

  !> Adds a row that holds a measure at its datum.
  subroutine hold(self, x, datum, pending)
    class(constraint_model), intent(inout) :: self
    class(measure_model), intent(in) :: x
    real(wp), intent(in), optional :: datum       !! 0, where it is not given [m] or [rad]
    logical, intent(in), optional :: pending      !! the datum follows from the assembled markers
    if (.not. allocated(self%measures)) allocate (self%measures(most_rows))
    self%rows = self%rows + 1
    allocate (self%measures(self%rows)%item, source=x)
    if (present(datum)) self%measures(self%rows)%item%datum = datum
    if (present(pending)) self%measures(self%rows)%item%pending = pending
    self%angular = self%measures(1)%item%angular
  end subroutine hold

  !> Gives it its markers.
  subroutine attach(self, a, b, c)
    class(constraint_model), intent(inout) :: self
    integer, intent(in) :: a, b, c                !! c: 0, where it has no carrier
    integer :: k
    self%ia = a
    self%ib = b
    self%ic = c
    do k = 1, self%rows
      self%measures(k)%item%ia = a
      self%measures(k)%item%ib = b
      self%measures(k)%item%ic = c
    end do
  end subroutine attach

  !> Whether a row is weight (x_a - x_b - datum) with positions along a direction that stays, or with section angles, at any time:
  !> `constraint_values` evaluates all of these together, once their gradients are written.
  pure logical function is_plain(self, k)
    class(constraint_model), intent(in) :: self
    integer, intent(in) :: k                      !! row of its own
    associate (x => self%measures(k)%item)
      is_plain = x%straight .and. .not. (self%drive .or. abs(x%carrier) > 0.0_wp)
    end associate
  end function is_plain

  !> Fills one of its rows from the states of the markers. A gradient that never changes stands there already, once it is written.
  pure subroutine evaluate(self, k, t, p, r)
    class(constraint_model), intent(in) :: self
    integer, intent(in) :: k                      !! row of its own
    real(wp), intent(in) :: t                     !! [s]
    type(marker_states), intent(in) :: p
    type(constraint_rows), intent(inout) :: r
    type(measured) :: now
    real(wp) :: w, h(0:2)                         ! weight [-] or [m]; target
    integer :: i
    i = self%first + k - 1
    associate (x => self%measures(k)%item)
      if (x%pending) return
      call x%measure(p, now)
      w = 1.0_wp
      if (x%angular) w = self%size
      r%phi(i) = w*(now%x - x%datum)
      if (.not. (x%straight .and. r%begun)) then
        r%na(:, i) = w*now%g(1:2)
        r%sa(i) = w*now%g(3)
        r%nb(:, i) = w*now%g(4:5)
        r%sb(i) = w*now%g(6)
        r%sc(i) = w*x%carrier
        r%acceleration_bias(i) = w*now%bias
      end if
      if (.not. self%drive) return
      call self%prescribed(t, r%left_limit, h)
      r%phi(i) = w*(now%x - h(0))
      r%phi_t(i) = -w*h(1)
      r%acceleration_bias(i) = w*(now%bias - h(2))
    end associate
  end subroutine evaluate

  !> Second derivatives of lambda.Phi with respect to the states of both markers.
  pure subroutine geometric(self, p, lambda, k)
    class(constraint_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: lambda(:)             !! multipliers of all rows [N]
    type(marker_stiffness), intent(inout) :: k    !! k%k is set
    real(wp) :: h(6, 6)                           ! [1/m], [-], [m]
    integer :: j
    k%k = 0.0_wp
    do j = 1, self%rows
      associate (x => self%measures(j)%item)
        if (x%straight) cycle
        call x%curvature(p, h)
        k%k = k%k + merge(self%size, 1.0_wp, x%angular)*lambda(self%first + j - 1)*h
      end associate
    end do
  end subroutine geometric

  !> Whether rows can act on x, y, section angle of marker a, then of b.
  pure function acts_on(self) result(yes)
    class(constraint_model), intent(in) :: self
    logical :: yes(6)
    integer :: k
    yes = .false.
    do k = 1, self%rows
      yes = yes .or. self%measures(k)%item%acts
    end do
  end function acts_on

  !> Components of the markers (1 to 3 of a, 4 to 6 of b) that `geometric` joins.
  pure function components(self) result(list)
    class(constraint_model), intent(in) :: self
    integer, allocatable :: list(:)
    logical :: bent(6)
    integer :: k
    bent = .false.
    do k = 1, self%rows
      if (.not. self%measures(k)%item%straight) bent = bent .or. self%measures(k)%item%acts
    end do
    list = listed(bent)
  end function components

  !> Whether it holds marker a on a line that turns with section b.
  pure logical function line_turns(self) result(yes)
    class(constraint_model), intent(in) :: self
    yes = any(self%components() == 6)
  end function line_turns

  !> Takes lengths and origins that the deck leaves open from the assembled markers.
  subroutine init_from_assembly(self, p)
    class(constraint_model), intent(inout) :: self
    type(marker_states), intent(in) :: p
    integer :: k
    do k = 1, self%rows
      call self%measures(k)%item%init_from_assembly(p, 0.0_wp)
    end do
  end subroutine init_from_assembly

  !> What its first row measures.
  pure real(wp) function position(self, p)        ! [m] or [rad]
    class(constraint_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(measured) :: now
    call self%measures(1)%item%measure(p, now)
    position = now%x
  end function position

  !> From one value of its first measure to another, the short way round where it goes round a closed curve.
  pure real(wp) function way(self, from, to)      ! [m] or [rad]
    class(constraint_model), intent(in) :: self
    real(wp), intent(in) :: from, to              !! [m] or [rad]
    way = to - from
    associate (period => self%measures(1)%item%period)
      if (period > 0.0_wp) way = way - period*anint(way/period)
    end associate
  end function way

  !> Factor from its unit to metres.
  pure real(wp) function weight(self)             ! [-] or [m]
    class(constraint_model), intent(in) :: self
    weight = merge(self%size, 1.0_wp, self%angular)
  end function weight

  !> What a drive prescribes, with two derivatives: its origin plus the history, or by rate plus the integral since t = 0.
  pure subroutine prescribed(self, t, left_limit, h)
    class(constraint_model), intent(in) :: self
    real(wp), intent(in) :: t                     !! [s]
    logical, intent(in) :: left_limit             !! limit from below
    real(wp), intent(out) :: h(0:2)               !! [m, rad], per s, per s2
    real(wp) :: now(-1:2), at_start(-1:2)
    call self%target%evaluate(t, left_limit, now)
    associate (origin => self%measures(1)%item%datum)
      h = [origin + now(0), now(1:2)]
      if (.not. self%rate) return
      call self%target%evaluate(0.0_wp, .false., at_start)
      h = [origin + (now(-1) - at_start(-1)), now(0:1)]
    end associate
  end subroutine prescribed

  !> A link without a length has no direction.
  pure function fault(self, gap) result(text)
    class(constraint_model), intent(in) :: self
    real(wp), intent(in) :: gap                   !! distance up to which markers coincide [m]
    character(:), allocatable :: text
    integer :: k
    text = ''
    do k = 1, self%rows
      associate (x => self%measures(k)%item)
        if (x%radial .and. x%datum <= gap) text = 'its markers coincide, so that the link between them has no length; expected '// &
          'two markers apart, or type=''revolute'''
      end associate
    end do
  end function fault

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
  pure function no_bounds(self, side, lambda, pressed) result(bounds)
    class(constraint_model), intent(in) :: self
    integer, intent(in) :: side                   !! limit of a stop
    real(wp), intent(in) :: lambda(:)             !! multipliers of all rows [N]
    real(wp), intent(in) :: pressed               !! force of the stop beside the row [N]
    real(wp) :: bounds(2)                         ! [N]
    bounds = [-1, 1]*huge(1.0_wp)
  end function no_bounds

  !> Most rows hold where they are.
  pure real(wp) function present_place(self, p, side) result(x)   ! [m]
    class(constraint_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    integer, intent(in) :: side                   !! limit of a stop
    x = self%weight()*self%position(p)
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
end module constraint
