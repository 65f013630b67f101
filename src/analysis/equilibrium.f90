!> Equilibrium of the elastic coordinates and of bodies at rest, under given loads, by Newton's method with the structured
!> tangent. The frames keep their velocities as seen from themselves, as far as drives and joints let them, and have the
!> accelerations that follow, so that centrifugal forces act and bodies held by springs on a turning one find the place at
!> which they turn with it; the elastic coordinates have neither. GHM is relaxed.
!>
!> The residual is M (a - a_p): what the equations of motion would accelerate beyond the prescribed accelerations a_p. The tangent
!> is that of the equilibrium: with a_p, and with the reactions that Newton's last step found for it. Those of the state out of
!> balance, which hold inertia forces too, would spoil its convergence where bodies turn far.
module equilibrium
  use kinds, only: wp
  use dynamic_stiffness, only: stiffness_system
  use dynamics, only: place_kinematics, set_frames, row_rates
  use force_scale, only: largest_force
  use frame_axes, only: to_global, to_body
  use linear_state, only: evaluate_state, linear_system
  use linear_matrices, only: linear_mechanism
  use place, only: turn
  use scene_run, only: run_state, relax
  implicit none (type, external)
  private
  public :: find_equilibrium, equilibrium_report

  integer, parameter :: most_newton = 60
  integer, parameter :: most_halvings = 10
  real(wp), parameter :: largest_turn = 0.3_wp       !! of a frame in one step [rad], and of its motion over the size [-]
  real(wp), parameter :: closed = 1.0e-12_wp         !! |Phi| of a closed mechanism, relative to the size [-]
  real(wp), parameter :: least_force = 1.0e-30_wp    !! forces below it are none [N]
  real(wp), parameter :: elastic_weight(2) = [1.0e20_wp, 1.0e6_wp]   !! keeps elastic coordinates out of the prescribed motion;
                                                     !! where frames alone cannot follow, they move least [-]
  real(wp), parameter :: followed = 1.0e-9_wp        !! what may be left of a prescribed rate, of the largest [-]

  !> What Newton's method did.
  type :: equilibrium_report
    real(wp) :: residual = 0.0_wp                    !! largest residual over the largest force [-]
    real(wp) :: noise = 0.0_wp                       !! what rounding of the elastic forces alone may give of it [-]
    real(wp) :: gap = 0.0_wp                         !! largest |Phi| over the size [-]
    integer :: steps = 0
    logical :: converged = .false.
  end type equilibrium_report

contains

  !> Brings run%y to equilibrium under the loads that act now.
  subroutine find_equilibrium(run, tolerance, report)
    type(run_state), intent(inout) :: run
    real(wp), intent(in) :: tolerance                !! [-]
    type(equilibrium_report), intent(out) :: report
    type(stiffness_system) :: ds
    complex(wp), allocatable :: r(:)
    real(wp), allocatable :: start(:), dx(:), lambda(:)
    real(wp) :: before, length
    integer :: tries
    logical :: at_floor
    call equations(run, ds, r, report)
    lambda = run%sys%m%lambda
    do
      report%converged = report%residual <= tolerance .and. report%gap <= closed
      if (report%converged .or. report%steps == most_newton) return
      report%steps = report%steps + 1
      call ds%set((0.0_wp, 0.0_wp), 1.0_wp)
      call ds%factor()
      call ds%solve(r)
      dx = real(r(1:ds%n), wp)
      lambda = run%sys%m%lambda
      lambda(ds%active) = lambda(ds%active) + real(r(ds%n + 1:), wp)
      if (.not. all(abs(dx) < huge(1.0_wp))) return
      start = run%y
      before = report%residual + report%gap
      length = min(1.0_wp, largest_turn/max(largest_motion(run, dx), tiny(1.0_wp)))
      do tries = 0, most_halvings
        run%y = start
        call move(run, length*dx)
        call equations(run, ds, r, report, lambda)
        if (report%residual + report%gap <= max(2*before, 10*tolerance)) exit
        length = length/2
      end do
      at_floor = report%residual <= 4*report%noise .and. report%residual + report%gap > 0.5_wp*before
      report%converged = at_floor .and. report%gap <= closed
      if (report%converged) return
    end do
  end subroutine find_equilibrium

  !> Largest motion of a frame: relative to the size, or in radians.
  pure real(wp) function largest_motion(run, dx) result(motion)
    type(run_state), intent(in) :: run
    real(wp), intent(in) :: dx(:)
    integer :: b, i
    motion = 0.0_wp
    do b = 1, size(run%sys%m%s%bodies)
      i = run%sys%m%s%qo(b)
      motion = max(motion, norm2(dx(i + 1:i + 2))/run%sys%m%s%size, abs(dx(i + 3)))
    end do
  end function largest_motion

  !> Adds a step of the linearisation's unknowns (frames in their own axes) to the positions. A frame that turns takes the
  !> velocity that its motion has where it comes to: what turns about a point goes on turning about it.
  subroutine move(run, dx)
    type(run_state), intent(inout) :: run
    real(wp), intent(in) :: dx(:)                    !! (nq)
    real(wp) :: d(size(dx))
    integer :: nq, b, i
    nq = size(dx)
    call set_frames(run%sys%m, run%y(1:nq))
    d = to_global(run%sys%m, dx)
    run%y(1:nq) = run%y(1:nq) + d
    do b = 1, size(run%sys%m%s%bodies)
      i = run%sys%m%s%qo(b)
      run%y(nq + i + 1:nq + i + 2) = run%y(nq + i + 1:nq + i + 2) + run%y(nq + i + 3)*turn(d(i + 1:i + 2))
    end do
  end subroutine move

  !> Residual, tangent and their measures at the present positions; velocities and dissipative coordinates follow.
  subroutine equations(run, ds, r, report, lambda)
    type(run_state), intent(inout) :: run
    type(stiffness_system), intent(out) :: ds
    complex(wp), allocatable, intent(inout) :: r(:)  !! right-hand side of Newton's step
    type(equilibrium_report), intent(inout) :: report
    real(wp), intent(in), optional :: lambda(:)      !! (rows) multipliers of the equilibrium, as known so far [N, N m]
    type(linear_mechanism) :: lin
    real(wp), allocatable :: a(:), reactions(:), steady(:), force(:)
    integer :: nq
    nq = run%sys%m%s%nq
    call set_frames(run%sys%m, run%y(1:nq))
    call place_kinematics(run%sys%m, run%y(1:nq), run%y(nq + 1:2*nq))
    call relax(run%sys, run%y)
    call evaluate_state(run)
    allocate (steady(nq), source=0.0_wp)
    if (moves(run)) then
      call linear_system(run, ds, lin, evaluated=.true.)
      call prescribe(run, ds, steady)
    end if
    a = run%sys%m%a
    reactions = run%sys%m%lambda
    run%sys%m%a = steady                                   ! the tangent belongs to the equilibrium's accelerations
    if (present(lambda)) run%sys%m%lambda = lambda         ! and reactions
    call linear_system(run, ds, lin, evaluated=.true.)
    run%sys%m%a = a
    run%sys%m%lambda = reactions
    if (allocated(r)) deallocate (r)
    allocate (r(ds%n + ds%rows), source=(0.0_wp, 0.0_wp))
    allocate (force(nq), source=0.0_wp)
    call lin%mass%times(1.0_wp, to_body(run%sys%m, run%sys%m%a - steady), force)
    r(1:nq) = force
    r(nq + 1:) = -run%sys%m%rows%phi(ds%active)
    call measure(run, ds, force, report)
  end subroutine equations

  !> Whether bodies move or drives accelerate them.
  pure logical function moves(run) result(yes)
    type(run_state), intent(in) :: run
    integer :: nq
    nq = run%sys%m%s%nq
    yes = any(abs(run%y(nq + 1:2*nq)) > 0.0_wp) .or. any(abs(run%sys%m%rows%phi_t) > 0.0_wp) &
          .or. any(abs(run%sys%m%rows%extra) > 0.0_wp)
  end function moves

  !> Velocities that satisfy the drives and joints again, and the accelerations of bodies that keep them in their own axes
  !> (theta' H R', theta'' = 0), with the least change that drives and joints ask for; elastic coordinates at rest where that
  !> suffices.
  subroutine prescribe(run, ds, steady)
    type(run_state), intent(inout) :: run
    type(stiffness_system), intent(inout) :: ds
    real(wp), intent(out) :: steady(:)               !! (nq) accelerations, global axes
    real(wp), allocatable :: rate(:)
    integer :: nq, k, i, b
    nq = size(steady)
    allocate (rate(run%sys%m%s%rows), source=0.0_wp)
    call row_rates(run%sys%m, rate)
    if (any(abs(rate) > 0.0_wp)) then
      run%y(nq + 1:2*nq) = run%y(nq + 1:2*nq) + to_global(run%sys%m, follow(run, ds, -rate))
      call evaluate_state(run)
    end if
    steady = 0.0_wp
    do b = 1, size(run%sys%m%s%bodies)
      i = run%sys%m%s%qo(b)
      steady(i + 1:i + 2) = run%y(nq + i + 3)*turn(run%y(nq + i + 1:nq + i + 2))
    end do
    rate = joint_rates(ds, to_body(run%sys%m, steady), run%sys%m%s%rows)
    do k = 1, size(run%sys%m%s%constraints)
      associate (c => run%sys%m%s%constraints(k)%item, m => run%sys%m)
        do i = c%first, c%first + c%rows - 1
          rate(i) = rate(i) + (m%rows%extra(i) + dot_product(m%rows%na(:, i), m%p%bias(:, c%ia)) &
                               + dot_product(m%rows%nb(:, i), m%p%bias(:, c%ib)))
        end do
      end associate
    end do
    steady = steady + to_global(run%sys%m, follow(run, ds, -rate))
  end subroutine prescribe

  !> J x: what a motion does to the independent rows.
  pure function joint_rates(ds, x, rows) result(rate)
    type(stiffness_system), intent(in) :: ds
    real(wp), intent(in) :: x(:)                     !! (nq) body axes
    integer, intent(in) :: rows                      !! all rows
    real(wp) :: rate(rows)                           !! 0 for dependent ones
    complex(wp) :: y(ds%n + ds%rows)
    y = 0.0_wp
    y(1:ds%n) = x
    y = ds%times(cmplx(ds%joint, 0.0_wp, wp), y)
    rate = 0.0_wp
    rate(ds%active) = real(y(ds%n + 1:), wp)
  end function joint_rates

  !> The least motion with the given rates of the rows, body axes: of the frames alone where that suffices.
  function follow(run, ds, rate) result(x)
    type(run_state), intent(in) :: run
    type(stiffness_system), intent(inout) :: ds
    real(wp), intent(in) :: rate(:)                  !! (rows) [m/s] or [m/s2]
    real(wp), allocatable :: x(:), unit(:)
    complex(wp), allocatable :: y(:)
    real(wp) :: left(size(rate)), most
    integer :: b, i, attempt
    unit = motion_units(run)
    do attempt = 1, 2
      y = [((0.0_wp, 0.0_wp), i=1, ds%n), cmplx(rate(ds%active), 0.0_wp, wp)]
      call weigh(run, unit, elastic_weight(attempt), ds)
      call ds%solver%solve(y)                        ! ds%solve would correct by the residual of the stiffness
      left = joint_rates(ds, real(y(1:ds%n), wp), size(rate)) - rate
      if (all(abs(left(ds%active)) <= followed*maxval(abs(rate)))) exit
    end do
    x = real(y(1:ds%n), wp)
    if (attempt > 1) return
    most = maxval(abs(unit*x))
    do b = 1, size(run%sys%m%s%bodies)               ! what is left of elastic motion by the weight alone
      i = run%sys%m%s%qo(b) + 3
      associate (n => run%sys%m%s%bodies(b)%nf)
        where (unit(i + 1:i + n)*abs(x(i + 1:i + n)) <= 1.0e-12_wp*most) x(i + 1:i + n) = 0.0_wp
      end associate
    end do
  end function follow

  !> A metric of the motion in place of the stiffness, factored: squares of lengths, whatever the units.
  subroutine weigh(run, unit, elastic, ds)
    type(run_state), intent(in) :: run
    real(wp), intent(in) :: unit(:)                  !! (nq) what makes lengths of the unknowns
    real(wp), intent(in) :: elastic                  !! of elastic coordinates; frames weigh 1 [-]
    type(stiffness_system), intent(inout) :: ds
    integer :: b, k, i
    ds%values = ds%joint
    do b = 1, size(run%sys%m%s%bodies)
      i = run%sys%m%s%qo(b)
      do k = i + 1, i + 3 + run%sys%m%s%bodies(b)%nf
        ds%values(ds%entry(k, k)) = merge(1.0_wp, elastic, k <= i + 3)*unit(k)**2
      end do
    end do
    call ds%factor()
  end subroutine weigh

  !> What makes lengths of all unknowns: 1, the size for angles and rotations, mass**(-1/2) for modes.
  function motion_units(run) result(unit)
    type(run_state), intent(in) :: run
    real(wp), allocatable :: unit(:)                 !! (nq) [-], [m] or [kg**(-1/2)]
    integer :: b, i
    allocate (unit(run%sys%m%s%nq), source=1.0_wp)
    do b = 1, size(run%sys%m%s%bodies)
      i = run%sys%m%s%qo(b) + 3
      unit(i) = run%sys%m%s%size
      associate (bo => run%sys%m%s%bodies(b))
        if (bo%modal) then
          unit(i + 1:i + bo%nf) = 1.0_wp/sqrt(bo%mass)
        else if (allocated(bo%dof)) then
          call rotations(bo%dof, i, run%sys%m%s%size, unit)
        end if
      end associate
    end do
  end function motion_units

  !> Residual (moments over the size) and gap, relative to the largest force and to the size.
  subroutine measure(run, ds, force, report)
    type(run_state), intent(in) :: run
    type(stiffness_system), intent(in) :: ds
    real(wp), intent(in) :: force(:)                 !! (nq) M (a - a_p), body axes
    type(equilibrium_report), intent(inout) :: report
    complex(wp) :: x(ds%n + ds%rows)
    real(wp) :: scale, size_s
    real(wp) :: weight(size(force))
    integer :: b, i
    size_s = run%sys%m%s%size
    weight = 1.0_wp
    x = 0.0_wp
    do b = 1, size(run%sys%m%s%bodies)
      i = run%sys%m%s%qo(b) + 3
      weight(i) = 1.0_wp/size_s
      associate (bo => run%sys%m%s%bodies(b))
        if (allocated(bo%dof) .and. .not. bo%modal) call rotations(bo%dof, i, 1.0_wp/size_s, weight)
        x(i - 2:i - 1) = size_s                        ! positions are known to rounding of the size
        x(i) = 1.0_wp
        x(i + 1:i + bo%nf) = abs(run%y(i + 1:i + bo%nf))
      end associate
    end do
    scale = maxval([least_force, largest_force(run%sys%m), abs(weight*force)])
    x = ds%times(cmplx(abs(ds%k), 0.0_wp, wp), x)
    report%noise = 8*epsilon(1.0_wp)*maxval([0.0_wp, weight*real(x(1:ds%n), wp)])/scale
    report%residual = maxval([0.0_wp, abs(weight*force)])/scale
    report%gap = 0.0_wp
    if (run%sys%m%s%rows > 0) report%gap = maxval(abs(run%sys%m%rows%phi))/size_s
  end subroutine measure

  !> Marks nodal rotations.
  pure subroutine rotations(dof, offset, value, weight)
    integer, intent(in) :: dof(:, :)                 !! (3, nodes)
    integer, intent(in) :: offset
    real(wp), intent(in) :: value                    !! [m] or [1/m]
    real(wp), intent(inout) :: weight(:)
    integer :: k
    do k = 1, size(dof, 2)
      if (dof(3, k) > 0) weight(offset + dof(3, k)) = value
    end do
  end subroutine rotations
end module equilibrium
