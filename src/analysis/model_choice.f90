!> What modes that a body leaves out and meshes make the columns err, and how many modes keep the accuracy (theory.md, section 12):
!> pilots beside a better model. The deck then has plain numbers, and all that follows sees an ordinary deck.
module model_choice
  use kinds, only: wp, pi, ip
  use accuracy_words, only: column_lines
  use build_scene, only: build
  use deck_geometry, only: removed_coordinates
  use deck_mesh, only: set_elements
  use deck_records, only: body_record, deck
  use errors, only: failure, fault_list, status_bad_input, status_failed, status_signal
  use modal_basis, only: modal_model
  use model_pilot, only: pilot_result, pilot_series
  use posix, only: caught_signal, hold_signals
  use scene_model, only: scene
  use scene_run, only: run_state, prepare_run
  use sorting, only: ascending
  use text, only: short_text, to_text
  implicit none (type, external)
  private
  public :: begin_model, choose_model

  integer, parameter :: most_modes = 60        !! of a body
  real(wp), parameter :: halving_error = 1/(1 - 0.5_wp**2)   !! error of a mesh over the change by half the length, by theory [-]

contains

  !> Until the number of modes='auto' is found it is the whole mesh.
  subroutine begin_model(d)
    type(deck), intent(inout) :: d
    integer :: k
    do k = 1, size(d%bodies)
      if (d%bodies(k)%auto_modes) call take_mesh(d%bodies(k))
    end do
  end subroutine begin_model

  !> Nodal coordinates; for reference='free', which has none, as many modes as can be had.
  pure subroutine take_mesh(b)
    type(body_record), intent(inout) :: b
    b%modes = merge(max(b%modes, modes_of_mesh(b)), 0, b%reference == 'free')
  end subroutine take_mesh

  !> How many modes a body may be given.
  pure integer function modes_of_mesh(b) result(n)
    type(body_record), intent(in) :: b
    logical :: kept(3, b%nodes)
    kept = .not. removed_coordinates(b)
    if (.not. b%axial) kept(1, :) = .false.
    n = count(kept)
    if (b%reference == 'free') n = n - merge(3, 2, b%axial)
    n = min(n, most_modes)
  end function modes_of_mesh

  !> Finds the number of modes='auto' and the errors of left-out modes and of meshes, where the deck asks for any of these; a
  !> restart has what the first run found. The scene is then built anew.
  subroutine choose_model(run, fail)
    type(run_state), intent(inout) :: run
    type(failure), intent(inout) :: fail
    type(fault_list) :: faults
    type(deck) :: better
    logical :: reduced
    integer :: k
    reduced = any(run%d%bodies%auto_modes)
    run%model_found = reduced .or. run%d%transient%check_reduction .or. run%d%transient%check_mesh
    if (.not. run%model_found) return
    call hold_signals(1)
    if (run%restart) then
      call run%exchange_model(run%saved)
    else
      run%model_words%path = run%d%path
      call run%model_words%open('reduction', '{')
      if (reduced) call choose_modes(run)
      better = run%d
      do k = 1, size(better%bodies)
        if (better%bodies(k)%modes > 0) call take_mesh(better%bodies(k))
      end do
      if (run%d%transient%check_reduction) call check_model(run, better, 'left-out modes, beside nodal coordinates', '', 1.0_wp)
      better = run%d
      do k = 1, size(better%bodies)
        if (better%bodies(k)%kind == 'beam') call set_elements(better, k, 2*better%bodies(k)%elements)
      end do
      if (run%d%transient%check_mesh) call check_model(run, better, 'meshes, beside elements of half the length', 'mesh_', &
                                                       halving_error)
      call run%model_words%close()
    end if
    if (caught_signal() > 0) call fail%raise(status_signal + caught_signal(), 'stopped by signal '//to_text(caught_signal())// &
      ' in a pilot, before the run: no file was written or changed; run the deck again')
    call hold_signals(0)
    if (reduced .and. .not. fail%happened()) call prepare_run(run, faults, fail)
  end subroutine choose_model

  !> The errors of the deck's model beside a better one.
  subroutine check_model(run, better, words, prefix, factor)
    type(run_state), intent(inout) :: run
    type(deck), intent(in) :: better
    character(*), intent(in) :: words                !! what is looked at
    character(*), intent(in) :: prefix               !! of the names of figures
    real(wp), intent(in) :: factor                   !! error over the difference from the better model [-]
    type(pilot_series) :: pilots
    type(pilot_result) :: reference, found
    type(failure) :: lost
    character(:), allocatable :: doubt
    call pilots%begin(run%d, run%began, factor)
    call pilots%run(better, reference, lost)
    if (.not. lost%happened()) call pilots%run(run%d, found, lost, reference)
    doubt = ''
    if (lost%status == status_failed) doubt = 'errors of the model are not known: '//lost%message
    call report(run, pilots, found, words, prefix, '', doubt)
  end subroutine check_model

  !> What pilots have found: errors of columns, a warning, what they have cost.
  subroutine report(run, pilots, found, words, prefix, notes, doubt)
    type(run_state), intent(inout) :: run
    type(pilot_series), intent(in) :: pilots
    type(pilot_result), intent(in) :: found          !! of the model
    character(*), intent(in) :: words                !! what is looked at
    character(*), intent(in) :: prefix               !! of the names of figures
    character(*), intent(in) :: notes                !! lines
    character(*), intent(in) :: doubt                !! for a warning; empty: none
    associate (text => run%model_words)
      call text%line('')
      call text%line(words//', by pilots (radau, tolerance {'//prefix//'tolerance}):', [pilots%tolerance])
      call text%words%add(notes)
      if (allocated(found%off%error)) call column_lines(prefix//'errors', found%columns, found%off%error, found%off%range, text)
      call text%warn(doubt)
      call text%line('  cost of {'//prefix//'pilots #} pilots: {'//prefix//'cost #} explicit evaluations', &
                     [real(wp) :: pilots%count, pilots%cost])
    end associate
  end subroutine report

  !> Numbers of modes of the bodies with modes='auto': all below a frequency, the lowest one that keeps the errors small enough, by
  !> bisection over the modes of all bodies. As many modes as there are are not tried: nodal coordinates cost less.
  subroutine choose_modes(run)
    type(run_state), intent(inout) :: run
    type(pilot_series) :: pilots
    type(pilot_result) :: reference, found, kept
    type(failure) :: lost, ended
    character(:), allocatable :: notes, fewer, doubt
    real(wp), allocatable :: frequency(:)            ! beyond the first one of each body [Hz]
    integer, allocatable :: body(:)                  ! whose it is
    integer :: low, high, n, k
    call pilots%begin(run%d, run%began, 1.0_wp)
    call list_frequencies(run%d, body, frequency, lost)
    if (.not. lost%happened()) call pilots%run(run%d, reference, lost)
    low = -1
    high = size(body)
    fewer = ''
    do while (high - low > 1 .and. .not. lost%happened())
      n = (low + high)/2
      ended = failure()
      call pilots%run(with_modes(run%d, body(:n)), found, ended, reference)
      if (pilots%over) lost = ended
      if (found%worst() <= 1 - found%worst()) then   ! they take no more than they leave to the steps
        high = n
        kept = found
        cycle
      end if
      low = n
      if (.not. allocated(found%off%error)) cycle
      k = maxloc(found%off%error/found%off%asked, 1)
      fewer = '  fewer are not enough: '//trim(found%columns(k)%label())//' errs by '//short_text(found%worst(), 1)// &
              ' of what is asked; they may take half'//new_line('a')
    end do
    notes = ''
    if (allocated(kept%off%error)) then
      run%d = with_modes(run%d, body(:high))
      run%model_error = kept%off%error
      if (high > 0) notes = '  the highest at '//short_text(frequency(high), 2)//' Hz'//new_line('a')
    else if (.not. lost%happened()) then
      notes = '  as many modes as the mesh has would be needed, or more than '//to_text(most_modes)// &
              ': nodal coordinates, or all modes with reference=''free'''//new_line('a')
      if (any(run%d%bodies%auto_modes .and. .not. run%d%bodies%static_shapes)) then
        notes = notes//'  with static_shapes=.true. few may be enough'//new_line('a')
      end if
    end if
    doubt = ''
    if (lost%status == status_failed) doubt = 'modes=''auto'': fewer modes may be enough: '//lost%message
    associate (text => run%model_words)
      call text%open('modes', '{')
      do k = 1, size(run%d%bodies)
        if (run%d%bodies(k)%auto_modes) call text%line('  body "'//trim(run%d%bodies(k)%name)//'": modes={'// &
          trim(run%d%bodies(k)%name)//' #}', [real(wp) :: run%d%bodies(k)%modes])
      end do
      call text%close()
    end associate
    call report(run, pilots, kept, 'modes=''auto'', beside nodal coordinates', '', notes//fewer, doubt)
  end subroutine choose_modes

  !> The deck with one mode of each body with modes='auto', and more of those in a list.
  function with_modes(d, list) result(x)
    type(deck), intent(in) :: d
    integer, intent(in) :: list(:)                   !! bodies
    type(deck) :: x
    integer :: k
    x = d
    do k = 1, size(x%bodies)
      if (x%bodies(k)%auto_modes) x%bodies(k)%modes = 1 + count(list == k)
    end do
  end function with_modes

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
      select type (basis => s%bodies(k)%basis)
      type is (modal_model)
        if (.not. d%bodies(k)%auto_modes) cycle
        body = [body, (k, j=2, most%bodies(k)%modes)]
        frequency = [frequency, sqrt(basis%omega2(2:most%bodies(k)%modes))/(2*pi)]   ! static shapes come last
      end select
    end do
    order = ascending(frequency)
    body = body(order)
    frequency = frequency(order)
  end subroutine list_frequencies
end module model_choice
