!> The elastic block of a body in the Newton matrix of the implicit method: the constant one c1 m_ff + c2 C + K_eff, factored
!> once a step size, and the exact one B = c1 m_ff + c2 (C - 2 theta' Z) + K_eff - theta'2 m - theta'' Z with geometric
!> stiffness, banded and nonsymmetric; solves with either (theory.md, section 7).
module implicit_blocks
  use kinds, only: wp
  use banded, only: band_solve, band_solve_two, factor_again, factor_symmetric
  use body, only: body_model
  use generalized_alpha, only: alpha_step
  use implicit_element, only: element_mass_product
  use implicit_element_tangent, only: element_block, element_base
  use implicit_model, only: implicit_body
  use lapack, only: dgbtrf, dgbtrs, dgetrf, dgetrs
  use place, only: place_model
  implicit none (type, external)
  private
  public :: base_block, exact_block, elastic_solve, elastic_columns, elastic_filter, invert3

contains

  !> Factors the constant block c1 m_ff + c2 C + K_eff.
  subroutine base_block(t, bo, now, bad)
    type(implicit_body), intent(inout) :: t
    type(body_model), intent(in) :: bo
    type(alpha_step), intent(in) :: now
    logical, intent(out) :: bad
    integer :: i, n, info
    logical :: same
    if (bo%modal) then
      t%dense = now%c2*bo%cmodal + t%stiff
      do i = 1, t%nf
        t%dense(i, i) = t%dense(i, i) + now%c1
      end do
      call dgetrf(t%nf, t%nf, t%dense, t%nf, t%base_pivots, info)
      bad = info /= 0
      return
    end if
    call list_entries(t, bo, now, n, same)
    if (same) then
      call factor_again(t%base, t%reordered, t%rows(1:n), t%cols(1:n), t%values(1:n), t%band, info)
    else
      call factor_symmetric(bo%nf, t%rows(1:n), t%cols(1:n), t%values(1:n), t%base, info)
      t%reordered(t%base%order) = [(i, i=1, bo%nf)]
      n = 0
      do i = 1, size(t%base%blocks)
        associate (blk => t%base%blocks(i))
          n = max(n, (blk%kd + 1)*(blk%last - blk%first + 1))
        end associate
      end do
      t%band = [(0.0_wp, i=1, n)]
    end if
    bad = info /= 0
  end subroutine base_block

  !> Entries of the constant block of a nodal body; whether they are those of the last time.
  subroutine list_entries(t, bo, now, n, same)
    type(implicit_body), intent(inout) :: t
    type(body_model), intent(in) :: bo
    type(alpha_step), intent(in) :: now
    integer, intent(out) :: n
    logical, intent(out) :: same
    real(wp) :: x(6, 6)
    integer :: e, i, j
    same = .true.
    n = 0
    do e = 1, bo%ne
      x = element_base(t%el, e, now%c1, now%c2)
      do i = 1, 6
        do j = 1, i
          if (bo%edof(i, e) == 0 .or. bo%edof(j, e) == 0 .or. abs(x(i, j)) <= 0.0_wp) cycle
          call add(bo%edof(i, e), bo%edof(j, e), x(i, j))
        end do
      end do
    end do
    do e = 1, size(bo%lumps)
      do i = 1, 3
        j = bo%dof(i, bo%lumps(e)%node)
        if (j > 0) call add(j, j, now%c1*merge(bo%lumps(e)%inertia, bo%lumps(e)%mass, i == 3))
      end do
    end do
    same = same .and. n == t%entries
    t%entries = n
  contains
    !> Adds an entry.
    subroutine add(row, col, value)
      integer, intent(in) :: row, col
      real(wp), intent(in) :: value            !! [kg/s2], [kg m/s2] or [kg m2/s2]
      n = n + 1
      same = same .and. t%rows(n) == row .and. t%cols(n) == col
      t%rows(n) = row
      t%cols(n) = col
      t%values(n) = value
    end subroutine add
  end subroutine list_entries

  !> Factors the exact block at the state of the last body_residual.
  subroutine exact_block(t, bo, now, w, wd, bad)
    type(implicit_body), intent(inout) :: t
    type(body_model), intent(in) :: bo
    type(alpha_step), intent(in) :: now
    real(wp), intent(in) :: w, wd              !! frame rate [rad/s] and acceleration [rad/s2]
    logical, intent(out) :: bad
    real(wp) :: x(6, 6), k2
    integer :: e, i, j, c, pi, pj, d(3), o, info
    k2 = 2*now%c2*w + wd
    if (bo%modal) then
      do j = 1, t%nf
        do i = 1, t%nf
          t%lu(i, j) = now%c2*bo%cmodal(i, j) + t%stiff(i, j) + w**2*bo%jmodal(i, j) - k2*bo%zmodal(i, j)
        end do
        t%lu(j, j) = t%lu(j, j) + now%c1 - w**2
      end do
      call dgetrf(t%nf, t%nf, t%lu, t%nf, t%pivots, info)
      bad = info /= 0
      return
    end if
    o = 2*t%kb + 1
    t%lu = 0.0_wp
    do e = 1, bo%ne
      x = element_block(t%el, bo, e, w, wd, now%c1, now%c2)
      do j = 1, 6
        if (bo%edof(j, e) == 0) cycle
        pj = t%position(bo%edof(j, e))
        do i = 1, 6
          if (bo%edof(i, e) == 0) cycle
          pi = t%position(bo%edof(i, e))
          t%lu(o + pi - pj, pj) = t%lu(o + pi - pj, pj) + x(i, j)
        end do
      end do
    end do
    do e = 1, size(bo%lumps)
      d = bo%dof(:, bo%lumps(e)%node)
      do c = 1, 3
        if (d(c) == 0) cycle
        pi = t%position(d(c))
        t%lu(o, pi) = t%lu(o, pi) + merge(now%c1*bo%lumps(e)%inertia, (now%c1 - w**2)*bo%lumps(e)%mass, c == 3)
      end do
      if (d(1) == 0 .or. d(2) == 0) cycle
      pi = t%position(d(1))
      pj = t%position(d(2))
      t%lu(o + pi - pj, pj) = t%lu(o + pi - pj, pj) - k2*bo%lumps(e)%mass
      t%lu(o + pj - pi, pi) = t%lu(o + pj - pi, pi) + k2*bo%lumps(e)%mass
    end do
    call dgbtrf(bo%nf, bo%nf, t%kb, t%kb, t%lu, 3*t%kb + 1, t%pivots, info)
    bad = info /= 0
  end subroutine exact_block

  !> Solves with the elastic block, for the residual t%ff and (with_column) the column t%col.
  subroutine elastic_solve(t, bo, exact, with_column)
    type(implicit_body), intent(inout) :: t
    type(body_model), intent(in) :: bo
    logical, intent(in) :: exact, with_column
    integer :: n
    n = t%nf
    if (exact .or. bo%modal) then
      t%many(:, 1) = t%ff(1:n)
      if (with_column) t%many(:, 2) = t%col(1:n)
      call solve_many(t, bo, exact, merge(2, 1, with_column))
      t%ff(1:n) = t%many(:, 1)
      if (with_column) t%col(1:n) = t%many(:, 2)
    else if (with_column) then
      call band_solve_two(t%base, t%ff(1:n), t%col(1:n))
    else
      call band_solve(t%base, t%ff(1:n))
    end if
  end subroutine elastic_solve

  !> Solves for the first n columns of t%many with an LU factor.
  subroutine solve_many(t, bo, exact, n)
    type(implicit_body), intent(inout) :: t
    type(body_model), intent(in) :: bo
    logical, intent(in) :: exact
    integer, intent(in) :: n
    integer :: info, j
    if (bo%modal) then
      if (exact) call dgetrs('N', t%nf, n, t%lu, t%nf, t%pivots, t%many, t%nf, info)
      if (.not. exact) call dgetrs('N', t%nf, n, t%dense, t%nf, t%base_pivots, t%many, t%nf, info)
      return
    end if
    do j = 1, n
      t%x(t%position) = t%many(:, j)
      t%many(:, j) = t%x(1:t%nf)
    end do
    call dgbtrs('N', t%nf, t%kb, t%kb, n, t%lu, 3*t%kb + 1, t%pivots, t%many, t%nf, info)
    do j = 1, n
      t%x(1:t%nf) = t%many(:, j)
      t%many(:, j) = t%x(t%position)
    end do
  end subroutine solve_many

  !> Columns B^-1 S-bar^T, B^-1 E^T and their products.
  subroutine elastic_columns(t, bo, places, exact)
    type(implicit_body), intent(inout) :: t
    type(body_model), intent(in) :: bo
    type(place_model), intent(in) :: places(:)
    logical, intent(in) :: exact
    integer :: i, j, c, n
    n = t%nf
    t%exact_columns = exact
    t%xs = bo%sbar
    t%xe = 0.0_wp
    do j = 1, size(t%seat, 2)
      associate (place => places(t%place(t%seat(1, j))), c => t%seat(2, j))
        if (bo%modal) t%xe(:, j) = place%psi(c, :)
        if (.not. bo%modal) t%xe(place%dof(c), j) = 1.0_wp
      end associate
    end do
    if (exact .or. bo%modal) then
      t%many(:, 1:2) = t%xs
      t%many(:, 3:) = t%xe
      call solve_many(t, bo, exact, size(t%many, 2))
      t%xs = t%many(:, 1:2)
      t%xe = t%many(:, 3:)
    else
      call band_solve_two(t%base, t%xs(:, 1), t%xs(:, 2))
      do j = 1, size(t%xe, 2)
        call band_solve(t%base, t%xe(:, j))
      end do
    end if
    do j = 1, 2
      do i = 1, 2
        t%pss(i, j) = dot_product(bo%sbar(:, i), t%xs(:, j))
      end do
    end do
    t%compliance = 0.0_wp
    do j = 1, size(t%xe, 2)
      do i = 1, 2
        t%sxe(i, j) = dot_product(bo%sbar(:, i), t%xe(:, j))
      end do
      do i = 1, t%na
        t%compliance(:, t%seat(2, j), i, t%seat(1, j)) = places(t%place(i))%elastic(t%xe(:, j))
      end do
    end do
    do i = 1, t%na
      do c = 1, 2
        t%exs(:, c, i) = places(t%place(i))%elastic(t%xs(:, c))
      end do
    end do
  end subroutine elastic_columns

  !> x <- B^-1 c1 m_ff x for two vectors of elastic coordinates: what a step resolves passes, faster motion does not.
  subroutine elastic_filter(t, bo, c1, x, y)
    type(implicit_body), intent(inout) :: t
    type(body_model), intent(in) :: bo
    real(wp), intent(in) :: c1               !! [1/s2]
    real(wp), intent(inout) :: x(:), y(:)    !! (nf)
    if (bo%modal) then
      t%many(:, 1) = c1*x
      t%many(:, 2) = c1*y
      call solve_many(t, bo, .false., 2)
      x = t%many(:, 1)
      y = t%many(:, 2)
      return
    end if
    call mass_product(t, bo, c1, x, t%ff)
    call mass_product(t, bo, c1, y, t%col)
    call band_solve_two(t%base, t%ff(1:t%nf), t%col(1:t%nf))
    x = t%ff(1:t%nf)
    y = t%col(1:t%nf)
  end subroutine elastic_filter

  !> c1 m_ff x, lumps included.
  subroutine mass_product(t, bo, c1, x, y)
    type(implicit_body), intent(inout) :: t
    type(body_model), intent(in) :: bo
    real(wp), intent(in) :: c1
    real(wp), intent(in) :: x(:)             !! (nf)
    real(wp), intent(inout) :: y(0:)         !! (0:nf)
    integer :: k, c, i
    t%x(1:t%nf) = c1*x
    y = 0.0_wp
    call element_mass_product(t%el, t%x, y)
    do k = 1, size(bo%lumps)
      do c = 1, 3
        i = bo%dof(c, bo%lumps(k)%node)
        if (i > 0) y(i) = y(i) + merge(bo%lumps(k)%inertia, bo%lumps(k)%mass, c == 3)*t%x(i)
      end do
    end do
  end subroutine mass_product

  !> Inverse of a 3 x 3 matrix by elimination with pivots.
  pure subroutine invert3(a, inverse, bad)
    real(wp), intent(in) :: a(3, 3)
    real(wp), intent(out) :: inverse(3, 3)
    logical, intent(out) :: bad
    real(wp) :: w(3, 6), row(6)
    integer :: k, i, p
    w = 0.0_wp
    w(:, 1:3) = a
    do k = 1, 3
      w(k, 3 + k) = 1.0_wp
    end do
    bad = .false.
    do k = 1, 3
      p = k - 1 + maxloc(abs(w(k:3, k)), 1)
      bad = bad .or. .not. (abs(w(p, k)) > 0.0_wp .and. abs(w(p, k)) < huge(1.0_wp))
      if (bad) exit
      row = w(p, :)
      w(p, :) = w(k, :)
      w(k, :) = row/row(k)
      do i = 1, 3
        if (i /= k) w(i, :) = w(i, :) - w(i, k)*w(k, :)
      end do
    end do
    inverse = w(:, 4:6)
  end subroutine invert3
end module implicit_blocks
