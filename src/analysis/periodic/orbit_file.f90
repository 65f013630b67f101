!> orbit.txt: the state of a cycle at t = 0, from which the search of another one may start (biela --orbit FOLDER).
module orbit_file
  use kinds, only: wp
  use deck_tables, only: read_columns
  use errors, only: failure, status_bad_input
  use readable_text, only: lf, one_line
  use scene_run, only: run_state, no_output
  use text, only: joined, to_text
  use text_file, only: result_file
  use whole_file, only: read_file
  implicit none (type, external)
  private
  public :: write_orbit, read_orbit

  character(*), parameter :: name = '/orbit.txt'

contains

  !> The line by which a file is known to belong to a scene.
  function heading(run) result(line)
    type(run_state), intent(in) :: run
    character(:), allocatable :: line
    line = '# unknowns: '//to_text(run%sys%m%s%ny)//' of bodies '//one_line(joined(run%sys%m%s%bodies%name, ' '))
  end function heading

  !> Writes the present state.
  subroutine write_orbit(run, period, fail)
    type(run_state), intent(in) :: run
    real(wp), intent(in) :: period            !! [s]
    type(failure), intent(inout) :: fail
    type(result_file) :: file
    integer :: k
    call file%open(run%folder//name)
    call file%head('state of a cycle at t = 0, after its period', run%d%name, run%sys%m%s%title)
    call file%line(heading(run))
    call file%line('# columns: number[-] value[-]')
    call file%row([0.0_wp, period])
    do k = 1, size(run%y)
      call file%row([real(k, wp), run%y(k)])
    end do
    call file%close()
    if (file%failed) call no_output(run, fail)
  end subroutine write_orbit

  !> Reads a state of the same unknowns.
  subroutine read_orbit(run, folder, period, fail)
    type(run_state), intent(inout) :: run     !! run%y receives it
    character(*), intent(in) :: folder
    real(wp), intent(inout) :: period         !! of the cycle; left as it is where the deck gives it [s]
    type(failure), intent(inout) :: fail
    character(:), allocatable :: content, problem
    real(wp), allocatable :: number(:), value(:)   ! [-], [any]
    call read_file(folder//name, content, problem)
    if (len(problem) == 0) then
      call read_columns(content, [1, 2], number, value, problem)
      if (index(content, heading(run)//lf) > 0 .and. size(value) == size(run%y) + 1) then
        if (run%d%periodic%free_period) period = value(1)
        run%y = value(2:)
        return
      end if
    end if
    call fail%raise(status_bad_input, '--orbit: "'//folder//name//'" is not the cycle of a deck with the same bodies and '// &
                    'unknowns; expected the results of such a deck with &periodic')
  end subroutine read_orbit
end module orbit_file
