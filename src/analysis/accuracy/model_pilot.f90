!> A pilot: the transient of a changed deck by radau, without files or words, for a question about the model. Two pilots at the same
!> tolerance, one of a better model, tell what the other model makes each column err (theory.md, section 12).
module model_pilot
  use kinds, only: wp, ip
  use accuracy_ladder, only: least, smallest_accuracy, tighter
  use deck_records, only: deck
  use deck_transient, only: default_accuracy
  use errors, only: failure, fault_list, status_failed, status_signal
  use force_element, only: stage_transient
  use scene_run, only: run_state, prepare_run
  use static_analysis, only: run_static
  use result_columns, only: result_column
  use stored_pass, only: compared_columns, pass_difference, pass_rows
  use summary_text, only: summary_record
  use text, only: either
  use transient, only: run_transient, transient_march
  implicit none (type, external)
  private

  real(wp), parameter :: most_work = 1.0e9_wp     !! of all pilots of a question: explicit evaluations times unknowns [-]

  !> What a pilot has shown; errors are told by the difference from the pilot of a better model.
  type, public :: pilot_result
    type(result_column), allocatable :: columns(:)
    type(pass_rows) :: rows
    type(pass_difference) :: off              !! from that pilot
  contains
    procedure :: worst
  end type pilot_result

  !> The pilots of one question.
  type, public :: pilot_series
    real(wp) :: tolerance = 0.0_wp            !! [-]
    real(wp) :: factor = 1.0_wp               !! error of a model over its difference from the better one [-]
    integer(ip) :: began = 0                  !! count of the clock when the program began, for `most_seconds` alone
    integer :: count = 0
    real(wp) :: cost = 0.0_wp                 !! in explicit evaluations [-]
    real(wp) :: work = 0.0_wp                 !! the same times unknowns [-]
    logical :: over = .false.                 !! pilots have cost what they may; no other one is run
  contains
    procedure :: begin
    procedure :: run => run_pilot
  end type pilot_series

contains

  !> The largest error over what a column may err by; huge: not known.
  pure real(wp) function worst(self)
    class(pilot_result), intent(in) :: self
    worst = huge(1.0_wp)                      ! [-]
    if (allocated(self%off%error)) worst = maxval(self%off%error/self%off%asked)
  end function worst

  !> No pilots yet. Their own errors have to be small beside what the columns may err by, and what left-out modes ring by must not
  !> be damped.
  subroutine begin(self, d, began, factor)
    class(pilot_series), intent(out) :: self
    type(deck), intent(in) :: d
    integer(ip), intent(in) :: began          !! count of the clock
    real(wp), intent(in) :: factor            !! error over the difference [-]
    self%tolerance = max(tighter**3*merge(smallest_accuracy(d), default_accuracy, d%transient%accuracy > 0.0_wp), least)
    self%began = began
    self%factor = factor
  end subroutine begin

  !> Runs a pilot, after the static analysis where the deck has one; where it cannot be run to its end, fail says why.
  subroutine run_pilot(self, d, found, fail, reference)
    class(pilot_series), intent(inout) :: self
    type(deck), intent(in) :: d
    type(pilot_result), intent(out) :: found
    type(failure), intent(inout) :: fail
    type(pilot_result), intent(in), optional :: reference   !! of a better model, with the same columns
    type(run_state) :: run
    type(transient_march) :: march
    type(fault_list) :: faults
    type(summary_record) :: unread
    run%d = d
    run%folder = ''
    run%quiet = .true.
    run%began = self%began
    march%pilot = .true.
    associate (r => run%d%transient)
      r%method = 'radau'
      r%adaptive = .true.
      r%tolerance = self%tolerance
      r%first_step = 0.0_wp
      r%max_step = 0.0_wp
      r%check_error = .false.
      r%checkpoint_interval = 0.0_wp
      r%motion_step = 0.0_wp
      r%stabilization = 'projection'
      if (r%most_seconds < huge(1.0_wp)) r%most_seconds = r%most_seconds/2   ! the rest is left to the run
    end associate
    call prepare_run(run, faults, fail)
    self%count = self%count + 1
    if (faults%count > 0) call fail%raise(status_failed, 'a pilot cannot be built: '//faults%items(1)%message)
    unread = summary_record(silent=.true.)
    unread%path = d%path
    if (d%static%present .and. .not. fail%happened()) call run_static(run, unread, fail)
    if (fail%happened()) return
    run%sys%options%stage = stage_transient
    found%columns = compared_columns(run)
    march%budget = (most_work - self%work)/run%sys%m%s%ny
    if (present(reference)) then
      march%rows = reference%rows
    else
      call march%rows%begin(run)
    end if
    call run_transient(run, march, fail)
    self%cost = self%cost + march%cost(run)
    self%work = self%work + march%cost(run)*run%sys%m%s%ny
    self%over = march%stopped .or. fail%status > status_signal
    if (march%stopped) call fail%raise(status_failed, either( &
      'pilots have cost 1e9 explicit evaluations times unknowns', 'most_seconds ended the pilots', march%cost(run) > march%budget))
    if (fail%happened()) return
    if (present(reference)) then
      found%off = march%rows%difference(run, 1.0_wp)
      found%off%error = self%factor*found%off%error
    end if
    call march%rows%turn(lost=.false.)
    found%rows = march%rows
  end subroutine run_pilot
end module model_pilot
