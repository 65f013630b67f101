!> The result files of a transient: history.txt, energy.txt and motion.txt, with their headers (README.md).
module results
  use column_names, only: joined, motion_names
  use kinds, only: wp, ip
  use archive, only: value_archive
  use body, only: body_model
  use mechanism, only: mechanism_model
  use sensors, only: sensor_list, read_sensors
  use energy, only: energies
  use projection, only: violations
  use text_file, only: result_file
  implicit none (type, external)
  private
  public :: result_set, file_header, motion_row

  !> Open result files and what their rows need.
  type :: result_set
    type(result_file) :: history, energy, motion
    real(wp), allocatable :: values(:)        !! columns of the sensors
    real(wp), allocatable :: nodes(:)         !! a row of motion
    logical :: incomplete = .false.           !! an interrupted run's files lack rows that its checkpoint counts on
    real(wp) :: energy_start = 0.0_wp         !! T + V at t = 0 [J]
    real(wp) :: energy_floor = 0.0_wp         !! energies below it mean nothing [J]
    real(wp) :: trusted_energy = 0.0_wp       !! largest energy of the rows whose balance is not lost [J]
    real(wp) :: residual = 0.0_wp             !! last energy residual [J]
    real(wp) :: largest_residual = 0.0_wp     !! [J]
    real(wp) :: largest_energy = 0.0_wp       !! largest of T, |V|, dissipated, |work| so far [J]
    real(wp) :: worst_position = 0.0_wp       !! [m]
    real(wp) :: worst_velocity = 0.0_wp       !! [m/s]
    real(wp) :: last(7) = 0.0_wp              !! last energy row without the time
    integer(ip) :: rows = 0
  contains
    procedure :: open => open_results
    procedure :: resume => resume_results
    procedure :: read_row
    procedure :: balance_lost
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

  !> Reads the sensors and the energies of a state. m holds the evaluation at it.
  subroutine read_row(self, t, m, list, q, v, z, zd, dissipated, work)
    class(result_set), intent(inout) :: self
    real(wp), intent(in) :: t                 !! [s]
    type(mechanism_model), intent(inout) :: m
    type(sensor_list), intent(inout) :: list
    real(wp), intent(in), contiguous :: q(:), v(:), z(:), zd(:)
    real(wp), intent(in) :: dissipated, work  !! [J]
    real(wp) :: kinetic, potential, position, velocity
    call read_sensors(list, m, q, v, z, self%values)
    call energies(m, q, v, z, zd, kinetic, potential)
    call violations(m, t, q, v, position, velocity)
    if (self%rows == 0) self%energy_start = kinetic + potential
    self%residual = kinetic + potential + dissipated - work - self%energy_start
    self%last = [kinetic, potential, dissipated, work, self%residual, position, velocity]
  end subroutine read_row

  !> Whether the energy balance of the row just read says that the solution has nothing to do with the mechanism any more:
  !> the residual is most of the largest energy, and far above all energies that the run had while its balance held.
  function balance_lost(self) result(yes)
    class(result_set), intent(inout) :: self
    logical :: yes
    real(wp), parameter :: most_of = 0.5_wp, far_above = 1.0e3_wp   !! [-]
    real(wp) :: largest
    largest = maxval(abs(self%last(1:4)))
    yes = abs(self%residual) > most_of*largest
    if (.not. yes) self%trusted_energy = max(self%trusted_energy, largest)
    if (yes) yes = abs(self%residual) > far_above*max(self%trusted_energy, self%energy_floor)
  end function balance_lost

  !> Writes the row just read.
  subroutine write_row(self, t)
    class(result_set), intent(inout) :: self
    real(wp), intent(in) :: t                 !! [s]
    call self%history%row(self%values, t)
    call self%energy%row(self%last, t)
    self%largest_residual = max(self%largest_residual, abs(self%residual))
    self%largest_energy = max(self%largest_energy, maxval(abs(self%last(1:4))))
    self%worst_position = max(self%worst_position, self%last(6))
    self%worst_velocity = max(self%worst_velocity, self%last(7))
    self%rows = self%rows + 1
  end subroutine write_row

  !> Writes one row of motion.
  subroutine write_motion(self, t, m, q)
    class(result_set), intent(inout) :: self
    real(wp), intent(in) :: t                 !! [s]
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in), contiguous :: q(:)  !! (nq)
    self%nodes(1) = t
    self%nodes(2:) = motion_row(m, q)
    call self%motion%row(self%nodes)
  end subroutine write_motion

  !> Frames (x, y, angle) and node positions (x, y) of every body [m, rad].
  pure function motion_row(m, q) result(row)
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in), contiguous :: q(:)  !! (nq)
    real(wp) :: row(sum(3 + 2*m%s%bodies%nn)), u(3), x(2), c, s
    integer :: b, k, i, j
    j = 0
    do b = 1, size(m%s%bodies)
      i = m%s%qo(b)
      row(j + 1:j + 3) = q(i + 1:i + 3)
      j = j + 3
      c = cos(q(i + 3))
      s = sin(q(i + 3))
      associate (bo => m%s%bodies(b))
        do k = 1, bo%nn
          u = bo%displacement(k, q(i + 4:i + 3 + bo%nf))
          x = bo%x(:, k) + u(1:2)
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

  !> Saves or restores how far the files are and what the rows have shown.
  subroutine exchange(self, a)
    class(result_set), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    call self%history%exchange(a)
    call self%energy%exchange(a)
    call self%motion%exchange(a)
    call a%exchange(self%energy_start)
    call a%exchange(self%trusted_energy)
    call a%exchange(self%residual)
    call a%exchange(self%largest_residual)
    call a%exchange(self%largest_energy)
    call a%exchange(self%worst_position)
    call a%exchange(self%worst_velocity)
    call a%exchange(self%last)
    call a%exchange(self%rows)
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
