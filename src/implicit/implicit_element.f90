!> Element loops of the implicit method for a flexible body in nodal coordinates, element by element in arrays (structure
!> of arrays: the compiler vectorises over elements). Element axes; coordinates u1 v1 r1 u2 v2 r2 as in `beam_element`.
module implicit_element
  use kinds, only: wp
  use beam_element, only: element_mass, element_gyroscopic, element_stiffness, deformation_matrix
  use body, only: body_model
  implicit none (type, external)
  private
  public :: element_arrays, set_up_elements, gather, scatter, element_residual, element_mass_product, mass_pairs

  !> Constants and work of all elements of a body.
  type :: element_arrays
    integer :: ne = 0
    integer :: nd = 3                        !! deformations kept per element
    logical :: straight = .true.
    logical :: stiffening = .false.
    logical :: rayleigh = .false.
    integer, allocatable :: edof(:, :)       !! (ne, 6) coordinate of each end, 0: removed
    real(wp), allocatable :: c(:), s(:)      !! (ne) of the element angle [-]
    real(wp), allocatable :: w4(:), w6(:)    !! (ne) element mass over 420 and over 60 [kg]
    real(wp), allocatable :: l(:), il(:)     !! (ne) length [m] and its inverse [1/m]
    real(wp), allocatable :: ea(:), ei(:)    !! (ne) E_R A/L [N/m], E_R I/L [N m]
    real(wp), allocatable :: kf(:)           !! (ne) 1 + sum alpha (1 - g): GHM condensed [-]
    real(wp), allocatable :: rm(:), rk(:)    !! (ne) Rayleigh coefficients [1/s], [s]
    real(wp), allocatable :: hs(:, :)        !! (nd, ne) GHM: what the past of z adds to the deformations
    real(wp), allocatable :: q(:, :), v(:, :), a(:, :)   !! (ne, 6) coordinates, rates, accelerations
    real(wp), allocatable :: f(:, :), g(:, :)            !! (ne, 6) results
    real(wp), allocatable :: me(:, :, :), ze(:, :, :), ke(:, :, :)   !! (6, 6, ne) matrices in body axes
  end type element_arrays

contains

  !> Copies a body's elements into arrays.
  subroutine set_up_elements(el, b)
    type(element_arrays), intent(out) :: el
    type(body_model), intent(in) :: b
    integer :: e
    el%ne = b%ne
    el%nd = b%nd
    el%straight = b%straight
    el%stiffening = b%stiffening
    el%rayleigh = b%rayleigh
    el%edof = transpose(b%edof)
    el%c = b%elements%c
    el%s = b%elements%s
    el%w4 = b%elements%mass/420
    el%w6 = b%elements%mass/60
    el%l = b%elements%length
    el%il = 1/el%l
    el%ea = b%elements%ea_l
    el%ei = b%elements%ei_l
    el%rm = b%elements%ray_m
    el%rk = b%elements%ray_k
    allocate (el%kf(el%ne), source=1.0_wp)
    allocate (el%hs(el%nd, el%ne), source=0.0_wp)
    allocate (el%q(el%ne, 6), el%v(el%ne, 6), el%a(el%ne, 6), el%f(el%ne, 6), el%g(el%ne, 6), source=0.0_wp)
    allocate (el%me(6, 6, el%ne), el%ze(6, 6, el%ne), el%ke(6, 6, el%ne))
    do e = 1, el%ne
      el%me(:, :, e) = element_mass(b%elements(e))
      el%ze(:, :, e) = element_gyroscopic(b%elements(e))
      el%ke(:, :, e) = element_stiffness(b%elements(e))
    end do
  end subroutine set_up_elements

  !> Coordinates of every element in its own axes.
  pure subroutine gather(el, x, y)
    type(element_arrays), intent(in) :: el
    real(wp), intent(in) :: x(0:)            !! (0:nf), entry 0 is zero
    real(wp), intent(inout) :: y(:, :)       !! (ne, 6)
    real(wp) :: u
    integer :: e, k
    do k = 1, 6
      do e = 1, el%ne
        y(e, k) = x(el%edof(e, k))
      end do
    end do
    if (el%straight) return
    do k = 1, 4, 3
      do e = 1, el%ne
        u = y(e, k)
        y(e, k) = el%c(e)*u + el%s(e)*y(e, k + 1)
        y(e, k + 1) = el%c(e)*y(e, k + 1) - el%s(e)*u
      end do
    end do
  end subroutine gather

  !> Adds element vectors to the coordinates; the vectors are turned into body axes on the way.
  pure subroutine scatter(el, y, x)
    type(element_arrays), intent(in) :: el
    real(wp), intent(inout) :: y(:, :)       !! (ne, 6)
    real(wp), intent(inout) :: x(0:)         !! (0:nf), entry 0 is thrown away
    real(wp) :: u
    integer :: e, k
    if (.not. el%straight) then
      do k = 1, 4, 3
        do e = 1, el%ne
          u = y(e, k)
          y(e, k) = el%c(e)*u - el%s(e)*y(e, k + 1)
          y(e, k + 1) = el%c(e)*y(e, k + 1) + el%s(e)*u
        end do
      end do
    end if
    do k = 1, 6
      do e = 1, el%ne
        x(el%edof(e, k)) = x(el%edof(e, k)) + y(e, k)
      end do
    end do
  end subroutine scatter

  !> Residual of all elements, from el%q, el%v, el%a: m (q'' - theta'2 q) - Z (2 theta' q' + theta'' q) + elastic and
  !> Rayleigh forces, added to ff; and q^T m (2 theta' q' + theta'' q) + q^T Z q''.
  subroutine element_residual(el, w, wd, ff, qmx)
    type(element_arrays), intent(inout) :: el
    real(wp), intent(in) :: w, wd            !! frame rate [rad/s] and acceleration [rad/s2]
    real(wp), intent(inout) :: ff(0:)        !! (0:nf)
    real(wp), intent(out) :: qmx             !! [N m]
    integer :: n
    n = el%ne
    call inertia_residual(n, w, wd, el%w4, el%w6, el%l, el%rm, el%q, el%v, el%a, el%f, qmx)
    if (el%stiffening) then
      call stiffened_forces(n, el%l, el%il, el%ea, el%ei, el%kf, el%hs, el%q, el%f)
    else
      call elastic_forces(n, el%nd, el%il, el%ea, el%ei, el%kf, el%hs, el%q, el%f)
    end if
    if (el%rayleigh) call damping_forces(n, el%il, el%ea, el%ei, el%rk, el%v, el%f)
    call scatter(el, el%f, ff)
  end subroutine element_residual

  !> Inertia part of the residual, element axes.
  pure subroutine inertia_residual(n, w, wd, w4, w6, l, rm, q, v, a, f, qmx)
    integer, intent(in) :: n
    real(wp), intent(in) :: w, wd
    real(wp), intent(in) :: w4(n), w6(n), l(n), rm(n), q(n, 6), v(n, 6), a(n, 6)
    real(wp), intent(inout) :: f(n, 6)
    real(wp), intent(out) :: qmx
    real(wp) :: x1, x2, x3, x4, x5, x6, y1, y2, y3, y4, y5, y6, g1, g2, g3, g4, g5, g6, w2
    integer :: e
    w2 = w**2
    qmx = 0.0_wp
    do e = 1, n
      x1 = a(e, 1) - w2*q(e, 1) + rm(e)*v(e, 1)
      x2 = a(e, 2) - w2*q(e, 2) + rm(e)*v(e, 2)
      x3 = (a(e, 3) - w2*q(e, 3) + rm(e)*v(e, 3))*l(e)
      x4 = a(e, 4) - w2*q(e, 4) + rm(e)*v(e, 4)
      x5 = a(e, 5) - w2*q(e, 5) + rm(e)*v(e, 5)
      x6 = (a(e, 6) - w2*q(e, 6) + rm(e)*v(e, 6))*l(e)
      y1 = 2*w*v(e, 1) + wd*q(e, 1)
      y2 = 2*w*v(e, 2) + wd*q(e, 2)
      y3 = (2*w*v(e, 3) + wd*q(e, 3))*l(e)
      y4 = 2*w*v(e, 4) + wd*q(e, 4)
      y5 = 2*w*v(e, 5) + wd*q(e, 5)
      y6 = (2*w*v(e, 6) + wd*q(e, 6))*l(e)
      f(e, 1) = w4(e)*(140*x1 + 70*x4) - w6(e)*(21*y2 + 3*y3 + 9*y5 - 2*y6)
      f(e, 4) = w4(e)*(70*x1 + 140*x4) - w6(e)*(9*y2 + 2*y3 + 21*y5 - 3*y6)
      f(e, 2) = w4(e)*(156*x2 + 22*x3 + 54*x5 - 13*x6) + w6(e)*(21*y1 + 9*y4)
      f(e, 3) = l(e)*(w4(e)*(22*x2 + 4*x3 + 13*x5 - 3*x6) + w6(e)*(3*y1 + 2*y4))
      f(e, 5) = w4(e)*(54*x2 + 13*x3 + 156*x5 - 22*x6) + w6(e)*(9*y1 + 21*y4)
      f(e, 6) = -l(e)*(w4(e)*(13*x2 + 3*x3 + 22*x5 - 4*x6) + w6(e)*(2*y1 + 3*y4))
      x3 = a(e, 3)*l(e)
      x6 = a(e, 6)*l(e)
      g1 = w4(e)*(140*y1 + 70*y4) + w6(e)*(21*a(e, 2) + 3*x3 + 9*a(e, 5) - 2*x6)
      g4 = w4(e)*(70*y1 + 140*y4) + w6(e)*(9*a(e, 2) + 2*x3 + 21*a(e, 5) - 3*x6)
      g2 = w4(e)*(156*y2 + 22*y3 + 54*y5 - 13*y6) - w6(e)*(21*a(e, 1) + 9*a(e, 4))
      g3 = w4(e)*(22*y2 + 4*y3 + 13*y5 - 3*y6) - w6(e)*(3*a(e, 1) + 2*a(e, 4))
      g5 = w4(e)*(54*y2 + 13*y3 + 156*y5 - 22*y6) - w6(e)*(9*a(e, 1) + 21*a(e, 4))
      g6 = -w4(e)*(13*y2 + 3*y3 + 22*y5 - 4*y6) + w6(e)*(2*a(e, 1) + 3*a(e, 4))
      qmx = qmx + q(e, 1)*g1 + q(e, 2)*g2 + q(e, 3)*l(e)*g3 + q(e, 4)*g4 + q(e, 5)*g5 + q(e, 6)*l(e)*g6
    end do
  end subroutine inertia_residual

  !> Adds B^T D (kf delta - hs) (theory.md, sections 4 and 5).
  pure subroutine elastic_forces(n, nd, il, ea, ei, kf, hs, q, f)
    integer, intent(in) :: n, nd
    real(wp), intent(in) :: il(n), ea(n), ei(n), kf(n), hs(nd, n), q(n, 6)
    real(wp), intent(inout) :: f(n, 6)
    real(wp) :: psi, p1, p2, m1, m2, s
    integer :: e
    do e = 1, n
      psi = (q(e, 5) - q(e, 2))*il(e)
      p1 = kf(e)*(q(e, 3) - psi) - hs(nd - 1, e)
      p2 = kf(e)*(q(e, 6) - psi) - hs(nd, e)
      m1 = ei(e)*(4*p1 + 2*p2)
      m2 = ei(e)*(2*p1 + 4*p2)
      s = (m1 + m2)*il(e)
      f(e, 2) = f(e, 2) + s
      f(e, 5) = f(e, 5) - s
      f(e, 3) = f(e, 3) + m1
      f(e, 6) = f(e, 6) + m2
    end do
    if (nd < 3) return
    do e = 1, n
      s = ea(e)*(kf(e)*(q(e, 4) - q(e, 1)) - hs(1, e))
      f(e, 1) = f(e, 1) - s
      f(e, 4) = f(e, 4) + s
    end do
  end subroutine elastic_forces

  !> The same with geometric stiffening.
  pure subroutine stiffened_forces(n, l, il, ea, ei, kf, hs, q, f)
    integer, intent(in) :: n
    real(wp), intent(in) :: l(n), il(n), ea(n), ei(n), kf(n), hs(3, n), q(n, 6)
    real(wp), intent(inout) :: f(n, 6)
    real(wp) :: psi, p1, p2, d1, d2, m1, m2, s, t
    integer :: e
    do e = 1, n
      psi = (q(e, 5) - q(e, 2))*il(e)
      p1 = q(e, 3) - psi
      p2 = q(e, 6) - psi
      s = q(e, 4) - q(e, 1) + l(e)*(0.5_wp*psi**2 + (2*p1**2 - p1*p2 + 2*p2**2)/30)
      s = ea(e)*(kf(e)*s - hs(1, e))
      d1 = kf(e)*p1 - hs(2, e)
      d2 = kf(e)*p2 - hs(3, e)
      t = s*l(e)/30
      m1 = ei(e)*(4*d1 + 2*d2) + t*(4*p1 - p2)
      m2 = ei(e)*(2*d1 + 4*d2) + t*(4*p2 - p1)
      f(e, 1) = f(e, 1) - s
      f(e, 4) = f(e, 4) + s
      s = (m1 + m2)*il(e) - s*psi
      f(e, 2) = f(e, 2) + s
      f(e, 5) = f(e, 5) - s
      f(e, 3) = f(e, 3) + m1
      f(e, 6) = f(e, 6) + m2
    end do
  end subroutine stiffened_forces

  !> Adds the stiffness-proportional part of Rayleigh damping.
  pure subroutine damping_forces(n, il, ea, ei, rk, v, f)
    integer, intent(in) :: n
    real(wp), intent(in) :: il(n), ea(n), ei(n), rk(n), v(n, 6)
    real(wp), intent(inout) :: f(n, 6)
    real(wp) :: psi, p1, p2, m1, m2, s
    integer :: e
    do e = 1, n
      s = rk(e)*ea(e)*(v(e, 4) - v(e, 1))
      f(e, 1) = f(e, 1) - s
      f(e, 4) = f(e, 4) + s
      psi = (v(e, 5) - v(e, 2))*il(e)
      p1 = v(e, 3) - psi
      p2 = v(e, 6) - psi
      m1 = rk(e)*ei(e)*(4*p1 + 2*p2)
      m2 = rk(e)*ei(e)*(2*p1 + 4*p2)
      s = (m1 + m2)*il(e)
      f(e, 2) = f(e, 2) + s
      f(e, 5) = f(e, 5) - s
      f(e, 3) = f(e, 3) + m1
      f(e, 6) = f(e, 6) + m2
    end do
  end subroutine damping_forces

  !> Adds the consistent mass times x.
  subroutine element_mass_product(el, x, y)
    type(element_arrays), intent(inout) :: el
    real(wp), intent(in) :: x(0:)            !! (0:nf), entry 0 is zero
    real(wp), intent(inout) :: y(0:)         !! (0:nf)
    real(wp) :: unused
    call gather(el, x, el%a)
    el%q = 0.0_wp
    el%v = 0.0_wp
    call inertia_residual(el%ne, 0.0_wp, 0.0_wp, el%w4, el%w6, el%l, el%rm, el%q, el%v, el%a, el%f, unused)
    call scatter(el, el%f, y)
  end subroutine element_mass_product

  !> Sum over the elements of el%q^T m el%v + el%a^T m el%g, the pairs gathered before.
  pure function mass_pairs(el) result(x)
    type(element_arrays), intent(in) :: el
    real(wp) :: x                            !! [J]
    x = pair_sum(el%ne, el%w4, el%l, el%q, el%v, el%a, el%g)
  end function mass_pairs

  !> The sum of mass_pairs.
  pure function pair_sum(n, w4, l, q, v, a, g) result(x)
    integer, intent(in) :: n
    real(wp), intent(in) :: w4(n), l(n), q(n, 6), v(n, 6), a(n, 6), g(n, 6)
    real(wp) :: x, q3, q6, v3, v6, a3, a6, g3, g6
    integer :: e
    x = 0.0_wp
    do e = 1, n
      q3 = l(e)*q(e, 3)
      q6 = l(e)*q(e, 6)
      v3 = l(e)*v(e, 3)
      v6 = l(e)*v(e, 6)
      a3 = l(e)*a(e, 3)
      a6 = l(e)*a(e, 6)
      g3 = l(e)*g(e, 3)
      g6 = l(e)*g(e, 6)
      x = x + w4(e)*(q(e, 1)*(140*v(e, 1) + 70*v(e, 4)) + q(e, 4)*(70*v(e, 1) + 140*v(e, 4)) &
                     + q(e, 2)*(156*v(e, 2) + 22*v3 + 54*v(e, 5) - 13*v6) &
                     + q3*(22*v(e, 2) + 4*v3 + 13*v(e, 5) - 3*v6) &
                     + q(e, 5)*(54*v(e, 2) + 13*v3 + 156*v(e, 5) - 22*v6) &
                     - q6*(13*v(e, 2) + 3*v3 + 22*v(e, 5) - 4*v6) &
                     + a(e, 1)*(140*g(e, 1) + 70*g(e, 4)) + a(e, 4)*(70*g(e, 1) + 140*g(e, 4)) &
                     + a(e, 2)*(156*g(e, 2) + 22*g3 + 54*g(e, 5) - 13*g6) &
                     + a3*(22*g(e, 2) + 4*g3 + 13*g(e, 5) - 3*g6) &
                     + a(e, 5)*(54*g(e, 2) + 13*g3 + 156*g(e, 5) - 22*g6) &
                     - a6*(13*g(e, 2) + 3*g3 + 22*g(e, 5) - 4*g6))
    end do
  end function pair_sum
end module implicit_element
