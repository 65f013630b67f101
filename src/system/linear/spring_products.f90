!> Springs in linear algebra, about the present markers: how small motions stretch a spring, and the generalised forces of a
!> spring that pulls. Unknowns as the coordinates, the frames' in body axes.
module spring_products
  use kinds, only: wp
  use constraint, only: marker_stiffness
  use evaluation_results, only: conditions_of, evaluation
  use measure, only: measured
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: spring_square, spring_pull, argument_pull, argument_motions

contains

  !> Square of a spring's change of deformation; with factors for its ends (`spring_directions`) the bound of it that holds for
  !> all directions.
  pure real(wp) function spring_square(m, ev, k, ends, x) result(square)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: k                   !! spring
    real(wp), intent(in) :: ends(2)            !! factors of its ends, negative: its present direction [-]
    real(wp), intent(in) :: x(:)               !! (n) displacements [m], [rad]
    real(wp) :: a(3), b(3)
    call end_displacements(m, ev, k, x, a, b)
    if (all(ends >= 0.0_wp)) then
      square = ends(1)*sum(a(1:2)**2) + ends(2)*sum(b(1:2)**2)
    else
      square = sum(stretch(m, ev, k, a - b)**2)
    end if
  end function spring_square

  !> Adds the forces of a spring of the given stiffness, or of the bound of it that holds for all directions.
  pure subroutine spring_pull(m, ev, k, stiffness, ends, x, y)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: k                   !! spring
    real(wp), intent(in) :: stiffness          !! or damping [N/m, N m/rad; N s/m, N m s/rad]
    real(wp), intent(in) :: ends(2)            !! factors of its ends, negative: its present direction [-]
    real(wp), intent(in) :: x(:)               !! (n) displacements [m], [rad]
    real(wp), intent(inout) :: y(:)            !! (n) forces [N], [N m]
    real(wp) :: a(3), b(3)
    if (.not. abs(stiffness) > 0.0_wp) return
    call end_displacements(m, ev, k, x, a, b)
    if (all(ends >= 0.0_wp)) then
      a = [ends(1)*a(1:2), 0.0_wp]
      b = [-ends(2)*b(1:2), 0.0_wp]
    else
      a = stretch(m, ev, k, a - b)
      b = a
    end if
    if (any(abs(a) > 0.0_wp)) call add_force(m, ev, m%s%forces(k)%item%ia, stiffness*a, y)
    if (any(abs(b) > 0.0_wp)) call add_force(m, ev, m%s%forces(k)%item%ib, -stiffness*b, y)
  end subroutine spring_pull

  !> Adds the forces with which an element that follows a motion answers small ones and their rates.
  pure subroutine argument_pull(m, ev, k, j, x, stiffness, damping)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: k                   !! force element with arguments
    integer, intent(in) :: j                   !! which one
    real(wp), intent(in) :: x(:)               !! (n) displacements [m], [rad], or their rates
    real(wp), intent(inout) :: stiffness(:), damping(:)   !! (n) forces [N], [N m]
    type(marker_stiffness) :: t
    real(wp) :: u(6), w(6)
    associate (f => m%s%forces(k)%item)
      call f%argument_tangent(ev%p, conditions_of(m, ev, k, j), j, t)
      u = [marker_displacement(m, ev, f%arguments(j)%item%ia, x), marker_displacement(m, ev, f%arguments(j)%item%ib, x)]
      w = matmul(t%k, u)
      call add_force(m, ev, f%ia, w(1:3), stiffness)
      w = matmul(t%c, u)
      call add_force(m, ev, f%ia, w(1:3), damping)
    end associate
  end subroutine argument_pull

  !> Generalised directions in which such a force acts, and of the motion that it follows.
  pure subroutine argument_motions(m, ev, k, j, acts, sees)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: k                   !! force element with arguments
    integer, intent(in) :: j                   !! which one
    real(wp), intent(out) :: acts(:), sees(:)  !! (n) [N], [N m]
    real(wp) :: w(6), by_place(6), by_rate(6)
    acts = 0.0_wp
    sees = 0.0_wp
    associate (f => m%s%forces(k)%item, by => m%s%forces(k)%item%arguments(j)%item)
      w = f%slope(ev%p, conditions_of(m, ev, k, j))
      call by%gradient(ev%p, by_place, by_rate)
      if (by%rate) by_place = by_rate
      call add_force(m, ev, f%ia, w(1:3), acts)
      call add_force(m, ev, by%ia, by_place(1:3), sees)
      call add_force(m, ev, by%ib, by_place(4:6), sees)
    end associate
  end subroutine argument_motions

  !> Displacements and turns of a spring's ends, global axes.
  pure subroutine end_displacements(m, ev, k, x, a, b)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: k                   !! spring
    real(wp), intent(in) :: x(:)               !! (n) [m], [rad]
    real(wp), intent(out) :: a(3), b(3)        !! [m], [m], [rad]
    a = marker_displacement(m, ev, m%s%forces(k)%item%ia, x)
    b = marker_displacement(m, ev, m%s%forces(k)%item%ib, x)
  end subroutine end_displacements

  !> The part of the ends' relative motion that deforms a spring: along it; of a bush in any direction; of a torsional one the turn.
  pure function stretch(m, ev, k, d) result(s)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: k                   !! spring
    real(wp), intent(in) :: d(3)               !! of a relative to b [m], [m], [rad]
    type(measured) :: now
    real(wp) :: s(3)
    associate (f => m%s%forces(k)%item)
      if (f%in_all_directions()) then
        s = [d(1:2), 0.0_wp]
      else
        now = f%deformation(ev%p)
        s = dot_product(now%g(1:3), d)*now%g(1:3)
      end if
    end associate
  end function stretch

  !> Displacement of a marker, global, and turn of its section, from the unknowns.
  pure function marker_displacement(m, ev, k, x) result(d)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: k                   !! marker
    real(wp), intent(in) :: x(:)               !! (n) [m], [rad]
    real(wp) :: d(3), u(3)                     !! [m], [m], [rad]
    integer :: b, i
    d = 0.0_wp
    b = m%s%markers(k)%body
    if (b == 0) return
    i = m%s%qo(b)
    u = m%s%markers(k)%displacement(ev%p%rho(:, k), x(i + 1:i + 3), x(i + 4:i + 3 + m%s%bodies(b)%nf))
    d = [ev%frame%to_global(b, u(1:2)), u(3)]
  end function marker_displacement

  !> Adds a wrench (global force, moment) on a marker as generalised forces.
  pure subroutine add_force(m, ev, k, f, y)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: k                   !! marker
    real(wp), intent(in) :: f(3)               !! [N], [N m]
    real(wp), intent(inout) :: y(:)            !! (n) [N], [N m]
    real(wp) :: w(3)
    integer :: b, i
    b = m%s%markers(k)%body
    if (b == 0) return
    i = m%s%qo(b)
    w = [ev%frame%to_body(b, f(1:2)), f(3)]
    call m%s%markers(k)%add_wrench(ev%p%rho(:, k), w, y(i + 1:i + 3), y(i + 4:i + 3 + m%s%bodies(b)%nf))
  end subroutine add_force
end module spring_products
