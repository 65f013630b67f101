!> Which rows there are between bodies (see `border_rows`), where their sides are, and in which order their system is solved. Set-up
!> work only.
module border_row_lists
  use kinds, only: wp
  use force_element, only: inactive
  use measure, only: listed
  use mechanism, only: mechanism_model
  use row_sides, only: side_list
  use ordering, only: reverse_cuthill_mckee
  use triplets, only: triplet_matrix
  implicit none (type, external)
  private
  public :: coupling, row_lists, list_rows, order_rows

  integer, parameter, public :: from_joint = 1, from_element = 2, from_argument = 3, from_friction = 4

  !> A law between displacement rows: forces on two markers that follow from the motion of two markers. These are the same ones, or
  !> those of an element's argument. Of the friction of a stop: its multiplier follows from the motion of the stop's markers.
  type :: coupling
    integer :: kind = 0                      !! from_joint, from_element, from_argument, from_friction
    integer :: item = 0                      !! its number; of friction among those that have it
    integer :: argument = 0                  !! which of the element's
    integer :: n = 0                         !! displacement rows on which forces act
    integer :: row(6) = 0                    !! their numbers among all rows
    integer :: slot(6) = 0                   !! marker component 1 to 6 (a then b) of each
    integer :: nc = 0                        !! displacement rows on which they depend
    integer :: column(6) = 0                 !! their numbers
    integer :: column_slot(6) = 0
    integer :: nr = 0                        !! rate rows on which they depend
    integer :: rate(6) = 0                   !! their numbers
    integer :: rate_slot(6) = 0
  end type coupling

  !> Rows, their sides on bodies (kinds 1 to 3 of displacement rows, 4 and 5 of rate rows) and their order.
  type, extends(side_list) :: row_lists
    integer :: n = 0                         !! all rows
    integer :: nc = 0                        !! constraint rows, the first ones
    type(coupling), allocatable :: laws(:)
    logical, allocatable :: rate_row(:)      !! (n)
    real(wp), allocatable :: lever(:)        !! (n) of angles: a power of two near the scene's size, by which moments are forces [m]
    integer, allocatable :: switched(:)      !! constraint rows that can be off
    integer :: kd = 0                        !! half band width
    integer, allocatable :: position(:)      !! (n)
  end type row_lists

contains

  !> Constraint rows, displacement rows and rate rows with their sides, body by body. Elements that switch have rows while they are
  !> not inactive.
  subroutine list_rows(r, m, states)
    type(row_lists), intent(out) :: r
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: states(:)           !! discrete ones, of the elements that switch
    integer :: k
    call r%begin(3*m%s%rows + 5*size(m%s%markers))
    call r%add_constraints(m%s)
    r%nc = m%s%rows
    r%n = m%s%rows
    r%switched = [(m%s%constraints(k)%item%first, k=m%s%permanent + 1, size(m%s%constraints))]
    call list_laws(r, m, states)
    call r%sort(size(m%s%bodies))
    allocate (r%rate_row(r%n), source=.false.)
    allocate (r%lever(r%n), source=1.0_wp)
    do k = 1, size(r%laws)
      associate (t => r%laws(k))
        r%rate_row(t%rate(1:t%nr)) = .true.
        where (mod(t%slot(1:t%n), 3) == 0) r%lever(t%row(1:t%n)) = scale(1.0_wp, exponent(m%s%size))
        where (mod(t%column_slot(1:t%nc), 3) == 0) r%lever(t%column(1:t%nc)) = scale(1.0_wp, exponent(m%s%size))
      end associate
    end do
  end subroutine list_rows

  !> Curved joints, force elements with a tangent, those that follow an argument, and friction of stops that touch.
  subroutine list_laws(r, m, states)
    type(row_lists), intent(inout) :: r
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: states(:)
    type(coupling), allocatable :: all(:)
    integer, allocatable :: components(:)
    integer, allocatable :: displacement(:, :)       !! (5, markers) row of each component that has one
    integer :: k, j, n
    allocate (all(size(m%s%constraints) + size(m%s%friction) + sum([(1 + m%s%forces(k)%item%motions, k=1, size(m%s%forces))])))
    allocate (displacement(5, size(m%s%markers)), source=0)
    n = 0
    do k = 1, size(m%s%constraints)
      associate (c => m%s%constraints(k)%item)
        components = c%components()
        if (size(components) > 0) call add_law(from_joint, k, [c%ia, c%ib], components, [c%ia, c%ib], components)
      end associate
    end do
    do k = 1, size(m%s%forces)
      associate (f => m%s%forces(k)%item)
        if (f%switch_number > 0) then
          if (states(f%switch_number) == inactive) cycle
        end if
        if (size(f%components()) > 0) then
          call add_law(from_element, k, [f%ia, f%ib], f%components(), [f%ia, f%ib], f%components())
          call add_rates(all(n), [f%ia, f%ib], f%rate_components())
        end if
        do j = 1, f%motions
          associate (x => f%arguments(j)%item)
            call add_law(from_argument, k, [f%ia, f%ib], listed(f%acts), [x%ia, x%ib], listed(x%acts))
            all(n)%argument = j
            if (x%rate) call add_rates(all(n), [x%ia, x%ib], listed(x%acts))
          end associate
        end do
      end associate
    end do
    do k = 1, size(m%s%friction)
      if (m%s%friction(k)%element == 0) cycle
      associate (f => m%s%forces(m%s%friction(k)%element)%item)
        if (states(f%switch_number) == inactive) cycle
        call add_law(from_friction, k, [f%ia, f%ib], [integer ::], [f%ia, f%ib], f%components())
        call add_rates(all(n), [f%ia, f%ib], f%rate_components())
        all(n)%n = 1
        all(n)%row(1) = m%s%friction(k)%row
        all(n)%slot(1) = 1
      end associate
    end do
    r%laws = all(1:n)
  contains
    !> Appends a law: forces on components of two markers (1 to 3 of the first, 4 to 6 of the second) by those of two.
    subroutine add_law(kind, item, on, slots, by, by_slots)
      integer, intent(in) :: kind, item, on(2), slots(:), by(2), by_slots(:)
      n = n + 1
      all(n)%kind = kind
      all(n)%item = item
      call number_rows(on, slots, 0, all(n)%n, all(n)%row, all(n)%slot)
      call number_rows(by, by_slots, 0, all(n)%nc, all(n)%column, all(n)%column_slot)
    end subroutine add_law

    !> Rows of components of two markers.
    subroutine number_rows(markers, slots, kind, count, row, slot)
      integer, intent(in) :: markers(2), slots(:)
      integer, intent(in) :: kind                    !! 0: displacements, 3: rates
      integer, intent(out) :: count, row(6), slot(6)
      integer :: j, i
      count = 0
      row = 0
      slot = 0
      do j = 1, size(slots)
        i = displacement_row(markers(merge(1, 2, slots(j) <= 3)), kind + mod(slots(j) - 1, 3) + 1)
        if (i == 0) cycle
        count = count + 1
        row(count) = i
        slot(count) = slots(j)
      end do
    end subroutine number_rows

    !> Row of a marker's component, made where there is none yet; 0 on the ground.
    integer function displacement_row(marker, component)
      integer, intent(in) :: marker, component
      displacement_row = 0
      if (m%s%markers(marker)%body == 0) return
      if (displacement(component, marker) == 0) then
        r%n = r%n + 1
        displacement(component, marker) = r%n
        call r%add(m%s, marker, r%n, component, [component /= 3, component /= 3, component == 3])
      end if
      displacement_row = displacement(component, marker)
    end function displacement_row

    !> Rate rows; angles' rates are what they are in all axes.
    subroutine add_rates(t, markers, slots)
      type(coupling), intent(inout) :: t
      integer, intent(in) :: markers(2), slots(:)
      call number_rows(markers, pack(slots, mod(slots, 3) > 0), 3, t%nr, t%rate, t%rate_slot)
    end subroutine add_rates
  end subroutine list_laws

  !> Orders the rows: rows meet in bodies, and through laws each displacement row meets all rows of the bodies its law joins.
  subroutine order_rows(r)
    type(row_lists), intent(inout) :: r
    type(triplet_matrix) :: met                ! an entry for each meeting
    integer, allocatable :: order(:), starts(:), body(:)
    integer :: k, b, e, f, i, j
    allocate (r%position(r%n))
    if (r%n == 0) return
    allocate (body(r%n), source=0)             ! of displacement rows
    do b = 1, size(r%first) - 1
      do e = r%first(b), r%first(b + 1) - 1
        body(r%row(e)) = b
        do f = r%first(b), e - 1
          call met%add(r%row(e), r%row(f), 1.0_wp)
        end do
      end do
    end do
    do k = 1, size(r%laws)
      associate (t => r%laws(k))
        do i = 1, t%n
          do j = 1, t%nc
            b = body(t%column(j))
            do e = r%first(b), r%first(b + 1) - 1
              call met%add(t%row(i), r%row(e), 1.0_wp)
            end do
          end do
          do j = 1, t%nr
            call met%add(t%row(i), t%rate(j), 1.0_wp)
          end do
        end do
      end associate
    end do
    call met%add(r%n, r%n, 1.0_wp)             ! a single row meets none but itself
    call reverse_cuthill_mckee(r%n, met%rows(1:met%count), met%cols(1:met%count), order, starts)
    r%position(order) = [(k, k=1, r%n)]
    r%kd = maxval(abs(r%position(met%rows(1:met%count)) - r%position(met%cols(1:met%count))))
  end subroutine order_rows
end module border_row_lists
