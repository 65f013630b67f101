!> Which bodies nothing holds: those that move without any stiffness. Joints, drives, elasticity and springs hold bodies wherever
!> they are; weight, loads and springs under tension hold them where these change with the position.
module free_bodies
  use kinds, only: wp
  use dynamic_stiffness, only: stiffness_system
  use equilibrium, only: equations, equilibrium_report, move
  use evaluation_settings, only: evaluation_options
  use force_element, only: bilateral, element_action
  use linear_matrices, only: linear_mechanism
  use linear_state, only: evaluate_state, linear_system_with
  use natural_modes, only: highest_ratio, rounding_level, small_shift
  use position_closing, only: largest_motion
  use prescribed_motion, only: motion_units, weigh
  use scene_run, only: run_state
  implicit none (type, external)
  private
  public :: loose_bodies, free_bodies_under

  real(wp), parameter :: aside = 0.01_wp             !! motion to a position at which no slope vanishes by chance [-], [rad]
  real(wp), parameter :: takes_part = 1.0e-6_wp      !! energy of a body in a free motion worth naming, over the largest [-]
  integer, parameter :: most_shifts = 4              !! of a search for a free motion

contains

  !> The bodies that joints, drives, elasticity, springs, and stops as they are, leave free; loads may hold them.
  function loose_bodies(run) result(loose)
    type(run_state), intent(inout) :: run
    logical, allocatable :: loose(:)                 !! (bodies)
    type(stiffness_system) :: ds
    real(wp), allocatable :: x(:)                    ! [m, rad]
    call unloaded_stiffness(run, .false., ds)
    call find_free(run, ds, x, loose)
  end function loose_bodies

  !> The bodies that loads do not hold either. Their free motion has no stiffness of any kind a little aside: where a body stands
  !> it may have none by chance, as a level pendulum. The reactions that bring loads nearest to balance, by weights without a
  !> meaning, count, not those of bodies let go, which fall and need none.
  function free_bodies_under(run, options, both_ways) result(free)
    type(run_state), intent(inout) :: run
    type(evaluation_options), intent(in) :: options  !! the loads that act
    logical, intent(in) :: both_ways                 !! stops act both ways, not as they are
    logical, allocatable :: free(:)                  !! (bodies)
    type(stiffness_system) :: ds
    type(equilibrium_report) :: unused
    complex(wp), allocatable :: r(:)
    real(wp), allocatable :: start(:), x(:)          ! [m, rad]
    real(wp), allocatable :: lambda(:)               ! (rows) [N]
    call unloaded_stiffness(run, both_ways, ds)
    call find_free(run, ds, x, free)
    if (.not. any(free)) return
    start = run%y
    run%y(ds%n + 1:2*ds%n) = 0.0_wp                  ! centrifugal forces of bodies that nothing drives hold nothing
    call move(run, aside/max(aside, largest_motion(run%sys%m, x, 1.0_wp))*x)
    call equations(run, options, ds, r, unused)
    call weigh(run, motion_units(run), 1.0_wp, ds)
    r(ds%n + 1:) = 0.0_wp
    call ds%solver%solve(r, .false.)
    lambda = run%sys%ev%lambda
    lambda(ds%active) = lambda(ds%active) + real(r(ds%n + 1:), wp)
    call equations(run, options, ds, r, unused, lambda, both_ways)
    run%y = start
    call find_free(run, ds, x, free)
  end function free_bodies_under

  !> The stiffness of joints, elasticity and springs alone, at rest and without loads.
  subroutine unloaded_stiffness(run, both_ways, ds)
    type(run_state), intent(inout) :: run
    logical, intent(in) :: both_ways                 !! stops act both ways, not as they are
    type(stiffness_system), intent(out) :: ds
    type(evaluation_options) :: unloaded
    type(element_action), allocatable :: action(:)
    type(linear_mechanism) :: lin
    real(wp), allocatable :: y(:), a(:), lambda(:)
    integer, allocatable :: state(:)
    integer :: j
    associate (m => run%sys%m, ev => run%sys%ev)
      unloaded = run%sys%options
      unloaded%gravity = 0.0_wp
      unloaded%load_factor = 0.0_wp
      y = run%y
      y(m%s%nq + 1:2*m%s%nq) = 0.0_wp
      call evaluate_state(run%sys, unloaded, y)
      allocate (a(m%s%nq), lambda(m%s%rows), source=0.0_wp)
      action = ev%action
      do j = 1, size(action)
        if (.not. m%s%forces(j)%item%in_all_directions()) action(j) = element_action()
      end do
      state = ev%switches%state
      ev%switches%state = merge(bilateral, state, both_ways)
      call linear_system_with(m, ev, y, a, lambda, action, ds, lin)
      ev%switches%state = state
    end associate
  end subroutine unloaded_stiffness

  !> A motion without stiffness, to which all such motions add, and the bodies that take part in it. Inverse iteration from any
  !> motion, with a shift that shrinks to the rounding of what it finds: motions with a stiffness, of either sign, fade.
  subroutine find_free(run, ds, x, free)
    type(run_state), intent(in) :: run
    type(stiffness_system), intent(inout) :: ds
    real(wp), allocatable, intent(out) :: x(:)       !! (nq) mass-normalised [m, rad, over kg^.5 m]
    logical, allocatable, intent(out) :: free(:)     !! (bodies)
    real(wp) :: shift, least, nearest                ! [rad2/s2]
    real(wp) :: y(ds%n)
    integer :: k, pass
    allocate (free(size(run%sys%m%s%bodies)), source=.false.)
    call even_masses(run, ds)
    ds%gyro = 0.0_wp
    x = [(sin(real(k, wp)**2)/sqrt(ds%m(ds%entry(k, k))), k=1, ds%n)]
    if (ds%n == ds%rows) return
    shift = small_shift*highest_ratio(ds)
    if (shift <= 0.0_wp) shift = 1.0_wp
    least = epsilon(1.0_wp)*shift
    do pass = 1, most_shifts
      call ds%set(cmplx(sqrt(shift), 0.0_wp, wp), 0.0_wp)
      call ds%factor()
      do k = 1, 3
        y = ds%real_times(ds%m, x)
        x = inverse(ds, y)
        nearest = sqrt(1/dot_product(x, ds%real_times(ds%m, x)))
        x = nearest*x
      end do
      if (nearest > 3*shift) return
      shift = min(shift, max(least, 4*rounding_level(ds, x)))
    end do
    free = energies(run, ds, x) > takes_part
  end subroutine find_free

  !> Displacements under given forces.
  function inverse(ds, force) result(x)
    type(stiffness_system), intent(inout) :: ds
    real(wp), intent(in) :: force(:)                 !! (n) [N, N m]
    real(wp) :: x(size(force))                       !! [m, rad]
    complex(wp) :: y(ds%n + ds%rows)
    y = ds%padded(cmplx(force, 0.0_wp, wp))
    call ds%solve(y)
    x = real(y(1:ds%n), wp)
  end function inverse

  !> Gives every body the same mass, distributed as before. Whether a motion is free does not depend on masses, but with very
  !> uneven masses rounding would hide it.
  subroutine even_masses(run, ds)
    type(run_state), intent(in) :: run
    type(stiffness_system), intent(inout) :: ds
    integer :: b, e, first, last
    do b = 1, size(run%sys%m%s%bodies)
      first = run%sys%m%s%qo(b) + 1
      last = first + 2 + run%sys%m%s%bodies(b)%nf
      do e = ds%first(first), ds%first(last + 1) - 1
        ds%m(e) = ds%m(e)/run%sys%m%s%bodies(b)%mass
      end do
    end do
  end subroutine even_masses

  !> Parts of a motion's kinetic energy in the bodies, over the largest.
  function energies(run, ds, x) result(part)
    type(run_state), intent(in) :: run
    type(stiffness_system), intent(in) :: ds
    real(wp), intent(in) :: x(:)                     !! (nq) [m, rad]
    real(wp) :: part(size(run%sys%m%s%bodies)), y(size(x))
    integer :: b, i, n
    y = ds%real_times(ds%m, x)
    do b = 1, size(part)
      i = run%sys%m%s%qo(b)
      n = 3 + run%sys%m%s%bodies(b)%nf
      part(b) = dot_product(x(i + 1:i + n), y(i + 1:i + n))
    end do
    part = part/maxval(part)
  end function energies
end module free_bodies
