!> The result files of a transient: history.txt, energy.txt, motion.txt and events.txt, with their headers (README.md).
module results
  use result_columns, only: labels_of, motion_columns, motion_row
  use decimal, only: number_width, write_number
  use kinds, only: wp, ip
  use archive, only: value_archive
  use own_files, only: remove_own
  use posix, only: file_size, replace_file
  use mechanism, only: mechanism_model
  use sensors, only: sensor_list
  use switching, only: event_list, element_name, state_word
  use text, only: either, joined
  use text_file, only: result_file
  implicit none (type, external)
  private
  public :: result_set, remove_results, pass_suffix

  integer, parameter :: history = 1, energies = 2, motion = 3, events = 4
  character(*), parameter :: names(4) = [character(12) :: '/history.txt', '/energy.txt', '/motion.txt', '/events.txt']
  character(*), parameter, public :: unfinished(2) = ['.new1', '.new2']   !! ends of the names of passes in turn, until they count
  integer(ip), parameter, public :: most_events = 100000   !! lines of events.txt

  !> Open result files and what their rows need.
  type :: result_set
    character(5) :: suffix = ''               !! of the names while the run is not finished
    type(result_file), private :: files(4)
    type(result_file), private :: delivered(4)   !! of an earlier pass, which stay where this one is not delivered
    integer, allocatable, private :: used(:)  !! files that are written: motion and events only where there may be any
    integer(ip) :: events = 0                 !! so far; the file has the first ones
    real(wp), allocatable :: values(:)        !! columns of the sensors [unit of each column]
    logical :: incomplete = .false.           !! an interrupted run's files lack rows that its checkpoint counts on
  contains
    procedure :: follow
    procedure :: open => open_results
    procedure :: resume => resume_results
    procedure :: write_row
    procedure :: write_motion
    procedure :: write_events
    procedure :: sync => sync_results
    procedure :: exchange
    procedure :: close => close_results
    procedure :: publish
    procedure :: failed
  end type result_set

contains

  !> How the names of a pass's files end until they count.
  pure function pass_suffix(pass) result(suffix)
    integer, intent(in) :: pass               !! number
    character(5) :: suffix
    suffix = unfinished(1 + mod(pass, 2))
  end function pass_suffix

  !> Takes over which files an earlier pass has delivered.
  subroutine follow(self, before, its)
    class(result_set), intent(inout) :: self
    type(result_set), intent(in) :: before    !! the pass before, closed
    logical, intent(in) :: its                !! they are of the pass before
    self%delivered = before%delivered
    if (its) self%delivered = before%files
  end subroutine follow

  !> Opens the files in a folder that exists and writes their headers; without a folder there are no files.
  subroutine open_results(self, folder, deck_name, m, list, with_motion)
    class(result_set), intent(inout) :: self
    character(*), intent(in) :: folder, deck_name
    type(mechanism_model), intent(in) :: m
    type(sensor_list), intent(in) :: list
    logical, intent(in) :: with_motion
    allocate (self%values(list%columns))
    self%used = files_of(m, with_motion)
    if (len(folder) == 0) self%used = [integer ::]
    if (len(folder) == 0) return
    call begin(history, 'sensors against time', 't[s] '//joined(list%column%label(), ' '))
    call begin(energies, 'energies, their residual and constraint violations against time', 't[s] kinetic[J] potential[J] '// &
               'dissipated[J] work[J] residual[J] position_violation[m] velocity_violation[m/s]'// &
               either(' stops[J]', '', m%s%stops > 0)// &
               either(' friction[J]', '', m%s%elements > size(m%s%switching)))
    if (with_motion) call begin(motion, 'body frames and node positions against time', &
                                't[s] '//joined(labels_of(motion_columns(m)), ' '))
    if (any(self%used == events)) call begin(events, 'events; speed: at touching, 0 where none touches, rad/s where a stop '// &
                                             'limits an angle', 't[s] element from to speed[m/s]')
  contains
    !> Opens a file and writes its first lines.
    subroutine begin(k, what, columns)
      integer, intent(in) :: k                !! which file
      character(*), intent(in) :: what        !! what it holds
      character(*), intent(in) :: columns     !! names with units, separated by blanks
      call self%files(k)%open(folder//trim(names(k))//trim(self%suffix))
      call self%files(k)%head(what, deck_name, m%s%title)
      call self%files(k)%line('# columns: '//columns)
    end subroutine begin
  end subroutine open_results

  !> Which files a run writes.
  pure function files_of(m, with_motion) result(list)
    type(mechanism_model), intent(in) :: m
    logical, intent(in) :: with_motion
    integer, allocatable :: list(:)
    list = pack([history, energies, motion, events], &
                [.true., .true., with_motion, m%s%stops + m%s%choices + size(m%s%friction) > 0])
  end function files_of

  !> Opens the files of an interrupted run and cuts them to the length at its checkpoint, which `exchange` has restored.
  subroutine resume_results(self, folder, delivered, m, list, with_motion)
    class(result_set), intent(inout) :: self
    character(*), intent(in) :: folder
    character(*), intent(in) :: delivered     !! suffix of the pass that is delivered
    type(mechanism_model), intent(in) :: m
    type(sensor_list), intent(in) :: list
    logical, intent(in) :: with_motion
    logical :: named
    integer :: k
    allocate (self%values(list%columns))
    self%used = files_of(m, with_motion)
    do k = 1, size(self%used)                 ! all of them before any is cut
      associate (i => self%used(k))
        if (.not. self%files(i)%covers(present_path(i, trim(self%suffix)))) self%incomplete = .true.
        if (.not. self%delivered(i)%covers(present_path(i, delivered))) self%incomplete = .true.
      end associate
    end do
    if (self%incomplete) return
    do k = 1, size(self%used)
      associate (i => self%used(k), path => folder//trim(names(self%used(k)))//trim(self%suffix))
        if (present_path(i, trim(self%suffix)) /= path) named = replace_file(present_path(i, trim(self%suffix)), path)
        call self%files(i)%resume(path)
      end associate
    end do
  contains
    !> Where a file is: a run that was killed at its end may have given it its own name already.
    function present_path(i, suffix) result(path)
      integer, intent(in) :: i
      character(*), intent(in) :: suffix
      character(:), allocatable :: path
      path = folder//trim(names(i))//suffix
      if (file_size(path) < 0) path = folder//trim(names(i))
    end function present_path
  end subroutine resume_results

  !> Writes a row of sensors, which `values` holds, and one of energies.
  subroutine write_row(self, t, energy)
    class(result_set), intent(inout) :: self
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in) :: energy(:)         !! columns of energy.txt after the time [J], [m], [m/s]
    if (size(self%used) == 0) return
    call self%files(history)%row(self%values, t)
    call self%files(energies)%row(energy, t)
  end subroutine write_row

  !> Writes one row of motion.
  subroutine write_motion(self, t, m, q)
    class(result_set), intent(inout) :: self
    real(wp), intent(in) :: t                 !! [s]
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in), contiguous :: q(:)  !! (nq) [m, rad]
    call self%files(motion)%row(motion_row(m, q), t)
  end subroutine write_motion

  !> Writes events, a line each, and empties their list.
  subroutine write_events(self, m, list)
    class(result_set), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(event_list), intent(inout) :: list
    character(number_width) :: time, speed
    integer :: k
    do k = 1, list%count
      self%events = self%events + 1
      if (self%events > most_events .or. size(self%used) == 0) cycle
      associate (x => list%items(k))
        call write_number(x%t, time)
        call write_number(merge(x%event_value, 0.0_wp, x%from == 0), speed)
        call self%files(events)%line(time//' '//element_name(m, x%element)//' '// &
          state_word(m, x%element, x%from)//' '//state_word(m, x%element, x%to)//speed)
      end associate
    end do
    list%count = 0
  end subroutine write_events

  !> Puts everything written so far on the disk.
  subroutine sync_results(self)
    class(result_set), intent(inout) :: self
    call self%files%sync()
  end subroutine sync_results

  !> Saves or restores how far the files are.
  subroutine exchange(self, a)
    class(result_set), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    integer :: k
    do k = 1, size(self%files)
      call self%files(k)%exchange(a)
      call self%delivered(k)%exchange(a)
    end do
    call a%exchange(self%events)
  end subroutine exchange

  !> Closes the files.
  subroutine close_results(self)
    class(result_set), intent(inout) :: self
    call self%files%close()
  end subroutine close_results

  !> Gives the closed files of a pass their own names, those that do not have them yet; ok is false where that cannot be.
  subroutine publish(self, folder, suffix, ok)
    class(result_set), intent(in) :: self
    character(*), intent(in) :: folder
    character(*), intent(in) :: suffix        !! of the pass
    logical, intent(out) :: ok
    integer :: k
    ok = .true.
    do k = 1, size(self%used)
      associate (path => folder//trim(names(self%used(k))))
        if (file_size(path//suffix) >= 0) then
          if (ok) ok = replace_file(path//suffix, path)
        end if
      end associate
    end do
  end subroutine publish

  !> Removes what an earlier run has left in a folder under some suffixes.
  subroutine remove_results(folder, suffixes)
    character(*), intent(in) :: folder
    character(*), intent(in) :: suffixes(:)   !! empty: none
    integer :: k, i
    do k = 1, size(names)
      do i = 1, size(suffixes)
        call remove_own(folder//trim(names(k))//trim(suffixes(i)))
      end do
    end do
  end subroutine remove_results

  !> Whether something could not be written.
  pure logical function failed(self)
    class(result_set), intent(in) :: self
    failed = any(self%files%failed)
  end function failed
end module results
