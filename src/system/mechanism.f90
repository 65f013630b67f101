!> The mechanism: a scene with the work space of its equations of motion, and what is computed once (attachment columns
!> m_ff^-1 E^T and compliances, the joint graph). `mechanism_setup` fills it; the equations themselves are in `dynamics`.
module mechanism
  use kinds, only: wp, ip
  use evaluation_settings, only: evaluation_options
  use scene_model, only: scene
  use force_element, only: conditions, element_action
  use marker, only: marker_states
  use constraint, only: constraint_rows
  use multipliers, only: multiplier_system
  implicit none (type, external)
  private
  public :: mechanism_model, flexible_attachments, factor_frame, conditions_of

  !> Attached markers of a flexible body: columns m_ff^-1 E_k^T and the compliances between them (constant).
  type :: flexible_attachments
    integer, allocatable :: marker(:)           !! attached markers (indices in the scene's list)
    real(wp), allocatable :: columns(:, :)      !! (nf, nc) m_ff^-1 E^T [1/kg ...]
    integer, allocatable :: column(:, :)        !! (3, na) column of each marker's u, v, rotation, 0: none needed
    real(wp), allocatable :: compliance(:, :, :, :)   !! (3, 3, na, na) E_i m_ff^-1 E_j^T
    real(wp), allocatable :: ep(:, :, :)        !! (3, 2, na) E_k m_ff^-1 S-bar^T
    real(wp), allocatable :: ex(:, :)           !! (3, na) E_k m_ff^-1 Q_f, this evaluation
    real(wp), allocatable :: ey(:, :)           !! (3, na) E_k m_ff^-1 m_theta_f^T, this evaluation
    real(wp), allocatable :: load(:)            !! (nc) multiplier forces on the columns
  end type flexible_attachments

  !> Scene and work space.
  type :: mechanism_model
    type(scene) :: s
    type(marker_states) :: p                    !! states of the scene's markers
    type(constraint_rows) :: rows
    type(multiplier_system) :: schur
    type(flexible_attachments), allocatable :: attached(:)   !! (nb), empty for rigid bodies
    ! what loops over many bodies need, apart from the bulky models
    logical, allocatable :: flexible(:)         !! (nb)
    integer, allocatable :: prototype(:)        !! (nb) the first body with the same elastic constants (prototypes)
    integer, allocatable :: attached_prototype(:) !! (nb) the first that is also attached in the same way
    real(wp), allocatable :: rigid(:, :)        !! (9, nb) rigid bodies: mass [kg], I1 [kg m], L and 1/D of the frame's mass
    integer, allocatable :: marker_body(:)      !! (markers) body of each marker, 0: the ground
    integer, allocatable :: marker_dof(:, :)    !! (3, markers) elastic coordinates (u, v, rotation) of each marker, 0: none
    real(wp), allocatable :: marker_x(:, :)     !! (2, markers) undeformed positions, body axes [m]
    integer, allocatable :: nodal_markers(:)    !! markers on flexible bodies in nodal coordinates
    integer, allocatable :: modal_markers(:)    !! markers on flexible bodies in modal coordinates
    integer, allocatable :: rigid_markers(:)    !! markers on rigid bodies
    integer, allocatable :: row_marker(:, :)    !! (2, rows) markers a and b of each row
    ! sides of constraint rows on moving bodies, grouped by body
    integer, allocatable :: side_first(:)       !! (nb+1) first side of each body
    integer, allocatable :: side_row(:)         !! row of each side
    integer, allocatable :: end_marker(:)       !! its place
    integer, allocatable :: side_body(:)        !! its body
    integer, allocatable :: side_attachment(:)  !! its marker's number among the body's attachments (flexible bodies)
    logical, allocatable :: side_is_a(:)        !! side of the row
    integer, allocatable :: of_row(:, :)        !! (2, rows) sides of each row, 0: on the ground
    integer, allocatable :: slot(:)             !! entry of S for each pair of sides f <= e of one body, body by body; negative
                                                !! where both are sides of one row, whose entry gets the pair twice
    real(wp), allocatable :: w(:, :)            !! (3, sides) wrench of a unit multiplier, body axes
    real(wp), allocatable :: frame_wrench(:, :) !! (3, sides) the same on the condensed frame, J^T w
    real(wp), allocatable :: g(:, :)            !! (3, sides) L^-1 J^T w
    type(multiplier_system) :: closing          !! Phi_r Mc^-1 Phi_r^T of the frames alone, elastic coordinates held
    real(wp), allocatable :: rigid_wrench(:, :) !! (3, sides) wrench of a unit multiplier on the frame, elastic coordinates held
    ! frames
    real(wp), allocatable :: cos_theta(:), sin_theta(:) !! (nb) cosine and sine of the frame angle [-]
    real(wp), allocatable :: frame_l(:, :)      !! (3, nb) L of the condensed 3 x 3 mass: l21, l31, l32
    real(wp), allocatable :: frame_dinv(:, :)   !! (3, nb) 1/D of it
    real(wp), allocatable :: rhs(:, :)          !! (3, nb) condensed generalised forces, body axes
    real(wp), allocatable :: free(:, :)         !! (3, nb) accelerations without multipliers, body axes
    real(wp), allocatable :: push(:, :)         !! (3, nb) what the multipliers take from them
    real(wp), allocatable :: wrench(:, :)       !! (3, markers) force in body axes and moment of force elements
    real(wp), allocatable :: pin(:, :)          !! (2, nb) p = I1 + S-bar q_f, body axes [kg m]
    ! results of the last evaluation
    real(wp), allocatable :: lambda(:)          !! (rows) multipliers [N]
    real(wp), allocatable :: lambda_change(:)   !! (rows) correction of the multipliers [N]
    real(wp), allocatable :: change(:)          !! (nq) correction of the accelerations
    real(wp), allocatable :: a(:)               !! (nq) accelerations, global axes for the frames' origins
    real(wp), allocatable :: zdd(:)             !! (nz) accelerations of internal variables, rates of those of first order
    type(element_action), allocatable :: action(:)   !! what each force element does
    real(wp) :: dissipated_power = 0.0_wp       !! [W]
    real(wp) :: input_power = 0.0_wp            !! of loads and drives [W]
    real(wp) :: t = 0.0_wp                      !! time of the last evaluation [s]
    type(evaluation_options) :: options         !! what it was made with
    logical :: elastic_held = .false.           !! the multipliers' matrix is that of the frames: elastic coordinates do not move
    ! counts
    integer(ip) :: evaluations = 0              !! right-hand sides
    integer(ip) :: solves = 0                   !! banded solves of bodies
    integer(ip) :: factorisations = 0           !! of body mass matrices
    logical :: redundant = .false.              !! some rows depend on others everywhere, not only in a singular position
    logical :: broken = .false.                 !! a condensed mass matrix lost positive definiteness
  end type mechanism_model

contains

  !> L D L^T of the condensed 3 x 3 mass matrix [[a, b, d], [b, c, e], [d, e, f]].
  pure subroutine factor_frame(a, b, c, d, e, f, frame_l, frame_dinv)
    real(wp), intent(in) :: a, b, c, d, e, f
    real(wp), intent(out) :: frame_l(3), frame_dinv(3) !! l21, l31, l32 and 1/D
    real(wp) :: d2
    frame_dinv(1) = reciprocal(a)
    frame_l(1) = b*frame_dinv(1)
    frame_l(2) = d*frame_dinv(1)
    d2 = c - frame_l(1)*b
    frame_dinv(2) = reciprocal(d2)
    frame_l(3) = (e - frame_l(2)*b)*frame_dinv(2)
    frame_dinv(3) = reciprocal(f - frame_l(2)*d - frame_l(3)**2*d2)
  end subroutine factor_frame

  !> 1/x of a pivot; 0 where the pivot is none, since the mass that makes it is lost in rounding.
  elemental real(wp) function reciprocal(x)
    real(wp), intent(in) :: x                  !! [kg] or [kg m2]
    reciprocal = 0.0_wp
    if (x > 0.0_wp) reciprocal = 1.0_wp/x
  end function reciprocal

  !> What force element k may depend on beside the motion of its markers, in the last evaluation.
  pure type(conditions) function conditions_of(self, k, t) result(with)
    type(mechanism_model), intent(in) :: self
    integer, intent(in) :: k
    real(wp), intent(in) :: t                  !! [s]
    integer :: b
    associate (options => self%options)
      with = conditions(t, options%left_limit, options%stage, options%load_factor, options%prestress)
    end associate
    b = self%marker_body(self%s%forces(k)%item%ia)
    if (b > 0) with%axes = [self%cos_theta(b), self%sin_theta(b)]
  end function conditions_of
end module mechanism
