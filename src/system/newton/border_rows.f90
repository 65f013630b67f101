!> The rows that bodies meet in when a step is solved implicitly: constraint rows, displacement rows (displacements of markers on
!> which force elements and curved joints act by a linear law) and rate rows (what turning adds to the rates that dampers
!> see). With d the rows' displacements under the residual alone and S = J T^-1 J^T the rows' compliance:
!>
!>   constraint rows    S y = d + Phi
!>   displacement rows  y_i = sum_j K_ij (d - S y)_j + G_ij y_j
!>   rate rows          y_j = (d - S y)_j
!>   rows that are off  y = sum_k slope_k y_k + gap, of a stop's friction  sum_j K_j (d - S y)_j + G_j y_j + gap
!>
!> A row that is off holds nothing: its multiplier follows those of its joint's other rows or the force of its stop (friction), or
!> is zero.
!> One banded system in a good ordering of the joint graph (theory.md, section 7).
module border_rows
  use kinds, only: wp, number
  use band_lu, only: factor_lu, solve_lu
  use border_row_lists, only: row_lists
  implicit none (type, external)
  private
  public :: row_system, set_up_rows, factor_rows, regularise_weak_rows, solve_rows, solve_gaps

  real(wp), parameter, public :: least_shift = 3.0e-14_wp  !! on the diagonal of constraint rows: uneven masses allow no more [-]
  real(wp), parameter, public :: light_shift = 1.0e-11_wp   !! the same where rows are redundant everywhere [-]
  real(wp), parameter, public :: strong_shift = 1.0e-7_wp  !! the same near a singular position [-]
  real(wp), parameter, public :: stage_shift = 1.0e-5_wp   !! the same for several stages, which see the rates of rows alone [-]
  real(wp), parameter, public :: weak_pivot = 1.0e-5_wp   !! pivot of rows that count as nearly dependent [-]

  !> The equations between rows and their factor.
  type :: row_equations
    real(number), allocatable :: e(:, :)       !! (-kd:kd, n) equations by rows [m/N, -]
    real(number), allocatable :: lu(:, :)      !! (3 kd + 1, n) LAPACK band storage [-]
    real(wp), allocatable :: scale(:)        !! (n) of the equations, by position [N/m, -]
    real(wp), allocatable :: lever(:)        !! (n) of the unknowns, by position: all are solved for as forces [m, m/(N s), -]
    integer, allocatable :: pivots(:)        !! (n)
    integer :: upper = 0                     !! diagonals of the factor above the main one
    real(number), allocatable :: x(:, :)     !! (n, 3) right-hand sides, by position [-]
  end type row_equations

  !> A row that can be off.
  type, public :: open_row
    integer :: row = 0
    logical :: off = .false.
    integer :: reaction(2) = 0               !! rows whose multipliers its own one follows; 0: none
    real(wp) :: slope(2) = 0.0_wp            !! its derivative by theirs [-]
  end type open_row

  !> Rows, and the system between them. The force of a law is force_i = sum_j k_ij u_j + g_ij y_j.
  type, extends(row_lists) :: row_system
    real(number), allocatable :: marker_row(:, :), marker_column(:, :)   !! (3, sides) row, column on the marker, body axes [-, m]
    real(number), allocatable :: frame_row(:, :), frame_column(:, :)   !! (3, sides) the same on the condensed frame [-, m]
    real(number), allocatable :: solved_column(:, :)   !! (3, sides) inverse of the condensed frame times frame_column [m/N, rad/N]
    real(number), allocatable :: k(:, :, :)  !! (6, 6, laws) on displacements, the step's rates included [N/m, N, N m]
    real(wp), allocatable :: g(:, :, :)      !! (6, 6, laws) on the rates that turning adds [N s/m]
    real(number), allocatable :: s(:, :)       !! (-kd:kd, n) compliance by rows: s(j-i, i) [m/N, ...]
    type(row_equations) :: system
    real(number), allocatable :: d(:)        !! (n) rows of the correction without rows [m]
    real(number), allocatable :: y(:)        !! (n) solution, by row [N]
    real(number), allocatable :: closing(:, :)   !! (n, 3) the same for gaps alone [N]
    type(open_row), allocatable :: open(:)   !! rows that can be off
    real(number) :: unit = 1.0_wp            !! makes newtons of the method's gaps of rows that are off [-, 1/s]
    real(wp) :: held = 0.0_wp                !! shift that holds what rows leave open of multipliers; 0: none [-]
    real(wp) :: least_pivot = 1.0_wp             !! least pivot of the last factorisation, rows being scaled to 1 [-]
    logical :: bad = .false.                 !! the last factorisation met a zero pivot
  end type row_system

contains

  !> Work space.
  subroutine set_up_rows(r, lists)
    type(row_system), intent(out) :: r
    type(row_lists), intent(in) :: lists
    r%row_lists = lists
    associate (n => r%n, kd => r%kd, sides => size(r%row), laws => size(r%laws))
      allocate (r%marker_row(3, sides), r%marker_column(3, sides), r%frame_row(3, sides), r%frame_column(3, sides), &
                r%solved_column(3, sides), r%k(6, 6, laws), r%s(-kd:kd, n), r%d(n), r%y(n), r%closing(n, 3))
      allocate (r%g(6, 6, laws), source=0.0_wp)
      allocate (r%system%e(-kd:kd, n), r%system%lu(3*kd + 1, n), r%system%scale(n), r%system%lever(n), r%system%x(n, 3), &
                r%system%pivots(n))
      allocate (r%open(size(r%switched)))
    end associate
    r%open%row = r%switched
    r%system%lever(r%position) = r%lever
  end subroutine set_up_rows

  !> The equations between rows from their compliance, and their LU factor. The shift keeps dependent rows apart.
  subroutine factor_rows(r, shift)
    type(row_system), intent(inout) :: r
    real(wp), intent(in) :: shift            !! added to the diagonal of constraint rows, relative [-]
    integer :: i, j, k, p, o, n
    real(number) :: x
    real(wp) :: largest
    n = r%n
    r%bad = .false.
    if (n == 0) return
    do i = 1, r%nc
      p = r%position(i)
      r%system%e(:, p) = r%s(:, p)
      r%system%e(0, p) = r%system%e(0, p)*(1 + shift)
    end do
    do i = r%nc + 1, n
      p = r%position(i)
      r%system%e(:, p) = 0.0_wp
      if (r%rate_row(i)) r%system%e(:, p) = r%s(:, p)
      if (r%rate_row(i)) r%system%lever(p) = huge(1.0_wp)
      r%system%e(0, p) = r%system%e(0, p) + 1.0_wp
    end do
    do i = 1, size(r%open)
      if (r%open(i)%off) call leave_open(r, r%open(i))
    end do
    do k = 1, size(r%laws)
      associate (t => r%laws(k))
        do i = 1, t%n
          p = r%position(t%row(i))
          do j = 1, t%nc
            o = r%position(t%column(j)) - p
            x = r%k(t%slot(i), t%column_slot(j), k)
            if (abs(x) > 0.0_wp) call add_row(r%kd, o, x, r%s(:, p + o), r%system%e(:, p))
          end do
          do j = 1, t%nr
            o = r%position(t%rate(j)) - p
            r%system%e(o, p) = r%system%e(o, p) - r%g(t%slot(i), t%rate_slot(j), k)
            x = r%g(t%slot(i), t%rate_slot(j), k)/r%system%lever(p)
            if (abs(x) > 0.0_wp) r%system%lever(p + o) = min(r%system%lever(p + o), scale(1.0_wp, -exponent(abs(x))))
          end do
        end do
      end associate
    end do
    r%system%lu = 0.0_wp
    where (.not. r%system%lever < huge(1.0_wp)) r%system%lever = 1.0_wp
    do i = 1, n
      largest = 0.0_wp
      do o = max(-r%kd, 1 - i), min(r%kd, n - i)
        largest = max(largest, abs(r%system%e(o, i))*r%system%lever(i + o))
      end do
      r%bad = r%bad .or. .not. (largest > 0.0_wp .and. largest < huge(1.0_wp))
      if (r%bad) return
      r%system%scale(i) = 1.0_wp/largest
      do o = max(-r%kd, 1 - i), min(r%kd, n - i)
        r%system%lu(2*r%kd + 1 - o, i + o) = r%system%e(o, i)*(r%system%scale(i)*r%system%lever(i + o))
      end do
    end do
    call factor_lu(n, r%kd, r%system%lu, r%system%pivots, r%system%upper, r%bad)
    r%least_pivot = minval(abs(r%system%lu(2*r%kd + 1, :)))
  end subroutine factor_rows

  !> The equation of a row that is off. The rows that its multiplier follows are of the same joint: they stand within the band.
  subroutine leave_open(r, x)
    type(row_system), intent(inout) :: r
    type(open_row), intent(in) :: x
    integer :: k, p
    p = r%position(x%row)
    r%system%e(:, p) = 0.0_wp
    r%system%e(0, p) = 1.0_wp
    do k = 1, 2
      if (x%reaction(k) > 0) r%system%e(r%position(x%reaction(k)) - p, p) = -x%slope(k)
    end do
  end subroutine leave_open

  !> Factors again with a stronger shift where rows are nearly dependent: in the directions in which these act, a solution would
  !> be amplified rounding.
  subroutine regularise_weak_rows(r)
    type(row_system), intent(inout) :: r
    if (r%bad .or. r%least_pivot > weak_pivot) return
    call factor_rows(r, strong_shift)
  end subroutine regularise_weak_rows

  !> e <- e + x s, s the compliance of the row that stands o positions behind.
  pure subroutine add_row(kd, o, x, s, e)
    integer, intent(in) :: kd, o
    real(number), intent(in) :: x, s(-kd:kd)   !! [N/m], [m/N]
    real(number), intent(inout) :: e(-kd:kd)   !! [-]
    integer :: c
    do c = max(-kd, -kd - o), min(kd, kd - o)
      e(c + o) = e(c + o) + x*s(c)
    end do
  end subroutine add_row

  !> y of all rows from their displacements d under the residual alone and the constraints' values; of rows that are off, from the
  !> errors of their multipliers.
  subroutine solve_rows(r, phi, lambda)
    type(row_system), intent(inout) :: r
    real(number), intent(in) :: phi(:)       !! (nc) [m], [N]
    real(number), intent(in), optional :: lambda(:)   !! (nc) multipliers over their held values [N]
    integer :: i, j, k, p
    if (r%n == 0) return
    do i = 1, r%nc
      r%system%x(r%position(i), 1) = r%d(i) + phi(i)
    end do
    if (present(lambda) .and. r%held > 0.0_wp) then
      do i = 1, r%nc
        p = r%position(i)
        r%system%x(p, 1) = r%system%x(p, 1) - r%held*r%s(0, p)*lambda(i)
      end do
    end if
    do i = r%nc + 1, r%n
      r%system%x(r%position(i), 1) = r%d(i)
      if (.not. r%rate_row(i)) r%system%x(r%position(i), 1) = 0.0_wp
    end do
    do k = 1, size(r%open)
      i = r%open(k)%row
      if (r%open(k)%off) r%system%x(r%position(i), 1) = r%unit*phi(i)
    end do
    do k = 1, size(r%laws)
      associate (t => r%laws(k))
        do i = 1, t%n
          p = r%position(t%row(i))
          do j = 1, t%nc
            r%system%x(p, 1) = r%system%x(p, 1) + r%k(t%slot(i), t%column_slot(j), k)*r%d(t%column(j))
          end do
        end do
      end associate
    end do
    call substitute(r, 1)
    do i = 1, r%n
      r%y(i) = r%system%x(r%position(i), 1)
    end do
  end subroutine solve_rows

  !> The same without a residual, for several columns of gaps: r%closing.
  subroutine solve_gaps(r, gap)
    type(row_system), intent(inout) :: r
    real(number), intent(in) :: gap(:, :)    !! (nc, columns) [m] or its derivatives
    integer :: i, columns
    if (r%n == 0) return
    columns = size(gap, 2)
    do i = 1, r%nc
      r%system%x(r%position(i), 1:columns) = gap(i, :)
    end do
    do i = r%nc + 1, r%n
      r%system%x(r%position(i), 1:columns) = 0.0_wp
    end do
    call substitute(r, columns)
    do i = 1, r%n
      r%closing(i, 1:columns) = r%system%x(r%position(i), 1:columns)
    end do
  end subroutine solve_gaps

  !> Solves for the first right-hand sides.
  subroutine substitute(r, columns)
    type(row_system), intent(inout) :: r
    integer, intent(in) :: columns
    integer :: k
    do k = 1, columns
      r%system%x(:, k) = r%system%x(:, k)*r%system%scale
    end do
    call solve_lu(r%n, r%kd, r%system%lu, r%system%pivots, r%system%upper, columns, r%system%x)
    do k = 1, columns
      r%system%x(:, k) = r%system%x(:, k)*r%system%lever
    end do
  end subroutine substitute
end module border_rows
