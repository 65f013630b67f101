!> The result files of a transient: history.txt, energy.txt and motion.txt, with their headers (README.md).
module results
  use column_names, only: joined, motion_names
  use kinds, only: wp
  use archive, only: value_archive
  use mechanism, only: mechanism_model
  use sensors, only: sensor_list
  use text_file, only: result_file
  implicit none (type, external)
  private
  public :: result_set, file_header, motion_row

  !> Open result files and what their rows need.
  type :: result_set
    type(result_file) :: history, energy, motion
    real(wp), allocatable :: values(:)        !! columns of the sensors [unit of each column]
    real(wp), allocatable :: nodes(:)         !! a row of motion [m, rad]
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

  !> First lines of a result file.
  subroutine file_header(file, what, deck_name, title, columns)
    type(result_file), intent(inout) :: file
    character(*), intent(in) :: what          !! what the file holds
    character(*), intent(in) :: deck_name, title
    character(*), intent(in) :: columns       !! names with units, separated by blanks
    call file%head(what, deck_name, title)
    call file%line('# columns: '//columns)
  end subroutine file_header

  !> Opens the files in a folder that exists and writes their headers.
  subroutine open_results(self, folder, deck_name, m, list, with_motion)
    class(result_set), intent(inout) :: self
    character(*), intent(in) :: folder, deck_name
    type(mechanism_model), intent(in) :: m
    type(sensor_list), intent(in) :: list
    logical, intent(in) :: with_motion
    call allocate_rows(self, m, list, with_motion)
    call self%history%open(folder//'/history.txt')
    call file_header(self%history, 'sensors against time', deck_name, m%s%title, &
                     't[s]'//joined(list%names(:list%columns)))
    call self%energy%open(folder//'/energy.txt')
    call file_header(self%energy, 'energies, their residual and constraint violations against time', deck_name, &
                     m%s%title, 't[s] kinetic[J] potential[J] dissipated[J] work[J] residual[J] '// &
                     'position_violation[m] velocity_violation[m/s]')
    if (.not. with_motion) return
    call self%motion%open(folder//'/motion.txt')
    call file_header(self%motion, 'body frames and node positions against time', deck_name, m%s%title, &
                     't[s]'//joined(motion_names(m)))
  end subroutine open_results

  !> Opens the files of an interrupted run where its checkpoint left them: exchange has restored how far they are.
  subroutine resume_results(self, folder, m, list, with_motion)
    class(result_set), intent(inout) :: self
    character(*), intent(in) :: folder
    type(mechanism_model), intent(in) :: m
    type(sensor_list), intent(in) :: list
    logical, intent(in) :: with_motion
    call allocate_rows(self, m, list, with_motion)
    self%incomplete = .not. self%history%covers(folder//'/history.txt')
    if (.not. self%incomplete) self%incomplete = .not. self%energy%covers(folder//'/energy.txt')
    if (with_motion .and. .not. self%incomplete) self%incomplete = .not. self%motion%covers(folder//'/motion.txt')
    if (self%incomplete) return               ! before anything is cut
    call self%history%resume(folder//'/history.txt')
    call self%energy%resume(folder//'/energy.txt')
    if (with_motion) call self%motion%resume(folder//'/motion.txt')
  end subroutine resume_results

  !> Room for rows.
  subroutine allocate_rows(self, m, list, with_motion)
    type(result_set), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(sensor_list), intent(in) :: list
    logical, intent(in) :: with_motion
    allocate (self%values(list%columns))
    if (with_motion) allocate (self%nodes(1 + sum(3 + 2*m%s%bodies%nn)))
  end subroutine allocate_rows

  !> Writes a row of sensors, which `values` holds, and one of energies.
  subroutine write_row(self, t, energy)
    class(result_set), intent(inout) :: self
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in) :: energy(:)         !! columns of energy.txt after the time [J], [m], [m/s]
    call self%history%row(self%values, t)
    call self%energy%row(energy, t)
  end subroutine write_row

  !> Writes one row of motion.
  subroutine write_motion(self, t, m, q)
    class(result_set), intent(inout) :: self
    real(wp), intent(in) :: t                 !! [s]
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in), contiguous :: q(:)  !! (nq) [m, rad]
    self%nodes(1) = t
    self%nodes(2:) = motion_row(m, q)
    call self%motion%row(self%nodes)
  end subroutine write_motion

  !> Frames (x, y, angle) and node positions (x, y) of every body [m, rad].
  pure function motion_row(m, q) result(row)
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in), contiguous :: q(:)  !! (nq) [m, rad]
    real(wp) :: row(sum(3 + 2*m%s%bodies%nn)), u(3), x(2), c, s
    integer :: b, k, i, j
    j = 0
    do b = 1, size(m%s%bodies)
      i = m%s%qo(b)
      row(j + 1:j + 3) = q(i + 1:i + 3)
      j = j + 3
      c = cos(q(i + 3))
      s = sin(q(i + 3))
      associate (body => m%s%bodies(b))
        do k = 1, body%nn
          u = body%displacement(k, q(i + 4:i + 3 + body%nf))
          x = body%x(:, k) + u(1:2)
          row(j + 1:j + 2) = q(i + 1:i + 2) + [c*x(1) - s*x(2), s*x(1) + c*x(2)]
          j = j + 2
        end do
      end associate
    end do
  end function motion_row

  !> Puts everything written so far on the disk.
  subroutine sync_results(self)
    class(result_set), intent(inout) :: self
    call self%history%sync()
    call self%energy%sync()
    if (allocated(self%nodes)) call self%motion%sync()
  end subroutine sync_results

  !> Saves or restores how far the files are.
  subroutine exchange(self, a)
    class(result_set), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    call self%history%exchange(a)
    call self%energy%exchange(a)
    call self%motion%exchange(a)
  end subroutine exchange

  !> Closes the files.
  subroutine close_results(self)
    class(result_set), intent(inout) :: self
    call self%history%close()
    call self%energy%close()
    if (allocated(self%nodes)) call self%motion%close()
  end subroutine close_results

  !> Whether something could not be written.
  pure function failed(self) result(yes)
    class(result_set), intent(in) :: self
    logical :: yes
    yes = self%history%failed .or. self%energy%failed .or. self%motion%failed
  end function failed
end module results
