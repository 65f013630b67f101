!> What modes that a body leaves out make the columns err, and how many modes keep the accuracy (theory.md, section 12): pilots
!> beside one in nodal coordinates. The deck then has plain numbers, and all that follows sees an ordinary deck.
module model_choice
  use kinds, only: wp, pi, ip
  use build_scene, only: build
  use deck_records, only: deck
  use errors, only: failure, fault_list, status_bad_input
  use mesh_choice, only: choose_elements, error_lines, modes_of_mesh, most_modes, take_mesh
  use modal_basis, only: modal_model
  use model_pilot, only: pilot_result, pilot_tolerance, run_pilot
  use scene_model, only: scene
  use scene_run, only: run_state, prepare_run
  use sorting, only: ascending
  use summary_text, only: summary_record
  use text, only: es_text, to_text
  implicit none (type, external)
  private
  public :: choose_model

  real(wp), parameter :: modes_share = 0.5_wp  !! of what a column may err by that left-out modes may take [-]

contains

  !> Settles elements='auto', then modes='auto' on these meshes, and finds the errors of left-out modes, where the deck asks for
  !> any of these.
  subroutine choose_model(run, text, fail)
    type(run_state), intent(inout) :: run
    type(summary_record), intent(inout) :: text
    type(failure), intent(inout) :: fail
    type(run_state) :: settled
    type(fault_list) :: faults
    real(wp), allocatable :: error(:), of_modes(:)   ! [of the columns]
    logical :: meshed, reduced
    meshed = any(run%d%bodies%auto_elements)
    reduced = any(run%d%bodies%auto_modes)
    if (.not. (meshed .or. reduced .or. run%d%transient%check_reduction)) return
    call text%open('reduction', '{')
    settled%d = run%d
    if (meshed) call choose_elements(settled%d, error, text, fail)
    if (reduced .and. .not. fail%happened()) call choose_modes(settled%d, of_modes, text, fail)
    if ((meshed .or. reduced) .and. .not. fail%happened()) then
      call prepare_run(settled, faults, fail)
      if (fail%happened()) return
      run = settled
      if (.not. allocated(error)) error = 0*of_modes
      if (allocated(of_modes)) error = error + of_modes
      run%model_error = error
    end if
    if (run%d%transient%check_reduction .and. .not. (reduced .or. fail%happened())) call check_modes(run%d, text, fail)
    if (fail%happened()) return
    call text%close()
  end subroutine choose_model

  !> The errors of the numbers of modes that the deck gives.
  subroutine check_modes(d, text, fail)
    type(deck), intent(in) :: d
    type(summary_record), intent(inout) :: text
    type(failure), intent(inout) :: fail
    type(deck) :: better
    type(pilot_result) :: reference, found
    integer :: k
    better = d
    do k = 1, size(d%bodies)
      if (d%bodies(k)%modes > 0) call take_mesh(better%bodies(k))
    end do
    call run_pilot(better, pilot_tolerance(d), reference, fail)
    if (.not. fail%happened()) call run_pilot(d, pilot_tolerance(d), found, fail, reference)
    if (fail%happened()) return
    call text%line('')
    call text%line('left-out modes, by pilots with them and without (radau, tolerance '//to_text(pilot_tolerance(d))//'):')
    call error_lines(found, 'errors', text)
    call text%figure('  cost of both: ', 'cost', nint(reference%cost + found%cost, ip), rest=' explicit evaluations')
  end subroutine check_modes

  !> Numbers of modes of the bodies with modes='auto': all below a frequency, the lowest one that keeps the errors small enough.
  subroutine choose_modes(d, error, text, fail)
    type(deck), intent(inout) :: d
    real(wp), allocatable, intent(out) :: error(:)   !! [of the columns]
    type(summary_record), intent(inout) :: text
    type(failure), intent(inout) :: fail
    type(pilot_result) :: reference, kept, missed
    type(deck) :: trial
    real(wp), allocatable :: frequency(:)            ! beyond the first one of each body [Hz]
    integer, allocatable :: body(:)                  ! whose it is
    real(wp) :: cost                                 ! in explicit evaluations [-]
    integer :: low, high, level, pilots
    logical :: good
    call list_frequencies(d, body, frequency, fail)
    if (fail%happened()) return
    call run_pilot(d, pilot_tolerance(d), reference, fail)
    if (fail%happened()) return
    cost = reference%cost
    pilots = 1
    low = -1
    level = 0
    do
      call judge_level()
      if (good .or. level == size(body)) exit
      low = level
      level = min(2*level + 1, size(body))
    end do
    high = level
    do while (good .and. high - low > 1)
      level = (low + high)/2
      call judge_level()
      if (good) high = level
      if (.not. good) low = level
      good = .true.
    end do
    good = high < size(body)                         ! else nodal coordinates cost less
    call tell()
    if (good) error = kept%error
    if (good) d = with_modes(high)
    if (.not. good) error = [(0.0_wp, level=1, size(reference%names))]
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

    !> Whether the lowest modes keep the errors small enough; a pilot that is lost says no.
    subroutine judge_level()
      type(pilot_result) :: found
      type(failure) :: lost
      trial = with_modes(level)
      call run_pilot(trial, pilot_tolerance(d), found, lost, reference)
      cost = cost + found%cost
      pilots = pilots + 1
      good = .not. lost%happened()
      if (good) good = all(found%error <= modes_share*found%asked)
      if (good) kept = found
      if (.not. good .and. .not. lost%happened()) missed = found
    end subroutine judge_level

    !> What was chosen and why.
    subroutine tell()
      logical :: shapes(size(d%bodies))
      integer :: k
      call text%line('')
      call text%line('modes=''auto'', by pilots beside nodal coordinates (radau, tolerance '//to_text(pilot_tolerance(d))//'):')
      call text%open('modes', '{')
      trial = d
      if (good) trial = with_modes(high)
      do k = 1, size(d%bodies)
        if (d%bodies(k)%auto_modes) call text%figure('  body "'//trim(d%bodies(k)%name)//'": modes=', trim(d%bodies(k)%name), &
                                                      trial%bodies(k)%modes, rest='')
      end do
      call text%close()
      if (good .and. high > 0) call text%line('  the highest at '//trim(adjustl(es_text(frequency(high), 2)))//' Hz')
      if (high > 0 .and. allocated(missed%error)) then
        k = maxloc(missed%error/missed%asked, 1)
        call text%line('  fewer are not enough: '//trim(missed%names(k))//' errs by '// &
                       trim(adjustl(es_text(missed%error(k)/missed%asked(k), 1)))//' of what is asked; left-out modes may take '// &
                       to_text(modes_share))
      end if
      if (good) call error_lines(kept, 'errors', text)
      if (.not. good) call text%line('  as many modes as the mesh has would be needed, or more than '//to_text(most_modes)// &
                                     ': nodal coordinates, or all modes with reference=''free''')
      shapes = d%bodies%static_shapes .or. .not. d%bodies%auto_modes
      if (.not. (good .or. all(shapes))) call text%line('  with static_shapes=.true. few may be enough')
      call text%figure('  cost of ', 'pilots', pilots)
      call text%figure(' pilots: ', 'cost', nint(cost, ip), rest=' explicit evaluations')
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
