!> What a cycle asks of the histories of loads, drives and controllers: that they repeat in its period, or do not depend on time
!> where that is sought.
module repeating_histories
  use kinds, only: half_digits, wp
  use build_history, only: make_history
  use deck_origin, only: origin
  use deck_records, only: deck
  use errors, only: fault_list
  use history, only: breakpoint, history_model
  use scene_model, only: scene
  use sorting, only: ascending
  use step_counts, only: rounding_of
  use text, only: es_text, to_text
  implicit none (type, external)
  private
  public :: check_repeating

  integer, parameter :: points = 64                !! in a period, at which values are compared
  real(wp), parameter :: golden = (sqrt(5.0_wp) - 1)/2   !! its multiples are even, but no sine is the same at them [-]

contains

  !> Reports each history that does not repeat, and samples that do not fit into the period.
  subroutine check_repeating(d, s, faults)
    type(deck), intent(in) :: d
    type(scene), intent(in) :: s                   !! its force elements are made
    type(fault_list), intent(inout) :: faults
    real(wp) :: samples                            ! [-]
    integer :: k, i
    if (.not. d%periodic%present) return
    do k = 1, size(d%forces)
      associate (f => d%forces(k))
        if (f%stage == 'static' .or. f%history == 0) cycle
        if (s%forces(s%springs + k)%item%motion_factor == 0) then
          call one_history(d, f%history, f%at, .false., faults)
          cycle
        end if
        associate (nodes => s%factors(s%forces(s%springs + k)%item%motion_factor)%nodes)
          do i = 1, size(nodes)
            if (allocated(nodes(i)%history)) call one_history(d, findloc(d%histories%name == nodes(i)%history%name, .true., 1), &
                                                              f%at, .false., faults)
          end do
        end associate
      end associate
    end do
    do k = 1, size(d%drives)
      call one_history(d, d%drives(k)%history, d%drives(k)%at, .not. d%drives(k)%rate, faults)
    end do
    do k = 1, size(d%controllers)
      associate (c => d%controllers(k))
        call one_history(d, c%history, c%at, .false., faults)
        if (.not. c%sample > 0.0_wp) cycle
        samples = d%periodic%period/c%sample
        if (d%periodic%free_period) then
          call c%at%blame(faults, 'sample='//to_text(c%sample)//' s beside a period that is sought, expected period in place '// &
                          'of period_guess, or no sample')
        else if (abs(samples - anint(samples)) > half_digits*samples) then
          call c%at%blame(faults, 'the period of the cycle, '//to_text(d%periodic%period)//' s, has '// &
                          to_text(anint(1000*samples)/1000)//' samples, expected a whole number of them')
        end if
      end associate
    end do
  end subroutine check_repeating

  !> One history, as it is used: where a drive follows it, it may go on by the same amount in each period.
  subroutine one_history(d, number, at, goes_on, faults)
    type(deck), intent(in) :: d
    integer, intent(in) :: number                  !! of its record
    type(origin), intent(in) :: at                 !! of its user
    logical, intent(in) :: goes_on
    type(fault_list), intent(inout) :: faults
    class(history_model), allocatable :: h
    type(breakpoint), allocatable :: breaks(:)
    real(wp), allocatable :: times(:), marks(:)    ! [s]
    real(wp), dimension(-1:2) :: now, later, first, after   ! [unit s, unit, unit/s, unit/s2]
    real(wp) :: largest, allowed                   ! [unit]
    character(:), allocatable :: own               ! its period
    integer :: k, i
    call make_history(d, number, h)
    own = ''
    if (h%period > 0.0_wp) own = '; it repeats in '//to_text(h%period)//' s'
    if (d%histories(number)%frequency > 0.0_wp) own = '; it repeats in '//to_text(1/d%histories(number)%frequency)//' s'
    associate (period => d%periodic%period, sought => d%periodic%free_period)
      breaks = h%breakpoints(period)
      marks = h%marks()                                ! also those after the first period
      marks = marks(ascending(marks))
      times = [[(period*modulo(k*golden, 1.0_wp), k=1, points)], breaks%time + rounding_of(period), marks + rounding_of(marks), &
               [(marks(k) + [golden**2, golden]*(marks(k + 1) - marks(k)), k=1, size(marks) - 1)]]
      times = pack(times, times > 0.0_wp)
      i = merge(1, 0, goes_on)
      call h%evaluate(0.0_wp, .false., first)
      call h%evaluate(period, .false., after)
      largest = 0.0_wp
      do k = 1, size(times)
        call h%evaluate(times(k), .false., now)
        largest = max(largest, abs(now(0)), abs(now(i)))
      end do
      do k = 1, size(times)
        call h%evaluate(times(k), .false., now)
        call h%evaluate(times(k) + period, .false., later)
        allowed = half_digits*largest + 4*rounding_of(times(k) + 2*period)*maxval(abs([now(1:2), later(1:2)]))
        if (sought) then
          if (abs(now(i) - first(i)) <= allowed) cycle
          call at%blame(faults, 'history "'//trim(h%name)//'" depends on time, so that a cycle has its period: expected period '// &
                        'in place of period_guess')
          return
        end if
        if (abs(later(0) - now(0) - merge(after(0) - first(0), 0.0_wp, goes_on)) <= allowed) cycle
        call at%blame(faults, 'history "'//trim(h%name)//'" does not repeat in the period of the cycle, '//to_text(period)// &
                      ' s: it is '//es_text(now(0), 4)//' at t = '//es_text(times(k), 4)//' s and '// &
                      es_text(later(0), 4)//' a period later'//own//', expected a history that repeats')
        return
      end do
    end associate
  end subroutine one_history
end module repeating_histories
