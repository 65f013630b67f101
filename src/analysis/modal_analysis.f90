!> The modal analysis: undamped and complex modes of the constrained scene about its present state, into modes.txt.
module modal_analysis
  use kinds, only: wp, pi
  use closed_loops, only: loop_system
  use complex_modes, only: find_modes
  use dynamic_stiffness, only: stiffness_system
  use errors, only: failure, status_failed
  use held_friction, only: tell_friction
  use loop_analysis, only: run_loops
  use linear_state, only: linear_system, refuse_uneven
  use present_state, only: warn_of_motion
  use mode_file, only: write_modes, mode_figures
  use material_band, only: outside_band
  use mode_list, only: say_what_is_missing, mode_set, vibration_mode
  use own_files, only: remove_own
  use scene_run, only: run_state, no_output, stop_if_signalled
  use summary_text, only: summary_record
  use text, only: to_text
  implicit none (type, external)
  private
  public :: run_modal

contains

  !> Runs the deck's modal analysis; its figures go to the summary.
  subroutine run_modal(run, text, fail)
    type(run_state), intent(inout) :: run
    type(summary_record), intent(inout) :: text   !! the summary
    type(failure), intent(inout) :: fail
    type(stiffness_system) :: ds
    type(loop_system) :: loops
    type(mode_set) :: modes
    character(:), allocatable :: words
    logical :: ok, failed
    logical :: frozen                             ! modes are those of an instant
    call remove_own(run%folder//'/modes.txt')
    call run%sys%hold_rows(run%y, run%d%modal%friction /= 'held')
    call linear_system(run, ds, loops)
    call refuse_uneven(run, 'modal analysis', status_failed, fail)
    if (fail%happened()) return
    call warn_of_motion(run, text, frozen)
    call find_modes(ds, run%d%modal%modes, modes, ok)
    call stop_if_signalled('modal analysis', fail)
    if (.not. ok) then
      call fail%raise(status_failed, 'the modal analysis did not converge: the mass matrix or the stiffness about the '// &
                      'present state is not fit for it (check masses and static state)')
      return
    end if
    call write_modes(run%folder//'/modes.txt', run%d%name, run%sys%m, run%sys%ev, run%y(1:run%sys%m%s%nq), modes, frozen, failed)
    if (failed) call no_output(run, fail)
    call modal_lines(run, modes, ds, text)
    associate (f => abs(modes%lambda(:modes%count)%im)/(2*pi), damped => modes%kind(:modes%count) == vibration_mode)
      call text%warn(outside_band(run, 'damped modes', pack(f, damped .and. f > 0.0_wp)))
      run%fastest = 2*pi*maxval([0.0_wp, f])
    end associate
    call say_what_is_missing(modes, failed, words)
    if (failed) then
      call fail%raise(status_failed, words)
    else
      call text%warn(words)
    end if
    call run_loops(run, ds, loops, text, fail)
  end subroutine run_modal

  !> The table of modes for the summary.
  subroutine modal_lines(run, modes, ds, text)
    type(run_state), intent(in) :: run
    type(mode_set), intent(in) :: modes
    type(stiffness_system), intent(in) :: ds
    type(summary_record), intent(inout) :: text
    character(12), parameter :: names(0:3) = [character(12) :: 'undamped', 'damped', 'further pole', 'real pole']
    real(wp) :: x(9)
    integer :: k
    call text%section('modes', 'modes')
    associate (wanted => run%d%modal%modes, all => ds%n - ds%rows)
      if (wanted > all) call text%line('  only {degrees_of_freedom #} degrees of freedom for {modes_asked #} modes', &
                                       [real(wp) :: all, wanted])
    end associate
    call tell_friction(run, text)
    call text%open('poles', '[')
    do k = 1, modes%count
      x = mode_figures(modes, k)
      call text%item(repeat(' ', max(2, 6 - len(to_text(modes%mode(k)))))//'{mode #}  {kind='//trim(names(modes%kind(k)))// &
                     '}'//repeat(' ', 13 - len_trim(names(modes%kind(k))))//'{frequency 8} Hz, damping ratio {damping_ratio '// &
                     '8}, real part {real_part 8} 1/s, residual {residual 3}', &
                     [real(wp) :: modes%mode(k), x(4), x(5), x(7), x(9)])
    end do
    call text%close()
    call text%word('  ', 'complete', modes%note_undamped)
    call text%word(new_line('a')//'  ', 'complete_damped', modes%note_damped)
    call text%line(new_line('a')//'  factorisations: {factorisations #}', [real(wp) :: ds%factorisations])
    call text%close()
  end subroutine modal_lines
end module modal_analysis
