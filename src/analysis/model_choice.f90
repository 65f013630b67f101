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
  use posix, only: caught_signal, hold_signals
  use scene_model, only: scene
  use scene_run, only: run_state, prepare_run
  use sorting, only: ascending
  use summary, only: add_warnings
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

  !> A search of the poorest model that is good enough, by pilots beside a better model.
  type :: model_search
    logical :: by_elements = .false.           !! numbers of elements are looked for; else of modes
    real(wp) :: share = 0.0_wp                 !! of what a column may err by that the model may take [-]
    type(pilot_series) :: pilots
    type(pilot_result) :: reference            !! of the better model
    type(pilot_result) :: kept                 !! of the poorest model that is good enough so far
    type(pilot_result) :: missed               !! of the last one that is not
    type(failure) :: lost                      !! why the search ended early
  end type model_search

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
    type(deck) :: better
    logical :: meshed, reduced
    integer :: k
    meshed = any(run%d%bodies%auto_elements)
    reduced = any(run%d%bodies%auto_modes)
    run%model_found = meshed .or. reduced .or. run%d%transient%check_reduction .or. run%d%transient%check_mesh
    if (.not. run%model_found) return
    call hold_signals(1)
    if (run%restart) then
      call run%exchange_model(run%saved)
    else
      call run%model_words%open('reduction', '{')
      if (meshed) call choose_elements(run)
      if (reduced) call choose_modes(run)
      if (run%d%transient%check_reduction) then
        better = run%d
        do k = 1, size(better%bodies)
          if (better%bodies(k)%modes > 0) call take_mesh(better%bodies(k))
        end do
        call check_model(run, better, 'left-out modes, beside nodal coordinates', '', 1.0_wp)
      end if
      if (run%d%transient%check_mesh) then
        better = run%d
        do k = 1, size(better%bodies)
          if (better%bodies(k)%kind /= 'beam' .or. better%bodies(k)%auto_elements) cycle
          call set_elements(better, k, 2*better%bodies(k)%elements)
        end do
        call check_model(run, better, 'meshes, beside elements of half the length', 'mesh_', halving_error)
      end if
      call run%model_words%close()
    end if
    if (caught_signal() > 0) call fail%raise(status_signal + caught_signal(), 'stopped by signal '//to_text(caught_signal())// &
      ' in a pilot, before the run: no file was written or changed; run the deck again')
    call hold_signals(0)
    if ((meshed .or. reduced) .and. .not. fail%happened()) call prepare_run(run, faults, fail)
  end subroutine choose_model

  !> The errors of the deck's model beside a better one.
  subroutine check_model(run, better, words, prefix, factor)
    type(run_state), intent(inout) :: run
    type(deck), intent(in) :: better
    character(*), intent(in) :: words                !! what is looked at
    character(*), intent(in) :: prefix               !! of the names of figures
    real(wp), intent(in) :: factor                   !! error over the difference from the better model [-]
    type(model_search) :: s
    character(:), allocatable :: doubt
    call s%pilots%begin(run%d, run%began, factor)
    call s%pilots%run(better, s%reference, s%lost)
    if (.not. s%lost%happened()) call s%pilots%run(run%d, s%kept, s%lost, s%reference)
    doubt = ''
    if (s%lost%status == status_failed) doubt = 'errors of the model are not known: '//s%lost%message
    call report(run, s, words, prefix, '', doubt)
  end subroutine check_model

  !> What a search has found: numbers of bodies, errors of columns, a warning, what it has cost.
  subroutine report(run, s, words, prefix, notes, doubt)
    type(run_state), intent(inout) :: run
    type(model_search), intent(in) :: s
    character(*), intent(in) :: words                !! what is looked at
    character(*), intent(in) :: prefix               !! of the names of figures
    character(*), intent(in) :: notes                !! lines
    character(*), intent(in) :: doubt                !! for a warning; empty: none
    character(:), allocatable :: what
    integer :: k
    associate (text => run%model_words, bodies => run%d%bodies)
      call text%line('')
      call text%line(words//', by pilots (radau, tolerance '//to_text(s%pilots%tolerance)//'):')
      if (s%share > 0.0_wp) then                     ! else nothing was chosen
        what = trim(merge('elements', 'modes   ', s%by_elements))
        call text%open(what, '{')
        do k = 1, size(bodies)
          if (.not. merge(bodies(k)%auto_elements, bodies(k)%auto_modes, s%by_elements)) cycle
          call text%figure('  body "'//trim(bodies(k)%name)//'": '//what//'=', trim(bodies(k)%name), &
                             merge(bodies(k)%elements, bodies(k)%modes, s%by_elements), rest='')
        end do
        call text%close()
      end if
      call text%words%add(notes)
      if (allocated(s%kept%error)) call column_lines(prefix//'errors', s%kept%names, s%kept%error, s%kept%range, text)
      if (allocated(s%missed%error)) call text%line('  fewer are not enough: '//worst_words(s%missed)//'; they may take '// &
                                                    to_text(s%share))
      if (len(doubt) > 0) call add_warnings(text, run%d%path, 'warning: '//doubt//new_line('a'))
      call text%figure('  cost of ', prefix//'pilots', s%pilots%count)
      call text%figure(' pilots: ', prefix//'cost', nint(s%pilots%cost, ip), rest=' explicit evaluations')
    end associate
  end subroutine report

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
  !> nothing is gained any more.
  subroutine choose_elements(run)
    type(run_state), intent(inout) :: run
    type(model_search) :: s
    type(pilot_result) :: found
    character(:), allocatable :: doubt
    integer, allocatable :: level(:)                 ! elements of each body's longest way between two places; 0: it has its own
    integer, allocatable :: chosen(:)                ! those with the smallest error so far
    integer, allocatable :: steps(:)
    integer :: b
    s = model_search(by_elements=.true., share=mesh_share)
    call s%pilots%begin(run%d, run%began, halving_error)
    level = merge(1, 0, run%d%bodies%auto_elements)
    chosen = first_elements*level
    call s%pilots%run(numbered(run%d, s, level), s%reference, s%lost)
    if (s%lost%happened() .and. .not. s%pilots%over) then   ! one element may be too few for what the deck asks of the body
      s%lost = failure()
      level = 2*level
      call s%pilots%run(numbered(run%d, s, level), s%reference, s%lost)
    end if
    do while (.not. s%lost%happened())
      call s%pilots%run(numbered(run%d, s, 2*level), found, s%lost, s%reference)
      if (s%lost%happened()) exit
      s%reference = found
      if (found%worst() < s%kept%worst()) then
        s%kept = found
        chosen = level
      end if
      if (s%kept%worst() <= mesh_share .or. maxval(level) >= max(4*maxval(chosen), least_level) .or. &
          maxval(level) == most_level) exit
      level = 2*level
    end do
    level = chosen
    if (s%kept%worst() <= mesh_share) then
      do b = 1, size(level)
        steps = spread(b, 1, level(b))
        level(b) = 0
        call bisect(run, s, level, steps, merge(size(steps)/2, 0, all(level == 0)))
      end do
    end if
    run%d = numbered(run%d, s, level)
    doubt = ''
    if (s%kept%worst() > 1 - least_part .and. s%lost%status <= status_signal) then   ! steps need no more than the rest
      doubt = 'elements=''auto'': what the mesh makes columns err is not known'
      if (allocated(s%kept%error)) doubt = 'elements=''auto'': '//worst_words(s%kept)
      if (s%lost%happened()) doubt = doubt//': '//s%lost%message
      if (.not. s%lost%happened()) doubt = doubt//' on meshes that no finer one betters'
    end if
    call report(run, s, 'elements=''auto'', beside finer meshes', 'mesh_', '', doubt)
    if (allocated(s%kept%error)) run%model_error = s%kept%error
  end subroutine choose_elements

  !> Numbers of modes of the bodies with modes='auto': all below a frequency, the lowest one that keeps the errors small enough.
  subroutine choose_modes(run)
    type(run_state), intent(inout) :: run
    type(model_search) :: s
    character(:), allocatable :: notes, doubt
    real(wp), allocatable :: frequency(:)            ! beyond the first one of each body [Hz]
    integer, allocatable :: body(:)                  ! whose it is
    integer, allocatable :: numbers(:)               ! of modes of each body
    integer :: n
    s = model_search(share=modes_share)
    notes = ''
    doubt = ''
    call s%pilots%begin(run%d, run%began, 1.0_wp)
    call list_frequencies(run%d, body, frequency, s%lost)
    if (.not. s%lost%happened()) call s%pilots%run(run%d, s%reference, s%lost)
    if (.not. s%lost%happened()) then
      numbers = merge(1, 0, run%d%bodies%auto_modes)
      call bisect(run, s, numbers, body, -1)
    end if
    if (allocated(s%kept%error)) then
      run%d = numbered(run%d, s, numbers)
      n = sum(numbers) - count(run%d%bodies%auto_modes)
      if (n > 0) notes = '  the highest at '//short_text(frequency(n), 2)//' Hz'//new_line('a')
    else if (.not. s%lost%happened()) then
      notes = '  as many modes as the mesh has would be needed, or more than '//to_text(most_modes)// &
              ': nodal coordinates, or all modes with reference=''free'''//new_line('a')
      if (any(run%d%bodies%auto_modes .and. .not. run%d%bodies%static_shapes)) then
        notes = notes//'  with static_shapes=.true. few may be enough'//new_line('a')
      end if
    end if
    if (s%lost%status == status_failed) doubt = 'modes=''auto'': fewer modes may be enough: '//s%lost%message
    call report(run, s, 'modes=''auto'', beside nodal coordinates', '', notes, doubt)
    if (.not. allocated(s%kept%error)) return
    if (allocated(run%model_error)) s%kept%error = s%kept%error + run%model_error
    run%model_error = s%kept%error
  end subroutine choose_modes

  !> The poorest model of a sequence that is good enough, by bisection. The sequence adds an element or a mode to one body after the
  !> other, by a list; of modes as many as the list has are not tried: nodal coordinates cost less.
  subroutine bisect(run, s, numbers, list, poor)
    type(run_state), intent(in) :: run
    type(model_search), intent(inout) :: s
    integer, intent(inout) :: numbers(:)             !! (bodies) before the list; receives those of the model found
    integer, intent(in) :: list(:)                   !! bodies
    integer, intent(in) :: poor                      !! how much of the list is not enough
    type(pilot_result) :: found
    type(failure) :: lost
    integer :: low, high, n, k
    low = poor
    high = size(list)
    do while (high - low > 1 .and. .not. s%pilots%over)
      n = (low + high)/2
      lost = failure()
      call s%pilots%run(numbered(run%d, s, [(numbers(k) + count(list(1:n) == k), k=1, size(numbers))]), found, lost, s%reference)
      if (s%pilots%over) s%lost = lost
      if (is_enough(found, s%share, run%model_error)) then
        high = n
        s%kept = found
      else
        low = n
        if (allocated(found%error)) s%missed = found
      end if
    end do
    numbers = [(numbers(k) + count(list(1:high) == k), k=1, size(numbers))]
  end subroutine bisect

  !> The deck with numbers of elements or modes of its bodies.
  function numbered(d, s, numbers) result(x)
    type(deck), intent(in) :: d
    type(model_search), intent(in) :: s
    integer, intent(in) :: numbers(:)                !! (bodies)
    type(deck) :: x
    integer :: k
    x = d
    do k = 1, size(numbers)
      if (s%by_elements .and. d%bodies(k)%auto_elements) call set_mesh(x, k, numbers(k))
      if (.not. s%by_elements .and. d%bodies(k)%auto_modes) x%bodies(k)%modes = numbers(k)
    end do
    if (s%by_elements) call begin_model(x)
  end function numbered

  !> Whether a model takes no more than its share, or than the errors of meshes and steps leave where that is less.
  pure logical function is_enough(found, share, error) result(yes)
    type(pilot_result), intent(in) :: found
    real(wp), intent(in) :: share                    !! of what a column may err by [-]
    real(wp), allocatable, intent(in) :: error(:)    !! of meshes [of the column]
    real(wp), allocatable :: part(:)                 ! [of the column]
    yes = allocated(found%error)
    if (.not. yes) return
    part = share*found%asked
    if (allocated(error)) then
      where (error <= (1 - least_part)*found%asked) part = min(part, (1 - least_part)*found%asked - error)
    end if
    yes = all(found%error <= part)
  end function is_enough

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
