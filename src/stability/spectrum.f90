!> The fast end of the mechanism's spectrum, by Lanczos iterations in the mass inner product with the structured solves of
!> `mass_solve`: with or without joints, at the present configuration. The stiffness is the instantaneous one,
!> E_R (1 + sum of alpha), of bodies and springs. Unknowns as in `linearisation`.
module spectrum
  use kinds, only: wp, half_digits
  use lapack, only: dsteqr
  use linear_matrices, only: linear_mechanism
  use linear_bodies, only: elastic_matrices
  use mass_solve, only: remove_joint_forces, solve_mass
  use evaluation_results, only: conditions_of, evaluation
  use measure, only: measured
  use mechanism, only: mechanism_model
  use spring_products, only: spring_square, spring_pull
  use springs, only: spring_model
  use triplets, only: triplet_matrix
  implicit none (type, external)
  private
  public :: fast_spectrum, fast_mode

  real(wp), parameter, public :: only_damping(2) = [1.0_wp, 0.0_wp], only_stiffness(2) = [0.0_wp, 1.0_wp]   !! a unit of one [-]
  real(wp), parameter, public :: no_part = half_digits   !! of a motion's stiffness in a segment that takes no part [-]

  integer, parameter :: most_vectors = 100     !! Lanczos vectors kept

  !> One fast mode, mass-normalised, with its Rayleigh quotients.
  type :: fast_mode
    real(wp) :: stiffness = 0.0_wp             !! x^T K x at E_R, springs static [1/s2]
    real(wp) :: damping = 0.0_wp               !! x^T C x [1/s]
    real(wp) :: springs = 0.0_wp               !! part of springs in x^T C x [1/s]
    real(wp), allocatable :: segments(:)       !! x^T K_r x of each segment [1/s2]
    real(wp), allocatable :: x(:)              !! (n) the mode [1/sqrt(kg)]
  end type fast_mode

  !> Operators and work space; set up once, used again during a run without allocation.
  type :: fast_spectrum
    type(linear_mechanism) :: lin              !! elastic matrices of the bodies
    real(wp), allocatable :: spring_static(:), spring_fast(:)   !! (force elements) [N/m] or [N m/rad]
    real(wp), allocatable :: spring_damping(:)   !! (force elements) [N s/m] or [N m s/rad]
    logical :: damped = .false.                !! by springs or by Rayleigh damping of bodies
    logical :: loops = .false.                 !! there are controllers, or forces that follow the motion of others
    real(wp), allocatable :: ends(:, :)        !! (2, force elements) factors (`safe_bound`), < 0: present direction [-]
    real(wp), allocatable :: turning(:)        !! (bodies) stiffness against turns by springs' forces, bound only [N m/rad]
    type(triplet_matrix) :: stiffness          !! of the bodies, instantaneous
    real(wp), allocatable :: v(:, :), w(:, :)  !! (n, most) Lanczos vectors and their products with the mass [kg^-.5, kg^.5]
    real(wp), allocatable :: r(:), u(:)        !! (n) force and displacement of an iteration [N], [m]
    real(wp), allocatable :: start(:)          !! (n) first force of the iteration [N, N m]
    real(wp), allocatable :: alpha(:), beta(:) !! the tridiagonal matrix [rad2/s2]
    real(wp), allocatable :: t(:, :), e(:), off(:), work(:)   !! its eigenvectors and eigenvalues [rad2/s2]
    integer :: steps = 0                       !! Lanczos vectors of the last iteration
  contains
    procedure :: set_up
    procedure :: take_present_springs
    procedure :: largest
    procedure :: mode
    procedure :: quotients
    procedure :: products
  end type fast_spectrum

contains

  !> Prepares the operators for a mechanism that has been evaluated once.
  subroutine set_up(self, m, ev, q)
    class(fast_spectrum), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: q(:)               !! (nq) the evaluated positions [m, rad]
    integer :: n, k, r, most
    n = m%s%nq
    call elastic_matrices(m, ev, q, self%lin)
    self%stiffness = self%lin%stiffness
    do r = 1, size(self%lin%segments)
      associate (segment => self%lin%segments(r)%stiffness, alpha => sum(self%lin%segments(r)%law%alpha))
        do k = 1, segment%count
          call self%stiffness%add(segment%rows(k), segment%cols(k), alpha*segment%values(k))
        end do
      end associate
    end do
    self%spring_static = [(m%s%forces(k)%item%stiffness, k=1, size(m%s%forces))]
    self%spring_fast = self%spring_static
    do k = 1, size(m%s%forces)
      associate (law => m%s%forces(k)%item%law)
        if (law%order() > 0) self%spring_fast(k) = self%spring_static(k)*(1 + sum(law%alpha))
      end associate
    end do
    self%spring_damping = [(m%s%forces(k)%item%damping, k=1, size(m%s%forces))]
    self%damped = any(self%spring_damping > 0.0_wp) .or. any(m%s%bodies%rayleigh)
    self%loops = size(m%s%controllers) > 0 .or. any([(m%s%forces(k)%item%motions > 0, k=1, size(m%s%forces))])
    allocate (self%ends(2, size(m%s%forces)), source=-1.0_wp)
    allocate (self%turning(size(m%s%bodies)), source=0.0_wp)
    most = min(n, most_vectors)
    allocate (self%v(n, most + 1), self%w(n, 0:most + 1), self%r(n), self%u(n), self%alpha(most), &
              self%beta(0:most), self%t(most, most), self%e(most), self%off(most), self%work(2*most))
    self%start = [(sin(1.3_wp*k**2) + 0.1_wp, k=1, n)]
  end subroutine set_up

  !> Springs with a characteristic count with their stiffness at the evaluated state, in place of the largest.
  pure subroutine take_present_springs(self, m, ev)
    class(fast_spectrum), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    type(measured) :: now
    integer :: k
    do k = 1, m%s%springs
      select type (f => m%s%forces(k)%item)
      class is (spring_model)
        if (.not. allocated(f%history)) cycle
        now = f%deformation(ev%p)
        self%spring_static(k) = f%present_stiffness(conditions_of(m, ev, k), now%x)
        self%spring_fast(k) = self%spring_static(k)
      end select
    end do
  end subroutine take_present_springs

  !> Largest eigenvalue of (p C + q K) x = lambda M x by at most `most` Lanczos steps; with or without joints. m holds an
  !> evaluation at the present configuration. Where asked K is the static stiffness of one segment's material or spring alone.
  subroutine largest(self, m, ev, with_joints, mix, most, lambda, segment)
    class(fast_spectrum), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    logical, intent(in) :: with_joints              !! joints and drives act
    real(wp), intent(in) :: mix(2)           !! p and q: [s], [s2], or [-] with one of them zero
    integer, intent(in) :: most              !! Lanczos steps
    real(wp), intent(out) :: lambda          !! [-], or with p or q alone [1/s], [rad2/s2]
    integer, intent(in), optional :: segment !! of viscoelastic terms; 0: none
    real(wp) :: b
    integer :: j, info, chosen
    logical :: last
    chosen = 0
    if (present(segment)) chosen = segment
    lambda = 0.0_wp
    self%steps = 0
    self%w(:, 0) = 0.0_wp
    self%r = self%start
    call solve_mass(m, ev, with_joints, self%r, self%u)
    if (with_joints .and. self%loops) call remove_joint_forces(m, ev, self%r)
    b = sqrt(max(dot_product(self%u, self%r), 0.0_wp))
    if (b <= tiny(1.0_wp)) return
    self%v(:, 1) = self%u/b
    self%w(:, 1) = self%r/b
    self%beta(0) = 0.0_wp
    do j = 1, min(most, size(self%alpha))
      if (chosen > 0) then
        call multiply_segment(self, m, ev, chosen, self%v(:, j), self%r)
      else
        call multiply(self, m, ev, mix, self%v(:, j), self%r)
      end if
      self%alpha(j) = dot_product(self%v(:, j), self%r)
      self%r = self%r - self%alpha(j)*self%w(:, j) - self%beta(j - 1)*self%w(:, j - 1)
      call remove_earlier(size(self%r), j, self%v, self%w(:, 1:), self%r)
      call solve_mass(m, ev, with_joints, self%r, self%u)
      if (with_joints .and. self%loops) call remove_joint_forces(m, ev, self%r)
      b = sqrt(max(dot_product(self%u, self%r), 0.0_wp))
      self%steps = j
      self%beta(j) = b
      last = j == min(most, size(self%alpha)) .or. b <= 1.0e-10_wp*abs(self%alpha(1)) + tiny(b)
      if (mod(j, 8) == 0 .or. last) then
        self%e(1:j) = self%alpha(1:j)
        self%off(1:j) = self%beta(1:j)
        call dsteqr('I', j, self%e, self%off, self%t, size(self%t, 1), self%work, info)
        lambda = self%e(j)
        if (last .or. b*abs(self%t(j, j)) <= 1.0e-5_wp*max(abs(lambda), abs(self%e(1)))) exit
      end if
      self%v(:, j + 1) = self%u/b
      self%w(:, j + 1) = self%r/b
    end do
  end subroutine largest

  !> Makes the force of an iteration orthogonal to earlier vectors, by loops: products of matrices would allocate.
  pure subroutine remove_earlier(n, vectors, v, w, r)
    integer, intent(in) :: n, vectors
    real(wp), intent(in) :: v(n, vectors)    !! the vectors [kg^-.5]
    real(wp), intent(in) :: w(n, vectors)    !! their products with the mass [kg^.5]
    real(wp), intent(inout) :: r(n)          !! [N]
    real(wp) :: sums(8)                      ! eight sums at a time: each addition to a single one waits for the one before
    integer :: i, k
    do i = 1, vectors
      sums = 0.0_wp
      do k = 1, n - 7, 8
        sums = sums + v(k:k + 7, i)*r(k:k + 7)
      end do
      r = r - (sum(sums) + dot_product(v(k:n, i), r(k:n)))*w(:, i)
    end do
  end subroutine remove_earlier

  !> The k-th fastest mode of the last iteration with its Rayleigh quotients. A mode that had room allocates nothing.
  subroutine mode(self, m, ev, k, f)
    class(fast_spectrum), intent(in) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: k                 !! 1: the fastest
    type(fast_mode), intent(inout) :: f
    integer :: i
    if (.not. allocated(f%x)) allocate (f%x(size(self%r)))
    f%x(:) = 0.0_wp
    do i = 1, self%steps
      f%x(:) = f%x + self%t(i, self%steps + 1 - k)*self%v(:, i)
    end do
    call self%quotients(m, ev, f)
  end subroutine mode

  !> Rayleigh quotients of a motion f%x of unit modal mass.
  subroutine quotients(self, m, ev, f)
    class(fast_spectrum), intent(in) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    type(fast_mode), intent(inout) :: f
    real(wp) :: square                       ! of a spring's deformation [m2] or [rad2]
    integer :: j, r
    if (.not. allocated(f%segments)) allocate (f%segments(size(self%lin%segments)))
    f%stiffness = self%lin%stiffness%quadratic_form(f%x)
    do j = 1, size(self%turning)
      f%stiffness = f%stiffness + self%turning(j)*f%x(m%s%qo(j) + 3)**2
    end do
    f%damping = self%lin%damping%quadratic_form(f%x)
    f%springs = 0.0_wp
    do r = 1, size(self%lin%segments)
      f%segments(r) = self%lin%segments(r)%stiffness%quadratic_form(f%x)     ! zero of a spring: it follows
    end do
    do j = 1, size(m%s%forces)
      if (.not. (self%spring_static(j) > 0.0_wp .or. self%spring_damping(j) > 0.0_wp)) cycle
      square = spring_square(m, ev, j, self%ends(:, j), f%x)
      f%stiffness = f%stiffness + self%spring_static(j)*square
      f%springs = f%springs + self%spring_damping(j)*square
      do r = 1, size(self%lin%segments)
        if (self%lin%segments(r)%element == j) f%segments(r) = self%spring_static(j)*square
      end do
    end do
    f%damping = f%damping + f%springs
  end subroutine quotients

  !> K x at E_R, springs static, C x, and K_r x of the segments, summed by their groups.
  subroutine products(self, m, ev, group, x, stiffness, damping, parts)
    class(fast_spectrum), intent(in) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: group(:)          !! (segments) 0: left out
    real(wp), intent(in) :: x(:)             !! (n) [1/sqrt(kg)]
    real(wp), intent(out) :: stiffness(:), damping(:), parts(:, :)   !! (n), (n), (n, groups) [kg^.5/s2], [kg^.5/s], [kg^.5/s2]
    integer :: j, r
    stiffness = 0.0_wp
    damping = 0.0_wp
    parts = 0.0_wp
    call self%lin%stiffness%times(1.0_wp, x, stiffness)
    call self%lin%damping%times(1.0_wp, x, damping)
    do j = 1, size(self%turning)
      r = m%s%qo(j) + 3
      stiffness(r) = stiffness(r) + self%turning(j)*x(r)
    end do
    do j = 1, size(m%s%forces)
      call spring_pull(m, ev, j, self%spring_static(j), self%ends(:, j), x, stiffness)
      call spring_pull(m, ev, j, self%spring_damping(j), self%ends(:, j), x, damping)
    end do
    do r = 1, size(group)
      if (group(r) == 0) cycle
      call self%lin%segments(r)%stiffness%times(1.0_wp, x, parts(:, group(r)))       ! zero of a spring: it follows
      j = self%lin%segments(r)%element
      if (j > 0) call spring_pull(m, ev, j, self%spring_static(j), self%ends(:, j), x, parts(:, group(r)))
    end do
  end subroutine products

  !> y = (p C + q K) x, K instantaneous, of bodies and springs. Springs that may turn count only where they raise it. Forces of
  !> springs against turns are an upper bound, too.
  subroutine multiply(self, m, ev, mix, x, y)
    class(fast_spectrum), intent(in) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: mix(2)             !! p and q, as in `largest`: [s], [s2]
    real(wp), intent(in) :: x(:)               !! (n) [m], [rad]
    real(wp), intent(out) :: y(:)              !! (n) [N, N m]
    real(wp) :: s
    integer :: i, k
    y = 0.0_wp
    if (abs(mix(1)) > 0.0_wp) call self%lin%damping%times(mix(1), x, y)
    if (abs(mix(2)) > 0.0_wp) call self%stiffness%times(mix(2), x, y)
    do k = 1, size(self%turning)
      i = m%s%qo(k) + 3
      y(i) = y(i) + max(mix(2), 0.0_wp)*self%turning(k)*x(i)
    end do
    do k = 1, size(m%s%forces)
      s = mix(1)*self%spring_damping(k) + mix(2)*self%spring_fast(k)
      if (all(self%ends(:, k) >= 0.0_wp)) s = max(s, 0.0_wp)
      call spring_pull(m, ev, k, s, self%ends(:, k), x, y)
    end do
  end subroutine multiply

  !> y = K_r x, the static stiffness of the chosen segment's material wherever it is, or of its spring.
  subroutine multiply_segment(self, m, ev, segment, x, y)
    class(fast_spectrum), intent(in) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: segment
    real(wp), intent(in) :: x(:)            !! (n) [m, rad]
    real(wp), intent(out) :: y(:)           !! (n) [N, N m]
    integer :: k
    y = 0.0_wp
    associate (segments => self%lin%segments, r => self%lin%segments(segment))
      if (r%element > 0) then
        call spring_pull(m, ev, r%element, self%spring_static(r%element), self%ends(:, r%element), x, y)
        return
      end if
      do k = 1, size(segments)
        if (segments(k)%element == 0 .and. segments(k)%material == r%material) call segments(k)%stiffness%times(1.0_wp, x, y)
      end do
    end associate
  end subroutine multiply_segment
end module spectrum
