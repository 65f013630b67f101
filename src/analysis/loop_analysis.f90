!> Closed loops of a modal analysis: all poles into poles.txt, whether they grow, and the margins of each loop when it is opened.
!> Before a transient: whether a vibration grows by them.
module loop_analysis
  use kinds, only: wp, pi
  use closed_loops, only: known_poles, loop_system, most_states
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

  integer, parameter :: per_decade = 20                !! frequencies at which margins are looked for, at least
  real(wp), parameter :: neutral = 1.0e-10_wp          !! real part of a pole that neither grows nor decays, over the modulus [-]

contains

  !> Warns of a vibration that loops make grow in the run, about the state as assembled: steps would follow it until limits or
  !> friction hold it. Friction is left out, since a joint at rest hides its loop. Motions that fall over without vibrating are left
  !> to the run, and held outputs to their samples.
  subroutine warn_of_loops(run, text)
    type(run_state), intent(inout) :: run
    type(summary_record), intent(inout) :: text
    type(stiffness_system) :: ds
    type(loop_system) :: loops
    type(known_poles) :: all
    complex(wp), allocatable :: lambda(:)              ! [1/s]
    integer :: states, k
    logical :: ok
    associate (s => run%sys%m%s)
      if (size(s%controllers) == 0 .or. run%d%modal%present .or. .not. run%d%transient%present) return
      if (any(s%controllers%sample > 0.0_wp)) return
      call run%sys%hold_rows(run%y, free=.true.)
      call linear_system(run, ds, loops)
    end associate
    call loops%poles(ds, 0, all, states, ok)
    if (.not. ok) return
    lambda = pack(all%lambda, all%lambda%im > abs(all%lambda%re) .and. all%lambda%re*run%d%transient%t_end > 1.0_wp)
    if (size(lambda) == 0) return
    k = maxloc(lambda%re, 1)
    call text%warn('controllers make a vibration of '//to_text(lambda(k)%im/(2*pi))//' Hz grow by '//to_text(lambda(k)%re)// &
              ' 1/s, as assembled and with joints free of friction: steps will follow it; &modal friction=''free'' tells poles '// &
              'and margins')
  end subroutine warn_of_loops

  !> Poles and margins.
  subroutine run_loops(run, ds, loops, text, fail)
    type(run_state), intent(inout) :: run
    type(stiffness_system), intent(inout) :: ds
    type(loop_system), intent(in) :: loops
    type(summary_record), intent(inout) :: text
    type(failure), intent(inout) :: fail
    type(result_file) :: file
    type(known_poles) :: all
    integer :: states, k, grow, unknown
    logical :: ok
    call remove_own(run%folder//'/poles.txt')
    if (loops%n == 0 .or. fail%happened()) return
    call loops%poles(ds, 0, all, states, ok)
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
    associate (lambda => all%lambda, error => all%error)
      grow = sum(merge(2, 1, lambda%im > 0.0_wp), grows(lambda, error))
      unknown = findloc(is_not_known(lambda, error), .true., 1)
      if (grow == 0 .and. unknown > 0) then
        call text%line(', all poles computed; whether any grows is not known')
        call text%member('growing', 'null')
        call text%warn('whether the closed loops are stable is not known: the real part of the pole at '// &
                       to_text(abs(lambda(unknown))/(2*pi))//' Hz is '//to_text(lambda(unknown)%re)//' 1/s with an error of '// &
                       to_text(error(unknown))//' 1/s; a transient, or damping of that motion, tells')
      else
        call text%line(', all poles computed; growing: {growing #}', [real(wp) :: grow])
      end if
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
      do k = 1, merge(0, loops%n, grow > 0 .or. unknown > 0)
        call stop_if_signalled('modal analysis', fail)
        if (fail%happened()) exit
        call margins(loops, ds, k, all, text)
      end do
      call text%close()
      call text%close()
      call tell_limits(run, text)
      if (grow > 0) call text%warn('a closed loop is unstable: '//to_text(grow)//' of the poles '// &
                              either('grows', 'grow', grow == 1)//' (poles.txt)')
    end associate
  end subroutine run_loops

  !> Whether a pole grows, by more than its error.
  elemental logical function grows(lambda, error) result(yes)
    complex(wp), intent(in) :: lambda                  !! [1/s]
    real(wp), intent(in) :: error                      !! [1/s]
    yes = lambda%re > neutral*abs(lambda) + error
  end function grows

  !> Whether it is not known if a pole grows: it may, by no more than its error.
  elemental logical function is_not_known(lambda, error) result(yes)
    complex(wp), intent(in) :: lambda                  !! [1/s]
    real(wp), intent(in) :: error                      !! [1/s]
    yes = lambda%re + error > 2*neutral*abs(lambda) .and. .not. grows(lambda, error)
  end function is_not_known

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
  !> either side; where its size is 1, the least lag that takes it to -1. Frequencies at which they are looked for are halved until
  !> the open loop hardly changes in between. At its own undamped poles it is infinite and at undamped zeros nothing: it crosses
  !> nothing there.
  subroutine margins(loops, ds, c, closed, text)
    type(loop_system), intent(in) :: loops
    type(stiffness_system), intent(inout) :: ds
    integer, intent(in) :: c                           !! controller
    type(known_poles), intent(in) :: closed            !! all poles
    type(summary_record), intent(inout) :: text
    real(wp), parameter :: finest = 1.0e-10_wp         ! distance of frequencies that is not halved, over the upper one [-]
    real(wp), parameter :: same = 1.0e-3_wp            ! change of the open loop by which it is constant towards 0 Hz [-]
    type(known_poles) :: open                          ! poles with this loop opened
    complex(wp), allocatable :: moved(:)               ! poles, open or closed, that the loop moves [1/s]
    real(wp), allocatable :: omega(:)
    complex(wp) :: left, right, real_from, size_from
    real(wp) :: gain, gain_at, phase, phase_at, real_at, size_at   ! [-], [rad/s], [rad]
    integer :: k, states
    logical :: ok
    call loops%poles(ds, c, open, states, ok)
    call find_moved(closed, open, moved)
    gain = huge(1.0_wp)
    phase = huge(1.0_wp)
    if (size(moved) > 0) then
      omega = frequencies(moved)
      call at_rest(omega(1))
      left = open_loop(omega(1))
      real_from = left
      size_from = left
      real_at = omega(1)
      size_at = omega(1)
      do k = 2, size(omega)
        right = open_loop(omega(k))
        call scan(omega(k - 1), left, omega(k), right)
        left = right
      end do
    end if
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
    !> The open loop at a frequency [-].
    complex(wp) function open_loop(at)
      real(wp), intent(in) :: at                       !! [rad/s]
      open_loop = loops%opened(ds, cmplx(0.0_wp, at, wp), c)
    end function open_loop

    !> What the open loop tends to towards 0 Hz, where that is a number and negative: there it crosses, too.
    subroutine at_rest(low)
      real(wp), intent(in) :: low                      !! far below all poles [rad/s]
      complex(wp) :: one, half
      one = open_loop(low)
      half = open_loop(0.5_wp*low)
      if (abs(one - half) <= same*abs(half) .and. half%re < 0.0_wp) call keep_gain(0.0_wp, (4*half%re - one%re)/3)
    end subroutine at_rest

    !> Halves an interval until the open loop changes little in it, then looks for crossings.
    recursive subroutine scan(a, la, b, lb)
      real(wp), intent(in) :: a, b                     !! [rad/s]
      complex(wp), intent(in) :: la, lb                !! the open loop there [-]
      complex(wp) :: l
      real(wp) :: middle                               ! [rad/s]
      if (abs(lb - la) > 0.3_wp*min(abs(la), abs(lb)) .and. b - a > finest*b) then
        middle = 0.5_wp*(a + b)
        l = open_loop(middle)
        call scan(a, la, middle, l)
        call scan(middle, l, b, lb)
        return
      end if
      if (abs(lb%im) > neutral*abs(lb)) then           ! of a loop that is real the sign of its imaginary part is rounding
        if (real_from%im*lb%im < 0.0_wp .and. min(real_from%re, lb%re) < 0.0_wp) call cross(.false., real_at, real_from, b, lb)
        real_from = lb
        real_at = b
      end if
      if ((abs(size_from) - 1)*(abs(lb) - 1) < 0.0_wp) call cross(.true., size_at, size_from, b, lb)
      size_from = lb
      size_at = b
    end subroutine scan

    !> Halves the interval in which the size of the open loop crosses 1, or its imaginary part 0.
    subroutine cross(by_size, a, la, b, lb)
      logical, intent(in) :: by_size
      real(wp), intent(in) :: a, b                     !! [rad/s]
      complex(wp), intent(in) :: la, lb                !! the open loop there [-]
      complex(wp) :: l
      real(wp) :: low, high, at, angle                 ! [rad/s], [rad]
      integer :: i
      low = a
      high = b
      do i = 1, 60
        at = 0.5_wp*(low + high)
        l = open_loop(at)
        if (merge((abs(la) - 1)*(abs(l) - 1), la%im*l%im, by_size) > 0.0_wp) then
          low = at
        else
          high = at
        end if
      end do
      if (abs(l) > 2*max(abs(la), abs(lb)) .or. abs(l) < 0.5_wp*min(abs(la), abs(lb))) return   ! a pole or a zero
      if (any(abs(open%lambda - cmplx(0.0_wp, at, wp)) <= open%error + 10*neutral*at)) return   ! beside a pole
      if (.not. by_size) call keep_gain(at, l%re)
      if (.not. by_size) return
      angle = atan2(-l%im, -l%re)
      if (angle < -neutral) angle = angle + 2*pi
      if (angle >= phase) return
      phase = angle
      phase_at = at
    end subroutine cross

    !> Keeps the gain nearest to 1.
    subroutine keep_gain(at, l)
      real(wp), intent(in) :: at                       !! [rad/s]
      real(wp), intent(in) :: l                        !! the open loop there, which is real [-]
      if (.not. l < 0.0_wp) return
      if (abs(log(-l)) >= abs(log(gain))) return
      gain = -1/l
      gain_at = at
    end subroutine keep_gain
  end subroutine margins

  !> Poles that a loop moves: of the closed one and of the open one those that are not alike within their errors.
  pure subroutine find_moved(closed, open, moved)
    type(known_poles), intent(in) :: closed, open
    complex(wp), allocatable, intent(out) :: moved(:)  !! [1/s]
    logical :: alone(size(open%lambda)), moves(size(closed%lambda))
    real(wp) :: slack                                  ! [1/s]
    integer :: i, j
    alone = .true.
    do i = 1, size(moves)
      associate (p => closed%lambda(i))
        moves(i) = .true.
        do j = 1, size(alone)
          slack = closed%error(i) + open%error(j) + 100*epsilon(1.0_wp)*abs(p)
          if (.not. (alone(j) .and. abs(p - open%lambda(j)) <= slack)) cycle
          alone(j) = .false.
          moves(i) = .false.
          exit
        end do
      end associate
    end do
    moved = [pack(closed%lambda, moves), pack(open%lambda, alone)]
    moved = pack(moved, abs(moved) > 0.0_wp)
  end subroutine find_moved

  !> Frequencies at which the open loop is looked at first: a grid over all decades of the poles that it has or moves, and about
  !> each of them distances that are doubled.
  pure function frequencies(lambda) result(omega)
    complex(wp), intent(in) :: lambda(:)               !! [1/s]
    real(wp), allocatable :: omega(:)                  !! ascending [rad/s]
    real(wp) :: low, high, distance
    integer :: i, k
    low = 1.0e-4_wp*minval(abs(lambda))
    high = 10*maxval(abs(lambda))
    omega = [(low*(high/low)**(k/(per_decade*log10(high/low))), k=0, int(per_decade*log10(high/low)) + 1)]
    do i = 1, size(lambda)
      distance = max(0.5_wp*abs(lambda(i)%re), neutral*abs(lambda(i)))
      do while (distance < 2*abs(lambda(i)))
        omega = [omega, lambda(i)%im - distance, lambda(i)%im + distance]
        distance = 2*distance
      end do
    end do
    omega = pack(omega, omega >= low)
    omega = omega(ascending(omega))
  end function frequencies
end module loop_analysis
