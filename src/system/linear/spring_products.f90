!> Springs in linear algebra, about the present markers: how small motions stretch a spring, and the generalised forces of a
!> spring that pulls. Unknowns as the coordinates, the frames' in body axes.
module spring_products
  use kinds, only: wp
  use constraint, only: marker_stiffness
  use evaluation_results, only: conditions_of, evaluation
  use frame_axes, only: add_force, displacement_at
  use measure, only: measured
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: spring_square, spring_pull, argument_pull, argument_motions

contains

  !> Square of a spring's change of deformation; with factors for its ends (`safe_bound`) the bound of it that holds for
  !> all directions.
  pure real(wp) function spring_square(m, ev, k, ends, x) result(square)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: k                   !! spring
    real(wp), intent(in) :: ends(2)            !! factors of its ends, negative: its present direction [-]
    real(wp), intent(in) :: x(:)               !! (n) displacements [m], [rad]
    real(wp) :: u(6), w(6)
    call pull(m, ev, k, ends, x, u, w)
    square = dot_product(u, w)
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
    real(wp) :: u(6), w(6)
    if (.not. abs(stiffness) > 0.0_wp) return
    call pull(m, ev, k, ends, x, u, w)
    if (.not. any(abs(w) > 0.0_wp)) return
    call add_force(m, ev, m%s%forces(k)%item%ia, stiffness*w(1:3), y)
    call add_force(m, ev, m%s%forces(k)%item%ib, stiffness*w(4:6), y)
  end subroutine spring_pull

  !> Displacements and turns of a spring's ends, global axes, and the forces of unit stiffness against them: along the spring; of a
  !> bush in any direction; of a torsional one against the turn; with factors of the ends by each end for itself.
  pure subroutine pull(m, ev, k, ends, x, u, w)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: k                   !! spring
    real(wp), intent(in) :: ends(2)            !! as in `spring_pull` [-]
    real(wp), intent(in) :: x(:)               !! (n) displacements [m], [rad]
    real(wp), intent(out) :: u(6), w(6)        !! of a, then of b [m], [m], [rad]
    type(measured) :: now
    real(wp) :: d(3)
    associate (f => m%s%forces(k)%item)
      u = [displacement_at(m, ev, f%ia, x), displacement_at(m, ev, f%ib, x)]
      d = u(1:3) - u(4:6)
      if (all(ends >= 0.0_wp)) then
        w = [ends(1)*u(1:2), 0.0_wp, ends(2)*u(4:5), 0.0_wp]
      else if (f%in_all_directions()) then
        w = [d(1:2), 0.0_wp, -d(1:2), 0.0_wp]
      else
        now = f%deformation(ev%p)
        d = dot_product(now%g(1:3), d)*now%g(1:3)
        w = [d, -d]
      end if
    end associate
  end subroutine pull

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
      u = [displacement_at(m, ev, f%arguments(j)%item%ia, x), displacement_at(m, ev, f%arguments(j)%item%ib, x)]
      w = matmul(t%k, u)
      call add_force(m, ev, f%ia, w(1:3), stiffness)
      w = matmul(t%c, u)
      call add_force(m, ev, f%ia, w(1:3), damping)
    end associate
  end subroutine argument_pull

  !> Generalised directions in which such a force acts, and of the motion that it follows, by places and by rates.
  pure subroutine argument_motions(m, ev, k, j, acts, places, rates)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: k                   !! force element with arguments
    integer, intent(in) :: j                   !! which one
    real(wp), intent(out) :: acts(:), places(:), rates(:)   !! (n) [N], [N m]
    real(wp) :: w(6), by_place(6), by_rate(6)
    acts = 0.0_wp
    places = 0.0_wp
    rates = 0.0_wp
    associate (f => m%s%forces(k)%item, by => m%s%forces(k)%item%arguments(j)%item)
      w = f%slope(ev%p, conditions_of(m, ev, k, j))
      call by%gradient(ev%p, by_place, by_rate)
      call add_force(m, ev, f%ia, w(1:3), acts)
      call add_force(m, ev, by%ia, by_place(1:3), places)
      call add_force(m, ev, by%ib, by_place(4:6), places)
      call add_force(m, ev, by%ia, by_rate(1:3), rates)
      call add_force(m, ev, by%ib, by_rate(4:6), rates)
    end associate
  end subroutine argument_motions
end module spring_products
