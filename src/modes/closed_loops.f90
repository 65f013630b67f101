!> Controllers in linear algebra, about an evaluated state (theory.md, section 14), each as if it had no limits. T(s) is that of
!> open loops. Controller c has the transfer function H_c from the sensed quantity, g_c(s).x, to its forces b_c: closing its loop
!> adds -H_c b_c g_c^T. All poles are eigenvalues of the whole system of first order.
module closed_loops
  use kinds, only: wp
  use controller, only: controller_model, free
  use dynamic_stiffness, only: stiffness_system
  use evaluation_results, only: conditions_of, evaluation
  use force_element, only: stage_static
  use frame_axes, only: add_force
  use gyroscopic_modes, only: rigid_motions_first
  use lapack, only: dgebal, dgeev
  use linear_matrices, only: linear_mechanism
  use linearisation, only: marker_jacobian, rate_jacobian
  use loads, only: load_model
  use mechanism, only: mechanism_model
  use natural_modes, only: lowest_natural_modes, rounding_level
  use reduced_system, only: first_order, nonzero_part, reduced_model
  use sorting, only: ascending
  use triplets, only: triplet_matrix
  implicit none (type, external)
  private

  integer, parameter, public :: most_states = 1000     !! of which all poles are computed

  !> The loops.
  type, public :: loop_system
    integer :: n = 0                                   !! controllers
    type(controller_model), allocatable :: law(:)      !! (n)
    real(wp), allocatable :: b(:, :)                   !! (unknowns, n) forces of a unit output [N, N m]
    real(wp), allocatable :: place(:, :)               !! (unknowns, n) g = place + s rate [-], [m], [1/s]
    real(wp), allocatable :: rate(:, :)                !! [-], [m]
  contains
    procedure :: build
    procedure :: couple
    procedure :: factor_closed
    procedure :: opened
    procedure :: add_loops
    procedure :: poles
  end type loop_system

  !> Poles, those with Im >= 0, by ascending modulus.
  type, public :: known_poles
    complex(wp), allocatable :: lambda(:)              !! [1/s]
    real(wp), allocatable :: error(:)                  !! of each; a zero that was counted has none [1/s]
  end type known_poles

contains

  !> The loops about an evaluated state; none where no force follows a controller.
  subroutine build(self, m, ev, v)
    class(loop_system), intent(out) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: v(:)                       !! (nq) rates [m/s, rad/s]
    real(wp) :: by_place(6), by_rate(6)
    integer :: k
    self%n = size(m%s%controllers)
    allocate (self%law, source=m%s%controllers)
    allocate (self%b(m%s%nq, self%n), self%place(m%s%nq, self%n), self%rate(m%s%nq, self%n), source=0.0_wp)
    do k = 1, self%n
      associate (q => m%s%controllers(k)%quantity)
        call q%gradient(ev%p, by_place, by_rate)
        call add_motion(q%ia, by_place(1:3), by_rate(1:3), self%place(:, k), self%rate(:, k))
        call add_motion(q%ib, by_place(4:6), by_rate(4:6), self%place(:, k), self%rate(:, k))
      end associate
    end do
    do k = 1, size(m%s%forces)
      select type (f => m%s%forces(k)%item)
      class is (load_model)
        if (f%controller == 0 .or. f%stage == stage_static) cycle
        call add_force(m, ev, f%ia, f%unit_wrench(ev%p, conditions_of(m, ev, k)), self%b(:, f%controller))
      end select
    end do
  contains
    !> Adds a marker's position and rate as functions of the unknowns and their rates.
    subroutine add_motion(marker, by_place, by_rate, place, rate)
      integer, intent(in) :: marker
      real(wp), intent(in) :: by_place(3), by_rate(3)  !! [-], [m], [1/s]
      real(wp), intent(inout) :: place(:), rate(:)     !! (nq) [-], [m], [1/s]
      integer, allocatable :: cols(:)
      real(wp), allocatable :: jac(:, :)
      call marker_jacobian(m, ev, marker, cols, jac)
      if (size(cols) == 0) return
      place(cols) = place(cols) + matmul(by_place, jac) + matmul(by_rate, rate_jacobian(m, ev, marker, v, jac))
      rate(cols) = rate(cols) + matmul(by_rate, jac)
    end subroutine add_motion
  end subroutine build

  !> Adds the loops to a linear system, so that its dynamic stiffness can close them.
  subroutine couple(self, lin)
    class(loop_system), intent(in) :: self
    type(linear_mechanism), intent(inout) :: lin
    integer :: k
    allocate (lin%controlled(self%n))
    do k = 1, self%n
      call add_product(self%b(:, k), self%place(:, k), lin%controlled(k)%place)
      call add_product(self%b(:, k), self%rate(:, k), lin%controlled(k)%rate)
    end do
  contains
    !> Adds -b g^T.
    subroutine add_product(b, g, a)
      real(wp), intent(in) :: b(:), g(:)               !! (unknowns) [N, N m]; [-], [m], [1/s]
      type(triplet_matrix), intent(inout) :: a
      integer :: i
      associate (rows => pack([(i, i=1, size(b))], abs(b) > 0.0_wp), cols => pack([(i, i=1, size(g))], abs(g) > 0.0_wp))
        call a%add_block(rows, cols, -matmul(reshape(b(rows), [size(rows), 1]), reshape(g(cols), [1, size(cols)])))
      end associate
    end subroutine add_product
  end subroutine couple

  !> Factors the dynamic stiffness at s with the loops closed, all or all but one. An open loop that is singular there, as of a free
  !> motion or at its own mode, does no harm.
  subroutine factor_closed(self, ds, s, opened)
    class(loop_system), intent(in) :: self
    type(stiffness_system), intent(inout) :: ds
    complex(wp), intent(in) :: s                       !! [1/s]
    integer, intent(in) :: opened                      !! controller of the loop that is opened, 0: none
    integer :: k
    call ds%set(s, 1.0_wp)
    do k = 1, self%n
      if (k /= opened) call ds%close_loop(k, self%law(k)%response(free, s))
    end do
    call ds%factor()
  end subroutine factor_closed

  !> The loop of one controller opened, all others closed: -H y of a unit output, 1 + that is zero at a pole.
  complex(wp) function opened(self, ds, s, c) result(l)
    class(loop_system), intent(in) :: self
    type(stiffness_system), intent(inout) :: ds
    complex(wp), intent(in) :: s                       !! [1/s]
    integer, intent(in) :: c                           !! controller
    complex(wp) :: x(ds%n + ds%rows)                   ! [m, rad], [N]
    call self%factor_closed(ds, s, c)
    x = ds%padded(cmplx(self%b(:, c), 0.0_wp, wp))
    call ds%solve(x)
    l = -self%law(c)%response(free, s)*sum((self%place(:, c) + s*self%rate(:, c))*x(1:ds%n))
  end function opened

  !> All poles with all loops closed, or with one opened. Parts that do not couple are solved one by one, so that slow motions keep
  !> their digits beside stiff ones.
  subroutine poles(self, ds, opened, found, states, ok)
    class(loop_system), intent(in) :: self
    type(stiffness_system), intent(inout), target :: ds
    integer, intent(in) :: opened                      !! controller of the loop that is opened, 0: none
    type(known_poles), intent(out) :: found
    integer, intent(out) :: states                     !! above `most_states` no pole is computed
    logical, intent(out) :: ok                         !! false: the eigenvalues do not converge
    type(reduced_model) :: model
    real(wp), allocatable :: omega2(:), x(:, :), rotated(:, :), a(:, :), noise(:)
    integer, allocatable :: label(:), order(:), members(:)
    integer :: j, c, rigid, part
    c = ds%n - ds%rows
    states = 2*c + sum(self%law%states)
    allocate (found%lambda(0), found%error(0))
    ok = .true.
    if (states == 0 .or. states > most_states) return
    call lowest_natural_modes(ds, c, .true., omega2, x, ok)
    if (.not. ok) return
    if (ds%symmetric .or. c == 0) then
      call model%build(ds, x, [(abs(omega2(j)) <= rounding_level(ds, x(:, j)), j=1, c)])
    else
      call rigid_motions_first(ds, x, rotated, rigid, ok)
      if (.not. ok) return
      call model%build(ds, rotated, [(j <= rigid, j=1, c)])
    end if
    call find_loop_scale(self, model)
    call first_order(model, [(j, j=1, c)], .true., a)
    allocate (noise(size(a, 1)), source=0.0_wp)
    noise(c + 1:2*c) = model%noise(:, 2)
    call self%add_loops(model, opened, a, noise)
    states = size(a, 1)
    if (states > most_states) return
    label = parts_of(a)
    do part = 1, maxval(label)
      members = pack([(j, j=1, states)], label == part)
      call add_part(a(members, members), noise(members), count(members <= 2*c), found, ok)
      if (.not. ok) return
    end do
    order = ascending(abs(found%lambda))
    found%lambda = found%lambda(order)
    found%error = found%error(order)
  end subroutine poles

  !> Scales of motions with loops: what a controller does to a motion that it senses in it counts as its stiffness and damping.
  pure subroutine find_loop_scale(self, model)
    class(loop_system), intent(in) :: self
    type(reduced_model), intent(inout) :: model
    real(wp), dimension(model%p) :: force, place, rate, scale, own   ! [N/sqrt(kg)], [any/sqrt(kg)]; [rad/s]
    integer :: j, k, n
    scale = 0.0_wp
    do k = 1, self%n
      force = abs(matmul(self%b(:, k), model%basis))
      place = abs(matmul(self%place(:, k), model%basis))
      rate = abs(matmul(self%rate(:, k), model%basis))
      n = self%law(k)%states
      associate (by_value => abs(self%law(k)%output(n + 1, free)), by_rate => abs(self%law(k)%output(n + 2, free)))
        scale = max(scale, sqrt(force*place*by_value), force*(place*by_rate + rate*by_value))
      end associate
    end do
    own = [(maxval(abs(model%k(:, j))) + maxval(abs(model%g(:, j))) + maxval(abs(model%c(:, j))), j=1, model%p)]
    where (scale > 0.0_wp) model%scale = merge(max(model%scale, scale), scale, own > 0.0_wp)
  end subroutine find_loop_scale

  !> Numbers the parts of a matrix that do not couple.
  pure function parts_of(a) result(label)
    real(wp), intent(in) :: a(:, :)                    !! [1/s]
    integer :: label(size(a, 1))
    logical :: mine(size(a, 1)), new(size(a, 1))
    integer :: i, j, parts
    label = 0
    parts = 0
    do j = 1, size(label)
      if (label(j) > 0) cycle
      parts = parts + 1
      mine = .false.
      new = [(i == j, i=1, size(label))]
      do while (any(new))
        mine = mine .or. new
        new = [(.not. mine(i) .and. any((abs(a(:, i)) > 0.0_wp .or. abs(a(i, :)) > 0.0_wp) .and. new), i=1, size(label))]
      end do
      where (mine) label = parts
    end do
  end function parts_of

  !> Adds the eigenvalues of one part, of each conjugate pair that with Im >= 0. Zeros are counted by null spaces and are exact.
  !> Each other one is corrected by its residual, r = y^H (A x - lambda x)/(y^H x). What is left is rounding of that sum, and what
  !> rounding of the whole matrix makes of the vectors, squared over the distance to the next one.
  subroutine add_part(matrix, noise, motions, found, ok)
    real(wp), intent(in) :: matrix(:, :)               !! [1/s]
    real(wp), intent(in) :: noise(:)                   !! what is rounding in each row [1/s]
    integer, intent(in) :: motions                     !! unknowns whose columns have this rounding, the first ones
    type(known_poles), intent(inout) :: found
    logical, intent(out) :: ok
    real(wp), parameter :: rounding = 10*epsilon(1.0_wp)   ! of eigenvalues, over the norm of the matrix and their condition [-]
    real(wp), parameter :: enough = 1.0e-12_wp         ! error that needs no correction, over the modulus [-]
    real(wp), allocatable :: a(:, :), b(:, :), wr(:), wi(:), vl(:, :), vr(:, :), work(:)
    real(wp) :: scale(size(noise))                     ! of the unknowns: from here on sizes of rows and vectors mean something
    complex(wp), allocatable :: x(:), y(:), lambda(:)  ! [any], [1/s]
    real(wp) :: first, gap, error                      ! [1/s]
    complex(wp) :: yx                                  ! [-]
    integer :: i, j, n, zeros, low, high, info
    b = matrix
    call dgebal('S', size(noise), b, size(noise), low, high, scale, info)
    call nonzero_part(b, noise*maxval([0.0_wp, scale(:motions)])/scale, a, zeros)
    found%lambda = [found%lambda, [((0.0_wp, 0.0_wp), j=1, zeros)]]
    found%error = [found%error, [(0.0_wp, j=1, zeros)]]
    n = size(a, 1)
    ok = .true.
    if (n == 0) return
    allocate (wr(n), wi(n), vl(n, n), vr(n, n), work(34*n))
    b = a
    call dgeev('V', 'V', n, b, n, wr, wi, vl, n, vr, n, work, size(work), info)
    ok = info == 0
    if (.not. ok) return
    lambda = cmplx(wr, wi, wp)
    do j = 1, n
      if (wi(j) < 0.0_wp) cycle
      x = vr(:, j)
      y = vl(:, j)
      if (wi(j) > 0.0_wp) x = cmplx(vr(:, j), vr(:, j + 1), wp)
      if (wi(j) > 0.0_wp) y = cmplx(vl(:, j), vl(:, j + 1), wp)
      yx = dot_product(y, x)
      first = rounding*norm2(a)*norm2(abs(x))*norm2(abs(y))/max(abs(yx), tiny(1.0_wp))
      gap = minval([huge(1.0_wp), pack(abs(lambda - lambda(j)), [(i /= j, i=1, n)])])
      error = first
      if (first > enough*abs(lambda(j)) .and. first < 0.5_wp*gap) then
        lambda(j) = lambda(j) + dot_product(y, matmul(a, x) - lambda(j)*x)/yx
        error = min(first, first**2/gap + rounding*sum(abs(y)*(matmul(abs(a), abs(x)) + abs(lambda(j))*abs(x)))/abs(yx))
      end if
      if (.not. wi(j) > 0.0_wp) lambda(j)%im = 0.0_wp
      found%lambda = [found%lambda, lambda(j)]
      found%error = [found%error, error]
    end do
  end subroutine add_part

  !> Adds all controllers to the system of first order of a model, with all loops closed or one opened.
  subroutine add_loops(self, model, opened, a, noise)
    class(loop_system), intent(in) :: self
    type(reduced_model), intent(in) :: model
    integer, intent(in) :: opened                      !! controller of the loop that is opened, 0: none
    real(wp), allocatable, intent(inout) :: a(:, :)    !! of all motions, then with the controllers' states behind [1/s]
    real(wp), allocatable, intent(inout), optional :: noise(:)   !! what is rounding in each row [1/s]
    real(wp), allocatable :: whole(:, :), level(:)
    integer :: k, n, states
    n = size(a, 1)
    states = n + sum(self%law%states)
    allocate (whole(states, states), source=0.0_wp)
    whole(1:n, 1:n) = a
    allocate (level(states), source=0.0_wp)
    if (present(noise)) level(1:n) = noise
    do k = 1, self%n
      call add_loop(self, k, merge(0.0_wp, 1.0_wp, k == opened), model, model%p, n, whole, level)
      n = n + self%law(k)%states
    end do
    call move_alloc(whole, a)
    if (present(noise)) call move_alloc(level, noise)
  end subroutine add_loops

  !> One loop in the system of first order, whose first unknowns are scale times the motions, then their rates. What a motion that
  !> the controller does not see leaves of sums is rounding.
  subroutine add_loop(self, k, gain, model, c, before, a, noise)
    class(loop_system), intent(in) :: self
    integer, intent(in) :: k                           !! controller
    real(wp), intent(in) :: gain                       !! 0: its output does not act, the loop is open; else 1 [-]
    type(reduced_model), intent(in) :: model
    integer, intent(in) :: c                           !! motions
    integer, intent(in) :: before                      !! unknowns before the controller's states
    real(wp), intent(inout) :: a(:, :)                 !! [1/s]
    real(wp), intent(inout) :: noise(:)                !! what is rounding in each row [1/s]
    real(wp), dimension(c) :: force, place, rate, force_noise, place_noise, rate_noise
    real(wp), dimension(size(a, 1)) :: y, yd, y_noise, yd_noise
    integer :: i, n
    call on_basis(self%b(:, k), force, force_noise)
    call on_basis(self%place(:, k), place, place_noise)
    call on_basis(self%rate(:, k), rate, rate_noise)
    force = gain*force
    y = [place/model%scale, rate, [(0.0_wp, i=1, size(a, 1) - 2*c)]]
    yd = [[(0.0_wp, i=1, c)], place, [(0.0_wp, i=1, size(a, 1) - 2*c)]]     ! asked for only where the quantity is no rate
    y_noise = [place_noise/model%scale, rate_noise, [(0.0_wp, i=1, size(a, 1) - 2*c)]]
    yd_noise = [[(0.0_wp, i=1, c)], place_noise, [(0.0_wp, i=1, size(a, 1) - 2*c)]]
    associate (law => self%law(k))
      n = law%states
      do i = 1, c
        a(c + i, :) = a(c + i, :) + force(i)*(law%output(n + 1, free)*y + law%output(n + 2, free)*yd)
        a(c + i, before + 1:before + n) = a(c + i, before + 1:before + n) + force(i)*law%output(1:n, free)
        noise(c + i) = max(noise(c + i), abs(force(i))*maxval(abs(law%output(n + 1, free))*y_noise &
                                                              + abs(law%output(n + 2, free))*yd_noise))
      end do
      do i = 1, n
        a(before + i, :) = law%rates(i, n + 1, free)*y + law%rates(i, n + 2, free)*yd
        a(before + i, before + 1:before + n) = a(before + i, before + 1:before + n) + law%rates(i, 1:n, free)
        noise(before + i) = maxval(abs(law%rates(i, n + 1, free))*y_noise + abs(law%rates(i, n + 2, free))*yd_noise)
      end do
    end associate
  contains
    !> Components on the basis, without those that are rounding: of their own sum, or of the basis, which mixes motions.
    pure subroutine on_basis(v, x, level)
      real(wp), intent(in) :: v(:)                     !! (unknowns) [any]
      real(wp), intent(out) :: x(:), level(:)          !! (motions) components, their rounding [any/sqrt(kg)]
      x = matmul(v, model%basis)
      level = 1.0e3_wp*epsilon(1.0_wp)*max(matmul(abs(v), abs(model%basis)), maxval(abs(x)))
      where (abs(x) <= level) x = 0.0_wp
    end subroutine on_basis
  end subroutine add_loop
end module closed_loops
