!> Closed loops of a modal analysis: all poles into poles.txt, whether they grow, and the margins of each loop when it is opened.
!> Before a transient: whether a vibration grows by them.
module loop_analysis
  use kinds, only: wp, pi
  use closed_loops, only: loop_system, most_states
  use dynamic_stiffness, only: stiffness_system
  use errors, only: failure, status_failed
  use linear_state, only: linear_system
  use own_files, only: remove_own
  use scene_run, only: run_state, no_output, stop_if_signalled
  use sorting, only: ascending
  use summary_text, only: summary_record
  use text, only: either, joined, to_text
  use text_file, only: result_file
  implicit none (type, external)
  private
  public :: run_loops, tell_limits, warn_of_loops

  integer, parameter :: per_decade = 40                !! frequencies at which margins are looked for
  real(wp), parameter :: negligible = 1.0e-9_wp        !! modulus of a rigid motion's pole, over the largest [-]
  real(wp), parameter :: growing = 1.0e-10_wp          !! real part of a pole that grows, over the modulus: below is rounding [-]

contains

  !> Warns of a vibration that loops make grow in the run, about the state as assembled: steps would follow it until limits or
  !> friction hold it. Friction is left out, since a joint at rest hides its loop. Motions that fall over without vibrating are left
  !> to the run, and held outputs to their samples.
  subroutine warn_of_loops(run, text)
    type(run_state), intent(inout) :: run
    type(summary_record), intent(inout) :: text
    type(stiffness_system) :: ds
    type(loop_system) :: loops
    complex(wp), allocatable :: lambda(:)              ! [1/s]
    integer :: states, k
    logical :: ok
    associate (s => run%sys%m%s)
      if (size(s%controllers) == 0 .or. run%d%modal%present .or. .not. run%d%transient%present) return
      if (any(s%controllers%sample > 0.0_wp)) return
      call run%sys%hold_rows(run%y, free=.true.)
      call linear_system(run, ds)
      call loops%build(run%sys%m, run%sys%ev, run%y(s%nq + 1:2*s%nq))
    end associate
    call loops%poles(ds, 0, lambda, states, ok)
    if (.not. ok) return
    lambda = pack(lambda, lambda%im > abs(lambda%re) .and. lambda%re*run%d%transient%t_end > 1.0_wp)
    if (size(lambda) == 0) return
    k = maxloc(lambda%re, 1)
    call text%warn('controllers make a vibration of '//to_text(lambda(k)%im/(2*pi))//' Hz grow by '//to_text(lambda(k)%re)// &
              ' 1/s, as assembled and with joints free of friction: steps will follow it; &modal friction=''free'' tells poles '// &
              'and margins')
  end subroutine warn_of_loops

  !> Poles and margins.
  subroutine run_loops(run, ds, text, fail)
    type(run_state), intent(inout) :: run
    type(stiffness_system), intent(inout) :: ds
    type(summary_record), intent(inout) :: text
    type(failure), intent(inout) :: fail
    type(loop_system) :: loops
    type(result_file) :: file
    complex(wp), allocatable :: lambda(:)
    integer :: states, k, grow
    logical :: ok
    call remove_own(run%folder//'/poles.txt')
    if (size(run%sys%m%s%controllers) == 0 .or. fail%happened()) return
    associate (nq => run%sys%m%s%nq)
      call loops%build(run%sys%m, run%sys%ev, run%y(nq + 1:2*nq))
    end associate
    call loops%poles(ds, 0, lambda, states, ok)
    if (.not. ok) call fail%raise(status_failed, 'the poles of the closed loops cannot be computed: the '// &
                                 'eigenvalues do not converge')
    if (fail%happened()) return
    call text%section('closed_loops', 'closed loops')
    call text%say('  states: {states #}', [real(wp) :: states])
    if (states > most_states) then
      call text%line(', more than '//to_text(most_states)//': stability not decided')
      call text%close()
      call text%warn('stability not decided: '//to_text(states)//' states, all poles are computed of up to '// &
                to_text(most_states)//'; expected fewer coordinates (modes=, fewer elements)')
      return
    end if
    grow = sum(merge(2, 1, lambda%im > 0.0_wp), lambda%re > growing*abs(lambda) .and. &
                                                abs(lambda) > negligible*maxval(abs(lambda)))
    call text%line(', all poles computed; growing: {growing #}', [real(wp) :: grow])
    call file%open(run%folder//'/poles.txt')
    call file%head('poles of the closed loops about the present state', run%d%name, run%sys%m%s%title)
    call file%line('# all of them, one of each conjugate pair')
    call file%line('# columns: frequency[Hz] damping_ratio[-] real[1/s] imag[rad/s]')
    do k = 1, size(lambda)
      call file%row([lambda(k)%im/(2*pi), -lambda(k)%re/max(abs(lambda(k)), tiny(1.0_wp)), lambda(k)%re, lambda(k)%im])
    end do
    call file%close()
    if (file%failed) call no_output(run, fail)
    if (grow > 0) call text%line('  no margins: a closed loop is unstable')
    call text%open('margins', '[')
    do k = 1, merge(0, loops%n, grow > 0)
      call stop_if_signalled('modal analysis', fail)
      if (fail%happened()) exit
      call margins(loops, ds, k, lambda, text)
    end do
    call text%close()
    call text%close()
    call tell_limits(run, text)
    if (grow > 0) call text%warn('a closed loop is unstable: '//to_text(grow)//' of the poles '// &
                            either('grows', 'grow', grow == 1)//' (poles.txt)')
  end subroutine run_loops

  !> Warns of controllers that are at a limit in the evaluated state: there they do not answer to small motions.
  subroutine tell_limits(run, text)
    type(run_state), intent(in) :: run
    type(summary_record), intent(inout) :: text
    character(32), allocatable :: names(:)
    associate (s => run%sys%m%s, ev => run%sys%ev)
      names = pack(s%controllers%name, ev%control%limited /= 0)
    end associate
    if (size(names) > 0) call text%warn('at a limit in the present state: controllers '//joined(names, ', ')// &
                                   '; poles, margins and responses are those of loops without limits')
  end subroutine tell_limits

  !> Gain and phase margin of one loop of stable ones, opened: where the open loop is real and negative, the gain nearest to 1 on
  !> either side; where its size is 1, the least lag that takes it to -1. Searched at frequencies around all poles, with that loop
  !> closed and opened: the open loop is steep at its own poles.
  subroutine margins(loops, ds, c, lambda, text)
    type(loop_system), intent(in) :: loops
    type(stiffness_system), intent(inout) :: ds
    integer, intent(in) :: c                           !! controller
    complex(wp), intent(in) :: lambda(:)               !! all poles [1/s]
    type(summary_record), intent(inout) :: text
    real(wp), allocatable :: omega(:)
    complex(wp), allocatable :: open(:)                !! poles with this loop opened [1/s]
    complex(wp) :: left, right, l
    real(wp) :: at, gain, gain_at, phase, phase_at, angle
    integer :: k, states
    logical :: ok
    call loops%poles(ds, c, open, states, ok)
    omega = frequencies([lambda, open])
    gain = huge(1.0_wp)
    phase = huge(1.0_wp)
    left = loops%opened(ds, cmplx(0.0_wp, omega(1), wp), c)
    do k = 2, size(omega)
      right = loops%opened(ds, cmplx(0.0_wp, omega(k), wp), c)
      if (left%im*right%im < 0.0_wp .and. min(left%re, right%re) < 0.0_wp) then
        call cross(.false., at, l)
        if (l%re < 0.0_wp .and. abs(log(abs(l))) < abs(log(gain))) then
          gain = 1/abs(l)
          gain_at = at
        end if
      end if
      if ((abs(left) - 1)*(abs(right) - 1) < 0.0_wp) then
        call cross(.true., at, l)
        angle = modulo(atan2(l%im, l%re) + pi, 2*pi)
        if (angle < phase) then
          phase = angle
          phase_at = at
        end if
      end if
      left = right
    end do
    call text%open('', '{')
    call text%say('  loop of controller "{controller='//trim(loops%law(c)%name)//'}" opened: ')
    if (gain < huge(1.0_wp)) then
      call text%say('gain margin {gain_margin 5} at {gain_margin_at 5} Hz, ', [gain, gain_at/(2*pi)])
    else
      call text%say('no frequency limits the gain, ')
    end if
    if (phase < huge(1.0_wp)) then
      call text%line('phase margin {phase_margin 5} degrees at {phase_margin_at 5} Hz', [phase*180/pi, phase_at/(2*pi)])
    else
      call text%line('no frequency has the gain 1')
    end if
    call text%close()
  contains
    !> Halves the interval in which the size of the open loop crosses 1, or its imaginary part 0.
    subroutine cross(by_size, at, l)
      logical, intent(in) :: by_size
      real(wp), intent(out) :: at                      !! [rad/s]
      complex(wp), intent(out) :: l                   !! the open loop there [-]
      real(wp) :: low, high                            ! [rad/s]
      integer :: i
      low = omega(k - 1)
      high = omega(k)
      do i = 1, 45
        at = 0.5_wp*(low + high)
        l = loops%opened(ds, cmplx(0.0_wp, at, wp), c)
        if (merge((abs(left) - 1)*(abs(l) - 1), left%im*l%im, by_size) > 0.0_wp) then
          low = at
        else
          high = at
        end if
      end do
    end subroutine cross
  end subroutine margins

  !> Frequencies that show every pole: a grid over all decades, and narrow ones about each.
  pure function frequencies(lambda) result(omega)
    complex(wp), intent(in) :: lambda(:)               !! [1/s]
    real(wp), allocatable :: omega(:)                  !! ascending [rad/s]
    complex(wp), allocatable :: moving(:)              !! rigid motions left out
    real(wp) :: low, high
    integer :: i, j, k
    moving = pack(lambda, abs(lambda) > 1.0e-7_wp*maxval(abs(lambda)))
    if (size(moving) == 0) moving = [(1.0_wp, 0.0_wp)]   ! a mechanism that cannot move: any frequency shows what there is
    low = 0.01_wp*minval(abs(moving))
    high = 10*maxval(abs(moving))
    omega = [(low*(high/low)**(k/(per_decade*log10(high/low))), k=0, int(per_decade*log10(high/low)) + 1), &
             ((moving(i)%im + 0.5_wp*j*abs(moving(i)%re), j=-4, 4), i=1, size(moving))]
    omega = pack(omega, omega >= low)
    omega = omega(ascending(omega))
  end function frequencies
end module loop_analysis
