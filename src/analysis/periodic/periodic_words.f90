!> What a periodic analysis says: its part of the summary, floquet.txt, why there is no cycle.
module periodic_words
  use kinds, only: wp, pi
  use cycle_search, only: cycle_state, safety
  use errors, only: failure
  use loss_words, only: loss_lines
  use readable_text, only: json_text
  use scene_run, only: run_state, no_output
  use self_heating, only: heat_balance
  use summary_text, only: summary_record
  use switching, only: element_name
  use text, only: either, quoted, short_text, to_text
  use text_file, only: result_file
  implicit none (type, external)
  private
  public :: cycle_lines, no_cycle

  !> An estimated error may be too small by this factor: true ones were up to five times as large where coordinates rest.
  real(wp), parameter :: doubt = 5.0_wp

contains

  !> Why there is no cycle, or why what repeats is none: a rest, rates alone, a start whose force it does not tell.
  !> Empty: there is one.
  function no_cycle(run, cycle) result(words)
    type(run_state), intent(in) :: run
    type(cycle_state), intent(in) :: cycle
    character(:), allocatable :: words
    real(wp) :: r(size(cycle%map%compared))   ! [-], then [m, rad]
    integer :: k, b
    words = ''
    associate (s => run%sys%m%s, map => cycle%map, turn => cycle%turn, event => cycle%changed)
      if (turn%lost) then
        words = 'the first turn of the periodic analysis failed at t = '//short_text(turn%at, 4)// &
                ' s; the deck without &periodic says why'
      else if (.not. cycle%found) then
        r = map%change(turn)
        k = maxloc(abs(r), 1)
        words = 'no cycle was found in '//to_text(cycle%turns)//' turns: the best one repeats to '// &
                short_text(cycle%residual, 2)//' of its range, '//to_text(cycle%tolerance)//' was asked for; '// &
                name_of(run, cycle, abs(r))//' repeats worst'
        b = count(s%qo < map%compared(k))
        if (map%compared(k) <= min(s%nq, s%qo(b) + 3)) words = words//': it is '//short_text(r(k)*map%scale(k), 3)// &
          either(' rad', ' m', map%turning(k))//' farther on after a period; moves_on='//quoted(trim(s%bodies(b)%name))// &
          ' if it may be'
        if (event%element > 0) words = words//'; events of "'//element_name(run%sys%m, event%element)//'" at t = '// &
                                       short_text(event%t, 4)//' s are not in every turn'
        words = words//'; a motion that never repeats has statistics, by a long transient'
      else if (cycle%free_period .and. maxval(abs(map%scaled(turn%slope)))*turn%period < sqrt(cycle%tolerance)) then
        words = 'the search of a cycle came to a rest, which repeats after any time, or near one: a period of '// &
                short_text(cycle%turn%period, 3)//' s; expected a start farther from rest, or a better period_guess than '// &
                to_text(run%d%periodic%period)//' s'
      else if (turn%remembers > 0) then
        words = 'stop "'//element_name(run%sys%m, turn%remembers)//'" is touched at t = 0, and its force depends on the speed '// &
                'at touching, before that; expected histories of another phase, so that all such stops are open at t = 0'
      else if (cycle%again > sqrt(cycle%tolerance)) then
        words = 'a turn repeats, but not the one after it: a second turn, which begins when and where the first one ends, '// &
                'differs by '//short_text(cycle%again, 2)//' of the ranges, in its motion or in the work of what acts; '
        if (map%moves_on) words = words//'the rates repeat, but the motion does not: expected moves_on without bodies whose '// &
          'place matters, or angle_repeats for those whose angle does'
        if (.not. map%moves_on) words = words//'whole turns of a body wind up what acts on its angle, as a torsional spring'
      end if
    end associate
  end function no_cycle

  !> The part of the summary, and floquet.txt.
  subroutine cycle_lines(run, cycle, heat, text, fail)
    type(run_state), intent(inout) :: run
    type(cycle_state), intent(in) :: cycle
    type(heat_balance), intent(in) :: heat
    type(summary_record), intent(inout) :: text
    type(failure), intent(inout) :: fail
    integer, allocatable :: list(:)
    integer :: k
    associate (s => run%sys%m%s, turn => cycle%turn)
      call text%section('periodic', 'periodic')
      call text%line('  period {period 9} s, repeats to {residual 1} after {turns_to_cycle #} turns of {steps #} steps; all '// &
                     'turns: {turns #}; lost in a period: {lost_in_a_period 4} J', [real(wp) :: cycle%turn%period, cycle%residual, &
                     cycle%turns_to_cycle, cycle%map%steps, cycle%turns, turn%end(2*s%nq + s%nz + s%nzd + 1)])
      call loss_lines(run, turn%end, .true., text)
      call heat%lines(run, text)
    end associate
    list = pack([(k, k=1, cycle%wanted)], [(k /= cycle%time, k=1, cycle%wanted)])   ! not the pair of time
    call error_lines(run, cycle, list, text)
    if (run%d%periodic%multipliers > 0) call stability_lines(run, cycle, list, text)
    call multiplier_lines(run, cycle, list, text, fail)
    call text%close()
  end subroutine cycle_lines

  !> Errors of start, period and multipliers, and whether each is what was asked for.
  subroutine error_lines(run, cycle, list, text)
    type(run_state), intent(inout) :: run
    type(cycle_state), intent(in) :: cycle
    integer, intent(in) :: list(:)             !! pairs that are told
    type(summary_record), intent(inout) :: text
    real(wp) :: asked, of_multipliers          ! [-]
    character(:), allocatable :: missed
    associate (t => run%d%transient, p => run%d%periodic)
      if (.not. (p%multipliers > 0 .or. t%accuracy > 0.0_wp .or. t%check_error)) return
      asked = t%accuracy
      if (.not. asked > 0.0_wp .and. p%own_tolerance) asked = p%tolerance
      if (cycle%share > 0.0_wp) then
        call text%line('  errors, by {error_steps #} steps beside these: of the start {error 1} of the ranges', &
                       [real(wp) :: cycle%other%steps, cycle%start_error])
        if (p%free_period) call text%line('  error of the period: {period_error 1} s', [cycle%period_error])
      else
        call text%line('  errors are not known: with other numbers of steps no cycle was found')
        call text%member('error', 'null')
      end if
      if (cycle%share > 0.0_wp .and. (t%accuracy > 0.0_wp .or. t%check_error)) then
        call text%line('  of each column there:')
        call text%table('errors_of_columns', run%list%column%label(), &
                        cycle%share*abs(cycle%map%columns_after(run, cycle%turn) - cycle%map%columns_after(run, cycle%other)), 2)
      end if
      if (.not. asked > 0.0_wp) return
      missed = ''
      of_multipliers = maxval([0.0_wp, cycle%error(list)])
      call text%line('  asked of the cycle: {asked 1}', [asked])
      call verdict('start', cycle%start_error)
      if (p%multipliers > 0) call verdict('multipliers', of_multipliers)
      if (len(missed) > 0) call text%warn('the cycle: '//missed//' not known to the '//short_text(asked, 1)//' asked, or not '// &
                                          'for sure; smaller steps or a smaller tolerance of &periodic give that')
    end associate
  contains
    !> Whether an error is small enough. It is told with a safety: within that of the limit nobody knows.
    subroutine verdict(what, error)
      character(*), intent(in) :: what
      real(wp), intent(in) :: error            !! huge: not known [-]
      logical :: known, kept
      kept = error <= asked
      known = kept .or. error > safety**2*asked .and. error < huge(1.0_wp)
      call text%member(what//'_kept', either(either('true', 'false', kept), 'null', known))
      call text%line('  '//what//': '//either(either('kept', 'not kept', kept), 'not known whether kept', known))
      if (.not. kept) missed = missed//either('', ' and ', len(missed) == 0)//what
    end subroutine verdict
  end subroutine error_lines

  !> Whether the cycle is stable, what of a disturbance lives longest, and where a cycle that is not stable leads. Each multiplier
  !> counts with several times its error: one above 1 is enough for unstable, all below 1 are needed for stable.
  subroutine stability_lines(run, cycle, list, text)
    type(run_state), intent(inout) :: run
    type(cycle_state), intent(in) :: cycle
    integer, intent(in) :: list(:)             !! pairs that are told
    type(summary_record), intent(inout) :: text
    real(wp) :: modulus(size(list)), far(size(list))   ! [-]
    logical :: grows, falls
    integer :: k
    character(:), allocatable :: what, way, unknown
    modulus = abs(cycle%pairs%value(list))
    far = doubt*min(cycle%error(list), huge(1.0_wp)/doubt)
    grows = any(modulus - far > 1) .and. .not. cycle%grazes
    falls = all(modulus + far < 1) .and. .not. cycle%grazes
    k = findloc(merge(modulus - far > 1, modulus + far >= 1, grows), .true., 1)
    if (falls) k = min(1, size(list))
    call text%member('stable', either(either('true', 'false', falls), 'null', falls .or. grows))
    call text%line('  largest multiplier: {largest_multiplier 8}', [maxval([0.0_wp, modulus])])
    if (cycle%grazes) then
      call text%line('  stability is {stability=not known}')
      call text%warn('events of "'//element_name(run%sys%m, cycle%changed%element)//'" at t = '// &
                     short_text(cycle%changed%t, 4)//' s change on both sides of the cycle, as where a stop is just touched: '// &
                     'it has no multipliers, and those told mean little')
      return
    end if
    what = 'any disturbance'
    if (k > 0) what = 'a disturbance of '//name_of(run, cycle, abs(cycle%pairs%vector(:, list(k))))
    if (falls) then
      call text%say('  {stability=stable}: '//what)
      if (k == 0) call text%line(' is gone after a turn')
      if (k > 0) call text%line(' falls to a hundredth in {turns_to_hundredth} turns', [log(0.01_wp)/log(modulus(max(1, k)))])
      return
    end if
    associate (mu => cycle%pairs%value(list(k)), error => cycle%error(list(k)))
      way = 'beat'
      if (abs(mu%im) <= error) way = trim(merge('jump', 'flip', mu%re > 0.0_wp))
      if (grows) then
        call text%line('  {stability=unstable}: '//what//' grows '//to_text(modulus(k))//' times a turn')
        if (way == 'jump') call text%line('  it leads away to one side: to another cycle, or to none')
      else
        unknown = 'its multiplier is '//to_text(modulus(k))//', and its error '//short_text(error, 1)
        if (.not. error < huge(1.0_wp)) unknown = 'the error of its multiplier, '//to_text(modulus(k))//', is not known'
        call text%line('  stability is {stability=not known}: '//what//' neither falls nor grows as far as '// &
                       either('errors tell', 'is known', error < huge(1.0_wp)))
        if (way == 'jump') call text%line('  nothing that is seen brings it back: the cycle may be one of a family')
        call text%warn('whether the cycle is stable is not known: of '//what//' '//unknown// &
                       '; smaller steps tell, but where nothing damps it')
      end if
    end associate
    call text%member('way', json_text(way))
    if (way == 'flip') call text%line('  an orbit of two periods may exist: period='//to_text(2*cycle%turn%period)// &
                                      ' s, from a start off this one')
    associate (mu => cycle%pairs%value(list(k)))
      if (way == 'beat') call text%line('  it turns by '//to_text(anint(1.0e4_wp*abs(atan2(mu%im, mu%re))/(2*pi))/1.0e4_wp)// &
                                        ' of a circle each period: the motion beats')
    end associate
  end subroutine stability_lines

  !> Each multiplier in the summary, and as a row of floquet.txt.
  subroutine multiplier_lines(run, cycle, list, text, fail)
    type(run_state), intent(in) :: run
    type(cycle_state), intent(in) :: cycle
    integer, intent(in) :: list(:)            !! pairs that are told
    type(summary_record), intent(inout) :: text
    type(failure), intent(inout) :: fail
    type(result_file) :: file
    real(wp) :: x(7, size(list))              ! [-, -, -, -, 1/s, Hz, -]
    character(:), allocatable :: name
    integer :: k
    call text%open('multipliers', '[')
    do k = 1, size(list)
      associate (mu => cycle%pairs%value(list(k)))
        name = name_of(run, cycle, abs(cycle%pairs%vector(:, list(k))))
        x(:, k) = [mu%re, mu%im, abs(mu), cycle%error(list(k)), log(abs(mu))/cycle%turn%period, &
                   atan2(mu%im, mu%re)/(2*pi*cycle%turn%period), log(0.01_wp)/log(abs(mu))]
      end associate
      call text%item('  multiplier '//to_text(k)//': {real 8} {imag 8} i, modulus {modulus 8}, error {error 1}; growth '// &
                     '{growth 3} 1/s at {frequency 3} Hz; moves {moves='//name//'}', &
                     [x(1:5, k), abs(x(6, k))])
    end do
    call text%close()
    if (cycle%wanted == 0) return
    call file%open(run%folder//'/floquet.txt')
    call file%head('Floquet multipliers of the cycle of '//to_text(cycle%turn%period)//' s', run%d%name, run%sys%m%s%title)
    call file%line('# a disturbance is multiplied by one of them each period; frequency: up to whole multiples of '// &
                   to_text(1/cycle%turn%period)//' Hz')
    do k = 1, size(list)
      call file%line('# '//to_text(k)//' moves most: '//name_of(run, cycle, abs(cycle%pairs%vector(:, list(k)))))
    end do
    call file%line('# columns: number[-] real[-] imag[-] modulus[-] error[-] growth[1/s] frequency[Hz] turns_to_hundredth[-]')
    do k = 1, size(list)
      call file%row([real(k, wp), x(:, k)])
    end do
    call file%close()
    if (file%failed) call no_output(run, fail)
  end subroutine multiplier_lines

  !> The unknown that moves most, in words.
  function name_of(run, cycle, size_of) result(name)
    type(run_state), intent(in) :: run
    type(cycle_state), intent(in) :: cycle
    real(wp), intent(in) :: size_of(:)        !! (compared) of the move [-]
    character(5), parameter :: frame(3) = ['x    ', 'y    ', 'angle']
    character(:), allocatable :: name
    integer :: unknown, b, k
    unknown = cycle%map%compared(maxloc(size_of, 1))
    associate (s => run%sys%m%s)
      k = 1 + mod(unknown - 1, s%nq)
      b = count(s%qo < k)
      k = k - s%qo(b)
      name = 'elastic coordinate '//to_text(k - 3)
      if (k <= 3) name = 'the '//trim(frame(k))
      if (unknown > s%nq) name = 'the rate of '//name
      name = name//' of body "'//trim(s%bodies(b)%name)//'"'
      if (unknown <= 2*s%nq) return
      k = 1 + mod(unknown - 2*s%nq - 1, s%nz)
      name = 'an internal variable of a spring'
      do b = 1, size(s%bodies)
        if (s%bodies(b)%nz == 0) cycle
        associate (before => s%bodies(b)%segments(1)%start(1))
          if (k > before .and. k <= before + s%bodies(b)%nz) name = 'an internal variable of body "'//trim(s%bodies(b)%name)//'"'
        end associate
      end do
      do b = 1, size(s%controllers)
        associate (c => s%controllers(b))
          if (k > c%first .and. k <= c%first + c%states) name = 'a state of controller "'//trim(c%name)//'"'
        end associate
      end do
    end associate
  end function name_of
end module periodic_words
