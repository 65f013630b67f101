!> The result files of a transient: history.txt, energy.txt and motion.txt, with their headers (README.md).
module results
  use column_names, only: motion_names, motion_row
  use kinds, only: wp
  use archive, only: value_archive
  use mechanism, only: mechanism_model
  use sensors, only: sensor_list
  use text, only: joined
  use text_file, only: result_file
  implicit none (type, external)
  private
  public :: result_set

  integer, parameter :: history = 1, energies = 2, motion = 3
  character(*), parameter :: names(3) = [character(12) :: '/history.txt', '/energy.txt', '/motion.txt']

  !> Open result files and what their rows need.
  type :: result_set
    type(result_file), private :: files(3)
    integer, private :: count = 2             !! files that are written: without motion where the deck does not ask for it
    real(wp), allocatable :: values(:)        !! columns of the sensors [unit of each column]
    logical :: incomplete = .false.           !! an interrupted run's files lack rows that its checkpoint counts on
  contains
    procedure :: open => open_results
    procedure :: resume => resume_results
    procedure :: write_row
    procedure :: write_motion
    procedure :: sync => sync_results
    procedure :: exchange
    procedure :: close => close_results
    procedure :: failed
  end type result_set

contains

  !> Opens the files in a folder that exists and writes their headers.
  subroutine open_results(self, folder, deck_name, m, list, with_motion)
    class(result_set), intent(inout) :: self
    character(*), intent(in) :: folder, deck_name
    type(mechanism_model), intent(in) :: m
    type(sensor_list), intent(in) :: list
    logical, intent(in) :: with_motion
    allocate (self%values(list%columns))
    self%count = merge(3, 2, with_motion)
    call begin(history, 'sensors against time', joined([character(80) :: 't[s]', list%names(:list%columns)], ' '))
    call begin(energies, 'energies, their residual and constraint violations against time', 't[s] kinetic[J] potential[J] '// &
               'dissipated[J] work[J] residual[J] position_violation[m] velocity_violation[m/s]'// &
               trim(merge(' stops[J]', '         ', size(m%s%switching) > 0)))
    if (with_motion) call begin(motion, 'body frames and node positions against time', &
                                joined([character(64) :: 't[s]', motion_names(m)], ' '))
  contains
    !> Opens a file and writes its first lines.
    subroutine begin(k, what, columns)
      integer, intent(in) :: k                !! which file
      character(*), intent(in) :: what        !! what it holds
      character(*), intent(in) :: columns     !! names with units, separated by blanks
      call self%files(k)%open(folder//trim(names(k)))
      call self%files(k)%head(what, deck_name, m%s%title)
      call self%files(k)%line('# columns: '//columns)
    end subroutine begin
  end subroutine open_results

  !> Opens the files of an interrupted run and cuts them to the length at its checkpoint, which `exchange` has restored.
  subroutine resume_results(self, folder, list, with_motion)
    class(result_set), intent(inout) :: self
    character(*), intent(in) :: folder
    type(sensor_list), intent(in) :: list
    logical, intent(in) :: with_motion
    integer :: k
    allocate (self%values(list%columns))
    self%count = merge(3, 2, with_motion)
    do k = 1, self%count                      ! all of them before any is cut
      if (.not. self%files(k)%covers(folder//trim(names(k)))) self%incomplete = .true.
    end do
    if (self%incomplete) return
    do k = 1, self%count
      call self%files(k)%resume(folder//trim(names(k)))
    end do
  end subroutine resume_results

  !> Writes a row of sensors, which `values` holds, and one of energies.
  subroutine write_row(self, t, energy)
    class(result_set), intent(inout) :: self
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in) :: energy(:)         !! columns of energy.txt after the time [J], [m], [m/s]
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

  !> Puts everything written so far on the disk.
  subroutine sync_results(self)
    class(result_set), intent(inout) :: self
    integer :: k
    do k = 1, self%count
      call self%files(k)%sync()
    end do
  end subroutine sync_results

  !> Saves or restores how far the files are.
  subroutine exchange(self, a)
    class(result_set), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    integer :: k
    do k = 1, size(self%files)
      call self%files(k)%exchange(a)
    end do
  end subroutine exchange

  !> Closes the files.
  subroutine close_results(self)
    class(result_set), intent(inout) :: self
    integer :: k
    do k = 1, self%count
      call self%files(k)%close()
    end do
  end subroutine close_results

  !> Whether something could not be written.
  pure logical function failed(self)
    class(result_set), intent(in) :: self
    failed = any(self%files%failed)
  end function failed
end module results
