!> What modes that a body leaves out make the columns err, and how many modes keep the accuracy (theory.md, section 12): pilots
!> beside one in nodal coordinates. The deck then has plain numbers, and all that follows sees an ordinary deck.
module model_choice
  use kinds, only: wp, pi, ip
  use accuracy_words, only: least_part
  use build_scene, only: build
  use deck_mesh, only: halve_elements
  use deck_records, only: deck
  use errors, only: failure, fault_list, status_bad_input, status_failed, status_signal
  use mesh_choice, only: choose_elements, error_lines, modes_of_mesh, most_modes, take_mesh
  use modal_basis, only: modal_model
  use model_pilot, only: pilot_result, pilot_series
  use process, only: caught_signal, hold_signals
  use scene_model, only: scene
  use scene_run, only: run_state, prepare_run
  use sorting, only: ascending
  use summary, only: add_warnings
  use summary_text, only: summary_record
  use text, only: short_text, to_text
  implicit none (type, external)
  private
  public :: choose_model

  real(wp), parameter :: halving_error = 4/3.0_wp   !! error of a mesh over the change where errors fall by four [-]
  integer, parameter :: most_level = 1000000000    !! more modes than any deck has
  real(wp), parameter :: modes_share = 0.5_wp  !! of what a column may err by that left-out modes may take [-]

contains

  !> Settles elements='auto', then modes='auto' on these meshes, and finds the errors of left-out modes and of meshes, where the
  !> deck asks for any of these; a restart has what the first run found. The scene is then built anew.
  subroutine choose_model(run, fail)
    type(run_state), intent(inout) :: run
    type(failure), intent(inout) :: fail
    type(fault_list) :: faults
    logical :: meshed, reduced
    meshed = any(run%d%bodies%auto_elements)
    reduced = any(run%d%bodies%auto_modes)
    run%model_found = meshed .or. reduced .or. run%d%transient%check_reduction .or. run%d%transient%check_mesh
    if (.not. run%model_found) return
    call hold_signals(.true.)
    if (run%restart) then
      call run%exchange_model(run%saved)
    else
      associate (text => run%model_words)
        call text%open('reduction', '{')
        if (meshed) call choose_elements(run%d, run%began, run%model_error, text)
        if (reduced) call choose_modes(run%d, run%began, run%model_error, text)
        if (run%d%transient%check_reduction) call check_model(run, take_meshes(run%d), 'left-out modes, beside nodal coordinates', &
                                                              'errors', 'cost', 1.0_wp, text)
        if (run%d%transient%check_mesh) call check_model(run, halved(run%d), 'meshes, beside elements of half the length', &
                                                         'mesh_errors', 'mesh_cost', halving_error, text)
        call text%close()
      end associate
    end if
    if (caught_signal() > 0) call fail%raise(status_signal + caught_signal(), 'stopped by signal '//to_text(caught_signal())// &
      ' in a pilot, before the run: no file was written or changed; run the deck again')
    call hold_signals(.false.)
    if ((meshed .or. reduced) .and. .not. fail%happened()) call prepare_run(run, faults, fail)
  end subroutine choose_model

  !> A deck in nodal coordinates.
  function take_meshes(d) result(better)
    type(deck), intent(in) :: d
    type(deck) :: better
    integer :: k
    better = d
    do k = 1, size(d%bodies)
      if (d%bodies(k)%modes > 0) call take_mesh(better%bodies(k))
    end do
  end function take_meshes

  !> A deck with beams of twice as many elements.
  function halved(d) result(better)
    type(deck), intent(in) :: d
    type(deck) :: better
    integer :: k
    better = d
    do k = 1, size(d%bodies)
      if (d%bodies(k)%kind == 'beam' .and. .not. d%bodies(k)%auto_elements) call halve_elements(better, k)
    end do
  end function halved

  !> The errors of the deck's model beside a better one.
  subroutine check_model(run, better, words, errors, cost, factor, text)
    type(run_state), intent(in) :: run
    type(deck), intent(in) :: better
    character(*), intent(in) :: words                !! what is looked at
    character(*), intent(in) :: errors, cost         !! names of figures
    real(wp), intent(in) :: factor                   !! error over the difference from the better model [-]
    type(summary_record), intent(inout) :: text
    type(pilot_series) :: pilots
    type(pilot_result) :: reference, found
    type(failure) :: lost
    call pilots%begin(run%d, run%began)
    call pilots%run(better, reference, lost)
    if (.not. lost%happened()) call pilots%run(run%d, found, lost, reference)
    call pilots%title(words//', by pilots', text)
    if (.not. lost%happened()) found%error = factor*found%error
    if (.not. lost%happened()) call error_lines(found, errors, text)
    if (lost%status == status_failed) call add_warnings(text, run%d%path, 'warning: errors of the model are not known: '// &
                                                        lost%message//new_line('a'))
    call text%figure('  cost of both: ', cost, nint(pilots%cost, ip), rest=' explicit evaluations')
  end subroutine check_model

  !> Numbers of modes of the bodies with modes='auto': all below a frequency, the lowest one that keeps the errors small enough.
  subroutine choose_modes(d, began, error, text)
    type(deck), intent(inout) :: d
    integer(ip), intent(in) :: began                 !! count of the clock
    real(wp), allocatable, intent(inout) :: error(:) !! of meshes; receives that of modes as well [of the columns]
    type(summary_record), intent(inout) :: text
    type(pilot_series) :: pilots
    type(pilot_result) :: reference, kept, missed
    type(failure) :: lost
    type(deck) :: trial
    real(wp), allocatable :: frequency(:)            ! beyond the first one of each body [Hz]
    integer, allocatable :: body(:)                  ! whose it is
    integer :: low, high, level
    logical :: good
    call pilots%begin(d, began)
    call list_frequencies(d, body, frequency, lost)
    if (.not. lost%happened()) call pilots%run(d, reference, lost)
    low = -1
    level = 0
    high = most_level                                ! not known
    do while (.not. (lost%happened() .or. pilots%over) .and. high - low > 1 .and. low < size(body))
      call judge_level()
      if (good) high = level
      if (.not. good) low = level
      if (high == most_level) level = min(2*level + 1, size(body))
      if (high < most_level) level = (low + high)/2
    end do
    good = high < size(body)                         ! else nodal coordinates cost less
    call tell()
    if (good) d = with_modes(high)
    if (good .and. allocated(error)) error = error + kept%error
    if (good .and. .not. allocated(error)) error = kept%error
  contains
    !> The deck with the lowest modes of all bodies together, beyond the first one of each.
    function with_modes(level) result(x)
      integer, intent(in) :: level
      type(deck) :: x
      integer :: k
      x = d
      do k = 1, size(d%bodies)
        if (d%bodies(k)%auto_modes) x%bodies(k)%modes = 1 + count(body(1:level) == k)
      end do
    end function with_modes

    !> What left-out modes may take: their share, or what meshes and steps leave where that is less.
    pure function allowed(asked) result(part)
      real(wp), intent(in) :: asked(:)               !! (columns) [of the column]
      real(wp) :: part(size(asked))                  !! [of the column]
      part = modes_share*asked
      if (.not. allocated(error)) return
      where (error <= (1 - least_part)*asked) part = min(part, (1 - least_part)*asked - error)
    end function allowed

    !> Whether the lowest modes keep the errors small enough; a pilot that is lost says no.
    subroutine judge_level()
      type(pilot_result) :: found
      type(failure) :: no_end
      trial = with_modes(level)
      call pilots%run(trial, found, no_end, reference)
      if (pilots%over) lost = no_end
      good = .not. no_end%happened()
      if (good) good = all(found%error <= allowed(found%asked))
      if (good) kept = found
      if (.not. good .and. .not. no_end%happened()) missed = found
    end subroutine judge_level

    !> What was chosen and why.
    subroutine tell()
      logical :: shapes(size(d%bodies))
      integer :: k
      call pilots%title('modes=''auto'', by pilots beside nodal coordinates', text)
      call text%open('modes', '{')
      trial = d
      if (good) trial = with_modes(high)
      do k = 1, size(d%bodies)
        if (d%bodies(k)%auto_modes) call text%figure('  body "'//trim(d%bodies(k)%name)//'": modes=', trim(d%bodies(k)%name), &
                                                      trial%bodies(k)%modes, rest='')
      end do
      call text%close()
      if (good .and. high > 0) call text%line('  the highest at '//short_text(frequency(high), 2)//' Hz')
      if (allocated(missed%error)) then
        k = maxloc(missed%error/missed%asked, 1)
        call text%line('  fewer are not enough: '//trim(missed%names(k))//' errs by '// &
                       short_text(missed%error(k)/missed%asked(k), 1)//' of what is asked; left-out modes may take '// &
                       to_text(modes_share))
      end if
      if (good) call error_lines(kept, 'errors', text)
      if (lost%status == status_failed) call add_warnings(text, d%path, 'warning: modes=''auto'': fewer modes may be enough: '// &
                                                          lost%message//new_line('a'))
      if (.not. (good .or. lost%happened())) call text%line('  as many modes as the mesh has would be needed, or more than '// &
                                     to_text(most_modes)//': nodal coordinates, or all modes with reference=''free''')
      shapes = d%bodies%static_shapes .or. .not. d%bodies%auto_modes
      if (.not. (good .or. all(shapes) .or. lost%happened())) call text%line('  with static_shapes=.true. few may be enough')
      call text%figure('  cost of ', 'pilots', pilots%count)
      call text%figure(' pilots: ', 'cost', nint(pilots%cost, ip), rest=' explicit evaluations')
    end subroutine tell
  end subroutine choose_modes

  !> The natural frequencies of the bodies with modes='auto' beyond the first one of each, from the lowest to the highest.
  subroutine list_frequencies(d, body, frequency, fail)
    type(deck), intent(in) :: d
    integer, allocatable, intent(out) :: body(:)
    real(wp), allocatable, intent(out) :: frequency(:)   !! [Hz]
    type(failure), intent(inout) :: fail
    type(deck) :: most
    type(scene) :: s
    type(fault_list) :: faults
    integer, allocatable :: order(:)
    integer :: k, j
    most = d
    do k = 1, size(d%bodies)
      if (d%bodies(k)%auto_modes) most%bodies(k)%modes = modes_of_mesh(d%bodies(k))
    end do
    call build(most, s, faults)
    if (faults%count > 0) then
      call fail%raise(status_bad_input, faults%items(1)%message)
      return
    end if
    body = [integer ::]
    frequency = [real(wp) ::]
    do k = 1, size(d%bodies)
      if (.not. d%bodies(k)%auto_modes) cycle
      associate (n => most%bodies(k)%modes)
        select type (basis => s%bodies(k)%basis)
        type is (modal_model)
          body = [body, (k, j=2, n)]
          frequency = [frequency, sqrt(basis%omega2(2:n))/(2*pi)]
        end select
      end associate
    end do
    order = ascending(frequency)
    body = body(order)
    frequency = frequency(order)
  end subroutine list_frequencies
end module model_choice
