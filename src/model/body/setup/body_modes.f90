!> The lowest modes of a flexible body under its reference conditions (free-free modes for reference 'free'), mass-normalised
!> with lumps included: densely for small bodies, by subspace iteration beyond. Set-up work only.
module body_modes
  use kinds, only: wp
  use banded, only: band_factor, band_solve
  use block_lanczos, only: inertia_operator, krylov_modes, iterate_subspace, inverse_iteration, orthonormalise
  use body, only: body_model
  use body_setup, only: elements_of
  use elastic_operators, only: factor_entries, mass_product
  use lapack, only: dsyev, dsygvd
  use nodal_basis, only: nodal_model
  use sparse_pattern, only: symmetric_pattern
  implicit none (type, external)
  private
  public :: lowest_modes, add_static_shapes, static_displacements

  integer, parameter :: dense_size = 90   !! coordinates up to which all modes are computed densely: beyond, the lowest lose digits
  integer, parameter :: polish_passes = 2, most_passes = 200
  integer, parameter :: static_passes = 3 !! solutions with a shifted stiffness that make one static solution
  real(wp), parameter :: as_one_beam = 500.0_wp   !! squared lowest frequency of a free beam, of EI/(m l^3) [-]
  integer, parameter :: most_corrections = 10    !! of a solution: a factor that needs more has lost its digits
  real(wp), parameter :: last_correction = 1.0e-7_wp   !! root of its energy over the solution's; frequencies err by the square [-]
  real(wp), parameter :: dependent = 1.0e-7_wp   !! what is left of a shape that the others already contain [-]
  real(wp), parameter :: far_below = 1.0e-3_wp   !! of the largest squared frequency: dense modes below it are polished [-]

  !> K + shift M and m_ff of a body.
  type, extends(inertia_operator) :: body_operator
    real(wp), allocatable :: rigid(:, :)                 !! (nf, n) free rigid motions, mass-orthonormal [m, rad, over kg^.5 m]
    type(band_factor) :: factor                          !! of K + shift M
    type(body_model) :: body
    type(nodal_model) :: elements                        !! deformations and forces of its elements
    logical :: corrected = .true.                        !! solutions are corrected by their residuals
    logical :: not_converged = .false.                   !! the corrections of one did not converge
  contains
    procedure :: set_up
    procedure :: solve
    procedure :: stiffness_times
    procedure :: mass_times
  end type body_operator

contains

  !> Lowest elastic modes in nodal coordinates.
  subroutine lowest_modes(b, modes, x, w, bad)
    type(body_model), intent(in) :: b
    integer, intent(in) :: modes
    real(wp), allocatable, intent(out) :: x(:, :)        !! (nf, modes) mass-normalised [m, rad, over kg^.5 m]
    real(wp), allocatable, intent(out) :: w(:)           !! (modes) squared frequencies [rad2/s2]
    logical, intent(out) :: bad
    call modes_with_shift(b, modes, .false., x, w, bad)
    if (bad) call modes_with_shift(b, modes, .true., x, w, bad)
  end subroutine lowest_modes

  !> The same with a shift of the operator.
  subroutine modes_with_shift(b, modes, large_shift, x, w, bad)
    type(body_model), intent(in) :: b
    integer, intent(in) :: modes
    logical, intent(in) :: large_shift                   !! of the order of the lowest squared frequency
    real(wp), allocatable, intent(out) :: x(:, :)        !! (nf, modes) mass-normalised [m, rad, over kg^.5 m]
    real(wp), allocatable, intent(out) :: w(:)           !! (modes) squared frequencies [rad2/s2]
    logical, intent(out) :: bad
    type(body_operator) :: op
    real(wp) :: highest                                  ! squared frequency that is known [rad2/s2]
    integer :: j
    call op%set_up(b, large_shift, bad)
    if (bad) return
    if (b%nf <= dense_size .or. 2*(modes + size(op%rigid, 2)) >= b%nf) then
      call dense_modes(b, op, modes, x, w, highest, bad)
      if (bad) return
    else
      call subspace_modes(op, modes, x, w, bad)
      if (bad) return
      highest = w(modes)
    end if
    call polish(op, x(:, 1:count(w <= far_below*highest)), bad)
    bad = bad .or. op%not_converged
    do j = 1, size(x, 2)
      w(j) = dot_product(x(:, j), op%stiffness_times(x(:, j)))
    end do
  end subroutine modes_with_shift

  !> Appends to the modes the static shapes of given loads (Craig & Bampton 1968; with free rigid motions their inertia balances
  !> the load: Craig & Chang 1977). The shapes are made mass-orthogonal to the modes and
  !> then diagonalise the stiffness among themselves, so that K stays diag(w). Those that others contain are left out.
  subroutine add_static_shapes(b, loads, x, w, bad)
    type(body_model), intent(in) :: b
    real(wp), intent(in) :: loads(:, :)                  !! (nf, loads) [N, N m]
    real(wp), allocatable, intent(inout) :: x(:, :)      !! (nf, modes), then (nf, modes + shapes) [m, rad, over kg^.5 m]
    real(wp), allocatable, intent(inout) :: w(:)         !! their squared frequencies, Rayleigh quotients of shapes [rad2/s2]
    logical, intent(out) :: bad
    type(body_operator) :: op
    real(wp), allocatable :: y(:, :), f(:, :), part(:), kk(:, :), lambda(:), work(:)
    real(wp) :: my(b%nf), whole, length                  ! of a shape [kg m, kg m2], [kg^.5 m]
    integer :: j, n, m, info
    call op%set_up(b, .false., bad)
    if (bad) return
    m = size(x, 2)
    allocate (y(b%nf, m + size(loads, 2)), f(b%nf, m + size(loads, 2)))
    y(:, 1:m) = x
    do j = 1, m
      f(:, j) = (w(j) + op%shift)*op%mass_times(x(:, j))
    end do
    n = m
    do j = 1, size(loads, 2)
      call static_shape(op, loads(:, j), y(:, n + 1), f(:, n + 1))
      if (norm2(f(:, n + 1)) <= dependent*norm2(loads(:, j))) cycle      ! a load that rigid motions alone balance, or none
      whole = sqrt(max(dot_product(y(:, n + 1), op%mass_times(y(:, n + 1))), 0.0_wp))
      call orthonormalise(op, y(:, 1:n), y(:, n + 1), my, part, length)
      if (.not. length > dependent*whole) cycle
      f(:, n + 1) = (f(:, n + 1) - matmul(f(:, 1:n), part))/length
      n = n + 1
    end do
    allocate (lambda(n - m), work(40*(n - m) + 1))
    kk = matmul(transpose(y(:, m + 1:n)), f(:, m + 1:n))
    call dsyev('V', 'U', n - m, kk, max(1, n - m), lambda, work, size(work), info)
    bad = info /= 0 .or. op%not_converged
    if (bad) return
    x = reshape([x, matmul(y(:, m + 1:n), kk)], [b%nf, n])
    w = [w, lambda - op%shift]
  end subroutine add_static_shapes

  !> Static displacements of the nodal coordinates under loads, each scaled so that it stores an energy of 1/2; 0 where free rigid
  !> motions balance it.
  subroutine static_displacements(b, loads, y, bad)
    type(body_model), intent(in) :: b                    !! with nodal operators
    real(wp), intent(inout) :: loads(:, :)               !! (nf, loads) any; then scaled and balanced [N, N m]
    real(wp), intent(out) :: y(:, :)                     !! (nf, loads) [m, rad]
    logical, intent(out) :: bad
    type(body_operator) :: op
    real(wp) :: f(size(loads, 1)), scale                 ! [N, N m], [-]
    integer :: j
    call op%set_up(b, .false., bad)
    if (bad) return
    do j = 1, size(loads, 2)
      call static_shape(op, loads(:, j), y(:, j), f)
      scale = 0.0_wp
      if (norm2(f) > dependent*norm2(loads(:, j))) scale = 1/sqrt(dot_product(f, y(:, j)))
      loads(:, j) = scale*f
      y(:, j) = scale*y(:, j)
    end do
    bad = op%not_converged
  end subroutine static_displacements

  !> Displacements y under a load, balanced by the inertia of free rigid motions, and the force f with (K + shift M) y = f.
  subroutine static_shape(op, load, y, f)
    type(body_operator), intent(inout) :: op
    real(wp), intent(in) :: load(:)                      !! (nf) [N, N m]
    real(wp), intent(out) :: y(:)                        !! (nf) [m, rad]
    real(wp), intent(out) :: f(:)                        !! (nf) [N, N m]
    real(wp) :: balanced(size(f))                        ! [N, N m]
    integer :: i, pass
    balanced = load
    do i = 1, size(op%rigid, 2)
      balanced = balanced - dot_product(op%rigid(:, i), load)*op%mass_times(op%rigid(:, i))
    end do
    y = 0.0_wp
    do pass = 1, static_passes
      f = balanced + op%shift*op%mass_times(y)
      y = f
      call op%solve(y)
      if (size(op%rigid, 2) == 0) exit                   ! no shift
    end do
  end subroutine static_shape

  !> Prepares the operator. A shift far below the lowest frequency, zero where no rigid motion is free, parts the lowest modes in
  !> few solutions; the factor of one with a large shift loses fewer digits.
  subroutine set_up(self, b, large_shift, bad)
    class(body_operator), intent(inout) :: self
    type(body_model), intent(in) :: b
    logical, intent(in) :: large_shift                   !! of the order of the lowest squared frequency
    logical, intent(out) :: bad                          !! the stiffness is not positive definite
    self%body = b
    self%elements = elements_of(b)
    call find_rigid_modes(b, self)
    self%shift = minval(b%elements%ei_l*b%elements%length)/(b%mass*max(b%length, tiny(1.0_wp))**3)
    if (large_shift) then
      self%shift = as_one_beam*self%shift
    else if (size(self%rigid, 2) == 0) then
      self%shift = 0.0_wp
    end if
    call factor_entries(b%op%symmetric, b%op%k + self%shift*(b%op%m + b%op%j), self%factor, bad)
  end subroutine set_up

  !> Mass-orthonormal rigid motions that the reference conditions leave free (reference 'free' only).
  subroutine find_rigid_modes(b, op)
    type(body_model), intent(in) :: b
    type(body_operator), intent(inout) :: op
    real(wp) :: u(3), mx(b%nf), length                   ! [m, m, rad], [kg m, kg m2], [kg^.5 m]
    real(wp), allocatable :: part(:)
    integer :: k, c, m, n, first
    if (any(b%dof(2:3, :) == 0)) then
      allocate (op%rigid(b%nf, 0))
      return
    end if
    first = merge(1, 2, b%axial)
    n = 0
    allocate (op%rigid(b%nf, 4 - first), source=0.0_wp)   ! nothing slips
    do m = first, 3
      n = n + 1
      do k = 1, b%nn
        u = 0.0_wp
        u(m) = 1.0_wp
        if (m == 3) u(1:2) = [-b%x(2, k), b%x(1, k)]
        do c = 1, 3
          if (b%dof(c, k) > 0) op%rigid(b%dof(c, k), n) = u(c)
        end do
      end do
      call orthonormalise(op, op%rigid(:, 1:n - 1), op%rigid(:, n), mx, part, length)
    end do
  end subroutine find_rigid_modes

  !> y <- (K + shift M)^-1 y without rigid motions. The factor loses as many digits as the fourth power of the number of elements
  !> has; residuals by deformations give them back, as long as any is left.
  subroutine solve(self, y)
    class(body_operator), intent(inout) :: self
    real(wp), intent(inout) :: y(:)                      !! (nf) forces [N, N m], then displacements [m, rad]
    real(wp) :: force(size(y)), residual(size(y)), correction(size(y))   ! [N, N m], [N, N m], [m, rad]
    real(wp) :: work(2, size(y))                         ! [any]
    integer :: i, pass
    if (self%not_converged) return
    force = y
    do i = 1, size(self%rigid, 2)
      force = force - dot_product(self%rigid(:, i), y)*self%mass_times(self%rigid(:, i))
    end do
    residual = force
    y = 0.0_wp
    do pass = 1, most_corrections
      correction = residual
      call band_solve(self%factor, size(y), correction, work)
      do i = 1, size(self%rigid, 2)
        correction = correction - dot_product(self%rigid(:, i), self%mass_times(correction))*self%rigid(:, i)
      end do
      y = y + correction
      if (.not. self%corrected) return
      if (dot_product(correction, residual) <= last_correction**2*dot_product(y, force)) return
      residual = force - self%stiffness_times(y) - self%shift*self%mass_times(y)
    end do
    self%not_converged = .true.
  end subroutine solve

  !> K x from the deformations of the elements: sums of nodal forces would lose the digits that the motion of small elements as
  !> rigid bodies cancels.
  pure function stiffness_times(self, x) result(y)
    class(body_operator), intent(in) :: self
    real(wp), intent(in) :: x(:)                         !! (nf) [m, rad]
    real(wp) :: y(size(x))                               !! [N, N m]
    real(wp) :: q(0:size(x)), f(0:size(x))               ! entry 0 of removed coordinates
    real(wp) :: d(self%elements%rows, self%elements%columns)   ! deformations
    q(0) = 0.0_wp
    q(1:) = x
    f = 0.0_wp
    call self%elements%deform(self%body, q, d)
    call self%elements%add_stress(self%body, d, d, q, 1.0_wp, f)
    y = f(1:)
  end function stiffness_times

  !> m_ff x.
  pure function mass_times(self, x) result(y)
    class(body_operator), intent(in) :: self
    real(wp), intent(in) :: x(:)                         !! (nf) [m, rad]
    real(wp) :: y(size(x))                               !! [kg m, kg m2]
    call mass_product(self%body%op, x, y)
  end function mass_times

  !> All modes of a small body.
  subroutine dense_modes(b, op, modes, x, w, highest, bad)
    type(body_model), intent(in) :: b
    type(body_operator), intent(in) :: op
    integer, intent(in) :: modes
    real(wp), allocatable, intent(out) :: x(:, :)        !! (nf, modes) [m, rad, over kg^.5 m]
    real(wp), allocatable, intent(out) :: w(:)           !! (modes) [rad2/s2]
    real(wp), intent(out) :: highest                     !! squared frequency of all [rad2/s2]
    logical, intent(out) :: bad
    real(wp), allocatable :: k(:, :), m(:, :), lambda(:), part(:), work(:)
    integer, allocatable :: iwork(:)
    real(wp) :: mx(b%nf), length                         ! [kg m, kg m2], [kg^.5 m]
    integer :: nr, j, n, info
    n = b%nf
    k = dense(n, b%op%symmetric, b%op%k)
    m = dense(n, b%op%symmetric, b%op%m + b%op%j)
    allocate (lambda(n), work(1 + 6*n + 2*n*n), iwork(3 + 5*n))
    call dsygvd(1, 'V', 'L', n, k, n, m, n, lambda, work, size(work), iwork, size(iwork), info)
    bad = info /= 0
    if (bad) return
    highest = lambda(n)
    nr = size(op%rigid, 2)
    x = k(:, nr + 1:nr + modes)
    w = lambda(nr + 1:nr + modes)
    do j = 1, merge(modes, 0, nr > 0)
      call orthonormalise(op, op%rigid, x(:, j), mx, part, length)
    end do
  end subroutine dense_modes

  !> A matrix from its entries on a pattern.
  pure function dense(n, pattern, entries) result(a)
    integer, intent(in) :: n
    type(symmetric_pattern), intent(in) :: pattern
    real(wp), intent(in) :: entries(:)                   !! [any]
    real(wp) :: a(n, n)                                  !! [any]
    integer :: k
    a = 0.0_wp
    do k = 1, size(entries)
      a(pattern%row(k), pattern%col(k)) = entries(k)
    end do
  end function dense

  !> Repeats inverse iteration on the lowest modes, whose errors are those of the highest frequency: with a heavy lump on a light
  !> beam they are a large part of the lowest.
  subroutine polish(op, x, bad)
    type(body_operator), intent(inout) :: op
    real(wp), intent(inout) :: x(:, :)                   !! (nf, low) [m, rad, over kg^.5 m]
    logical, intent(out) :: bad
    real(wp) :: f(size(x, 1), size(x, 2))                ! [N, N m, over kg^.5 m]
    integer :: pass
    logical :: ok
    ok = .true.
    do pass = 1, polish_passes
      if (ok) call inverse_iteration(op, x, f, ok)
    end do
    bad = .not. ok
  end subroutine polish

  !> Lowest modes by subspace iteration with the banded factor of K + shift M, from the modes of a Krylov space, which are exact
  !> but for rounding.
  subroutine subspace_modes(op, modes, x, w, bad)
    type(body_operator), intent(inout) :: op
    integer, intent(in) :: modes                         !! modes wanted
    real(wp), allocatable, intent(out) :: x(:, :)        !! (nf, modes) [m, rad, over kg^.5 m]
    real(wp), allocatable, intent(out) :: w(:)           !! (modes) [rad2/s2]
    logical, intent(out) :: bad
    real(wp), allocatable :: y(:, :)
    real(wp), allocatable :: lambda(:), old(:)           ! squared frequencies + shift, of the last pass [rad2/s2]
    real(wp) :: change, before                           ! of the frequencies, relative to themselves [-]
    integer :: p, n, pass
    logical :: ok
    n = size(op%rigid, 1)
    p = min(n - size(op%rigid, 2), modes + 8)
    allocate (y(n, p), lambda(p))
    op%corrected = .false.
    call krylov_modes(op, min(n - size(op%rigid, 2), 2*p + 20), y, lambda, ok)
    op%corrected = .true.
    before = huge(1.0_wp)
    do pass = 1, most_passes
      bad = .not. ok .or. op%not_converged
      if (bad) return
      old = lambda
      call iterate_subspace(op, y, lambda, ok)
      change = maxval(abs(lambda(1:modes) - old(1:modes))/lambda(1:modes))
      if (change <= 1.0e-10_wp .or. (change < 1.0e-8_wp .and. change > 0.5_wp*before)) exit      ! rounding alone is left
      before = change
    end do
    x = y(:, 1:modes)
    w = lambda(1:modes) - op%shift
  end subroutine subspace_modes
end module body_modes
