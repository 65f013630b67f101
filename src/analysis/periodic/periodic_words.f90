!> What a periodic analysis says: its part of the summary, floquet.txt, why there is no cycle.
module periodic_words
  use kinds, only: wp, pi
  use cycle_search, only: cycle_state
  use errors, only: failure, status_failed
  use loss_words, only: loss_lines
  use readable_text, only: json_text
  use scene_model, only: scene
  use scene_run, only: run_state, no_output
  use self_heating, only: heat_balance
  use summary_text, only: summary_record
  use switching, only: element_name, switch_event
  use text, only: either, quoted, short_text, to_text
  use text_file, only: result_file
  implicit none (type, external)
  private
  public :: cycle_lines, explain_cycle, write_floquet

contains

  !> Fails where there is no cycle, and says what is known of it.
  subroutine explain_cycle(run, cycle, fail)
    type(run_state), intent(in) :: run
    type(cycle_state), intent(in) :: cycle
    type(failure), intent(inout) :: fail
    real(wp), allocatable :: r(:)             ! [-]
    integer :: k
    if (cycle%lost_first) then
      call fail%raise(status_failed, 'the first turn of the periodic analysis failed at t = '//short_text(cycle%turn%at, 4)// &
                      ' s; the deck without &periodic says why')
      return
    end if
    if (cycle%found) then
      call refuse_false(run, cycle, fail)
      return
    end if
    r = cycle%map%change(cycle%turn)
    k = maxloc(abs(r), 1)
    call fail%raise(status_failed, 'no cycle was found in '//to_text(cycle%turns)//' turns: the best one repeats to '// &
                    short_text(cycle%residual, 2)//' of its range, '//to_text(cycle%tolerance)//' was asked for; '// &
                    name_of(run%sys%m%s, cycle%map%compared(k))//' repeats worst'//drift(run, cycle, k))
  end subroutine explain_cycle

  !> Fails where what repeats is no cycle: a rest, rates alone, a start whose force it does not tell.
  subroutine refuse_false(run, cycle, fail)
    type(run_state), intent(in) :: run
    type(cycle_state), intent(in) :: cycle
    type(failure), intent(inout) :: fail
    if (cycle%free_period) call refuse_rest(run, cycle, fail)
    if (cycle%turn%remembers > 0) call fail%raise(status_failed, 'stop "'//element_name(run%sys%m, cycle%turn%remembers)// &
      '" is touched at t = 0, and its force depends on the speed at touching, before that; expected histories of another '// &
      'phase, so that all such stops are open at t = 0')
    if (cycle%again > sqrt(cycle%tolerance)) call fail%raise(status_failed, 'the rates repeat, but the motion does not: a '// &
      'second turn, which begins where the first one ends, differs by '//short_text(cycle%again, 2)//' of the ranges; expected '// &
      'moves_on without bodies whose place matters, or angle_repeats for those whose angle does')
  end subroutine refuse_false

  !> What else is known of an unknown that does not repeat.
  function drift(run, cycle, k) result(words)
    type(run_state), intent(in) :: run
    type(cycle_state), intent(in) :: cycle
    integer, intent(in) :: k                  !! its number among those that repeat
    character(:), allocatable :: words
    real(wp) :: r(size(cycle%map%compared))   ! [-]
    integer :: b
    associate (s => run%sys%m%s, i => cycle%map%compared(k))
      r = cycle%map%change(cycle%turn)*cycle%map%scale
      words = '; a motion that never repeats has statistics, by a long transient'
      if (cycle%changed%element > 0) words = '; events of '//event_words(run, cycle%changed)//' change from turn to turn'//words
      if (i > s%nq) return
      b = count(s%qo < i)
      if (i - s%qo(b) <= 3) words = ': it is '//short_text(r(k), 3)//either(' rad', ' m', i - s%qo(b) == 3)// &
        ' farther on after a period; moves_on='//quoted(trim(s%bodies(b)%name))//' if it may be'//words
    end associate
  end function drift

  !> An event, by the name of its element and its time.
  function event_words(run, event) result(words)
    type(run_state), intent(in) :: run
    type(switch_event), intent(in) :: event
    character(:), allocatable :: words
    words = '"'//element_name(run%sys%m, event%element)//'" at t = '//short_text(event%t, 4)//' s'
  end function event_words

  !> Where the period is an unknown a rest repeats after any time.
  subroutine refuse_rest(run, cycle, fail)
    type(run_state), intent(in) :: run
    type(cycle_state), intent(in) :: cycle
    type(failure), intent(inout) :: fail
    real(wp), parameter :: still = 1.0e-6_wp, short = 0.2_wp   ! change over the scales; period over the guess [-]
    character(:), allocatable :: words
    words = ''
    if (maxval(abs(cycle%map%scaled(cycle%turn%slope)))*cycle%period < still) words = 'came to a rest, which repeats after any time'
    if (cycle%period < short*run%d%periodic%period) words = 'came to a period of '//short_text(cycle%period, 3)// &
      ' s, so short that it is likely a rest'
    if (len(words) > 0) call fail%raise(status_failed, 'the search of a cycle '//words//'; expected a start farther from rest, '// &
      'or a better period_guess than '//to_text(run%d%periodic%period)//' s')
  end subroutine refuse_rest

  !> The part of the summary.
  subroutine cycle_lines(run, cycle, heat, text)
    type(run_state), intent(inout) :: run
    type(cycle_state), intent(in) :: cycle
    type(heat_balance), intent(in) :: heat
    type(summary_record), intent(inout) :: text
    integer :: k, n
    call text%section('periodic', 'periodic')
    call text%line('  period {period 9} s, repeats to {residual 1} after {turns_to_cycle #} turns of {steps #} steps; all '// &
      'turns: {turns #}; lost in a period: {lost_in_a_period 4} J', [real(wp) :: cycle%period, cycle%residual, &
      cycle%turns_to_cycle, cycle%turn%steps, cycle%turns, cycle%turn%end(2*run%sys%m%s%nq + run%sys%m%s%nz + run%sys%m%s%nzd + 1)])
    call loss_lines(run, cycle%turn%end, .true., text)
    call heat%lines(run, text)
    if (cycle%start_error >= 0.0_wp) then
      call text%line('  error of the start: {error 1} of the ranges, by half the steps; of each column there:', [cycle%start_error])
      call text%table('errors_of_columns', run%list%column%label(), &
                      abs(cycle%map%columns_at(run, cycle%map%moved(cycle%turn%start, &
                          cycle%map%change(cycle%turn))) - cycle%map%columns_at(run, cycle%coarse)), 2)   ! a turn later
    end if
    if (run%d%periodic%multipliers > 0) call stability_lines(run, cycle, text)
    call text%open('multipliers', '[')
    n = 0
    do k = 1, cycle%wanted
      if (k == cycle%time) cycle
      n = n + 1
      call one_multiplier(run, cycle, k, n, text)
    end do
    call text%close()
    call text%close()
  end subroutine cycle_lines

  !> Whether the cycle is stable, what of a disturbance lives longest, and where a cycle that is not stable leads.
  subroutine stability_lines(run, cycle, text)
    type(run_state), intent(inout) :: run
    type(cycle_state), intent(in) :: cycle
    type(summary_record), intent(inout) :: text
    real(wp), parameter :: so_near = 1.0e-6_wp   ! to 1 is 1, if the error of a multiplier is not larger [-]
    complex(wp) :: mu
    real(wp) :: near, modulus                  ! [-]
    character(:), allocatable :: what, way
    integer :: k
    k = findloc([(k /= cycle%time, k=1, cycle%wanted)], .true., 1)
    if (cycle%time > 0) then
      near = abs(cycle%pairs%value(cycle%time) - 1)
      if (near > 10*max(cycle%error(cycle%time), so_near)) call text%warn('the multiplier that belongs to time differs from 1 '// &
        'by '//short_text(near, 1)//': finer steps would tell the others better')
    end if
    if (cycle%grazes) call text%warn('events of '//event_words(run, cycle%changed)//' change on both sides of the cycle, '// &
      'as where a stop is just touched: it has no multipliers, and those told mean little')
    mu = 0.0_wp
    near = so_near
    what = 'any disturbance'
    if (k > 0) then
      mu = cycle%pairs%value(k)
      near = max(so_near, cycle%error(k))
      what = 'a disturbance of '//mover(run, cycle, k)
    end if
    modulus = abs(mu)
    way = 'beat'
    if (abs(mu%im) <= near) way = trim(merge('jump', 'flip', mu%re > 0.0_wp))
    call text%member('stable', either('true', 'false', modulus <= 1 + near))
    call text%line('  largest multiplier: {largest_multiplier 8}', [modulus])
    if (modulus < 1 - near) then
      call text%say('  {stability=stable}: '//what)
      if (modulus > so_near) then
        call text%line(' falls to a hundredth in {turns_to_hundredth} turns', [log(0.01_wp)/log(modulus)])
      else
        call text%line(' is gone after a turn')
      end if
      return
    else if (modulus <= 1 + near) then
      call text%line('  {stability=undamped}: '//what//' neither falls nor grows')
      if (way == 'jump') call text%line('  nothing brings it back: the cycle is one of a family')
    else
      call text%line('  {stability=unstable}: '//what//' grows '//to_text(modulus)//' times a turn')
      if (way == 'jump') call text%line('  it leads away to one side: to another cycle, or to none')
    end if
    call text%member('way', json_text(way))
    if (way == 'flip') call text%line('  an orbit of two periods may exist: period='//to_text(2*cycle%period)// &
                                      ' s, from a start off this one')
    if (way == 'beat') call text%line('  it turns by '//to_text(anint(1.0e4_wp*abs(atan2(mu%im, mu%re))/(2*pi))/1.0e4_wp)// &
                                      ' of a circle each period: the motion beats')
  end subroutine stability_lines

  !> The unknown that a multiplier moves most, in words.
  function mover(run, cycle, k) result(words)
    type(run_state), intent(in) :: run
    type(cycle_state), intent(in) :: cycle
    integer, intent(in) :: k                  !! its number among the pairs
    character(:), allocatable :: words
    words = name_of(run%sys%m%s, cycle%map%compared(maxloc(abs(cycle%pairs%vector(:, k)), 1)))
  end function mover

  !> A line for one multiplier.
  subroutine one_multiplier(run, cycle, k, number, text)
    type(run_state), intent(in) :: run
    type(cycle_state), intent(in) :: cycle
    integer, intent(in) :: k                  !! its number among the pairs
    integer, intent(in) :: number             !! among those that are told
    type(summary_record), intent(inout) :: text
    real(wp) :: x(7)
    x = figures(cycle, k)
    call text%item('  multiplier '//to_text(number)//': {real 8} {imag 8} i, modulus {modulus 8}, error {error 1}; growth '// &
                   '{growth 3} 1/s at {frequency 3} Hz; moves {moves='//mover(run, cycle, k)//'}', [x(1:5), abs(x(6))])
  end subroutine one_multiplier

  !> Figures of a multiplier: real and imaginary part, modulus, error, growth, frequency, turns to a hundredth.
  pure function figures(cycle, k) result(x)
    type(cycle_state), intent(in) :: cycle
    integer, intent(in) :: k                  !! its number among the pairs
    real(wp) :: x(7)                          !! [-, -, -, -, 1/s, Hz, -]
    associate (mu => cycle%pairs%value(k))
      x = [mu%re, mu%im, abs(mu), cycle%error(k), log(abs(mu))/cycle%period, atan2(mu%im, mu%re)/(2*pi*cycle%period), &
           log(0.01_wp)/log(abs(mu))]
    end associate
  end function figures

  !> floquet.txt: one row a multiplier.
  subroutine write_floquet(run, cycle, fail)
    type(run_state), intent(in) :: run
    type(cycle_state), intent(in) :: cycle
    type(failure), intent(inout) :: fail
    type(result_file) :: file
    integer :: k, n
    if (cycle%wanted == 0) return
    call file%open(run%folder//'/floquet.txt')
    call file%head('Floquet multipliers of the cycle of '//to_text(cycle%period)//' s', run%d%name, run%sys%m%s%title)
    call file%line('# a disturbance is multiplied by one of them each period; frequency: up to whole multiples of '// &
                   to_text(1/cycle%period)//' Hz')
    n = 0
    do k = 1, cycle%wanted
      if (k == cycle%time) cycle
      n = n + 1
      call file%line('# '//to_text(n)//' moves most: '//mover(run, cycle, k))
    end do
    call file%line('# columns: number[-] real[-] imag[-] modulus[-] error[-] growth[1/s] frequency[Hz] turns_to_hundredth[-]')
    n = 0
    do k = 1, cycle%wanted
      if (k == cycle%time) cycle
      n = n + 1
      call file%row([real(n, wp), figures(cycle, k)])
    end do
    call file%close()
    if (file%failed) call no_output(run, fail)
  end subroutine write_floquet

  !> An unknown in words.
  function name_of(s, unknown) result(name)
    type(scene), intent(in) :: s
    integer, intent(in) :: unknown            !! its number in the state
    character(:), allocatable :: name
    integer :: b, k
    k = unknown
    name = ''
    if (k > s%nq .and. k <= 2*s%nq) name = 'the rate of '
    if (k <= 2*s%nq) then
      k = 1 + mod(k - 1, s%nq)
      b = count(s%qo < k)
      k = k - s%qo(b)
      if (k <= 2) name = name//'the '//either('x', 'y', k == 1)//' of body "'//trim(s%bodies(b)%name)//'"'
      if (k == 3) name = name//'the angle of body "'//trim(s%bodies(b)%name)//'"'
      if (k > 3) name = name//'elastic coordinate '//to_text(k - 3)//' of body "'//trim(s%bodies(b)%name)//'"'
      return
    end if
    k = k - 2*s%nq
    if (k > s%nz) k = k - s%nz
    name = 'an internal variable of a spring'
    do b = 1, size(s%bodies)
      if (s%bodies(b)%nz == 0) cycle
      associate (first => s%bodies(b)%segments(1)%start(1))
        if (k > first .and. k <= first + s%bodies(b)%nz) name = 'an internal variable of body '//quoted(trim(s%bodies(b)%name))
      end associate
    end do
    do b = 1, size(s%controllers)
      associate (c => s%controllers(b))
        if (k > c%first .and. k <= c%first + c%states) name = 'a state of controller '//quoted(trim(c%name))
      end associate
    end do
  end function name_of
end module periodic_words
