!> Files that a run must leave as they are: those that it reads, and those that biela has not written.
module kept_files
  use kinds, only: wp
  use errors, only: failure, status_bad_input
  use own_files, only: drawn_files, endings, is_others, result_names
  use posix, only: same_file
  use readable_text, only: lf
  use scene_run, only: run_state
  use whole_file, only: from_input
  implicit none (type, external)
  private
  public :: refuse_losses

contains

  !> Fails where the run would replace or remove such a file of its folder.
  subroutine refuse_losses(run, fail)
    type(run_state), intent(in) :: run
    type(failure), intent(inout) :: fail
    character(:), allocatable :: drawn
    logical :: written(size(result_names))           ! by this run
    integer :: k, i, first, length
    associate (d => run%d, t => run%d%transient, s => run%sys%m%s)
      written = [.true., .true., d%static%present, &
        d%modal%present, d%modal%present .and. size(s%controllers) > 0, d%response%present, &
        d%periodic%present .and. d%periodic%multipliers > 0, d%periodic%present, t%present, t%present, t%motion_step > 0.0_wp, &
        t%present .and. s%stops + s%choices + size(s%friction) > 0, t%checkpoint_interval > 0.0_wp]
    end associate
    do k = 1, size(result_names)
      do i = 1, size(endings)
        call look(trim(result_names(k))//trim(endings(i)), written(k))
      end do
    end do
    call look('.lock', .true.)
    drawn = drawn_files(run%folder)
    first = 1
    do while (first <= len(drawn))
      length = index(drawn(first:), lf) - 1
      call ask(run%folder//'/'//drawn(first:first + length - 1))
      first = first + length + 1
    end do
  contains
    !> Looks at one file.
    subroutine look(name, replaced)
      character(*), intent(in) :: name
      logical, intent(in) :: replaced                !! otherwise removed, if biela has written it
      logical :: others
      others = is_others(run%folder//'/'//name)
      if (run%restart) others = .false.              ! it compares what it goes on with its checkpoint
      if (.not. others .or. replaced) call ask(run%folder//'/'//name)
      if (others .and. replaced) call fail%raise(status_bad_input, 'biela has not written "'//run%folder//'/'//name// &
        '", which this run would replace; expected another folder (--output DIR), or that file under another name')
    end subroutine look

    !> Fails where the run reads a file that would be lost.
    subroutine ask(path)
      character(*), intent(in) :: path
      character(:), allocatable :: inputs
      integer :: first, length
      logical :: exists
      inquire (file=path, exist=exists)
      if (.not. exists) return
      inputs = run%d%inputs
      if (len(run%orbit) > 0) inputs = inputs//run%orbit//'/orbit.txt'//achar(0)
      first = 1
      do while (first <= len(inputs))
        length = index(inputs(first:), achar(0)) - 1
        associate (input => inputs(first:first + length - 1))
          if (same_file(path, input) .or. (input == from_input .and. same_file(path, '/dev/stdin'))) call fail%raise( &
            status_bad_input, 'this run reads "'//input//'", which its results would replace; expected another folder '// &
            '(--output DIR)')
        end associate
        first = first + length + 1
      end do
    end subroutine ask
  end subroutine refuse_losses
end module kept_files
