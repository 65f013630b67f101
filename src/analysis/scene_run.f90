!> A scene ready for its analyses: the deck, its mechanism assembled at t = 0, and the present state. Analyses follow one
!> another on it (input/README.md: static, modal, frequency response, transient).
module scene_run
  use kinds, only: wp, ip
  use archive, only: value_archive
  use errors, only: failure, fault_list, status_no_output, status_signal
  use evaluation_settings, only: usual_options
  use deck_records, only: deck
  use build_scene, only: build
  use clearance_start, only: start_through_clearances
  use assembly_conflict, only: explain_open_joints, deck_line_of
  use assembly_reports, only: add_warning, assembly_report
  use controls, only: switch_on_controls
  use mechanism_ode, only: mechanism_system
  use posix, only: caught_signal
  use scene_model, only: scene
  use sensors, only: sensor_list, set_up_sensors
  use step_monitor, only: stability_monitor
  use tableaux, only: method_names
  use text, only: to_text
  use trial_scene, only: assemble_scene
  use summary_text, only: summary_record
  use validity, only: validity_watch
  implicit none (type, external)
  private
  public :: run_state, prepare_run, assemble_run, relax, no_output, stop_if_signalled

  !> What analyses share.
  type :: run_state
    type(deck) :: d
    class(mechanism_system), allocatable :: sys   !! of a class: where a type is copied, its whole copy is compiled
    type(sensor_list) :: list
    type(assembly_report) :: assembly
    type(validity_watch) :: watch             !! figures of the run so far
    type(stability_monitor) :: monitor        !! current bound along the run
    type(value_archive) :: saved              !! a restart's checkpoint
    real(wp), allocatable :: y(:)             !! present state at t = 0 (layout in `scene_model`) [m, rad], [m/s, rad/s], [J]
    character(:), allocatable :: folder       !! results folder
    character(:), allocatable :: orbit        !! results folder of a cycle from which that of the deck is sought; empty: none
    type(summary_record) :: opening           !! first part of the summary: the model, its stable steps
    real(wp) :: stable_step = huge(1.0_wp)    !! safe bound of the deck's explicit method; huge: nothing limits it [s]
    real(wp) :: stable_steps(size(method_names)) = huge(1.0_wp)   !! of each explicit method, also with bent bodies [s]
    real(wp) :: fastest = 0.0_wp              !! highest frequency of modes and responses [rad/s]
    logical :: model_found = .false.          !! pilots have looked for it, or at it
    real(wp), allocatable :: model_error(:)   !! (columns) what left-out modes make them err, where the run chose [of the column]
    type(summary_record) :: model_words       !! what pilots have found
    type(value_archive) :: turns              !! of the periodic analysis; restoring, while turns of a checkpoint are left
    integer(ip) :: began = 0                  !! count of the clock, for `most_seconds` alone
    logical :: quiet = .false.
    logical :: restart = .false.
  contains
    procedure :: late
    procedure :: exchange_model
  end type run_state

contains

  !> Whether `most_seconds` are over.
  logical function late(self)
    class(run_state), intent(in) :: self
    integer(ip) :: now, rate
    late = self%d%transient%most_seconds < huge(1.0_wp)
    if (.not. late) return
    call system_clock(now, rate)
    late = real(now - self%began, wp) > self%d%transient%most_seconds*real(rate, wp)
  end function late

  !> Saves or restores what pilots have found: their ends by `most_seconds` are not the same twice.
  subroutine exchange_model(self, a)
    class(run_state), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    integer :: k, n
    do k = 1, size(self%d%bodies)
      call a%exchange(self%d%bodies(k)%modes)
    end do
    n = 0
    if (allocated(self%model_error)) n = size(self%model_error)
    call a%exchange(n)
    if (n > 0 .and. .not. a%saving) self%model_error = [(0.0_wp, k=1, n)]
    if (n > 0) call a%exchange(self%model_error)
    call self%model_words%exchange(a)
  end subroutine exchange_model

  !> Builds and assembles the scene of a deck; faults of the deck go to faults, failed assembly to fail.
  subroutine prepare_run(run, faults, fail)
    type(run_state), intent(inout) :: run     !! run%d is set
    type(fault_list), intent(inout) :: faults
    type(failure), intent(inout) :: fail
    type(scene) :: s
    character(:), allocatable :: contradiction
    call build(run%d, s, faults)
    if (faults%count > 0) return
    call start_through_clearances(run%d, s, contradiction)
    call assemble_run(run, s, fail)
    if (len(contradiction) > 0 .and. .not. fail%happened()) call add_warning(run%assembly, contradiction)
  end subroutine prepare_run

  !> Assembles a scene that is built, in place of what the run has had; tests do so with kinds that the program does not have.
  subroutine assemble_run(run, s, fail)
    type(run_state), intent(inout) :: run     !! run%d is set
    type(scene), intent(in) :: s
    type(failure), intent(inout) :: fail
    real(wp), allocatable :: q(:), v(:)       ! (nq) [m, rad] and per second
    type(sensor_list) :: list
    if (allocated(run%sys)) deallocate (run%sys)
    allocate (mechanism_system :: run%sys)
    run%list = list
    call assemble_scene(s, run%sys%m, run%sys%ev, q, run%assembly, fail, v)
    run%sys%n = s%ny
    run%y = spread(0.0_wp, 1, s%ny)
    if (run%assembly%open) call explain_open_joints(run%d, fail)
    if (run%assembly%culprit > 0) fail%deck_line = deck_line_of(run%d, run%assembly%culprit)
    if (fail%happened()) return
    run%y(1:2*s%nq) = [q, v]
    run%sys%options = usual_options(s)
    call relax(run%sys, run%sys%options%prestress, run%y)
    call set_up_sensors(run%d, run%sys%m, run%list)
  end subroutine assemble_run

  !> Results that cannot be written.
  subroutine no_output(run, fail)
    type(run_state), intent(in) :: run
    type(failure), intent(inout) :: fail
    call fail%raise(status_no_output, 'results cannot be written into "'//run%folder//'": the disk may be full or the '// &
                    'folder protected')
  end subroutine no_output

  !> Fails where a signal has come in an analysis that has no checkpoint: what it found so far is written.
  subroutine stop_if_signalled(analysis, fail)
    character(*), intent(in) :: analysis      !! which one
    type(failure), intent(inout) :: fail
    if (caught_signal() > 0) call fail%raise(status_signal + caught_signal(), 'stopped by signal '// &
      to_text(caught_signal())//' in the '//analysis//', whose results may be incomplete; run the deck again')
  end subroutine stop_if_signalled

  !> Relaxed internal variables: equal to the deformation they follow (theory.md, section 5); no analysis gives them rates but
  !> the transient, which is the last.
  subroutine relax(sys, prestress, y)
    type(mechanism_system), intent(inout) :: sys
    real(wp), intent(in) :: prestress !! fraction that acts [-]
    real(wp), intent(inout) :: y(:)   !! (ny) [m, rad], [m/s, rad/s], [J]
    integer :: b, r, k, o, i
    associate (s => sys%m%s)
      do b = 1, size(s%bodies)
        associate (body => s%bodies(b), w => sys%ev%elastic(b))
          if (body%nz == 0) cycle
          i = s%qo(b) + 3
          w%q(1:) = y(i + 1:i + body%nf)
          call body%basis%deform(body, w%q, w%d)
          do r = 1, size(body%segments)
            associate (segment => body%segments(r))
              do k = 1, size(segment%law%alpha)
                o = 2*s%nq + segment%start(k)
                y(o + 1:o + segment%width) = reshape(w%d(:, segment%first:segment%last), [segment%width])
              end do
            end associate
          end do
        end associate
      end do
      do k = 1, size(s%forces)
        call s%forces(k)%item%relax(sys%ev%p, prestress, y(2*s%nq + 1:))
      end do
      call switch_on_controls(sys%m, sys%ev, y(1:s%nq), y(s%nq + 1:2*s%nq), y(2*s%nq + 1:2*s%nq + s%nz))
    end associate
  end subroutine relax
end module scene_run
