!> Multipliers of joints that slip: friction follows from the same multipliers that it changes (theory.md, section 13),
!>
!>   S_nn lambda = b - S_nt sigma c(lambda)                                 (A)
!>
!> with the rows n that hold and the rows t that slip. It is iterated with the factor at hand; where that contracts slowly, Newton's
!> method takes over, whose matrix has the same band.
module slipping
  use kinds, only: wp
  use evaluation_results, only: evaluation
  use friction_law, only: row_slips
  use lapack, only: dgbtrf, dgbtrs
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: slip_multipliers, pressing

  integer, parameter :: most_passes = 60
  real(wp), parameter :: slow = 0.3_wp             !! contraction from which Newton's method takes less work [-]
  real(wp), parameter :: settled = 4*epsilon(1.0_wp)   !! change of the friction that is rounding, of its size [-]

contains

  !> Multipliers of all rows from the right-hand side that they hold: those of rows that are off are the friction. Where no force
  !> meets (A), the evaluation is broken.
  subroutine slip_multipliers(m, ev)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    real(wp), dimension(size(ev%lambda)) :: b, x, free, f   ! [m/s2], [N]; without friction
    real(wp) :: change, last, strongest
    integer :: pass
    b = ev%lambda
    x = b
    call ev%schur%solve(x)
    free = x
    f = 0.0_wp
    call friction(m, ev, x, f, change, strongest)
    last = huge(1.0_wp)
    do pass = 1, merge(most_passes, 0, strongest > 0.0_wp)
      call ev%schur%solve_beside(b, f, x)
      call friction(m, ev, x, f, change, strongest)
      if (change <= settled*strongest) exit
      if (change > slow*last .and. change > 64*settled*strongest) then
        x = free                                 ! c is convex: from here the way to a single row's limit is monotone
        call friction(m, ev, x, f, change, strongest)
        call newton(m, ev, b, x, f)
        exit
      end if
      if (change > slow*last) exit               ! no longer falls: rounding
      last = change
    end do
    ev%lambda = merge(f, x, ev%rows%off)
    x = b
    call ev%schur%whole_product(ev%lambda, x)
    ev%rows%acceleration = x
    ev%rows%largest = max(maxval(abs(b)), maxval(abs(ev%frame%free(1:2, :))), m%s%size*maxval(abs(ev%frame%free(3, :))))
    ev%rows%strongest = maxval(abs(ev%lambda))
  end subroutine slip_multipliers

  !> The friction of all rows that are off; others have none.
  pure subroutine friction(m, ev, lambda, f, change, strongest)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: lambda(:)                !! [N]
    real(wp), intent(inout) :: f(:)                  !! (rows) [N]
    real(wp), intent(out) :: change                  !! the largest [N]
    real(wp), intent(out) :: strongest               !! the largest [N]
    real(wp) :: before                               ! [N]
    integer :: k
    change = 0.0_wp
    strongest = 0.0_wp
    do k = 1, size(m%s%friction)
      associate (law => m%s%friction(k))
        before = f(law%row)
        f(law%row) = law%force(ev%switches%state(law%number), lambda)
        change = max(change, abs(f(law%row) - before))
        strongest = max(strongest, abs(f(law%row)))
      end associate
    end do
  end subroutine friction

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
      call ev%schur%whole_product(merge(f, x, ev%rows%off), r)
      call solve_linearised(m, ev, x, 0, r, ok)
      if (.not. ok) exit
      x = x + r
      call friction(m, ev, x, f, change, strongest)
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
    real(wp), dimension(size(ev%lambda)) :: y, unit  ! [-]
    logical :: ok
    ratio = 0.0_wp
    associate (law => m%s%friction(k))
      if (abs(ev%switches%state(law%number)) /= row_slips .or. .not. law%kinetic > 0.0_wp) return
      unit = 0.0_wp
      unit(law%row) = -1.0_wp
      y = 0.0_wp
      call ev%schur%whole_product(unit, y)
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
    integer :: pivots(ev%schur%n), info
    where (ev%rows%off) x = 0.0_wp
    call sum_matrix(m, ev, lambda, without, ab)
    call dgbtrf(size(x), size(x), ev%schur%kd, ev%schur%kd, ab, size(ab, 1), pivots, info)
    x(ev%schur%position) = x*ev%schur%scale
    if (info == 0) call dgbtrs('N', size(x), ev%schur%kd, ev%schur%kd, 1, ab, size(ab, 1), pivots, x, size(x), info)
    ok = info == 0
    x = x(ev%schur%position)*ev%schur%scale
  end subroutine solve_linearised

  !> S + S_t sigma dc/dlambda in the band storage of `dgbtrf`. A row t meets the rows of its joint, and all that these meet.
  subroutine sum_matrix(m, ev, lambda, without, ab)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: lambda(:)                !! [N]
    integer, intent(in) :: without                   !! a row t that is left out, 0: none
    real(wp), intent(out) :: ab(:, :)                !! [1/kg]
    real(wp) :: d(2)                                 ! [-]
    real(wp) :: t                                    ! [1/kg]
    integer :: i, j, k, l, n, kd
    n = ev%schur%n
    kd = ev%schur%kd
    ab = 0.0_wp
    do j = 1, n
      do i = 0, min(kd, n - j)
        ab(2*kd + 1 + i, j) = ev%schur%s(i, j)
        ab(2*kd + 1 - i, j + i) = ev%schur%s(i, j)
      end do
    end do
    if (ev%schur%singular) ab(2*kd + 1, :) = ab(2*kd + 1, :) + ev%schur%shift*sum(ev%schur%s(0, :))/n
    do k = 1, size(m%s%friction)
      associate (law => m%s%friction(k))
        if (law%row == without) cycle
        d = law%force_slope(ev%switches%state(law%number), lambda)
        associate (at => ev%schur%position(law%row), scale => ev%schur%scale)
          do i = max(1, at - kd), min(n, at + kd)
            if (ev%rows%off(ev%schur%row(i))) cycle
            t = ev%schur%whole(abs(i - at), min(i, at))/scale(law%row)
            if (.not. abs(t) > 0.0_wp) cycle
            do l = 1, law%rows
              j = ev%schur%position(law%first + l - 1)
              ab(2*kd + 1 + i - j, j) = ab(2*kd + 1 + i - j, j) + t*d(l)*scale(law%first + l - 1)
            end do
          end do
        end associate
      end associate
    end do
  end subroutine sum_matrix
end module slipping
