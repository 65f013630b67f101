!> What the summary says of a transient's accuracy: the estimated errors of columns where the deck asks for them. The energy
!> balance does not bound them: a vibration that is late keeps its energy. Only a second run tells errors of columns.
module accuracy_words
  use kinds, only: wp
  use accuracy_ladder, only: setting_words
  use balance_words, only: balance_lines, closing_lines, distrusted
  use column_ranges, only: column_range
  use errors, only: failure
  use scene_run, only: run_state
  use result_columns, only: result_column
  use stored_pass, only: compared_columns, pass_rows
  use summary_text, only: json_number, summary_record
  use text, only: either, short_text, to_text
  use transient, only: transient_march
  implicit none (type, external)
  private
  public :: accuracy_lines, asked_errors, column_lines, error_lines

  real(wp), parameter :: rounding = 1.0e-9_wp          !! residual that may be rounding, of the energy that moved [-]
  real(wp), parameter :: least_range = 1.0e-3_wp       !! that counts, of the largest one of its kind [-]
  real(wp), parameter, public :: modes_share = 0.5_wp  !! of what a column may err by that left-out modes may take [-]
  real(wp), parameter :: converging = 0.5_wp           !! residual of the second run, of the first one's, at most [-]

contains

  !> All of it; lost: the run could not go on.
  subroutine accuracy_lines(run, march, lost, text)
    type(run_state), intent(in) :: run
    type(transient_march), intent(in) :: march
    logical, intent(in) :: lost
    type(summary_record), intent(inout) :: text
    call closing_lines(run, march, text)
    if (lost) then
      call text%line('  accuracy: unknown, the run failed; its last rows may be wrong')
      return
    end if
    call balance_lines(run, march, text)
    if (march%ladder%estimates) return
    if (march%rows%filled) then
      call error_lines(run, march, failure(), text)
    else if (march%ladder%active) then
      call text%line('  accuracy: unknown, there is no other pass to compare this one with')
    else
      call text%line('  accuracy: the energy balance does not bound errors of columns: a vibration that is late keeps its '// &
                    'energy; check_error=.true. in &transient estimates the error of every column')
    end if
  end subroutine accuracy_lines

  !> The estimated errors of all columns; those of a second run with a warning where some are large or the estimate is doubtful.
  subroutine error_lines(run, march, fail, text)
    type(run_state), intent(in) :: run
    type(transient_march), intent(in) :: march
    type(failure), intent(in) :: fail          !! how this pass ended
    type(summary_record), intent(inout) :: text
    real(wp), allocatable :: e(:), range(:), x(:), asked(:)   ! [of the column], x of the range [-]
    type(column_range) :: seen
    type(result_column), allocatable :: columns(:)
    character(:), allocatable :: doubt
    integer :: k
    columns = compared_columns(run)
    associate (c => march%rows, ladder => march%ladder, ratio => march%ladder%error_ratio())
      if (.not. ladder%over .and. ladder%estimates) then
        call text%line('  accuracy: unknown, the second run did not come to its end')
        return
      end if
      seen = march%compared_range()
      range = seen%moved(run%sys%m%s, columns, run%d%transient%t_end)
      e = ratio*merge(c%agreed, c%error, c%differ_at >= 0.0_wp)
      if (ladder%estimates) then
        call text%line('  estimated errors, from a second run with '//either('a tenth of the tolerance', 'half the step', &
          run%d%transient%adaptive)//' ({second_evaluations #} evaluations):', [march%cost(run)])
        call column_lines('estimated_errors', columns, e, range, text)
      else
        associate (other => ladder%passes(ladder%stored))
          call text%line('  estimated errors, the difference from pass {compared_with #} ('//trim(other%method)// &
                         setting_words(other)//'):', [real(wp) :: ladder%stored])
        end associate
        asked = asked_errors(run, seen)
        x = e
        if (allocated(run%model_error)) call text%line('    (those of left-out modes and of meshes included)')
        if (allocated(run%model_error)) where (asked < huge(1.0_wp)) x = e + run%model_error
        call column_lines('estimated_errors', columns, x, range, text, e > asked)
      end if
      call event_words(run, c, ratio, text)
      if (.not. ladder%estimates) return
      call text%line('  energy residual of the second run: largest {second_energy_residual 3} J', [march%balance%largest_residual])
      doubt = doubts(march, fail)
      call text%warn(doubt)
      x = 0*e
      where (range > 0.0_wp) x = e/range
      k = maxloc(x, 1)
      call text%line('  accuracy: '//either('unknown, columns may err by more than was estimated; the worst one: ', &
        'the worst column, ', len(doubt) > 0)//'{worst_column='//trim(columns(k)%label())//'}'//either(', ', &
        ', errs by an estimated ', len(doubt) > 0)//'{worst_error_of_range 1} of its range', x(k:k))
      if (x(k) > distrusted) call text%warn(to_text(count(x > distrusted))//' of '//to_text(size(x))//' columns err by more '// &
        'than '//short_text(distrusted, 1)//' of their range, the worst, '//trim(columns(k)%label())//', by an estimated '// &
        short_text(x(k), 1)//'; use a smaller step or tolerance')
    end associate
  end subroutine error_lines

  !> Errors of columns.
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
      share(k) = '  (constant but for rounding)'
      if (range(k) > 0.0_wp) share(k) = ' '//short_text(error(k)/range(k), 1)
      if (present(too_large)) share(k) = trim(share(k))//either(', more than is asked', '', too_large(k))
    end do
    call text%table(name, columns%label(), error, 2, share)
    call text%open(name//'_of_range', '{')
    do k = 1, size(error)
      if (range(k) > 0.0_wp) call text%member(trim(columns(k)%label()), json_number(error(k)/range(k)))
    end do
    call text%close()
  end subroutine column_lines

  !> The error that each column may have beside that of the model [of the column]: the accuracy of its sensor times its range, or
  !> the sensor's floor; any where a column is constant but for rounding, or counts states or elements. A range counts at least a
  !> thousandth of the largest one of the same quantity and unit: a column that hardly moves beside them shall not set the cost.
  function asked_errors(run, seen, absolute) result(asked)
    type(run_state), intent(in) :: run
    type(column_range), intent(in) :: seen
    real(wp), intent(out), optional :: absolute(:)   !! (columns) that error where the range alone does not set it, else 0 [of it]
    real(wp), allocatable :: asked(:)
    real(wp), allocatable :: range(:)          ! [of the column]
    type(result_column), allocatable :: columns(:)
    logical, allocatable :: alike(:)
    real(wp) :: accuracy, floor, counted       ! [-], [of the column]
    integer :: k, n
    columns = compared_columns(run)
    range = seen%moved(run%sys%m%s, columns, run%d%transient%t_end)
    asked = spread(huge(1.0_wp), 1, size(columns))
    if (present(absolute)) absolute = 0.0_wp
    do k = 1, size(columns)
      if (.not. range(k) > 0.0_wp .or. columns(k)%unit == '-') cycle
      accuracy = run%d%transient%accuracy
      floor = 0.0_wp
      n = count(run%list%first <= k)
      if (n > 0) floor = run%d%sensors(n)%floor
      if (n > 0) accuracy = merge(run%d%sensors(n)%accuracy, accuracy, run%d%sensors(n)%accuracy > 0.0_wp)
      alike = columns%quantity == columns(k)%quantity .and. columns%unit == columns(k)%unit
      counted = max(range(k), least_range*maxval(range, alike))
      asked(k) = max(accuracy*counted, floor)
      if (present(absolute) .and. asked(k) > accuracy*range(k)) absolute(k) = asked(k)
    end do
    if (allocated(run%model_error)) where (asked < huge(1.0_wp)) asked = max(asked - run%model_error, (1 - modes_share)*asked)
  end function asked_errors

  !> How well the times of events are known, and up to when the sequences of both runs agree.
  subroutine event_words(run, c, ratio, text)
    type(run_state), intent(in) :: run
    type(pass_rows), intent(in) :: c
    real(wp), intent(in) :: ratio              !! error over the difference [-]
    type(summary_record), intent(inout) :: text
    if (run%sys%roots == 0) return
    call text%line('  events of both runs: {events_compared #}, their times err by an estimated {event_time_error 2} s at most', &
                   [real(wp) :: c%matched, ratio*c%event_error])
    if (c%differ_at < 0.0_wp) return
    call text%line('  events differ from t = {events_differ_from 6} s', [c%differ_at])
    call text%warn('from t = '//short_text(c%differ_at, 6)//' s on the event sequences of both runs differ: rows beyond are '// &
                   'not predictable, and their errors not estimated')
  end subroutine event_words

  !> Why the estimate may be too small; empty: no reason. A vibration that both runs damp away is missing in both: the second
  !> one's energy balance then closes no better.
  function doubts(march, fail) result(text)
    type(transient_march), intent(in) :: march
    type(failure), intent(in) :: fail          !! of the second run
    character(:), allocatable :: text
    text = ''
    associate (first => march%ladder%passes(1))
      if (fail%happened()) then
        text = 'the second run failed after t = '//short_text(march%last, 3)//' s: errors are unknown from there on'
      else if (first%share > rounding .and. march%balance%largest_residual > converging*first%residual) then
        text = 'the energy balance of the second run closes hardly better: vibrations that both runs damp away between rows '// &
               'are missing in these estimates; a smaller output_step or step shows them'
      end if
    end associate
  end function doubts
end module accuracy_words
