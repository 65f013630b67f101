!> What an integrator sees: a system y' = f(t, y) with a manifold that accepted states are projected onto. No mechanics.
module ode_system
  use kinds, only: wp
  use, intrinsic :: iso_fortran_env, only: int64
  implicit none (type, external)
  private
  public :: is_bounded

  real(wp), parameter, public :: largest_value = 1.0e40_wp   !! beyond it a state is lost; products of several still fit [any]
  integer, parameter :: lanes = 8, many = 128   !! values compared side by side; least size of a state for which that pays

  !> The system.
  type, abstract, public :: ode
    integer :: n = 0                          !! unknowns
    logical :: has_manifold = .true.          !! accept may move a state (projection)
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

  !> Whether every value is finite and below `largest_value`, so that products of a few of them stay finite.
  pure function is_bounded(y) result(yes)
    real(wp), intent(in), contiguous :: y(:)  !! [any]
    logical :: yes
    integer :: n
    n = size(y) - mod(size(y), lanes)
    if (n < many) n = 0
    yes = bounded(size(y) - n, y(n + 1:))
    if (yes .and. n > 0) yes = many_bounded(n, y)
  end function is_bounded

  !> The same by comparing bit patterns as integers, which processors do several at a time: those of positive reals have the
  !> order of the reals, with infinity and NaN above all.
  pure function bounded(n, y) result(yes)
    integer, intent(in) :: n
    real(wp), intent(in) :: y(n)   !! [any]
    logical :: yes
    integer(int64) :: excess, limit
    integer :: k
    limit = transfer(largest_value, limit)
    excess = 0
    do k = 1, n
      excess = ior(excess, limit - iand(transfer(y(k), limit), huge(limit)))
    end do
    yes = excess >= 0
  end function bounded

  !> The same for n a multiple of `lanes`, with so many values compared side by side.
  pure function many_bounded(n, y) result(yes)
    integer, intent(in) :: n
    real(wp), intent(in) :: y(lanes, n/lanes)   !! [any]
    logical :: yes
    integer(int64) :: excess(lanes), limit
    integer :: k, i
    limit = transfer(largest_value, limit)
    excess = 0
    do k = 1, n/lanes
      do i = 1, lanes
        excess(i) = ior(excess(i), limit - iand(transfer(y(i, k), limit), huge(limit)))
      end do
    end do
    yes = all(excess >= 0)
  end function many_bounded
end module ode_system
