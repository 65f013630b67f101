!> Linearisation of the constrained, GHM-augmented mechanism about an evaluated state. Unknowns of a body: eta = A^T dR (the
!> frame's displacement in its own axes), dtheta, elastic coordinates. In these axes the matrices of steadily turning
!> bodies are constant. With x all unknowns and z_rk in each segment's deformation space:
!>
!>   M x'' + C x' + K x + sum_r sum_k alpha_rk K_r (x - z_rk) + Phi^T dlambda = input,   Phi x = 0
!>   z_rk'' + 2 zeta omega z_rk' + omega^2 (z_rk - x) = 0
!>
!> K holds the stiffness at E_R, the geometric stiffness of stiffening, joints, springs and loads, and what the present
!> velocities and accelerations add (centrifugal, Euler); C holds damping and gyroscopic terms. Derivatives of the inertia
!> residuals of theory.md, sections 2 and 3, term by term.
module linearisation
  use kinds, only: wp
  use constraint, only: marker_stiffness
  use force_element, only: conditions, element_action
  use linear_bodies, only: linear_body
  use linear_matrices, only: linear_mechanism, count_segments
  use evaluation_results, only: evaluation, conditions_of
  use mechanism, only: mechanism_model
  use marker, only: turn
  use triplets, only: triplet_matrix
  implicit none (type, external)
  private
  public :: linearise, marker_jacobian

contains

  !> Linearises about the state of an evaluation, with these accelerations, multipliers and forces.
  subroutine linearise(m, ev, q, v, a, lambda, action, lin)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in), contiguous :: q(:), v(:), a(:)   !! (nq) the evaluated state [m, rad] and per second, accelerations
    real(wp), intent(in), contiguous :: lambda(:)    !! (rows) [N]
    type(element_action), intent(in) :: action(:)    !! (force elements)
    type(linear_mechanism), intent(out) :: lin
    real(wp), allocatable :: wrench(:, :)   !! (3, markers) [N, N m]
    integer :: b
    lin%n = m%s%nq
    lin%rows = m%s%rows
    call count_segments(m, lin)
    allocate (wrench(3, size(m%s%markers)), source=0.0_wp)
    call marker_terms(m, ev, v, lambda, action, lin, wrench)
    call constraint_rows_matrix(m, ev, lin)
    do b = 1, size(m%s%bodies)
      call linear_body(m, ev, b, q, v, a, lin)
    end do
    call turning_terms(m, ev, wrench, lin)
  end subroutine linearise

  !> Displacement of a marker in its body's axes (and its section's angle) from the body's unknowns: 3 x n matrix.
  subroutine marker_jacobian(m, ev, k, cols, jac)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: k                           !! marker of the scene
    integer, allocatable, intent(out) :: cols(:)       !! unknowns it depends on; none on the ground
    real(wp), allocatable, intent(out) :: jac(:, :)    !! (3, size(cols)) [-] or [m]
    integer :: b, i, c, n
    b = m%s%markers(k)%body
    if (b == 0) then
      allocate (cols(0), jac(3, 0))
      return
    end if
    i = m%s%qo(b)
    associate (marker => m%s%markers(k))
      n = 3 + count(marker%dof > 0)
      if (allocated(marker%psi)) n = 3 + size(marker%psi, 2)
      allocate (cols(n), source=0)
      allocate (jac(3, n), source=0.0_wp)
      cols(1:3) = [i + 1, i + 2, i + 3]
      jac(1, 1) = 1.0_wp
      jac(2, 2) = 1.0_wp
      jac(1:2, 3) = turn(ev%p%rho(:, k))
      jac(3, 3) = 1.0_wp
      if (allocated(marker%psi)) then
        cols(4:) = [(i + 3 + c, c=1, n - 3)]
        jac(:, 4:) = marker%psi
      else
        n = 3
        do c = 1, 3
          if (marker%dof(c) == 0) cycle
          n = n + 1
          cols(n) = i + 3 + marker%dof(c)
          jac(c, n) = 1.0_wp
        end do
      end if
    end associate
  end subroutine marker_jacobian

  !> Rows of Phi_q.
  subroutine constraint_rows_matrix(m, ev, lin)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    type(linear_mechanism), intent(inout) :: lin
    integer, allocatable :: cols(:)
    real(wp), allocatable :: jac(:, :)
    real(wp) :: w(3), n(2)
    integer :: k, i, side, marker, j
    do k = 1, size(m%s%constraints)
      associate (c => m%s%constraints(k)%item)
        do side = 1, 2
          marker = merge(c%ia, c%ib, side == 1)
          call marker_jacobian(m, ev, marker, cols, jac)
          do i = c%first, c%first + c%rows - 1
            n = merge(ev%rows%na(:, i), ev%rows%nb(:, i), side == 1)
            w = [to_body(m, ev, marker, n), merge(ev%rows%sa(i), ev%rows%sb(i), side == 1)]
            do j = 1, size(cols)
              call lin%jacobian%add(i, cols(j), dot_product(w, jac(:, j)))
            end do
          end do
        end do
      end associate
    end do
  end subroutine constraint_rows_matrix

  !> A global vector in the axes of a marker's body.
  pure function to_body(m, ev, marker, x) result(y)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: marker
    real(wp), intent(in) :: x(2)            !! [any]
    real(wp) :: y(2)
    integer :: b
    b = m%s%markers(marker)%body
    y = x
    if (b > 0) y = [ev%frame%cos(b)*x(1) + ev%frame%sin(b)*x(2), ev%frame%cos(b)*x(2) - ev%frame%sin(b)*x(1)]
  end function to_body

  !> Joints and force elements: marker-level stiffness and damping, and the residual wrench on every marker.
  subroutine marker_terms(m, ev, v, lambda, action, lin, wrench)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: v(:)               !! (nq) [m/s, rad/s]
    real(wp), intent(in) :: lambda(:)          !! (rows) [N]
    type(element_action), intent(in) :: action(:)   !! (force elements)
    type(linear_mechanism), intent(inout) :: lin
    real(wp), intent(inout) :: wrench(:, :)    !! (3, markers) residual force (body axes) and moment [N, N m]
    type(marker_stiffness) :: t
    integer :: k, i
    do k = 1, size(m%s%constraints)
      associate (c => m%s%constraints(k)%item)
        t%ia = c%ia
        t%ib = c%ib
        t%c = 0.0_wp
        call c%geometric(ev%p, lambda, t)
        call add_pair(m, ev, t, v, lin%stiffness, lin%damping, lin%stiffness)
        do i = c%first, c%first + c%rows - 1
          call add_wrench(m, ev, c%ia, ev%rows%na(:, i)*lambda(i), ev%rows%sa(i)*lambda(i), wrench)
          call add_wrench(m, ev, c%ib, ev%rows%nb(:, i)*lambda(i), ev%rows%sb(i)*lambda(i), wrench)
        end do
      end associate
    end do
    call element_terms(m, ev, v, action, lin, wrench)
  end subroutine marker_terms

  !> Adds a force (global) and a moment to a marker's residual wrench.
  pure subroutine add_wrench(m, ev, marker, force, moment, wrench)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: marker
    real(wp), intent(in) :: force(2), moment !! [N], [N m]
    real(wp), intent(inout) :: wrench(:, :) !! (3, markers) [N, N m]
    wrench(1:2, marker) = wrench(1:2, marker) + to_body(m, ev, marker, force)
    wrench(3, marker) = wrench(3, marker) + moment
  end subroutine add_wrench

  !> Force elements: their tangents, with the segments of their viscoelastic terms, and their wrenches. Forces that keep their
  !> direction in the axes of a body turn with it.
  subroutine element_terms(m, ev, v, action, lin, wrench)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: v(:)               !! (nq) [m/s, rad/s]
    type(element_action), intent(in) :: action(:)   !! (force elements)
    type(linear_mechanism), intent(inout) :: lin
    real(wp), intent(inout) :: wrench(:, :)    !! (3, markers) [N, N m]
    type(marker_stiffness) :: t
    type(conditions) :: with
    integer, allocatable :: cols(:)
    real(wp), allocatable :: jac(:, :)
    integer :: k, j, segment
    segment = findloc(lin%segments%element > 0, .true., 1) - 1
    do k = 1, size(m%s%forces)
      associate (f => m%s%forces(k)%item, x => action(k))
        with = conditions_of(m, ev, k)
        t%ia = f%ia
        t%ib = f%ib
        call f%tangent(ev%p, with, [1.0_wp, 1.0_wp], x%force, t)
        call add_pair(m, ev, t, v, lin%stiffness, lin%damping, lin%stiffness)
        call add_wrench(m, ev, f%ia, -x%a(1:2), -x%a(3), wrench)
        if (f%ib /= f%ia) call add_wrench(m, ev, f%ib, -x%b(1:2), -x%b(3), wrench)
        if (f%in_frame) then
          call marker_jacobian(m, ev, f%ia, cols, jac)
          do j = 1, size(cols)
            call lin%stiffness%add(cols(j), cols(3), -dot_product(jac(1:2, j), turn(to_body(m, ev, f%ia, x%a(1:2)))))
          end do
        end if
        if (f%law%order() == 0) cycle
        segment = segment + 1
        call f%tangent(ev%p, with, [1.0_wp, 0.0_wp], 0.0_wp, t)
        call add_pair(m, ev, t, v, lin%segments(segment)%stiffness, lin%damping, lin%segments(segment)%stiffness)
      end associate
    end do
  end subroutine element_terms

  !> Adds J^T k J of a pair of markers, with k and c given in global axes; rates see J x' + (J' + theta' H J) x.
  subroutine add_pair(m, ev, t, v, stiffness, damping, rate_stiffness)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    type(marker_stiffness), intent(in) :: t
    real(wp), intent(in) :: v(:)               !! (nq) [m/s, rad/s]
    type(triplet_matrix), intent(inout) :: stiffness, damping, rate_stiffness
    integer, allocatable :: rows(:), cols(:)
    real(wp), allocatable :: ji(:, :), jj(:, :)
    real(wp) :: k(3, 3), c(3, 3)               ! [N/m, N, N m], [N s/m, ...]
    integer :: side, other, pi, pj
    do side = 0, 1
      pi = merge(t%ia, t%ib, side == 0)
      do other = 0, 1
        pj = merge(t%ia, t%ib, other == 0)
        k = in_body_axes(m, ev, pi, pj, t%k(3*side + 1:3*side + 3, 3*other + 1:3*other + 3))
        c = in_body_axes(m, ev, pi, pj, t%c(3*side + 1:3*side + 3, 3*other + 1:3*other + 3))
        call marker_jacobian(m, ev, pi, rows, ji)
        call marker_jacobian(m, ev, pj, cols, jj)
        if (size(rows) == 0 .or. size(cols) == 0) cycle
        if (any(abs(k) > 0.0_wp)) call stiffness%add_block(rows, cols, matmul(transpose(ji), matmul(k, jj)))
        if (.not. any(abs(c) > 0.0_wp)) cycle
        call damping%add_block(rows, cols, matmul(transpose(ji), matmul(c, jj)))
        call rate_stiffness%add_block(rows, cols, matmul(transpose(ji), matmul(c, rate_jacobian(m, ev, pj, v, jj))))
      end do
    end do
  end subroutine add_pair

  !> How a marker's velocity (body axes) depends on the displacements: theta' H J and the turn of the elastic rate.
  function rate_jacobian(m, ev, marker, v, jac) result(r)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: marker
    real(wp), intent(in) :: v(:), jac(:, :) !! (nq) [m/s, rad/s]; of `marker_jacobian` [-, m]
    real(wp) :: r(3, size(jac, 2)), thetad, u(2)
    integer :: b, j, i
    b = m%s%markers(marker)%body
    i = m%s%qo(b)
    thetad = v(i + 3)
    do j = 1, size(jac, 2)
      r(1:2, j) = thetad*turn(jac(1:2, j))
      r(3, j) = 0.0_wp
    end do
    u = to_body(m, ev, marker, ev%p%v(:, marker) - v(i + 1:i + 2)) - thetad*turn(ev%p%rho(:, marker))
    r(1:2, 3) = r(1:2, 3) + turn(u)
  end function rate_jacobian

  !> A 3 x 3 marker block from global axes into those of the two markers' bodies.
  pure function in_body_axes(m, ev, pi, pj, k) result(x)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: pi, pj
    real(wp), intent(in) :: k(3, 3)         !! [N/m, N, N m]
    real(wp) :: x(3, 3)
    integer :: j
    do j = 1, 3
      x(1:2, j) = to_body(m, ev, pi, k(1:2, j))
      x(3, j) = k(3, j)
    end do
    do j = 1, 3
      x(j, 1:2) = to_body(m, ev, pj, x(j, 1:2))
    end do
  end function in_body_axes

  !> Residual wrenches on markers turn with the body that carries them: theta-theta, theta-f and f-theta terms.
  subroutine turning_terms(m, ev, wrench, lin)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: wrench(:, :)    !! (3, markers) [N, N m]
    type(linear_mechanism), intent(inout) :: lin
    integer, allocatable :: cols(:)
    real(wp), allocatable :: jac(:, :)
    real(wp) :: hf(2), x
    integer :: k, j
    do k = 1, size(m%s%markers)
      if (m%s%markers(k)%body == 0) cycle
      call marker_jacobian(m, ev, k, cols, jac)
      call lin%stiffness%add(cols(3), cols(3), -dot_product(ev%p%rho(:, k), wrench(1:2, k)))
      hf = -turn(wrench(1:2, k))            ! H^T F
      do j = 4, size(cols)
        x = dot_product(hf, jac(1:2, j))
        call lin%stiffness%add(cols(3), cols(j), x)
        call lin%stiffness%add(cols(j), cols(3), x)
      end do
    end do
  end subroutine turning_terms

end module linearisation
