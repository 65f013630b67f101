!> Residual and tangent of the whole mechanism at a trial state (t, q, v, a, lambda). The elastic blocks are factored once a step
!> size (`prepare`). A new tangent renews the frames' columns and rows and the border, and the full elastic blocks only on demand.
!> For several stages: the elastic blocks for a real and a complex constant, and the tangent for the complex one.
module newton_equations
  use kinds, only: wp
  use body_tangents, only: find_tangents, find_wrenches, frame_acceleration
  use body_terms, only: body_residual
  use complex_condensed_system, only: complex_matrix => condensed_matrix
  use complex_elastic_columns, only: factor_complex => factor_blocks
  use complex_newton_condensation, only: add_complex => add_tangent
  use controls, only: control_states
  use elastic_columns, only: factor_blocks
  use dynamics, only: marker_kinematics, constraint_values, applied_forces
  use evaluation_settings, only: evaluation_options
  use evaluation_results, only: evaluation
  use measure, only: measured
  use mechanism, only: mechanism_model
  use newton_condensation, only: add_tangent, condense
  use newton_system, only: newton_matrix
  implicit none (type, external)
  private
  public :: prepare, set_terms, use_given_terms, residual, gather_residual, renew, factor_stages, complex_tangents

contains

  !> Takes the constants of a step: factors the elastic blocks, unless those that stand are of constants so near.
  subroutine prepare(self, m, c1, c2, near, bad)
    type(newton_matrix), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in) :: c1               !! [1/s2]
    real(wp), intent(in) :: c2               !! [1/s]
    real(wp), intent(in) :: near             !! of c1 [-]
    logical, intent(out) :: bad
    self%terms%g = 1/(1 + self%terms%viscosity*c2 + self%terms%inertia*c1)
    call set_factors(self)
    bad = .false.
    if (self%t%factored .and. abs(c1 - self%t%c1) < near*c1) return
    call factor_blocks(self%t, m, self%terms, c1, c2, bad)
  end subroutine prepare

  !> For a method that solves for the dissipative coordinates itself: residuals take them as given, whatever the deformations.
  subroutine use_given_terms(self)
    type(newton_matrix), intent(inout) :: self
    self%stages = .true.
    self%terms%g = 0.0_wp
    call set_factors(self)
  end subroutine use_given_terms

  !> What the terms add to the stiffness of their segments, given what follows the deformations.
  subroutine set_factors(self)
    type(newton_matrix), intent(inout) :: self
    integer :: k
    do k = 1, size(self%eq)
      if (self%eq(k)%n > 0) self%eq(k)%factor = 1.0_wp
    end do
    do k = 1, size(self%terms)
      associate (t => self%terms(k))
        if (t%body > 0) self%eq(t%body)%factor(t%segment) = self%eq(t%body)%factor(t%segment) + t%alpha*(1 - t%g)
      end associate
    end do
  end subroutine set_factors

  !> Sets the dissipative coordinates at zero deformation for the next residuals: those of force elements, and their sum in bodies.
  subroutine set_terms(self, m, z)
    type(newton_matrix), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in), contiguous :: z(:) !! (nz) [m, rad]
    integer :: k, b, e, i
    self%offset = z
    do b = 1, size(self%eq)
      if (m%s%bodies(b)%nz > 0) self%eq(b)%history_strain = 0.0_wp
    end do
    do k = 1, size(self%terms)
      associate (t => self%terms(k))
        if (t%body == 0) cycle
        i = t%first
        associate (x => self%eq(t%body)%history_strain, segment => m%s%bodies(t%body)%segments(t%segment))
          do e = segment%first, segment%first + (t%last - t%first)/size(x, 1)
            x(:, e) = x(:, e) + t%alpha*z(i:i + size(x, 1) - 1)
            i = i + size(x, 1)
          end do
        end associate
      end associate
    end do
  end subroutine set_terms

  !> Residuals of all bodies (self%eq) and values of the constraints (ev%rows%phi).
  subroutine residual(self, m, ev, options, t, q, v, a, lambda)
    type(newton_matrix), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(evaluation_options), intent(in) :: options
    real(wp), intent(in) :: t                !! [s]
    real(wp), intent(in), contiguous :: q(:), v(:), a(:)   !! (nq) positions [m, rad], rates, accelerations
    real(wp), intent(in) :: lambda(:)        !! (rows) [N]
    integer :: b, i, n, k
    ev%t = t
    ev%options = options
    call marker_kinematics(m, ev, q, v)
    call element_state(self, m, ev)
    call applied_forces(m, ev, options, t, self%element_z, self%element_zd)
    call constraint_values(m, ev, options, t)
    call find_wrenches(m, ev, lambda, ev%action, self%wrench)
    do b = 1, size(self%eq)
      i = m%s%qo(b)
      n = i + 3 + self%eq(b)%n
      call body_residual(self%eq(b), m%s%bodies(b), q(i + 1:n), v(i + 1:n), a(i + 1:n), frame_acceleration(m, ev, b, a))
    end do
    do k = 1, size(m%s%markers)
      b = m%markers%body(k)
      if (b == 0) cycle
      associate (eq => self%eq(b))
        if (eq%n > 0) then
          call m%s%markers(k)%add_elastic_forces(self%wrench(:, k), eq%elastic(1:eq%n))
        end if
        eq%frame(1:2) = eq%frame(1:2) + self%wrench(1:2, k)
        eq%frame(3) = eq%frame(3) + self%wrench(3, k) + ev%p%rho(1, k)*self%wrench(2, k) - ev%p%rho(2, k)*self%wrench(1, k)
      end associate
    end do
  end subroutine residual

  !> Dissipative coordinates of the force elements at the trial state.
  subroutine element_state(self, m, ev)
    type(newton_matrix), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    type(measured) :: now
    integer :: k
    do k = 1, size(self%terms)
      associate (t => self%terms(k))
        if (t%element == 0) cycle
        now = m%s%forces(t%element)%item%deformation(ev%p)
        self%element_z(t%first) = t%g*now%x + self%offset(t%first)
      end associate
    end do
    if (size(m%s%controllers) > 0) call control_states(m, ev, self%t%c2, self%stages, self%offset, self%element_z)
  end subroutine element_state

  !> The tangent at the state of the last residual, whose arguments are given again, condensed and factored, together with the
  !> elastic residuals that were taken.
  subroutine renew(self, m, ev, q, v, a, lambda, full_block, shift, bad)
    type(newton_matrix), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in), contiguous :: q(:), v(:), a(:)   !! (nq) [m, rad], rates, accelerations
    real(wp), intent(in) :: lambda(:)        !! (rows) [N]
    logical, intent(in) :: full_block        !! factors the full elastic blocks
    real(wp), intent(in) :: shift            !! of the constraint rows, relative [-]
    logical, intent(out) :: bad
    integer :: b
    call find_tangents(m, ev, self%wrench, ev%action, self%t%c1, self%t%c2, 1.0_wp, q, v, a, self%eq)
    do b = 1, size(self%eq)
      call add_tangent(self%t%b(b), self%eq(b), 1.0_wp, .true.)
    end do
    call condense(self%t, m, ev, self%eq, v, a, lambda, full_block, shift, bad)
  end subroutine renew

  !> The last residual, frames' origins in global axes.
  subroutine gather_residual(self, m, ev, r)
    type(newton_matrix), intent(in) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(out), contiguous :: r(:)              !! (nq) [N, N m]
    integer :: b, i
    do b = 1, size(self%eq)
      i = m%s%qo(b)
      associate (eq => self%eq(b))
        r(i + 1) = ev%frame%cos(b)*eq%frame(1) - ev%frame%sin(b)*eq%frame(2)
        r(i + 2) = ev%frame%sin(b)*eq%frame(1) + ev%frame%cos(b)*eq%frame(2)
        r(i + 3) = eq%frame(3)
        if (eq%n > 0) r(i + 4:i + 3 + eq%n) = eq%elastic(1:eq%n)
      end associate
    end do
  end subroutine gather_residual

  !> Takes a real and a complex constant: elastic blocks of both matrices anew where the constants are.
  subroutine factor_stages(t, newton, m, c2, bad)
    type(complex_matrix), intent(inout) :: t
    type(newton_matrix), intent(inout) :: newton
    type(mechanism_model), intent(in) :: m
    complex(wp), intent(in) :: c2(2)         !! [1/s]
    logical, intent(out) :: bad
    bad = .false.
    if (.not. abs(t%c2 - c2(2)) > 0.0_wp) return
    call factor_blocks(newton%t, m, newton%terms, real(c2(1)**2, wp), real(c2(1), wp), bad)
    if (.not. bad) call factor_complex(t, m, newton%terms, c2(2)**2, c2(2), bad)
    if (bad) t%c2 = 0.0_wp
  end subroutine factor_stages

  !> The complex T(c2**2, c2) at the state of the last residual.
  subroutine complex_tangents(t, newton, m, ev, q, v, a)
    type(complex_matrix), intent(inout) :: t
    type(newton_matrix), intent(inout) :: newton
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in), contiguous :: q(:), v(:), a(:)   !! (nq) [m, rad], rates, accelerations
    integer :: b
    call find_tangents(m, ev, newton%wrench, ev%action, t%c1%re, t%c2%re, 1.0_wp, q, v, a, newton%eq)
    do b = 1, size(newton%eq)
      call add_complex(t%b(b), newton%eq(b), (1.0_wp, 0.0_wp), .true.)
    end do
    call find_tangents(m, ev, newton%wrench, ev%action, t%c1%im, t%c2%im, 0.0_wp, q, v, a, newton%eq)
    do b = 1, size(newton%eq)
      call add_complex(t%b(b), newton%eq(b), (0.0_wp, 1.0_wp), .false.)
    end do
  end subroutine complex_tangents
end module newton_equations
