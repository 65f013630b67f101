!> What can be checked only when the whole deck has been read, and the order of the faults.
module deck_checks
  use kinds, only: wp
  use counting_sort, only: sort_by_number
  use errors, only: fault_list
  use deck_input, only: deck_source
  use deck_records, only: deck
  implicit none (type, external)
  private
  public :: check_inertia, sort_faults

contains

  !> A rigid body needs inertia about its mass centre, its own or that of lumps.
  subroutine check_inertia(source, d)
    type(deck_source), intent(inout) :: source
    type(deck), intent(in) :: d
    logical, allocatable :: turns(:)      ! bodies whose rotation has inertia
    integer :: k
    if (source%faults%count > 0) return
    allocate (turns(size(d%bodies)))
    turns = d%bodies%kind /= 'rigid' .or. d%bodies%inertia > 0.0_wp
    do k = 1, size(d%lumps)
      associate (l => d%lumps(k), i => d%lumps(k)%marker%body)
        turns(i) = turns(i) .or. l%inertia > 0.0_wp
        if (l%mass > 0.0_wp) turns(i) = turns(i) .or. any(abs(l%marker%point - d%bodies(i)%com) > 0.0_wp)
      end associate
    end do
    do k = 1, size(d%bodies)
      if (.not. turns(k)) call d%bodies(k)%at%blame(source%faults, 'inertia=0 and no lump away from the '// &
        'mass centre: its rotation has no inertia, expected inertia > 0')
    end do
  end subroutine check_inertia

  !> The faults by file, in the order in which the files were read, and by line; those of one line as they were found.
  subroutine sort_faults(source, faults)
    type(deck_source), intent(in) :: source
    type(fault_list), intent(inout) :: faults      !! receives the faults
    integer, allocatable :: first(:), by_line(:)
    integer :: j, k
    if (source%faults%count == 0) return
    associate (found => source%faults%items(1:source%faults%count))
      call sort_by_number(found%line, maxval(found%line), first, by_line)
    end associate
    do j = 1, source%parts%source_count
      do k = 1, source%faults%count
        associate (f => source%faults%items(by_line(k)))
          if (f%file == source%parts%sources(j)%path) call faults%add(f%file, f%line, f%subject, f%message)
        end associate
      end do
    end do
  end subroutine sort_faults
end module deck_checks
