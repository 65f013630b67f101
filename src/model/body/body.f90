!> A body in its floating frame: its constant inertia integrals, its elastic coordinates and what damps them.
!> Frame: origin R (global), angle theta; every integral is in body axes. Built by `body_setup`.
module body
  use kinds, only: wp
  use banded, only: band_factor
  use beam_element, only: beam_geometry
  use elastic_operators, only: elastic_operator
  use segment_model, only: viscoelastic_segment
  implicit none (type, external)
  private
  public :: viscoelastic_segment

  !> A point mass and rotary inertia at a node or at a point of a rigid body.
  type, public :: lump
    integer :: node = 0                       !! 0: a point of a rigid body
    real(wp) :: x(2) = 0.0_wp                 !! where, body axes [m]
    real(wp) :: mass = 0.0_wp                 !! [kg]
    real(wp) :: inertia = 0.0_wp              !! [kg m2]
  end type lump

  !> What tells nodal coordinates from modal amplitudes: the kinds of flexible body.
  type, abstract, public :: elastic_basis
  contains
    procedure(to_deformations), deferred, nopass :: deform
    procedure(to_forces), deferred, nopass :: add_stress
    procedure(to_energy), deferred, nopass :: strain_energy
    procedure(to_displacement), deferred, nopass :: displacement
  end type elastic_basis

  !> One rigid or flexible body.
  type, public :: body_model
    character(32) :: name = ''
    logical :: flexible = .false.
    class(elastic_basis), allocatable :: basis   !! of flexible bodies
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
    real(wp), allocatable :: d(:, :)          !! deformations: nodes: (nd, ne); modes: (nf, segments) the amplitudes
    real(wp), allocatable :: ds(:, :)         !! the same with the terms' differences added
  contains
    procedure :: displacement => node_displacement
  end type body_model

  abstract interface
    !> Deformations of coordinates.
    pure subroutine to_deformations(b, qx, d)
      import :: body_model, wp
      type(body_model), intent(in) :: b
      real(wp), intent(in), contiguous :: qx(0:)      !! (0:nf) coordinates, entry 0 is zero [m, rad]
      real(wp), intent(inout), contiguous :: d(:, :)  !! as the body's [m, rad]
    end subroutine to_deformations

    !> Adds the elastic forces of deformations b%d with terms' differences added to ds, times a factor, to f.
    pure subroutine to_forces(b, ds, qx, factor, f)
      import :: body_model, wp
      type(body_model), intent(in) :: b
      real(wp), intent(in), contiguous :: ds(:, :)    !! as b%d [m, rad]
      real(wp), intent(in), contiguous :: qx(0:)      !! (0:nf) coordinates, entry 0 is zero [m, rad]
      real(wp), intent(in) :: factor                  !! 1, or -1 for forces that they exert [-]
      real(wp), intent(inout), contiguous :: f(0:)    !! (0:nf) entry 0 is thrown away [N, N m]
    end subroutine to_forces

    !> Strain energy at E_R of the deformations b%d and coordinates b%qx.
    pure function to_energy(b) result(energy)
      import :: body_model, wp
      type(body_model), intent(in) :: b
      real(wp) :: energy                              !! [J]
    end function to_energy

    !> Displacement (u, v, rotation) of a node in body axes.
    pure function to_displacement(b, node, q) result(u)
      import :: body_model, wp
      type(body_model), intent(in) :: b
      integer, intent(in) :: node
      real(wp), intent(in) :: q(:)                    !! (nf) elastic coordinates, their rates or accelerations [m, rad]
      real(wp) :: u(3)                                !! [m, m, rad] or their rates
    end function to_displacement
  end interface

contains

  !> Elastic displacement (u, v, rotation) of a node in body axes; also its rate, from rates.
  pure function node_displacement(self, node, q) result(u)
    class(body_model), intent(in) :: self
    integer, intent(in) :: node        !! node number
    real(wp), intent(in) :: q(:)       !! (nf) elastic coordinates or their rates or accelerations
    real(wp) :: u(3)                   !! [m, m, rad] or their rates
    u = 0.0_wp
    if (self%flexible) u = self%basis%displacement(self, node, q)
  end function node_displacement
end module body
