!> Roots of elements with discrete states.
module root_watch
  use kinds, only: wp
  implicit none (type, external)
  private

  integer, parameter, public :: by_position = -huge(1)   !! no discrete state is kept: an element takes it from its position
  integer, parameter, public :: most_roots = 3           !! that an element watches at a time
  real(wp), parameter, public :: root_rounding = 64*epsilon(1.0_wp)   !! a root so small is zero, of what it is a difference of [-]

  real(wp), parameter, public :: resting = 1.0e-11_wp   !! what solves and projections leave of a force or an acceleration that is
                                                        !! none, of its scale [-]; of a rate, sizes a second [1/s]

  !> Each root is positive in the present state, its fall to zero is an event.
  type, public :: watched_roots
    real(wp) :: g(most_roots) = huge(1.0_wp)      !! values; huge: not watched [m], [rad] or [-]; of rows [m/s] or [N]
    real(wp) :: rate(most_roots) = 0.0_wp         !! their rates; huge: not known [m/s], [rad/s], [1/s]; of rows [m/s2]
    real(wp) :: zero(most_roots) = root_rounding  !! a value so small is rounding, in the unit of g [any]
  end type watched_roots
end module root_watch
