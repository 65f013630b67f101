!> The motion that a static analysis holds: velocities that satisfy drives and joints, and accelerations of bodies that keep these
!> velocities as seen from themselves, so that centrifugal forces act.
module prescribed_motion
  use kinds, only: wp
  use dynamic_stiffness, only: stiffness_system
  use dynamics, only: row_rates
  use evaluation_settings, only: evaluation_options
  use frame_axes, only: to_global, to_body
  use linear_state, only: evaluate_state
  use marker, only: turn
  use scene_run, only: run_state
  implicit none (type, external)
  private
  public :: prescribe, motion_units, weigh

  real(wp), parameter :: elastic_weight(2) = [1.0e20_wp, 1.0e6_wp]   !! keeps elastic coordinates out of the prescribed motion;
                                                     !! where frames alone cannot follow, they move least [-]
  real(wp), parameter :: followed = 1.0e-9_wp        !! what may be left of a prescribed rate, of the largest [-]

contains

  !> Velocities that satisfy the drives and joints again, and the accelerations of bodies that keep them in their own axes
  !> (theta' H R', theta'' = 0), with the least change that drives and joints ask for; elastic coordinates at rest where that
  !> suffices.
  subroutine prescribe(run, options, ds, steady)
    type(run_state), intent(inout) :: run
    type(evaluation_options), intent(in) :: options
    type(stiffness_system), intent(inout) :: ds
    real(wp), intent(out) :: steady(:)               !! (nq) accelerations, global axes [m/s2, rad/s2]
    real(wp), allocatable :: rate(:)
    integer :: nq, k, i, b
    nq = size(steady)
    allocate (rate(run%sys%m%s%rows), source=0.0_wp)
    call row_rates(run%sys%m, run%sys%ev, rate)
    if (any(abs(rate) > 0.0_wp)) then
      run%y(nq + 1:2*nq) = run%y(nq + 1:2*nq) + to_global(run%sys%m, run%sys%ev, follow(run, ds, -rate))
      call evaluate_state(run%sys, options, run%y)
    end if
    steady = 0.0_wp
    do b = 1, size(run%sys%m%s%bodies)
      i = run%sys%m%s%qo(b)
      steady(i + 1:i + 2) = run%y(nq + i + 3)*turn(run%y(nq + i + 1:nq + i + 2))
    end do
    rate = joint_rates(ds, to_body(run%sys%m, run%sys%ev, steady), run%sys%m%s%rows)
    do k = 1, size(run%sys%m%s%constraints)
      associate (c => run%sys%m%s%constraints(k)%item, m => run%sys%m, ev => run%sys%ev)
        do i = c%first, c%first + c%rows - 1
          rate(i) = rate(i) + (ev%rows%acceleration_bias(i) + dot_product(ev%rows%na(:, i), ev%p%bias(:, c%ia)) &
                               + dot_product(ev%rows%nb(:, i), ev%p%bias(:, c%ib)))
        end do
      end associate
    end do
    steady = steady + to_global(run%sys%m, run%sys%ev, follow(run, ds, -rate))
  end subroutine prescribe

  !> J x: what a motion does to the independent rows.
  pure function joint_rates(ds, x, rows) result(rate)
    type(stiffness_system), intent(in) :: ds
    real(wp), intent(in) :: x(:)   !! (nq) velocities or accelerations, body axes [m, rad, per second or its square]
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
      call ds%solver%solve(y, .false.)                        ! ds%solve would correct by the residual of the stiffness
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

  !> Puts a diagonal metric of lengths in place of the stiffness and factors it: the least motion is then independent of units.
  subroutine weigh(run, unit, elastic, ds)
    type(run_state), intent(in) :: run
    real(wp), intent(in) :: unit(:)                  !! (nq) what makes lengths of the unknowns [-], [m]
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

  !> Factors that turn all unknowns into lengths: 1, the size for angles and rotations, mass**(-1/2) for modes.
  function motion_units(run) result(unit)
    type(run_state), intent(in) :: run
    real(wp), allocatable :: unit(:)                 !! (nq) [-], [m] or [kg**(-1/2)]
    integer :: b, i
    allocate (unit(run%sys%m%s%nq), source=1.0_wp)
    do b = 1, size(run%sys%m%s%bodies)
      i = run%sys%m%s%qo(b) + 3
      unit(i) = run%sys%m%s%size
      associate (body => run%sys%m%s%bodies(b))
        if (body%flexible) unit(i + 1:i + body%nf) = merge(run%sys%m%s%size, body%basis%unit, body%basis%rotation)
      end associate
    end do
  end function motion_units
end module prescribed_motion
