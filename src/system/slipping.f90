!> Multipliers of joints that slip: friction follows from the same multipliers that it changes (theory.md, section 13),
!>
!>   S_nn lambda = b - S_nt sigma c(lambda)                                 (A)
!>
!> with the rows n that hold and the rows t that slip. Newton's method solves it, from the multipliers of the last accepted state: c
!> is a norm, of which a slope keeps all but the change of direction. Its matrix has the band of S.
module slipping
  use kinds, only: wp
  use band_lu, only: factor_lu, solve_lu
  use evaluation_results, only: evaluation, slip_work
  use friction_law, only: pressure_of, row_slips, slip_forces
  use mechanism, only: mechanism_model
  use multipliers, only: multiplier_system
  implicit none (type, external)
  private
  public :: painleve_ratio, slip_multipliers

  integer, parameter :: most_passes = 60
  integer, parameter :: refinements = 2            !! by each, what the shift of a singular S leaves falls by 1e-6
  real(wp), parameter :: law_rounding = 1.0e-14_wp !! what the friction misses of its law in the last pass, of its size [-]
  real(wp), parameter :: rounding = 64*epsilon(1.0_wp)   !! the same where it falls no longer [-]
  real(wp), parameter :: slow = 0.01_wp            !! contraction from which a new matrix takes less work [-]
  real(wp), parameter :: far = 0.9_wp              !! contraction of simple passes that lead nowhere [-]

contains

  !> Multipliers of all rows from the right-hand side that they hold: those of rows that are off are the friction. Where no force
  !> meets (A), the evaluation is broken.
  subroutine slip_multipliers(m, ev)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    logical :: ok
    ev%slip%b = ev%lambda
    if (ev%schur%singular) then
      call iterate(m, ev, ok)
      if (.not. ok) call newton(m, ev, ok)
    else
      call newton(m, ev, ok)
      if (.not. ok) call iterate(m, ev, ok)
    end if
    if (.not. ok) ok = largest_difference(ev%slip%law, ev%slip%f) <= rounding*held_alone(ev)
    if (.not. ok) ev%broken = .true.
    associate (b => ev%slip%b)
      ev%lambda = merge(ev%slip%f, ev%slip%x, ev%rows%off)
      ev%rows%largest = max(maxval(abs(b)), maxval(abs(ev%frame%free(1:2, :))), m%s%size*maxval(abs(ev%frame%free(3, :))))
      ev%rows%strongest = maxval(abs(ev%lambda))
      ev%rows%acceleration = b
      call ev%schur%motion_off(ev%lambda, ev%rows%acceleration)
    end associate
  end subroutine slip_multipliers

  !> The largest multiplier that a row would need if it held alone: where reactions pass through zero they are its rounding.
  pure real(wp) function held_alone(ev) result(largest)   ! [N]
    type(evaluation), intent(in) :: ev
    real(wp) :: compliance                           ! [1/kg]
    integer :: k
    largest = 0.0_wp
    do k = 1, size(ev%slip%b)
      compliance = ev%schur%diagonal(k)
      if (compliance > 0.0_wp .and. .not. ev%rows%off(k)) largest = max(largest, abs(ev%slip%b(k))/compliance)
    end do
  end function held_alone

  !> Newton's method: the friction of multipliers y near x is f + D (y - x). The matrix of a singular S is shifted: the
  !> solution is refined.
  subroutine newton(m, ev, ok)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    logical, intent(out) :: ok
    real(wp) :: missed, last, strongest              ! [N]
    logical :: renew
    integer :: pass
    associate (w => ev%slip)
      w%x = w%start
      renew = .true.
      do pass = 1, most_passes
        if (renew) call factor(m, ev, w%x, 0, ok)
        if (renew .and. .not. ok) return
        call solve_linearised(m, ev, .false.)
        call slip_forces(m%s%friction, ev%switches%state, w%x, ev%rows%pressed, w%law, strongest)
        missed = largest_difference(w%law, w%f)
        if (pass == 1) last = strongest
        ok = missed <= law_rounding*strongest .or. (missed <= rounding*strongest .and. missed > slow*last)
        if (ok .or. .not. missed < huge(1.0_wp)) exit
        renew = missed > slow*last
        last = missed
      end do
    end associate
    if (.not. (ok .and. ev%schur%singular)) return
    do pass = 1, refinements
      call solve_linearised(m, ev, .true.)
    end do
  end subroutine newton

  !> Multipliers and friction by the matrix that is factored. What its shift adds to the multipliers so far stands on the right-hand
  !> side, too, where they are refined, so that the solution does not feel it.
  subroutine solve_linearised(m, ev, refine)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    logical, intent(in) :: refine
    real(wp) :: strongest                            ! [N]
    associate (w => ev%slip)
      call slip_forces(m%s%friction, ev%switches%state, w%x, ev%rows%pressed, w%f, strongest)
      call add_slopes(m, w, -1, w%f)
      call ev%schur%put(w%b, w%f)
      if (refine) call ev%schur%add_shift(w%x)
      call substitute(ev%schur, w)
      call ev%schur%get(w%x)
      call add_slopes(m, w, 1, w%f)
    end associate
  end subroutine solve_linearised

  !> f + D x or f - D x of the rows that slip.
  pure subroutine add_slopes(m, w, sign_of, f)
    type(mechanism_model), intent(in) :: m
    type(slip_work), intent(in) :: w
    integer, intent(in) :: sign_of                   !! 1 or -1
    real(wp), intent(inout) :: f(:)                  !! (rows) [N]
    integer :: k
    do k = 1, size(m%s%friction)
      associate (law => m%s%friction(k))
        if (law%element > 0) cycle
        f(law%row) = f(law%row) + sign_of*(w%slope(1, k)*w%x(law%first) + w%slope(2, k)*w%x(law%first + law%rows - 1))
      end associate
    end do
  end subroutine add_slopes

  !> The largest |a - b|.
  pure real(wp) function largest_difference(a, b) result(largest)   ! [N]
    real(wp), intent(in), contiguous :: a(:), b(:)   !! [N]
    integer :: k
    largest = 0.0_wp
    do k = 1, size(a)
      if (.not. abs(a(k) - b(k)) <= largest) largest = abs(a(k) - b(k))
    end do
  end function largest_difference

  !> Simple passes with the factor of S: multipliers of least norm where S is singular.
  subroutine iterate(m, ev, ok)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    logical, intent(out) :: ok
    real(wp) :: missed, last, strongest              ! [N]
    integer :: pass
    associate (w => ev%slip)
      w%f = 0.0_wp
      last = huge(1.0_wp)
      do pass = 1, most_passes
        call ev%schur%solve_beside(w%b, w%f, w%x)
        call slip_forces(m%s%friction, ev%switches%state, w%x, ev%rows%pressed, w%law, strongest)
        missed = largest_difference(w%law, w%f)
        ok = missed <= law_rounding*strongest .or. (missed <= rounding*strongest .and. missed > far*last)
        if (ok .or. .not. missed < far*last) return
        w%f = w%law
        last = missed
      end do
    end associate
  end subroutine iterate

  !> How hard the friction of row k of those that switch presses its own joint, of what it brakes: where that is 1 or more, rigid
  !> bodies have no motion with friction, or two (Painleve 1895). With y the multipliers that a unit of friction asks for, the
  !> largest of dc/dlambda y over all directions of lambda is what c makes of y itself.
  real(wp) function painleve_ratio(m, ev, k, others) result(ratio) ! [-]
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
        call factor(m, ev, ev%lambda, law%row, ok)
        if (.not. ok) return
        call ev%schur%put(y, spread(0.0_wp, 1, size(y)))
        call substitute(ev%schur, ev%slip)
        call ev%schur%get(y)
      else
        call ev%schur%solve(y)
      end if
      ratio = law%kinetic*pressure_of(law, y)
    end associate
  end function painleve_ratio

  !> The matrix of (A) about given multipliers, factored: S_nn + S_nt D, D = sigma dc/dlambda. ok is false where it is singular.
  subroutine factor(m, ev, lambda, without, ok)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in) :: lambda(:)                !! [N]
    integer, intent(in) :: without                   !! a row t that is left out, 0: none
    logical, intent(out) :: ok
    logical :: bad
    integer :: k
    associate (w => ev%slip, s => ev%schur, c => ev%schur%coupled)
      do k = 1, size(m%s%friction)
        if (m%s%friction(k)%element > 0) cycle
        associate (law => m%s%friction(k), columns => [m%s%friction(k)%first, m%s%friction(k)%first + m%s%friction(k)%rows - 1])
          w%law_of(law%row) = k
          w%slope(:, k) = 0.0_wp
          if (law%row /= without) w%slope(:, k) = law%force_slope(ev%switches%state(law%number), lambda)
          w%weighed(:, k) = w%slope(:, k)*s%scale(columns)/s%scale(law%row)
          w%column(:, k) = s%position(columns)
        end associate
      end do
      if (size(w%ab, 1) /= 3*s%kd + 1 .or. size(w%ab, 2) /= s%n) then
        deallocate (w%ab, w%pivots)
        allocate (w%ab(3*s%kd + 1, s%n), w%pivots(s%n))
      end if
      call fill_band(s%n, s%kd, s%s, w%ab)
      if (s%singular) w%ab(2*s%kd + 1, :) = w%ab(2*s%kd + 1, :) + s%mean_shift()
      if (c%holding > 0) call add_friction(c%holding, c%place, c%off, s%s(0, s%n + 1), w%law_of, w%column, w%weighed, s%n, s%kd, &
                                           w%ab)
      call factor_lu(s%n, s%kd, w%ab, w%pivots, w%upper, bad)
      ok = .not. bad
    end associate
  end subroutine factor

  !> Adds S_nt D to the band.
  pure subroutine add_friction(entries, place, off, s, law_of, column, slope, n, kd, ab)
    integer, intent(in) :: entries, n, kd
    integer, intent(in) :: place(entries), off(entries)   !! place of the row that holds, the row that is off
    real(wp), intent(in) :: s(entries)               !! [1/kg]
    integer, intent(in), contiguous :: law_of(:), column(:, :)
    real(wp), intent(in), contiguous :: slope(:, :)  !! (2, joints with friction) [-]
    real(wp), intent(inout) :: ab(3*kd + 1, n)       !! [1/kg]
    integer :: i, j, k, l, t
    do k = 1, entries
      t = law_of(off(k))
      if (t == 0) cycle                              ! a stop, or its friction
      i = 2*kd + 1 + place(k)
      do l = 1, 2
        j = column(l, t)
        ab(i - j, j) = ab(i - j, j) + s(k)*slope(l, t)
      end do
    end do
  end subroutine add_friction

  !> A symmetric band in the storage of `band_lu`.
  pure subroutine fill_band(n, kd, s, ab)
    integer, intent(in) :: n, kd
    real(wp), intent(in) :: s(0:kd, n)               !! [1/kg]
    real(wp), intent(out) :: ab(3*kd + 1, n)         !! [1/kg]
    integer :: i, j
    ab = 0.0_wp
    do j = 1, n
      ab(2*kd + 1, j) = s(0, j)
      do i = 1, min(kd, n - j)
        ab(2*kd + 1 + i, j) = s(i, j)
        ab(2*kd + 1 - i, j + i) = s(i, j)
      end do
    end do
  end subroutine fill_band

  !> Multipliers by that factor, in its order.
  subroutine substitute(schur, w)
    type(multiplier_system), intent(inout) :: schur
    type(slip_work), intent(in) :: w
    call solve_lu(schur%n, schur%kd, w%ab, w%pivots, w%upper, 1, schur%x)
  end subroutine substitute
end module slipping
