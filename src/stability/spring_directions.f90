!> Springs turn with the bodies that they join. A bound that holds wherever bodies come to in a run must not depend on the
!> direction in which a spring pulls, seen from either body: with u_a and u_b the displacements of its ends,
!>
!>   (e_a.u_a - e_b.u_b)^2 <= (1 + s) |u_a|^2 + (1 + 1/s) |u_b|^2   for all unit vectors e_a, e_b and every s > 0,
!>
!> so that its stiffness k is at most that of two springs that act in all directions, (1 + s) k from a and
!> (1 + 1/s) k from b to the ground. With s = rho_b/rho_a, the ratio of the ends' accelerations by a unit force (largest
!> eigenvalues of J M^-1 J^T), this is exact for one spring between two bodies: k (rho_a + rho_b). Its tension F adds
!> F/length <= k across it, which is covered, too, and |F| |lever| against turns of a body about its mass centre.
module spring_directions
  use kinds, only: wp
  use mass_solve, only: solve_body
  use evaluation_results, only: evaluation
  use measure, only: measured
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: bound_directions, turning_stiffness

  real(wp), parameter :: parallel = 1.0e-6_wp    !! sine of the angle between a guide and a spring along it [-]

contains

  !> The factors 1 + s and 1 + 1/s of every spring's ends; negative where the spring cannot turn and its present direction
  !> stays.
  subroutine bound_directions(m, ev, ends)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev    !! evaluated
    real(wp), intent(out) :: ends(:, :)          !! (2, force elements) [-]
    real(wp) :: ra, rb
    integer :: k
    ends = -1.0_wp
    do k = 1, size(m%s%forces)
      associate (sp => m%s%forces(k)%item)
        if (.not. sp%along_line) cycle
        if (is_guided(m, ev, k)) cycle
        ends(:, k) = 0.0_wp
        ra = inverse_mass(m, ev, sp%ia)
        rb = inverse_mass(m, ev, sp%ib)
        if (ra > 0.0_wp) ends(1, k) = 1 + rb/ra
        if (rb > 0.0_wp) ends(2, k) = 1 + ra/rb
      end associate
    end do
  end subroutine bound_directions

  !> Bound of the stiffness that the present forces of linear springs add against turns of every body.
  pure function turning_stiffness(m, ev) result(stiffness)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev       !! evaluated
    real(wp) :: stiffness(size(m%s%bodies))      !! [N m/rad]
    integer :: k, i, b, marker
    stiffness = 0.0_wp
    do k = 1, size(m%s%forces)
      if (.not. m%s%forces(k)%item%along_line) cycle
      do i = 1, 2
        marker = merge(m%s%forces(k)%item%ia, m%s%forces(k)%item%ib, i == 1)
        b = m%s%markers(marker)%body
        if (b == 0) cycle
        stiffness(b) = stiffness(b) + abs(ev%action(k)%force)* &
                       norm2(ev%p%rho(:, marker) - ev%frame%first_moment(:, b)/m%s%bodies(b)%mass)
      end do
    end do
  end function turning_stiffness

  !> Whether a spring's direction is fixed in both its bodies: welds, or guides along the spring, join them.
  pure logical function is_guided(m, ev, k)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: k                     !! spring
    type(measured) :: now
    integer :: group(0:size(m%s%bodies)), j, a, b
    logical :: welded
    group = [(j, j=0, size(m%s%bodies))]
    now = m%s%forces(k)%item%deformation(ev%p)
    do j = 1, m%s%joints
      associate (c => m%s%constraints(j)%item)
        a = group(m%s%markers(c%ia)%body)
        b = group(m%s%markers(c%ib)%body)
        welded = c%rows == 3
        associate (last => c%first + c%rows - 1)
          if (norm2(ev%rows%na(:, last)) > 0.0_wp .or. c%rows == 1) cycle   ! the sections' angle is free
        end associate
        if (welded .or. abs(dot_product(ev%rows%na(:, c%first), now%g(1:2))) <= parallel) where (group == a) group = b
      end associate
    end do
    is_guided = group(m%s%markers(m%s%forces(k)%item%ia)%body) == group(m%s%markers(m%s%forces(k)%item%ib)%body)
  end function is_guided

  !> The largest acceleration of a marker by a unit force: largest eigenvalue of J M^-1 J^T.
  real(wp) function inverse_mass(m, ev, k) result(rho)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    integer, intent(in) :: k                     !! marker
    real(wp), allocatable :: f(:), u(:)
    real(wp) :: c(2, 2), w(3)
    integer :: b, j
    rho = 0.0_wp
    b = m%s%markers(k)%body
    if (b == 0) return
    associate (p => m%s%markers(k), n => m%s%bodies(b)%nf)
      allocate (f(3 + n), u(3 + n))
      do j = 1, 2
        f = 0.0_wp
        w = 0.0_wp
        w(j) = 1.0_wp
        call p%add_wrench(ev%p%rho(:, k), w, f(1:3), f(4:))
        call solve_body(m, ev, b, f, u)
        w = p%displacement(ev%p%rho(:, k), u(1:3), u(4:))
        c(:, j) = w(1:2)
      end do
    end associate
    rho = 0.5_wp*(c(1, 1) + c(2, 2)) + hypot(0.5_wp*(c(1, 1) - c(2, 2)), 0.5_wp*(c(1, 2) + c(2, 1)))   ! [1/kg]
  end function inverse_mass
end module spring_directions
