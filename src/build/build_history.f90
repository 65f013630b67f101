!> Histories of the model from their records: the factory of their kinds.
module build_history
  use kinds, only: wp, pi
  use simple_histories, only: cycloid_model, polynomial_model, pulse_model, ramp_model, rise_model, sine_model
  use deck_records, only: deck, history_record
  use history, only: breakpoint, history_box, history_model, merged
  use sequence_history, only: sequence_model
  use sum_history, only: compound_model, product_model, sum_model
  use table_history, only: table_model
  use table_slopes, only: spline_slopes, monotone_slopes, ends_free, ends_rest, ends_natural, ends_periodic
  implicit none (type, external)
  private
  public :: make_history

contains

  !> A history of the model from its record.
  recursive subroutine make_history(d, number, h)
    type(deck), intent(in) :: d
    integer, intent(in) :: number                         !! of the record
    class(history_model), allocatable, intent(out) :: h
    type(polynomial_model), allocatable :: polynomial    ! constructors of allocatable components would leak (gfortran)
    type(pulse_model), allocatable :: pulse
    type(sequence_model), allocatable :: sequence
    associate (r => d%histories(number))
      select case (r%kind)
      case ('polynomial')
        allocate (polynomial)
        polynomial%c = r%coefficients
        call move_alloc(polynomial, h)
      case ('sine')
        h = sine_model(offset=r%offset, amplitude=r%amplitude, omega=2*pi*r%frequency, phase=mod(r%phase, 2*pi))
      case ('ramp', 'cycloid')
        call make_rise(r, h)
      case ('table')
        call make_table(r, h)
      case ('pulse')
        allocate (pulse)
        pulse%value = r%value
        pulse%start = r%start
        pulse%finish = r%finish
        pulse%breaks = both_ends(r, 0)
        pulse%remedy = 'a ramp or a cycloid instead of the pulse'
        call move_alloc(pulse, h)
      case ('sum', 'product')
        call make_sum(d, r, h)
      case default
        allocate (sequence)
        call make_parts(d, r, sequence%parts)
        call sequence%set(r%start, r%durations, r%periodic)
        sequence%remedy = 'parts that begin with the value and slope with which the one before ends'
        call move_alloc(sequence, h)
      end select
      h%name = r%name
      if (.not. allocated(h%remedy)) h%remedy = ''
    end associate
  end subroutine make_history

  !> A rise from one value to another.
  subroutine make_rise(r, h)
    type(history_record), intent(in) :: r
    class(history_model), allocatable, intent(out) :: h
    class(rise_model), allocatable :: rise
    if (r%kind == 'ramp') then
      allocate (ramp_model :: rise)
    else
      allocate (cycloid_model :: rise)
    end if
    rise%low = r%start_value
    rise%high = r%end_value
    rise%start = r%start
    rise%finish = r%finish
    rise%breaks = both_ends(r, 3)
    call move_alloc(rise, h)
  end subroutine make_rise

  !> Breakpoints at the start and at the finish.
  pure function both_ends(r, order) result(list)
    type(history_record), intent(in) :: r
    integer, intent(in) :: order                          !! derivative that jumps
    type(breakpoint) :: list(2)
    list = [breakpoint(r%start, order), breakpoint(r%finish, order)]
  end function both_ends

  !> A table, with the slopes of the curve through its points.
  subroutine make_table(r, h)
    type(history_record), intent(in) :: r
    class(history_model), allocatable, intent(out) :: h
    type(table_model), allocatable :: table
    real(wp) :: w(size(r%time) - 1), chord(size(r%time) - 1), d(size(r%time)), slopes(2, size(r%time) - 1)
    integer :: ends, n
    n = size(r%time)
    w = r%time(2:) - r%time(:n - 1)
    chord = (r%values(2:) - r%values(:n - 1))/w
    ends = ends_free
    if (r%ends == 'rest') ends = ends_rest
    if (r%ends == 'natural') ends = ends_natural
    if (r%periodic) ends = ends_periodic
    allocate (table)
    if (r%interpolation == 'linear') then
      table%remedy = 'interpolation=''pchip'' ends=''rest'''
      slopes = spread(chord, 1, 2)
    else
      table%remedy = 'ends=''rest'', or periodic=.true. where the motion goes on'
      if (r%interpolation == 'spline') call spline_slopes(w, chord, ends, d)
      if (r%interpolation == 'pchip') call monotone_slopes(w, chord, ends, d)
      slopes(1, :) = d(:n - 1)
      slopes(2, :) = d(2:)
    end if
    call table%set(r%time, r%values, slopes, r%periodic)
    call move_alloc(table, h)
  end subroutine make_table

  !> The histories that a sum or a sequence is made of.
  recursive subroutine make_parts(d, r, parts)
    type(deck), intent(in) :: d
    type(history_record), intent(in) :: r
    type(history_box), allocatable, intent(out) :: parts(:)
    integer :: k
    allocate (parts(size(r%parts)))
    do k = 1, size(parts)
      call make_history(d, r%parts(k), parts(k)%item)
    end do
  end subroutine make_parts

  !> A weighted sum, or a product.
  recursive subroutine make_sum(d, r, h)
    type(deck), intent(in) :: d
    type(history_record), intent(in) :: r
    class(history_model), allocatable, intent(out) :: h
    class(compound_model), allocatable :: total
    type(sum_model), allocatable :: weighted
    integer :: k
    if (r%kind == 'product') then
      allocate (product_model :: total)
    else
      allocate (weighted)
      weighted%factors = r%factors
      call move_alloc(weighted, total)
    end if
    call make_parts(d, r, total%parts)
    if (r%kind == 'product') then
      allocate (total%breaks(0))
      do k = 1, size(total%parts)
        if (allocated(total%parts(k)%item%breaks)) total%breaks = merged(total%breaks, total%parts(k)%item%breaks)
      end do
    end if
    call move_alloc(total, h)
  end subroutine make_sum
end module build_history
