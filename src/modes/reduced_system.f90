!> The linearised mechanism on a subspace of undamped motions, viscoelastic terms as coordinates of their own in the space that each
!> set of terms deforms (theory.md, section 5), K_r = F F^T:
!>   x'' = -K x - C x' - sum_r F sum_k alpha_k (F^T x - z_rk),   inertia_k z_rk'' + viscosity_k z_rk' + z_rk = F^T x
!> Motions that do not couple are parts of their own, such as each mode of a homogeneous body. The poles are estimates of those of
!> the whole system.
module reduced_system
  use kinds, only: wp
  use dynamic_stiffness, only: stiffness_system
  use lapack, only: dgeev, dgeqp3, dorgqr, dsyev
  use natural_modes, only: rounding_level, stiffness_scales, without_rounding
  use viscoelastic_law, only: viscoelastic_terms
  implicit none (type, external)
  private
  public :: reduced_model, reduced_poles, first_order, nonzero_part, usual_unknowns

  integer, parameter :: usual_unknowns = 400           !! of first order that are solved at once
  real(wp), parameter :: uncoupled = 1.0e-8_wp         !! coupling that is rounding [-]
  real(wp), parameter :: negligible = 1.0e-9_wp        !! stiffness of one set of terms that is rounding, over the whole [-]

  real(wp), parameter :: rounding = 1.0e-13_wp         !! of a sum, over the sum of its sizes [-]
  real(wp), parameter :: nothing = 1.0e3_wp*epsilon(1.0_wp)   !! share of a relaxation that moves something; less is rounding [-]
  real(wp), parameter :: dependent = 1.0e-9_wp         !! part of a row that is rounding where the others span the rest [-]

  !> The matrices on the subspace.
  type :: reduced_model
    integer :: p = 0                                   !! motions
    real(wp), allocatable :: basis(:, :)               !! (n, p) of unit modal mass [1/sqrt(kg)]
    logical, allocatable :: rigid(:)                   !! (p) motions without stiffness
    real(wp), allocatable :: k(:, :)                   !! (p, p) at E_R [1/s2]
    real(wp), allocatable :: g(:, :)                   !! (p, p) gyroscopic terms [1/s]
    real(wp), allocatable :: c(:, :)                   !! (p, p) damping [1/s]
    real(wp), allocatable :: part(:, :, :)             !! (p, p, groups) of each set of terms [1/s2]
    type(viscoelastic_terms), allocatable :: law(:)    !! (groups) the sets of terms
    real(wp), allocatable :: scale(:)                  !! (p) about the frequency of each motion [rad/s]
    real(wp), allocatable :: noise(:, :)               !! (p, 2) rounding of the row of each rate, without and with damping [1/s]
    integer, allocatable :: label(:)                   !! (p) which part each motion is in
    integer :: parts = 0
    logical :: exact = .true.                          !! no coupling was cut
  contains
    procedure :: make_room
    procedure :: build
    procedure :: find_scale
    procedure :: split_into_parts
  end type reduced_model

  !> Poles of one part.
  type :: reduced_poles
    complex(wp), allocatable :: lambda(:)              !! those with Im >= 0, zeros of rigid motions left out [1/s]
    complex(wp), allocatable :: shape(:, :)            !! (p, poles) [-]
    integer :: alone = 0                               !! poles of viscoelastic terms alone, to rounding: they are left out
  contains
    procedure :: find
  end type reduced_poles

contains

  !> A system of p motions, whose matrices are zero.
  pure subroutine make_room(self, p, law)
    class(reduced_model), intent(inout) :: self
    integer, intent(in) :: p
    type(viscoelastic_terms), intent(in) :: law(:)     !! the sets of terms
    self%p = p
    self%law = law
    allocate (self%rigid(p), source=.false.)
    allocate (self%k(p, p), self%g(p, p), self%c(p, p), self%part(p, p, size(law)), self%scale(p), source=0.0_wp)
  end subroutine make_room

  !> Products of all matrices with the basis.
  subroutine build(self, ds, basis, rigid)
    class(reduced_model), intent(out) :: self
    type(stiffness_system), intent(in) :: ds
    real(wp), intent(in) :: basis(:, :)                !! (n, p) [1/sqrt(kg)]
    logical, intent(in) :: rigid(:)                    !! (p)
    complex(wp) :: v(ds%n + ds%rows)
    real(wp), dimension(size(basis, 2)) :: level, g, c ! rounding of K [1/s2], of gyroscopic terms and of damping [1/s]
    integer :: j, r
    call self%make_room(size(basis, 2), [(ds%groups(r)%law, r=1, size(ds%groups))])
    self%basis = basis
    self%rigid = rigid
    do j = 1, self%p
      v = ds%padded(cmplx(basis(:, j), 0.0_wp, wp))
      self%k(:, j) = projected(ds%stiffness_product(v, 0))
      self%g(:, j) = projected(ds%times(cmplx(ds%gyro, 0.0_wp, wp), v))
      self%c(:, j) = projected(ds%times(cmplx(ds%c - ds%gyro, 0.0_wp, wp), v))
      do r = 1, size(ds%groups)
        self%part(:, j, r) = projected(ds%stiffness_product(v, r))
      end do
    end do
    if (ds%symmetric) self%k = 0.5_wp*(self%k + transpose(self%k))
    level = [(rounding_level(ds, basis(:, j)), j=1, self%p)]
    self%k = without_rounding(self%k, level)
    self%noise = reshape([(0.0_wp, j=1, 2*self%p)], [self%p, 2])
    do j = 1, self%p
      g = rounding*matmul(ds%real_times(abs(ds%gyro), abs(basis(:, j))), abs(basis))
      c = rounding*matmul(ds%real_times(abs(ds%c - ds%gyro), abs(basis(:, j))), abs(basis))
      where (abs(self%g(:, j)) <= g) self%g(:, j) = 0.0_wp
      where (abs(self%c(:, j)) <= c) self%c(:, j) = 0.0_wp
      self%noise(:, 1) = max(self%noise(:, 1), g)
      self%noise(:, 2) = max(self%noise(:, 2), c)
    end do
    self%c = without_rounding(self%c, spread(rounding**2*maxval([(self%c(j, j), j=1, self%p)]), 1, self%p))
    do j = 1, self%p
      if (.not. rigid(j)) cycle
      self%k(:, j) = 0.0_wp
      if (ds%conservative) self%k(j, :) = 0.0_wp
      self%part(:, j, :) = 0.0_wp
      self%part(j, :, :) = 0.0_wp
    end do
    call self%find_scale()
    level = sqrt(level)*max(0.0_wp, maxval(sqrt(level)/self%scale, .not. rigid))   ! positions of rigid motions act on nothing
    self%noise(:, 1) = max(self%noise(:, 1), level)
    self%noise(:, 2) = max(self%noise(:, 1), self%noise(:, 2))
  contains
    !> Components of a force on the basis.
    function projected(force) result(y)
      complex(wp), intent(in) :: force(:)   !! (n+rows) [N, N m]
      real(wp) :: y(size(basis, 2))
      y = matmul(real(force(1:ds%n), wp), basis)
    end function projected
  end subroutine build

  !> About the frequency of each motion.
  pure subroutine find_scale(self)
    class(reduced_model), intent(inout) :: self
    integer :: j, r
    do j = 1, self%p
      self%scale(j) = abs(self%k(j, j))
      do r = 1, size(self%law)
        self%scale(j) = self%scale(j) + sum(self%law(r)%alpha)*self%part(j, j, r)
      end do
    end do
    self%scale = sqrt(stiffness_scales(self%k, max(self%scale, 0.0_wp)))
    do j = 1, self%p
      self%scale(j) = max(self%scale(j), maxval(abs(self%g(:, j))), maxval(abs(self%c(:, j))))
      if (.not. self%scale(j) > 0.0_wp) self%scale(j) = 1.0_wp
    end do
  end subroutine find_scale

  !> Divides the motions into parts that do not couple; parts too large are divided where they couple least.
  subroutine split_into_parts(self, largest)
    class(reduced_model), intent(inout) :: self
    integer, intent(in) :: largest                     !! unknowns of first order beyond which a part is cut at weak couplings
    real(wp) :: coupling(self%p, self%p), threshold
    integer :: i, j, r, part, order
    do j = 1, self%p
      do i = 1, self%p
        associate (d => self%scale(i)*self%scale(j))
          coupling(i, j) = max(abs(self%k(i, j))/d, (abs(self%g(i, j)) + abs(self%c(i, j)))/sqrt(d))
          do r = 1, size(self%law)
            coupling(i, j) = max(coupling(i, j), sum(self%law(r)%alpha)*abs(self%part(i, j, r))/d)
          end do
        end associate
      end do
    end do
    coupling = max(coupling, transpose(coupling))
    allocate (self%label(self%p), source=0)
    self%parts = 0
    do j = 1, self%p
      if (self%label(j) > 0) cycle
      threshold = uncoupled
      do
        self%parts = self%parts + 1
        part = self%parts
        call label_coupled(j)
        order = order_of(self, pack([(i, i=1, self%p)], self%label == part))
        if (order <= largest .or. count(self%label == part) == 1) exit
        where (self%label == part) self%label = 0      ! cut higher and try again
        self%parts = self%parts - 1
        self%exact = .false.
        threshold = 3*threshold
      end do
    end do
  contains
    !> Labels all motions that couple to one, directly or through others.
    subroutine label_coupled(start)
      integer, intent(in) :: start
      logical :: mine(self%p), new(self%p)
      mine = .false.
      new = [(i == start, i=1, self%p)]
      do while (any(new))
        mine = mine .or. new
        new = self%label == 0 .and. .not. mine .and. [(any(coupling(:, i) > threshold .and. new), i=1, self%p)]
      end do
      where (mine) self%label = part
    end subroutine label_coupled
  end subroutine split_into_parts

  !> Unknowns of first order of some motions.
  integer function order_of(self, members) result(order)
    type(reduced_model), intent(in) :: self
    integer, intent(in) :: members(:)
    real(wp), allocatable :: f(:, :)
    integer :: r
    order = 2*size(members)
    do r = 1, size(self%law)
      call deformation(self, members, r, f)
      order = order + size(f, 2)*self%law(r)%order()
    end do
  end function order_of

  !> F of one set of terms in scaled unknowns, (K_r)_ij/(scale_i scale_j) = (F F^T)_ij.
  subroutine deformation(self, members, r, f)
    type(reduced_model), intent(in) :: self
    integer, intent(in) :: members(:), r
    real(wp), allocatable, intent(out) :: f(:, :)      !! (members, rank) [-]
    real(wp) :: a(size(members), size(members)), w(size(members)), work(40*size(members))
    integer :: i, n, info
    n = size(members)
    do i = 1, n
      a(:, i) = 0.5_wp*(self%part(members, members(i), r) + self%part(members(i), members, r)) &
                /(self%scale(members)*self%scale(members(i)))
    end do
    call dsyev('V', 'U', n, a, n, w, work, size(work), info)
    f = a(:, pack([(i, i=1, n)], w > negligible))
    w(1:size(f, 2)) = pack(w, w > negligible)
    do i = 1, size(f, 2)
      f(:, i) = sqrt(w(i))*f(:, i)
    end do
  end subroutine deformation

  !> All poles of one part, or those of its undamped system, or with the states of controllers.
  subroutine find(self, model, members, damped, ok, closed)
    class(reduced_poles), intent(out) :: self
    type(reduced_model), intent(in) :: model
    integer, intent(in) :: members(:)                  !! the motions of the part
    logical, intent(in) :: damped
    logical, intent(out) :: ok
    real(wp), intent(in), optional :: closed(:, :)     !! the system of first order with closed loops behind it [1/s]
    real(wp), allocatable :: a(:, :), wr(:), wi(:), vr(:, :), work(:)
    real(wp), allocatable :: noise(:), rest(:, :)      ! what is rounding in rows, the part without zeros [1/s]
    real(wp) :: left(1, 1)
    complex(wp) :: shape(size(members))                ! [-]
    complex(wp), allocatable :: state(:), lambda(:)    ! [any], [1/s]
    logical, allocatable :: kept(:), zero(:), moving(:)
    integer, allocatable :: states(:), found(:)
    integer :: n, c, e, zeros, j, k, r, info
    if (present(closed)) then
      a = closed
    else
      call first_order(model, members, damped, a)
    end if
    c = size(members)
    states = [pack([(j, j=1, c)], .not. model%rigid(members)), [(j, j=c + 1, size(a, 1))]]
    a = a(states, states)                              ! rigid positions, which act on nothing, are left out
    n = size(a, 1)
    e = count(.not. model%rigid(members))
    zeros = 0
    if (c > e) then
      allocate (noise(n), source=0.0_wp)
      noise(e + 1:e + c) = model%noise(members, merge(2, 1, damped))
      call nonzero_part(a, noise, rest, zeros)
    end if
    allocate (wr(n), wi(n), vr(n, n), work(34*n))
    call dgeev('N', 'V', n, a, n, wr, wi, left, 1, vr, n, work, size(work), info)
    ok = info == 0
    lambda = cmplx(wr, wi, wp)
    allocate (zero(n), source=.false.)
    do j = 1, zeros
      zero(minloc(abs(lambda), 1, .not. zero)) = .true.
    end do
    kept = wi >= 0.0_wp .and. .not. zero               ! a pole at zero is left out
    moving = spread(.true., 1, n)
    do r = 1, merge(size(model%law), 0, damped)        ! and one of a viscoelastic term alone, in which nothing moves
      associate (law => model%law(r))
        do k = 1, size(law%alpha)
          moving = moving .and. abs(1 + law%viscosity(k)*lambda + law%inertia(k)*lambda**2) > nothing
        end do
      end associate
    end do
    self%alone = count(.not. (moving .or. zero))
    kept = kept .and. moving
    self%lambda = pack(lambda, kept)
    found = pack([(j, j=1, n)], kept)
    allocate (self%shape(model%p, size(found)), source=(0.0_wp, 0.0_wp))
    do k = 1, size(found)
      j = found(k)
      state = vr(:, j)
      if (wi(j) > 0.0_wp) state = cmplx(vr(:, j), vr(:, j + 1), wp)
      where (model%rigid(members)) shape = state(e + 1:e + c)*model%scale(members)/self%lambda(k)
      self%shape(members, k) = unpack(state(1:e), .not. model%rigid(members), shape)/model%scale(members)
      if (.not. any(abs(self%shape(members, k)) > tiny(1.0_wp))) self%shape(members, k) = 1.0_wp  ! hardly anything moves: any shape
    end do
  end subroutine find

  !> The matrix of first order for (scale x, x', then F^T-sized z and, of second order, z'/omega of each term of each group).
  subroutine first_order(model, members, damped, a)
    type(reduced_model), intent(in) :: model
    integer, intent(in) :: members(:)
    logical, intent(in) :: damped
    real(wp), allocatable, intent(out) :: a(:, :)      !! [1/s]
    real(wp), allocatable :: f(:, :), whole(:, :)
    real(wp) :: omega                                  ! of a term of second order [rad/s]
    integer :: c, r, k, i, j, m, n, groups
    groups = merge(size(model%law), 0, damped)
    c = size(members)
    n = 2*c
    if (damped) n = order_of(model, members)
    allocate (a(n, n), source=0.0_wp)
    do j = 1, c
      a(j, c + j) = model%scale(members(j))
      a(c + 1:2*c, j) = -model%k(members, members(j))/model%scale(members(j))
      a(c + 1:2*c, c + j) = -model%g(members, members(j))
      if (damped) a(c + 1:2*c, c + j) = a(c + 1:2*c, c + j) - model%c(members, members(j))
    end do
    i = 2*c
    do r = 1, groups
      call deformation(model, members, r, f)
      m = size(f, 2)
      whole = f
      do j = 1, m
        whole(:, j) = f(:, j)*model%scale(members)
      end do
      associate (law => model%law(r))
        do k = 1, size(law%alpha)
          a(c + 1:2*c, 1:c) = a(c + 1:2*c, 1:c) - law%alpha(k)*matmul(whole, transpose(f))
          a(c + 1:2*c, i + 1:i + m) = law%alpha(k)*whole
          if (k <= law%second) then
            omega = 1/sqrt(law%inertia(k))
            a(i + m + 1:i + 2*m, 1:c) = omega*transpose(f)
            do j = 1, m
              a(i + j, i + m + j) = omega
              a(i + m + j, i + j) = -omega
              a(i + m + j, i + m + j) = -law%viscosity(k)*omega**2
            end do
            i = i + 2*m
          else
            a(i + 1:i + m, 1:c) = transpose(f)/law%viscosity(k)
            do j = 1, m
              a(i + j, i + j) = -1/law%viscosity(k)
            end do
            i = i + m
          end if
        end do
      end associate
    end do
  end subroutine first_order

  !> How many eigenvalues are zero, by the dimensions of null spaces: as many as there are dependent rows, then the same on the
  !> space that the rows span, until all rows are independent (Golub & Wilkinson 1976). The eigenvalues themselves do not show it:
  !> rounding moves zeros of a Jordan chain farther than slow turning moves others. What is left has the other eigenvalues.
  subroutine nonzero_part(matrix, rounded, a, zeros)
    real(wp), intent(in) :: matrix(:, :)               !! [1/s]
    real(wp), intent(in) :: rounded(:)                 !! what is rounding in each row [1/s]
    real(wp), allocatable, intent(out) :: a(:, :)      !! [1/s]
    integer, intent(out) :: zeros
    real(wp), allocatable :: q(:, :), noise(:), known(:), tau(:), work(:)
    integer, allocatable :: pivots(:)
    integer :: n, rank, j, info
    zeros = 0
    a = matrix
    noise = rounded
    do
      n = size(a, 1)
      if (n == 0) return
      q = transpose(a)
      known = [(max(dependent*maxval(abs(q(:, j))), noise(j), tiny(1.0_wp)), j=1, n)]
      do j = 1, n
        q(:, j) = q(:, j)/known(j)
      end do
      allocate (tau(n), work(66*n), source=0.0_wp)
      allocate (pivots(n), source=0)
      call dgeqp3(n, n, q, n, pivots, tau, work, size(work), info)
      rank = count([(abs(q(j, j)) > 1.0_wp, j=1, n)])
      if (rank == n) return
      zeros = zeros + n - rank
      call dorgqr(n, n, rank, q, n, tau, work, size(work), info)
      a = matmul(transpose(q(:, 1:rank)), matmul(a, q(:, 1:rank)))
      noise = matmul(noise, abs(q(:, 1:rank)))
      deallocate (tau, work, pivots)
    end do
  end subroutine nonzero_part
end module reduced_system
