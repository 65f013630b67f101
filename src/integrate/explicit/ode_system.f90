!> What an integrator sees: a system y' = f(t, y) with a manifold that accepted states are projected onto. No mechanics.
module ode_system
  use kinds, only: wp
  implicit none (type, external)
  private
  public :: is_bounded

  real(wp), parameter, public :: largest_value = 1.0e40_wp   !! beyond it a state is lost; products of several still fit [any]

  !> The system.
  type, abstract, public :: ode
    integer :: n = 0                          !! unknowns
    logical :: has_manifold = .true.          !! `project` may move a state
  contains
    procedure(right_hand_side), deferred :: derivative
    procedure(onto_manifold), deferred :: project
  end type ode

  abstract interface
    !> f(t, y). With left = .true. jumps of the loads at t are not yet felt: the end of a step belongs to the step.
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

  !> Whether every value is finite and below `largest_value`, so that products of a few of them stay finite. All are tested, several
  !> at a time, which is faster than a search for the first that is not.
  pure function is_bounded(y) result(yes)
    real(wp), intent(in), contiguous :: y(:)  !! [any]
    logical :: yes
    yes = count(abs(y) < largest_value) == size(y)
  end function is_bounded
end module ode_system
