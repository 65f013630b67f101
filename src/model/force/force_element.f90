!> Base of all springs and loads: wrenches on a marker a and, where there is a second one, on a marker b. A kind says
!> its wrenches with their powers; its tangent, energy and the rest where these are not zero.
module force_element
  use kinds, only: wp
  use constraint, only: marker_stiffness
  use history, only: breakpoint
  use internal_variables, only: internal_state
  use marker, only: marker_states
  use measure, only: listed, measure_box, measure_model, measured
  use root_watch, only: by_position, most_roots, root_rounding, watched_roots
  use small_matrices, only: outer
  implicit none (type, external)
  private
  public :: append, by_position, most_roots, root_rounding, watched_roots

  integer, parameter, public :: stage_all = 0, stage_static = 1, stage_transient = 2
  integer, parameter, public :: stage_linear = 3   !! about a state that no static analysis has found: loads of all stages alone
  integer, parameter, public :: inactive = 0   !! discrete state in which an element does nothing: a stop that is open
  integer, parameter, public :: on_a_piece = 1   !! the one discrete state of what goes by pieces
  integer, parameter, public :: bilateral = huge(1)   !! state in which it is linearised as though it acted both ways

  !> Values on which an element may depend beside the motion of its markers and its internal variables.
  type, public :: conditions
    real(wp) :: t = 0.0_wp                !! time [s]
    logical :: left_limit = .false.       !! a jump of a history at t does not act yet
    integer :: stage = stage_transient    !! the analysis: stage_static, stage_transient or stage_linear
    real(wp) :: load_factor = 1.0_wp      !! fraction of the loads that acts [-]
    real(wp) :: prestress = 1.0_wp        !! fraction of the springs' prestress that acts [-]
    real(wp) :: signal = 1.0_wp           !! output of the controller that it obeys, or its factor [-]
    real(wp) :: slopes(2) = 0.0_wp        !! its derivatives by one of its arguments and by the rate of that [-]
    real(wp) :: axes(2) = [1.0_wp, 0.0_wp]   !! cosine and sine of the frame angle of marker a's body [-]
    integer :: state = by_position        !! discrete state of an element that switches
    real(wp) :: event_value = 0.0_wp      !! what it keeps from its last event: a stop the speed at touching [m/s] or [rad/s]
    real(wp) :: multiplier = 0.0_wp       !! of its own constraint row, where it has one [N]
  end type conditions

  !> Forces and powers of an element at a state.
  type, public :: element_action
    real(wp) :: a(3) = 0.0_wp             !! force on marker a, global axes [N], and moment [N m]
    real(wp) :: b(3) = 0.0_wp             !! the same on marker b [N], [N m]
    real(wp) :: force = 0.0_wp            !! along its one deformation, tension > 0 [N] or [N m]
    real(wp) :: dissipated = 0.0_wp       !! power [W]
    real(wp) :: input = 0.0_wp            !! power put in [W]
  end type element_action

  !> A spring, a load or anything else that acts by forces that follow from the state.
  type, abstract, extends(internal_state), public :: force_model
    character(32) :: name = ''
    character(8) :: group = 'force'       !! the deck's word after `&`, for messages
    integer :: ia = 0, ib = 0             !! markers a and b; the same where it acts on one
    logical :: angular = .false.          !! its deformation is an angle
    logical :: acts(6) = .false.          !! whether it can act on x, y, section angle of marker a, then of b
    logical :: along_line = .false.       !! it acts along the line between its markers, which turns
    logical :: in_frame = .false.         !! its force on a keeps its direction in the axes of a's body
    real(wp) :: stiffness = 0.0_wp        !! static, of its deformation; at most, if it varies [N/m] or [N m/rad]
    real(wp) :: damping = 0.0_wp          !! of the deformation's rate; at most, if it varies [N s/m] or [N m s/rad]
    integer :: controller = 0             !! number of the controller whose output scales its force, 0: none
    integer :: motion_factor = 0          !! number of the factor that scales it and follows motions, 0: none
    real(wp) :: size = 1.0_wp             !! the scene's size: what lengths are small against [m]
    logical :: switches = .false.         !! it has discrete states, between which events lead
    integer :: switch_number = 0          !! its number among the elements that switch
    integer :: row = 0                    !! its own constraint row; 0: it has none
    class(measure_model), allocatable :: measure  !! its deformation, or what a stop limits; loads have none
    integer :: stage = stage_all          !! the analyses in which it acts
    integer :: motions = 0                !! number of motions that its force follows beside those of its markers
    type(measure_box), allocatable :: arguments(:) !! these motions
  contains
    procedure :: product => elastic_product
    procedure(state_to_action), deferred :: act
    procedure :: tangent => no_tangent
    procedure :: components => acting_components  !! of the markers (1 to 3 of a, 4 to 6 of b) that the tangent joins
    procedure :: rate_components => damped_components !! of them, those whose rates it sees
    procedure, non_overridable :: slope           !! derivative of the wrenches by an argument
    procedure :: argument_tangent                 !! the tangent by the motion of an argument's markers
    procedure :: signal => no_signal              !! what an element that only watches gives to factors
    procedure :: unit_wrench => no_wrench         !! wrench on a for a unit of the history that scales it
    procedure :: deformation
    procedure :: tangent_along
    procedure :: energy => no_energy
    procedure :: relax => keep_coordinates        !! internal variables of an element at rest
    procedure :: in_all_directions                !! it pulls its markers together in every direction
    procedure :: init_from_assembly               !! takes free lengths and angles from the assembled markers
    procedure :: check => no_check                !! what is wrong with it as assembled, what is worth telling
    procedure :: breakpoints => no_breakpoints    !! times at which its force is not smooth
    procedure :: roots => no_roots                !! what it watches in its present state
    procedure :: switch => no_switch              !! its state after an event, or where none has led to it
    procedure :: state_word => no_word            !! a state in a word, for files
  end type force_model

  !> Makes an array of different kinds possible.
  type, public :: force_box
    class(force_model), allocatable :: item
  end type force_box

  abstract interface
    !> Wrenches, powers and highest derivatives of the internal variables at a state.
    pure subroutine state_to_action(self, p, with, z, zd, zdd, x)
      import :: force_model, marker_states, conditions, element_action, wp
      class(force_model), intent(in) :: self
      type(marker_states), intent(in) :: p
      type(conditions), intent(in) :: with
      real(wp), intent(in) :: z(*)          !! (nz) all internal variables [m, rad]
      real(wp), intent(in) :: zd(*)         !! (nzd) rates of those of second order [m/s, rad/s]
      real(wp), intent(inout) :: zdd(*)     !! (nz) highest derivatives [m/s2, rad/s2], [m/s, rad/s]
      type(element_action), intent(inout) :: x
    end subroutine state_to_action
  end interface

contains

  !> Appends an element to a list.
  subroutine append(list, item)
    type(force_box), allocatable, intent(inout) :: list(:)
    class(force_model), allocatable, intent(inout) :: item
    type(force_box), allocatable :: longer(:)
    integer :: k
    allocate (longer(size(list) + 1))
    do k = 1, size(list)
      call move_alloc(list(k)%item, longer(k)%item)
    end do
    call move_alloc(item, longer(k)%item)
    call move_alloc(longer, list)
  end subroutine append

  !> x k y of the static stiffness, which terms multiply; most elements have none [J].
  pure real(wp) function elastic_product(self, n, x, y) result(total)   ! [J]
    class(force_model), intent(in) :: self
    integer, intent(in) :: n
    real(wp), intent(in) :: x(n), y(n)      !! [m] or [rad]
    total = self%stiffness*x(1)*y(1)
  end function elastic_product

  !> Forces that are constant in global axes have no tangent. Kinds set k%k, and k%c if they damp: minus the wrenches' derivatives
  !> by displacements and turns of the markers (global axes) and by their rates.
  pure subroutine no_tangent(self, p, with, part, force, k)
    class(force_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp), intent(in) :: part(2)         !! factors of the deformation's stiffness and damping [-]
    real(wp), intent(in) :: force           !! present force along the deformation [N] or [N m]
    type(marker_stiffness), intent(inout) :: k
    k%k = 0.0_wp
    k%c = 0.0_wp
  end subroutine no_tangent

  !> Of a force along its measure: stiffness g g' + damping g (H q')' + force H, damping g g'.
  pure subroutine tangent_along(self, p, stiffness, damping, force, k)
    class(force_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: stiffness, damping   !! [N/m], [N s/m] or [N m/rad], [N m s/rad]
    real(wp), intent(in) :: force                !! against the measure [N] or [N m]
    type(marker_stiffness), intent(inout) :: k
    type(measured) :: now
    real(wp) :: h(6, 6)                          ! [1/m], [-], [m]
    call self%measure%measure(p, now)
    k%k = stiffness*outer(now%g, now%g)
    k%c = damping*outer(now%g, now%g)
    if (self%measure%straight) return
    call self%measure%curvature(p, h)
    k%k = k%k + damping*outer(now%g, matmul(h, self%measure%rates(p))) + force*h
  end subroutine tangent_along

  !> Most tangents join what the element acts on.
  pure function acting_components(self) result(list)
    class(force_model), intent(in) :: self
    integer, allocatable :: list(:)
    list = listed(self%acts)
  end function acting_components

  !> All of them, if it damps.
  pure function damped_components(self) result(list)
    class(force_model), intent(in) :: self
    integer, allocatable :: list(:)
    list = pack(self%components(), self%damping > 0.0_wp)
  end function damped_components

  !> How the wrench grows with an argument; where no load acts and the question is what holds at all, that of a unit load factor.
  pure function slope(self, p, with) result(w)
    class(force_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp) :: w(6)                        !! on markers a and b [N, N m] over the argument's unit
    w = 0.0_wp
    if (self%stage /= stage_all .and. self%stage /= with%stage) return
    w(1:3) = with%slopes(1)*self%unit_wrench(p, with)
    if (self%controller > 0 .or. with%load_factor > 0.0_wp) w = with%load_factor*w
  end function slope

  !> Minus the derivatives of the wrenches on a and b (rows) by the places and rates of the argument's markers (columns).
  pure subroutine argument_tangent(self, p, with, j, k)
    class(force_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with    !! with the slopes by this argument
    integer, intent(in) :: j                !! which argument
    type(marker_stiffness), intent(inout) :: k
    type(conditions) :: by_rate_of          ! by the rate of the argument
    real(wp) :: by_place(6), by_rate(6)     ! [-], [m], [1/s]
    call self%arguments(j)%item%gradient(p, by_place, by_rate)
    k%k = -outer(self%slope(p, with), by_place)
    k%c = -outer(self%slope(p, with), by_rate)
    if (.not. abs(with%slopes(2)) > 0.0_wp) return
    by_rate_of = with
    by_rate_of%slopes(1) = with%slopes(2)
    k%c = k%c - outer(self%slope(p, by_rate_of), by_place)
  end subroutine argument_tangent

  !> Most elements act.
  pure subroutine no_signal(self, p, with, h)
    class(force_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp), intent(out) :: h(0:1)         !! value and its slope by what is watched [any]
    h = 0.0_wp
  end subroutine no_signal

  !> Most elements do not follow a history.
  pure function no_wrench(self, p, with) result(w)
    class(force_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp) :: w(3)                        !! [N, N m]
    w = 0.0_wp
  end function no_wrench

  !> Its measure less the datum.
  pure type(measured) function deformation(self, p) result(now)
    class(force_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    call self%measure%measure(p, now)
    now%x = now%x - self%measure%datum
  end function deformation

  !> Whether its measure does.
  pure logical function in_all_directions(self) result(yes)
    class(force_model), intent(in) :: self
    yes = allocated(self%measure)
    if (yes) yes = self%measure%in_all_directions()
  end function in_all_directions

  !> Most elements store nothing.
  pure real(wp) function no_energy(self, p, z, zd) result(energy)   ! [J]
    class(force_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: z(*), zd(*)     !! all internal variables [m, rad] and rates
    energy = 0.0_wp
  end function no_energy

  !> Without internal variables there is nothing to set.
  pure subroutine keep_coordinates(self, p, prestress, z)
    class(force_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: prestress       !! fraction that acts [-]
    real(wp), intent(inout) :: z(*)         !! (nz) all internal variables [m, rad]
  end subroutine keep_coordinates

  !> The datum of its measure, and those of the motions that it follows.
  subroutine init_from_assembly(self, p, gap)
    class(force_model), intent(inout) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: gap             !! distance up to which markers coincide [m]
    integer :: k
    if (allocated(self%measure)) call self%measure%init_from_assembly(p, gap)
    do k = 1, self%motions
      call self%arguments(k)%item%init_from_assembly(p, gap)
    end do
  end subroutine init_from_assembly

  !> Most elements can act wherever their markers are.
  pure subroutine no_check(self, p, gap, fault, warning)
    class(force_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: gap             !! distance up to which markers coincide [m]
    character(:), allocatable, intent(out) :: fault, warning   !! empty: none
    fault = ''
    warning = ''
  end subroutine no_check

  !> Most elements do not depend on time.
  pure function no_breakpoints(self, until) result(list)
    class(force_model), intent(in) :: self
    real(wp), intent(in) :: until           !! end of the run [s]
    type(breakpoint), allocatable :: list(:)
    allocate (list(0))
  end function no_breakpoints

  !> Most elements watch nothing.
  pure subroutine no_roots(self, p, with, watched)
    class(force_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with          !! with its present state
    type(watched_roots), intent(out) :: watched
    watched = watched_roots()
  end subroutine no_roots

  !> Most elements have no states.
  pure subroutine no_switch(self, p, with, which, state, event_value)
    class(force_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with          !! with its present state
    integer, intent(in) :: which                  !! the root that fell to zero; 0: no event
    integer, intent(out) :: state                 !! the next one
    real(wp), intent(out) :: event_value          !! what it keeps from this event [m/s] or [rad/s]
    state = with%state
    event_value = with%event_value
  end subroutine no_switch

  !> Most elements have no states.
  pure function no_word(self, state) result(word)
    class(force_model), intent(in) :: self
    integer, intent(in) :: state
    character(:), allocatable :: word
    word = 'none'
  end function no_word
end module force_element
