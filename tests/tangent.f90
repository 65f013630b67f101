!> Checks the implicit method's structured Newton step against finite differences of its own residual:
!> tangent DECK STEP SPECTRAL_RADIUS SEED. A random state near the assembled one, the exact elastic blocks, the correction
!> dq, dlambda of one iteration; printed: the largest component of (finite-difference tangent times correction + residual)
!> relative to the largest component of the residual's own parts, for bodies and for constraints.
!> Joints and stops with friction slip, with an even SEED they stick.
!> tangent DECK STEP SPECTRAL_RADIUS march TIMES INTERVAL: fixed steps, and at TIMES multiples of INTERVAL the method's own
!> variables: q, v, accelerations v', multipliers.
program tangent
  use kinds, only: wp
  use deck_reader, only: read_deck
  use error_groups, only: group_unknowns
  use errors, only: failure, fault_list
  use friction_law, only: row_slips, row_stuck
  use alpha_newton, only: solve_trial, take_trial, find_offsets
  use alpha_stepper, only: start_method
  use alpha_state, only: alpha_solver, chung_hulbert, set_up_alpha
  use scene_run, only: run_state, prepare_run
  use step_control, only: error_norm
  implicit none (type, external)
  type(run_state) :: run
  type(alpha_solver) :: solver
  type(error_norm) :: norm
  type(fault_list) :: faults
  type(failure) :: fail
  character(512) :: word(6)
  real(wp), allocatable :: q(:), v(:), vd(:), lambda(:)   ! the trial state
  real(wp) :: h, rho
  integer :: k, seed
  do k = 1, 6
    call get_command_argument(k, word(k))
  end do
  read (word(2), *) h
  read (word(3), *) rho
  seed = 0
  if (word(4) /= 'march') read (word(4), *) seed
  call read_deck(trim(word(1)), run%d, faults)
  if (faults%count == 0) call prepare_run(run, faults, fail)
  if (faults%count > 0) then
    call faults%print()
    error stop 2, quiet=.true.
  end if
  if (fail%happened()) error stop 2, quiet=.true.
  call run%sys%start_implicit(.false.)
  call group_unknowns(run%sys%m%s, norm)
  call norm%watch(run%y)
  call set_up_alpha(solver, run%sys, chung_hulbert(rho), norm)
  call start_method(solver, run%sys, 0.0_wp, h, run%y)
  associate (s => run%sys%m%s, states => run%sys%ev%switches%state)
    if (word(4) /= 'march') states(size(s%switching) + 1:s%elements) = merge(row_slips, row_stuck, mod(seed, 2) == 1)
  end associate
  if (word(4) == 'march') then
    call march()
  else
    call disturb()
    call compare()
  end if

contains

  !> Fixed steps; what the method carries, not what is reported.
  subroutine march()
    real(wp) :: interval
    integer :: i, times, each
    logical :: ok
    read (word(5), *) times
    read (word(6), *) interval
    each = nint(interval/h)
    do i = 1, times*each
      call solve_trial(solver, run%sys, norm, i*h, .false., ok)
      if (.not. ok) error stop 3, quiet=.true.
      call take_trial(solver, run%sys, i*h)
      call norm%watch(solver%x(1:solver%nq))
      if (mod(i, each) > 0) cycle
      write (*, '(a, *(1x, es23.16))') 'q', solver%x(1:solver%nq)
      write (*, '(a, *(1x, es23.16))') 'v', solver%v(1:solver%nq)
      write (*, '(a, *(1x, es23.16))') 'acceleration', solver%vd(1:solver%nq)
      write (*, '(a, *(1x, es23.16))') 'multiplier', solver%lambda
    end do
  end subroutine march

  !> Random numbers in (-1, 1), the same on every machine.
  function random(n) result(x)
    integer, intent(in) :: n
    real(wp) :: x(n)
    integer :: i
    do i = 1, n
      seed = mod(1103*seed + 12345, 65536)
      x(i) = 2*real(seed, wp)/65536 - 1
    end do
  end function random

  !> A trial state away from the start: positions, rates, accelerations, multipliers, dissipative coordinates.
  subroutine disturb()
    integer :: n, nz
    real(wp) :: speed
    n = run%sys%m%s%nq
    nz = run%sys%m%s%nz
    speed = 30.0_wp
    solver%x(n + 1:) = solver%x(n + 1:) + 1.0e-3_wp*random(nz)
    call find_offsets(solver, run%sys, solver%x(n + 1:), solver%v(n + 1:), solver%vd(n + 1:))
    solver%x1(1:n) = solver%x(1:n) + 0.01_wp*random(n)
    solver%v1(1:n) = solver%v(1:n) + speed*random(n)
    solver%vd1(1:n) = solver%vd(1:n) + 10*speed**2*random(n)
    solver%lambda1 = solver%lambda + 100*random(size(solver%lambda))
  end subroutine disturb

  !> Residuals of all bodies (global axes) and of the constraints.
  function residual() result(r)
    real(wp) :: r(run%sys%m%s%nq + run%sys%m%s%rows)
    associate (n => solver%nq)
      call run%sys%residual(h, solver%x1(1:n), solver%v1(1:n), solver%vd1(1:n), solver%dx(n + 1:), solver%lambda1, .true., &
                            r(1:n), r(n + 1:))
    end associate
  end function residual

  !> The tangent's action on the correction, column by column and by central differences.
  subroutine compare()
    real(wp), allocatable :: r0(:), sum(:), size_of(:), column(:), dq(:), dl(:)
    real(wp) :: e
    integer :: j, n, nr
    logical :: ok
    n = run%sys%m%s%nq
    nr = run%sys%m%s%rows
    q = solver%x1(1:n)
    v = solver%v1(1:n)
    vd = solver%vd1(1:n)
    lambda = solver%lambda1
    allocate (size_of(n + nr), source=0.0_wp)
    r0 = residual()
    call run%sys%renew(q, v, vd, lambda, .true., .false., ok, r0(1:n))
    if (.not. ok) error stop 3, quiet=.true.
    allocate (dq(n), dl(nr), source=0.0_wp)
    call run%sys%correction(r0(1:n), r0(n + 1:), dq, dl)
    sum = r0
    do j = 1, n + nr
      e = 1.0e-5_wp
      if (j > n) e = 1.0_wp
      call move(j, e)
      column = residual()
      call move(j, -e)
      column = (column - residual())/(2*e)
      if (j <= n) column = column*dq(j)
      if (j > n) column = column*dl(j - n)
      sum = sum + column
      size_of = max(size_of, abs(column))
    end do
    write (*, '(a, 3(1x, es10.3))') 'mismatch', maxval(abs(sum(1:n)))/maxval(size_of(1:n)), &
      maxval(abs(sum(1:n))/max(size_of(1:n), 1.0e-9_wp*maxval(size_of(1:n)))), &
      maxval([0.0_wp, abs(sum(n + 1:))])/max(maxval([0.0_wp, size_of(n + 1:)]), tiny(1.0_wp))
  end subroutine compare

  !> The trial state with unknown j moved by e along the method's relations.
  subroutine move(j, e)
    integer, intent(in) :: j
    real(wp), intent(in) :: e
    integer :: n
    n = size(q)
    solver%x1(1:n) = q
    solver%v1(1:n) = v
    solver%vd1(1:n) = vd
    solver%lambda1 = lambda
    if (j <= n) then
      solver%x1(j) = q(j) + e
      solver%v1(j) = v(j) + solver%now%c2*e
      solver%vd1(j) = vd(j) + solver%now%c1*e
    else
      solver%lambda1(j - n) = lambda(j - n) + e
    end if
  end subroutine move
end program tangent
