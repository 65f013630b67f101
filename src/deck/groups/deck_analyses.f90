!> Readers of &static, &modal, &frequency_response and &transient.
module deck_analyses
  use kinds, only: wp
  use step_counts, only: actual_step, most_counted
  use text, only: to_text, quoted
  use deck_input, only: deck_source, required
  use deck_get, only: get
  use deck_words, only: get_choice, get_word, get_input
  use deck_records, only: static_record, modal_record, response_record, transient_record
  implicit none (type, external)
  private
  public :: read_static, read_modal, read_response, read_transient

contains

  !> &static
  subroutine read_static(deck, s)
    class(deck_source), intent(inout) :: deck
    type(static_record), intent(inout) :: s
    s%at = deck%at()
    s%present = .true.
    call get(deck, 'load_steps', s%load_steps, least=1.0_wp)
    call get(deck, 'tolerance', s%tolerance, above=0.0_wp, below=1.0_wp)
  end subroutine read_static

  !> &modal
  subroutine read_modal(deck, m)
    class(deck_source), intent(inout) :: deck
    type(modal_record), intent(inout) :: m
    m%at = deck%at()
    m%present = .true.
    call get(deck, 'modes', m%modes, least=1.0_wp)
    call get_word(deck, 'friction', m%friction, [character(4) :: 'held', 'free'])
  end subroutine read_modal

  !> &frequency_response
  subroutine read_response(deck, r)
    class(deck_source), intent(inout) :: deck
    type(response_record), intent(inout) :: r
    r%at = deck%at()
    r%present = .true.
    call get_word(deck, 'spacing', r%spacing, [character(6) :: 'log', 'linear'])
    if (r%spacing == 'log' .and. deck%is_known('spacing')) then
      call get(deck, 'from', r%from, required, above=0.0_wp)
    else
      call get(deck, 'from', r%from, required, least=0.0_wp)
    end if
    call get(deck, 'to', r%to, required, above=0.0_wp)
    call get(deck, 'points', r%points, required, least=2.0_wp)
    call get_input(deck, 'input', r%force, r%drive)
    call get_word(deck, 'friction', r%friction, [character(4) :: 'held', 'free'])
    call deck%check_order('from', r%from, 'to', r%to)
  end subroutine read_response

  !> &transient
  subroutine read_transient(deck, t)
    class(deck_source), intent(inout) :: deck
    type(transient_record), intent(inout) :: t
    real(wp), parameter :: default_accuracy = 1.0e-3_wp   ! [-]
    logical :: searched                 ! method and steps that keep an accuracy are
    t%at = deck%at()
    t%present = .true.
    t%method = 'rk4'
    call get(deck, 't_end', t%t_end, required, above=0.0_wp)
    call get_choice(deck, 'method', t%method, [character(17) :: 'rk4', 'dopri5', 'radau', 'generalized_alpha'])
    call get(deck, 'accuracy', t%accuracy, above=0.0_wp, below=1.0_wp)
    t%free_method = .not. deck%is_given('method')
    searched = deck%is_given('accuracy') .or. (t%free_method .and. .not. (deck%is_given('step') .or. deck%is_given('tolerance')))
    if (searched .and. .not. deck%is_given('accuracy')) t%accuracy = default_accuracy
    if (searched .and. t%free_method) call deck%choose('method', '', .false.)   ! then no variable is bound to one
    call get(deck, 'step', t%step, above=0.0_wp)
    call get(deck, 'tolerance', t%tolerance, above=0.0_wp, below=1.0_wp, kinds='dopri5 radau')
    call get(deck, 'first_step', t%first_step, above=0.0_wp, kinds='dopri5 radau')
    call get(deck, 'max_step', t%max_step, above=0.0_wp, kinds='dopri5 radau')
    call get(deck, 'spectral_radius', t%spectral_radius, least=0.0_wp, most=0.99_wp, kinds='generalized_alpha')
    call get(deck, 'accept_unstable', t%accept_unstable)
    call get(deck, 'check_error', t%check_error)
    call get(deck, 'check_reduction', t%check_reduction)
    call get(deck, 'check_mesh', t%check_mesh)
    call get(deck, 'most_seconds', t%most_seconds, above=0.0_wp)
    call get(deck, 'output_step', t%output_step, above=0.0_wp)
    call get(deck, 'checkpoint_interval', t%checkpoint_interval, least=0.0_wp)
    call get(deck, 'motion_step', t%motion_step, least=0.0_wp)
    if (searched) then
      call read_search()
    else
      call read_step_kind()
    end if
    call check_steps()
    call read_stabilization()
  contains
    !> What would fix the steps is refused beside an accuracy, which chooses them.
    subroutine read_search()
      character(15), parameter :: fixed(7) = [character(15) :: 'step', 'tolerance', 'first_step', 'max_step', 'spectral_radius', &
        'accept_unstable', 'check_error']
      integer :: k
      t%adaptive = .true.
      do k = 1, size(fixed)
        if (deck%is_set(trim(fixed(k)))) call deck%complain(trim(fixed(k)), trim(fixed(k))//' does not apply to accuracy, '// &
          'which chooses the steps and checks them, expected one of the two')
      end do
    end subroutine read_search

    !> A fixed step or a tolerance, not both.
    subroutine read_step_kind()
      t%adaptive = deck%is_given('tolerance') .and. deck%is_choice('dopri5 radau')
      if (t%adaptive .and. deck%is_given('step')) then
        call deck%complain('tolerance', 'step and tolerance are both given, expected step (fixed steps) or tolerance '// &
          '(adaptive steps)')
      else if (.not. (t%adaptive .or. deck%is_given('step'))) then
        if (deck%is_choice('rk4 generalized_alpha')) then
          if (.not. deck%is_given('tolerance')) then
            call deck%note_missing('step', 'step > 0 or accuracy > 0', kinds='rk4 generalized_alpha')
          end if
        else if (deck%choice_known) then
          call deck%note_missing('step', 'step > 0 (fixed steps), tolerance > 0 (adaptive steps) or accuracy > 0')
        end if
      else if (.not. t%adaptive) then
        call needs_tolerance('first_step')
        call needs_tolerance('max_step')
      end if
      if (deck%is_set('most_seconds')) call deck%complain('most_seconds', 'most_seconds ends the search of an accuracy, '// &
        'expected it with accuracy only')
    end subroutine read_step_kind

    !> Reports a variable that only adaptive steps use.
    subroutine needs_tolerance(name)
      character(*), intent(in) :: name   !! `first_step` or `max_step`
      if (deck%is_set(name)) call deck%complain(name, name//' does not apply to fixed steps, expected it with tolerance only')
    end subroutine needs_tolerance

    !> Steps and times that fit together; the default interval of output.
    subroutine check_steps()
      real(wp), parameter :: slack = 1.0_wp + 1.0e-9_wp   !! rounding of written numbers [-]
      logical :: stepped
      stepped = deck%is_set('step') .and. .not. t%adaptive
      call check_not_longer('output_step', t%output_step, 't_end', t%t_end*slack)
      if (stepped .and. deck%is_set('output_step')) then
        call check_not_longer('step', t%step, 'output_step', t%output_step*slack)
      else if (stepped) then
        call check_not_longer('step', t%step, 't_end', t%t_end*slack)
      end if
      if (t%adaptive) then
        call check_not_longer('first_step', t%first_step, 'max_step', t%max_step*slack)
        call check_not_longer('first_step', t%first_step, 't_end', t%t_end*slack)
      end if
      if (.not. deck%is_given('output_step')) t%output_step = merge(t%t_end/1000.0_wp, t%step, t%adaptive)
      if (stepped) call check_countable('step', t%step, 't_end', t%t_end)
      if (deck%is_set('output_step')) call check_countable('output_step', t%output_step, 't_end', t%t_end)
      call check_countable('output_step', t%output_step, 'motion_step', t%motion_step)
    end subroutine check_steps

    !> Reports an interval that holds more steps than can be counted.
    subroutine check_countable(name, time, other, interval)
      character(*), intent(in) :: name, other   !! the variables of step and interval
      real(wp), intent(in) :: time, interval    !! their values [s]
      if (.not. (deck%is_set(other) .and. time > 0.0_wp) .or. interval <= most_counted*time) return
      call deck%complain(other, other//'='//to_text(interval)//' is '//to_text(interval/time)//' times '//name//'='// &
        to_text(time)//', expected at most '//to_text(most_counted)//' times, as many as can be counted')
    end subroutine check_countable

    !> Reports a time that is longer than another one.
    subroutine check_not_longer(name, time, other, limit)
      character(*), intent(in) :: name, other   !! the two variables
      real(wp), intent(in) :: time              !! the first one's value [s]
      real(wp), intent(in) :: limit             !! the other one's value with some slack [s]
      if (.not. (deck%is_set(name) .and. deck%is_set(other)) .or. time <= limit) return
      call deck%complain(name, name//'='//to_text(time)//' is larger than '//other//'='//to_text(limit)//', expected '// &
        name//' <= '//other)
    end subroutine check_not_longer

    !> How drift off the constraints is kept small; the default rates of Baumgarte's terms.
    subroutine read_stabilization()
      logical :: baumgarte, implicit
      call get_word(deck, 'stabilization', t%stabilization, [character(10) :: 'projection', 'baumgarte', 'none'])
      implicit = deck%is_choice('generalized_alpha radau')
      if (implicit .and. t%stabilization /= 'projection') call deck%complain('stabilization', 'stabilization='// &
        quoted(trim(t%stabilization))//' does not apply to method='//quoted(trim(t%method))//', expected ''projection''')
      if (searched .and. .not. implicit .and. t%stabilization /= 'projection') call deck%complain('stabilization', &
        'stabilization='//quoted(trim(t%stabilization))//' does not apply to accuracy, expected ''projection''')
      call get(deck, 'baumgarte_alpha', t%baumgarte_alpha, least=0.0_wp)
      call get(deck, 'baumgarte_beta', t%baumgarte_beta, least=0.0_wp)
      baumgarte = t%stabilization == 'baumgarte' .and. .not. (implicit .or. searched)
      call fill_rate('baumgarte_alpha', t%baumgarte_alpha, baumgarte)
      call fill_rate('baumgarte_beta', t%baumgarte_beta, baumgarte)
    end subroutine read_stabilization

    !> Default 0.1/step of a rate of Baumgarte's terms; adaptive steps have none.
    subroutine fill_rate(name, value, baumgarte)
      character(*), intent(in) :: name             !! variable
      real(wp), intent(inout) :: value             !! [1/s]
      logical, intent(in) :: baumgarte             !! whether the terms are used
      if (.not. baumgarte) then
        if (deck%is_set(name) .and. deck%is_known('stabilization')) call deck%complain(name, name// &
          ' does not apply to stabilization='//quoted(trim(t%stabilization))//', it applies to stabilization=''baumgarte''')
      else if (.not. deck%is_given(name)) then
        if (t%adaptive) call deck%note_missing(name, name//' >= 0 (adaptive steps have no default)')
        if (.not. t%adaptive .and. t%step > 0.0_wp .and. t%output_step > 0.0_wp) value = 0.1_wp/actual_step(t%output_step, t%step)
      end if
    end subroutine fill_rate
  end subroutine read_transient
end module deck_analyses
