!> How many elements keep the accuracy (theory.md, section 12): pilots on meshes that are refined until the change is small enough,
!> then each body's mesh made coarser as far as that allows. The deck then has plain numbers.
module mesh_choice
  use kinds, only: wp, ip
  use accuracy_words, only: least_part
  use deck_geometry, only: removed_coordinates
  use deck_mesh, only: set_mesh
  use deck_records, only: body_record, deck
  use errors, only: failure, status_signal
  use model_pilot, only: pilot_result, pilot_series
  use summary, only: add_warnings
  use summary_text, only: summary_record
  use text, only: es_text, short_text
  implicit none (type, external)
  private
  public :: begin_model, choose_elements, error_lines, modes_of_mesh, take_mesh

  integer, parameter, public :: most_modes = 60    !! of a body
  integer, parameter :: first_elements = 4     !! between two places, before a run has found how many it needs
  integer, parameter :: most_level = 256       !! elements between two places
  integer, parameter :: most_stalls = 2        !! refinements in a row that come no closer, after which none follows
  real(wp), parameter :: mesh_share = 0.25_wp  !! of what a column may err by that the mesh may take [-]
  real(wp), parameter :: first_fall = 0.25_wp  !! of changes from mesh to mesh, before two of them have been seen [-]
  real(wp), parameter :: slowest_fall = 0.5_wp !! that is believed [-]

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

  !> The errors of a pilot.
  subroutine error_lines(found, name, text)
    type(pilot_result), intent(in) :: found
    character(*), intent(in) :: name           !! in summary.json
    type(summary_record), intent(inout) :: text
    character(:), allocatable :: share
    integer :: k
    call text%line('    column, largest error, of its range')
    call text%open(name, '{')
    do k = 1, size(found%error)
      share = '  (constant but for rounding)'
      if (found%range(k) > 0.0_wp) share = ' '//es_text(found%error(k)/found%range(k), 1)
      call text%figure('    '//trim(found%names(k))//' ', trim(found%names(k)), found%error(k), 2, rest=share)
    end do
    call text%close()
  end subroutine error_lines

  !> Elements of the bodies with elements='auto': the meshes of all are refined together until one is good enough by the next finer
  !> one; beside that each body is then given the fewest that are good enough. The errors are those that remain, none where no
  !> two meshes could be compared. Where two finer meshes in a row come no closer, nothing is gained any more.
  subroutine choose_elements(d, began, error, text)
    type(deck), intent(inout) :: d
    integer(ip), intent(in) :: began                 !! count of the clock
    real(wp), allocatable, intent(out) :: error(:)   !! [of the columns]
    type(summary_record), intent(inout) :: text
    type(pilot_series) :: pilots
    type(pilot_result) :: reference, found, kept
    type(failure) :: lost
    integer, allocatable :: level(:)                 ! elements of each body's longest way between two places; 0: it has its own
    integer, allocatable :: chosen(:)                ! those with the smallest change so far
    real(wp), allocatable :: rest(:), remains(:)     ! errors that the finer mesh still has [of the columns]
    integer :: b, low, high, stalls
    logical :: good, closer
    call pilots%begin(d, began)
    stalls = 0
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
      if (allocated(reference%error)) then
        remains = found%error*fall()/(1 - fall())
      else
        remains = found%error*first_fall/(1 - first_fall)
      end if
      closer = .not. allocated(kept%error)
      if (.not. closer) closer = worst(found%error) < worst(kept%error)
      stalls = merge(0, stalls + 1, closer)
      if (closer) then
        kept = found
        rest = remains
        chosen = level
      end if
      reference = found
      good = worst(kept%error + rest) <= mesh_share
      if (good .or. stalls == most_stalls .or. maxval(level) == most_level) exit
      level = 2*level
    end do
    level = chosen
    do b = 1, merge(size(level), 0, good)
      low = 0
      if (count(level > 0) == 1) low = level(b)/2
      high = level(b)
      do while (high - low > 1 .and. .not. pilots%over)
        level(b) = (low + high)/2
        if (good_enough()) then
          high = level(b)
        else
          low = level(b)
        end if
      end do
      level(b) = high
    end do
    if (allocated(kept%error)) then
      kept%error = kept%error + rest
      error = kept%error
    end if
    d = with(level)
    call tell()
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

    !> Whether the meshes of the present levels are good enough; a pilot that is lost says no.
    logical function good_enough() result(yes)
      type(failure) :: no_end
      call pilots%run(with(level), found, no_end, reference)
      yes = .not. no_end%happened()
      if (yes) yes = worst(found%error + rest) <= mesh_share
      if (yes) kept = found
    end function good_enough

    !> The largest error over what a column may err by.
    pure real(wp) function worst(x)
      real(wp), intent(in) :: x(:)                   !! (columns) [of the column]
      worst = maxval(x/found%asked)                  ! [-]
    end function worst

    !> By how much the last refinement has made the change of each column smaller, as far as it is believed.
    pure function fall() result(part)
      real(wp) :: part(size(found%error))            !! [-]
      part = slowest_fall
      where (reference%error > 0.0_wp) part = min(slowest_fall, found%error/reference%error)
    end function fall

    !> What was chosen.
    subroutine tell()
      character(:), allocatable :: words
      integer :: k
      call pilots%title('elements=''auto'', by pilots beside finer meshes', text)
      call text%open('elements', '{')
      do k = 1, size(d%bodies)
        if (level(k) > 0) call text%figure('  body "'//trim(d%bodies(k)%name)//'": elements=', trim(d%bodies(k)%name), &
                                           d%bodies(k)%elements, rest='')
      end do
      call text%close()
      words = 'what the mesh makes columns err is not known'
      if (allocated(error)) then
        call error_lines(kept, 'mesh_errors', text)
        k = maxloc(error/kept%asked, 1)
        words = trim(kept%names(k))//' errs by '//short_text(error(k)/kept%asked(k), 1)//' of what is asked'
      end if
      if (lost%happened()) then
        words = words//': '//lost%message
      else
        words = words//' on meshes that no finer one betters'
      end if
      if (.not. good .and. allocated(error)) good = worst(error) <= 1 - least_part   ! more than its share, but steps get the rest
      if (.not. (good .or. lost%status > status_signal)) call add_warnings(text, d%path, 'warning: elements=''auto'': '// &
        words//new_line('a'))
      call text%figure('  cost of ', 'mesh_pilots', pilots%count)
      call text%figure(' pilots: ', 'mesh_cost', nint(pilots%cost, ip), rest=' explicit evaluations')
    end subroutine tell
  end subroutine choose_elements
end module mesh_choice
