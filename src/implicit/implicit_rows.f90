!> The rows that bodies meet in when a step is solved implicitly: constraint rows, soft rows (displacements of places on
!> which springs, loads and curved joints act by a linear law) and rate rows (what turning adds to the rates that dampers
!> see). With d the rows' displacements under the residual alone and S = J T^-1 J^T the rows' compliance:
!>
!>   constraint rows  S y = d + Phi         soft rows  y_i = sum_j K_ij (d - S y)_j + G_ij y_j         rate rows  y_j = (d - S y)_j
!>
!> One banded system in a good ordering of the joint graph (theory.md, section 7).
module implicit_rows
  use kinds, only: wp
  use lapack, only: dgbtrf, dgbtrs
  use load, only: load_force, load_about, axes_section
  use mechanism, only: mechanism_model
  use ordering, only: reverse_cuthill_mckee
  implicit none (type, external)
  private
  public :: coupling, row_system, list_rows, order_rows, factor_rows, solve_rows

  integer, parameter, public :: from_joint = 1, from_spring = 2, from_load = 3
  real(wp), parameter :: shift = 1.0e-11_wp  !! added to the diagonal of constraint rows, relative: dependent rows [-]

  !> A law between soft rows: force_i = sum_j k_ij u_j + g_ij y_j.
  type :: coupling
    integer :: kind = 0                      !! from_joint, from_spring, from_load
    integer :: item = 0                      !! its number
    integer :: n = 0                         !! soft rows
    integer :: row(6) = 0                    !! their numbers among all rows
    integer :: slot(6) = 0                   !! place component 1 to 6 (a then b) of each
    integer :: nr = 0                        !! rate rows
    integer :: rate(4) = 0                   !! their numbers
    integer :: rate_slot(4) = 0
    real(wp) :: k(6, 6) = 0.0_wp             !! on displacements, the step's rates included [N/m, N, N m]
    real(wp) :: g(6, 6) = 0.0_wp             !! on the rates that turning adds [N s/m]
  end type coupling

  !> Rows, their ends on bodies, and the system between them.
  type :: row_system
    integer :: n = 0                         !! all rows
    integer :: nc = 0                        !! constraint rows, the first ones
    integer, allocatable :: first(:)         !! (nb+1) ends of each body
    integer, allocatable :: row(:)           !! (ends) row
    integer, allocatable :: place(:)         !! (ends) place
    integer, allocatable :: local(:)         !! (ends) the place's number on its flexible body
    integer, allocatable :: kind(:)          !! (ends) -1, -2: side a, b of a constraint; 1 to 3 displacement; 4, 5 rate
    logical, allocatable :: acts(:, :)       !! (3, ends) components of the place that it may see
    real(wp), allocatable :: wr(:, :), wc(:, :)   !! (3, ends) row and column on the place, body axes
    real(wp), allocatable :: jr(:, :), jc(:, :)   !! (3, ends) the same on the condensed frame
    real(wp), allocatable :: mj(:, :)        !! (3, ends) inverse of the condensed frame times jc
    type(coupling), allocatable :: laws(:)
    logical, allocatable :: rate_row(:)      !! (n)
    integer :: kd = 0                        !! half band width
    integer, allocatable :: position(:)      !! (n)
    real(wp), allocatable :: s(:, :)         !! (-kd:kd, n) compliance by rows: s(j-i, i)
    real(wp), allocatable :: e(:, :)         !! (-kd:kd, n) equations by rows
    real(wp), allocatable :: lu(:, :)        !! (3 kd + 1, n) LAPACK band storage
    real(wp), allocatable :: scale(:)        !! (n) of the equations, by position
    integer, allocatable :: pivots(:)        !! (n)
    real(wp), allocatable :: d(:)            !! (n) rows of the correction without rows
    real(wp), allocatable :: y(:)            !! (n) solution, by row
    real(wp), allocatable :: x(:)            !! (n) right-hand side, by position
    logical :: bad = .false.                 !! the last factorisation met a zero pivot
  end type row_system

  !> Ends while they are collected.
  type :: end_list
    integer :: n = 0
    integer, allocatable :: body(:), row(:), place(:), kind(:)
    integer, allocatable :: soft(:, :)       !! (5, places) row of each component that has one
  end type end_list

contains

  !> Constraint rows, soft rows and rate rows with their ends, body by body.
  subroutine list_rows(r, m)
    type(row_system), intent(inout) :: r
    type(mechanism_model), intent(in) :: m
    type(end_list) :: list
    integer :: most, k, i, side
    most = 2*m%s%rows + 10*(size(m%s%springs) + size(m%s%constraints) + size(m%s%loads))
    allocate (list%body(most), list%row(most), list%place(most), list%kind(most))
    allocate (list%soft(5, size(m%s%places)), source=0)
    r%nc = m%s%rows
    r%n = m%s%rows
    do k = 1, size(m%s%constraints)
      associate (c => m%s%constraints(k)%item)
        do i = c%first, c%first + c%rows - 1
          do side = 1, 2
            call add_end(list, m, merge(c%ia, c%ib, side == 1), i, -side)
          end do
        end do
      end associate
    end do
    call list_laws(r, m, list)
    call sort_ends(r, m, list)
    allocate (r%rate_row(r%n), source=.false.)
    do k = 1, size(r%laws)
      r%rate_row(r%laws(k)%rate(1:r%laws(k)%nr)) = .true.
    end do
  end subroutine list_rows

  !> Adds one end, unless its place is on the ground.
  subroutine add_end(list, m, place, row, kind)
    type(end_list), intent(inout) :: list
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: place, row, kind
    if (m%s%places(place)%body == 0) return
    list%n = list%n + 1
    list%body(list%n) = m%s%places(place)%body
    list%row(list%n) = row
    list%place(list%n) = place
    list%kind(list%n) = kind
  end subroutine add_end

  !> Springs, curved joints and loads that need rows.
  subroutine list_laws(r, m, list)
    type(row_system), intent(inout) :: r
    type(mechanism_model), intent(in) :: m
    type(end_list), intent(inout) :: list
    type(coupling), allocatable :: all(:)
    integer :: k, n
    allocate (all(size(m%s%constraints) + size(m%s%springs) + size(m%s%loads)))
    n = 0
    do k = 1, size(m%s%constraints)
      associate (c => m%s%constraints(k)%item)
        if (.not. c%curved()) cycle
        if (c%turns_b()) then
          if (m%s%places(c%ib)%body == 0) cycle        ! a line fixed to the ground is straight
          all(n + 1) = new_law(from_joint, k, c%ia, c%ib, [1, 2, 4, 5, 6])
        else
          all(n + 1) = new_law(from_joint, k, c%ia, c%ib, [1, 2, 4, 5])
        end if
      end associate
    end do
    do k = 1, size(m%s%springs)
      associate (s => m%s%springs(k))
        if (s%torsional) all(n + 1) = new_law(from_spring, k, s%ia, s%ib, [3, 6])
        if (.not. s%torsional) all(n + 1) = new_law(from_spring, k, s%ia, s%ib, [1, 2, 4, 5])
        if (.not. s%torsional .and. s%damping > 0.0_wp) call add_rates(all(n), s%ia, s%ib)
      end associate
    end do
    do k = 1, size(m%s%loads)
      associate (l => m%s%loads(k))
        if (l%kind == load_about) all(n + 1) = new_law(from_load, k, l%place, l%place, [1, 2])
        if (l%kind == load_force .and. l%axes == axes_section) all(n + 1) = new_law(from_load, k, l%place, l%place, [1, 2, 3])
      end associate
    end do
    r%laws = all(1:n)
  contains
    !> A law between components of places a (1 to 3) and b (4 to 6); counts it.
    function new_law(kind, item, ia, ib, slots) result(t)
      integer, intent(in) :: kind, item, ia, ib, slots(:)
      type(coupling) :: t
      integer :: j, i
      t%kind = kind
      t%item = item
      n = n + 1
      do j = 1, size(slots)
        i = soft_row(merge(ia, ib, slots(j) <= 3), mod(slots(j) - 1, 3) + 1)
        if (i == 0) cycle
        t%n = t%n + 1
        t%row(t%n) = i
        t%slot(t%n) = slots(j)
      end do
    end function new_law

    !> Row of a place's component, made where there is none yet; 0 on the ground.
    integer function soft_row(place, component)
      integer, intent(in) :: place, component
      soft_row = 0
      if (m%s%places(place)%body == 0) return
      if (list%soft(component, place) == 0) then
        r%n = r%n + 1
        list%soft(component, place) = r%n
        call add_end(list, m, place, r%n, component)
      end if
      soft_row = list%soft(component, place)
    end function soft_row

    !> Rate rows of a damper.
    subroutine add_rates(t, ia, ib)
      type(coupling), intent(inout) :: t
      integer, intent(in) :: ia, ib
      integer :: c, i, slot
      do slot = 1, 5
        if (slot == 3) cycle
        c = mod(slot - 1, 3) + 1
        i = soft_row(merge(ia, ib, slot <= 3), 3 + c)
        if (i == 0) cycle
        t%nr = t%nr + 1
        t%rate(t%nr) = i
        t%rate_slot(t%nr) = slot
      end do
    end subroutine add_rates
  end subroutine list_laws

  !> Sorts the ends by body.
  subroutine sort_ends(r, m, list)
    type(row_system), intent(inout) :: r
    type(mechanism_model), intent(in) :: m
    type(end_list), intent(in) :: list
    integer, allocatable :: fill(:)
    logical, allocatable :: moves(:), turns_a(:), turns_b(:)
    integer :: nb, n, k, i
    nb = size(m%s%bodies)
    n = list%n
    allocate (r%first(nb + 1), r%row(n), r%place(n), r%kind(n), r%local(n), source=0)
    allocate (r%wr(3, n), r%wc(3, n), r%jr(3, n), r%jc(3, n), r%mj(3, n), source=0.0_wp)
    allocate (r%acts(3, n), source=.false.)
    allocate (moves(r%nc), turns_a(r%nc), turns_b(r%nc))
    do k = 1, size(m%s%constraints)
      associate (c => m%s%constraints(k)%item)
        moves(c%first:c%first + c%rows - 1) = c%moves()
        turns_a(c%first:c%first + c%rows - 1) = c%turns_a()
        turns_b(c%first:c%first + c%rows - 1) = c%turns_b()
      end associate
    end do
    do k = 1, n
      r%first(list%body(k) + 1) = r%first(list%body(k) + 1) + 1
    end do
    r%first(1) = 1
    do k = 1, nb
      r%first(k + 1) = r%first(k + 1) + r%first(k)
    end do
    fill = r%first(1:nb)
    do k = 1, n
      i = fill(list%body(k))
      fill(list%body(k)) = i + 1
      r%row(i) = list%row(k)
      r%place(i) = list%place(k)
      r%kind(i) = list%kind(k)
      select case (r%kind(i))
      case (-1)
        r%acts(:, i) = [moves(r%row(i)), moves(r%row(i)), turns_a(r%row(i))]
      case (-2)
        r%acts(:, i) = [moves(r%row(i)), moves(r%row(i)), turns_b(r%row(i))]
      case (3)
        r%acts(3, i) = .true.
      case default
        r%acts(1:2, i) = .true.
      end select
    end do
  end subroutine sort_ends

  !> Orders the rows: rows meet in bodies, and through laws each soft row meets all rows of the bodies its law joins.
  subroutine order_rows(r)
    type(row_system), intent(inout) :: r
    integer, allocatable :: rows(:), cols(:), order(:), starts(:), body(:)
    integer :: k, n, b, e, f, i, j, pass
    allocate (body(r%n), source=0)          ! of soft rows
    do b = 1, size(r%first) - 1
      do e = r%first(b), r%first(b + 1) - 1
        body(r%row(e)) = b
      end do
    end do
    do pass = 1, 2
      n = 0
      do b = 1, size(r%first) - 1
        do e = r%first(b), r%first(b + 1) - 1
          do f = r%first(b), e - 1
            call pair(r%row(e), r%row(f))
          end do
        end do
      end do
      do k = 1, size(r%laws)
        associate (t => r%laws(k))
          do i = 1, t%n
            do j = 1, t%n
              b = body(t%row(j))
              do e = r%first(b), r%first(b + 1) - 1
                call pair(t%row(i), r%row(e))
              end do
            end do
            do j = 1, t%nr
              call pair(t%row(i), t%rate(j))
            end do
          end do
        end associate
      end do
      if (pass == 1) allocate (rows(n), cols(n))
    end do
    call reverse_cuthill_mckee(r%n, rows, cols, order, starts)
    allocate (r%position(r%n), r%pivots(r%n))
    r%position(order) = [(k, k=1, r%n)]
    r%kd = 0
    do k = 1, n
      r%kd = max(r%kd, abs(r%position(rows(k)) - r%position(cols(k))))
    end do
    allocate (r%s(-r%kd:r%kd, r%n), r%e(-r%kd:r%kd, r%n), r%lu(3*r%kd + 1, r%n), r%scale(r%n), r%d(r%n), r%y(r%n), &
              r%x(r%n), source=0.0_wp)
  contains
    !> Counts a pair, and in the second pass notes it.
    subroutine pair(x, y)
      integer, intent(in) :: x, y
      if (x == y) return
      n = n + 1
      if (pass == 1) return
      rows(n) = x
      cols(n) = y
    end subroutine pair
  end subroutine order_rows

  !> The equations between rows from their compliance, and their LU factor.
  subroutine factor_rows(r)
    type(row_system), intent(inout) :: r
    integer :: i, j, k, p, o, n, info
    real(wp) :: x
    n = r%n
    r%bad = .false.
    if (n == 0) return
    do i = 1, r%nc
      p = r%position(i)
      r%e(:, p) = r%s(:, p)
      r%e(0, p) = r%e(0, p)*(1 + shift)
    end do
    do i = r%nc + 1, n
      p = r%position(i)
      r%e(:, p) = 0.0_wp
      if (r%rate_row(i)) r%e(:, p) = r%s(:, p)
      r%e(0, p) = r%e(0, p) + 1.0_wp
    end do
    do k = 1, size(r%laws)
      associate (t => r%laws(k))
        do i = 1, t%n
          p = r%position(t%row(i))
          do j = 1, t%n
            o = r%position(t%row(j)) - p
            x = t%k(t%slot(i), t%slot(j))
            if (abs(x) > 0.0_wp) call add_row(r%kd, o, x, r%s(:, p + o), r%e(:, p))
          end do
          do j = 1, t%nr
            o = r%position(t%rate(j)) - p
            r%e(o, p) = r%e(o, p) - t%g(t%slot(i), t%rate_slot(j))
          end do
        end do
      end associate
    end do
    r%lu = 0.0_wp
    do i = 1, n
      x = maxval(abs(r%e(:, i)))
      r%bad = r%bad .or. .not. (x > 0.0_wp .and. x < huge(1.0_wp))
      if (r%bad) return
      r%scale(i) = 1.0_wp/x
      do o = max(-r%kd, 1 - i), min(r%kd, n - i)
        r%lu(2*r%kd + 1 - o, i + o) = r%e(o, i)*r%scale(i)
      end do
    end do
    call dgbtrf(n, n, r%kd, r%kd, r%lu, 3*r%kd + 1, r%pivots, info)
    r%bad = info /= 0
  end subroutine factor_rows

  !> e <- e + x s, s the compliance of the row o places further on.
  pure subroutine add_row(kd, o, x, s, e)
    integer, intent(in) :: kd, o
    real(wp), intent(in) :: x, s(-kd:kd)
    real(wp), intent(inout) :: e(-kd:kd)
    integer :: c
    do c = max(-kd, -kd - o), min(kd, kd - o)
      e(c + o) = e(c + o) + x*s(c)
    end do
  end subroutine add_row

  !> y of all rows from their displacements d under the residual alone and the constraints' values.
  subroutine solve_rows(r, phi)
    type(row_system), intent(inout) :: r
    real(wp), intent(in) :: phi(:)           !! (nc) [m]
    integer :: i, j, k, p, info
    if (r%n == 0) return
    do i = 1, r%nc
      r%x(r%position(i)) = r%d(i) + phi(i)
    end do
    do i = r%nc + 1, r%n
      r%x(r%position(i)) = merge(r%d(i), 0.0_wp, r%rate_row(i))
    end do
    do k = 1, size(r%laws)
      associate (t => r%laws(k))
        do i = 1, t%n
          p = r%position(t%row(i))
          do j = 1, t%n
            r%x(p) = r%x(p) + t%k(t%slot(i), t%slot(j))*r%d(t%row(j))
          end do
        end do
      end associate
    end do
    do i = 1, r%n
      r%x(i) = r%x(i)*r%scale(i)
    end do
    call dgbtrs('N', r%n, r%kd, r%kd, 1, r%lu, 3*r%kd + 1, r%pivots, r%x, r%n, info)
    do i = 1, r%n
      r%y(i) = r%x(r%position(i))
    end do
  end subroutine solve_rows
end module implicit_rows
