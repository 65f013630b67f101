!> Multipliers of joints that slip: friction follows from the same multipliers that it changes (theory.md, section 13),
!>
!>   S_nn lambda = b - S_nt sigma c(lambda)                                 (A)
!>
!> with the rows n that hold and the rows t that slip. It is iterated with the factor at hand, from the friction of the last accepted
!> state; where that contracts slowly, Newton's method takes over, whose matrix has the same band.
module slipping
  use kinds, only: wp
  use band_lu, only: factor_lu, solve_lu
  use evaluation_results, only: evaluation
  use friction_law, only: row_slips, slip_forces
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: keep_friction, pressing, slip_multipliers

  integer, parameter :: most_passes = 60
  real(wp), parameter :: slow = 0.3_wp             !! contraction from which Newton's method takes less work [-]
  real(wp), parameter :: settled = 1.0e-14_wp      !! change of the friction in the last pass, of its size [-]

contains

  !> Multipliers of all rows from the right-hand side that they hold: those of rows that are off are the friction. Where no force
  !> meets (A), the evaluation is broken.
  subroutine slip_multipliers(m, ev)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    real(wp), dimension(size(ev%lambda)) :: x, f     ! [N]
    real(wp) :: change, last, strongest
    integer :: pass
    associate (b => ev%rows%acceleration, laws => m%s%friction, state => ev%switches%state)
      b = ev%lambda
      f = merge(ev%rows%friction, 0.0_wp, ev%rows%off)
      last = huge(1.0_wp)
      do pass = 1, most_passes
        call ev%schur%solve_beside(b, f, x)
        call slip_forces(laws, state, x, f, change, strongest)
        if (change <= settled*strongest) exit
        if (change > slow*last .and. change > 64*settled*strongest) then
          f = 0.0_wp                               ! c is convex: from here the way to a single row's limit is monotone
          call ev%schur%solve_beside(b, f, x)
          call slip_forces(laws, state, x, f, change, strongest)
          call newton(m, ev, b, x, f)
          exit
        end if
        if (change > slow*last) exit               ! no longer falls: rounding
        last = change
      end do
      ev%lambda = merge(f, x, ev%rows%off)
      ev%rows%largest = max(maxval(abs(b)), maxval(abs(ev%frame%free(1:2, :))), m%s%size*maxval(abs(ev%frame%free(3, :))))
      ev%rows%strongest = maxval(abs(ev%lambda))
      call ev%schur%motion_off(ev%lambda, b)
    end associate
  end subroutine slip_multipliers

  !> The friction of the last evaluation is that of an accepted state: evaluations to come start from it.
  pure subroutine keep_friction(ev)
    type(evaluation), intent(inout) :: ev
    ev%rows%friction = merge(ev%lambda, 0.0_wp, ev%rows%off .and. abs(ev%lambda) < huge(1.0_wp))
  end subroutine keep_friction

  !> Newton's method for (A).
  subroutine newton(m, ev, b, x, f)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in) :: b(:)                     !! [m/s2]
    real(wp), intent(inout) :: x(:), f(:)            !! [N]
    real(wp) :: r(size(x))                           ! [m/s2], then [N]
    real(wp) :: change, last, strongest
    logical :: ok
    integer :: pass
    last = huge(1.0_wp)
    do pass = 1, most_passes
      r = b
      call ev%schur%residual(merge(f, x, ev%rows%off), r)
      call solve_linearised(m, ev, x, 0, r, ok)
      if (.not. ok) exit
      x = x + r
      call slip_forces(m%s%friction, ev%switches%state, x, f, change, strongest)
      if (change <= settled*strongest) return
      if (change > slow*last .and. change <= 64*settled*strongest) return
      if (.not. change < huge(1.0_wp)) exit
      last = change
    end do
    ev%broken = .true.
  end subroutine newton

  !> How hard the friction of row k of those that switch presses its own joint, of what it brakes: where that is 1 or more, rigid
  !> bodies have no motion with friction, or two (Painleve 1895). With y the multipliers that a unit of friction asks for, the
  !> largest of dc/dlambda y over all directions of lambda is what c makes of y itself.
  real(wp) function pressing(m, ev, k, others) result(ratio)   ! [-]
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    integer, intent(in) :: k
    logical, intent(in) :: others                    !! with the friction of other joints, linearised; else without
    real(wp) :: y(size(ev%lambda))                   ! [-]
    logical :: ok
    ratio = 0.0_wp
    associate (law => m%s%friction(k))
      if (abs(ev%switches%state(law%number)) /= row_slips .or. .not. law%kinetic > 0.0_wp) return
      call ev%schur%column(law%row, y)
      if (others) then
        call solve_linearised(m, ev, ev%lambda, law%row, y, ok)
        if (.not. ok) return
      else
        call ev%schur%solve(y)
      end if
      ratio = law%kinetic*law%pressure(y)
    end associate
  end function pressing

  !> Multipliers of the rows that hold, friction linearised, from what they have to cancel; ok is false where there are none.
  subroutine solve_linearised(m, ev, lambda, without, x, ok)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: lambda(:)                !! about which [N]
    integer, intent(in) :: without                   !! a row t that is left out, 0: none
    real(wp), intent(inout) :: x(:)                  !! [m/s2], then [N]
    logical, intent(out) :: ok
    real(wp) :: ab(3*ev%schur%kd + 1, ev%schur%n)    ! band of the matrix [1/kg]
    real(wp) :: y(ev%schur%n, 1)                     ! at their places, weighed [m/s2], then [N]
    integer :: pivots(ev%schur%n), upper
    logical :: bad
    call sum_matrix(m, ev, lambda, without, ab)
    associate (n => ev%schur%n, kd => ev%schur%kd, row => ev%schur%row, scale => ev%schur%scale)
      y(:, 1) = x(row)*scale(row)
      call factor_lu(n, kd, ab, pivots, upper, bad)
      if (.not. bad) call solve_lu(n, kd, ab, pivots, upper, 1, y)
      x = 0.0_wp
      x(row) = y(:, 1)*scale(row)
    end associate
    ok = .not. bad
  end subroutine solve_linearised

  !> S + S_t sigma dc/dlambda of the rows that hold, in the storage of `band_lu`. A row t meets the rows of its joint, and all that
  !> these meet.
  subroutine sum_matrix(m, ev, lambda, without, ab)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: lambda(:)                !! [N]
    integer, intent(in) :: without                   !! a row t that is left out, 0: none
    real(wp), intent(out) :: ab(:, :)                !! [1/kg]
    real(wp) :: d(2, size(lambda))                   ! slopes of rows t by the multipliers of their joints [-]
    integer :: first(size(lambda)), last(size(lambda))   ! those multipliers
    integer :: i, j, k, l
    associate (s => ev%schur, c => ev%schur%coupled, main => 2*ev%schur%kd + 1)
      ab = 0.0_wp
      do j = 1, s%n
        do i = 0, min(s%kd, s%n - j)
          ab(main + i, j) = s%s(i, j)
          ab(main - i, j + i) = s%s(i, j)
        end do
      end do
      if (s%singular) ab(main, :) = ab(main, :) + s%shift*sum(s%s(0, 1:s%n))/s%n
      first = 1
      last = 0
      do k = 1, size(m%s%friction)
        associate (law => m%s%friction(k))
          if (law%row == without) cycle
          d(:, law%row) = law%force_slope(ev%switches%state(law%number), lambda)
          first(law%row) = law%first
          last(law%row) = law%first + law%rows - 1
        end associate
      end do
      do k = 1, c%held
        associate (i => c%place(k), t => c%off(k))
          do l = first(t), last(t)
            j = s%position(l)
            ab(main + i - j, j) = ab(main + i - j, j) + s%entry_of(k)/s%scale(t)*d(1 + l - first(t), t)*s%scale(l)
          end do
        end associate
      end do
    end associate
  end subroutine sum_matrix
end module slipping
