!> A body in its floating frame: its constant inertia integrals, its elastic coordinates and what damps them; the work space of its
!> evaluations is apart. Frame: origin R (global), angle theta; every integral is in body axes. Built by `body_setup`.
module body
  use kinds, only: wp
  use beam_element, only: beam_geometry
  use elastic_operators, only: elastic_operator
  use layered_element, only: layered_element_model
  use layered_section, only: layered_section_model
  use marker, only: marker_model
  use segment_model, only: viscoelastic_segment
  use triplets, only: triplet_matrix
  implicit none (type, external)
  private

  !> A point mass and rotary inertia at a node or at a point of a rigid body.
  type, public :: lump
    integer :: node = 0                       !! 0: a point of a rigid body
    real(wp) :: x(2) = 0.0_wp                 !! where, body axes [m]
    real(wp) :: mass = 0.0_wp                 !! [kg]
    real(wp) :: inertia = 0.0_wp              !! [kg m2]
  end type lump

  !> Integrals of the elastic coordinates' shapes (theory.md, section 2), and their solutions by m_ff^-1.
  type, public :: shape_integrals
    real(wp), allocatable :: sbar(:, :)       !! (nf, 2) S-bar transposed [kg]
    real(wp), allocatable :: i1f(:)           !! (nf) [kg m]
    real(wp), allocatable :: c0(:)            !! (nf) [kg m]
    real(wp), allocatable :: pmat(:, :)       !! (nf, 2) m_ff^-1 S-bar^T [-]
    real(wp) :: sps(2, 2) = 0.0_wp            !! S-bar m_ff^-1 S-bar^T [kg]
  contains
    procedure :: moment
  end type shape_integrals

  !> The kinds of flexible body: nodal coordinates, or modal amplitudes.
  type, abstract, public :: elastic_basis
    integer :: factors = 0                    !! factored mass matrices: none where m_ff is the unit matrix
    integer :: reduced_from = 0               !! nodal coordinates before a reduction to modes; 0: they are the coordinates
    integer :: static_shapes = 0              !! static shapes among the coordinates
    real(wp) :: unit = 1.0_wp                 !! metres in a unit of a coordinate that is no rotation: nodes 1 [-], modes [kg^-1/2]
    logical, allocatable :: rotation(:)       !! (nf) whether a coordinate is a node's rotation
    integer :: rows = 0, columns = 0          !! of the deformations
    logical, allocatable :: angle(:)          !! whether a deformation is an angle: of a column, for all alike, or of every one
    real(wp) :: top_frequency = 0.0_wp        !! highest that the coordinates can follow [rad/s]
    real(wp) :: highest_bending = 0.0_wp      !! that of the highest mode in bending; 0 without a reduction [rad/s]
  contains
    procedure(to_deformations), deferred :: deform
    procedure(to_forces), deferred :: add_stress
    procedure :: solve_mass => unit_mass
    procedure(to_parts), deferred :: strain_parts
    procedure(to_largest), deferred :: largest_force
    procedure(to_element), deferred :: element_strain
    procedure(to_tangent), deferred :: add_stiffness
    procedure(to_values), deferred :: nodal_values
    procedure :: element_coordinates
    procedure(to_marker), deferred :: attach
    procedure :: same => shares_nothing
  end type elastic_basis

  !> What a body has beside its elements' geometry.
  type, public :: body_layers
    logical :: shown = .false.                !! some section has layers or shears
    type(layered_section_model), allocatable :: sections(:)
    type(layered_element_model), allocatable :: kinds(:)   !! elements of one section and one length
    integer, allocatable :: kind(:)           !! (ne)
    integer, allocatable :: slot(:, :)        !! (cores, sections) number of a core among those of all sections
    integer, allocatable :: row(:, :)         !! (rows, ne) column of the deformations that a row of the element is, 0: none
    integer, allocatable :: part(:, :)        !! (parts, ne) segments that the rows belong to, 0: elastic rows, -1: none
    integer, allocatable :: row_part(:, :)    !! (rows, ne) the part of each row
  end type body_layers

  !> One rigid or flexible body.
  type, public :: body_model
    character(32) :: name = ''
    logical :: flexible = .false.
    class(elastic_basis), allocatable :: basis   !! of flexible bodies
    logical :: axial = .true.
    logical :: stiffening = .false.
    logical :: rayleigh = .false.
    integer :: nn = 0                         !! nodes
    integer :: ne = 0                         !! elements
    integer :: nf = 0                         !! elastic coordinates
    integer :: nz = 0                         !! internal variables
    integer :: extra_references = 0           !! reference conditions beyond the three that are needed
    real(wp) :: mass = 0.0_wp                 !! m [kg]
    real(wp) :: i1(2) = 0.0_wp                !! integral of u0 [kg m]
    real(wp) :: i11 = 0.0_wp                  !! integral of u0.u0 and rotary inertias [kg m2]
    real(wp) :: length = 0.0_wp               !! largest distance between two nodes [m]
    real(wp), allocatable :: x(:, :)          !! (2, nn) nodes, body axes [m]
    integer, allocatable :: en(:, :)          !! (2, ne) nodes of each element
    type(beam_geometry), allocatable :: elements(:)
    integer, allocatable :: dof(:, :)         !! (3, nn) number of each nodal coordinate, 0: removed; behind them angles of cores
    integer, allocatable :: edof(:, :)        !! (6, ne) the same by element; with cores more (`layered_element`)
    type(body_layers) :: layers               !! of beams and frames
    type(lump), allocatable :: lumps(:)
    type(shape_integrals) :: shape            !! of the elastic coordinates, nodal or modal
    type(elastic_operator) :: op              !! their matrices
    type(viscoelastic_segment), allocatable :: segments(:)
  contains
    procedure :: displacement => node_displacement
  end type body_model

  !> Elastic coordinates, forces and deformations of one evaluation of a flexible body.
  type, public :: elastic_work
    real(wp), allocatable :: q(:)             !! (0:nf) coordinates, entry 0 is zero [m, rad]
    real(wp), allocatable :: v(:)             !! (0:nf) rates, then work [m/s, rad/s]
    real(wp), allocatable :: force(:)         !! (0:nf) Q_f, then m_ff^-1 Q_f; entry 0 is thrown away [N, N m], [m/s2, rad/s2]
    real(wp), allocatable :: coupling(:)      !! (0:nf) m_theta_f, then m_ff^-1 m_theta_f^T; likewise [kg m, kg m2], [m, -]
    real(wp), allocatable :: d(:, :)          !! deformations: nodes: (1, rows); modes: (nf, segments) the amplitudes [m, rad]
    real(wp), allocatable :: ds(:, :)         !! the same with the terms' differences added [m, rad]
  contains
    procedure :: allocate => allocate_work
  end type elastic_work

  abstract interface
    !> Deformations of coordinates.
    pure subroutine to_deformations(self, b, q, d)
      import :: elastic_basis, body_model, wp
      class(elastic_basis), intent(in) :: self
      type(body_model), intent(in) :: b
      real(wp), intent(in), contiguous :: q(0:)       !! (0:nf) coordinates, entry 0 is zero [m, rad]
      real(wp), intent(inout), contiguous :: d(:, :)  !! [m, rad]
    end subroutine to_deformations

    !> Adds the elastic forces of deformations d, with terms' differences ds, times a factor to f.
    pure subroutine to_forces(self, b, d, ds, q, factor, f)
      import :: elastic_basis, body_model, wp
      class(elastic_basis), intent(in) :: self
      type(body_model), intent(in) :: b
      real(wp), intent(in), contiguous :: d(:, :), ds(:, :)   !! [m, rad]
      real(wp), intent(in), contiguous :: q(0:)       !! (0:nf) coordinates, entry 0 is zero [m, rad]
      real(wp), intent(in) :: factor                  !! 1, or -1 for forces that they exert [-]
      real(wp), intent(inout), contiguous :: f(0:)    !! (0:nf) entry 0 is thrown away [N, N m]
    end subroutine to_forces

    !> Twice the strain energy at E_R, axial, in bending and of what slips between layers, of deformations or else of the linear
    !> strain; of modes all is bending.
    pure function to_parts(self, b, q, d) result(parts)
      import :: elastic_basis, body_model, wp
      class(elastic_basis), intent(in) :: self
      type(body_model), intent(in) :: b
      real(wp), intent(in) :: q(:)                    !! (nf) [m, rad]
      real(wp), intent(in), contiguous, optional :: d(:, :)   !! [m, rad]
      real(wp) :: parts(3)                            !! [J]
    end function to_parts

    !> Largest elastic force: axial and shear forces, or modal forces.
    pure real(wp) function to_largest(self, b, w) result(force)   ! [N]
      import :: elastic_basis, elastic_work, body_model, wp
      class(elastic_basis), intent(in) :: self
      type(body_model), intent(in) :: b
      type(elastic_work), intent(in) :: w             !! of the last evaluation
    end function to_largest

    !> Rows of an element's deformations with the terms' differences (`element_law`).
    pure function to_element(self, b, e, w) result(d)
      import :: elastic_basis, elastic_work, body_model, wp
      class(elastic_basis), intent(in) :: self
      type(body_model), intent(in) :: b
      integer, intent(in) :: e                        !! element
      type(elastic_work), intent(in) :: w
      real(wp), allocatable :: d(:)                   !! [m, rad]
    end function to_element

    !> Adds the tangent stiffness of the elastic coordinates, and what of it viscoelastic terms multiply, to sparse matrices.
    pure subroutine to_tangent(self, b, first, q, w, stiffness, segments)
      import :: elastic_basis, elastic_work, body_model, triplet_matrix, wp
      class(elastic_basis), intent(in) :: self
      type(body_model), intent(in) :: b
      integer, intent(in) :: first                    !! coordinates before them in the matrices
      real(wp), intent(in) :: q(:)                    !! (nf) coordinates, for stiffening [m, rad]
      type(elastic_work), intent(in) :: w             !! deformations there, for the same
      type(triplet_matrix), intent(inout) :: stiffness
      type(triplet_matrix), intent(inout) :: segments(:)   !! (segments)
    end subroutine to_tangent

    !> Some of the nodal coordinates, in body axes.
    pure subroutine to_values(self, n, at, q, a)
      import :: elastic_basis, wp
      class(elastic_basis), intent(in) :: self
      integer, intent(in) :: n
      integer, intent(in) :: at(n)                    !! their numbers, 0: removed
      real(wp), intent(in) :: q(:)                    !! (nf) elastic coordinates, their rates or accelerations [m, rad]
      real(wp), intent(out) :: a(n)                   !! [m, rad] or their rates
    end subroutine to_values

    !> Gives a marker on a node the coordinates or modes that move it.
    pure subroutine to_marker(self, b, p)
      import :: elastic_basis, body_model, marker_model
      class(elastic_basis), intent(in) :: self
      type(body_model), intent(in) :: b
      type(marker_model), intent(inout) :: p
    end subroutine to_marker
  end interface

contains

  !> S-bar q.
  pure function moment(self, q) result(p)
    class(shape_integrals), intent(in) :: self
    real(wp), intent(in), contiguous :: q(:)   !! (nf) elastic coordinates or their rates [m, rad]
    real(wp) :: p(2)                   !! [kg m]
    integer :: k
    p = 0.0_wp
    do k = 1, size(q)
      p = p + self%sbar(k, :)*q(k)
    end do
  end function moment

  !> Elastic displacement (u, v, rotation) of a node in body axes; also its rate, from rates.
  pure function node_displacement(self, node, q) result(u)
    class(body_model), intent(in) :: self
    integer, intent(in) :: node        !! node number
    real(wp), intent(in) :: q(:)       !! (nf) elastic coordinates or their rates or accelerations [m, rad]
    real(wp) :: u(3)                   !! [m, m, rad] or their rates
    u = 0.0_wp
    if (self%flexible) call self%basis%nodal_values(3, self%dof(1, node), q, u)
  end function node_displacement

  !> Coordinates of an element's ends, and of its cores, in body axes.
  pure function element_coordinates(self, b, e, q) result(a)
    class(elastic_basis), intent(in) :: self
    type(body_model), intent(in) :: b
    integer, intent(in) :: e           !! element
    real(wp), intent(in) :: q(:)       !! (nf) elastic coordinates or their rates [m, rad]
    real(wp) :: a(size(b%edof, 1))     !! [m, rad] or their rates
    call self%nodal_values(size(a), b%edof(1, e), q, a)
  end function element_coordinates

  !> Room for the evaluations of a flexible body.
  subroutine allocate_work(self, b)
    class(elastic_work), intent(inout) :: self
    type(body_model), intent(in) :: b
    associate (n => b%nf, rows => b%basis%rows, columns => b%basis%columns)
      allocate (self%q(0:n), self%v(0:n), self%force(0:n), self%coupling(0:n), self%d(rows, columns), self%ds(rows, columns), &
                source=0.0_wp)
    end associate
  end subroutine allocate_work

  !> m_ff^-1 x, and m_ff^-1 y, in place: nothing to do where m_ff is the unit matrix.
  pure subroutine unit_mass(self, n, work, x, y)
    class(elastic_basis), intent(in) :: self
    integer, intent(in) :: n                        !! nf
    real(wp), intent(inout) :: work(2, n)           !! [any]
    real(wp), intent(inout) :: x(n)                 !! [N, N m], then [m/s2, rad/s2]
    real(wp), intent(inout), optional :: y(n)       !! likewise [N, N m]
  end subroutine unit_mass

  !> Whether another body with the same integrals has the same constants in its basis; modal bodies share none.
  pure logical function shares_nothing(self, other) result(same)
    class(elastic_basis), intent(in) :: self, other
    same = .false.
  end function shares_nothing

end module body
