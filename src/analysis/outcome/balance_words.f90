!> Lines of the summary about a transient's largest gaps of joints and its energy balance.
module balance_words
  use kinds, only: wp
  use energy_balance, only: balance_watch, distrusted
  use scene_run, only: run_state
  use summary_text, only: summary_record
  use text, only: short_text
  use transient, only: transient_march
  implicit none (type, external)
  private
  public :: balance_lines, closing_lines

contains

  !> Largest violations of joints and residuals of the energy.
  subroutine closing_lines(run, march, text)
    type(run_state), intent(in) :: run
    type(transient_march), intent(in) :: march
    type(summary_record), intent(inout) :: text
    associate (b => march%balance)
      call text%line('  largest violations: position {position_violation 3} m ({position_violation_of_size 3} of the size), '// &
                     'velocity {velocity_violation 3} m/s', [b%violation(1), b%violation(1)/run%sys%m%s%size, b%violation(2)])
      call text%line('  energy residual: largest {energy_residual 3} J, at the end {energy_residual_at_end 3} J; largest swing '// &
                     'of an energy {energy_swing 3} J', [b%largest_residual, b%row(5), maxval(b%kinds%high - b%kinds%low)])
      if (run%d%transient%method == 'generalized_alpha' .or. run%d%transient%method == 'radau') call text%line( &
        '  energy removed by the method itself: {energy_removed 3} J, numerical damping that the residual shows; without it '// &
        'the residual at the end: {energy_residual_without_removed 3} J', [march%method%removed, b%row(5) + march%method%removed])
    end associate
  end subroutine closing_lines

  !> The energy balance of the whole scene, and of the body with the largest share of residual.
  subroutine balance_lines(run, march, text)
    type(run_state), intent(in) :: run
    type(transient_march), intent(in) :: march
    type(summary_record), intent(inout) :: text
    character(:), allocatable :: name, energy
    real(wp) :: x, exchanged
    integer :: body
    associate (b => march%balance)
      if (.not. b%moved() > 0.0_wp) then
        call text%line('  energy balance: no energy moves in this scene beyond what shifts it by a millionth of its size, '// &
                       'so that it says nothing')
        return
      end if
      energy = 'the energy that moved'
      if (.not. b%exchanged()) energy = 'the kinetic energy, which is constant'
      call text%line('  energy balance: closed to {energy_balance 1} of '//energy, [b%share()])
      if (b%share() > distrusted) call text%warn('the energy balance is off by '//short_text(b%share(), 1)// &
        ' of '//energy//': the results cannot be trusted; use a smaller step or tolerance')
      call b%body_share(body, x, exchanged)
      if (body == 0) return
      name = trim(run%sys%m%s%bodies(body)%name)
      call text%open('energy_balance_of_deformation', '{')
      call text%line('  energy balance: closed to {share 1} of what the deformation of body "{body='//name//'}" took up and '// &
                     'gave back, {exchanged 1} J', [x, exchanged])
      call text%close()
    end associate
  end subroutine balance_lines
end module balance_words
