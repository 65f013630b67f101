!> Results of an evaluation of the equations of motion, and its work space: one `evaluation` serves again and again, at any states
!> and options, for one constant mechanism.
module evaluation_results
  use kinds, only: wp, ip
  use body, only: elastic_work
  use constraint, only: constraint_rows, row_motion
  use controller, only: unset
  use evaluation_settings, only: evaluation_options
  use force_element, only: conditions, element_action
  use marker, only: marker_states
  use mechanism, only: mechanism_model
  use multipliers, only: multiplier_system
  use root_watch, only: resting, root_rounding
  use scene_model, only: power_source
  implicit none (type, external)
  private
  public :: evaluation, conditions_of, motion_of_row, power_of, powers_of, row_power

  !> The bodies' frames.
  type :: frame_results
    real(wp), allocatable :: angle(:)           !! (nb) frame angle [rad]
    real(wp), allocatable :: cos(:), sin(:)     !! (nb) its cosine and sine [-]
    real(wp), allocatable :: l(:, :)            !! (3, nb) L of the condensed 3 x 3 mass: l21, l31, l32 [-], [m], [m]
    real(wp), allocatable :: dinv(:, :)         !! (3, nb) 1/D of it [1/kg], [1/kg], [1/(kg m2)]
    real(wp), allocatable :: rhs(:, :)          !! (3, nb) condensed generalised forces, body axes [N, N, N m]
    real(wp), allocatable :: free(:, :)         !! (3, nb) accelerations without multipliers, body axes [m/s2, rad/s2]
    real(wp), allocatable :: response(:, :)     !! (3, nb) to multipliers: accelerations, corrections, body axes [m/s2, rad/s2]
    real(wp), allocatable :: first_moment(:, :) !! (2, nb) p = I1 + S-bar q_f, body axes [kg m]
  contains
    procedure :: to_body
    procedure :: to_global
  end type frame_results

  !> Wrenches of unit multipliers on the sides of constraint rows (`row_incidence`).
  type :: side_wrenches
    real(wp), allocatable :: w(:, :)            !! (3, sides) on the marker, body axes [-, -, m]
    real(wp), allocatable :: frame_wrench(:, :) !! (3, sides) the same on the condensed frame, J^T w [-, -, m]
    real(wp), allocatable :: g(:, :)            !! (3, sides) L^-1 J^T w [-, -, m]
    real(wp), allocatable :: rigid_wrench(:, :) !! (3, sides) on the frame, elastic coordinates fixed [-, -, m]
  end type side_wrenches

  !> Motion of a flexible body's attached markers by forces.
  type :: attachment_results
    real(wp), allocatable :: ex(:, :)           !! (3, na) E_k m_ff^-1 Q_f [m/s2, rad/s2]
    real(wp), allocatable :: ey(:, :)           !! (3, na) E_k m_ff^-1 m_theta_f^T [m, -]
    real(wp), allocatable :: load(:)            !! (nc) multiplier forces on the columns [N, N m]
  end type attachment_results

  !> Discrete states, and values of elements at their last events (`s%switching`).
  type, public :: switch_states
    integer, allocatable :: state(:)
    real(wp), allocatable :: event_value(:)     !! [m/s] or [rad/s] of stops; [m] of rows that hold
    logical :: indeterminate = .false.          !! rows that hold depend on one another: how they share a load is not determined
  end type switch_states

  !> A factor of loads that follows motions.
  type, public :: factor_results
    real(wp) :: value = 0.0_wp                  !! [-]
    real(wp), allocatable :: slopes(:)          !! by its arguments [1/m], [1/rad] or times seconds
  end type factor_results

  !> What a controller does.
  type, public :: control_results
    integer :: state = unset                    !! discrete state; of a sampled one the number of the next sample
    integer :: limited = 0                      !! 1: at its upper limit, -1: at the lower one
    real(wp) :: parts = 0.0_wp                  !! largest of the sum that its demand is [any]
    real(wp) :: output = 0.0_wp                 !! [any]
    real(wp) :: error = 0.0_wp                  !! [m, rad, or per second]
  end type control_results

  !> Rows that slip (`slipping`).
  type, public :: slip_work
    real(wp), allocatable :: start(:)           !! (rows) multipliers of the last accepted state [N]
    real(wp), allocatable :: b(:), x(:), f(:), law(:)   !! (rows) what rows hold [m/s2], multipliers, friction, that of the law [N]
    real(wp), allocatable :: slope(:, :)        !! (2, joints with friction) of the friction by their multipliers [-]
    real(wp), allocatable :: weighed(:, :)      !! the same between rows as S weighs them [-]
    integer, allocatable :: column(:, :)        !! (2, joints with friction) places of these multipliers
    integer, allocatable :: law_of(:)           !! (rows) joint with friction, 0: none
    real(wp), allocatable :: ab(:, :)           !! matrix of the multipliers with that slope, factored [1/kg]
    integer, allocatable :: pivots(:)           !! likewise
    integer :: upper = 0                        !! likewise
  end type slip_work

  !> Results of the last evaluation, and work space.
  type :: evaluation
    real(wp) :: t = 0.0_wp                      !! its time [s]
    type(evaluation_options) :: options         !! its options
    type(marker_states) :: p                    !! states of the scene's markers
    type(constraint_rows) :: rows
    type(frame_results) :: frame
    type(side_wrenches) :: side
    type(elastic_work), allocatable :: elastic(:)   !! (nb), empty for rigid bodies
    type(attachment_results), allocatable :: attached(:)   !! (nb), likewise
    real(wp), allocatable :: work(:, :)         !! (2, largest nf) of solves with m_ff [any]
    type(multiplier_system) :: schur            !! S = Phi_q M^-1 Phi_q^T
    type(multiplier_system), allocatable :: closing   !! Phi_r Mc^-1 Phi_r^T of the frames alone, elastic coordinates fixed;
                                                !! allocated where a body is flexible
    logical :: elastic_fixed = .false.           !! S is that of the frames alone: elastic coordinates do not move
    real(wp), allocatable :: displacement(:, :) !! (3, markers) work: by small motions of the coordinates, global axes [m, m, rad]
    real(wp), allocatable :: wrench(:, :)       !! (3, markers) of force elements, body axes [N, N, N m]
    type(element_action), allocatable :: action(:)   !! what each force element does
    type(control_results), allocatable :: control(:)   !! what each controller does
    type(factor_results), allocatable :: factor(:)
    real(wp), allocatable :: signals(:, :)      !! (0:1, watches) value and slope of what each of them watches [any]
    type(slip_work) :: slip
    type(switch_states) :: switches             !! discrete states of the force elements that have such
    real(wp) :: softening = 0.0_wp              !! added to the compliance of rows that stick, relative, while states are sought [-]
    real(wp), allocatable :: lambda(:)          !! (rows) multipliers [N]
    real(wp), allocatable :: a(:)               !! (nq) accelerations, global axes for the frames' origins [m/s2, rad/s2]
    real(wp), allocatable :: zdd(:)             !! (nz) highest derivatives of internal variables [m/s2, rad/s2], [m/s, rad/s]
    real(wp), allocatable :: lambda_change(:)   !! (rows) correction of the multipliers, or work [N]
    real(wp), allocatable :: change(:)          !! (nq) correction of the accelerations, or work [m/s2, rad/s2]
    real(wp) :: dissipated_power = 0.0_wp       !! by force elements and Rayleigh damping [W]
    real(wp), allocatable :: loss(:)            !! (term losses) power dissipated by each term of each material [W]
    real(wp), allocatable :: dissipated_in(:)   !! (nb) by the materials of each body, where sensors integrate [W]
    real(wp) :: input_power = 0.0_wp            !! of loads and drives [W]
    logical :: broken = .false.                 !! a condensed mass matrix lost positive definiteness
    integer(ip) :: evaluations = 0              !! right-hand sides so far
    integer(ip) :: solves = 0                   !! banded solves of bodies so far
    integer(ip) :: factorisations = 0           !! of body mass matrices
  end type evaluation

contains

  !> A global vector in the axes of a body; those of the ground are global.
  pure function to_body(self, b, x) result(y)
    class(frame_results), intent(in) :: self
    integer, intent(in) :: b                    !! body, 0: the ground
    real(wp), intent(in) :: x(2)                !! [any]
    real(wp) :: y(2)
    y = x
    if (b > 0) y = [self%cos(b)*x(1) + self%sin(b)*x(2), self%cos(b)*x(2) - self%sin(b)*x(1)]
  end function to_body

  !> And back.
  pure function to_global(self, b, x) result(y)
    class(frame_results), intent(in) :: self
    integer, intent(in) :: b                    !! body, 0: the ground
    real(wp), intent(in) :: x(2)                !! [any]
    real(wp) :: y(2)
    y = x
    if (b > 0) y = [self%cos(b)*x(1) - self%sin(b)*x(2), self%sin(b)*x(1) + self%cos(b)*x(2)]
  end function to_global

  !> State and motion of row k of those that switch, also where it holds nothing; its acceleration is that of the last evaluation.
  pure type(row_motion) function motion_of_row(m, ev, k) result(x)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: k
    real(wp) :: term(6)                     ! [m/s]
    associate (c => m%s%constraints(m%s%permanent + k)%item, r => ev%rows)
      associate (i => c%first, a => c%ia, b => c%ib)
        term = [r%na(:, i)*ev%p%v(:, a), r%nb(:, i)*ev%p%v(:, b), r%sa(i)*ev%p%rate(a), r%sb(i)*ev%p%rate(b)]
        x = row_motion(ev%switches%state(c%switch_number), ev%switches%event_value(c%switch_number), sum(term), &
                       r%acceleration(i), resting*m%s%size + root_rounding*sum(abs(term)), ev%schur%diagonal(i))
        x%pressed = r%pressed(i)
        x%noise = root_rounding*r%largest + merge(resting, root_rounding, ev%schur%singular)*x%compliance*r%strongest
      end associate
    end associate
  end function motion_of_row

  !> Power that its friction dissipates.
  pure real(wp) function slip_power(m, ev, k) result(power)   ! [W]
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: k
    associate (c => m%s%constraints(m%s%permanent + k)%item, r => ev%rows, v => ev%p%v)
      associate (i => c%first, a => c%ia, b => c%ib)
        power = ev%lambda(i)*((r%na(1, i)*v(1, a) + r%na(2, i)*v(2, a)) + (r%nb(1, i)*v(1, b) + r%nb(2, i)*v(2, b)) &
                              + (r%sa(i)*ev%p%rate(a) + r%sb(i)*ev%p%rate(b)))
      end associate
    end associate
  end function slip_power

  !> Values on which force element k may depend beside the motion of its markers, in the last evaluation.
  pure type(conditions) function conditions_of(m, ev, k, argument) result(with)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: k
    integer, intent(in), optional :: argument   !! the one by which slopes are asked for; without it the first
    integer :: b, i, j
    associate (options => ev%options)
      with = conditions(ev%t, options%left_limit, options%stage, options%load_factor, options%prestress)
    end associate
    b = m%markers%body(m%s%forces(k)%item%ia)
    if (b > 0) with%axes = [ev%frame%cos(b), ev%frame%sin(b)]
    i = m%s%forces(k)%item%controller
    if (i > 0) then
      with%signal = ev%control(i)%output
      if (ev%options%controlled) with%slopes = m%s%controllers(i)%slopes(ev%control(i)%limited)
    end if
    i = m%s%forces(k)%item%motion_factor
    if (i > 0) then
      j = 1
      if (present(argument)) j = argument
      with%signal = ev%factor(i)%value
      if (j <= size(ev%factor(i)%slopes)) with%slopes(1) = ev%factor(i)%slopes(j)
    end if
    i = m%s%forces(k)%item%switch_number
    if (i == 0) return
    with%state = ev%switches%state(i)
    with%event_value = ev%switches%event_value(i)
    if (m%s%forces(k)%item%row > 0) with%multiplier = ev%lambda(m%s%forces(k)%item%row)
  end function conditions_of

  !> Powers that the state integrates: power dissipated by all, put in, dissipated by each element that switches, also by friction,
  !> by each term of each material, by each damped spring, and what sensors integrate.
  pure subroutine powers_of(m, ev, power)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(out) :: power(:)           !! (quadratures) [W]
    integer :: k, n
    power(1) = ev%dissipated_power
    power(2) = ev%input_power
    if (size(power) == 2) return     ! nothing is kept by cause: every evaluation comes here
    do k = 1, size(m%s%switching)
      power(2 + k) = ev%action(m%s%switching(k))%dissipated
    end do
    n = 2 + size(m%s%switching)
    do k = 1, size(m%s%friction)
      power(n + k) = 0.0_wp
      if (ev%rows%off(m%s%friction(k)%row)) power(n + k) = slip_power(m, ev, k)
      power(1) = power(1) + power(n + k)
    end do
    n = 2 + m%s%elements
    do k = 1, m%s%term_losses
      power(1) = power(1) + ev%loss(k)
      power(n + k) = ev%loss(k)
    end do
    do k = m%s%term_losses + 1, size(m%s%losses)
      power(n + k) = ev%action(m%s%losses(k)%spring)%dissipated
    end do
    n = n + size(m%s%losses)
    do k = 1, size(m%s%integrated)
      power(n + k) = power_of(m, ev, m%s%integrated(k))
    end do
  end subroutine powers_of

  !> The power of one source in the last evaluation.
  pure real(wp) function power_of(m, ev, source) result(power)   ! [W]
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    type(power_source), intent(in) :: source
    power = row_power(m, ev, source, ev%lambda)
    if (source%body > 0) power = ev%dissipated_in(source%body)
    if (source%element == 0) return
    associate (f => m%s%forces(source%element)%item, does => ev%action(source%element), p => ev%p)
      power = dot_product(does%a(1:2), p%v(:, f%ia)) + does%a(3)*p%rate(f%ia)
      if (f%ib /= f%ia) power = power + dot_product(does%b(1:2), p%v(:, f%ib)) + does%b(3)*p%rate(f%ib)
    end associate
  end function power_of

  !> The same by constraint rows alone: of a drive its multiplier times what it prescribes, of a joint, with its friction, the power
  !> of its reaction on body a.
  pure real(wp) function row_power(m, ev, source, lambda) result(power)   ! [W], of impulses [J]
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    type(power_source), intent(in) :: source
    real(wp), intent(in) :: lambda(:)           !! (rows) multipliers [N], or impulses [N s]
    integer :: i, k
    power = 0.0_wp
    if (source%drive > 0) then
      i = m%s%constraints(source%drive)%item%first
      power = lambda(i)*ev%rows%phi_t(i)
    else if (allocated(source%joint)) then
      do k = 1, size(source%joint)
        associate (c => m%s%constraints(source%joint(k))%item, r => ev%rows, p => ev%p)
          do i = c%first, c%first + c%rows - 1
            power = power - lambda(i)*(dot_product(r%na(:, i), p%v(:, c%ia)) + r%sa(i)*p%rate(c%ia))
          end do
        end associate
      end do
    end if
  end function row_power
end module evaluation_results
