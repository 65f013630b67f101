!> Flexible bodies in a truncated modal basis: mass-normalised modes, so that m_ff = 1. Their deformations are the amplitudes,
!> once for every viscoelastic material (theory.md, section 5).
module modal_basis
  use kinds, only: wp
  use body, only: body_model, elastic_basis, elastic_work
  use element_law, only: rows_of
  use marker, only: marker_model
  use triplets, only: triplet_matrix
  implicit none (type, external)
  private

  !> A basis of modes.
  type, extends(elastic_basis), public :: modal_model
    real(wp), allocatable :: psi(:, :)        !! (0:nodal, nf) nodal coordinates of each mode, 0: none [m or rad, mass-normalised]
    real(wp), allocatable :: omega2(:)        !! (nf) squared frequencies at E_R [rad2/s2]
  contains
    procedure :: deform
    procedure :: add_stress
    procedure :: strain_parts
    procedure :: largest_force
    procedure :: element_strain
    procedure :: add_stiffness
    procedure :: nodal_values
    procedure :: attach
  end type modal_model

contains

  !> The deformations are the amplitudes.
  pure subroutine deform(self, b, q, d)
    class(modal_model), intent(in) :: self
    type(body_model), intent(in) :: b
    real(wp), intent(in), contiguous :: q(0:)       !! (0:nf) [kg^.5 m]
    real(wp), intent(inout), contiguous :: d(:, :)  !! (nf, segments) [kg^.5 m]
    integer :: r
    do r = 1, size(d, 2)
      d(:, r) = q(1:)
    end do
  end subroutine deform

  !> Elastic forces: Omega2 q, and of every material K (ds - d).
  pure subroutine add_stress(self, b, d, ds, q, factor, f)
    class(modal_model), intent(in) :: self
    type(body_model), intent(in) :: b
    real(wp), intent(in), contiguous :: d(:, :), ds(:, :)   !! (nf, segments) [kg^.5 m]
    real(wp), intent(in), contiguous :: q(0:)       !! (0:nf) [kg^.5 m]
    real(wp), intent(in) :: factor                  !! [-]
    real(wp), intent(inout), contiguous :: f(0:)    !! (0:nf) [kg^.5 m/s2]
    integer :: r, j
    f(1:) = f(1:) + factor*self%omega2*q(1:)
    do r = 1, size(b%segments)
      do j = 1, b%nf
        f(1:) = f(1:) + b%segments(r)%stiffness(:, j)*(factor*(ds(j, r) - d(j, r)))
      end do
    end do
  end subroutine add_stress

  !> All strain energy counts as bending.
  pure function strain_parts(self, b, q, d) result(parts)
    class(modal_model), intent(in) :: self
    type(body_model), intent(in) :: b
    real(wp), intent(in) :: q(:)                    !! (nf) [kg^.5 m]
    real(wp), intent(in), contiguous, optional :: d(:, :)   !! (nf, segments) [kg^.5 m]
    real(wp) :: parts(3)                            !! [J]
    parts = [0.0_wp, sum(self%omega2*q**2), 0.0_wp]
  end function strain_parts

  !> The largest elastic force: modal forces times the square root of the mass.
  pure real(wp) function largest_force(self, b, w) result(force)   ! [N]
    class(modal_model), intent(in) :: self
    type(body_model), intent(in) :: b
    type(elastic_work), intent(in) :: w
    force = maxval(abs(self%omega2*w%q(1:)))*sqrt(b%mass)
  end function largest_force

  !> The rows of an element, each from the amplitudes that its material sees.
  pure function element_strain(self, b, e, w) result(d)
    class(modal_model), intent(in) :: self
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                        !! element
    type(elastic_work), intent(in) :: w
    real(wp), allocatable :: d(:)                   !! [m, rad]
    integer :: r
    d = rows_of(b, e, self%element_coordinates(b, e, w%q(1:)))
    do r = 1, size(b%segments)
      d = merge(rows_of(b, e, self%element_coordinates(b, e, w%ds(:, r))), d, &
                b%layers%kinds(b%layers%kind(e))%material == b%segments(r)%material)
    end do
  end function element_strain

  !> The tangent stiffness: Omega2, and the stiffness of each material.
  pure subroutine add_stiffness(self, b, first, q, w, stiffness, segments)
    class(modal_model), intent(in) :: self
    type(body_model), intent(in) :: b
    integer, intent(in) :: first                    !! coordinates before
    real(wp), intent(in) :: q(:)                    !! (nf) [kg^.5 m]
    type(elastic_work), intent(in) :: w
    type(triplet_matrix), intent(inout) :: stiffness
    type(triplet_matrix), intent(inout) :: segments(:)
    integer :: k, r, all(b%nf)
    all = [(first + k, k=1, b%nf)]
    do k = 1, b%nf
      call stiffness%add(all(k), all(k), self%omega2(k))
    end do
    do r = 1, size(segments)
      call segments(r)%add_block(all, all, b%segments(r)%stiffness)
    end do
  end subroutine add_stiffness

  !> Nodal coordinates: sums over the modes.
  pure subroutine nodal_values(self, n, at, q, a)
    class(modal_model), intent(in) :: self
    integer, intent(in) :: n
    integer, intent(in) :: at(n)                    !! their numbers, 0: removed
    real(wp), intent(in) :: q(:)                    !! (nf) [kg^.5 m]
    real(wp), intent(out) :: a(n)                   !! [m, rad]
    integer :: k, c
    a = 0.0_wp
    do k = 1, size(q)
      do c = 1, n
        a(c) = a(c) + self%psi(at(c), k)*q(k)
      end do
    end do
  end subroutine nodal_values

  !> A marker moves by all modes.
  pure subroutine attach(self, b, p)
    class(modal_model), intent(in) :: self
    type(body_model), intent(in) :: b
    type(marker_model), intent(inout) :: p
    p%psi = self%psi(b%dof(:3, p%node), :)
  end subroutine attach
end module modal_basis
