!> The solver's inside for the tests: coordinates, accelerations, multipliers, energies at states given on standard input.
!> probe layout DECK | probe evaluate DECK < states (a line each: t, q, v, z, z') | probe linear DECK < states: the same
!> and the matrices of the linearisation. | probe completeness DECK: what a modal analysis says that knows its k-th mode not, for
!> k = 1 to the number asked for. | probe error DECK: radau's estimated error of a step `first_step`. | probe numbers < bit
!> patterns of reals as integers: each as result files show it.
program probe
  use kinds, only: wp
  use choose_stepper, only: make_stepper
  use complex_modes, only: find_modes
  use decimal, only: number_width, write_number
  use deck_reader, only: read_deck
  use dynamic_stiffness, only: stiffness_system
  use energy, only: energies
  use errors, only: failure, fault_list
  use scene_run, only: run_state, prepare_run
  use dynamics, only: row_rates
  use linear_matrices, only: linear_mechanism
  use linear_state, only: linear_system
  use linearisation, only: linearise
  use mode_list, only: check_undamped, say_what_is_missing, mode_set, undamped_mode
  use radau_stepper, only: radau_march
  use time_stepper, only: stepper
  use triplets, only: triplet_matrix
  use, intrinsic :: iso_fortran_env, only: error_unit, input_unit, int64, iostat_end
  implicit none (type, external)
  type(run_state) :: run
  type(fault_list) :: faults
  type(failure) :: fail
  character(512) :: word, path
  call get_command_argument(1, word)
  if (word == 'numbers') then
    call numbers()
    stop
  end if
  call get_command_argument(2, path)
  call read_deck(trim(path), run%d, faults)
  if (faults%count == 0) call prepare_run(run, faults, fail)
  if (faults%count > 0) then
    call faults%print()
    error stop 2, quiet=.true.
  end if
  if (fail%happened()) then
    write (error_unit, '(a)') fail%message
    error stop 2, quiet=.true.
  end if
  if (word == 'layout') then
    call layout()
  else if (word == 'completeness') then
    call completeness()
  else if (word == 'error') then
    call estimated_error()
  else
    call evaluate_all()
  end if

contains

  !> Reals, given by their bits, as result files show them.
  subroutine numbers()
    character(number_width) :: text
    integer(int64) :: bits
    integer :: status
    do
      read (input_unit, *, iostat=status) bits
      if (status /= 0) exit
      call write_number(transfer(bits, 1.0_wp), text)
      write (*, '(a)') text
    end do
  end subroutine numbers

  !> Sizes, offsets and meanings of the unknowns.
  subroutine layout()
    integer :: b, r, k, e, i, at(2)
    associate (s => run%sys%m%s)
      write (*, '(a, i0)') 'coordinates ', s%nq, 'dissipative ', s%nz, 'rows ', s%rows
      do b = 1, size(s%bodies)
        write (*, '(3a, i0, a, i0)') 'body ', trim(s%bodies(b)%name), ' ', s%qo(b) + 1, ' ', s%bodies(b)%nf
      end do
      do b = 1, size(s%bodies)
        associate (body => s%bodies(b))
          do r = 1, size(body%segments)
            do k = 1, body%segments(r)%law%second
              if (body%basis%reduced_from > 0) then
                do i = 1, body%nf
                  write (*, '(3a, 3(1x, i0))') 'z mode ', trim(body%name), ' ', i, r, k
                end do
              else
                do e = body%segments(r)%first, body%segments(r)%last
                  at = [3, e]
                  if (.not. body%layers%shown) at = findloc(body%layers%row, e) + [3 - size(body%layers%row, 1), 0]
                  write (*, '(2a, 3(1x, i0))') 'z element ', trim(body%name), at([2, 1]), k
                end do
              end if
            end do
          end do
        end associate
      end do
      do i = 1, s%springs
        do k = 1, s%forces(i)%item%law%second
          write (*, '(2a, 1x, i0)') 'z spring ', trim(s%forces(i)%item%name), k
        end do
      end do
      do i = 1, size(s%constraints)
        do k = 1, s%constraints(i)%item%rows
          write (*, '(a, i0, 2a)') 'row ', s%constraints(i)%item%first + k - 1, ' ', trim(s%constraints(i)%item%name)
        end do
      end do
      call show('initial', run%y(1:s%nq))
      call show('initial', run%y(s%nq + 1:2*s%nq))
    end associate
  end subroutine layout

  !> The error of the first step, from internal variables 0.1 beyond their deformations and with rates of 0.1, in the layout of the
  !> state, and over what is allowed.
  subroutine estimated_error()
    class(stepper), allocatable :: march
    real(wp) :: error
    logical :: ok
    call make_stepper(run%d%transient, run%sys%m%s, 0.0_wp, march)
    associate (s => run%sys%m%s)
      run%y(2*s%nq + 1:2*s%nq + s%nz + s%nzd) = run%y(2*s%nq + 1:2*s%nq + s%nz + s%nzd) + 0.1_wp
    end associate
    call march%begin(run%sys, 0.0_wp, run%y)
    march%tried = run%d%transient%first_step
    select type (march)
    type is (radau_march)
      call march%try_step(run%sys, march%tried, ok)
      call march%measure_step(run%sys, error)
      call show('error', march%stages%work%e)
    end select
    write (*, '(a, es24.16)') 'allowed', error
  end subroutine estimated_error

  !> The count and the verdict with each undamped mode left out of the list in turn.
  subroutine completeness()
    type(stiffness_system) :: ds
    type(mode_set) :: modes
    character(:), allocatable :: words
    integer :: k
    logical :: ok, failed
    call linear_system(run, ds)
    call find_modes(ds, run%d%modal%modes + 1, modes, ok)
    do k = 0, run%d%modal%modes
      call check_undamped(ds, .false., pack(modes%lambda, modes%kind == undamped_mode .and. modes%mode /= k), modes)
      call say_what_is_missing(modes, failed, words)
      write (*, '(l1, 1x, a)') failed, words
    end do
  end subroutine completeness

  !> Evaluates every state of the input.
  subroutine evaluate_all()
    real(wp), allocatable :: y(:), dy(:), rate(:), strain(:)
    real(wp) :: t, kinetic, potential
    integer :: status, nq, nz, nzd
    nq = run%sys%m%s%nq
    nz = run%sys%m%s%nz
    nzd = run%sys%m%s%nzd
    allocate (y(run%sys%n), dy(run%sys%n), rate(run%sys%m%s%rows), strain(size(run%sys%m%s%bodies)), source=0.0_wp)
    do
      read (input_unit, *, iostat=status) t, y(1:2*nq + nz + nzd)
      if (status /= 0) exit
      call run%sys%derivative(t, y, .false., dy)
      associate (m => run%sys%m, ev => run%sys%ev)
        call row_rates(m, ev, rate)
        call show('acceleration', ev%a)
        call show('zdd', ev%zdd)
        call show('multipliers', ev%lambda)
        call show('phi', ev%rows%phi)
        call show('phidot', rate)
        call gamma(m%s%rows)
        call jacobian()
        call energies(m, ev, y(1:nq), y(nq + 1:2*nq), y(2*nq + 1:2*nq + nz), y(2*nq + nz + 1:2*nq + nz + nzd), kinetic, &
                      potential, strain)
        call show('energy', [kinetic, potential])
        call show('power', [ev%dissipated_power + sum(ev%loss), ev%input_power])
      end associate
      if (word == 'linear') call matrices(y)
      write (*, '(a)') 'end'
    end do
  end subroutine evaluate_all

  !> Dense matrices of the linearisation, column by column.
  subroutine matrices(y)
    real(wp), intent(in) :: y(:)
    type(linear_mechanism) :: lin
    real(wp), allocatable :: dy(:)
    integer :: nq, r
    nq = run%sys%m%s%nq
    allocate (dy(size(y)))
    call run%sys%derivative(run%sys%ev%t, y, .false., dy)
    associate (m => run%sys%m, ev => run%sys%ev)
      call linearise(m, ev, y(1:nq), y(nq + 1:2*nq), ev%a, ev%lambda, ev%action, lin)
    end associate
    call matrix('mass', lin%mass, nq)
    call matrix('damping', lin%damping, nq)
    call matrix('stiffness', lin%stiffness, nq)
    call matrix('rows', lin%jacobian, lin%rows)
    do r = 1, size(lin%segments)
      associate (law => lin%segments(r)%law)
        call show('run', [law%alpha, 0.5_wp*law%viscosity/sqrt(law%inertia), 1/sqrt(law%inertia)])   ! alpha, zeta, omega
      end associate
      call matrix('run_stiffness', lin%segments(r)%stiffness, nq)
    end do
  end subroutine matrices

  !> One dense matrix.
  subroutine matrix(name, a, rows)
    character(*), intent(in) :: name
    type(triplet_matrix), intent(in) :: a
    integer, intent(in) :: rows
    real(wp) :: d(rows, run%sys%m%s%nq)
    integer :: k
    d = 0.0_wp
    do k = 1, a%count
      d(a%rows(k), a%cols(k)) = d(a%rows(k), a%cols(k)) + a%values(k)
    end do
    call show(name, reshape(d, [size(d)]))
  end subroutine matrix

  !> gamma of Phi_q a = gamma.
  subroutine gamma(n)
    integer, intent(in) :: n
    real(wp) :: g(n)
    integer :: k, i
    associate (m => run%sys%m, ev => run%sys%ev, r => run%sys%ev%rows)
      do k = 1, size(m%s%constraints)
        associate (c => m%s%constraints(k)%item)
          do i = c%first, c%first + c%rows - 1
            g(i) = -(r%acceleration_bias(i) + dot_product(r%na(:, i), ev%p%bias(:, c%ia)) + dot_product(r%nb(:, i), ev%p%bias(:, &
                c%ib)))
          end do
        end associate
      end do
    end associate
    call show('gamma', g)
  end subroutine gamma

  !> Phi_q row by row.
  subroutine jacobian()
    real(wp), allocatable :: j(:, :)
    integer :: k, i
    allocate (j(run%sys%m%s%nq, run%sys%m%s%rows), source=0.0_wp)
    associate (m => run%sys%m, ev => run%sys%ev, r => run%sys%ev%rows)
      do k = 1, size(m%s%constraints)
        associate (c => m%s%constraints(k)%item)
          do i = c%first, c%first + c%rows - 1
            call marker_gradient(c%ia, r%na(:, i), r%sa(i), j(:, i))
            call marker_gradient(c%ib, r%nb(:, i), r%sb(i), j(:, i))
            if (c%ic > 0) call marker_gradient(c%ic, [0.0_wp, 0.0_wp], r%sc(i), j(:, i))
          end do
        end associate
      end do
    end associate
    call show('jacobian', reshape(j, [size(j)]))
  end subroutine jacobian

  !> Adds a unit wrench on a marker as generalised forces.
  subroutine marker_gradient(p, n, s, j)
    integer, intent(in) :: p
    real(wp), intent(in) :: n(2), s
    real(wp), intent(inout) :: j(:)
    real(wp) :: w(3)
    integer :: b, i, k
    associate (m => run%sys%m, ev => run%sys%ev, marker => run%sys%m%s%markers(p))
      b = marker%body
      if (b == 0) return
      i = m%s%qo(b)
      w = [ev%frame%cos(b)*n(1) + ev%frame%sin(b)*n(2), -ev%frame%sin(b)*n(1) + ev%frame%cos(b)*n(2), s]
      j(i + 1:i + 2) = j(i + 1:i + 2) + n
      j(i + 3) = j(i + 3) + s + ev%p%rho(1, p)*w(2) - ev%p%rho(2, p)*w(1)
      if (allocated(marker%psi)) then
        j(i + 4:i + 3 + m%s%bodies(b)%nf) = j(i + 4:i + 3 + m%s%bodies(b)%nf) + matmul(w, marker%psi)
      else
        do k = 1, 3
          if (marker%dof(k) > 0) j(i + 3 + marker%dof(k)) = j(i + 3 + marker%dof(k)) + w(k)
        end do
      end if
    end associate
  end subroutine marker_gradient

  !> A named line of numbers.
  subroutine show(name, x)
    character(*), intent(in) :: name
    real(wp), intent(in) :: x(:)
    write (*, '(a, *(1x, es24.16e3))') name, x
  end subroutine show
end program probe
