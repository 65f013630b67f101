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
  use body_tangents, only: find_tangents, find_wrenches
  use body_terms, only: body_equations, set_up_terms
  use constraint, only: marker_stiffness
  use force_element, only: element_action
  use linear_bodies, only: add_tangent, add_turning
  use linear_matrices, only: linear_mechanism, count_segments
  use evaluation_results, only: evaluation, conditions_of
  use mechanism, only: mechanism_model
  use marker, only: turn
  use triplets, only: triplet_matrix
  implicit none (type, external)
  private
  public :: joint_rows_matrix, linearise, marker_jacobian, rate_jacobian

contains

  !> Linearises about the state of an evaluation, with these accelerations, multipliers and forces.
  subroutine linearise(m, ev, q, v, a, lambda, action, lin)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in), contiguous :: q(:), v(:), a(:)   !! (nq) the evaluated state [m, rad] and per second, accelerations
    real(wp), intent(in), contiguous :: lambda(:)    !! (rows) [N]
    type(element_action), intent(in) :: action(:)    !! (force elements)
    type(linear_mechanism), intent(out) :: lin
    type(body_equations), allocatable :: eq(:)
    real(wp) :: wrench(3, size(m%s%markers))         ! [N, N m]
    integer :: b
    lin%n = m%s%nq
    lin%rows = m%s%rows
    call count_segments(m, lin)
    call marker_terms(m, ev, v, lambda, action, lin)
    call constraint_rows_matrix(m, ev, size(m%s%constraints), lin%jacobian)
    call find_wrenches(m, ev, lambda, action, wrench)
    allocate (eq(size(m%s%bodies)))
    do b = 1, size(eq)
      call set_up_terms(eq(b), m%s%bodies(b))
    end do
    call add_bodies(1.0_wp, 0.0_wp, 0.0_wp, lin%mass)
    call add_bodies(0.0_wp, 1.0_wp, 0.0_wp, lin%damping)
    call add_bodies(0.0_wp, 0.0_wp, 1.0_wp, lin%stiffness)
    do b = 1, size(eq)
      call add_turning(m, ev, b, q, v, a, lin)
    end do
  contains
    !> Adds one of the matrices of all bodies.
    subroutine add_bodies(a2, a1, a0, matrix)
      real(wp), intent(in) :: a2, a1, a0             !! one of them 1 [-]
      type(triplet_matrix), intent(inout) :: matrix
      integer :: b
      call find_tangents(m, ev, wrench, action, a2, a1, a0, q, v, a, eq)
      do b = 1, size(eq)
        call add_tangent(eq(b), m%s%bodies(b), m%s%qo(b), a2, matrix)
      end do
    end subroutine add_bodies
  end subroutine linearise

  !> Displacement of a marker, global axes, and turn of its section from the body's unknowns: 3 x n matrix.
  subroutine marker_jacobian(m, ev, k, cols, jac)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: k                           !! marker of the scene
    integer, allocatable, intent(out) :: cols(:)       !! unknowns it depends on; none on the ground
    real(wp), allocatable, intent(out) :: jac(:, :)    !! (3, size(cols)) [-] or [m]
    integer :: b, i, j, c, n
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
      do j = 1, n
        jac(1:2, j) = ev%frame%to_global(b, jac(1:2, j))
      end do
    end associate
  end subroutine marker_jacobian

  !> Rows of Phi_q of joints and drives alone.
  subroutine joint_rows_matrix(m, ev, jacobian)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    type(triplet_matrix), intent(inout) :: jacobian    !! (rows, nq) [-], [m]
    call constraint_rows_matrix(m, ev, m%s%permanent, jacobian)
  end subroutine joint_rows_matrix

  !> Rows of Phi_q of the first constraints.
  subroutine constraint_rows_matrix(m, ev, last, jacobian)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: last                        !! of these constraints
    type(triplet_matrix), intent(inout) :: jacobian    !! (rows, nq) [-], [m]
    integer, allocatable :: cols(:)
    real(wp), allocatable :: jac(:, :)
    real(wp) :: w(3)
    integer :: k, i, side, marker, j
    do k = 1, last
      associate (c => m%s%constraints(k)%item)
        do side = 1, merge(3, 2, c%ic > 0)
          marker = merge(c%ic, merge(c%ia, c%ib, side == 1), side == 3)
          call marker_jacobian(m, ev, marker, cols, jac)
          do i = c%first, c%first + c%rows - 1
            w = merge([ev%rows%na(:, i), ev%rows%sa(i)], [ev%rows%nb(:, i), ev%rows%sb(i)], side == 1)
            if (side == 3) w = [0.0_wp, 0.0_wp, ev%rows%sc(i)]
            do j = 1, size(cols)
              call jacobian%add(i, cols(j), dot_product(w, jac(:, j)))
            end do
          end do
        end do
      end associate
    end do
  end subroutine constraint_rows_matrix

  !> Marker-level stiffness and damping of joints and force elements, with the segments of the elements' viscoelastic terms.
  subroutine marker_terms(m, ev, v, lambda, action, lin)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: v(:)               !! (nq) [m/s, rad/s]
    real(wp), intent(in) :: lambda(:)          !! (rows) [N]
    type(element_action), intent(in) :: action(:)   !! (force elements)
    type(linear_mechanism), intent(inout) :: lin
    type(marker_stiffness) :: t
    type(triplet_matrix) :: unused
    integer :: k, j, segment
    do k = 1, size(m%s%constraints)
      associate (c => m%s%constraints(k)%item)
        t%ia = c%ia
        t%ib = c%ib
        t%c = 0.0_wp
        call c%geometric(ev%p, lambda, t)
        call add_pair(m, ev, t, [t%ia, t%ib], v, lin%stiffness, lin%damping, lin%stiffness)
      end associate
    end do
    segment = findloc(lin%segments%element > 0, .true., 1) - 1
    do k = 1, size(m%s%forces)
      associate (f => m%s%forces(k)%item, with => conditions_of(m, ev, k))
        t%ia = f%ia
        t%ib = f%ib
        call f%tangent(ev%p, with, [1.0_wp, 1.0_wp], action(k)%force, t)
        call add_pair(m, ev, t, [t%ia, t%ib], v, lin%stiffness, lin%damping, lin%stiffness)
        do j = 1, merge(f%motions, 0, f%controller == 0)    ! loops of controllers are closed by `closed_loops`
          associate (by => [f%arguments(j)%item%ia, f%arguments(j)%item%ib])
            call f%argument_tangent(ev%p, conditions_of(m, ev, k, j), j, t)
            call add_pair(m, ev, t, by, v, lin%stiffness, lin%damping, lin%stiffness)
            t%k = 0.0_wp
            call add_pair(m, ev, t, by, v, unused, lin%loops, unused)
          end associate
        end do
        if (f%law%order() == 0) cycle
        segment = segment + 1
        call f%tangent(ev%p, with, [1.0_wp, 0.0_wp], 0.0_wp, t)
        call add_pair(m, ev, t, [t%ia, t%ib], v, lin%segments(segment)%stiffness, lin%damping, lin%segments(segment)%stiffness)
      end associate
    end do
  end subroutine marker_terms

  !> Adds J^T k J of a pair of markers on which forces act and a pair whose motion they follow; rates see J x' + J' x.
  subroutine add_pair(m, ev, t, by, v, stiffness, damping, rate_stiffness)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    type(marker_stiffness), intent(in) :: t
    integer, intent(in) :: by(2)               !! the second pair
    real(wp), intent(in) :: v(:)               !! (nq) [m/s, rad/s]
    type(triplet_matrix), intent(inout) :: stiffness, damping, rate_stiffness
    integer, allocatable :: rows(:), cols(:)
    real(wp), allocatable :: ji(:, :), jj(:, :)
    real(wp) :: k(3, 3), c(3, 3)               ! [N/m, N, N m], [N s/m, ...]
    integer :: side, other, pi, pj
    do side = 0, 1
      pi = merge(t%ia, t%ib, side == 0)
      do other = 0, 1
        pj = by(1 + other)
        k = t%k(3*side + 1:3*side + 3, 3*other + 1:3*other + 3)
        c = t%c(3*side + 1:3*side + 3, 3*other + 1:3*other + 3)
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

  !> How a marker's velocity depends on the displacements, J': theta' H J and the turn of the elastic rate.
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
    u = ev%p%v(:, marker) - v(i + 1:i + 2) - thetad*jac(1:2, 3)      ! jac(1:2, 3): H times the arm
    r(1:2, 3) = r(1:2, 3) + turn(u)
  end function rate_jacobian
end module linearisation
