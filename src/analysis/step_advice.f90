!> Which explicit step is stable, what limits it and what allows larger ones (theory.md, section 8). Safe bound: joints
!> and drives released, for the whole run of linear bodies. Current bound: the constrained mechanism as it stands.
module step_advice
  use kinds, only: wp
  use dynamics, only: evaluate_start
  use evaluation_results, only: evaluation
  use layer_limits, only: told
  use mechanism, only: mechanism_model
  use safe_bound, only: find_safe_bound, turning_stiffness
  use scene_run, only: run_state
  use spectrum, only: fast_spectrum
  use tableaux, only: method_names
  use text, only: either
  use step_bounds, only: bound_cause, step_bound, find_bound, take_smaller, windup_poles
  use step_monitor, only: method_number
  use summary_text, only: summary_record
  use validity, only: bend_to_limit
  implicit none (type, external)
  private
  public :: advise, stability_advice

  !> Both bounds and their explanation, for the summary.
  type :: stability_advice
    type(step_bound) :: safe, current
    real(wp) :: lowest(size(method_names)) = huge(1.0_wp)   !! safe bound, or that of bent bodies where it is lower [s]
    character(:), allocatable :: provided                   !! what the safe bound takes for granted, in words; empty: nothing
    type(summary_record) :: text
  end type stability_advice

contains

  !> Both bounds at the present state of a run, with their explanation; the run keeps its stable steps.
  subroutine advise(run, advice)
    type(run_state), intent(inout) :: run
    type(stability_advice), intent(out) :: advice
    integer :: k
    associate (m => run%sys%m, ev => run%sys%ev, q => run%y(1:run%sys%m%s%nq))
      call both_bounds(m, ev, q, advice%safe, advice%current)
      call advice_lines(m, advice)
      call note_limits(m, ev, q, advice)
    end associate
    k = method_number(run%d%transient%method)
    if (k > 0) run%stable_step = advice%safe%step(k)
    run%stable_steps = advice%lowest
  end subroutine advise

  !> Adds what the safe bound of this scene does not count: inertia that deflections change, tried with every flexible body bent
  !> as far as the model holds, tension, and forces of springs against turns that grow beyond those of the start.
  subroutine note_limits(m, ev, q, advice)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: q(:)               !! (nq) the assembled positions [m], [rad]
    type(stability_advice), intent(inout) :: advice
    type(evaluation) :: work
    type(step_bound) :: bent_bound
    real(wp), allocatable :: bent(:)
    integer :: b
    advice%provided = ''
    advice%lowest = advice%safe%step
    if (advice%safe%step(1) >= huge(1.0_wp)) return
    call as_at_start('tension', any(m%s%bodies%stiffening))
    call as_at_start('forces over the motion', any([(m%s%forces(b)%item%motions > 0, b=1, size(m%s%forces))]))
    work = ev
    call evaluate_start(m, work, q)
    call as_at_start('forces of springs', any(turning_stiffness(m, work) > 0.0_wp))
    call as_at_start('friction of joints', size(m%s%friction) > 0)
    if (len(advice%provided) > 0) call advice%text%line('  note: the safe bound takes '//advice%provided//' as at the start: '// &
                                                        'where they grow it may fall, as the current bound then tells')
    if (.not. any(m%s%bodies%flexible)) return
    bent = q
    do b = 1, size(m%s%bodies)
      associate (i => m%s%qo(b) + 3, body => m%s%bodies(b))
        if (body%flexible) call bend_to_limit(body, bent(i + 1:i + body%nf))
      end associate
    end do
    call both_bounds(m, ev, bent, bent_bound)
    if (.not. any(bent_bound%step < (1 - told)*advice%safe%step)) return
    advice%lowest = min(advice%safe%step, bent_bound%step)
    call advice%text%line('  note: the safe bound counts the inertia of bodies as they stand at the start; bent as far as the '// &
                          'model holds they would allow about {bent_bound 4} s (rk4), limited by {bent_bound_limited_by='// &
                          trim(bent_bound%cause(1)%what)//'}', bent_bound%step(1:1))
  contains
    !> Adds what has to stay as it is at the start.
    subroutine as_at_start(what, true)
      character(*), intent(in) :: what
      logical, intent(in) :: true
      if (true) advice%provided = advice%provided//either(' and ', '', len(advice%provided) > 0)//what
    end subroutine as_at_start
  end subroutine note_limits

  !> The safe bound and that of the mechanism as it stands, which the former never exceeds: joints may keep a mode from what
  !> damps it. Where nothing does, joints only lower frequencies.
  subroutine both_bounds(m, ev, q, safe, current)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: q(:)               !! (nq) the assembled positions [m], [rad]
    type(step_bound), intent(out) :: safe
    type(step_bound), intent(out), optional :: current
    type(step_bound) :: assembled
    type(evaluation) :: work
    type(fast_spectrum) :: fast
    work = ev
    call evaluate_start(m, work, q)
    call fast%set_up(m, ev, q)
    call find_safe_bound(m, work, fast, safe)
    call windup_poles(m, spread(.true., 1, size(m%s%controllers)), safe)
    if (.not. (present(current) .or. fast%damped .or. fast%loops .or. size(fast%lin%segments) > 0)) return
    call find_bound(m, work, .true., fast, assembled)
    call take_smaller(assembled, safe)
    if (present(current)) current = assembled
  end subroutine both_bounds

  !> The advice in words: bounds, what limits them, what allows larger steps.
  subroutine advice_lines(m, advice)
    type(mechanism_model), intent(in) :: m
    type(stability_advice), intent(inout) :: advice
    character(:), allocatable :: words
    integer :: k
    call advice%text%section('stable_steps', 'stable steps of explicit methods')
    do k = 1, size(method_names)
      call advice%text%open(trim(method_names(k)), '{')
      call method_lines(advice, k)
      call advice%text%close()
    end do
    if (advice%current%growth > 0.0_wp) call advice%text%line('  note: loops or forces over the motion make a motion grow by '// &
      '{growth} 1/s, as assembled', [advice%current%growth])
    words = remedy(m, advice%safe%cause(1))
    if (len(words) > 0) call advice%text%line('  larger steps by: {larger_steps_by='//words//'}')
  end subroutine advice_lines

  !> Both bounds of one method and what limits it.
  subroutine method_lines(advice, k)
    type(stability_advice), intent(inout) :: advice
    integer, intent(in) :: k                   !! method
    associate (text => advice%text, safe => advice%safe%step(k), current => advice%current%step(k), mu => advice%safe%mu(k))
      call text%say('  '//trim(method_names(k)))
      if (safe >= huge(1.0_wp)) then
        call text%line(': no limit (nothing vibrates or decays fast): accuracy alone sets the step')
        return
      end if
      call text%say(': safe bound {safe_bound 4} s (joints released)', [safe])
      if (current > 1.0e6_wp*safe) then
        call text%line(', no current bound (as assembled)')
      else
        call text%line(', current bound {current_bound 4} s (as assembled)', [current])
      end if
      call text%line('    limited by {limited_by='//trim(advice%safe%cause(k)%what)//'}, |eigenvalue| {eigenvalue 4} rad/s, '// &
                     'damping ratio {damping_ratio}', [abs(mu), abs(real(mu, wp))/abs(mu)])
      if (k == 1 .and. .not. abs(aimag(mu)) > 0.0_wp) call text%line('    which decays and does not vibrate; '// &
        'the implicit methods have no such bound and lose no vibration by larger steps (radau for small errors)')
    end associate
  end subroutine method_lines

  !> What allows larger steps, by the cause of the bound; empty where no body is.
  function remedy(m, cause) result(words)
    type(mechanism_model), intent(in) :: m
    type(bound_cause), intent(in) :: cause
    character(:), allocatable :: words
    words = ''
    if (cause%body == 0) return
    words = 'fewer elements, modes=, axial=.false. or flexible=.false.'
    associate (body => m%s%bodies(cause%body))
      if (body%layers%shown) words = 'fewer elements, modes='//either('', ', axial=.false.', &
                                          any(body%layers%sections%stretched()))//' or flexible=.false.'
    end associate
    if (cause%rayleigh) words = 'less Rayleigh damping'
    if (cause%segment > 0) words = 'viscoelastic=.false., slower terms'
    words = words//' on body "'//trim(m%s%bodies(cause%body)%name)//'", or radau'
  end function remedy
end module step_advice
