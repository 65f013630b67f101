!> How positions are measured: in groups (origins, angles, elastic translations and rotations of a body), each by the largest value
!> that it has had, or by the scene's size.
module position_measures
  use kinds, only: wp
  implicit none (type, external)
  private

  !> The groups.
  type, public :: position_measure
    integer, allocatable :: group(:)         !! (nq)
    logical, allocatable :: grows(:)         !! (groups) its size grows with its values
    real(wp), allocatable :: weight(:)       !! (nq) of a unit value [m, rad]
    real(wp), allocatable :: scale(:)        !! (groups) running maxima [m, rad]
    real(wp), allocatable :: by_group(:)         !! (nq) weight over scale [1/m, 1/rad]
    real(wp), allocatable :: by_scene(:)        !! (nq) weight over the scene's size or one radian [1/m, 1/rad]
  contains
    procedure :: widen
  end type position_measure

contains

  !> Running maxima of the groups.
  pure subroutine widen(self, q)
    class(position_measure), intent(inout) :: self
    real(wp), intent(in) :: q(:)             !! (nq) [m, rad]
    integer :: i, g
    logical :: wider
    wider = self%by_group(1) <= 0.0_wp
    do i = 1, size(self%group)
      g = self%group(i)
      if (.not. self%grows(g)) cycle
      if (self%weight(i)*abs(q(i)) > self%scale(g)) then
        self%scale(g) = self%weight(i)*abs(q(i))
        wider = .true.
      end if
    end do
    if (.not. wider) return
    do i = 1, size(self%group)
      self%by_group(i) = self%weight(i)/self%scale(self%group(i))
    end do
  end subroutine widen
end module position_measures
