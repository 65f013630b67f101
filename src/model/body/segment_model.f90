!> The internal variables of neighbouring elements that share one viscoelastic material, or of modal amplitudes on one material.
module segment_model
  use kinds, only: wp
  use internal_variables, only: internal_state
  implicit none (type, external)
  private

  !> With the stiffness that the terms multiply: of each element, or of all modes.
  type, extends(internal_state), public :: viscoelastic_segment
    integer :: first = 0, last = 0            !! columns of the body's deformations: elements; of modes, one a material
    integer :: material = 0                   !! index of the material, for messages
    real(wp), allocatable :: ea_l(:)          !! elements: E_R A/l, empty without axial deformation [N/m]
    real(wp), allocatable :: ei_l(:)          !! elements: E_R I/l [N m]
    real(wp), allocatable :: stiffness(:, :)  !! modes (k x k) [rad2/s2]
  contains
    procedure :: product => strain_product
    procedure :: dissipation => strain_dissipation
  end type viscoelastic_segment

contains

  !> x^T D y [J].
  pure function strain_product(self, n, x, y) result(total)
    class(viscoelastic_segment), intent(in) :: self
    integer, intent(in) :: n
    real(wp), intent(in) :: x(n), y(n)        !! deformations, internal variables or their rates [m, rad, ...]
    real(wp) :: total                         !! [J]
    if (allocated(self%stiffness)) then
      total = of_modes(n, self%stiffness, x, y)
    else if (size(self%ea_l) > 0) then
      total = axial_and_bending(n/3, self%ea_l, self%ei_l, x, y)
    else
      total = bending(n/2, self%ei_l, x, y)
    end if
  end function strain_product

  !> With axial deformation.
  pure function axial_and_bending(n, ea_l, ei_l, x, y) result(total)
    integer, intent(in) :: n                  !! elements
    real(wp), intent(in) :: ea_l(n)           !! [N/m]
    real(wp), intent(in) :: ei_l(n)           !! [N m]
    real(wp), intent(in) :: x(3, n), y(3, n)  !! [m, rad, ...]
    real(wp) :: total, bend, stretch          !! [J]
    integer :: e
    bend = 0.0_wp
    stretch = 0.0_wp
    do e = 1, n
      stretch = stretch + ea_l(e)*x(1, e)*y(1, e)
      bend = bend + ei_l(e)*(x(2, e)*(2*y(2, e) + y(3, e)) + x(3, e)*(y(2, e) + 2*y(3, e)))
    end do
    total = stretch + 2*bend
  end function axial_and_bending

  !> Without.
  pure function bending(n, ei_l, x, y) result(total)
    integer, intent(in) :: n                  !! elements
    real(wp), intent(in) :: ei_l(n)           !! [N m]
    real(wp), intent(in) :: x(2, n), y(2, n)  !! [rad, ...]
    real(wp) :: total                         !! [J]
    integer :: e
    total = 0.0_wp
    do e = 1, n
      total = total + ei_l(e)*(x(1, e)*(2*y(1, e) + y(2, e)) + x(2, e)*(y(1, e) + 2*y(2, e)))
    end do
    total = 2*total
  end function bending

  !> Of modal amplitudes.
  pure function of_modes(n, stiffness, x, y) result(total)
    integer, intent(in) :: n
    real(wp), intent(in) :: stiffness(n, n)   !! [rad2/s2]
    real(wp), intent(in) :: x(n), y(n)        !! [m kg^1/2]
    real(wp) :: total                         !! [J]
    integer :: j
    total = 0.0_wp
    do j = 1, n
      total = total + y(j)*dot_product(stiffness(:, j), x)
    end do
  end function of_modes

  !> What its terms dissipate: products of rates with themselves, which need fewer operations than those of two vectors.
  pure function strain_dissipation(self, n, m, alpha, viscosity, zd) result(power)
    class(viscoelastic_segment), intent(in) :: self
    integer, intent(in) :: n, m
    real(wp), intent(in) :: alpha(m)          !! [-]
    real(wp), intent(in) :: viscosity(m)      !! [s]
    real(wp), intent(in) :: zd(n, m)          !! [m/s, rad/s, ...]
    real(wp) :: power                         !! [W]
    integer :: k
    power = 0.0_wp
    do k = 1, m
      if (allocated(self%stiffness)) then
        power = power + alpha(k)*viscosity(k)*of_modes(n, self%stiffness, zd(1, k), zd(1, k))
      else if (size(self%ea_l) > 0) then
        power = power + alpha(k)*viscosity(k)*square_of_both(n/3, self%ea_l, self%ei_l, zd(1, k))
      else
        power = power + alpha(k)*viscosity(k)*square_of_bending(n/2, self%ei_l, zd(1, k))
      end if
    end do
  end function strain_dissipation

  !> x^T D x with axial deformation.
  pure function square_of_both(n, ea_l, ei_l, x) result(total)
    integer, intent(in) :: n                  !! elements
    real(wp), intent(in) :: ea_l(n)           !! [N/m]
    real(wp), intent(in) :: ei_l(n)           !! [N m]
    real(wp), intent(in) :: x(3, n)           !! [m, rad, ...]
    real(wp) :: total                         !! [J]
    integer :: e
    total = 0.0_wp
    do e = 1, n
      total = total + (ea_l(e)*x(1, e)**2 + 4*ei_l(e)*(x(2, e)*(x(2, e) + x(3, e)) + x(3, e)**2))
    end do
  end function square_of_both

  !> Without.
  pure function square_of_bending(n, ei_l, x) result(total)
    integer, intent(in) :: n                  !! elements
    real(wp), intent(in) :: ei_l(n)           !! [N m]
    real(wp), intent(in) :: x(2, n)           !! [rad, ...]
    real(wp) :: total                         !! [J]
    integer :: e
    total = 0.0_wp
    do e = 1, n
      total = total + ei_l(e)*(x(1, e)*(x(1, e) + x(2, e)) + x(2, e)**2)
    end do
    total = 4*total
  end function square_of_bending
end module segment_model
