!> Why a march stopped, in one paragraph: what happened, when, which body or joints, what to try.
module march_failure
  use kinds, only: wp
  use error_groups, only: fastest_growth, out_of_shape
  use errors, only: failure, status_failed
  use assembly_conflict, only: deck_line_of
  use assembly_reports, only: too_uneven, weakest_constraint, weakest_text, widest_gap
  use contact_mass, only: drives_against, mass_at
  use evaluation_results, only: evaluation
  use root_watch, only: most_roots
  use scene_run, only: run_state
  use slipping, only: painleve_ratio
  use sorting, only: ascending
  use step_control, only: error_norm
  use step_counts, only: actual_step
  use step_monitor, only: method_number
  use summary, only: weak_frames
  use switching, only: element_name, too_soft
  use text, only: either, fixed_text, in_quotes, short_text
  use time_stepper, only: stepper, trouble_size, trouble_manifold, trouble_accuracy, trouble_iteration, trouble_shape, &
                          trouble_events, trouble_system
  implicit none (type, external)
  private
  public :: explain_loss, explain_balance, explain_shape, explain_drift

  character(*), parameter :: too_large = '; the step is too large for stability or for the motion there: try a smaller one '// &
                                         '(biela --check tells the stable ones), or dopri5 with a tolerance'
  integer, parameter :: trouble_masses = -1    !! a cause that no stepper reports: uneven masses
  real(wp), parameter :: nearly_locked = 0.9_wp   !! Painleve's ratio from which friction is named as the cause [-]
  integer, parameter :: most_named = 4

contains

  !> A march that its method gave up.
  subroutine explain_loss(run, norm, march, last, fail)
    type(run_state), intent(in) :: run
    type(error_norm), intent(in) :: norm
    class(stepper), intent(in) :: march
    real(wp), intent(in) :: last               !! time of the last row [s]
    type(failure), intent(inout) :: fail
    character(:), allocatable :: text, at, growing
    real(wp), allocatable :: ratios(:)
    integer :: b, trouble
    b = 0
    if (march%trouble == trouble_shape) b = out_of_shape(norm, size(run%sys%m%s%bodies))
    if (b > 0) then
      call explain_shape(run, b, march%tried, last, fail)
      return
    end if
    trouble = merge(trouble_masses, march%trouble, run%sys%ev%schur%was_ill_conditioned .and. march%trouble /= trouble_size)
    if (any(trouble == [trouble_masses, trouble_manifold]) .and. is_above_bound(run)) trouble = trouble_size
    ratios = ratios_now(run)
    if (any(ratios > nearly_locked) .and. trouble /= trouble_masses) trouble = trouble_system
    at = ' at t = '//short_text(march%t, 6)//' s'
    growing = growing_body(run, norm, march%trial)
    select case (trouble)
    case (trouble_system)
      if (run%sys%sunk > 0) then
        text = at(2:)//' '//too_soft(run%sys%m, run%sys%sunk)
      else
        text = friction_fault(run, ratios, at)
      end if
    case (trouble_masses)
      text = weak_frames(run%sys%m)
      if (len(text) == 0) text = too_uneven//weakest_text(run%sys%m, run%sys%ev)
      text = 'the run cannot go on after t = '//short_text(march%t, 6)//' s: '//text
    case (trouble_manifold)
      if (run%sys%m%s%rows > 0) then
        text = 'the joints cannot be kept closed after t = '//short_text(march%t, 6)//' s: '//widest_gap(run%sys%m, run%sys%ev)// &
               ' at t = '//short_text(march%tried, 6)//' s'//impossible(run)
      else
        text = 'the motion has no finite state after t = '//short_text(march%t, 6)//' s'//growing//': the step may be too large'
      end if
    case (trouble_accuracy)
      text = 'the step became too small'//at//': the tolerance cannot be kept'//growing//largest_reactions(run)// &
             '; the motion may be singular there (a drive beyond the reach of the mechanism, a dead centre), rounding may set '// &
             'the estimated error (large values that cancel: springs wound or stretched far, places far from the origin), or '// &
             'light masses on stiff springs may be too fast (biela --check tells): check these and the loads, or try a larger '// &
             'tolerance or radau'
    case (trouble_iteration)
      text = 'the equations of a step could not be solved at t = '//short_text(march%tried, 6)//' s'//growing
      if (run%sys%m%s%rows > 0) then
        text = text//impossible(run)
      else
        text = text//'; try a '//either('larger tolerance', 'smaller step', run%d%transient%adaptive)
      end if
    case (trouble_events)
      if (run%sys%conflict > 0) then
        text = rigid_conflict(run, at)
      else
        text = 'events follow one another without end'//at//', in'//last_elements(run, march%roots%fallen)//': more than 1000 '// &
               'in a millionth of the run. Limits may exclude one another, a drive press against one that yields too little, '// &
               'an explicit step be too large (biela --check tells), or a history of kind=''switch'' drive its column back to '// &
               'its level: check limits, stiffnesses and steps; in place of a switch take friction of a joint, or a table '// &
               'that rises steeply'
      end if
    case default      ! trouble_size
      text = 'the solution diverged at t = '//short_text(march%tried, 6)//' s'//growing// &
             either('; no step is small enough: check the loads', too_large, run%d%transient%adaptive)
    end select
    call give_up(text, last, fail)
    if (trouble /= trouble_masses) return
    b = weakest_constraint(run%sys%m, run%sys%ev)
    if (b > 0) fail%deck_line = deck_line_of(run%d, b)
  end subroutine explain_loss

  !> Whether a fixed explicit step is above a bound that is known: what else is found of a lost run is its consequence.
  pure logical function is_above_bound(run) result(above)
    type(run_state), intent(in) :: run
    integer :: k
    above = .false.
    k = method_number(run%d%transient%method)
    if (k == 0 .or. run%d%transient%adaptive) return
    above = actual_step(run%d%transient%output_step, run%d%transient%step) > min(run%stable_steps(k), run%monitor%smallest)
  end function is_above_bound

  !> Ends the run with a paragraph.
  subroutine give_up(text, last, fail)
    character(*), intent(in) :: text
    real(wp), intent(in) :: last               !! time of the last row [s]
    type(failure), intent(inout) :: fail
    call fail%raise(status_failed, text//'. Results up to t = '//short_text(last, 6)//' s are complete')
  end subroutine give_up

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
  function friction_fault(run, ratios, at) result(text)
    type(run_state), intent(in) :: run
    real(wp), intent(in) :: ratios(:)          !! (joints with friction) [-]
    character(*), intent(in) :: at             !! when, in words
    character(:), allocatable :: text
    real(wp) :: ratio
    integer :: k
    associate (m => run%sys%m)
      k = maxloc(ratios, 1)
      ratio = ratios(k)
      if (.not. ratio > nearly_locked) then
        text = 'no joint with friction was found to stick or slip by its law'//at//largest_reactions(run)//'; expected smaller '// &
               'coefficients, or elastic bodies that decide how joints share a load'
        return
      end if
      text = 'joint "'//element_name(m, size(m%s%switching) + k)//'"'//at//': its friction presses '//fixed_text(ratio, 3)// &
             ' times as hard as it brakes'//either(', and harder from here on', '', ratio < 1.0_wp)//'; rigid bodies have no '// &
             '(or two) accelerations there (Painleve); a friction below '// &
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
    call give_up('the solution diverged before t = '//short_text(t, 6)//' s: the energy balance is off by '// &
                 short_text(residual, 6)//' J, where energies were up to '//short_text(energy, 6)//' J'// &
                 growing_body(run, norm, run%y)//largest_reactions(run)// &
                 either('; check drives and near-singular positions, or try a smaller tolerance', too_large, &
                        run%d%transient%adaptive), last, fail)
  end subroutine explain_balance

  !> A body whose deflections have no meaning any more, though the equations are integrated well.
  subroutine explain_shape(run, b, t, last, fail)
    type(run_state), intent(in) :: run
    integer, intent(in) :: b                   !! body
    real(wp), intent(in) :: t, last            !! refused time, time of the last row [s]
    type(failure), intent(inout) :: fail
    call give_up('the solution diverged before t = '//short_text(t, 6)//' s: body'//in_quotes([run%sys%m%s%bodies(b)%name])// &
                 ' deflects by more than a thousand times the size of the scene'// &
                 either('; ', too_large//'; or ', run%d%transient%adaptive)//'the motion itself grows without bound: a beam '// &
                 'that spins faster than its first bending frequency needs stiffening=.true., loads may exceed a buckling load', &
                 last, fail)
  end subroutine explain_shape

  !> Joints that have drifted apart in a run that does not close them.
  subroutine explain_drift(run, t, last, fail)
    type(run_state), intent(in) :: run
    real(wp), intent(in) :: t, last            !! refused time, time of the last row [s]
    type(failure), intent(inout) :: fail
    call give_up('the joints have drifted apart by t = '//short_text(t, 6)//' s: '//widest_gap(run%sys%m, run%sys%ev)// &
                 ', more than a hundredth of the scene''s size; a drive may demand the impossible there; try '// &
                 'stabilization=''projection'', or a smaller step or tolerance', last, fail)
  end subroutine explain_drift

  !> A rigid stop that is pressed by a part which cannot move back.
  function rigid_conflict(run, at) result(text)
    type(run_state), intent(in) :: run
    character(*), intent(in) :: at             !! when, in words
    character(:), allocatable :: text
    type(evaluation) :: work
    work = run%sys%ev
    associate (k => run%sys%m%s%switching(run%sys%conflict))
      text = 'stop "'//trim(run%sys%m%s%forces(k)%item%name)//'" is rigid, and what presses on it'//at//' cannot give way'
      if (.not. mass_at(run%sys%m, work, k) < huge(1.0_wp)) then
        if (len(drives_against(run%sys%m, work)) > 0) text = text//': it is moved by drive'//drives_against(run%sys%m, work)
      end if
    end associate
    text = text//'; give the stop a stiffness, or check drives and limits'
  end function rigid_conflict

  !> The elements and controllers of the last events, also of those that changed no state, as part of a sentence.
  function last_elements(run, fallen) result(text)
    type(run_state), intent(in) :: run
    logical, intent(in) :: fallen(:)           !! (roots) those of the last event
    character(:), allocatable :: text
    character(32), allocatable :: names(:)
    logical :: named(run%sys%m%s%elements + size(run%sys%m%s%controllers))
    integer :: k
    associate (list => run%sys%events)
      named = any(reshape(fallen, [most_roots, size(named)]), 1)
      do k = max(1, list%count - 99), list%count
        named(list%items(k)%element) = .true.
      end do
    end associate
    allocate (names(size(named)))
    do k = 1, size(named)
      names(k) = element_name(run%sys%m, k)
      named(k) = named(k) .and. .not. any(named(:k - 1) .and. names(:k - 1) == names(k))   ! a stop and its friction have one
    end do
    names = pack(names, named)
    text = in_quotes(names(:min(most_named, size(names))))//either(' and others', '', size(names) > most_named)
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
    if (b > 0) text = ', the coordinates of body'//in_quotes([run%sys%m%s%bodies(b)%name])//' grow most'
  end function growing_body

  !> The joints and drives with the largest multipliers at the last evaluation, as part of a sentence.
  function largest_reactions(run) result(text)
    type(run_state), intent(in) :: run
    character(:), allocatable :: text
    character(32) :: names(size(run%sys%m%s%constraints))
    real(wp) :: force(size(names))             !! [N]
    integer :: k
    text = ''
    if (size(force) == 0) return
    do k = 1, size(force)
      associate (c => run%sys%m%s%constraints(k)%item)
        names(k) = c%name
        force(k) = maxval(abs(run%sys%ev%lambda(c%first:c%first + c%rows - 1)))
      end associate
    end do
    names = names(ascending(-force))
    text = ', the largest reactions are those of'//in_quotes(names(:min(most_named, count(100*force >= maxval(force)))))
  end function largest_reactions

  !> What joints may demand there, and what to try. Where the start is a singular position, a motion that its rates do not continue.
  function impossible(run) result(text)
    type(run_state), intent(in) :: run
    character(:), allocatable :: text
    logical :: singular, driven
    integer :: k
    associate (s => run%sys%m%s)
      singular = run%assembly%rank < s%permanent_rows .and. .not. run%sys%m%redundant
      driven = s%permanent > s%joints
      if (singular) then
        text = '; the start is a singular position of joints'//in_quotes(pack([(s%constraints(k)%item%name, k=1, s%joints)], &
               run%assembly%dependent(:s%joints)))//' (a dead centre, a change point): stated rates need not be those of a '// &
               'motion that goes on from there; begin a little aside, or state the rates of all bodies'
        return
      end if
      text = either('; joints and drives may demand the impossible there, such as a drive beyond the reach of the mechanism; '// &
                    'check the drive and the geometry', '; the position may be singular there: check the geometry', driven)
      if (.not. run%d%transient%adaptive) text = text//', or the step is too large: try a smaller one'
    end associate
  end function impossible
end module march_failure
