!> What the summary says of a transient's accuracy: estimated errors of columns where the deck asks for them, and the passes
!> that were made. The energy balance does not bound errors: a vibration that is late keeps its energy. A second run tells them.
module accuracy_words
  use kinds, only: wp
  use accuracy_ladder, only: finished, half, pass_ladder, pass_record, under_way
  use energy_balance, only: distrusted
  use scene_run, only: run_state
  use result_columns, only: labels_of, result_column
  use stored_pass, only: compared_columns, pass_difference
  use summary_text, only: json_number, summary_record
  use text, only: either, short_text, to_text
  use transient, only: transient_march
  implicit none (type, external)
  private
  public :: column_lines, error_lines, ladder_lines

contains

  !> The estimated errors of all columns, with a warning where some are larger than asked or the estimate is doubtful.
  subroutine error_lines(run, march, x, text)
    type(run_state), intent(in) :: run
    type(transient_march), intent(in) :: march
    type(pass_difference), intent(in) :: x
    type(summary_record), intent(inout) :: text
    type(result_column), allocatable :: columns(:)
    integer :: k
    columns = compared_columns(run)
    associate (ladder => march%ladder, large => x%error > x%asked .and. .not. x%unseen)
      k = merge(2, ladder%count - 1, ladder%estimates)
      call text%line('  estimated errors, from the difference to pass {compared_with #}'//either(' with '//either('half the step', &
        'a tenth of the tolerance', ladder%passes(k)%fixed), '', ladder%estimates)//':', [real(wp) :: k])
      if (allocated(run%model_error)) call text%line('    (those of left-out modes and of meshes included)')
      call column_lines('estimated_errors', columns, x%error, x%range, text, large)
      if (any(x%absolute) .and. .not. ladder%estimates) then
        call text%line('  absolute accuracy of columns with a floor, or a range below a thousandth of the largest of their '// &
                       'kind, or noise:')
        call text%table('absolute', pack(labels_of(columns), x%absolute), pack(x%asked, x%absolute), 2)
      end if
      if (run%sys%roots > 0) call text%line('  events of both runs: {events_compared #}, their times err by an estimated '// &
                                            '{event_time_error 2} s at most', [real(wp) :: x%matched, x%event_error])
      if (x%differ_at >= 0.0_wp) then
        call text%line('  events differ from t = {events_differ_from 6} s', [x%differ_at])
        call text%warn('from t = '//short_text(x%differ_at, 6)//' s on the event sequences of both runs differ: rows beyond '// &
                       'are not predictable, and these estimates compare two motions there')
      end if
      k = max(1, maxloc(x%error/x%asked, 1, x%range > 0.0_wp .and. .not. x%unseen))
      if (ladder%estimates .and. ladder%passes(1)%residual > march%balance%floor() .and. &
          march%balance%largest_residual > half*ladder%passes(1)%residual) then
        call text%warn('the energy balance of the second run closes hardly better: vibrations that both runs damp away between '// &
                       'rows are missing in these estimates; a smaller output_step or step shows them')
        call text%line('  accuracy: unknown, columns may err by more than was estimated')
      else if (x%range(k) > 0.0_wp .and. .not. x%unseen(k)) then
        call text%line('  accuracy: the worst column, {worst_column='//trim(columns(k)%label())//'}, errs by an estimated '// &
                       '{worst_error_of_range 1} of its range', [x%error(k)/x%range(k)])
      end if
      if (any(large)) call text%warn(to_text(count(large))//' of '//to_text(size(large))//' columns err by more than '// &
        either(short_text(distrusted, 1)//' of their range', 'is asked', ladder%estimates)//', the worst, '// &
        trim(columns(k)%label())//', by an estimated '//short_text(x%error(k)/x%range(k), 1)//' of its range'// &
        either('; use a smaller step or tolerance', '', ladder%estimates))
      if (any(x%unseen)) then
        k = maxloc(x%error/x%asked, 1, x%unseen)
        call text%warn(to_text(count(x%unseen))//' of '//to_text(size(large))//' columns move by no more than they err, '// &
          trim(columns(k)%label())//' by an estimated '//short_text(x%error(k), 1)//': whether they are constant is not known'// &
          either('; a smaller step or tolerance tells', '', ladder%estimates))
      end if
    end associate
  end subroutine error_lines

  !> Errors of columns, but of those that say where something is.
  subroutine column_lines(name, columns, error, range, text, too_large)
    character(*), intent(in) :: name           !! in summary.json
    type(result_column), intent(in) :: columns(:)
    real(wp), intent(in) :: error(:), range(:)   !! [of the column]
    type(summary_record), intent(inout) :: text
    logical, intent(in), optional :: too_large(:)
    character(64) :: share(size(error))
    integer :: k
    call text%line('    column, largest error, of its range')
    do k = 1, size(error)
      share(k) = '  (constant but for rounding or errors)'
      if (range(k) > 0.0_wp) share(k) = ' '//short_text(error(k)/range(k), 1)
      if (present(too_large)) share(k) = trim(share(k))//either(', too large', '', too_large(k))
    end do
    call text%table(name, pack(columns%label(), .not. columns%number), pack(error, .not. columns%number), 2, &
                    pack(share, .not. columns%number))
    call text%open(name//'_of_range', '{')
    do k = 1, size(error)
      if (columns(k)%number) cycle
      if (range(k) > 0.0_wp) call text%member(trim(columns(k)%label()), json_number(error(k)/range(k)))
    end do
    call text%close()
  end subroutine column_lines

  !> What was tried to keep an accuracy, and what it cost; a warning where it is not kept.
  subroutine ladder_lines(run, ladder, text)
    type(run_state), intent(in) :: run
    type(pass_ladder), intent(in) :: ladder
    type(summary_record), intent(inout) :: text
    character(80), allocatable :: names(:)
    integer :: k
    if (ladder%estimates) return
    names = labels_of(compared_columns(run))
    call text%line('')
    call text%open('accuracy', '{')
    call text%line('accuracy of {asked} of the range of each column, kept where two passes agree so well; cost in explicit '// &
                   'evaluations', [run%d%transient%accuracy])
    call text%open('passes', '[')
    do k = 1, ladder%count
      call pass_line(ladder%passes(k), k, text)
    end do
    call text%close()
    call text%line('  cost of all passes: {cost #}', [sum(ladder%passes%cost)])
    associate (kept => ladder%over .and. ladder%reason == '', delivered => ladder%delivered())
      if (ladder%over) call text%member('kept', either('true', 'false', kept))
      if (delivered > 0) call text%line('  the results are those of pass {results_of_pass #}', [real(wp) :: delivered])
      if (kept) call text%line('  accuracy: kept, the last two passes agree in all columns and events')
      if (ladder%over .and. delivered > 0) then
        names = pack(names, ladder%apart(:size(names), delivered) > 1.0_wp)
        call text%open('not_kept', '[')
        do k = 1, size(names)
          call text%line('  accuracy not kept: {='//trim(names(k))//'}')
        end do
        call text%close()
        if (.not. kept) call text%warn('the accuracy is not kept: '//trim(ladder%reason)//either('; errors are unknown, no '// &
          'other pass was finished', '', ladder%passes(delivered)%column == ''))
      end if
    end associate
    call text%close()
  end subroutine ladder_lines

  !> A pass: its method and setting, what it has cost, how it ended, what sets the cost of the next one.
  subroutine pass_line(pass, k, text)
    type(pass_record), intent(in) :: pass
    integer, intent(in) :: k                  !! number of the pass
    type(summary_record), intent(inout) :: text
    character(*), parameter :: endings(2:3) = [character(8) :: 'given up', 'failed']
    call text%open('', '{')
    call text%say('  pass '//to_text(k)//': {method='//trim(pass%method)//'}, '//either('step {step} s', 'tolerance {tolerance}', &
                                                                                       pass%fixed), [pass%setting])
    if (pass%outcome == under_way) then
      call text%say(', under way')
    else
      call text%say(', cost {cost #}', [pass%cost])
      if (pass%outcome > finished) call text%say(', '//trim(endings(pass%outcome))//' at t = {reached 3} s', [pass%reached])
      if (pass%outcome == finished) call text%member('reached', json_number(pass%reached))
    end if
    if (pass%column /= '') call text%say('; {worst_column='//trim(pass%column)//'} differs by {worst_error_of_asked 1} of what '// &
                                         'is asked from pass {compared_with #}', [pass%apart, real(k - 1, wp)])
    if (pass%differ_at >= 0.0_wp) call text%say('; events differ from t = {events_differ_from 3} s', [pass%differ_at])
    call text%line('')
    call text%close()
  end subroutine pass_line
end module accuracy_words
