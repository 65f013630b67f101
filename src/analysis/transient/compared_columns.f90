!> The columns in which two runs are compared: those of sensors, without any of all frames and nodes.
module compared_columns
  use kinds, only: wp
  use column_names, only: motion_names, motion_row
  use scene_run, only: run_state
  use sensors, only: read_sensors
  implicit none (type, external)
  private
  public :: compared_names, compared_row

contains

  !> Their names.
  function compared_names(run) result(names)
    type(run_state), intent(in) :: run
    character(80), allocatable :: names(:)
    names = run%list%names(1:run%list%columns)
    if (run%list%columns == 0) names = motion_names(run%sys%m)
  end function compared_names

  !> Their values at a state that has just been evaluated.
  subroutine compared_row(run, y, values)
    type(run_state), intent(inout) :: run
    real(wp), intent(in), contiguous :: y(:)  !! (ny) the state [m, rad], [m/s, rad/s], [J]
    real(wp), intent(out), contiguous :: values(:)   !! (columns) [of the column]
    if (run%list%columns > 0) then
      call read_sensors(run%list, run%sys%m, run%sys%ev, y, values)
    else
      values = motion_row(run%sys%m, y(1:run%sys%m%s%nq))
    end if
  end subroutine compared_row
end module compared_columns
