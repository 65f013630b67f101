!> Torsional springs: angle of section a minus that of section b minus the free angle.
module torsional_spring
  use kinds, only: wp
  use marker, only: marker_states
  use spring, only: spring_model
  implicit none (type, external)
  private

  !> One torsional spring.
  type, extends(spring_model), public :: torsional_model
  contains
    procedure :: deformation => turn_of_sections
    procedure :: acts_on
    procedure :: components => angles
  end type torsional_model

contains

  !> Relative angle and its rate.
  pure subroutine turn_of_sections(self, p, d, dd, e)
    class(torsional_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(out) :: d             !! [rad]
    real(wp), intent(out) :: dd            !! [rad/s]
    real(wp), intent(out) :: e(3)          !! [-]
    d = p%angle(self%ia) - p%angle(self%ib) - self%free
    dd = p%rate(self%ia) - p%rate(self%ib)
    e = [0.0_wp, 0.0_wp, 1.0_wp]
  end subroutine turn_of_sections

  !> It acts by moments.
  pure function acts_on(self) result(yes)
    class(torsional_model), intent(in) :: self
    logical :: yes(6)
    yes = [.false., .false., .true., .false., .false., .true.]
  end function acts_on

  !> It acts between the angles of both sections.
  pure function angles(self) result(list)
    class(torsional_model), intent(in) :: self
    integer, allocatable :: list(:)
    list = [3, 6]
  end function angles
end module torsional_spring
