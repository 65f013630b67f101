!> The columns of sensors that are quantities of motion: what forces may follow without their value depending on itself.
module deck_columns
  use errors, only: fault_list
  use deck_origin, only: origin
  use deck_records, only: deck, column_record
  use text, only: joined, quoted
  implicit none (type, external)
  private
  public :: motion_suffixes, find_column

contains

  !> What follows the sensor's name in the names of its columns of motion; size 0: it has none.
  pure function motion_suffixes(quantity) result(list)
    character(*), intent(in) :: quantity
    character(4), allocatable :: list(:)
    select case (quantity)
    case ('position', 'velocity')
      list = [character(4) :: '.x', '.y']
    case ('angle', 'angular_velocity', 'distance')
      list = [character(4) :: '']
    case ('deflection')
      list = [character(4) :: '.u', '.v', '.r']
    case ('coordinate')
      list = [character(4) :: '.q', '.qd']
    case ('contact')
      list = [character(4) :: '.gap']
    case ('spring')
      list = [character(4) :: '.d']
    case default
      allocate (list(0))
    end select
  end function motion_suffixes

  !> Finds the column that a group names, or says what is wrong with it.
  subroutine find_column(d, at, variable, column, faults)
    type(deck), intent(in) :: d                     !! its sensors are read
    type(origin), intent(in) :: at                  !! the group
    character(*), intent(in) :: variable            !! that names the column
    type(column_record), intent(inout) :: column
    type(fault_list), intent(inout) :: faults
    character(:), allocatable :: written
    character(4), allocatable :: list(:)
    if (column%sensor == 0) return
    associate (s => d%sensors(column%sensor))
      if (len_trim(s%name) == 0 .or. len_trim(s%quantity) == 0) return     ! it could not be read
      list = motion_suffixes(s%quantity)
      column%number = findloc(list == column%suffix, .true., 1)
      if (column%number > 0) return
      written = variable//'='//quoted(trim(s%name)//trim(column%suffix))//' is no column of motion of that sensor, expected '
      if (size(list) == 0) then
        call at%blame(faults, written//'one of position, velocity, angle, angular_velocity, deflection, coordinate, distance, '// &
          'spring or contact: what quantity='//quoted(trim(s%quantity))//' shows follows from the forces themselves')
      else
        call at%blame(faults, written//quoted(joined(s%name(:len_trim(s%name))//list, ''' or ''')))    ! trim() with a list leaks
      end if
    end associate
  end subroutine find_column
end module deck_columns
