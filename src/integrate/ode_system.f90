!> The system of an integrator: y' = f(t, y) with a manifold that accepted states are projected onto. No mechanics.
module ode_system
  use kinds, only: wp, ip
  implicit none (type, external)
  private
  public :: is_bounded

  real(wp), parameter, public :: largest_value = 1.0e40_wp   !! beyond it a state is lost; products of several still fit [any]

  !> How a state moves what a root is a function of: bounds of the root between two states follow from it.
  type, public :: root_course
    real(wp) :: w(2) = 0.0_wp                 !! rates of coordinates; the root changes at most by the sum of their changes [any/s]
    real(wp) :: turning = 0.0_wp              !! of what may turn these rates [rad/s]
    real(wp) :: bend = huge(1.0_wp)           !! largest second derivative by the coordinates; huge: not known [any]
  end type root_course

  !> The system.
  type, abstract, public :: ode
    integer :: n = 0                          !! unknowns
    logical :: has_manifold = .true.          !! `project` may move a state
    integer :: roots = 0                      !! functions that are watched: positive, the fall of one to zero is an event
    real(wp) :: longest_step = huge(1.0_wp)   !! that resolves the motion which the last events have started [s]
    real(wp) :: resting_step = huge(1.0_wp)   !! longest step of adaptive methods while nothing moves: errors do not limit it [s]
    logical :: fault = .false.                !! the system itself has no solution from here
    logical :: events_may_follow = .false.    !! at the state of the last `find_roots`, without the fall of a root
    logical :: unchanged = .false.            !! the last `resolve_events` has found nothing to change
  contains
    procedure(right_hand_side), deferred :: derivative
    procedure(onto_manifold), deferred :: project
    procedure :: evaluate_on_manifold
    procedure :: find_roots => no_roots
    procedure :: find_courses => no_courses
    procedure :: follow_roots => no_motion
    procedure :: resolve_events => no_events
    procedure :: note_step => no_note
    procedure :: longest_fixed => as_events_allow
  end type ode

  abstract interface
    !> f(t, y). With left_limit jumps of the loads at t do not act yet: the end of a step belongs to the step.
    subroutine right_hand_side(self, t, y, left_limit, dy)
      import :: ode, wp
      class(ode), intent(inout) :: self
      real(wp), intent(in) :: t               !! [s]
      real(wp), intent(in), contiguous :: y(:)    !! (n) [unit of each unknown]
      logical, intent(in) :: left_limit
      real(wp), intent(out), contiguous :: dy(:)  !! (n) [the same per second]
    end subroutine right_hand_side
    !> Puts the end of a step onto the manifold; ok is false where that fails or y is not finite.
    subroutine onto_manifold(self, t, y, ok)
      import :: ode, wp
      class(ode), intent(inout) :: self
      real(wp), intent(in) :: t               !! [s]
      real(wp), intent(inout), contiguous :: y(:) !! (n) [unit of each unknown]
      logical, intent(out) :: ok
    end subroutine onto_manifold
  end interface

contains

  !> Puts a state onto the manifold and evaluates it there: the derivative dy and all that sensors read. The projection uses the
  !> factors of an evaluation at the state.
  subroutine evaluate_on_manifold(self, t, y, left_limit, dy, ok)
    class(ode), intent(inout) :: self
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(inout), contiguous :: y(:) !! (n) [unit of each unknown]
    logical, intent(in) :: left_limit         !! jumps at t do not act yet
    real(wp), intent(out), contiguous :: dy(:)  !! (n) [the same per second]
    logical, intent(out) :: ok                !! the state and its derivative are finite, the projection has succeeded
    ok = .true.
    call self%derivative(t, y, left_limit, dy)
    if (self%has_manifold) then
      call self%project(t, y, ok)
      if (.not. ok) return
      call self%derivative(t, y, left_limit, dy)
    end if
    ok = is_bounded(y) .and. is_bounded(dy)
  end subroutine evaluate_on_manifold

  !> Roots at a state: their values, their rates and the values that count as zero. Huge values are not watched, huge rates not
  !> known. Here: none.
  subroutine no_roots(self, t, y, left_limit, g, rate, zero)
    class(ode), intent(inout) :: self
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in), contiguous :: y(:)  !! (n) [unit of each unknown]
    logical, intent(in) :: left_limit         !! y is the end of a step
    real(wp), intent(out) :: g(:), rate(:), zero(:)   !! (roots) [any], [any/s], [any]
    g = huge(1.0_wp)
    rate = huge(1.0_wp)
    zero = 0.0_wp
  end subroutine no_roots

  !> Courses of the roots that were found last. Here: none.
  subroutine no_courses(self, course)
    class(ode), intent(in) :: self
    type(root_course), intent(out) :: course(:)   !! (roots)
    course = root_course()
  end subroutine no_courses

  !> Roots that need no derivative, at a state within a step: their values and rates as above, and their courses; others are huge.
  !> Here: none. The last `find_roots` and `derivative` stand.
  subroutine no_motion(self, t, y, g, rate, course)
    class(ode), intent(inout) :: self
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in), contiguous :: y(:)  !! (n) without quadratures [unit of each unknown]
    real(wp), intent(out) :: g(:), rate(:)    !! (roots) [any], [any/s]
    type(root_course), intent(out) :: course(:)   !! (roots)
    g = huge(1.0_wp)
    rate = huge(1.0_wp)
    course = root_course()
  end subroutine no_motion

  !> Changes by events: of the system's own states, and of the state y where an event makes it jump. Not ok where events follow one
  !> another without end. Here: nothing.
  subroutine no_events(self, t, y, fallen, ok)
    class(ode), intent(inout) :: self
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(inout), contiguous :: y(:) !! (n) [unit of each unknown]
    logical, intent(in) :: fallen(:)          !! (roots) those that have fallen to zero
    logical, intent(out) :: ok
    ok = .true.
  end subroutine no_events

  !> Notes an accepted step: its length and the roots at both ends. Here: nothing.
  subroutine no_note(self, h, g0, rate0, g1, rate1)
    class(ode), intent(inout) :: self
    real(wp), intent(in) :: h                 !! its length [s]
    real(wp), intent(in) :: g0(:), rate0(:), g1(:), rate1(:)   !! (roots) as `find_roots` says [any], [any/s]
  end subroutine no_note

  !> The longest fixed step, or part of one of length h, with which a method keeps its order. Here: what events allow.
  real(wp) function as_events_allow(self, h, order) result(longest)   ! [s]
    class(ode), intent(in) :: self
    real(wp), intent(in) :: h                 !! [s]
    integer, intent(in) :: order              !! of the method
    longest = self%longest_step
  end function as_events_allow

  !> Whether every value is finite and below `largest_value`, so that products of a few of them stay finite. All are tested, several
  !> at a time, which is faster than a search for the first that is not.
  pure logical function is_bounded(y) result(yes)
    real(wp), intent(in), contiguous :: y(:)  !! [any]
    yes = count(abs(y) < largest_value, kind=ip) == size(y)   ! of eight bytes, as the values: half of the instructions
  end function is_bounded
end module ode_system
