!> What an implicit method needs at the end of a step: deformations of internal variables, powers, products with the mass, the size
!> of rounding errors.
module newton_results
  use kinds, only: wp
  use body, only: body_model
  use body_terms, only: body_equations
  use dynamics, only: marker_kinematics, applied_forces, drive_powers
  use elastic_operators, only: add_product, elastic_mass => mass_product
  use condensed_terms, only: term_product
  use evaluation_results, only: evaluation, powers_of
  use measure, only: measured
  use mechanism, only: mechanism_model
  use newton_system, only: newton_matrix
  implicit none (type, external)
  private
  public :: term_deformations, relaxation_rates, find_powers, mass_product, rounding_scale_of

contains

  !> The deformations that the dissipative coordinates follow.
  subroutine term_deformations(self, m, ev, q, v, delta)
    type(newton_matrix), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in), contiguous :: q(:), v(:)            !! (nq) [m, rad] and per second
    real(wp), intent(out), contiguous :: delta(:)             !! (nz) [m, rad]
    type(measured) :: now
    integer :: k
    if (size(self%terms) == 0) return
    if (any(self%terms%element > 0)) call marker_kinematics(m, ev, q, v)
    call deform(self, m, q, delta)
    do k = 1, size(self%terms)
      associate (t => self%terms(k))
        if (t%body > 0) cycle
        now = m%s%forces(t%element)%item%deformation(ev%p)
        delta(t%first) = now%x
      end associate
    end do
  end subroutine term_deformations

  !> Those of the viscoelastic bodies.
  subroutine deform(self, m, q, delta)
    type(newton_matrix), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in) :: q(:)                              !! (nq) [m, rad]
    real(wp), intent(inout), contiguous :: delta(:)           !! (nz) [m, rad]
    integer :: b, i, k
    do b = 1, size(m%s%bodies)
      associate (body => m%s%bodies(b), w => self%eq(b)%w)
        if (body%nz == 0) cycle
        i = m%s%qo(b) + 3
        w%q(1:) = q(i + 1:i + body%nf)
        call body%basis%deform(body, w%q, w%d)
      end associate
    end do
    do k = 1, size(self%terms)
      associate (t => self%terms(k), i => self%terms(k)%first, j => self%terms(k)%last)
        if (t%body == 0) cycle
        associate (segment => m%s%bodies(t%body)%segments(t%segment))
          call flatten(j - i + 1, self%eq(t%body)%w%d(:, segment%first:segment%last), delta(i:j))
        end associate
      end associate
    end do
  end subroutine deform

  !> An array as a vector.
  pure subroutine flatten(n, x, y)
    integer, intent(in) :: n
    real(wp), intent(in) :: x(n)             !! [m, rad]
    real(wp), intent(out) :: y(n)            !! [m, rad]
    y = x
  end subroutine flatten

  !> Rates of the internal variables of first order at the state of the last evaluation, and the rates' own derivatives,
  !> (delta' - z')/tau. Deformations are at most quadratic in q: delta' = (delta(q + v) - delta(q - v))/2, exactly.
  subroutine relaxation_rates(self, m, ev, q, v, zd, a)
    type(newton_matrix), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in), contiguous :: q(:), v(:)            !! (nq) [m, rad] and per second
    real(wp), intent(inout), contiguous :: zd(:)              !! (nz) [m/s, rad/s], of second order: untouched
    real(wp), intent(inout), contiguous :: a(:)               !! (nz) [m/s2, rad/s2], of second order: untouched
    real(wp), dimension(size(a)) :: before, after             ! [m, rad]
    type(measured) :: now
    integer :: k
    if (m%s%nz == m%s%nzd) return
    zd(m%s%nzd + 1:) = ev%zdd(m%s%nzd + 1:)
    call deform(self, m, q - v, before)
    call deform(self, m, q + v, after)
    do k = 1, size(self%terms)
      associate (t => self%terms(k), i => self%terms(k)%first, j => self%terms(k)%last)
        if (i <= m%s%nzd) cycle
        if (t%body == 0) then
          now = m%s%forces(t%element)%item%deformation(ev%p)
          a(i) = (now%rate - zd(i))/t%viscosity
        else
          a(i:j) = (0.5_wp*(after(i:j) - before(i:j)) - zd(i:j))/t%viscosity
        end if
      end associate
    end do
  end subroutine relaxation_rates

  !> Power dissipated in bodies and springs, and put in by loads and drives, at the present frames and markers.
  subroutine find_powers(self, m, ev, t, v, lambda, z, zd, power)
    type(newton_matrix), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in) :: t                                 !! [s]
    real(wp), intent(in), contiguous :: v(:)                  !! (nq) [m/s, rad/s]
    real(wp), intent(in) :: lambda(:)                         !! (rows) [N]
    real(wp), intent(in), contiguous :: z(:), zd(:)           !! (nz) [m, rad] and per second
    real(wp), intent(out) :: power(:)                         !! as `powers_of` [W]
    real(wp) :: lost                                          ! [W]
    integer :: k, b, i, n
    ev%dissipated_in = 0.0_wp
    ev%dissipated_power = 0.0_wp
    ev%loss = 0.0_wp
    ev%input_power = 0.0_wp
    call applied_forces(m, ev, ev%options, t, z, zd)
    do k = 1, size(self%terms)
      associate (s => self%terms(k))
        if (s%body == 0) cycle
        lost = s%alpha*s%viscosity*term_product(s, m%s, zd(s%first:s%last), zd(s%first:s%last))
        ev%loss(s%loss) = ev%loss(s%loss) + lost
        ev%dissipated_in(s%body) = ev%dissipated_in(s%body) + lost
      end associate
    end do
    do b = 1, size(self%eq)
      i = m%s%qo(b) + 3
      n = self%eq(b)%n
      if (n == 0 .or. .not. m%s%bodies(b)%rayleigh) cycle
      associate (eq => self%eq(b), op => m%s%bodies(b)%op)
        eq%elastic = 0.0_wp
        call add_product(op%symmetric, op%c, v(i + 1:i + n), eq%elastic(1:))
        lost = dot_product(v(i + 1:i + n), eq%elastic(1:))
        ev%dissipated_power = ev%dissipated_power + lost
        ev%dissipated_in(b) = ev%dissipated_in(b) + lost
      end associate
    end do
    call drive_powers(m, ev, lambda)
    ev%lambda = lambda                        ! friction dissipates by them, sensors read powers of drives and joints
    call powers_of(m, ev, power)
  end subroutine find_powers

  !> x1^T M x2 + x3^T M x4 of coordinates (frames' origins in global axes) and internal variables, whose mass is alpha inertia D,
  !> and x1^T C x4 of those of first order with C = alpha viscosity D, at the positions q of the last find_powers [J for rates].
  real(wp) function mass_product(self, m, ev, q, x) result(total)
    type(newton_matrix), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: q(:)                              !! (nq) [m, rad]
    real(wp), intent(in), contiguous :: x(:, :)               !! (nq + nz, 4) [any]
    integer :: b, i, n, k, j
    total = 0.0_wp
    do b = 1, size(self%eq)
      i = m%s%qo(b)
      n = self%eq(b)%n
      total = total + body_product(self%eq(b), m%s%bodies(b), ev%frame%cos(b), ev%frame%sin(b), &
                                   q(i + 4:i + 3 + n), x(i + 1:i + 3 + n, :))
    end do
    do k = 1, size(self%terms)
      associate (t => self%terms(k))
        i = m%s%nq + t%first
        j = m%s%nq + t%last
        if (t%inertia > 0.0_wp) then
          total = total + t%alpha*t%inertia*(term_product(t, m%s, x(i:j, 1), x(i:j, 2)) &
                                             + term_product(t, m%s, x(i:j, 3), x(i:j, 4)))
        else
          total = total + t%alpha*t%viscosity*term_product(t, m%s, x(i:j, 1), x(i:j, 4))
        end if
      end associate
    end do
  end function mass_product

  !> x1^T M x2 + x3^T M x4 of one body.
  real(wp) function body_product(eq, body, c, s, q, x) result(total)
    type(body_equations), intent(inout) :: eq
    type(body_model), intent(in) :: body
    real(wp), intent(in) :: c, s              !! of the frame angle [-]
    real(wp), intent(in) :: q(:)              !! (nf) elastic coordinates [m, rad]
    real(wp), intent(in) :: x(:, :)           !! (3 + nf, 4) frames in global axes [any]
    real(wp) :: p(2), r(2, 4), f(2, 4), tf(4)
    integer :: j, k
    p = body%i1
    do j = 1, 4
      r(1, j) = c*x(1, j) + s*x(2, j)
      r(2, j) = c*x(2, j) - s*x(1, j)
    end do
    f = 0.0_wp
    tf = 0.0_wp
    do k = 1, eq%n
      p = p + body%shape%sbar(k, :)*q(k)
      do j = 1, 4
        f(:, j) = f(:, j) + body%shape%sbar(k, :)*x(3 + k, j)
        tf(j) = tf(j) + body%shape%c0(k)*x(3 + k, j)
      end do
    end do
    total = 0.0_wp
    do j = 1, 3, 2
      total = total + body%mass*dot_product(r(:, j), r(:, j + 1)) + x(3, j)*body%i11*x(3, j + 1) &
              + x(3, j)*(p(1)*r(2, j + 1) - p(2)*r(1, j + 1) + tf(j + 1)) &
              + x(3, j + 1)*(p(1)*r(2, j) - p(2)*r(1, j) + tf(j)) &
              + dot_product(r(:, j), f(:, j + 1)) + dot_product(r(:, j + 1), f(:, j))
    end do
    if (eq%n == 0) return
    do j = 1, 3, 2
      call elastic_mass(body%op, x(4:, j + 1), eq%column(1:))
      total = total + dot_product(x(4:, j), eq%column(1:))
    end do
  end function body_product

  !> The size of rounding errors, in units of eps times the scene's size: 1, or how far markers are from the origin in sizes of the
  !> scene, or the largest angle of a frame.
  pure real(wp) function rounding_scale_of(m, ev, q) result(scale)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: q(:)              !! (nq) [m, rad]
    integer :: b
    scale = 1 + max(0.0_wp, maxval(abs(ev%p%r)))/m%s%size             ! without markers the largest is -huge
    do b = 1, size(m%s%bodies)
      scale = max(scale, abs(q(m%s%qo(b) + 3)))
    end do
  end function rounding_scale_of
end module newton_results
