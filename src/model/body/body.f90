!> A body in its floating frame: its constant inertia integrals, its elastic coordinates and what damps them.
!> Frame: origin R (global), angle theta; every integral is in body axes. Built by `body_setup`.
module body
  use kinds, only: wp
  use banded, only: band_factor
  use beam_element, only: beam_geometry
  use elastic_operators, only: elastic_operator
  use viscoelastic_law, only: viscoelastic_terms
  implicit none (type, external)
  private

  !> A segment of neighbouring elements that share one viscoelastic material, or (modal bodies) one distinct material.
  !> Internal variables of a run: z(component, element, term), those of second order contiguous, and those of first order.
  type, public :: viscoelastic_segment
    integer :: first = 0, last = 0            !! elements
    integer :: offset = 0                     !! of its internal variables of second order among the scene's, from 0
    integer :: first_order = 0                !! of those of first order
    integer :: width = 0                      !! coordinates of one term
    integer :: material = 0                   !! index of the material, for messages
    type(viscoelastic_terms) :: law
    real(wp), allocatable :: stiffness(:, :)  !! modal bodies: the material's modal stiffness (k x k) [N/m scaled]
  end type viscoelastic_segment

  !> A point mass and rotary inertia at a node or at a point of a rigid body.
  type, public :: lump
    integer :: node = 0                       !! 0: a point of a rigid body
    real(wp) :: x(2) = 0.0_wp                 !! where, body axes [m]
    real(wp) :: mass = 0.0_wp                 !! [kg]
    real(wp) :: inertia = 0.0_wp              !! [kg m2]
  end type lump

  !> One rigid or flexible body.
  type, public :: body_model
    character(32) :: name = ''
    logical :: flexible = .false.
    logical :: modal = .false.
    logical :: axial = .true.
    logical :: straight = .true.              !! all elements along body x
    logical :: chain = .false.                !! straight, elements one after the other, linear strain
    logical :: stiffening = .false.
    logical :: rayleigh = .false.
    integer :: nn = 0                         !! nodes
    integer :: ne = 0                         !! elements
    integer :: nf = 0                         !! elastic coordinates
    integer :: nd = 3                         !! deformations kept per element
    integer :: nz = 0                         !! internal variables
    integer :: extra_references = 0           !! reference conditions beyond the three that are needed
    integer :: static_shapes = 0              !! static shapes among the modal coordinates
    real(wp) :: mass = 0.0_wp                 !! m [kg]
    real(wp) :: i1(2) = 0.0_wp                !! integral of u0 [kg m]
    real(wp) :: i11 = 0.0_wp                  !! integral of u0.u0 and rotary inertias [kg m2]
    real(wp) :: length = 0.0_wp               !! largest distance between two nodes [m]
    real(wp), allocatable :: x(:, :)          !! (2, nn) nodes, body axes [m]
    integer, allocatable :: en(:, :)          !! (2, ne) nodes of each element
    type(beam_geometry), allocatable :: elements(:)
    real(wp), allocatable :: factors(:, :)    !! (10, ne) constants of each element (order and units: chain_kernel)
    real(wp), allocatable :: fibre(:)         !! (ne) outer fibre distance [m], 0: none
    real(wp), allocatable :: area(:)          !! (ne) section areas [m2]
    real(wp), allocatable :: second(:)        !! (ne) second moments [m4]
    integer, allocatable :: material(:)       !! (ne) material index
    integer, allocatable :: dof(:, :)         !! (3, nn) number of each nodal coordinate, 0: removed
    integer, allocatable :: edof(:, :)        !! (6, ne) the same by element
    type(lump), allocatable :: lumps(:)
    ! constants of the elastic coordinates (nodal or modal)
    real(wp), allocatable :: sbar(:, :)       !! (nf, 2) S-bar transposed [kg]
    real(wp), allocatable :: i1f(:)           !! (nf) [kg m]
    real(wp), allocatable :: c0(:)            !! (nf) [kg m]
    real(wp), allocatable :: pmat(:, :)       !! (nf, 2) m_ff^-1 S-bar^T [-]
    real(wp) :: sps(2, 2) = 0.0_wp            !! S-bar m_ff^-1 S-bar^T [kg]
    type(band_factor) :: mff                  !! nodal: factor of m_ff
    type(elastic_operator) :: op
    ! modal bodies
    integer :: nodal_nf = 0                   !! nodal coordinates before the reduction
    real(wp), allocatable :: psi(:, :)        !! (3 nn, nf) nodal displacements of each mode [m or rad, mass-normalised]
    real(wp), allocatable :: omega2(:)        !! (nf) squared frequencies at E_R [rad2/s2]
    real(wp), allocatable :: zmodal(:, :)     !! (nf, nf) Psi^T Z Psi [-]
    real(wp), allocatable :: jmodal(:, :)     !! (nf, nf) rotary inertia of lumps, part of m_ff = 1 that theta' does not see
    real(wp), allocatable :: cmodal(:, :)     !! (nf, nf) Rayleigh damping [1/s]
    ! viscoelasticity
    type(viscoelastic_segment), allocatable :: segments(:)
    ! work space of one evaluation
    real(wp), allocatable :: qx(:), vx(:)     !! (0:nf) coordinates and rates, entry 0 is zero
    real(wp), allocatable :: elastic_force(:), angle_coupling(:) !! (0:nf) Q_f and m_theta_f, entry 0 is thrown away
    real(wp), allocatable :: d(:, :)          !! nodal: (nd, ne) deformations; modal: (nf, 1) work
    real(wp), allocatable :: ds(:, :)         !! the same with the terms' differences added
  contains
    procedure :: displacement => node_displacement
  end type body_model

contains

  !> Elastic displacement (u, v, rotation) of a node in body axes; also its rate, from rates.
  pure function node_displacement(self, node, q) result(u)
    class(body_model), intent(in) :: self
    integer, intent(in) :: node        !! node number
    real(wp), intent(in) :: q(:)       !! (nf) elastic coordinates or their rates or accelerations
    real(wp) :: u(3)                   !! [m, m, rad] or their rates
    integer :: k
    u = 0.0_wp
    if (.not. self%flexible) return
    if (self%modal) then
      do k = 1, self%nf
        u = u + self%psi(3*node - 2:3*node, k)*q(k)
      end do
    else
      do k = 1, 3
        if (self%dof(k, node) > 0) u(k) = q(self%dof(k, node))
      end do
    end if
  end function node_displacement
end module body
