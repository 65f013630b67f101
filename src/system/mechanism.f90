!> The mechanism: a scene and what is computed of it once (the joint graph, markers as plain arrays, attachment columns m_ff^-1 E^T
!> and compliances). Constant once `mechanism_setup` has filled it and `assembly` has given joints and springs their start.
module mechanism
  use kinds, only: wp
  use row_sides, only: attached_markers, side_list
  use scene_model, only: scene
  implicit none (type, external)
  private
  public :: mechanism_model, row_incidence, marker_arrays, flexible_attachments, factor_frame

  !> The sides of constraint rows on moving bodies.
  type, extends(side_list) :: row_incidence
    integer, allocatable :: row_marker(:, :)    !! (2, rows) markers a and b of each row
    integer, allocatable :: with_carrier(:)     !! rows with a carrier
    integer, allocatable :: carrier(:)          !! its marker, of each
    integer, allocatable :: places(:), angles(:)   !! plain rows (`is_plain`): of positions, of section angles
    real(wp), allocatable :: datum(:)           !! (rows) of plain rows [m] or [rad]
    integer, allocatable :: others(:, :)        !! (2, others) other rows: constraint, row of its own
  end type row_incidence

  !> Markers as plain arrays, and sorted by what their motion follows from.
  type :: marker_arrays
    integer, allocatable :: body(:)             !! (markers) body of each marker, 0: the ground
    integer, allocatable :: dof(:, :)           !! (3, markers) elastic coordinates (u, v, rotation) of each marker, 0: none
    real(wp), allocatable :: x(:, :)            !! (2, markers) undeformed positions, body axes [m]
    integer, allocatable :: nodal(:)            !! markers on flexible bodies in nodal coordinates
    integer, allocatable :: modal(:)            !! markers on flexible bodies in modal coordinates
    integer, allocatable :: rigid(:)            !! markers on rigid bodies
  end type marker_arrays

  !> Attached markers of a flexible body: columns m_ff^-1 E_k^T and the compliances between them.
  type, extends(attached_markers) :: flexible_attachments
    real(wp), allocatable :: columns(:, :)      !! (nf, nc) m_ff^-1 E^T [1/kg ...]
    real(wp), allocatable :: compliance(:, :, :, :)   !! (3, 3, na, na) E_i m_ff^-1 E_j^T [1/kg ...]
    real(wp), allocatable :: ep(:, :, :)        !! (3, 2, na) E_k m_ff^-1 S-bar^T [-]
  end type flexible_attachments

  !> A scene, and plain arrays for loops over many bodies, which do not touch the models.
  type :: mechanism_model
    type(scene) :: s
    type(row_incidence) :: incidence
    type(marker_arrays) :: markers
    type(flexible_attachments), allocatable :: attached(:)   !! (nb), empty for rigid bodies
    logical, allocatable :: flexible(:)         !! (nb)
    integer, allocatable :: prototype(:)        !! (nb) the first body with the same elastic constants (prototypes)
    integer, allocatable :: attached_prototype(:) !! (nb) the first that is also attached in the same way
    real(wp), allocatable :: rigid(:, :)        !! (9, nb) rigid bodies: mass [kg], I1 [kg m], L and 1/D of the frame's mass
    logical :: redundant = .false.              !! some rows depend on others everywhere, not only in a singular position
  end type mechanism_model

contains

  !> L D L^T of the condensed 3 x 3 mass matrix [[a, b, d], [b, c, e], [d, e, f]].
  pure subroutine factor_frame(a, b, c, d, e, f, frame_l, frame_dinv)
    real(wp), intent(in) :: a, b, c             !! [kg]
    real(wp), intent(in) :: d, e, f             !! [kg m], [kg m], [kg m2]
    real(wp), intent(out) :: frame_l(3)         !! l21, l31, l32 [-], [m], [m]
    real(wp), intent(out) :: frame_dinv(3)      !! 1/D [1/kg], [1/kg], [1/(kg m2)]
    real(wp) :: d2
    frame_dinv(1) = reciprocal(a)
    frame_l(1) = b*frame_dinv(1)
    frame_l(2) = d*frame_dinv(1)
    d2 = c - frame_l(1)*b
    frame_dinv(2) = reciprocal(d2)
    frame_l(3) = (e - frame_l(2)*b)*frame_dinv(2)
    frame_dinv(3) = reciprocal(f - frame_l(2)*d - frame_l(3)**2*d2)
  end subroutine factor_frame

  !> 1/x of a pivot; 0 where x is not positive: the mass in it is lost in rounding.
  elemental real(wp) function reciprocal(x)
    real(wp), intent(in) :: x                  !! [kg] or [kg m2]
    reciprocal = 0.0_wp
    if (x > 0.0_wp) reciprocal = 1.0_wp/x
  end function reciprocal
end module mechanism
