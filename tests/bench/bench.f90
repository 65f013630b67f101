!> Times of the solver's parts, in one process: bench DECK STEPS. Each line of the output is a name, the median and the
!> smallest and largest of several repetitions, in microseconds a step or a call.
program bench
  use kinds, only: wp, ip
  use banded, only: band_solve_two
  use body, only: body_model
  use deck_reader, only: read_deck
  use dynamics, only: evaluate
  use errors, only: failure, fault_list
  use lapack, only: use_one_blas_thread, dpbtrf, dpbtrs, dsbmv
  use body_setup, only: mass_triplets
  use projection, only: project
  use results, only: result_set
  use runge_kutta, only: explicit_stepper, classical_rk4
  use scene_run, only: run_state, prepare_run
  use, intrinsic :: iso_fortran_env, only: error_unit
  implicit none (type, external)

  integer, parameter :: repetitions = 7
  type(run_state) :: run
  real(wp) :: seconds(repetitions)           !! of each repetition [s]
  integer :: steps

  call read_arguments()
  call use_one_blas_thread()
  call time_start_up()
  call time_steps()
  call time_parts()
  call time_rows()
  call time_floor()

contains

  !> The deck and the number of steps of one repetition.
  subroutine read_arguments()
    type(fault_list) :: faults
    character(512) :: path, number
    call get_command_argument(1, path)
    call get_command_argument(2, number)
    read (number, *) steps
    call read_deck(trim(path), run%d, faults)
    if (faults%count == 0) return
    call faults%print(error_unit)
    error stop 2, quiet=.true.
  end subroutine read_arguments

  !> Wall time [s].
  real(wp) function clock()
    integer(ip) :: count, rate
    call system_clock(count, rate)
    clock = real(count, wp)/real(rate, wp)
  end function clock

  !> Prints the median and the spread of the repetitions, of n calls each [us].
  subroutine show(name, n)
    character(*), intent(in) :: name
    integer, intent(in) :: n
    real(wp) :: x(repetitions)
    integer :: k, i
    x = seconds/n*1.0e6_wp
    do k = 2, repetitions
      do i = k, 2, -1
        if (x(i) >= x(i - 1)) exit
        x([i - 1, i]) = x([i, i - 1])
      end do
    end do
    write (*, '(a, 3es13.5)') name, x((repetitions + 1)/2), x(1), x(repetitions)
  end subroutine show

  !> Building and assembling the scene, once.
  subroutine time_start_up()
    type(fault_list) :: faults
    type(failure) :: fail
    seconds = -clock()
    call prepare_run(run, faults, fail)
    seconds = seconds + clock()
    if (faults%count > 0) call faults%print(error_unit)
    if (fail%happened()) write (error_unit, '(a)') fail%message
    if (faults%count > 0 .or. fail%happened()) error stop 2, quiet=.true.
    call show('set_up', 1)
    associate (s => run%sys%m%s)
      write (*, '(a, i0)') 'coordinates ', s%nq, 'dissipative ', s%nz, 'rows ', s%rows, 'band ', run%sys%m%schur%kd
    end associate
  end subroutine time_start_up

  !> Whole rk4 steps with projection, as the transient makes them.
  subroutine time_steps()
    type(explicit_stepper) :: stepper
    real(wp), allocatable :: y(:)
    real(wp) :: h, t
    logical :: ok
    integer :: r, i
    h = run%d%transient%step
    call stepper%prepare(classical_rk4(), run%sys%n)
    do r = 1, repetitions
      y = run%y
      call run%sys%derivative(0.0_wp, y, .false., stepper%k(:, 1))
      seconds(r) = -clock()
      do i = 1, steps
        t = i*h
        call stepper%step(run%sys, t - h, h, y)
        call run%sys%accept(t, y, ok)
        if (.not. ok) error stop 'the benchmark scene diverged'
        call run%sys%derivative(t, y, .false., stepper%k(:, 1))
      end do
      seconds(r) = seconds(r) + clock()
    end do
    run%y = y
    call show('step', steps)
  end subroutine time_steps

  !> A right-hand side, the banded solves in it, and a projection of a state that one correction closes.
  subroutine time_parts()
    real(wp), allocatable :: q(:), v(:), z(:), zd(:), q0(:), v0(:)
    integer :: r, i, b, nq, nz
    logical :: ok
    nq = run%sys%m%s%nq
    nz = run%sys%m%s%nz
    q0 = run%y(1:nq)
    v0 = run%y(nq + 1:2*nq)
    z = run%y(2*nq + 1:2*nq + nz)
    zd = run%y(2*nq + nz + 1:2*nq + 2*nz)
    do r = 1, repetitions
      seconds(r) = -clock()
      do i = 1, steps
        call evaluate(run%sys%m, 0.0_wp, q0, v0, z, zd)
      end do
      seconds(r) = seconds(r) + clock()
    end do
    call show('right_hand_side', steps)
    do r = 1, repetitions
      seconds(r) = -clock()
      do i = 1, steps
        do b = 1, size(run%sys%m%s%bodies)
          associate (bo => run%sys%m%s%bodies(b))
            if (.not. bo%flexible .or. bo%modal) cycle
            bo%fx(1:bo%nf) = bo%c0
            bo%tx(1:bo%nf) = bo%i1f
            call band_solve_two(bo%mff, bo%fx(1:bo%nf), bo%tx(1:bo%nf))
          end associate
        end do
      end do
      seconds(r) = seconds(r) + clock()
    end do
    call show('solve', steps)
    call evaluate(run%sys%m, 0.0_wp, q0, v0, z, zd)
    do r = 1, repetitions
      seconds(r) = 0.0_wp
      do i = 1, steps
        q = q0*(1 + 1.0e-10_wp)
        v = v0*(1 + 1.0e-10_wp)
        seconds(r) = seconds(r) - clock()
        call project(run%sys%m, 0.0_wp, q, v, z, zd, ok)
        seconds(r) = seconds(r) + clock()
      end do
    end do
    call show('projection', steps)
  end subroutine time_parts

  !> Rows of history and energy.
  subroutine time_rows()
    type(result_set) :: files
    integer :: r, i, nq, nz
    nq = run%sys%m%s%nq
    nz = run%sys%m%s%nz
    call files%open('.', 'bench', run%sys%m, run%list, .false.)
    do r = 1, repetitions
      seconds(r) = -clock()
      do i = 1, steps
        call files%write_row(0.0_wp, run%sys%m, run%list, run%y(1:nq), run%y(nq + 1:2*nq), run%y(2*nq + 1:2*nq + nz), &
                             run%y(2*nq + nz + 1:2*nq + 2*nz), 0.0_wp, 0.0_wp)
      end do
      seconds(r) = seconds(r) + clock()
    end do
    call files%close()
    call show('row', steps)
  end subroutine time_rows

  !> The floor of an RK4 step: four times two DPBTRS and three DSBMV of every nodal flexible body's size.
  subroutine time_floor()
    real(wp), allocatable :: ab(:, :), x(:), y(:)
    integer :: r, i, b, k, kd, n, info
    if (.not. any(run%sys%m%s%bodies%flexible .and. .not. run%sys%m%s%bodies%modal)) return
    seconds = 0.0_wp
    do b = 1, size(run%sys%m%s%bodies)
      associate (bo => run%sys%m%s%bodies(b))
        if (.not. bo%flexible .or. bo%modal) cycle
        call mass_band(bo, ab, kd)
        n = bo%nf
        call dpbtrf('L', n, kd, ab, kd + 1, info)
        x = bo%c0
        y = bo%i1f
        do r = 1, repetitions
          seconds(r) = seconds(r) - clock()
          do i = 1, steps
            do k = 1, 2
              x = bo%c0
              call dpbtrs('L', n, kd, 1, ab, kd + 1, x, n, info)
            end do
            do k = 1, 3
              call dsbmv('L', n, kd, 1.0_wp, ab, kd + 1, x, 1, 0.0_wp, y, 1)
            end do
          end do
          seconds(r) = seconds(r) + clock()
        end do
      end associate
    end do
    seconds = 4*seconds
    call show('floor', steps)
  end subroutine time_floor

  !> m_ff in LAPACK's band storage, in the order of the nodes.
  subroutine mass_band(bo, ab, kd)
    type(body_model), intent(in) :: bo
    real(wp), allocatable, intent(out) :: ab(:, :)
    integer, intent(out) :: kd
    integer, allocatable :: rows(:), cols(:)
    real(wp), allocatable :: values(:)
    integer :: k, i, j
    call mass_triplets(bo, rows, cols, values)
    kd = maxval(abs(rows - cols))
    allocate (ab(0:kd, bo%nf), source=0.0_wp)
    do k = 1, size(values)
      i = max(rows(k), cols(k))
      j = min(rows(k), cols(k))
      ab(i - j, j) = ab(i - j, j) + values(k)
    end do
  end subroutine mass_band
end program bench
