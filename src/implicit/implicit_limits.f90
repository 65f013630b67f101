!> States of an implicit march that mean nothing any more though all their numbers are finite: it stops there and not when the
!> numbers end.
module implicit_limits
  use kinds, only: wp
  use implicit_model, only: implicit_solver
  use mechanism, only: mechanism_model
  use ode_system, only: sane
  implicit none (type, external)
  private
  public :: beyond_sense

  integer, parameter, public :: sensible = 0, out_of_shape = 1, out_of_turns = 2
  real(wp), parameter :: most_shape = 1.0e3_wp     !! deflections, of the scene's size, and rotations of sections [-], [rad]
  real(wp), parameter :: most_angle = 1.0e12_wp    !! of a frame: its sine then has four digits left [rad]

contains

  !> Whether the accepted state has a body that deflects beyond all shape or moves at no sensible rate, or one that has turned
  !> beyond the digits of its angle.
  pure function beyond_sense(self, m) result(what)
    type(implicit_solver), intent(in) :: self
    type(mechanism_model), intent(in) :: m
    integer :: what                            !! sensible, out_of_shape or out_of_turns
    integer :: b
    what = merge(sensible, out_of_shape, sane(self%v) .and. sane(self%vd))
    do b = 1, size(self%b)                     ! groups 4b-1, 4b: elastic translations and rotations
      if (self%scale(4*b - 1) > most_shape*m%s%size .or. self%scale(4*b) > most_shape) what = out_of_shape
      if (abs(self%q(m%s%qo(b) + 3)) > most_angle) what = out_of_turns
    end do
  end function beyond_sense
end module implicit_limits
