!> Times of the solver's parts, in one process: bench DECK STEPS [dense]. With `dense` also the paper's own way, its
!> augmented matrices assembled and solved dense at each of the four stages. Each line of the output is a name, the median and the
!> smallest and largest of several repetitions, in microseconds a step or a call.
program bench
  use kinds, only: wp, ip
  use body, only: body_model
  use choose_stepper, only: make_stepper
  use deck_reader, only: read_deck
  use dynamics, only: evaluate
  use energy_balance, only: balance_watch
  use errors, only: failure, fault_list
  use lapack, only: use_one_blas_thread, dpbtrf, dgesv
  use projection, only: project
  use results, only: result_set
  use scene_run, only: run_state, prepare_run
  use sensors, only: read_sensors
  use time_stepper, only: stepper, reached
  use, intrinsic :: iso_fortran_env, only: error_unit
  implicit none (type, external)

  interface
    !> Solves with the factor of dpbtrf.
    subroutine dpbtrs(uplo, n, kd, nrhs, ab, ldab, b, ldb, info)
      import :: wp
      character, intent(in) :: uplo
      integer, intent(in) :: n, kd, nrhs, ldab, ldb
      real(wp), intent(in) :: ab(ldab, *)   !! factor [any]
      real(wp), intent(inout) :: b(ldb, *)  !! right-hand sides, then solutions [any]
      integer, intent(out) :: info
    end subroutine dpbtrs
    !> y = alpha A x + beta y for a symmetric band matrix.
    subroutine dsbmv(uplo, n, k, alpha, a, lda, x, incx, beta, y, incy)
      import :: wp
      character, intent(in) :: uplo
      integer, intent(in) :: n, k, lda, incx, incy
      real(wp), intent(in) :: alpha, beta, a(lda, *), x(*)   !! [any]
      real(wp), intent(inout) :: y(*)                        !! [any]
    end subroutine dsbmv
  end interface

  integer, parameter :: repetitions = 9
  type(run_state) :: run
  real(wp) :: seconds(repetitions)           !! of each repetition [s]
  integer :: steps
  logical :: dense

  call read_arguments()
  call use_one_blas_thread()
  call time_start_up()
  call time_steps()
  call show_memory()
  call time_parts()
  call time_rows()
  call time_floor()
  if (dense) call time_dense()

contains

  !> The deck and the number of steps of one repetition.
  subroutine read_arguments()
    type(fault_list) :: faults
    character(512) :: path, number
    call get_command_argument(1, path)
    call get_command_argument(2, number)
    read (number, *) steps
    dense = command_argument_count() > 2
    call read_deck(trim(path), run%d, faults)
    if (faults%count == 0) return
    call faults%print()
    error stop 2, quiet=.true.
  end subroutine read_arguments

  !> Processor time of this process, which has one thread [s]: what others on the machine do counts as little as it can.
  real(wp) function clock()
    call cpu_time(clock)
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
    if (faults%count > 0) call faults%print()
    if (fail%happened()) write (error_unit, '(a)') fail%message
    if (faults%count > 0 .or. fail%happened()) error stop 2, quiet=.true.
    call show('set_up', 1)
    associate (s => run%sys%m%s)
      write (*, '(a, i0)') 'coordinates ', s%nq, 'dissipative ', s%nz, 'rows ', s%rows, 'band ', run%sys%ev%schur%kd
    end associate
  end subroutine time_start_up

  !> Whole steps of the deck's method, as the transient makes them.
  subroutine time_steps()
    class(stepper), allocatable :: march
    real(wp), allocatable :: y(:)
    real(wp) :: h
    integer :: r, outcome
    h = steps*run%d%transient%step
    call make_stepper(run%d%transient, run%sys%m%s, 0.0_wp, march)    ! steps are fixed: no frequency is needed
    if (.not. allocated(march)) error stop 'the method is not offered'
    y = run%y
    call march%begin(run%sys, 0.0_wp, y)
    do r = 1, repetitions
      seconds(r) = -clock()
      call march%advance(run%sys, (r - 1)*h, r*h, 2*steps, y, outcome)
      seconds(r) = seconds(r) + clock()
      if (outcome /= reached) error stop 'the benchmark scene diverged'
    end do
    run%y = y
    call show('step', steps)
  end subroutine time_steps

  !> Peak memory of the process so far [kB], where the system tells.
  subroutine show_memory()
    character(80) :: line
    integer :: unit, status
    open (newunit=unit, file='/proc/self/status', action='read', status='old', iostat=status)
    if (status /= 0) return
    do
      read (unit, '(a)', iostat=status) line
      if (status /= 0) exit
      if (line(1:6) == 'VmHWM:') write (*, '(2a)') 'memory ', trim(adjustl(line(7:index(line, 'kB') - 1)))
    end do
    close (unit)
  end subroutine show_memory

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
    zd = run%y(2*nq + nz + 1:2*nq + nz + run%sys%m%s%nzd)
    do r = 1, repetitions
      seconds(r) = -clock()
      do i = 1, steps
        call evaluate(run%sys%m, run%sys%ev, run%sys%options, 0.0_wp, q0, v0, z, zd)
      end do
      seconds(r) = seconds(r) + clock()
    end do
    call show('right_hand_side', steps)
    do r = 1, repetitions
      seconds(r) = -clock()
      do i = 1, steps
        do b = 1, size(run%sys%m%s%bodies)
          associate (body => run%sys%m%s%bodies(b), w => run%sys%ev%elastic(b))
            if (.not. body%flexible) cycle
            w%force(1:) = body%shape%c0
            w%coupling(1:) = body%shape%i1f
            call body%basis%solve_mass(body%nf, run%sys%ev%work, w%force(1:), w%coupling(1:))
          end associate
        end do
      end do
      seconds(r) = seconds(r) + clock()
    end do
    call show('solve', steps)
    call evaluate(run%sys%m, run%sys%ev, run%sys%options, 0.0_wp, q0, v0, z, zd)
    do r = 1, repetitions
      seconds(r) = -clock()
      do i = 1, steps
        q = q0*(1 + 1.0e-10_wp)
        v = v0*(1 + 1.0e-10_wp)
        call project(run%sys%m, run%sys%ev, run%sys%options, 0.0_wp, q, v, z, zd, ok)
      end do
      seconds(r) = seconds(r) + clock()
    end do
    call show('projection', steps)
  end subroutine time_parts

  !> Rows of history and energy.
  subroutine time_rows()
    type(result_set) :: files
    type(balance_watch) :: balance
    integer :: r, i, nq, nz
    nq = run%sys%m%s%nq
    nz = run%sys%m%s%nz
    call files%open('.', 'bench', run%sys%m, run%list, .false.)
    call balance%begin(run%sys%m, 1.0_wp)
    do r = 1, repetitions
      seconds(r) = -clock()
      do i = 1, steps
        call read_sensors(run%list, run%sys%m, run%sys%ev, run%y, files%values)
        call balance%read(run%sys%m, run%sys%ev, run%y, i == 1)
        call balance%count(int(i, ip))
        call files%write_row(0.0_wp, balance%row)
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
    if (run%sys%ev%factorisations == 0) return
    seconds = 0.0_wp
    do b = 1, size(run%sys%m%s%bodies)
      associate (body => run%sys%m%s%bodies(b))
        if (.not. body%flexible) cycle
        if (body%basis%factors == 0) cycle
        call mass_band(body, ab, kd)
        n = body%nf
        call dpbtrf('L', n, kd, ab, kd + 1, info)
        x = body%shape%c0
        y = body%shape%i1f
        do r = 1, repetitions
          seconds(r) = seconds(r) - clock()
          do i = 1, steps
            do k = 1, 2
              x = body%shape%c0
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
  subroutine mass_band(body, ab, kd)
    type(body_model), intent(in) :: body
    real(wp), allocatable, intent(out) :: ab(:, :)
    integer, intent(out) :: kd
    integer :: k
    associate (pattern => body%op%symmetric)
      kd = maxval(abs(pattern%row - pattern%col))
      allocate (ab(0:kd, body%nf), source=0.0_wp)
      do k = 1, size(pattern%row)
        if (pattern%row(k) >= pattern%col(k)) ab(pattern%row(k) - pattern%col(k), pattern%col(k)) = body%op%m(k) + body%op%j(k)
      end do
    end associate
  end subroutine mass_band

  !> The paper's way, one flexible body: M_G, C_G and K_G (VRL 31) of the coordinates, the dissipative coordinates and the
  !> constraint rows; four times a step the matrices are assembled, C_G v and K_G q subtracted, and DGESV called.
  subroutine time_dense()
    real(wp), allocatable :: mass(:, :), stiff(:, :), m(:, :), c(:, :), k(:, :), x(:), y(:)
    integer, allocatable :: pivot(:)
    real(wp) :: t
    integer :: r, i, n, f, calls, stage
    associate (body => run%sys%m%s%bodies(1), rows => run%sys%m%s%rows)
      f = body%nf
      n = 3 + f*(1 + terms(body)) + rows
      call dense_matrices(body, mass, stiff)
      allocate (m(n, n), c(n, n), k(n, n), x(n), y(n), pivot(n))
      y = 1.0e-3_wp
      calls = 0
      t = -clock()
      do while (t + clock() < 0.2_wp .or. calls == 0)
        calls = calls + 1
        call dense_stage(mass, stiff, y, m, c, k, x, pivot)
      end do
      calls = max(1, calls/repetitions)
      do r = 1, repetitions
        seconds(r) = -clock()
        do i = 1, calls
          do stage = 1, 4
            call dense_stage(mass, stiff, y, m, c, k, x, pivot)
          end do
        end do
        seconds(r) = seconds(r) + clock()
      end do
      call show('dense', calls)
    end associate
  end subroutine time_dense

  !> Assembles and solves once.
  subroutine dense_stage(mass, stiff, y, m, c, k, x, pivot)
    real(wp), intent(in) :: mass(:, :), stiff(:, :), y(:)
    real(wp), intent(inout) :: m(:, :), c(:, :), k(:, :), x(:)
    integer, intent(inout) :: pivot(:)
    integer :: info
    call augment(run%sys%m%s%bodies(1), run%sys%m%s%rows, mass, stiff, m, c, k)
    x = 1.0_wp - matmul(c, y) - matmul(k, y)
    call dgesv(size(x), 1, m, size(x), pivot, x, size(x), info)
    if (info /= 0) error stop 'the dense augmented system is singular'
  end subroutine dense_stage

  !> GHM terms of a body whose elements share one material.
  pure integer function terms(body)
    type(body_model), intent(in) :: body
    terms = 0
    if (size(body%segments) > 0) terms = body%segments(1)%law%second
  end function terms

  !> m_ff and K_ff as full matrices.
  subroutine dense_matrices(body, mass, stiff)
    type(body_model), intent(in) :: body
    real(wp), allocatable, intent(out) :: mass(:, :), stiff(:, :)
    integer :: k
    allocate (mass(body%nf, body%nf), stiff(body%nf, body%nf), source=0.0_wp)
    associate (op => body%op)
      do k = 1, size(op%m)
        mass(op%symmetric%row(k), op%symmetric%col(k)) = op%m(k) + op%j(k)
        stiff(op%symmetric%row(k), op%symmetric%col(k)) = op%k(k)
      end do
    end associate
  end subroutine dense_matrices

  !> The augmented matrices at the undeformed state, frame in body axes, constraint rows as a border.
  subroutine augment(body, rows, mass, stiff, m, c, k)
    type(body_model), intent(in) :: body
    integer, intent(in) :: rows
    real(wp), intent(in) :: mass(:, :), stiff(:, :)
    real(wp), intent(out) :: m(:, :), c(:, :), k(:, :)
    integer :: f, j, o, i
    f = body%nf
    m = 0.0_wp
    c = 0.0_wp
    k = 0.0_wp
    m(1, 1) = body%mass
    m(2, 2) = body%mass
    m(3, 3) = body%i11
    m(3, 1:2) = [-body%i1(2), body%i1(1)]
    m(1:2, 3) = m(3, 1:2)
    m(4:3 + f, 1:2) = body%shape%sbar
    m(4:3 + f, 3) = body%shape%c0
    m(1:2, 4:3 + f) = transpose(body%shape%sbar)
    m(3, 4:3 + f) = body%shape%c0
    m(4:3 + f, 4:3 + f) = mass
    k(4:3 + f, 4:3 + f) = stiff
    do j = 1, terms(body)
      o = 3 + j*f
      associate (run => body%segments(1)%law)
        m(o + 1:o + f, o + 1:o + f) = run%alpha(j)*run%inertia(j)*stiff
        c(o + 1:o + f, o + 1:o + f) = run%alpha(j)*run%viscosity(j)*stiff
        k(o + 1:o + f, o + 1:o + f) = run%alpha(j)*stiff
        k(4:3 + f, o + 1:o + f) = -run%alpha(j)*stiff
        k(o + 1:o + f, 4:3 + f) = -run%alpha(j)*stiff
        k(4:3 + f, 4:3 + f) = k(4:3 + f, 4:3 + f) + run%alpha(j)*stiff
      end associate
    end do
    o = 3 + f*(1 + terms(body))
    do i = 1, rows                             ! rows on the frame's own coordinates
      m(o + i, i) = 1.0_wp
      m(i, o + i) = 1.0_wp
    end do
  end subroutine augment
end program bench
