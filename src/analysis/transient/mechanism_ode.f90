!> The mechanism as integrators see it: what implicit methods ask beyond its rates and events.
module mechanism_ode
  use kinds, only: wp
  use border_row_lists, only: row_lists, list_rows, order_rows
  use border_rows, only: regularise_weak_rows, light_shift, least_shift, strong_shift, stage_shift, weak_pivot
  use condensed_system, only: change_rows
  use complex_condensed_system, only: complex_matrix => condensed_matrix, set_up_complex => set_up_condensed, &
                                      change_complex => change_rows
  use controls, only: control_inputs, control_slopes, solve_controls
  use dynamics, only: evaluate, set_frames, marker_kinematics, constraint_values, row_rates
  use evaluation_settings, only: at_side
  use evaluation_results, only: powers_of
  use force_element, only: inactive
  use mechanism, only: mechanism_model
  use mechanism_events, only: switching_mechanism
  use complex_newton_condensation, only: condense_complex => condense
  use newton_correction, only: take_residual, correction, row_correction
  use complex_newton_correction, only: take_complex => take_residual, correct_complex => correction
  use newton_equations, only: prepare, set_terms, use_given_terms, residual, gather_residual, renew, factor_stages, &
                              complex_tangents
  use newton_results, only: term_deformations, relaxation_rates, find_powers, mass_product, rounding_scale_of
  use newton_start, only: smooth_accelerations, row_gaps, row_correction_by_mass
  use newton_system, only: newton_matrix, set_up_newton
  use switched_rows, only: slip_gaps
  implicit none (type, external)
  private

  real(wp), parameter :: enlarging = 1.0e-2_wp    !! pivot of rows near a singular position that enlarge rounding [-]

  !> The system.
  type, extends(switching_mechanism), public :: mechanism_system
    class(newton_matrix), allocatable :: t    !! implicit methods: the dynamic stiffness
    type(complex_matrix), allocatable :: stages   !! methods of several stages: the same for a complex constant
    logical, private :: turning_lines = .false.   !! single-stage methods: rates are closed by the mass (theory.md, section 7)
    logical, allocatable, private :: bordered(:)   !! whether each element that switches has rows in the border of implicit steps
  contains
    procedure :: start_implicit
    procedure :: prepare => mechanism_prepare
    procedure :: residual => mechanism_residual
    procedure :: renew => mechanism_renew
    procedure :: correction => mechanism_correction
    procedure :: complex_correction
    procedure :: gap_correction
    procedure :: gaps
    procedure :: deformations
    procedure :: solve_linear
    procedure :: powers
    procedure :: mass_product => mechanism_mass
    procedure :: accelerations
    procedure :: smooth
    procedure :: choose_rows
  end type mechanism_system

contains

  !> Makes ready for an implicit method.
  subroutine start_implicit(self, stages)
    class(mechanism_system), intent(inout) :: self
    logical, intent(in) :: stages             !! the method has several
    integer :: k
    self%nq = self%m%s%nq
    self%nz = self%m%s%nz
    self%nzd = self%m%s%nzd
    self%linear = sum(self%m%s%controllers%states)
    self%rows = self%m%s%rows
    self%quadratures = self%m%s%quadratures
    self%blocks = count(self%m%s%bodies%flexible)
    if (allocated(self%t)) deallocate (self%t)
    if (allocated(self%stages)) deallocate (self%stages)
    allocate (self%t)
    self%turning_lines = .not. stages .and. any([(self%m%s%constraints(k)%item%line_turns(), k=1, self%m%s%permanent)])
    call set_up_newton(self%t, self%m)
    if (stages) then
      allocate (self%stages)
      call set_up_complex(self%stages, self%m, self%t%t%rows%row_lists)
      call use_given_terms(self%t)
    end if
    self%follows_stiffness = .false.
    self%bordered = spread(.true., 1, size(self%m%s%switching))
    call self%choose_rows()
    self%viscosity = spread(0.0_wp, 1, self%nz)
    self%inertia = self%viscosity
    do k = 1, size(self%t%terms)
      associate (t => self%t%terms(k))
        self%viscosity(t%first:t%last) = t%viscosity
        self%inertia(t%first:t%last) = t%inertia
      end associate
    end do
  end subroutine start_implicit

  !> Elements that are inactive have no rows in the border of implicit steps: open stops would widen its band.
  subroutine choose_rows(self)
    class(mechanism_system), intent(inout) :: self
    type(row_lists) :: lists
    if (.not. allocated(self%t)) return
    associate (states => self%ev%switches%state)
      if (all(self%bordered .eqv. states(:size(self%bordered)) /= inactive)) return
      self%bordered = states(:size(self%bordered)) /= inactive
      call list_rows(lists, self%m, states)
    end associate
    call order_rows(lists)
    call change_rows(self%t%t, self%m, lists)
    if (allocated(self%stages)) call change_complex(self%stages, self%m, lists)
  end subroutine choose_rows

  !> Takes the constants of a step and factors the elastic blocks.
  subroutine mechanism_prepare(self, c1, c2, near, ok)
    class(mechanism_system), intent(inout) :: self
    complex(wp), intent(in) :: c1(:)          !! [1/s2]
    complex(wp), intent(in) :: c2(:)          !! [1/s]
    real(wp), intent(in) :: near              !! of c1 [-]
    logical, intent(out) :: ok
    logical :: bad
    if (allocated(self%stages)) then
      self%t%t%rows%unit = c2(1)%re
      self%stages%rows%unit = c2(2)
      call factor_stages(self%stages, self%t, self%m, c2, bad)
    else
      call prepare(self%t, self%m, c1(1)%re, c2(1)%re, near, bad)
    end if
    ok = .not. bad
  end subroutine mechanism_prepare

  !> Residual at a trial state.
  subroutine mechanism_residual(self, t, q, v, a, z, lambda, left_limit, r, gap)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in), contiguous :: q(:), v(:), a(:)   !! (nq) [m, rad], rates, accelerations
    real(wp), intent(in), contiguous :: z(:)               !! (nz) [m, rad]
    real(wp), intent(in), contiguous :: lambda(:)          !! (rows) [N]
    logical, intent(in) :: left_limit
    real(wp), intent(out), contiguous :: r(:)              !! (nq) [N, N m]
    real(wp), intent(out), contiguous :: gap(:)            !! (rows) [m] or [m/s]
    call set_terms(self%t, self%m, z)
    call residual(self%t, self%m, self%ev, at_side(self%options, left_limit), t, q, v, a, lambda)
    call gather_residual(self%t, self%m, self%ev, r)
    self%t%t%solved = .false.
    if (allocated(self%stages)) then
      self%stages%solved = .false.
      call row_rates(self%m, self%ev, gap)
    else
      gap = self%ev%rows%phi
    end if
    call slip_gaps(self%m, self%ev, lambda, gap)
  end subroutine mechanism_residual

  !> The matrices at the state of the last residual. In a singular position rows depend on others: a stronger shift regularises all.
  subroutine mechanism_renew(self, q, v, a, lambda, exact, regularise, ok, r, r_complex)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in), contiguous :: q(:), v(:), a(:)   !! (nq) [m, rad], rates, accelerations
    real(wp), intent(in), contiguous :: lambda(:)          !! (rows) [N]
    logical, intent(in) :: exact, regularise
    logical, intent(out) :: ok
    real(wp), intent(in), contiguous :: r(:)               !! (nq) [N, N m]
    complex(wp), intent(in), contiguous, optional :: r_complex(:)   !! (nq) [N, N m]
    logical :: bad
    self%shift = merge(light_shift, least_shift, self%m%redundant)
    if (regularise) self%shift = merge(stage_shift, strong_shift, allocated(self%stages))
    self%t%t%rows%held = merge(self%shift, 0.0_wp, merge(allocated(self%stages), self%m%redundant, regularise))
    if (allocated(self%stages)) self%stages%rows%held = self%t%t%rows%held
    call set_gains(self)
    call take_residual(self%t%t, self%m, self%ev, r)
    call renew(self%t, self%m, self%ev, q, v, a, lambda, exact, self%shift, bad)
    if (present(r_complex) .and. .not. bad) then
      call take_complex(self%stages, self%m, self%ev, r_complex)
      call complex_tangents(self%stages, self%t, self%m, self%ev, q, v, a)
      call condense_complex(self%stages, self%m, self%ev, self%t%eq, v, a, lambda, exact, self%shift, bad)
    end if
    self%least_pivot = self%t%t%rows%least_pivot
    self%weak_rows = self%least_pivot < weak_pivot
    self%enlargement = merge(1.0_wp, 0.0_wp, self%m%redundant)
    if (.not. self%m%redundant .and. self%least_pivot < enlarging) self%enlargement = 1/sqrt(max(self%least_pivot, self%shift))
    self%rounding_scale = rounding_scale_of(self%m, self%ev, q)
    ok = .not. bad
  end subroutine mechanism_renew

  !> Gains of controllers for the constants of the matrices.
  subroutine set_gains(self)
    class(mechanism_system), intent(inout) :: self
    integer :: k
    if (size(self%m%s%controllers) == 0) return
    do k = 1, size(self%m%s%forces)
      associate (c => self%m%s%forces(k)%item%controller)
        if (c == 0) cycle
        associate (control => self%m%s%controllers(c), side => self%ev%control(c)%limited)
          self%t%t%element_factor(k) = real(control%response(side, cmplx(self%t%t%c2, 0.0_wp, wp)), wp)
          if (allocated(self%stages)) self%stages%element_factor(k) = control%response(side, self%stages%c2)
        end associate
      end associate
    end do
  end subroutine set_gains

  !> Corrections by the real matrix.
  subroutine mechanism_correction(self, r, gap, dq, dlambda)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in), contiguous :: r(:)          !! (nq) [N, N m]
    real(wp), intent(in), contiguous :: gap(:)        !! (rows) [m]
    real(wp), intent(out), contiguous :: dq(:)        !! (nq) [m, rad]
    real(wp), intent(inout), contiguous :: dlambda(:)   !! (rows) multipliers over their held values, then corrections [N]
    if (.not. self%t%t%solved) call take_residual(self%t%t, self%m, self%ev, r)
    call correction(self%t%t, self%m, self%ev, gap, dq, dlambda)
    dlambda = self%t%t%rows%y(1:self%rows)
  end subroutine mechanism_correction

  !> The same by the complex matrix.
  subroutine complex_correction(self, r, gap, dq, dlambda)
    class(mechanism_system), intent(inout) :: self
    complex(wp), intent(in), contiguous :: r(:)         !! (nq) [N, N m]
    complex(wp), intent(in), contiguous :: gap(:)       !! (rows) [m]
    complex(wp), intent(out), contiguous :: dq(:)       !! (nq) [m, rad]
    complex(wp), intent(inout), contiguous :: dlambda(:)  !! (rows) multipliers over their held values, then corrections [N]
    if (.not. self%stages%solved) call take_complex(self%stages, self%m, self%ev, r)
    call correct_complex(self%stages, self%m, self%ev, gap, dq, dlambda)
    dlambda = self%stages%rows%y(1:self%rows)
  end subroutine complex_correction

  !> Powers at the end of a step or stage.
  subroutine powers(self, t, q, v, lambda, z, zd, power)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in), contiguous :: q(:), v(:)        !! (nq) [m, rad] and per second
    real(wp), intent(in), contiguous :: lambda(:)         !! (rows) [N]
    real(wp), intent(in), contiguous :: z(:), zd(:)       !! (nz) [m, rad] and per second
    real(wp), intent(out) :: power(:)         !! as `powers_of` [W]
    associate (m => self%m, ev => self%ev)
      ev%options = at_side(self%options, .true.)
      call marker_kinematics(m, ev, q, v)
      if (size(m%s%constraints) > m%s%joints .or. size(m%s%integrated) > 0) then   ! powers of drives, rows that switch, joints
        call constraint_values(m, ev, ev%options, t)
      end if
      call find_powers(self%t, m, ev, t, v, lambda, z, zd, power)
    end associate
  end subroutine powers

  !> Products with the mass.
  function mechanism_mass(self, q, x) result(product)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in), contiguous :: q(:)      !! (nq) [m, rad]
    real(wp), intent(in), contiguous :: x(:, :)   !! (nq + nz, 4) [any]
    real(wp) :: product                           !! [J] for rates
    product = mass_product(self%t, self%m, self%ev, q, x)
  end function mechanism_mass

  !> Accelerations, multipliers and powers of the equations.
  subroutine accelerations(self, t, q, v, z, zd, a, lambda, powers)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in), contiguous :: q(:), v(:), z(:)          !! (nq), (nz) [m, rad] and per second
    real(wp), intent(inout), contiguous :: zd(:)                  !! (nz) [m/s, rad/s]; set where of first order
    real(wp), intent(out), contiguous :: a(:)        !! (nq + nz) [m/s2, rad/s2]
    real(wp), intent(out), contiguous :: lambda(:)   !! (rows) [N]
    real(wp), intent(out) :: powers(:)        !! as `powers_of` [W]
    call evaluate(self%m, self%ev, at_side(self%options, .false.), t, q, v, z, zd)
    a(1:self%nq) = self%ev%a
    a(self%nq + 1:) = self%ev%zdd
    call relaxation_rates(self%t, self%m, self%ev, q, v, zd, a(self%nq + 1:))
    call control_slopes(self%m, self%ev, t, zd, a(self%nq + 1:))
    lambda = self%ev%lambda
    call powers_of(self%m, self%ev, powers)
  end subroutine accelerations

  !> Accelerations that a step resolves.
  subroutine smooth(self, t, q, v, z, lambda, a, ok)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in), contiguous :: q(:), v(:), lambda(:)   !! (nq), (rows) [m, rad], rates, [N]
    real(wp), intent(in), contiguous :: z(:)                    !! (nz) [m, rad]
    real(wp), intent(inout), contiguous :: a(:)                 !! (nq) [m/s2, rad/s2]
    logical, intent(out) :: ok
    logical :: bad
    call set_terms(self%t, self%m, z)
    call smooth_accelerations(self%t, self%m, self%ev, self%options, t, q, v, lambda, a, bad)
    ok = .not. bad
  end subroutine smooth

  !> The constraints and their derivatives.
  subroutine gaps(self, t, q, v, a, u, gap)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in), contiguous :: q(:), v(:), a(:), u(:)   !! (nq) [m, rad], rates, accelerations, [any]
    real(wp), intent(out), contiguous :: gap(:, 0:)        !! (rows, 0:2 or 0:3) [m], [m/s], [m/s2], [any]
    call row_gaps(self%m, self%ev, t, q, v, a, u, gap)
  end subroutine gaps

  !> Closes gaps in the directions that the constraints fix.
  subroutine gap_correction(self, q, gap, dq, dlambda)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in), contiguous :: q(:)          !! (nq) [m, rad]
    real(wp), intent(in), contiguous :: gap(:, :)        !! (rows, columns) [m] and its derivatives
    real(wp), intent(out), contiguous :: dq(:, :)        !! (nq, columns) [m, rad] and theirs
    real(wp), intent(out), contiguous :: dlambda(:, :)   !! (rows, columns) [N] and theirs
    logical :: closed
    closed = .false.
    call set_frames(self%m, self%ev, q)
    if (self%turning_lines) call row_correction_by_mass(self%m, self%ev, self%t%t%c1, q, gap, dq, dlambda, closed)
    if (closed) return
    if (.not. allocated(self%stages)) call regularise_weak_rows(self%t%t%rows)
    call row_correction(self%t%t, self%m, self%ev, gap, dq, dlambda)
  end subroutine gap_correction

  !> Deformations that internal variables follow.
  subroutine deformations(self, t, q, v, delta)
    class(mechanism_system), intent(inout) :: self
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in), contiguous :: q(:), v(:)   !! (nq) [m, rad] and per second
    real(wp), intent(out), contiguous :: delta(:)    !! (nz) [m, rad]
    call term_deformations(self%t, self%m, self%ev, q, v, delta)
    call control_inputs(self%m, self%ev, self%options, t, q, v, delta)
  end subroutine deformations

  !> States of controllers.
  subroutine solve_linear(self, c, x)
    class(mechanism_system), intent(in) :: self
    complex(wp), intent(in) :: c              !! [1/s]
    complex(wp), intent(inout) :: x(:)        !! (linear) [any], then [any s]
    call solve_controls(self%m, self%ev, c, x)
  end subroutine solve_linear
end module mechanism_ode
