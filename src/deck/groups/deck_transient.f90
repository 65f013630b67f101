!> Reader of &transient.
module deck_transient
  use kinds, only: wp
  use step_counts, only: actual_step, most_counted
  use text, only: to_text, quoted
  use deck_input, only: deck_source
  use deck_records, only: periodic_record, transient_record
  use deck_take, only: take
  implicit none (type, external)
  private
  public :: read_transient

  real(wp), parameter, public :: default_accuracy = 1.0e-3_wp   !! [-]

contains

  !> &transient
  subroutine read_transient(deck, t, cycle)
    class(deck_source), intent(inout) :: deck
    type(transient_record), intent(inout) :: t
    type(periodic_record), intent(inout) :: cycle       !! where the deck has one, it says how long a run is
    logical :: searched                 ! method and steps that keep an accuracy are
    t%free_method = .not. deck%is_given('method')
    searched = deck%is_given('accuracy') .or. (t%free_method .and. .not. (deck%is_given('step') .or. deck%is_given('tolerance')))
    deck%any_choice = searched .and. t%free_method       ! then no key is bound to a method
    call take(deck, t)
    cycle%one_period = cycle%present .and. .not. deck%is_given('t_end')
    if (cycle%one_period) t%t_end = cycle%period
    if (.not. cycle%present) call deck%need('t_end')
    if (.not. searched) t%accuracy = 0.0_wp
    if (searched) then                   ! the accuracy chooses the steps
      t%adaptive = .true.
      call deck%refuse('step tolerance first_step max_step spectral_radius accept_unstable check_error', &
                       ' does not apply to accuracy, which chooses the steps and checks them, expected one of the two')
    else
      call check_step_kind()
    end if
    call check_steps()
    call check_stabilization()
  contains
    !> A fixed step or a tolerance, not both.
    subroutine check_step_kind()
      t%adaptive = deck%is_given('tolerance') .and. deck%is_choice('dopri5 radau')
      if (t%adaptive .and. deck%is_given('step')) then
        call deck%complain('tolerance', 'step and tolerance are both given, expected step (fixed steps) or tolerance '// &
          '(adaptive steps)')
      else if (.not. (t%adaptive .or. deck%is_given('step'))) then
        if (deck%is_choice('rk4 generalized_alpha')) then
          if (.not. deck%is_given('tolerance')) call deck%need('step', 'step > 0 or accuracy > 0'//deck%for_choice())
        else if (deck%choice_known) then
          call deck%need('step', 'step > 0 (fixed steps), tolerance > 0 (adaptive steps) or accuracy > 0')
        end if
      else if (.not. t%adaptive) then
        call deck%refuse('first_step max_step', ' does not apply to fixed steps, expected it with tolerance only')
      end if
      call deck%refuse('most_seconds', ' ends the search of an accuracy, expected it with accuracy only')
    end subroutine check_step_kind

    !> Steps and times that fit together; the default interval of output.
    subroutine check_steps()
      logical :: stepped
      stepped = deck%is_set('step') .and. .not. t%adaptive
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

    !> How drift off the constraints is kept small; the default rates of Baumgarte's terms.
    subroutine check_stabilization()
      logical :: baumgarte, implicit_method
      implicit_method = deck%is_choice('generalized_alpha radau')
      if (implicit_method .and. t%stabilization /= 'projection') call deck%complain('stabilization', 'stabilization='// &
        quoted(trim(t%stabilization))//' does not apply to method='//quoted(trim(t%method))//', expected ''projection''')
      if (searched .and. .not. implicit_method .and. t%stabilization /= 'projection') call deck%complain('stabilization', &
        'stabilization='//quoted(trim(t%stabilization))//' does not apply to accuracy, expected ''projection''')
      baumgarte = t%stabilization == 'baumgarte' .and. .not. (implicit_method .or. searched)
      call fill_rate('baumgarte_alpha', t%baumgarte_alpha, baumgarte)
      call fill_rate('baumgarte_beta', t%baumgarte_beta, baumgarte)
    end subroutine check_stabilization

    !> Default 0.1/step of a rate of Baumgarte's terms; adaptive steps have none.
    subroutine fill_rate(name, value, baumgarte)
      character(*), intent(in) :: name             !! variable
      real(wp), intent(inout) :: value             !! [1/s]
      logical, intent(in) :: baumgarte             !! whether the terms are used
      if (.not. baumgarte) then
        if (deck%is_set(name) .and. deck%is_known('stabilization')) call deck%complain(name, name// &
          ' does not apply to stabilization='//quoted(trim(t%stabilization))//', it applies to stabilization=''baumgarte''')
      else if (.not. deck%is_given(name)) then
        if (t%adaptive) call deck%need(name, name//' >= 0 (adaptive steps have no default)')
        if (.not. t%adaptive .and. t%step > 0.0_wp .and. t%output_step > 0.0_wp) value = 0.1_wp/actual_step(t%output_step, t%step)
      end if
    end subroutine fill_rate
  end subroutine read_transient
end module deck_transient
