!> Why a march stopped, in one paragraph: what happened, when, which body or joints, what to try.
module march_failure
  use kinds, only: wp
  use error_groups, only: fastest_growth, out_of_shape
  use errors, only: failure, status_failed
  use assembly_conflict, only: deck_line_of
  use assembly_reports, only: too_uneven, weakest_constraint, weakest_text, widest_gap
  use contact_mass, only: drives_against, mass_at
  use evaluation_results, only: evaluation
  use motion_watch, only: switch_watch
  use root_watch, only: most_roots
  use scene_run, only: run_state
  use slipping, only: painleve_ratio
  use step_control, only: error_norm
  use switching, only: element_name, too_soft
  use text, only: fixed_text, short_text
  use time_stepper, only: stepper, trouble_size, trouble_manifold, trouble_accuracy, trouble_iteration, trouble_shape, &
                          trouble_events, trouble_system
  implicit none (type, external)
  private
  public :: explain_loss, explain_balance, explain_shape, explain_drift

  character(*), parameter :: too_large = 'the step is too large for stability or for the motion there: try a smaller one '// &
                                         '(biela --check tells the stable ones), or dopri5 with a tolerance'

  integer, parameter :: trouble_masses = -1    !! a cause that no stepper reports: uneven masses
  real(wp), parameter :: nearly_locked = 0.9_wp   !! Painleve's ratio from which friction is named as the cause [-]
  real(wp), parameter :: shortest_step = 1.0e-9_wp   !! stable step over the run: rounding disturbs faster motion [-]

  character(*), parameter :: beyond_reach = '; joints and drives may demand the impossible there, such as a drive beyond '// &
                                            'the reach of the mechanism'

contains

  !> A march that its method gave up.
  subroutine explain_loss(run, norm, march, last, fail)
    type(run_state), intent(in) :: run
    type(error_norm), intent(in) :: norm
    class(stepper), intent(in) :: march
    real(wp), intent(in) :: last               !! time of the last row [s]
    type(failure), intent(inout) :: fail
    character(:), allocatable :: text
    real(wp), allocatable :: ratios(:)
    integer :: b, trouble
    b = 0
    if (march%trouble == trouble_shape) b = out_of_shape(norm, size(run%sys%m%s%bodies))
    if (b > 0) then
      call explain_shape(run, b, march%tried, last, fail)
      return
    end if
    trouble = merge(trouble_masses, march%trouble, run%sys%ev%schur%was_ill_conditioned .and. march%trouble /= trouble_size)
    ratios = ratios_now(run)
    if (any(ratios > nearly_locked) .and. trouble /= trouble_masses) trouble = trouble_system
    select case (trouble)
    case (trouble_system)
      if (run%sys%sunk > 0) then
        text = 'at t = '//number(march%t)//' s '//too_soft(run%sys%m, run%sys%sunk)
      else
        text = friction_fault(run, ratios, march%t)
      end if
    case (trouble_masses)
      text = 'the run cannot go on after t = '//number(march%t)//' s: '//too_uneven//weakest_text(run%sys%m, run%sys%ev)
    case (trouble_manifold)
      text = 'the joints cannot be kept closed after t = '//number(march%t)//' s: '//widest_gap(run%sys%m, run%sys%ev)// &
             ' at t = '//number(march%tried)//' s'//beyond_reach// &
             advice('or the step is too large: check the drive, or try a smaller step', &
                    'check the drive and the geometry', run)
    case (trouble_accuracy)
      text = 'the step became too small at t = '//number(march%t)//' s: the tolerance cannot be kept'// &
             growing_body(run, norm, march%trial)//largest_reactions(run)
      if (run%stable_step < shortest_step*run%d%transient%t_end) then
        text = text//'; light masses or stiff springs ask for steps below '//number(run%stable_step)//' s, whose motion '// &
               'rounding shakes: check them, or use radau'
      else
        text = text//'; the motion may be singular there, or rounding sets the estimated error, where large values cancel '// &
               '(springs wound or stretched far, places far from the origin): check loads, drives and positions, or try a '// &
               'larger tolerance'
      end if
    case (trouble_iteration)
      text = 'the equations of a step could not be solved at t = '//number(march%tried)//' s'//growing_body(run, norm, march%trial)
      if (run%sys%m%s%rows > 0) then
        text = text//beyond_reach//advice('or the step is too large: check the drive, or try a smaller step', &
                                          'check the drive and the geometry', run)
      else
        text = text//advice('try a smaller step', 'try a larger tolerance', run)
      end if
    case (trouble_events)
      b = choice_to_and_fro(run, march%roots%fallen)
      if (run%sys%conflict > 0) then
        text = rigid_conflict(run, march%t)
      else if (b > 0) then
        text = 'history "'//element_name(run%sys%m, b)//'" switches to and fro without end at t = '//number(march%t)// &
               ' s: what each of its histories does drives its column back to the level. Expected friction of a joint, which '// &
               'holds what it brakes, or in place of the switch a table over the column that rises steeply there'
      else
        text = 'events follow one another without end at t = '//number(march%t)//' s, in'// &
               last_elements(run, march%roots%fallen)//': more than 1000 in a millionth of the run; their limits may '// &
               'exclude one another, or a drive may press against a limit that yields too little: check limits and stiffnesses'
      end if
    case default      ! trouble_size
      text = 'the solution diverged at t = '//number(march%tried)//' s'//growing_body(run, norm, march%trial)
      text = text//advice(too_large, 'no step is small enough: check the loads', run)
    end select
    call fail%raise(status_failed, text//'. '//complete_until(last))
    if (trouble /= trouble_masses) return
    b = weakest_constraint(run%sys%m, run%sys%ev)
    if (b > 0) fail%deck_line = deck_line_of(run%d, b)
  end subroutine explain_loss

  !> Painleve's ratio of each joint with friction when it was last checked; where the last evaluation has found no force that meets
  !> the law, also there.
  function ratios_now(run) result(ratios)
    type(run_state), intent(in) :: run
    real(wp), allocatable :: ratios(:)         ! [-]
    type(evaluation) :: work
    integer :: k
    allocate (ratios(0))
    if (.not. allocated(run%sys%painleve)) return
    ratios = run%sys%painleve
    if (.not. run%sys%ev%broken) return
    work = run%sys%ev
    do k = 1, size(ratios)
      ratios(k) = max(ratios(k), painleve_ratio(run%sys%m, work, k, .false.))
    end do
  end function ratios_now

  !> Which joint with friction has no motion of rigid bodies that satisfies its law.
  function friction_fault(run, ratios, t) result(text)
    type(run_state), intent(in) :: run
    real(wp), intent(in) :: ratios(:)          !! (joints with friction) [-]
    real(wp), intent(in) :: t                  !! [s]
    character(:), allocatable :: text
    real(wp) :: ratio
    integer :: k
    associate (m => run%sys%m)
      k = maxloc(ratios, 1)
      ratio = ratios(k)
      if (.not. ratio > nearly_locked) then
        text = 'no joint with friction was found to stick or slip by its law at t = '//number(t)//' s'//largest_reactions(run)// &
               '; expected smaller coefficients, or elastic bodies that decide how joints share a load'
        return
      end if
      text = 'joint "'//element_name(m, size(m%s%switching) + k)//'" at t = '//number(t)//' s: its friction presses '// &
             fixed_text(ratio, 3)//' times as hard as it brakes'
      if (ratio < 1.0_wp) text = text//', and harder from here on'
      text = text//'; rigid bodies have no (or two) accelerations there (Painleve); a friction below '// &
             fixed_text(m%s%friction(k)%kinetic/ratio, 3)//', or an elastic link, has one'
    end associate
  end function friction_fault

  !> A march whose energies say that the solution is lost, though its numbers are finite.
  subroutine explain_balance(run, norm, t, last, residual, energy, fail)
    type(run_state), intent(in) :: run         !! its state is that at t
    type(error_norm), intent(in) :: norm
    real(wp), intent(in) :: t, last            !! refused time, time of the last row [s]
    real(wp), intent(in) :: residual, energy   !! at t; largest before [J]
    type(failure), intent(inout) :: fail
    call fail%raise(status_failed, 'the solution diverged before t = '//number(t)//' s: the energy balance is off by '// &
                    number(residual)//' J, where energies were up to '//number(energy)//' J'// &
                    growing_body(run, norm, run%y)//largest_reactions(run)// &
                    advice(too_large, 'check drives and near-singular positions, or try a smaller tolerance', run)//'. '// &
                    complete_until(last))
  end subroutine explain_balance

  !> A body whose deflections have no meaning any more, though the equations are integrated well.
  subroutine explain_shape(run, b, t, last, fail)
    type(run_state), intent(in) :: run
    integer, intent(in) :: b                   !! body
    real(wp), intent(in) :: t, last            !! refused time, time of the last row [s]
    type(failure), intent(inout) :: fail
    call fail%raise(status_failed, 'the solution diverged before t = '//number(t)//' s: body '//name_of(run, b)// &
                    ' deflects by more than a thousand times the size of the scene'// &
                    advice(too_large//'; or ', '', run)//'the motion itself grows without bound: a beam that spins '// &
                    'faster than its first bending frequency needs stiffening=.true., loads may exceed a buckling load. '// &
                    complete_until(last))
  end subroutine explain_shape

  !> Joints that have drifted apart in a run that does not close them.
  subroutine explain_drift(run, t, last, fail)
    type(run_state), intent(in) :: run
    real(wp), intent(in) :: t, last            !! refused time, time of the last row [s]
    type(failure), intent(inout) :: fail
    call fail%raise(status_failed, 'the joints have drifted apart by t = '//number(t)//' s: '// &
                    widest_gap(run%sys%m, run%sys%ev)//', more than a hundredth of the scene''s size; a drive may demand '// &
                    'the impossible there; try '// &
                    'stabilization=''projection'', or a smaller step or tolerance. '//complete_until(last))
  end subroutine explain_drift

  !> A rigid stop that is pressed by a part which cannot move back.
  function rigid_conflict(run, t) result(text)
    type(run_state), intent(in) :: run
    real(wp), intent(in) :: t                  !! [s]
    character(:), allocatable :: text, drives
    type(evaluation) :: work
    work = run%sys%ev
    associate (k => run%sys%m%s%switching(run%sys%conflict))
      drives = ''
      if (.not. mass_at(run%sys%m, work, k) < huge(1.0_wp)) drives = drives_against(run%sys%m, work)
      text = 'stop "'//trim(run%sys%m%s%forces(k)%item%name)//'" is rigid, and what presses on it at t = '//number(t)// &
             ' s cannot give way'
    end associate
    if (len(drives) > 0) text = text//': it is moved by drive'//drives
    text = text//'; give the stop a stiffness, or check drives and limits'
  end function rigid_conflict

  !> The switch of a load's factor that fell at the last event, its number among the elements that switch; 0: none did.
  pure integer function choice_to_and_fro(run, fallen) result(i)
    type(run_state), intent(in) :: run
    logical, intent(in) :: fallen(:)           !! (roots) those of the last event
    do i = size(run%sys%m%s%switching), 1, -1
      if (.not. any(fallen(most_roots*(i - 1) + 1:most_roots*i))) cycle
      select type (f => run%sys%m%s%forces(run%sys%m%s%switching(i))%item)
      class is (switch_watch)
        return
      end select
    end do
  end function choice_to_and_fro

  !> The elements and controllers of the last events, also of those that changed no state, as part of a sentence.
  function last_elements(run, fallen) result(text)
    type(run_state), intent(in) :: run
    logical, intent(in) :: fallen(:)           !! (roots) those of the last event
    character(:), allocatable :: text
    logical :: named(run%sys%m%s%elements + size(run%sys%m%s%controllers))
    integer :: k, n
    text = ''
    associate (list => run%sys%events)
      named = any(reshape(fallen, [most_roots, size(named)]), 1)
      do k = max(1, list%count - 99), list%count
        named(list%items(k)%element) = .true.
      end do
      n = 0
      do k = 1, size(named)
        if (named(k)) n = n + 1
        if (.not. named(k) .or. n > 5) cycle
        if (n < 5) text = text//' "'//element_name(run%sys%m, k)//'"'
        if (n == 5) text = text//' and others'
      end do
    end associate
  end function last_elements

  !> The body that grows most, as part of a sentence.
  function growing_body(run, norm, y) result(text)
    type(run_state), intent(in) :: run
    type(error_norm), intent(in) :: norm
    real(wp), intent(in) :: y(:)               !! (n) the state given up [m, rad], [m/s, rad/s], [J]
    character(:), allocatable :: text
    integer :: b
    b = fastest_growth(norm, size(run%sys%m%s%bodies), y)
    text = ''
    if (b > 0) text = ', the coordinates of body '//name_of(run, b)//' grow most'
  end function growing_body

  !> A body's name in quotes.
  function name_of(run, b) result(text)
    type(run_state), intent(in) :: run
    integer, intent(in) :: b                   !! body
    character(:), allocatable :: text
    text = '"'//trim(run%sys%m%s%bodies(b)%name)//'"'
  end function name_of

  !> The joints and drives with the largest multipliers at the last evaluation, as part of a sentence.
  function largest_reactions(run) result(text)
    type(run_state), intent(in) :: run
    character(:), allocatable :: text
    real(wp) :: force(size(run%sys%m%s%constraints))   !! [N]
    real(wp) :: largest
    integer :: k, n
    text = ''
    if (size(force) == 0) return
    do k = 1, size(force)
      associate (c => run%sys%m%s%constraints(k)%item)
        force(k) = maxval(abs(run%sys%ev%lambda(c%first:c%first + c%rows - 1)))
      end associate
    end do
    largest = maxval(force)
    do n = 1, min(4, size(force))
      k = maxloc(force, 1)
      if (n > 1 .and. force(k) < 1.0e-2_wp*largest) exit
      if (n > 1) text = text//','
      text = text//' "'//trim(run%sys%m%s%constraints(k)%item%name)//'"'
      force(k) = -1.0_wp
    end do
    text = ', the largest reactions are those of'//text
  end function largest_reactions

  !> What to try, for fixed and for adaptive steps.
  pure function advice(fixed, free, run) result(text)
    character(*), intent(in) :: fixed, free
    type(run_state), intent(in) :: run
    character(:), allocatable :: text
    text = '; '//fixed
    if (run%d%transient%adaptive) text = '; '//free
  end function advice

  !> Up to when results are complete.
  function complete_until(last) result(text)
    real(wp), intent(in) :: last               !! [s]
    character(:), allocatable :: text
    text = 'Results up to t = '//number(last)//' s are complete'
  end function complete_until

  !> A number in a few digits.
  function number(x) result(text)
    real(wp), intent(in) :: x                  !! [any]
    character(:), allocatable :: text
    text = short_text(x, 6)
  end function number
end module march_failure
