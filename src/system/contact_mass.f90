!> The mass that a stop meets, and how long a contact with it lasts.
module contact_mass
  use kinds, only: wp, pi
  use evaluation_results, only: evaluation, conditions_of
  use force_element, only: conditions
  use frame_axes, only: add_force
  use mass_solve, only: solve_mass
  use mechanism, only: mechanism_model
  use stops, only: stop_contact, stop_model
  use text, only: in_quotes
  implicit none (type, external)
  private
  public :: mass_at, time_of_contact, drives_against

  real(wp), parameter, public :: no_motion = 1.0e-10_wp   !! acceleration by a unit force that is zero, over that without joints [-]

contains

  !> m of 1/m = J M^-1 J^T, J the gradient of the penetration, under the joints, by the factors of the last evaluation; huge where
  !> nothing can move. [kg] or [kg m2]
  real(wp) function mass_at(m, ev, k) result(mass)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    integer, intent(in) :: k                   !! force element
    real(wp) :: f(m%s%nq), u(m%s%nq)           ! [-], [m]; [1/kg], [1/(kg m)]
    type(stop_contact) :: c
    real(wp) :: alone                          ! the same with joints released [1/kg] or [1/(kg m2)]
    mass = huge(1.0_wp)
    f = 0.0_wp
    select type (stop => m%s%forces(k)%item)
    class is (stop_model)
      call stop%contact(ev%p, conditions_of(m, ev, k), c)
      call add_force(m, ev, stop%ia, c%g(1:3), f)
      call add_force(m, ev, stop%ib, c%g(4:6), f)
    end select
    call solve_mass(m, ev, .false., f, u)
    alone = dot_product(f, u)
    call solve_mass(m, ev, .true., f, u)
    if (dot_product(f, u) > no_motion*alone) mass = 1/dot_product(f, u)
  end function mass_at

  !> Names of the drives that react to the force of a stop, in quotes, after `mass_at` found that it moves nothing; empty: none.
  function drives_against(m, ev) result(names)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    character(:), allocatable :: names
    integer :: k
    associate (c => m%s%constraints, change => abs(ev%lambda_change))
      names = in_quotes(pack([(c(k)%item%name, k=m%s%joints + 1, m%s%permanent)], &
                             [(change(c(k)%item%first) > no_motion*maxval(change), k=m%s%joints + 1, m%s%permanent)]))
    end associate
  end function drives_against

  !> How long a contact lasts that has just begun, or in which the stop is pressed at rest [s].
  pure real(wp) function time_of_contact(m, ev, k, mass) result(time)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: k                   !! force element
    real(wp), intent(in) :: mass               !! [kg] or [kg m2]
    type(conditions) :: with
    type(stop_contact) :: c
    time = huge(1.0_wp)
    if (mass >= huge(1.0_wp)) return
    with = conditions_of(m, ev, k)
    select type (stop => m%s%forces(k)%item)
    class is (stop_model)
      call stop%contact(ev%p, with, c)
      time = stop%impact_time(mass, with%event_value)
      if (c%depth > 0.0_wp) time = min(time, pi*sqrt(mass/stop%stiffness_at(c%depth)))     ! half a period of small vibrations there
    end select
  end function time_of_contact
end module contact_mass
