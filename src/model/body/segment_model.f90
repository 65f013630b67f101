!> The internal variables of neighbouring elements, or of a layer of theirs, that share one viscoelastic material, or of modal
!> amplitudes on one material.
module segment_model
  use kinds, only: wp
  use beam_element, only: bending
  use internal_variables, only: internal_state
  implicit none (type, external)
  private
  public :: strain_product

  !> With the stiffness that the terms multiply: of each element, or of all modes.
  type, extends(internal_state), public :: viscoelastic_segment
    integer :: first = 0, last = 0            !! columns of the body's deformations: elements; of modes, one a material
    integer :: material = 0                   !! index of the material
    integer :: layer = 0                      !! the layer of the sections, 0: they have one at most, or several on one material
    integer :: losses = 0                     !! what its terms dissipate follows this place among the scene's losses
    real(wp), allocatable :: ea_l(:)          !! elements: E_R A/l, empty without axial deformation [N/m]
    real(wp), allocatable :: ei_l(:)          !! elements: E_R I/l [N m]
    real(wp), allocatable :: diagonal(:)      !! rows of layers: of each [N/m, N m]
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
    if (allocated(self%ei_l)) then
      if (size(self%ea_l) > 0) then
        total = sum(strain_product(n/3, 3, self%ea_l, self%ei_l, x, y))
      else
        total = sum(strain_product(n/2, 2, self%ea_l, self%ei_l, x, y))
      end if
    else if (allocated(self%stiffness)) then
      total = of_modes(n, self%stiffness, x, y)
    else
      total = sum(self%diagonal*x*y)
    end if
  end function segment_product

  !> x^T D y of n elements at E_R, of extension and of bending: deformations (e, phi1, phi2), or (phi1, phi2) without the first.
  pure function strain_product(n, nd, ea_l, ei_l, x, y) result(parts)
    integer, intent(in) :: n, nd
    real(wp), intent(in) :: ea_l(*)             !! (n) or none [N/m]
    real(wp), intent(in) :: ei_l(n)             !! [N m]
    real(wp), intent(in) :: x(nd, n), y(nd, n)  !! [m, rad, rad], or their rates
    real(wp) :: parts(2)                        !! [J]
    real(wp) :: stretch, bend
    integer :: e
    stretch = 0.0_wp
    bend = 0.0_wp
    do e = 1, n
      if (nd == 3) stretch = stretch + ea_l(e)*x(1, e)*y(1, e)
      associate (x1 => x(nd - 1, e), x2 => x(nd, e), y1 => y(nd - 1, e), y2 => y(nd, e))
        bend = bend + ei_l(e)*(x1*(bending(1, 1)*y1 + bending(1, 2)*y2) + x2*(bending(2, 1)*y1 + bending(2, 2)*y2))
      end associate
    end do
    parts = [stretch, bend]
  end function strain_product

  !> x^T D y of modal amplitudes.
  pure real(wp) function of_modes(n, stiffness, x, y) result(total)   ! [J]
    integer, intent(in) :: n
    real(wp), intent(in) :: stiffness(n, n)   !! [rad2/s2]
    real(wp), intent(in) :: x(n), y(n)        !! [m kg^1/2]
    integer :: j
    total = 0.0_wp
    do j = 1, n
      total = total + y(j)*dot_product(stiffness(:, j), x)
    end do
  end function of_modes
end module segment_model
