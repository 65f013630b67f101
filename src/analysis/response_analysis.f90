!> The frequency response about the present state: the exact dynamic stiffness with the complex modulus, one structured
!> factorisation a frequency, into frequency_response.txt.
module response_analysis
  use kinds, only: wp, pi
  use closed_loops, only: loop_system
  use result_columns, only: result_column
  use dynamic_stiffness, only: stiffness_system
  use errors, only: failure, status_failed
  use held_friction, only: tell_friction
  use linear_state, only: linear_system, refuse_uneven
  use present_state, only: warn_of_motion
  use linearisation, only: marker_jacobian
  use loop_analysis, only: tell_limits
  use material_band, only: outside_band
  use evaluation_results, only: conditions_of
  use scene_run, only: run_state, no_output, stop_if_signalled
  use sensor, only: harmonic_motion
  use sensors, only: read_sensors, read_linear_sensors
  use summary_text, only: summary_record
  use text, only: joined, to_text
  use text_file, only: result_file
  implicit none (type, external)
  private
  public :: run_response

contains

  !> Runs the deck's frequency response.
  subroutine run_response(run, text, fail)
    type(run_state), intent(inout) :: run
    type(summary_record), intent(inout) :: text   !! the summary
    type(failure), intent(inout) :: fail
    type(stiffness_system) :: ds
    type(loop_system) :: loops
    type(result_file) :: file
    complex(wp), allocatable :: values(:)
    real(wp), allocatable :: now(:)
    integer :: k
    real(wp) :: f
    logical :: exists, frozen
    call run%sys%hold_rows(run%y, run%d%response%friction /= 'held')
    call linear_system(run, ds, loops)
    call refuse_uneven(run, 'frequency response', status_failed, fail)
    if (fail%happened()) return
    allocate (values(run%list%columns), now(run%list%columns))
    associate (r => run%d%response, y => run%y)
      if (r%drive > 0) call check_drive(run, ds, fail)
      if (fail%happened()) return
      call read_sensors(run%list, run%sys%m, run%sys%ev, y, now)
      call file%open(run%folder//'/frequency_response.txt')
      call write_header(run, file)
      do k = 1, r%points
        call stop_if_signalled('frequency response', fail)
        if (fail%happened()) exit
        f = frequency(run, k)
        call respond(run, ds, loops, cmplx(0.0_wp, 2*pi*f, wp), values, exists)
        if (.not. (exists .and. all(abs(values) <= huge(1.0_wp)))) then
          call fail%raise(status_failed, 'the frequency response is singular at '//to_text(f)//' Hz: an undamped mode '// &
                          'or a free motion lies there; expected damping or other frequencies')
          exit
        end if
        call file%row([f, columns(values)])
      end do
      call file%close()
    end associate
    if (file%failed) call no_output(run, fail)
    call text%section('frequency_response', 'frequency response')
    call tell_friction(run, text)
    call text%line('  input: {input='//input_name(run)//'}, points: {points #}, matrices: {matrices_kb #} kB', &
                   [real(wp) :: k - 1, ds%solver%memory()/1024])
    call text%close()
    if (.not. run%d%modal%present) then
      call warn_of_motion(run, text, frozen)
      call tell_limits(run, text)
    end if
    call text%warn(outside_band(run, 'frequencies of the response', [(frequency(run, k), k=1, run%d%response%points)]))
    run%fastest = max(run%fastest, 2*pi*run%d%response%to)
  end subroutine run_response

  !> A drive whose row was left out as redundant cannot excite the linear system; nor can a constant rate be a small motion.
  subroutine check_drive(run, ds, fail)
    type(run_state), intent(in) :: run
    type(stiffness_system), intent(in) :: ds
    type(failure), intent(inout) :: fail
    associate (d => run%d%drives(run%d%response%drive), s => run%sys%m%s)
      if (.not. any(ds%active == s%constraints(s%joints + run%d%response%drive)%item%first)) then
        call fail%raise(status_failed, 'drive "'//trim(d%name)//'" is redundant at the present position and cannot be '// &
                        'the input of a frequency response')
      end if
      if (d%rate .and. .not. run%d%response%from > 0.0_wp) then
        call fail%raise(status_failed, 'drive "'//trim(d%name)//'" is driven by its rate, whose response at 0 Hz is '// &
                        'unbounded; expected from > 0')
      end if
    end associate
  end subroutine check_drive

  !> The k-th frequency [Hz].
  pure real(wp) function frequency(run, k) result(f)
    type(run_state), intent(in) :: run
    integer, intent(in) :: k
    real(wp) :: part
    associate (r => run%d%response)
      part = real(k - 1, wp)/real(r%points - 1, wp)
      if (k == r%points) then
        f = r%to
      else if (r%spacing == 'log') then
        f = r%from*(r%to/r%from)**part
      else
        f = r%from + (r%to - r%from)*part
      end if
    end associate
  end function frequency

  !> Amplitudes of all sensors at one s.
  subroutine respond(run, ds, loops, s, values, exists)
    type(run_state), intent(inout) :: run
    type(stiffness_system), intent(inout) :: ds
    type(loop_system), intent(in) :: loops
    complex(wp), intent(in) :: s                       !! [1/s]
    complex(wp), intent(out) :: values(:)              !! (columns) [unit of each column]
    logical, intent(out) :: exists                     !! there is a finite response
    complex(wp), allocatable :: x(:), lambda(:)        ! [m, rad], right-hand side before [N, N m], [m]; [N]
    type(harmonic_motion) :: motion
    integer, allocatable :: cols(:)
    real(wp), allocatable :: jac(:, :), part(:, :)
    integer :: k
    allocate (x(ds%n + ds%rows), lambda(run%sys%m%s%rows), source=(0.0_wp, 0.0_wp))
    associate (m => run%sys%m, ev => run%sys%ev, r => run%d%response)
      if (r%drive > 0) then                            ! a unit amplitude of what it follows, or of a load's history
        associate (c => m%s%constraints(m%s%joints + r%drive)%item)
          x(ds%n + findloc(ds%active, c%first, 1)) = c%weight()/merge(s, (1.0_wp, 0.0_wp), c%rate)
        end associate
      else
        k = m%s%springs + r%force
        associate (f => m%s%forces(k)%item)
          call marker_jacobian(m, ev, f%ia, cols, jac)
          motion%marker = f%ia
          motion%wrench = f%unit_wrench(ev%p, conditions_of(m, ev, k))
          x(cols) = matmul(real(motion%wrench, wp), jac)
        end associate
      end if
    end associate
    call loops%factor_closed(ds, s, 0)
    call ds%solve(x, exists=exists)
    lambda(ds%active) = x(ds%n + 1:)
    if (size(ds%active) < size(lambda)) then           ! redundant joints share reactions as in the time domain: least multipliers
      part = reshape([lambda%re, lambda%im], [size(lambda), 2])
      do k = 1, 2
        call run%sys%ev%schur%minimum_norm_equivalent(part(:, k))
      end do
      lambda = cmplx(part(:, 1), part(:, 2), wp)
    end if
    motion%s = s
    motion%x = x(1:ds%n)
    motion%lambda = lambda
    call read_linear_sensors(run%list, run%sys%m, run%sys%ev, run%y, motion, values)
  end subroutine respond

  !> Name of the input.
  function input_name(run) result(text)
    type(run_state), intent(in) :: run
    character(:), allocatable :: text
    if (run%d%response%drive > 0) then
      text = 'drive "'//trim(run%d%drives(run%d%response%drive)%name)//'"'
    else
      text = 'force "'//trim(run%d%forces(run%d%response%force)%name)//'"'
    end if
  end function input_name

  !> First lines of the file.
  subroutine write_header(run, file)
    type(run_state), intent(in) :: run
    type(result_file), intent(inout) :: file
    type(result_column) :: columns(4*run%list%columns)
    integer :: k
    call file%head('frequency response of the sensors about the present state', run%d%name, run%sys%m%s%title)
    call file%line('# input: '//input_name(run)//'; peak amplitude per unit of its history, phase ahead of it (-pi to pi)')
    do k = 1, run%list%columns
      associate (x => run%list%column(k))
        columns(4*k - 3:4*k) = [x%part('.re'), x%part('.im'), x%part('.amplitude'), x%part('.phase', 'rad')]
      end associate
    end do
    call file%line('# columns: f[Hz] '//joined(columns%label(), ' '))
  end subroutine write_header

  !> Real and imaginary part, amplitude and phase of every column.
  pure function columns(values) result(row)
    complex(wp), intent(in) :: values(:)   !! (columns) [unit of each column]
    real(wp) :: row(4*size(values))
    integer :: k
    do k = 1, size(values)
      row(4*k - 3) = values(k)%re
      row(4*k - 2) = values(k)%im
      row(4*k - 1) = abs(values(k))
      row(4*k) = atan2(values(k)%im, values(k)%re)
    end do
  end function columns
end module response_analysis
