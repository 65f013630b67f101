!> One deck from its file to its results: read, build, assemble, run every analysis that it asks for, write the summary.
module run_deck
  use kinds, only: wp, ip
  use checkpoint, only: read_checkpoint, remove_checkpoint
  use core_advice, only: core_lines
  use deck_json, only: groups_json
  use deck_reader, only: read_deck
  use errors, only: failure, fault_list, status_ok, status_failed, status_bad_input, status_no_output
  use left_out_flexibility, only: flexibility_lines
  use loop_analysis, only: warn_of_loops
  use mass_damping, only: warn_of_mass_damping
  use modal_analysis, only: run_modal
  use model_choice, only: begin_model, choose_model
  use posix, only: make_folder, lock_file, close_lock, hold_signals, write_bytes, standard_error, standard_output, tell
  use response_analysis, only: run_response
  use rigid_mobility, only: mobility_lines
  use scene_figures, only: add_scene
  use kept_files, only: refuse_losses
  use lapack, only: refused_routine
  use linear_state, only: refuse_uneven
  use force_element, only: stage_linear, stage_transient
  use readable_text, only: readable
  use results, only: remove_results, unfinished
  use periodic_analysis, only: run_periodic
  use run_summary, only: begin_results, finish_summary
  use scene_run, only: run_state, prepare_run
  use step_advice, only: stability_advice, advise
  use step_monitor, only: method_number
  use step_counts, only: actual_step
  use pair_advice, only: advise_pairs
  use stop_advice, only: advise_stops
  use static_analysis, only: run_static, refuse_free_bodies
  use summary, only: model_lines
  use summary_text, only: summary_record
  use text, only: either, es_text, to_text
  use accuracy_run, only: run_to_accuracy
  use transient, only: run_transient, transient_march
  use transient_summary, only: transient_lines
  use typical_mistakes, only: warn_of_mistakes
  use validity, only: limits_of_beams
  implicit none (type, external)
  private
  public :: run_one_deck, run_options, print_words

  !> What the command line asks for.
  type :: run_options
    logical :: check = .false.
    logical :: json = .false.                 !! the check's figures instead of its words
    logical :: restart = .false.
    logical :: quiet = .false.
    logical :: flat = .false.                 !! print the deck as one text without expressions
    character(:), allocatable :: settings(:)  !! NAME=VALUE of parameters
    character(:), allocatable :: output       !! folder, empty: results/<deck name>
    character(:), allocatable :: orbit        !! folder of a cycle to start from; empty: none
  end type run_options

contains

  !> Runs one deck; returns its exit status. Messages go to standard error, the check's summary to standard output.
  integer function run_one_deck(path, options) result(status)
    character(*), intent(in) :: path
    type(run_options), intent(in) :: options
    type(run_state) :: run
    type(fault_list) :: faults
    type(failure) :: fail
    type(stability_advice) :: advice
    character(:), allocatable :: words
    type(summary_record) :: text
    logical :: refused, written
    call system_clock(run%began)
    status = status_bad_input
    call read_deck(path, run%d, faults, options%settings, options%flat)
    if (options%flat .and. faults%count == 0) then
      if (options%json) call print_words(path, groups_json(run%d%flat)//new_line('a'), status)
      if (.not. options%json) call print_words(path, run%d%flat, status)
      return
    end if
    if (faults%count == 0) call begin_model(run%d)
    if (faults%count == 0) call prepare_run(run, faults, fail)
    if (faults%count > 0) then
      call faults%print()
      return
    end if
    if (.not. fail%happened()) call refuse_uneven(run, 'analysis', status_bad_input, fail)
    if (run%d%static%present .and. .not. fail%happened()) call refuse_free_bodies(run, fail)
    run%quiet = options%quiet
    run%restart = options%restart
    run%folder = options%output
    run%orbit = options%orbit
    if (len(run%orbit) > 0 .and. .not. run%d%periodic%present) call fail%raise(status_bad_input, &
      '--orbit is the start of a cycle, expected it for a deck with &periodic')
    if (len(run%folder) == 0) run%folder = 'results/'//run%d%name
    if (run%restart .and. .not. (fail%happened() .or. run%d%transient%present)) call fail%raise(status_bad_input, &
      'the deck has no transient that --restart could continue')
    if (run%restart .and. .not. fail%happened()) call read_checkpoint(run%folder, run%d%text, run%d%settings, run%saved, fail)
    if (.not. (options%check .or. fail%happened())) call choose_model(run, fail)
    if (fail%happened()) then
      call fail%tell(path)
      status = fail%status
      return
    end if
    text%path = path
    call model_lines(run%d, run%sys%m, run%assembly, text)
    call warn_of_mistakes(run%d, options%check)
    if (run%model_found) call text%append(run%model_words)
    if (options%check) call mobility_lines(run%d, text)
    if (options%check) call flexibility_lines(run, text)
    if (options%check) call core_lines(run%sys%m, text)
    if (options%check) call text%warn(limits_of_beams(run%sys%m, run%fastest))
    if (options%json .or. .not. options%check) call add_scene(run%d, run%sys%m, run%y(1:run%sys%m%s%nq), text)   ! in JSON alone
    call advise(run, advice)
    call text%append(advice%text)
    call deck_step(run, advice, options%check, text, refused)
    call text%close()
    call advise_stops(run%sys%m, run%sys%ev, run%y(1:run%sys%m%s%nq), text)
    call advise_pairs(run%d, run%sys%m, text)
    call warn_of_loops(run, text)
    call warn_of_mass_damping(run, text)
    if (refused) then
      written = write_bytes(standard_error, readable(advice%text%words%all()))
      return
    end if
    if (options%check) then
      words = readable(text%words%all())
      if (options%json) words = text%json()//new_line('a')
      call print_words(path, words, status)
      return
    end if
    status = run_in_folder(run, text)
  end function run_one_deck

  !> Writes to standard output what the command line asks for in place of a run.
  subroutine print_words(path, words, status)
    character(*), intent(in) :: path, words
    integer, intent(out) :: status
    status = status_ok
    if (write_bytes(standard_output, words)) return
    call tell(path//': standard output cannot be written')
    status = status_no_output
  end subroutine print_words

  !> A little less than a bound, so that its rounded digits are below it [s].
  pure real(wp) function most_of(bound)
    real(wp), intent(in) :: bound           !! [s]
    most_of = 0.98_wp*bound
  end function most_of

  !> Whether the step that the deck asks for is stable, in words. A fixed explicit one above the safe bound is refused, unless the
  !> deck accepts it; a check only warns.
  subroutine deck_step(run, advice, check, text, refused)
    type(run_state), intent(in) :: run
    type(stability_advice), intent(in) :: advice
    logical, intent(in) :: check
    type(summary_record), intent(inout) :: text
    logical, intent(out) :: refused
    character(:), allocatable :: line
    real(wp) :: h                           ! [s]
    integer :: k
    refused = .false.
    associate (r => run%d%transient, m => run%sys%m)
      if (.not. r%present) return
      k = method_number(r%method)
      h = actual_step(r%output_step, merge(r%output_step, r%step, r%adaptive))
      line = trim(r%method)
      if (r%accuracy > 0.0_wp) then
        line = 'accuracy='//to_text(r%accuracy)//': passes that check each other choose the steps'
      else if (k == 0) then
        line = line//', stable with any step for small vibrations: accuracy alone sets it'
      else if (advice%safe%step(k) >= huge(1.0_wp)) then
        line = line//': nothing limits its steps but accuracy'
      else if (r%adaptive) then
        line = line//' with tolerance='//to_text(r%tolerance)//': the error control keeps its steps near or below the current bound'
      else
        line = line//' with step='//to_text(h)//' s, {step_of_safe_bound %} of the safe bound: '
        if (h > advice%safe%step(k)) then
          line = line//'above that bound'
          refused = .not. (check .or. r%accept_unstable)
          call tell(r%at%file//':'//to_text(r%at%line)//': transient/step: '//either('', 'warning: ', refused)//'step = '// &
                    es_text(h, 3)//' s is above the safe bound of '//trim(r%method)//', '//es_text(advice%safe%step(k), 3)// &
                    ' s, set by '//trim(advice%safe%cause(k)%what)//'; expected at most '//es_text(most_of(advice%lowest(k)), 3)// &
                    ' s, or generalized_alpha, or accept_unstable=.true.')
        else if (h > advice%lowest(k)) then
          line = line//'too large where bodies bend as far as the model holds; expected at most '// &
                 to_text(most_of(advice%lowest(k)))//' s'
          call text%warn('step='//to_text(h)//' s is too large where bodies bend as far as the model holds; expected at '// &
                         'most '//to_text(most_of(advice%lowest(k)))//' s')
        else if (len(advice%provided) > 0) then
          line = line//'stable as long as '//advice%provided//' stay as at the start'
        else
          line = line//'stable'
        end if
      end if
      call text%line('  this deck: '//line, [h/advice%safe%step(max(k, 1))])
      if (r%method /= 'generalized_alpha') return
      do k = 1, m%s%permanent
        associate (c => m%s%constraints(k)%item)
          if (c%line_turns()) call text%line('    where the line of "'//trim(c%name)//'" turns that is not proven; radau is '// &
                                             'stable there')
        end associate
      end do
    end associate
  end subroutine deck_step

  !> Runs the analyses with the results folder locked.
  integer function run_in_folder(run, text) result(status)
    type(run_state), intent(inout) :: run
    type(summary_record), intent(inout) :: text         !! the summary so far
    type(failure) :: fail
    type(transient_march) :: march
    character(:), allocatable :: refused
    integer :: lock
    logical :: ok
    integer(ip) :: t0, t1, rate
    real(wp) :: p0, p1                        !! time of the processor [s]
    status = status_no_output
    call refuse_losses(run, fail)
    if (fail%happened()) then
      call fail%tell(run%d%path)
      status = fail%status
      return
    end if
    call hold_signals(1)
    call make_folder(run%folder)
    lock = lock_file(run%folder//'/.lock')
    if (lock < 0) call tell(run%d%path//': results cannot be written into "'//run%folder//'"')
    if (lock == 0) call tell(run%d%path//': another run is writing into "'//run%folder//'"')
    if (lock <= 0) call hold_signals(0)
    if (lock <= 0) return
    call system_clock(t0, rate)
    call cpu_time(p0)
    run%opening = text
    if (.not. run%restart) call begin_results(run, fail)
    if (.not. fail%happened()) call refuse_uneven(run, 'analysis', status_bad_input, fail)
    if (run%d%static%present .and. .not. fail%happened()) call run_static(run, text, fail)
    if (.not. run%d%static%present) run%sys%options%stage = stage_linear
    if (run%d%modal%present .and. .not. fail%happened()) call run_modal(run, text, fail)
    if (run%d%response%present .and. .not. fail%happened()) call run_response(run, text, fail)
    call text%warn(limits_of_beams(run%sys%m, run%fastest), outside=.true.)
    if (run%d%periodic%present .and. .not. fail%happened()) call run_periodic(run, text, fail)
    if (run%d%transient%present .and. .not. fail%happened()) then
      run%sys%options%stage = stage_transient
      if (run%d%transient%accuracy > 0.0_wp .or. run%d%transient%check_error) then
        call run_to_accuracy(run, march, text, fail)
      else
        call run_transient(run, march, fail)
        call transient_lines(run, march, fail%status, text)
        call text%close()
      end if
    end if
    refused = refused_routine()
    if (len(refused) > 0) fail = failure()
    if (len(refused) > 0) call fail%raise(status_failed, 'the linear algebra library refuses a matrix ('//refused// &
                                          '), so that no result can be trusted; this is a fault of biela')
    call system_clock(t1)
    call cpu_time(p1)
    ok = .true.
    if (fail%status /= status_bad_input) call finish_summary(run, fail, [real(t1 - t0, wp)/real(rate, wp), p1 - p0], &
                                                            march%restarts, text, ok)
    if (ok .and. .not. fail%happened()) call remove_checkpoint(run%folder)
    if (march%ladder%over) call remove_results(run%folder, unfinished)
    call close_lock(lock)
    call hold_signals(0)
    status = fail%status
    if (.not. ok .and. status == status_ok) then
      status = status_no_output
      call tell(run%d%path//': results cannot be written into "'//run%folder//'"')
    end if
    if (fail%happened()) call fail%tell(run%d%path)
  end function run_in_folder
end module run_deck
