!> Equilibrium of the elastic coordinates and of bodies at rest, under given loads, by Newton's method with the structured
!> tangent. The frames keep their velocities as seen from themselves, as far as drives and joints let them, and have the
!> accelerations that follow, so that centrifugal forces act and bodies held by springs on a turning one come to where
!> they turn with it; the elastic coordinates have neither. GHM is relaxed.
!>
!> The residual is M (a - a_p): what the equations of motion would accelerate beyond the prescribed accelerations a_p. The tangent
!> is that of the equilibrium: with a_p, and with the reactions that Newton's last step found for it. Those of the state out of
!> balance, which hold inertia forces too, would spoil its convergence where bodies turn far.
module equilibrium
  use kinds, only: wp
  use dynamic_stiffness, only: stiffness_system
  use dynamics, only: marker_kinematics, set_frames
  use evaluation_settings, only: evaluation_options
  use force_element, only: bilateral
  use force_scale, only: largest_force
  use frame_axes, only: to_global, to_body
  use linear_state, only: evaluate_state, largest_acceleration, linear_system_with
  use linear_matrices, only: linear_mechanism
  use marker, only: turn
  use prescribed_motion, only: prescribe, motion_units
  use position_closing, only: largest_motion
  use posix, only: caught_signal
  use scene_run, only: run_state, relax
  use singular, only: at_rest
  use projection, only: closed
  implicit none (type, external)
  private
  public :: find_equilibrium, find_contacts, equilibrium_report, equations, move

  integer, parameter :: most_newton = 60
  integer, parameter :: most_halvings = 10
  integer, parameter :: most_contact_steps = 400     !! of find_contacts
  real(wp), parameter :: away = 1.0e6_wp            !! beyond that nothing will hold a body any more, of the scene's size [-]
  real(wp), parameter :: largest_turn = 0.3_wp       !! of a frame in one step [rad], and of its motion over the size [-]
  real(wp), parameter :: least_force = 1.0e-30_wp    !! forces below it are none [N]

  !> Result of Newton's method.
  type :: equilibrium_report
    real(wp) :: residual = 0.0_wp                    !! largest residual over the largest force [-]
    real(wp) :: noise = 0.0_wp                       !! residual that rounding of the elastic forces alone may cause [-]
    real(wp) :: gap = 0.0_wp                         !! largest |Phi| over the size [-]
    real(wp) :: force = 0.0_wp                       !! largest residual [N]
    integer :: steps = 0
    logical :: converged = .false.
  end type equilibrium_report

contains

  !> Brings run%y to equilibrium.
  subroutine find_equilibrium(run, options, tolerance, report)
    type(run_state), intent(inout) :: run
    type(evaluation_options), intent(in) :: options  !! the loads that act
    real(wp), intent(in) :: tolerance                !! [-]
    type(equilibrium_report), intent(out) :: report
    type(stiffness_system) :: ds
    complex(wp), allocatable :: r(:)
    real(wp), allocatable :: start(:), dx(:), lambda(:)
    real(wp) :: before, length
    integer :: tries
    logical :: at_floor
    call equations(run, options, ds, r, report)
    lambda = run%sys%ev%lambda
    do
      report%converged = report%residual <= tolerance .and. report%gap <= closed
      if (report%converged .or. report%steps == most_newton) return
      if (caught_signal() > 0) return
      report%steps = report%steps + 1
      call ds%set((0.0_wp, 0.0_wp), 1.0_wp)
      call ds%factor()
      call ds%solve(r)
      dx = real(r(1:ds%n), wp)
      lambda = run%sys%ev%lambda
      lambda(ds%active) = lambda(ds%active) + real(r(ds%n + 1:), wp)
      if (.not. all(abs(dx) < sqrt(huge(1.0_wp)))) return
      start = run%y
      before = report%residual + report%gap
      length = min(1.0_wp, largest_turn/max(largest_motion(run%sys%m, dx, 1.0_wp), tiny(1.0_wp)))
      do tries = 0, most_halvings
        run%y = start
        call move(run, length*dx)
        call equations(run, options, ds, r, report, lambda)
        if (report%residual + report%gap <= max(2*before, 10*tolerance)) exit
        length = length/2
      end do
      at_floor = report%residual <= 4*report%noise .and. report%residual + report%gap > 0.5_wp*before
      report%converged = at_floor .and. report%gap <= closed
      if (report%converged) return
    end do
  end subroutine find_equilibrium

  !> Brings bodies to the stops and loads that hold them, by implicit steps of tau, each from rest: T = M/tau^2 + K
  !> (pseudo-transient continuation, Kelley & Keyes 1998). Steps grow up to Newton's own while the residual falls. They are short
  !> where motions grow: T is positive definite, so that bodies leave an unstable equilibrium.
  subroutine find_contacts(run, options, tolerance, report)
    type(run_state), intent(inout) :: run
    type(evaluation_options), intent(in) :: options  !! the loads that act
    real(wp), intent(in) :: tolerance                !! [-]
    type(equilibrium_report), intent(inout) :: report
    type(stiffness_system) :: ds
    complex(wp), allocatable :: r(:)
    real(wp), allocatable :: start(:), dx(:), lambda(:), origin(:)
    real(wp) :: rate, first                          ! 1/tau, of the first step [1/s]
    type(equilibrium_report) :: before
    integer :: k
    origin = run%y(1:run%sys%m%s%nq)
    call equations(run, options, ds, r, report)
    rate = largest_acceleration(run)/(largest_turn*run%sys%m%s%size)
    rate = sqrt(merge(rate, 1.0_wp, rate > sqrt(tiny(1.0_wp))))      ! nothing pulls: any step serves
    first = rate
    do k = 1, most_contact_steps                     ! of frames that turn little: a body may be far from its stop
      if (report%residual <= tolerance .and. report%gap <= closed) return
      if (rate*epsilon(1.0_wp) > first) return         ! no step helps
      report%steps = k
      if (caught_signal() > 0) return
      before = report
      start = run%y
      if (ds%modes_below(-rate**2) > 0) then
        rate = 3*rate
        cycle
      end if
      call ds%set(cmplx(rate, 0.0_wp, wp), 0.0_wp)
      call ds%factor()
      call ds%solve(r)
      dx = real(r(1:ds%n), wp)
      lambda = run%sys%ev%lambda
      lambda(ds%active) = lambda(ds%active) + real(r(ds%n + 1:), wp)
      if (all(abs(dx) < huge(1.0_wp)) .and. largest_motion(run%sys%m, dx, 0.0_wp) <= largest_turn) then
        call move(run, dx)
        if (maxval(abs(run%y(1:ds%n))) > away*run%sys%m%s%size + maxval(abs(origin))) return    ! nothing stops them
        call equations(run, options, ds, r, report, lambda)
        if (report%gap <= max(2*before%gap, largest_turn**2)) then
          rate = rate*min(0.5_wp, max(0.1_wp, report%force/before%force))
          cycle
        end if
      end if
      rate = 3*rate
      run%y = start
      call equations(run, options, ds, r, report)
    end do
  end subroutine find_contacts

  !> Adds a step of the linearisation's unknowns (frames in their own axes) to the positions. A frame that turns takes the
  !> velocity that its motion has where it comes to: what turns about a point goes on turning about it.
  subroutine move(run, dx)
    type(run_state), intent(inout) :: run
    real(wp), intent(in) :: dx(:)                    !! (nq) [m, rad]
    real(wp) :: d(size(dx))
    integer :: nq, b, i
    nq = size(dx)
    call set_frames(run%sys%m, run%sys%ev, run%y(1:nq))
    d = to_global(run%sys%m, run%sys%ev, dx)
    run%y(1:nq) = run%y(1:nq) + d
    do b = 1, size(run%sys%m%s%bodies)
      i = run%sys%m%s%qo(b)
      run%y(nq + i + 1:nq + i + 2) = run%y(nq + i + 1:nq + i + 2) + run%y(nq + i + 3)*turn(d(i + 1:i + 2))
    end do
  end subroutine move

  !> Residual, tangent and their measures at the present positions; velocities and internal variables follow.
  subroutine equations(run, options, ds, r, report, lambda, both_ways)
    type(run_state), intent(inout) :: run
    type(evaluation_options), intent(in) :: options
    type(stiffness_system), intent(out) :: ds
    complex(wp), allocatable, intent(inout) :: r(:)  !! right-hand side of Newton's step [N, N m], [m]
    type(equilibrium_report), intent(inout) :: report
    real(wp), intent(in), optional :: lambda(:)      !! (rows) multipliers of the equilibrium, as known so far [N, N m]
    logical, intent(in), optional :: both_ways       !! stops are linearised as though they acted both ways
    type(linear_mechanism) :: lin
    real(wp), allocatable :: reactions(:), steady(:), force(:)
    integer, allocatable :: state(:)
    integer :: nq
    nq = run%sys%m%s%nq
    call marker_kinematics(run%sys%m, run%sys%ev, run%y(1:nq), run%y(nq + 1:2*nq))
    call relax(run%sys, options%prestress, run%y)
    call evaluate_state(run%sys, options, run%y)
    allocate (steady(nq), source=0.0_wp)
    associate (m => run%sys%m, ev => run%sys%ev)
      if (.not. at_rest(ev, run%y(nq + 1:2*nq))) then
        call linear_system_with(m, ev, run%y, ev%a, ev%lambda, ev%action, ds, lin)
        call prescribe(run, options, ds, steady)
      end if
      reactions = ev%lambda
      if (present(lambda)) reactions = lambda
      state = ev%switches%state
      if (present(both_ways)) ev%switches%state = merge(bilateral, state, both_ways)
      call linear_system_with(m, ev, run%y, steady, reactions, ev%action, ds, lin)   ! the equilibrium's accelerations and reactions
      ev%switches%state = state
    end associate
    if (allocated(r)) deallocate (r)
    allocate (r(ds%n + ds%rows), source=(0.0_wp, 0.0_wp))
    allocate (force(nq), source=0.0_wp)
    call lin%mass%times(1.0_wp, to_body(run%sys%m, run%sys%ev, run%sys%ev%a - steady), force)
    r(1:nq) = force
    r(nq + 1:) = -run%sys%ev%rows%phi(ds%active)
    call measure(run, ds, force, report)
  end subroutine equations

  !> Residual (moments over the size) and gap, relative to the largest force and to the size.
  subroutine measure(run, ds, force, report)
    type(run_state), intent(in) :: run
    type(stiffness_system), intent(in) :: ds
    real(wp), intent(in) :: force(:)                 !! (nq) M (a - a_p), body axes [N, N m]
    type(equilibrium_report), intent(inout) :: report
    complex(wp) :: x(ds%n + ds%rows)
    real(wp) :: scale, size_s
    real(wp) :: weight(size(force))
    integer :: b, i
    size_s = run%sys%m%s%size
    weight = 1/motion_units(run)
    x = 0.0_wp
    do b = 1, size(run%sys%m%s%bodies)
      i = run%sys%m%s%qo(b) + 3
      associate (body => run%sys%m%s%bodies(b))
        x(i - 2:i - 1) = size_s                        ! positions are known to rounding of the size
        x(i) = 1.0_wp
        x(i + 1:i + body%nf) = abs(run%y(i + 1:i + body%nf))
      end associate
    end do
    scale = maxval([least_force, largest_force(run%sys%m, run%sys%ev), abs(weight*force)])
    x = ds%times(cmplx(abs(ds%k), 0.0_wp, wp), x)
    report%noise = 8*epsilon(1.0_wp)*maxval([0.0_wp, weight*real(x(1:ds%n), wp)])/scale
    report%force = maxval([0.0_wp, abs(weight*force)])
    report%residual = report%force/scale
    report%gap = 0.0_wp
    if (run%sys%m%s%rows > 0) report%gap = maxval(abs(run%sys%ev%rows%phi))/size_s
  end subroutine measure
end module equilibrium
