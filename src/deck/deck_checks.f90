!> What can be checked only when the whole deck has been read, and the order of the faults.
module deck_checks
  use kinds, only: wp
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
      if (.not. turns(k)) call source%faults%add(d%bodies(k)%at%file, d%bodies(k)%at%line, 'body/'// &
        trim(d%bodies(k)%name), 'inertia=0 and no lump away from the mass centre: its rotation has no inertia, '// &
        'expected inertia > 0')
    end do
  end subroutine check_inertia

  !> The faults by file, in the order in which the files were read, and by line; those of one line as they were found.
  subroutine sort_faults(source, faults)
    type(deck_source), intent(in) :: source
    type(fault_list), intent(inout) :: faults      !! receives the faults
    integer, allocatable :: order(:), file(:), line(:)
    integer :: k
    allocate (file(source%faults%count), line(source%faults%count))
    do k = 1, source%faults%count
      line(k) = source%faults%items(k)%line
      file(k) = file_number(source, source%faults%items(k)%file)
    end do
    call merge_order(file, line, order)
    do k = 1, source%faults%count
      associate (f => source%faults%items(order(k)))
        call faults%add(f%file, f%line, f%subject, f%message)
      end associate
    end do
  end subroutine sort_faults

  !> Number of a file of the deck.
  pure function file_number(source, path) result(number)
    type(deck_source), intent(in) :: source
    character(*), intent(in) :: path
    integer :: number
    do number = source%parts%source_count, 2, -1
      if (source%parts%sources(number)%path == path) return
    end do
    number = 1
  end function file_number

  !> Stable order of pairs of whole numbers, by merging ever longer runs.
  pure subroutine merge_order(major, minor, order)
    integer, intent(in) :: major(:), minor(:)        !! the pairs
    integer, allocatable, intent(out) :: order(:)    !! order(k): position of the k-th smallest
    integer, allocatable :: merged(:)
    integer :: n, run, start, middle, finish, i, j, k
    logical :: left
    n = size(major)
    order = [(k, k=1, n)]
    allocate (merged(n))
    run = 1
    do while (run < n)
      do start = 1, n, 2*run
        middle = min(start + run, n + 1)
        finish = min(start + 2*run, n + 1)
        i = start
        j = middle
        do k = start, finish - 1
          left = j >= finish
          if (.not. left .and. i < middle) left = .not. before(order(j), order(i))
          if (left) then
            merged(k) = order(i)
            i = i + 1
          else
            merged(k) = order(j)
            j = j + 1
          end if
        end do
      end do
      order = merged
      run = 2*run
    end do
  contains
    !> Whether pair a comes before pair b.
    pure function before(a, b) result(yes)
      integer, intent(in) :: a, b
      logical :: yes
      yes = major(a) < major(b) .or. (major(a) == major(b) .and. minor(a) < minor(b))
    end function before
  end subroutine merge_order
end module deck_checks
