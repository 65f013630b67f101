!> The internal variables of neighbouring elements, or of a layer of theirs, that share one viscoelastic material, or of modal
!> amplitudes on one material.
module segment_model
  use kinds, only: wp
  use internal_variables, only: internal_state
  implicit none (type, external)
  private

  !> With the stiffness that the terms multiply: of each element, or of all modes.
  type, extends(internal_state), public :: viscoelastic_segment
    integer :: first = 0, last = 0            !! columns of the body's deformations: rows; of modes, one a material
    integer :: material = 0                   !! index of the material
    integer :: layer = 0                      !! the layer of the sections, 0: they have one at most, or several on one material
    integer :: losses = 0                     !! what its terms dissipate follows this place among the scene's losses
    real(wp), allocatable :: diagonal(:)      !! rows of elements: of each [N/m, N m]
    real(wp), allocatable :: stiffness(:, :)  !! modes (k x k) [rad2/s2]
  contains
    procedure :: product => segment_product
  end type viscoelastic_segment

contains

  !> x^T D y [J].
  pure real(wp) function segment_product(self, n, x, y) result(total)   ! [J]
    class(viscoelastic_segment), intent(in) :: self
    integer, intent(in) :: n
    real(wp), intent(in) :: x(n), y(n)        !! deformations, internal variables or their rates [m, rad, ...]
    integer :: j
    if (allocated(self%stiffness)) then
      total = 0.0_wp
      do j = 1, n
        total = total + y(j)*dot_product(self%stiffness(:, j), x)
      end do
    else
      total = sum(self%diagonal*x*y)
    end if
  end function segment_product

end module segment_model
