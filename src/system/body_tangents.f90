!> Tangents of all bodies with what acts on their markers: what Newton's matrix and the linearisation have in common.
module body_tangents
  use kinds, only: wp
  use body_terms, only: body_equations, body_tangent
  use evaluation_results, only: evaluation
  use force_element, only: element_action
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: find_tangents, find_wrenches, frame_acceleration

contains

  !> The bodies' tangents a2 M + a1 C + a0 K at a state, frames of the last evaluation, with the wrenches on markers that turn with
  !> the bodies. How wrenches change with displacements and rates of markers is added by the caller.
  subroutine find_tangents(m, ev, wrench, action, a2, a1, a0, q, v, a, eq)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: wrench(:, :)             !! (3, markers) of `find_wrenches` [N, N m]
    type(element_action), intent(in) :: action(:)    !! (force elements)
    real(wp), intent(in) :: a2, a1, a0               !! [1/s2], [1/s], [-]
    real(wp), intent(in), contiguous :: q(:), v(:), a(:)   !! (nq) [m, rad], rates, accelerations
    type(body_equations), intent(inout) :: eq(:)     !! (nb)
    integer :: b, i, n
    do b = 1, size(eq)
      i = m%s%qo(b)
      n = i + 3 + eq(b)%n
      call body_tangent(eq(b), m%s%bodies(b), a2, a1, a0, q(i + 1:n), v(i + 1:n), a(i + 1:n), &
                        frame_acceleration(m, ev, b, a))
    end do
    if (abs(a0) > 0.0_wp) call turn_wrenches(m, ev, wrench, action, a0, eq)
  end subroutine find_tangents

  !> A^T (R'' - g) of a body, with the weight of the last residual [m/s2].
  pure function frame_acceleration(m, ev, b, a) result(x)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: b
    real(wp), intent(in) :: a(:)             !! (nq) accelerations [m/s2, rad/s2]
    real(wp) :: x(2), g(2)                   !! [m/s2]
    g = a(m%s%qo(b) + 1:m%s%qo(b) + 2) - ev%options%gravity
    x(1) = ev%frame%cos(b)*g(1) + ev%frame%sin(b)*g(2)
    x(2) = ev%frame%cos(b)*g(2) - ev%frame%sin(b)*g(1)
  end function frame_acceleration

  !> Residual force (body axes) and moment on every marker: multipliers' minus applied ones.
  subroutine find_wrenches(m, ev, lambda, action, wrench)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: lambda(:)                !! (rows) [N]
    type(element_action), intent(in) :: action(:)    !! (force elements)
    real(wp), intent(out) :: wrench(:, :)            !! (3, markers) [N, N m]
    integer :: i, k
    wrench = 0.0_wp
    do i = 1, m%s%rows
      call add(m%incidence%row_marker(1, i), lambda(i), ev%rows%na(1, i), ev%rows%na(2, i), ev%rows%sa(i))
      call add(m%incidence%row_marker(2, i), lambda(i), ev%rows%nb(1, i), ev%rows%nb(2, i), ev%rows%sb(i))
    end do
    do k = 1, size(m%incidence%with_carrier)
      i = m%incidence%with_carrier(k)
      call add(m%incidence%carrier(k), lambda(i), 0.0_wp, 0.0_wp, ev%rows%sc(i))
    end do
    do k = 1, size(m%s%forces)
      associate (f => m%s%forces(k)%item)
        call add(f%ia, -1.0_wp, action(k)%a(1), action(k)%a(2), action(k)%a(3))
        if (f%ib /= f%ia) call add(f%ib, -1.0_wp, action(k)%b(1), action(k)%b(2), action(k)%b(3))
      end associate
    end do
  contains
    !> Adds a factor times a wrench in global axes, by numbers: a step calls it for every row.
    subroutine add(marker, factor, fx, fy, moment)
      integer, intent(in) :: marker
      real(wp), intent(in) :: factor                 !! [N], or -1 [-]
      real(wp), intent(in) :: fx, fy, moment         !! [-, -, m], or [N, N, N m]
      integer :: b
      b = m%markers%body(marker)
      if (b == 0) return
      wrench(1, marker) = wrench(1, marker) + factor*(ev%frame%cos(b)*fx + ev%frame%sin(b)*fy)
      wrench(2, marker) = wrench(2, marker) + factor*(ev%frame%cos(b)*fy - ev%frame%sin(b)*fx)
      wrench(3, marker) = wrench(3, marker) + factor*moment
    end subroutine add
  end subroutine find_wrenches

  !> Residual wrenches on markers turn with the body: theta-theta, theta-f and f-theta terms. Forces that are fixed in the frame's
  !> axes are constant there: their part of the columns is taken out again.
  subroutine turn_wrenches(m, ev, wrench, action, a0, eq)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: wrench(:, :)             !! (3, markers) [N, N m]
    type(element_action), intent(in) :: action(:)    !! (force elements)
    real(wp), intent(in) :: a0                       !! factor of the stiffness [-]
    type(body_equations), intent(inout) :: eq(:)     !! (nb)
    real(wp) :: f(2)
    integer :: k, b
    do k = 1, size(m%s%markers)
      b = m%markers%body(k)
      if (b == 0) cycle
      f = a0*wrench(1:2, k)
      associate (t => eq(b), marker => m%s%markers(k))
        t%block(3, 3) = t%block(3, 3) - dot_product(ev%p%rho(:, k), f)
        if (t%n == 0) cycle
        call marker%add_elastic_forces([f(2), -f(1), 0.0_wp], t%column(1:t%n))
        call marker%add_elastic_forces([f(2), -f(1), 0.0_wp], t%row(1:t%n))
      end associate
    end do
    do k = 1, size(m%s%forces)
      if (.not. m%s%forces(k)%item%in_frame) cycle
      b = m%markers%body(m%s%forces(k)%item%ia)
      f = a0*ev%frame%to_body(b, action(k)%a(1:2))
      associate (t => eq(b), marker => m%s%forces(k)%item%ia)
        t%block(1:2, 3) = t%block(1:2, 3) + [f(2), -f(1)]
        t%block(3, 3) = t%block(3, 3) - dot_product(ev%p%rho(:, marker), f)
        if (t%n > 0) call m%s%markers(marker)%add_elastic_forces([f(2), -f(1), 0.0_wp], t%column(1:t%n))
      end associate
    end do
  end subroutine turn_wrenches
end module body_tangents
