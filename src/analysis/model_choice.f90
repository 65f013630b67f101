!> What modes that a body leaves out and meshes make the columns err, and how many modes and elements keep the accuracy (theory.md,
!> section 12): pilots beside a better model. The deck then has plain numbers, and all that follows sees an ordinary deck.
module model_choice
  use kinds, only: wp, pi, ip
  use accuracy_words, only: column_lines, least_part
  use build_scene, only: build
  use deck_geometry, only: removed_coordinates
  use deck_mesh, only: set_elements, set_mesh
  use deck_records, only: body_record, deck
  use errors, only: failure, fault_list, status_bad_input, status_failed, status_signal
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
  public :: begin_model, choose_model

  integer, parameter :: most_modes = 60        !! of a body
  integer, parameter :: first_elements = 4     !! between two places, before a run has found how many it needs
  integer, parameter :: most_level = 256       !! elements between two places
  integer, parameter :: least_level = 16       !! below which meshes that come no closer tell nothing: they carry no waves
  real(wp), parameter :: halving_error = 4/3.0_wp   !! error of a mesh over the change where errors fall by four [-]
  real(wp), parameter :: mesh_share = 0.25_wp  !! of what a column may err by that the mesh may take [-]
  real(wp), parameter :: modes_share = 0.5_wp  !! the same of left-out modes [-]

contains

  !> Until elements='auto' is settled a body has some, until modes='auto' is its whole mesh.
  subroutine begin_model(d)
    type(deck), intent(inout) :: d
    integer :: k
    do k = 1, size(d%bodies)
      if (d%bodies(k)%auto_elements .and. .not. allocated(d%bodies(k)%stations)) call set_mesh(d, k, first_elements)
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
                                                              '', 1.0_wp, text)
        if (run%d%transient%check_mesh) call check_model(run, halved(run%d), 'meshes, beside elements of half the length', &
                                                         'mesh_', halving_error, text)
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
      if (d%bodies(k)%kind /= 'beam' .or. d%bodies(k)%auto_elements) cycle
      call set_elements(better, k, 2*d%bodies(k)%elements)
    end do
  end function halved

  !> The errors of the deck's model beside a better one.
  subroutine check_model(run, better, words, prefix, factor, text)
    type(run_state), intent(in) :: run
    type(deck), intent(in) :: better
    character(*), intent(in) :: words                !! what is looked at
    character(*), intent(in) :: prefix               !! of the names of figures
    real(wp), intent(in) :: factor                   !! error over the difference from the better model [-]
    type(summary_record), intent(inout) :: text
    type(pilot_series) :: pilots
    type(pilot_result) :: reference, found
    type(failure) :: lost
    call pilots%begin(run%d, run%began, factor)
    call pilots%run(better, reference, lost)
    if (.not. lost%happened()) call pilots%run(run%d, found, lost, reference)
    call pilots%title(words, text)
    if (allocated(found%error)) call column_lines(prefix//'errors', found%names, found%error, found%range, text)
    if (lost%status == status_failed) call add_warnings(text, run%d%path, 'warning: errors of the model are not known: '// &
                                                        lost%message//new_line('a'))
    call cost_line(pilots, prefix, text)
  end subroutine check_model

  !> What all pilots have cost.
  subroutine cost_line(pilots, prefix, text)
    type(pilot_series), intent(in) :: pilots
    character(*), intent(in) :: prefix               !! of the names of the figures
    type(summary_record), intent(inout) :: text
    call text%figure('  cost of ', prefix//'pilots', pilots%count)
    call text%figure(' pilots: ', prefix//'cost', nint(pilots%cost, ip), rest=' explicit evaluations')
  end subroutine cost_line

  !> The numbers that bodies have got.
  subroutine number_lines(d, what, is_chosen, numbers, text)
    type(deck), intent(in) :: d
    character(*), intent(in) :: what                 !! that is counted
    logical, intent(in) :: is_chosen(:)              !! (bodies)
    integer, intent(in) :: numbers(:)                !! (bodies)
    type(summary_record), intent(inout) :: text
    integer :: k
    call text%open(what, '{')
    do k = 1, size(d%bodies)
      if (is_chosen(k)) call text%figure('  body "'//trim(d%bodies(k)%name)//'": '//what//'=', trim(d%bodies(k)%name), &
                                         numbers(k), rest='')
    end do
    call text%close()
  end subroutine number_lines

  !> The worst column of a pilot in words.
  function worst_words(found) result(words)
    type(pilot_result), intent(in) :: found
    character(:), allocatable :: words
    integer :: k
    k = maxloc(found%error/found%asked, 1)
    words = trim(found%names(k))//' errs by '//short_text(found%error(k)/found%asked(k), 1)//' of what is asked'
  end function worst_words

  !> Elements of the bodies with elements='auto': the meshes of all are refined together until one is good enough by the next finer
  !> one; beside that each body is then given the fewest that are good enough. Where two finer meshes in a row come no closer,
  !> nothing is gained any more. The errors are not allocated where no two meshes could be compared.
  subroutine choose_elements(d, began, error, text)
    type(deck), intent(inout) :: d
    integer(ip), intent(in) :: began                 !! count of the clock
    real(wp), allocatable, intent(out) :: error(:)   !! [of the columns]
    type(summary_record), intent(inout) :: text
    type(pilot_series) :: pilots
    type(pilot_result) :: reference, found, kept
    type(failure) :: lost
    character(:), allocatable :: words
    integer, allocatable :: level(:)                 ! elements of each body's longest way between two places; 0: it has its own
    integer, allocatable :: chosen(:)                ! those with the smallest error so far
    integer :: b, low, high
    logical :: good
    call pilots%begin(d, began, halving_error)
    good = .false.
    level = merge(1, 0, d%bodies%auto_elements)
    chosen = first_elements*level
    call pilots%run(with(level), reference, lost)
    if (lost%happened() .and. .not. pilots%over) then   ! one element may be too few for what the deck asks of the body
      lost = failure()
      level = 2*level
      call pilots%run(with(level), reference, lost)
    end if
    do while (.not. lost%happened())
      call pilots%run(with(2*level), found, lost, reference)
      if (lost%happened()) exit
      reference = found
      if (allocated(kept%error)) good = found%worst() < kept%worst()
      if (good .or. .not. allocated(kept%error)) then
        kept = found
        chosen = level
      end if
      good = kept%worst() <= mesh_share
      if (good .or. maxval(level) >= max(4*maxval(chosen), least_level) .or. maxval(level) == most_level) exit
      level = 2*level
    end do
    level = chosen
    do b = 1, merge(size(level), 0, good)
      low = 0
      if (count(level > 0) == 1) low = level(b)/2
      high = level(b)
      do while (high - low > 1 .and. .not. pilots%over)
        level(b) = (low + high)/2
        call pilots%run(with(level), found, lost, reference)
        if (found%worst() <= mesh_share) then
          high = level(b)
          kept = found
        else
          low = level(b)
        end if
      end do
      level(b) = high
    end do
    d = with(level)
    call pilots%title('elements=''auto'', beside finer meshes', text)
    call number_lines(d, 'elements', level > 0, d%bodies%elements, text)
    words = 'what the mesh makes columns err is not known'
    if (allocated(kept%error)) then
      call column_lines('mesh_errors', kept%names, kept%error, kept%range, text)
      words = worst_words(kept)
      error = kept%error
    end if
    if (lost%happened()) words = words//': '//lost%message
    if (.not. lost%happened()) words = words//' on meshes that no finer one betters'
    if (kept%worst() > 1 - least_part .and. lost%status <= status_signal) then   ! more than its share may be: steps need no more
      call add_warnings(text, d%path, 'warning: elements=''auto'': '//words//new_line('a'))
    end if
    call cost_line(pilots, 'mesh_', text)
  contains
    !> The deck with meshes of some levels.
    function with(levels) result(x)
      integer, intent(in) :: levels(:)               !! (bodies)
      type(deck) :: x
      integer :: k
      x = d
      do k = 1, size(levels)
        if (levels(k) > 0) call set_mesh(x, k, levels(k))
      end do
      call begin_model(x)
    end function with
  end subroutine choose_elements

  !> Numbers of modes of the bodies with modes='auto': all below a frequency, the lowest one that keeps the errors small enough.
  subroutine choose_modes(d, began, error, text)
    type(deck), intent(inout) :: d
    integer(ip), intent(in) :: began                 !! count of the clock
    real(wp), allocatable, intent(inout) :: error(:) !! of meshes; receives that of modes as well [of the columns]
    type(summary_record), intent(inout) :: text
    type(pilot_series) :: pilots
    type(pilot_result) :: reference, found, kept, missed
    type(failure) :: lost, no_end
    real(wp), allocatable :: frequency(:)            ! beyond the first one of each body [Hz]
    integer, allocatable :: body(:)                  ! whose it is
    integer :: low, high, level
    call pilots%begin(d, began, 1.0_wp)
    call list_frequencies(d, body, frequency, lost)
    if (.not. lost%happened()) call pilots%run(d, reference, lost)
    low = -1
    high = size(body)                                ! as many: nodal coordinates cost less
    do while (.not. (lost%happened() .or. pilots%over) .and. high - low > 1)
      level = (low + high)/2
      no_end = failure()
      call pilots%run(with_modes(level), found, no_end, reference)
      if (pilots%over) lost = no_end
      if (is_enough()) then
        high = level
        kept = found
      else
        low = level
        if (allocated(found%error)) missed = found
      end if
    end do
    call pilots%title('modes=''auto'', beside nodal coordinates', text)
    if (allocated(kept%error)) then
      d = with_modes(high)
      call number_lines(d, 'modes', d%bodies%auto_modes, d%bodies%modes, text)
      if (high > 0) call text%line('  the highest at '//short_text(frequency(high), 2)//' Hz')
      call column_lines('errors', kept%names, kept%error, kept%range, text)
      if (allocated(error)) kept%error = kept%error + error
      error = kept%error
    else
      call number_lines(d, 'modes', d%bodies%auto_modes, d%bodies%modes, text)
      if (.not. lost%happened()) call text%line('  as many modes as the mesh has would be needed, or more than '// &
                                     to_text(most_modes)//': nodal coordinates, or all modes with reference=''free''')
      if (any(d%bodies%auto_modes .and. .not. d%bodies%static_shapes) .and. .not. lost%happened()) then
        call text%line('  with static_shapes=.true. few may be enough')
      end if
    end if
    if (allocated(missed%error)) call text%line('  fewer are not enough: '//worst_words(missed)//'; left-out modes may take '// &
                                                to_text(modes_share))
    if (lost%status == status_failed) call add_warnings(text, d%path, 'warning: modes=''auto'': fewer modes may be enough: '// &
                                                        lost%message//new_line('a'))
    call cost_line(pilots, '', text)
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

    !> Whether left-out modes take no more than their share, or than meshes and steps leave where that is less.
    pure logical function is_enough() result(yes)
      real(wp) :: part(size(found%names))            ! [of the column]
      yes = allocated(found%error)
      if (.not. yes) return
      part = modes_share*found%asked
      if (allocated(error)) then
        where (error <= (1 - least_part)*found%asked) part = min(part, (1 - least_part)*found%asked - error)
      end if
      yes = all(found%error <= part)
    end function is_enough
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
