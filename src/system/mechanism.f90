!> The mechanism: a scene with the work space of its equations of motion, and what is computed once (attachment columns
!> m_ff^-1 E^T and compliances, the joint graph). `mechanism_setup` fills it; the equations themselves are in `dynamics`.
module mechanism
  use kinds, only: wp, ip
  use scene_model, only: scene
  use force_element, only: conditions, element_action
  use place, only: place_states
  use constraint, only: constraint_rows
  use multipliers, only: multiplier_system
  implicit none (type, external)
  private
  public :: mechanism_model, flexible_attachments, factor_frame, conditions_of

  !> Attached places of a flexible body: columns m_ff^-1 E_k^T and the compliances between them (constant).
  type :: flexible_attachments
    integer, allocatable :: place(:)            !! attached places (indices in the scene's list)
    real(wp), allocatable :: columns(:, :)      !! (nf, nc) m_ff^-1 E^T [1/kg ...]
    integer, allocatable :: column(:, :)        !! (3, na) column of each place's u, v, rotation, 0: none needed
    real(wp), allocatable :: compliance(:, :, :, :)   !! (3, 3, na, na) E_i m_ff^-1 E_j^T
    real(wp), allocatable :: ep(:, :, :)        !! (3, 2, na) E_k m_ff^-1 S-bar^T
    real(wp), allocatable :: ex(:, :)           !! (3, na) E_k m_ff^-1 Q_f, this evaluation
    real(wp), allocatable :: ey(:, :)           !! (3, na) E_k m_ff^-1 m_theta_f^T, this evaluation
    real(wp), allocatable :: load(:)            !! (nc) multiplier forces on the columns
  end type flexible_attachments

  !> Scene and work space.
  type :: mechanism_model
    type(scene) :: s
    type(place_states) :: p                     !! states of the scene's places
    type(constraint_rows) :: rows
    type(multiplier_system) :: schur
    type(flexible_attachments), allocatable :: attached(:)   !! (nb), empty for rigid bodies
    ! what loops over many bodies need, apart from the bulky models
    logical, allocatable :: flexible(:)         !! (nb)
    integer, allocatable :: like(:)             !! (nb) the first body with the same elastic constants (like_bodies)
    integer, allocatable :: held_like(:)        !! (nb) the first that is also attached in the same way
    real(wp), allocatable :: rigid(:, :)        !! (9, nb) rigid bodies: mass [kg], I1 [kg m], L and 1/D of the frame's mass
    integer, allocatable :: place_body(:)       !! (places) body of each place, 0: the ground
    integer, allocatable :: place_dof(:, :)     !! (3, places) elastic coordinates (u, v, rotation) of each place, 0: none
    real(wp), allocatable :: place_x(:, :)      !! (2, places) undeformed positions, body axes [m]
    integer, allocatable :: nodal_places(:)     !! places on flexible bodies in nodal coordinates
    integer, allocatable :: modal_places(:)     !! places on flexible bodies in modal coordinates
    integer, allocatable :: rigid_places(:)     !! places on rigid bodies
    integer, allocatable :: row_place(:, :)     !! (2, rows) places a and b of each row
    ! ends of constraint rows on moving bodies, grouped by body
    integer, allocatable :: end_first(:)        !! (nb+1) first end of each body
    integer, allocatable :: end_row(:)          !! row of each end
    integer, allocatable :: end_place(:)        !! its place
    integer, allocatable :: end_body(:)         !! its body
    integer, allocatable :: end_local(:)        !! its place's number among the body's attachments (flexible bodies)
    logical, allocatable :: end_is_a(:)         !! side of the row
    integer, allocatable :: of_row(:, :)        !! (2, rows) ends of each row, 0: on the ground
    integer, allocatable :: slot(:)             !! entry of S for each pair of ends f <= e of one body, body by body; negative
                                                !! where both are ends of one row, whose entry gets the pair twice
    real(wp), allocatable :: w(:, :)            !! (3, ends) wrench of a unit multiplier, body axes
    real(wp), allocatable :: jw(:, :)           !! (3, ends) the same on the condensed frame, J^T w
    real(wp), allocatable :: g(:, :)            !! (3, ends) L^-1 J^T w
    type(multiplier_system) :: closing          !! Phi_r Mc^-1 Phi_r^T of the frames alone, elastic coordinates held
    real(wp), allocatable :: lever(:, :)        !! (3, ends) wrench of a unit multiplier on the frame, elastic coordinates held
    ! frames
    real(wp), allocatable :: c(:), sn(:)        !! (nb) cosine and sine of the frame angle [-]
    real(wp), allocatable :: low(:, :)          !! (3, nb) L of the condensed 3 x 3 mass: l21, l31, l32
    real(wp), allocatable :: dinv(:, :)         !! (3, nb) 1/D of it
    real(wp), allocatable :: rhs(:, :)          !! (3, nb) condensed generalised forces, body axes
    real(wp), allocatable :: free(:, :)         !! (3, nb) accelerations without multipliers, body axes
    real(wp), allocatable :: push(:, :)         !! (3, nb) what the multipliers take from them
    real(wp), allocatable :: wrench(:, :)       !! (3, places) force in body axes and moment of force elements
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
    integer :: stage = 2                        !! stage_static or stage_transient of `force_element`
    logical :: left = .false.                   !! jumps of histories at t are not yet felt
    real(wp) :: last = huge(1.0_wp)             !! time after which drives lead nowhere: the end of the run [s]
    logical :: frozen = .false.                 !! assembly: elastic coordinates do not move
    real(wp) :: load_factor = 1.0_wp            !! static analysis: fraction of the loads
    real(wp) :: baumgarte(2) = 0.0_wp           !! alpha, beta [1/s]
    ! counts
    integer(ip) :: evaluations = 0              !! right-hand sides
    integer(ip) :: solves = 0                   !! banded solves of bodies
    integer(ip) :: factorisations = 0           !! of body mass matrices
    logical :: redundant = .false.              !! some rows depend on others everywhere, not only in a singular position
    logical :: broken = .false.                 !! a condensed mass matrix lost positive definiteness
  end type mechanism_model

contains

  !> L D L^T of the condensed 3 x 3 mass matrix [[a, b, d], [b, c, e], [d, e, f]].
  pure subroutine factor_frame(a, b, c, d, e, f, low, dinv)
    real(wp), intent(in) :: a, b, c, d, e, f
    real(wp), intent(out) :: low(3), dinv(3)   !! l21, l31, l32 and 1/D
    real(wp) :: d2
    dinv(1) = reciprocal(a)
    low(1) = b*dinv(1)
    low(2) = d*dinv(1)
    d2 = c - low(1)*b
    dinv(2) = reciprocal(d2)
    low(3) = (e - low(2)*b)*dinv(2)
    dinv(3) = reciprocal(f - low(2)*d - low(3)**2*d2)
  end subroutine factor_frame

  !> 1/x of a pivot; 0 where the pivot is none, since the mass that makes it is lost in rounding.
  elemental real(wp) function reciprocal(x)
    real(wp), intent(in) :: x                  !! [kg] or [kg m2]
    reciprocal = 0.0_wp
    if (x > 0.0_wp) reciprocal = 1.0_wp/x
  end function reciprocal

  !> What force element k may depend on beside the motion of its markers.
  pure type(conditions) function conditions_of(self, k, t) result(with)
    type(mechanism_model), intent(in) :: self
    integer, intent(in) :: k
    real(wp), intent(in) :: t                  !! [s]
    integer :: b
    with = conditions(t, self%left, self%stage, self%load_factor)
    b = self%place_body(self%s%forces(k)%item%ia)
    if (b > 0) with%axes = [self%c(b), self%sn(b)]
  end function conditions_of
end module mechanism
